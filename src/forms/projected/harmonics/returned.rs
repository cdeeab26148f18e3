//! Inter-reflection outside the medium: returned light is smooth, so that few harmonics of the light hold it.

use glam::DVec3;

use crate::evaluate::inter_reflection::Outside;
use crate::forms::distant::Work;
use crate::forms::sampled_scene::GROUP;
use crate::progress::Progress;
use crate::transport::interreflection::{InterReflection, Rays};
use crate::transport::many_lights::IrradianceRows;

/// Order of the harmonics at most.
const ORDER: usize = 6;

/// Inter-reflection as a matrix over the samples, applied a number of times.
pub(super) struct Returned {
    matrix: InterReflection,
    times: u32,
}

impl Returned {
    /// The inter-reflection of a bake, if it is asked for.
    pub(super) fn new(work: &Work, progress: &dyn Progress) -> Option<Self> {
        let Outside { times, rays } = work.plan.outside?;
        let sampled = work.sampled;
        let etas: Vec<f64> = sampled.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let matrix = InterReflection::new(&sampled.surface(), &etas, rays, progress);
        Some(Self { matrix: matrix.of_receivers(&sampled.receivers.of_vertex), times })
    }

    /// Adds the light that returns to the radiosities `[point][channel][harmonic]` of some receivers, in ascending
    /// order, which result from `rows` of irradiance.
    pub(super) fn add(
        &self,
        work: &Work,
        rows: &IrradianceRows,
        points: &[u32],
        values: &mut [f32],
        progress: &dyn Progress,
    ) {
        let functions = (ORDER * ORDER).min(rows.lights);
        let low = rows.values.chunks_exact(rows.lights.max(1)).flat_map(|row| &row[..functions]).copied().collect();
        let low = IrradianceRows { lights: functions, by_channel: rows.by_channel, values: low };
        let mut last = work.transfer.radiosity(&low, progress);
        let receivers = work.sampled.receivers.only(points, GROUP);
        let areas = vec![1.0; receivers.len()];
        let some = work.transfer.towards(&receivers, &areas);
        for time in 1..=self.times {
            let values_of_samples = self.matrix.apply_rows(&last.values, 3 * functions);
            let own = IrradianceRows { lights: functions, by_channel: true, values: values_of_samples };
            let found = some.radiosity(&own, progress);
            for (row, out) in values.chunks_exact_mut((3 * rows.lights).max(1)).enumerate() {
                for (out, found) in out.chunks_exact_mut(rows.lights.max(1)).zip(found.of(row).chunks(functions.max(1)))
                {
                    out.iter_mut().zip(found).for_each(|(sum, v)| *sum += v);
                }
            }
            if time < self.times {
                last = work.transfer.radiosity(&own, progress);
            }
        }
    }

    /// Radiosity of every receiver under an irradiance of the samples, inter-reflection included.
    pub(super) fn under(&self, work: &Work, irradiance: &[DVec3]) -> Vec<DVec3> {
        let mut last = work.transfer.under(irradiance);
        let mut all = last.clone();
        for _ in 0..self.times {
            last = work.transfer.under(&self.matrix.apply(&last, Rays::All));
            all.iter_mut().zip(&last).for_each(|(sum, b)| *sum += *b);
        }
        all
    }
}

/// As [`Returned::under`], or without inter-reflection.
pub(super) fn radiosity(work: &Work, returned: Option<&Returned>, irradiance: &[DVec3]) -> Vec<DVec3> {
    returned.map_or_else(|| work.transfer.under(irradiance), |returned| returned.under(work, irradiance))
}
