//! Steps of light in a medium: how far along the surface its first collisions lie from where it enters.

use glam::DVec3;

use super::cells::add;
use super::neighbours::DISTANCES;

/// Steps of each sample.
const STEPS: usize = 6;

/// Steps of light in a medium: their lengths, mm, and the share of the light of each channel that takes them.
#[derive(Clone, Copy)]
pub(super) struct Steps {
    pub(super) eta: f64,
    pub(super) lengths_mm: [f64; STEPS],
    pub(super) shares: [DVec3; STEPS],
}

impl Steps {
    /// Strata of equal shares of the mean distribution of all channels, and the mean lengths in them; none without free paths.
    pub(super) fn new(eta: f64, paths_mm: DVec3) -> Option<Self> {
        if !(paths_mm.min_element() > 0.0 && paths_mm.max_element().is_finite()) {
            return None;
        }
        // Shares and mean lengths of the channels beyond a length.
        let beyond = |length: f64| (-length / paths_mm).exp();
        let moment = |length: f64| (paths_mm + length) * beyond(length);
        let mean = |v: DVec3| v.element_sum() / 3.0;
        let edge = |share: f64| {
            let (mut low, mut high) = (0.0, -paths_mm.max_element() * share.ln());
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if mean(beyond(middle)) > share { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        };
        let (mut lengths_mm, mut shares) = ([0.0; STEPS], [DVec3::ZERO; STEPS]);
        let (mut share, mut length) = (DVec3::ONE, paths_mm);
        for k in 0..STEPS {
            let (next_share, next_length) = if k + 1 == STEPS {
                (DVec3::ZERO, DVec3::ZERO)
            } else {
                let end = edge(1.0 - (k + 1) as f64 / STEPS as f64);
                (beyond(end), moment(end))
            };
            shares[k] = share - next_share;
            lengths_mm[k] = mean(length - next_length) / mean(shares[k]);
            (share, length) = (next_share, next_length);
        }
        Some(Self { eta, lengths_mm, shares })
    }

    /// The farthest that light goes along the surface, mm.
    pub(super) fn farthest_mm(&self) -> f64 {
        self.lengths_mm[STEPS - 1] / self.eta
    }

    /// Shares of the light of an angle of incidence that stay, and that go each of the distances of neighbours.
    fn rungs_at(&self, sine: f64) -> Rungs {
        let mut rungs = [[0.0; 3]; DISTANCES + 1];
        for (length, share) in self.lengths_mm.iter().zip(&self.shares) {
            // Distances are 0, 1/8, 1/4, 1/2 and 1 of the farthest.
            let mut place = length / self.lengths_mm[STEPS - 1] * sine * f64::from(1u32 << (DISTANCES - 1));
            let mut rung = 0;
            while place > 1.0 && rung < DISTANCES - 1 {
                place = if rung == 0 { place - 1.0 } else { 0.5 * (place - 1.0) };
                // Beyond the first a distance is twice the one before.
                rung += 1;
            }
            let (along, share) = (place.clamp(0.0, 1.0), share.to_array());
            add(&mut rungs[rung], 1.0 - along, &share);
            add(&mut rungs[rung + 1], along, &share);
        }
        rungs
    }
}

/// Shares of each channel that stay, and that go each of the distances of neighbours.
pub(super) type Rungs = [[f64; 3]; DISTANCES + 1];

/// Angles of incidence, by their sines, at which shares are kept.
const SINES: usize = 128;

/// Where steps end, by the angle of incidence.
pub(super) struct Ladder(Vec<Rungs>);

impl Ladder {
    pub(super) fn new(steps: Steps) -> Self {
        Self((0..=SINES).map(|i| steps.rungs_at(i as f64 / SINES as f64)).collect())
    }

    /// [`Steps::rungs_at`], linear between the angles that are kept.
    #[inline]
    pub(super) fn at(&self, sine: f64) -> Rungs {
        let place = (sine * SINES as f64).clamp(0.0, SINES as f64);
        let first = (place as usize).min(SINES - 1);
        let along = place - first as f64;
        let (a, b) = (&self.0[first], &self.0[first + 1]);
        std::array::from_fn(|k| std::array::from_fn(|c| a[k][c] + along * (b[k][c] - a[k][c])))
    }
}
