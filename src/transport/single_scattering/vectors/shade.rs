//! Vectors from the light that arrives in each texel: attenuation of three channels, many texels at a time.

use super::super::interface::Form;
use crate::math::simd::multiversion;

/// The plane that is seen from one depth in every texel of a cube map, and the share of light that comes through.
pub(super) struct Planes {
    /// Cosine outside; not positive where no light arrives.
    pub(super) cosine: Vec<f32>,
    /// Distance of the plane, mm.
    pub(super) height_mm: Vec<f32>,
    /// The share of light that comes through, of each channel if bodies attenuate channels unequally; else the first is for all.
    pub(super) through: [Vec<f32>; 3],
    /// F_t and the refraction factor, from the cosine.
    pub(super) gain: Vec<f32>,
    /// Length `s_i'` of the refracted path inside, mm, from cosine and distance.
    pub(super) path_mm: Vec<f32>,
    /// Light side of the phase function, `[term][texel]`; empty where there is one constant term.
    pub(super) terms: Vec<f32>,
}

impl Planes {
    pub(super) fn new(texels: usize, terms: usize) -> Self {
        let plane = || vec![0.0; texels];
        Self {
            cosine: plane(),
            height_mm: plane(),
            through: std::array::from_fn(|_| plane()),
            gain: plane(),
            path_mm: plane(),
            terms: vec![0.0; texels * terms],
        }
    }
}

/// The surface that light enters by.
#[derive(Clone, Copy)]
pub(super) struct Medium {
    pub(super) form: Form,
    pub(super) eta: f32,
}

multiversion! {
    /// Computes gains and paths from cosines and distances.
    pub(super) fn refract(medium: Medium, cosines: &[f32], heights: &[f32], gains: &mut [f32], paths: &mut [f32])
        => refract_body
}

/// Cosines are at least this, so that nothing is divided by zero; light at or below it has no gain.
const LEAST_COSINE: f32 = 1e-6;

#[inline(always)]
fn refract_body(medium: Medium, cosines: &[f32], heights: &[f32], gains: &mut [f32], paths: &mut [f32]) {
    let eta = medium.eta;
    let offset = (eta - 1.0) * (eta + 1.0);
    let physical = medium.form == Form::Physical;
    for (((c, h), gain), path) in cosines.iter().zip(heights).zip(gains.iter_mut()).zip(paths.iter_mut()) {
        let cosine = c.clamp(LEAST_COSINE, 1.0);
        let square = cosine * cosine + offset;
        let inside = square.max(LEAST_COSINE * LEAST_COSINE).sqrt() / eta;
        let (perpendicular, parallel) = (cosine + eta * inside, eta * cosine + inside);
        let reciprocals = 1.0 / (perpendicular * perpendicular) + 1.0 / (parallel * parallel);
        let factor = if physical { 2.0 * cosine * cosine / eta } else { 2.0 * eta * cosine * inside };
        let enters = *c > LEAST_COSINE && square > LEAST_COSINE * LEAST_COSINE;
        *gain = if enters { factor * reciprocals } else { 0.0 };
        *path = h / inside;
    }
}

/// One channel of one depth of one face.
pub(super) struct Channel<'a> {
    pub(super) gain: &'a [f32],
    pub(super) through: &'a [f32],
    pub(super) path_mm: &'a [f32],
    /// Solid angles, sr.
    pub(super) angles: &'a [f32],
    /// Attenuated weight of the depth times the term, where that is a constant.
    pub(super) weight: f32,
    pub(super) sigma_t_per_mm: f32,
}

const LANES: usize = 16;

/// Exponents below this give what rounds to zero beside the rest.
const LEAST_EXPONENT: f32 = -80.0;

/// `exp(x)` for x in [-80, 0], to 2e-7 of itself, by the same operations on every processor.
#[inline(always)]
fn exponential(x: f32) -> f32 {
    let x = x.max(LEAST_EXPONENT);
    let y = x * std::f32::consts::LOG2_E;
    // Rounds to the nearest whole number: y is small.
    const SHIFT: f32 = 12_582_912.0;
    let whole = (y + SHIFT) - SHIFT;
    // The remainder in two steps keeps its digits.
    let r = (x - whole * 0.693_359_4) - whole * -2.121_944_4e-4;
    let p =
        1.0 + r * (1.0 + r * (0.5 + r * (0.166_666_67 + r * (0.041_666_67 + r * (0.008_333_35 + r * 0.001_388_89)))));
    let scale = f32::from_bits(((whole as i32 + 127) as u32) << 23);
    p * scale
}

