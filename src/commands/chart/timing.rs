//! Number of repetitions of timed work, and the edit of materials that is timed.

use std::time::Instant;

use crate::error::Result;
use crate::evaluate::{Evaluator, MaterialEdit};
use crate::math::statistics::Quantiles;
use crate::medium::material::{Medium, preset};

/// Limits on the repetitions of timed work.
#[derive(Clone, Copy, Debug)]
pub(super) struct Repetitions {
    /// Largest number of repetitions.
    pub(super) most: usize,
    /// Duration after which no further repetition begins, s.
    pub(super) patience: f64,
}

impl Repetitions {
    /// Times of repeated work, ms; at least one.
    pub(super) fn times(self, mut work: impl FnMut() -> Result<()>) -> Result<Vec<f64>> {
        let mut times = Vec::with_capacity(self.most);
        let begun = Instant::now();
        while times.is_empty() || times.len() < self.most && begun.elapsed().as_secs_f64() < self.patience {
            let started = Instant::now();
            work()?;
            times.push(1e3 * started.elapsed().as_secs_f64());
        }
        Ok(times)
    }

    /// Times of a change between two materials of equal refractive index, ms; none where the material is baked in. The
    /// media are restored in the end.
    pub(super) fn edits<E: Evaluator + ?Sized>(
        self,
        evaluator: &mut E,
        update: impl Fn(&mut E) -> Result<()>,
    ) -> Result<Option<Quantiles>> {
        if evaluator.capabilities().material == MaterialEdit::None {
            return Ok(None);
        }
        let before = evaluator.scene().media.clone();
        let other: Vec<Medium> = before.iter().map(edited).collect();
        let mut times = Vec::with_capacity(self.most + 1);
        let begun = Instant::now();
        for (index, media) in [&other, &before].into_iter().cycle().take(2 * self.most.div_ceil(2)).enumerate() {
            // The second of a pair puts the media back.
            if index >= 2 && index % 2 == 0 && begun.elapsed().as_secs_f64() > self.patience {
                break;
            }
            let started = Instant::now();
            evaluator.set_media(media.clone())?;
            update(evaluator)?;
            times.push(1e3 * started.elapsed().as_secs_f64());
        }
        Ok(Some(Quantiles::of(times)))
    }
}

/// Another material of equal refractive index.
fn edited(medium: &Medium) -> Medium {
    let mut other = medium.clone();
    if let Some(skin) = preset("skin1") {
        other.properties = skin.properties();
        other.properties.eta_inside_over_outside = medium.properties.eta_inside_over_outside;
    }
    other
}
