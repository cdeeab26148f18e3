//! Solid marble: veins across a direction, shifted by turbulence (Perlin 1985, "An image synthesizer").

use glam::DVec3;

use super::noise::noise;
use super::spec::MarbleSpec;
use crate::error::{Error, Result};

/// Direction across the veins, unlike any axis of an object.
pub(crate) const ACROSS: DVec3 = DVec3::new(0.6, 0.64, 0.48);
/// Offset between successive octaves of the turbulence, so that their zeros do not meet.
pub(crate) const SHIFT: DVec3 = DVec3::new(17.37, 5.71, 11.13);
/// Default distance between veins, as a share of the diagonal of the object.
const DEFAULT_SCALE_SHARE: f64 = 0.2;
/// Largest number of veins over the diagonal: beyond, 32-bit shaders cannot tell points apart.
const MOST_VEINS: f64 = 1e4;

/// Marble for an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marble {
    /// The specification, with the distance between veins filled in.
    pub spec: MarbleSpec,
    /// Distance between veins, in mm.
    pub scale_mm: f64,
}

impl Marble {
    /// The marble of an object with this diagonal.
    ///
    /// # Errors
    /// Veins too fine to be meaningful (exit 1).
    pub fn new(spec: MarbleSpec, diagonal_mm: f64) -> Result<Self> {
        let scale_mm = spec.scale_mm.unwrap_or(DEFAULT_SCALE_SHARE * diagonal_mm);
        if !(scale_mm > 0.0 && diagonal_mm / scale_mm <= MOST_VEINS) {
            return Err(Error::command_line(format!(
                "texture: a vein every {scale_mm} mm on an object of {diagonal_mm:.3} mm is too fine; \
                 scale={:.3} and more can be told apart",
                diagonal_mm / MOST_VEINS
            )));
        }
        Ok(Self { spec: MarbleSpec { scale_mm: Some(scale_mm), ..spec }, scale_mm })
    }

    /// The albedo at a position relative to the centre of the object, RGB in [0, 1].
    pub fn albedo(&self, at_mm: DVec3) -> DVec3 {
        let MarbleSpec { base, veins, turbulence, sharpness, .. } = self.spec;
        let at = at_mm / self.scale_mm;
        let shifted = ACROSS.dot(at) + turbulence * self.turbulence(at);
        base + (veins - base) * vein(shifted, sharpness)
    }

    fn turbulence(&self, at: DVec3) -> f64 {
        if self.spec.turbulence == 0.0 {
            return 0.0;
        }
        let octave = |i: u32| {
            let frequency = f64::from(1u32 << i);
            noise(at * frequency + SHIFT * f64::from(i), self.spec.seed.wrapping_add(i)).abs() / frequency
        };
        (0..self.spec.octaves).map(octave).sum()
    }

    /// Mean of the veins' share over space, for distances at which veins are not resolved.
    pub fn mean_vein(&self) -> f64 {
        const STEPS: u32 = 4096;
        let share = |i: u32| vein((f64::from(i) + 0.5) / f64::from(STEPS), self.spec.sharpness);
        (0..STEPS).map(share).sum::<f64>() / f64::from(STEPS)
    }
}

/// Share of the veins' colour: 1 at whole numbers, 0 half-way between them.
#[inline]
fn vein(at: f64, sharpness: f64) -> f64 {
    // The fraction first: the cosine of large numbers is where devices differ.
    let fraction = at - at.floor();
    (0.5 + 0.5 * (std::f64::consts::TAU * fraction).cos()).max(1e-12).powf(sharpness)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn anywhere(i: u64) -> DVec3 {
        DVec3::new(uniform(5, i, 0) - 0.5, uniform(5, i, 1) - 0.5, uniform(5, i, 2) - 0.5) * 30.0
    }

    #[test]
    fn colours_lie_between_base_and_veins_and_fill_the_range() {
        let marble = Marble::new(MarbleSpec::default(), 30.0).unwrap();
        assert_eq!(marble.scale_mm, 6.0);
        let MarbleSpec { base, veins, .. } = marble.spec;
        let (mut low, mut high) = (DVec3::ONE, DVec3::ZERO);
        for i in 0..20_000 {
            let albedo = marble.albedo(anywhere(i));
            (low, high) = (low.min(albedo), high.max(albedo));
        }
        assert!(low.cmpge(veins - 1e-12).all() && (low - veins).max_element() < 0.02, "{low}");
        assert!(high.cmple(base + 1e-12).all() && (high - base).abs().max_element() < 0.02, "{high}");
    }

    #[test]
    fn without_turbulence_veins_are_planes_at_the_distance_asked_for() {
        let spec = MarbleSpec { turbulence: 0.0, scale_mm: Some(4.0), ..MarbleSpec::default() };
        let marble = Marble::new(spec, 30.0).unwrap();
        for i in 0..200 {
            let at = anywhere(i);
            let [here, next] = [at, at + ACROSS * 4.0].map(|p| marble.albedo(p));
            assert!((here - next).length() < 1e-9);
            let beside = ACROSS.any_orthonormal_vector() * 3.3;
            assert!((marble.albedo(at + beside) - here).length() < 1e-9);
        }
        let [vein, between] = [DVec3::ZERO, ACROSS * 2.0].map(|p| marble.albedo(p));
        assert!(vein.distance(spec.veins) < 1e-9 && between.distance(spec.base) < 1e-9, "{vein} {between}");
    }

    #[test]
    fn the_mean_is_that_of_many_places_and_seeds_differ() {
        let marble = Marble::new(MarbleSpec { sharpness: 3.0, ..MarbleSpec::default() }, 30.0).unwrap();
        // Gamma(s + 1/2) / (sqrt(pi) Gamma(s + 1)) at s = 3.
        assert!((marble.mean_vein() - 0.3125).abs() < 1e-9);
        let other = Marble::new(MarbleSpec { seed: 1, ..marble.spec }, 30.0).unwrap();
        let differ =
            (0..1000).filter(|&i| marble.albedo(anywhere(i)).distance(other.albedo(anywhere(i))) > 0.01).count();
        assert!(differ > 500, "{differ}");
        let again = Marble::new(marble.spec, 99.0).unwrap();
        assert!((0..100).all(|i| marble.albedo(anywhere(i)) == again.albedo(anywhere(i))));
    }

    #[test]
    fn veins_too_fine_are_refused() {
        for (scale, diagonal) in [(1e-3, 30.0), (1e-300, 1.0)] {
            let spec = MarbleSpec { scale_mm: Some(scale), ..MarbleSpec::default() };
            let error = Marble::new(spec, diagonal).unwrap_err();
            assert!(error.message().contains("too fine"), "{error}");
        }
        let huge = MarbleSpec { scale_mm: Some(1e300), ..MarbleSpec::default() };
        assert!(Marble::new(huge, 30.0).unwrap().albedo(DVec3::ONE).is_finite());
    }
}
