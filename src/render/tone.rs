//! Tone curves: from exposed radiance, which has no upper end, to what a display shows.
//!
//! Without a curve, what is brighter than white is cut off channel by channel, so that bright colours turn to the
//! nearest corner of the display's cube. Curves bend instead, and give up some contrast below white for it.

use std::str::FromStr;
use std::sync::LazyLock;

use glam::{DMat3, DVec2, DVec3};

use crate::error::{Error, Result};
use crate::io::colour::Chromaticities;
use crate::math::srgb::linear_from_srgb;

/// How exposed radiance becomes light of a display; OpenEXR pictures have no curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Tone {
    /// Cut off at 1.
    #[default]
    None,
    /// A film's curve for each channel: Hable's of "Uncharted 2" (2010), with white at 11.2 and radiance doubled first.
    Filmic,
    /// Sobotka's AgX, its base look, in which bright colours turn pale as on film.
    //
    // Primaries moved a fifth of the way to white, stops from -10 to 6.5 about middle grey (0.18), and a sigmoid in them.
    Agx,
}

/// Stops of AgX about middle grey.
const AGX_STOPS: [f64; 2] = [-10.0, 6.5];
/// Middle grey, and where the sigmoid shows it.
const MIDDLE_GREY: f64 = 0.18;
const AGX_PIVOT: f64 = 0.5;
/// Slope of the sigmoid there, and how sharply it bends below and above.
const AGX_SLOPE: f64 = 2.0;
const AGX_TOE: f64 = 3.0;
const AGX_SHOULDER: f64 = 3.25;
/// Share of the way to white that primaries move.
const AGX_INSET: f64 = 0.2;

/// The radiance that Hable's curve shows as white, and the factor on radiance before it.
const FILMIC_WHITE: f64 = 11.2;
const FILMIC_GAIN: f64 = 2.0;

impl Tone {
    /// All curves.
    pub const ALL: [Self; 3] = [Self::None, Self::Filmic, Self::Agx];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Filmic => "filmic",
            Self::Agx => "agx",
        }
    }

    /// The least grey that is shown as white.
    pub fn white(self) -> f64 {
        match self {
            Self::None => 1.0,
            Self::Filmic => FILMIC_WHITE / FILMIC_GAIN,
            Self::Agx => MIDDLE_GREY * AGX_STOPS[1].exp2(),
        }
    }

    /// Light of the display, linear sRGB in [0, 1], for exposed radiance; what is negative or no number is 0.
    pub fn shown(self, radiance: DVec3) -> DVec3 {
        let positive = radiance.map(|c| if c > 0.0 { c.min(f64::MAX) } else { 0.0 });
        let shown = match self {
            Self::None => positive,
            Self::Filmic => positive.map(|c| hable(FILMIC_GAIN * c.min(FILMIC_WHITE)) / hable(FILMIC_WHITE)),
            Self::Agx => agx(positive),
        };
        shown.clamp(DVec3::ZERO, DVec3::ONE)
    }
}

/// Hable's curve before its division by white: shoulder 0.15, linear strength 0.5 and angle 0.1, toe 0.2, 0.02, 0.3.
fn hable(x: f64) -> f64 {
    (x * (0.15 * x + 0.1 * 0.5) + 0.2 * 0.02) / (x * (0.15 * x + 0.5) + 0.2 * 0.3) - 0.02 / 0.3
}

/// From linear sRGB to channels of moved primaries: what a colour gives to each of the three.
static AGX_MATRIX: LazyLock<DMat3> = LazyLock::new(|| {
    let Chromaticities { primaries, white } = Chromaticities::REC_709;
    let primaries = primaries.map(|xy: DVec2| xy.lerp(white, AGX_INSET));
    // These primaries span a colour space, as theirs do which they are moved from.
    Chromaticities { primaries, white }.to_rec_709().unwrap_or(DMat3::IDENTITY)
});

