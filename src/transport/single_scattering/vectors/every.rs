//! A ray through every sub-texel from every depth: slow and plain, the truth that shared rays are measured against.

use super::super::interface::{Refraction, inside_direction};
use super::probes::{Line, ProbeMemory, Prober, Request};
use crate::math::cube_map::{FACES, direction};

/// Adds the vector of a point to `out`.
pub(super) fn every_direction(prober: &Prober, line: &Line, memory: &mut ProbeMemory, out: &mut [f32]) {
    let side = prober.settings.side;
    let (count, texels) = (prober.settings.phase.count(), prober.texels());
    let (extinction, eta) = (line.optics.sigma_t_per_mm, line.optics.eta_inside_over_outside);
    let mut terms = vec![0.0; count];
    for (index, depth) in line.depths.iter().enumerate() {
        for at in 0..FACES * side {
            let (face, row) = (at / side, at % side);
            memory.requests.clear();
            memory.probes.clear();
            for sub in 0..4 * side {
                let (x, y) = (sub % (2 * side), 2 * row + sub / (2 * side));
                memory.requests.push(Request { depth: index as u32, direction: direction(2 * side, face, x, y) });
            }
            prober.trace(line, memory);
            for (sub, (probe, request)) in memory.probes.iter().zip(&memory.requests).enumerate() {
                let texel = at * side + sub % (2 * side) / 2;
                let angle = f64::from(prober.angles[texel % (side * side)]);
                let cosine = probe.normal.as_dvec3().dot(request.direction);
                let Some(refraction) = Refraction::new(prober.settings.form, eta, cosine) else { continue };
                let normal = probe.normal.as_dvec3();
                let inside = inside_direction(eta, request.direction, normal, cosine, refraction.cos_inside);
                prober.settings.phase.evaluate(inside, &mut terms);
                let path_mm = f64::from(probe.height_mm) / cosine * refraction.stretch;
                for channel in 0..3 {
                    let attenuated = (-extinction[channel] * path_mm).exp();
                    let arriving = refraction.gain * f64::from(probe.through[channel]);
                    let value = depth.weight[channel] * attenuated * arriving * (0.25 * angle);
                    for (k, g) in terms.iter().enumerate() {
                        out[(k * 3 + channel) * texels + texel] += (value * g) as f32;
                    }
                }
            }
        }
    }
}
