//! A ray through every sub-texel from every depth: slow, plain, and what sharing is measured against.

use super::super::interface::{Entry, inside_direction};
use super::{Line, Request, VectorBaker, Work};
use crate::math::cube_map::{FACES, direction};

/// Adds the vector of a point to `out`.
pub(super) fn every_direction(baker: &VectorBaker, line: &Line, work: &mut Work, out: &mut [f32]) {
    let side = baker.settings.side;
    let (count, texels) = (baker.settings.phase.count(), baker.texels());
    let (extinction, eta) = (line.optics.sigma_t_per_mm, line.optics.eta_inside_over_outside);
    let mut terms = vec![0.0; count];
    for (index, depth) in line.depths.iter().enumerate() {
        for at in 0..FACES * side {
            let (face, row) = (at / side, at % side);
            work.requests.clear();
            work.probes.clear();
            for sub in 0..4 * side {
                let (x, y) = (sub % (2 * side), 2 * row + sub / (2 * side));
                work.requests.push(Request { depth: index as u32, direction: direction(2 * side, face, x, y) });
            }
            baker.trace(line, &work.requests, &mut work.tracer, &mut work.probes);
            for (sub, (probe, request)) in work.probes.iter().zip(&work.requests).enumerate() {
                let texel = at * side + sub % (2 * side) / 2;
                let angle = f64::from(baker.angles[texel % (side * side)]);
                let cosine = probe.normal.as_dvec3().dot(request.direction);
                let Some(entry) = Entry::new(baker.settings.form, eta, cosine) else { continue };
                let normal = probe.normal.as_dvec3();
                let inside = inside_direction(eta, request.direction, normal, cosine, entry.cos_inside);
                baker.settings.phase.evaluate(inside, &mut terms);
                let path_mm = f64::from(probe.height_mm) / cosine * entry.stretch;
                for channel in 0..3 {
                    let attenuated = (-extinction[channel] * path_mm).exp();
                    let arriving = entry.gain * f64::from(probe.through[channel]);
                    let value = depth.weight[channel] * attenuated * arriving * (0.25 * angle);
                    for (k, g) in terms.iter().enumerate() {
                        out[(k * 3 + channel) * texels + texel] += (value * g) as f32;
                    }
                }
            }
        }
    }
}
