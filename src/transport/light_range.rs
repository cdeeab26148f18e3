//! Brightness of light, and whether it has one colour, so that one channel holds all of it: a single light, several
//! lights of one colour, a grey environment.

use glam::DVec3;

use crate::parallel::*;

/// Irradiance farther than this share of the brightest from every multiple of a colour is of another one.
const SAME_COLOUR: f64 = 1e-10;

/// Irradiances of one task.
const CHUNK: usize = 8192;

/// A colour that all light is a multiple of.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CommonColour {
    /// The first channel that no other exceeds: its light, times `rgb`, is the light.
    pub channel: usize,
    /// The colour relative to that channel.
    pub rgb: DVec3,
}

/// Brightness and colour of all irradiance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightRange {
    /// The largest component, at least 0.
    pub brightest: f64,
    /// Colour of all irradiance; white where there is none, `None` if colours differ.
    pub colour: Option<CommonColour>,
}

impl LightRange {
    /// The range of irradiance and of its deviations in pieces of samples, RGB.
    pub fn new(irradiance: &[DVec3], deviations: &[DVec3]) -> Self {
        let dark = (0.0, DVec3::ZERO);
        let brighter = |a: (f64, DVec3), e: &DVec3| if e.max_element() > a.0 { (e.max_element(), *e) } else { a };
        let of_chunks: Vec<(f64, DVec3)> =
            irradiance.par_chunks(CHUNK).map(|chunk| chunk.iter().fold(dark, brighter)).collect();
        // The first of the brightest: which of them it is must not depend on threads.
        let (brightest, e) = of_chunks.iter().fold(dark, |a, (_, e)| brighter(a, e));
        let Some(channel) = (0..3).find(|&c| e[c] == brightest && brightest > 0.0) else {
            return Self { brightest, colour: Some(CommonColour { channel: 0, rgb: DVec3::ONE }) };
        };
        let (rgb, most) = (e / brightest, SAME_COLOUR * brightest);
        let same = |chunk: &[DVec3]| chunk.iter().all(|e| (*e - rgb * e[channel]).abs().max_element() <= most);
        let one = irradiance.par_chunks(CHUNK).all(same) && deviations.par_chunks(CHUNK).all(same);
        Self { brightest, colour: one.then_some(CommonColour { channel, rgb }) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_alike_have_a_colour_and_others_none() {
        let sun = DVec3::new(0.7, 1.0, 0.2);
        let mut light: Vec<DVec3> = (0..20_000).map(|i| sun * (f64::from(i) * 1.7).sin().max(0.0)).collect();
        let range = LightRange::new(&light, &[-0.1 * sun, 0.1 * sun]);
        let colour = range.colour.unwrap();
        assert_eq!(colour.channel, 1);
        assert!(colour.rgb.distance(sun) < 1e-15 && (range.brightest - 1.0).abs() < 1e-6);
        assert_eq!(LightRange::new(&light, &[DVec3::X, -DVec3::X]).colour, None);
        light[12_321] += DVec3::new(0.0, 0.0, 1e-6);
        assert_eq!(LightRange::new(&light, &[]).colour, None);
    }

    #[test]
    fn no_light_is_white() {
        let white = Some(CommonColour { channel: 0, rgb: DVec3::ONE });
        for light in [&[][..], &[DVec3::ZERO; 3]] {
            assert_eq!(LightRange::new(light, &[]), LightRange { brightest: 0.0, colour: white });
        }
    }
}
