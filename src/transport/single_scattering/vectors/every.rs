//! A ray through every sub-texel from every depth: slow, plain, and what sharing is measured against.

use super::{Line, Request, VectorBaker, Work};
use crate::math::cube_map::{FACES, direction};

/// Adds the vector of a point to `out`.
pub(super) fn every_direction(baker: &VectorBaker, line: &Line, work: &mut Work, out: &mut [f32]) {
    let side = baker.settings.side;
    let (count, texels) = (baker.settings.phase.count(), baker.texels());
    let extinction = line.optics.sigma_t_per_mm;
    for (index, depth) in line.depths.iter().enumerate() {
        for at in 0..FACES * side {
            let (face, row) = (at / side, at % side);
            work.requests.clear();
            work.probes.clear();
            work.terms.clear();
            for sub in 0..4 * side {
                let (x, y) = (sub % (2 * side), 2 * row + sub / (2 * side));
                work.requests.push(Request { depth: index as u32, direction: direction(2 * side, face, x, y) });
            }
            baker.trace(line, &work.requests, &mut work.tracer, &mut work.probes, &mut work.terms);
            for (sub, (probe, terms)) in work.probes.iter().zip(work.terms.chunks_exact(count)).enumerate() {
                let texel = at * side + sub % (2 * side) / 2;
                let angle = f64::from(baker.angles[texel % (side * side)]);
                for channel in 0..3 {
                    let attenuated = (-extinction[channel] * f64::from(probe.path_mm)).exp();
                    let value = depth.weight[channel]
                        * attenuated
                        * f64::from(probe.gain * probe.through[channel])
                        * (0.25 * angle);
                    for (k, g) in terms.iter().enumerate() {
                        out[(k * 3 + channel) * texels + texel] += (value * f64::from(*g)) as f32;
                    }
                }
            }
        }
    }
}