multiversion! {
    /// Adds the product of gain, transmitted share, attenuation, weight and solid angle of one channel to `out`.
    pub(super) fn add_channel(channel: &Channel, out: &mut [f32]) => add_channel_body
}

#[inline(always)]
fn add_channel_body(channel: &Channel, out: &mut [f32]) {
    let (gain, path) = (channel.gain.as_chunks::<LANES>().0, channel.path_mm.as_chunks::<LANES>().0);
    let (angles, through) = (channel.angles.as_chunks::<LANES>().0, channel.through.as_chunks::<LANES>().0);
    let out = out.as_chunks_mut::<LANES>().0;
    for ((((out, gain), path), angles), through) in out.iter_mut().zip(gain).zip(path).zip(angles).zip(through) {
        for i in 0..LANES {
            let attenuated = exponential(-channel.sigma_t_per_mm * path[i]);
            out[i] += gain[i] * through[i] * attenuated * (channel.weight * angles[i]);
        }
    }
}

multiversion! {
    /// Adds a picture times the values of a term to `out`.
    pub(super) fn add_product(picture: &[f32], term: &[f32], out: &mut [f32]) => add_product_body
}

#[inline(always)]
fn add_product_body(picture: &[f32], term: &[f32], out: &mut [f32]) {
    for ((out, p), t) in out.iter_mut().zip(picture).zip(term) {
        *out += p * t;
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::interface::Refraction;
    use super::*;
    use crate::math::simd::InstructionSet;

    #[test]
    fn the_exponential_is_exact_to_single_precision() {
        for i in 0..80_000 {
            let x = -(i as f32) / 1000.0;
            let exact = f64::from(x).exp();
            assert!((f64::from(exponential(x)) / exact - 1.0).abs() < 4e-7, "{x}");
        }
        assert!(exponential(f32::NEG_INFINITY) < 1e-34 && exponential(0.0) == 1.0);
    }

    #[test]
    fn refraction_is_that_of_double_precision() {
        for form in [Form::Physical, Form::Printed] {
            for eta in [0.7, 1.0, 1.3, 1.5] {
                let cosines: Vec<f32> = (-4..=64).map(|i| i as f32 / 64.0).collect();
                let (mut gains, mut paths) = (vec![0.0; cosines.len()], vec![0.0; cosines.len()]);
                let heights = vec![2.0; cosines.len()];
                let medium = Medium { form, eta };
                refract(InstructionSet::detect(), medium, &cosines, &heights, &mut gains, &mut paths);
                for ((c, gain), path) in cosines.iter().zip(&gains).zip(&paths) {
                    let Some(refraction) = Refraction::new(form, eta.into(), (*c).into()) else {
                        assert!(*gain == 0.0, "{eta} {c}");
                        continue;
                    };
                    assert!((f64::from(*gain) / refraction.gain - 1.0).abs() < 1e-5, "{form:?} {eta} {c}");
                    assert!((f64::from(*path) * refraction.cos_inside / 2.0 - 1.0).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let ramp = |scale: f32| (0..64).map(|i| i as f32 * scale).collect::<Vec<f32>>();
        let (gain, path, angles, through) = (ramp(0.01), ramp(0.3), ramp(1e-3), ramp(0.02));
        let channel = Channel {
            gain: &gain,
            through: &through,
            path_mm: &path,
            angles: &angles,
            weight: 0.7,
            sigma_t_per_mm: 1.3,
        };
        let results: Vec<Vec<f32>> = InstructionSet::available()
            .into_iter()
            .map(|level| {
                let mut out = vec![0.0; 64];
                add_channel(level, &channel, &mut out);
                out
            })
            .collect();
        assert!(results.iter().all(|r| *r == results[0]) && results[0][5] > 0.0);
    }
}