fn agx(radiance: DVec3) -> DVec3 {
    let [least, most] = AGX_STOPS;
    let curve = |c: f64| {
        let stops = (c / MIDDLE_GREY).max(f64::MIN_POSITIVE).log2().clamp(least, most);
        // The curve gives code values of a display.
        linear_from_srgb(sigmoid((stops - least) / (most - least)))
    };
    // Beyond a float's range sums would not be finite.
    (*AGX_MATRIX * radiance.min(DVec3::splat(1e30))).map(curve)
}

/// From [0, 1] to [0, 1] through the pivot with its slope: `y + s h(slope (x - x0) / s)` on each side, `h(t) = t / (1 + t^p)^(1/p)`, and s so
/// that the end is met.
fn sigmoid(x: f64) -> f64 {
    let pivot = -AGX_STOPS[0] / (AGX_STOPS[1] - AGX_STOPS[0]);
    let (run, rise, power) = match x < pivot {
        true => (pivot, AGX_PIVOT, AGX_TOE),
        false => (1.0 - pivot, 1.0 - AGX_PIVOT, AGX_SHOULDER),
    };
    let whole = AGX_SLOPE * run;
    let scale = whole / ((whole / rise).powf(power) - 1.0).powf(1.0 / power);
    let t = AGX_SLOPE * (x - pivot).abs() / scale;
    let y = scale * t / (1.0 + t.powf(power)).powf(1.0 / power);
    AGX_PIVOT + if x < pivot { -y } else { y }
}

impl FromStr for Tone {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|tone| tone.name() == text.trim()).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            Error::command_line(format!("tone `{text}`: there are {names}"))
        })
    }
}

impl std::fmt::Display for Tone {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_black_to_white_and_keep_greys() {
        for tone in Tone::ALL {
            assert_eq!(tone.name().parse::<Tone>().unwrap(), tone);
            let mut last = -1.0;
            for step in 0..=400 {
                let grey = tone.white() * f64::from(step) / 400.0;
                let shown = tone.shown(DVec3::splat(grey));
                assert!(shown.max_element() - shown.min_element() < 1e-9, "{tone}: {shown}");
                assert!(shown.x >= last, "{tone} {grey}");
                last = shown.x;
            }
            assert!((last - 1.0).abs() < 1e-6, "{tone}: {last}");
            assert!(tone.shown(DVec3::ZERO).max_element() < 1e-9);
            for odd in [f64::NAN, f64::INFINITY, -1.0, 1e300] {
                let shown = tone.shown(DVec3::new(odd, 0.5, 0.1));
                assert!(shown.is_finite() && shown.min_element() >= 0.0 && shown.max_element() <= 1.0, "{tone} {odd}");
            }
        }
        assert!("aces".parse::<Tone>().unwrap_err().message().contains("none, filmic, agx"));
    }

    #[test]
    fn agx_shows_middle_grey_in_the_middle_and_bright_red_pale() {
        let grey = Tone::Agx.shown(DVec3::splat(MIDDLE_GREY)).x;
        assert!((grey - linear_from_srgb(0.5)).abs() < 1e-9, "{grey}");
        let [dim, bright] = [0.1, 20.0].map(|red| Tone::Agx.shown(DVec3::new(red, 0.0, 0.0)));
        let paleness = |shown: DVec3| shown.y / shown.x;
        assert!(paleness(dim) < 0.1 && paleness(bright) > 0.5, "{dim} {bright}");
        // Cut off, it is as red as a display can.
        assert_eq!(Tone::None.shown(DVec3::new(20.0, 0.0, 0.0)), DVec3::X);
        // The slope at the pivot, by differences.
        let pivot = -AGX_STOPS[0] / (AGX_STOPS[1] - AGX_STOPS[0]);
        let slope = (sigmoid(pivot + 1e-5) - sigmoid(pivot - 1e-5)) / 2e-5;
        assert!((slope - AGX_SLOPE).abs() < 1e-6 && sigmoid(0.0).abs() < 1e-12 && (sigmoid(1.0) - 1.0).abs() < 1e-12);
    }
}
