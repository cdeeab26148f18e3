//! The number of samples that an asked error needs, and the errors of the texels and of the samples.

use glam::DVec3;

use super::light::LitMap;
use super::settings::Sampling;
use super::state::{TextureSpaceEvaluator, of_descent};
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::Silent;
use crate::transport::receivers::Receivers;

/// Names in ledgers.
const TEXTURE: &str = "texture";
const SAMPLES: &str = "samples";

/// Vertices that errors are measured on; where there are not many more, all are.
const MEASURED: usize = 2048;

/// Vertices that texels are held against exact sums at: all, or half as many where there are more.
const MEASURED_EXACTLY: usize = 1024;

/// What twice the samples leave of the error at most, where they are worth it.
const WORTH_MORE: f64 = 0.9;

/// Samples that stand for all texels where errors are measured.
const RESOLVED: usize = 1 << 13;

impl TextureSpaceEvaluator {
    /// Radiosity of some receivers from as many samples as tell every texel that matters, RGB.
    fn resolved(&self, lit: &LitMap, receivers: &Receivers) -> Vec<DVec3> {
        let descent = self.descent(lit, self.form.near);
        descent
            .radiosity(receivers, descent.limit(&self.receivers, RESOLVED.max(4 * self.numbers.count as usize), None))
    }

    /// Receivers that descend one by one, each a group.
    fn are_alone(&self) -> bool {
        self.receivers.groups.len() == self.receivers.len()
    }

    /// Receivers that errors are measured on, with the areas around them.
    fn measured(&self, phase: usize) -> (Receivers, Vec<f64>) {
        if self.receivers.len() <= 2 * MEASURED {
            return (self.receivers.clone(), self.areas.clone());
        }
        let descends_in_groups = self.form.sampling == Sampling::Product && !self.are_alone();
        let (subset, indices) = if descends_in_groups {
            // Whole groups: smaller ones would fare better.
            let size = of_descent(self.numbers.count);
            let step = self.receivers.groups.len().div_ceil(MEASURED / size).max(1);
            let groups = self.receivers.groups.iter().skip(phase * step / 2).step_by(step);
            let indices: Vec<u32> = groups.flat_map(|group| group.run.first..group.run.end).collect();
            (self.receivers.only(&indices, size), indices)
        } else {
            self.receivers.subset(MEASURED, phase)
        };
        (subset, indices.iter().map(|i| self.areas[*i as usize]).collect())
    }

    /// Chooses the least number of samples, doubled from `least` to `most`, whose error is as asked under each
    /// of some lights, at vertices that no reported error looks at. The hybrid method's is no more than lowers the error: its near part has
    /// samples of its own.
    pub(super) fn choose_count(&mut self, lights: &[Light], asked: f64, (least, most): (u32, u32)) -> Result<()> {
        let (receivers, areas) = self.measured(0);
        self.numbers.count = least;
        let near_samples = matches!(self.form.sampling, Sampling::Hybrid(_));
        for light in lights {
            let light = std::slice::from_ref(light);
            let lit = self.illuminate(light, &Silent)?;
            let all = self.resolved(&lit, &receivers);
            let mut before: Option<(u32, f64)> = None;
            loop {
                let found = self.sums(&self.choose(light, &lit)?, &lit, &receivers);
                let rms = vertex_error(&found, &all, &areas).or_none().rms;
                match before {
                    Some((count, error)) if near_samples && rms > WORTH_MORE * error => {
                        self.numbers.count = count;
                        break;
                    }
                    _ if self.numbers.count >= most || rms <= asked => break,
                    _ => before = Some((self.numbers.count, rms)),
                }
                self.numbers.count = (2 * self.numbers.count).min(most);
            }
        }
        Ok(())
    }

    /// The errors of texels against exact sums and of samples against all texels, under the worst of some sets of lights.
    pub(super) fn errors(&mut self, sets: &[Vec<Light>], note: &str) -> Result<Ledger> {
        let (receivers, areas) = self.measured(1);
        // Exact sums take their time where there are many vertices.
        let (some, of_some) = receivers.all_or_probe_points(&areas, MEASURED_EXACTLY, (MEASURED_EXACTLY / 2, 1));
        let mut worst = [VertexError::default(); 2];
        for lights in sets {
            let lit = self.illuminate(lights, &Silent)?;
            let found = self.sums(&self.choose(lights, &lit)?, &lit, &receivers);
            let all = self.resolved(&lit, &receivers);
            let truth = self.truth.lit(&self.scene, lights, &Silent)?;
            if let Some(profile) = &self.profile {
                truth.set_profile(profile.clone())?;
            }
            let expected = truth.all_pairs_at(&some, &Silent)?;
            let of = |values: &[DVec3], truth: &[DVec3]| vertex_error(values, truth, &areas).or_none();
            let errors = [of_some.error(&of_some.of(&all), &expected), of(&found, &all)];
            worst.iter_mut().zip(errors).for_each(|(worst, error)| *worst = worst.max(error));
        }
        let (texels, side) = (self.map.texels, self.map.resolution);
        let mut ledger = Ledger::default();
        let texture = format!("{texels} texels of {side} x {side}, against exact sums over samples, {note}");
        ledger.add(TEXTURE, worst[0], texture);
        ledger.add(SAMPLES, worst[1], format!("{} samples, against all texels, {note}", self.numbers.count));
        Ok(ledger)
    }
}
