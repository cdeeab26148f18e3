//! From a colour and a length to a medium: inversion of a profile's total reflectance.
//!
//! Jensen and Buhler (2002) describe a medium by its diffuse reflectance and the distance that light scatters over, and
//! solve the dipole's total for alpha'. This module does the same for any profile: at a fixed length the coefficients
//! of a channel depend on one number, which is found by a bracketing search on the total.
//!
//! That number is `x = sqrt(1 - alpha')`, 0 where nothing absorbs and 1 where nothing scatters: totals are smooth in it
//! even where they near 1, while in alpha' they end in a root that costs half the digits. The search is that of
//! Oliveira and Takahashi, "An Enhancement of the Bisection Method Average Performance Preserving Minmax Optimality"
//! (2020): a bisection that takes secants as long as they are no slower, because a total may stand for a table of
//! thousands of numbers.

use glam::DVec3;

use super::material::{LARGEST_SIGMA_PER_MM, OpticalProperties};
use super::profiles::model::LoadedProfile;
use crate::error::{Error, Result};

/// Accepted lengths (mm).
pub const RADII_MM: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// Difference of the totals below which a colour is reached.
pub const REACHED: f64 = 1e-6;

/// Difference of the totals at which a search ends.
const CLOSE: f64 = 1e-10;

/// Width in x of the last bracket.
const NARROWEST: f64 = 1e-14;

/// The length that is fixed while the albedo is sought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Radius {
    /// The mean free path 1 / sigma_t'. Any albedo is possible with any mean free path.
    #[default]
    MeanFreePath,
    /// The diffusion length 1 / sigma_tr, sigma_tr = sqrt(3 sigma_a sigma_t'), whatever the profile. At a fixed length,
    /// a medium that absorbs little must scatter much, so that sigma_t' grows without bound towards a reflectance of 1;
    /// it is limited to [`LARGEST_SIGMA_PER_MM`].
    DiffusionLength,
}

impl Radius {
    /// Both lengths.
    pub const ALL: [Self; 2] = [Self::MeanFreePath, Self::DiffusionLength];

    /// Name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::MeanFreePath => "mean free path",
            Self::DiffusionLength => "diffusion length",
        }
    }

    /// The length of a medium in each channel, mm, within [`RADII_MM`]: an infinite one is the longest.
    pub fn of_medium_mm(self, properties: &OpticalProperties) -> DVec3 {
        let length = match self {
            Self::MeanFreePath => properties.mean_free_path_mm(),
            Self::DiffusionLength => properties.diffusion_length_mm(),
        };
        length.clamp(DVec3::splat(*RADII_MM.start()), DVec3::splat(*RADII_MM.end()))
    }

    /// Smallest accepted x.
    fn least(self, radius_mm: f64) -> f64 {
        match self {
            Self::MeanFreePath => 0.0,
            Self::DiffusionLength => (3f64.sqrt() * radius_mm * LARGEST_SIGMA_PER_MM).recip().min(1.0),
        }
    }

    /// sigma_s' and sigma_a in 1/mm for a length and an x.
    fn coefficients_per_mm(self, radius_mm: f64, x: f64) -> [f64; 2] {
        let extinction = match self {
            Self::MeanFreePath => 1.0 / radius_mm,
            Self::DiffusionLength => 1.0 / (3f64.sqrt() * radius_mm * x),
        };
        let extinction = extinction.min(LARGEST_SIGMA_PER_MM);
        [extinction * ((1.0 - x) * (1.0 + x)), extinction * (x * x)]
    }
}

/// The appearance that is asked of a medium; channels are linear sRGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Total diffuse reflectance of the half space (of the slab, of the layers) under the profile.
    pub reflectance: DVec3,
    /// Meaning of `radius_mm`.
    pub radius: Radius,
    /// Length of each channel in mm.
    pub radius_mm: DVec3,
    /// Mean cosine g; sigma_s' is reduced, so that only single scattering depends on it.
    pub g: f64,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
}

impl Target {
    /// A target with a medium's own length, g and eta, and another colour.
    pub fn of_medium(properties: &OpticalProperties, radius: Radius, reflectance: DVec3) -> Self {
        Self {
            reflectance,
            radius,
            radius_mm: radius.of_medium_mm(properties),
            g: properties.g,
            eta_inside_over_outside: properties.eta_inside_over_outside,
        }
    }
}

/// Result of an inversion: a medium with its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inversion {
    /// The medium.
    pub properties: OpticalProperties,
    /// Total diffuse reflectance that was asked for, RGB.
    pub asked: DVec3,
    /// Total diffuse reflectance of the medium, RGB.
    pub achieved: DVec3,
}

impl Inversion {
    /// A medium as it is, its own colour being the asked one.
    ///
    /// # Errors
    /// As [`totals`].
    pub fn of_medium(profile: &LoadedProfile, properties: &OpticalProperties) -> Result<Self> {
        let achieved = totals(profile, properties)?;
        Ok(Self { properties: *properties, asked: achieved, achieved })
    }

    /// Achieved less asked, each channel.
    pub fn gap(&self) -> DVec3 {
        self.achieved - self.asked
    }

    /// Returns whether every channel is within [`REACHED`] of its target.
    pub fn is_reached(&self) -> bool {
        self.gap().abs().max_element() <= REACHED
    }
}

/// Total diffuse reflectance of a medium by a profile, RGB.
///
/// # Errors
/// As [`LoadedProfile::channels`].
pub fn totals(profile: &LoadedProfile, properties: &OpticalProperties) -> Result<DVec3> {
    let totals = DVec3::from_array(profile.channels(properties)?.map(|channel| channel.total()));
    if totals.is_finite() { Ok(totals) } else { Err(Error::runtime(format!("the profile reflects {totals}"))) }
}

/// Returns whether a medium's coefficients change a profile.
pub fn follows_medium(profile: &LoadedProfile) -> bool {
    match profile {
        LoadedProfile::OfMedium(model) => model.follows_medium(),
        LoadedProfile::Layers(layers) => layers.iter().any(|layer| layer.properties.is_none()),
        LoadedProfile::Gaussians(_) | LoadedProfile::Measured(_) => false,
    }
}

/// The medium whose total reflectance under `profile` is nearest to the asked one, at the asked length.
///
/// Each channel is within 1e-10 of its target where this lies between the totals without scattering (0, or the
/// reflectance of other layers) and without absorption; otherwise it is the nearer of the two, and [`Inversion::gap`]
/// is the difference. Totals must rise with alpha' for that, as those of all models do.
///
/// # Errors
/// Unsupported for profiles that no medium changes; invalid input for a colour that is not finite, a length outside
/// [`RADII_MM`], and g and eta as [`OpticalProperties::validated`] has them; run time, should a profile's table fail.
pub fn invert(profile: &LoadedProfile, target: &Target) -> Result<Inversion> {
    if !follows_medium(profile) {
        return Err(Error::unsupported(
            "this profile is the same whatever the medium: no coefficients give it another colour or radius; choose \
             dipole, better-dipole, photon-beam, burley, slab, or layers of which one is the medium",
        ));
    }
    let channels = ["red", "green", "blue"].into_iter().zip(target.reflectance.to_array());
    for ((name, reflectance), radius_mm) in channels.zip(target.radius_mm.to_array()) {
        if !reflectance.is_finite() {
            return Err(Error::input(format!("the {name} reflectance is {reflectance}; it must be a finite number")));
        }
        if !RADII_MM.contains(&radius_mm) {
            let radius = target.radius.name();
            let (least, most) = (RADII_MM.start(), RADII_MM.end());
            return Err(Error::input(format!(
                "the {radius} of the {name} channel is {radius_mm} mm; it must be between {least:e} and {most:e}"
            )));
        }
    }
    let mut searches = [0, 1, 2].map(|i| {
        let wanted = target.reflectance.to_array()[i];
        Search::new(wanted, target.radius.least(target.radius_mm.to_array()[i]))
    });
    loop {
        let asked = searches.each_ref().map(Search::next);
        if asked == [None; 3] {
            break;
        }
        // A channel without extinction costs nothing.
        let values = totals(profile, &medium(target, asked))?.to_array();
        for ((search, x), value) in searches.iter_mut().zip(asked).zip(values) {
            if let Some(x) = x {
                search.learn(x, value);
            }
        }
    }
    let best = searches.each_ref().map(|search| search.best);
    let properties = medium(target, best.map(|known| known.map(|(x, _)| x))).validated()?;
    let achieved = DVec3::from_array(best.map(|known| known.map_or(0.0, |(_, value)| value)));
    Ok(Inversion { properties, asked: target.reflectance, achieved })
}

/// The medium with these x; channels without an x have no extinction.
fn medium(target: &Target, x: [Option<f64>; 3]) -> OpticalProperties {
    let radius_mm = target.radius_mm.to_array();
    let [red, green, blue] =
        [0, 1, 2].map(|i| x[i].map_or([0.0; 2], |x| target.radius.coefficients_per_mm(radius_mm[i], x)));
    OpticalProperties {
        sigma_s_reduced_per_mm: DVec3::new(red[0], green[0], blue[0]),
        sigma_a_per_mm: DVec3::new(red[1], green[1], blue[1]),
        g: target.g,
        eta_inside_over_outside: target.eta_inside_over_outside,
    }
}

/// The search for x of one channel.
#[derive(Clone, Copy, Debug)]
struct Search {
    wanted: f64,
    /// First and second x of the search: without absorption and without scattering.
    ends: [f64; 2],
    /// Ends of the bracket, each x with its difference from the wanted total; the signs differ once both are known.
    bracket: [Option<(f64, f64)>; 2],
    /// x and total of the nearest one so far.
    best: Option<(f64, f64)>,
    steps: u32,
    is_done: bool,
}

impl Search {
    fn new(wanted: f64, least: f64) -> Self {
        Self { wanted, ends: [least, 1.0], bracket: [None; 2], best: None, steps: 0, is_done: false }
    }

    /// The next x to try; none at the end.
    fn next(&self) -> Option<f64> {
        match self.bracket {
            _ if self.is_done => None,
            [None, _] => Some(self.ends[0]),
            [_, None] => Some(self.ends[1]),
            [Some(low), Some(high)] => Some(self.between(low, high)),
        }
    }

    /// The next x inside the bracket: interpolated, truncated and projected.
    fn between(&self, (low, at_low): (f64, f64), (high, at_high): (f64, f64)) -> f64 {
        let (width, whole) = (high - low, self.ends[1] - self.ends[0]);
        let middle = 0.5 * (low + high);
        let secant = (at_high * low - at_low * high) / (at_high - at_low);
        let towards_middle = (middle - secant).signum();
        let shift = 0.2 / whole * width * width;
        let near = if shift <= (middle - secant).abs() { secant + towards_middle * shift } else { middle };
        // One step more than a bisection would take.
        let most = (whole / NARROWEST).log2().ceil() + 1.0;
        let room = (0.5 * NARROWEST * (most - f64::from(self.steps)).exp2() - 0.5 * width).max(0.0);
        if (near - middle).abs() <= room { near } else { middle - towards_middle * room }
    }

    /// Records the total at an x.
    fn learn(&mut self, x: f64, value: f64) {
        let difference = value - self.wanted;
        if self.best.is_none_or(|(_, best)| difference.abs() < (best - self.wanted).abs()) {
            self.best = Some((x, value));
        }
        let known = Some((x, difference));
        match &mut self.bracket {
            [low @ None, _] => *low = known,
            [Some(low), high @ None] => {
                // Without a change of sign there is nothing between the ends.
                self.is_done |= low.1 * difference > 0.0;
                *high = known;
            }
            [Some(low), Some(high)] => {
                let side = if difference * low.1 > 0.0 { low } else { high };
                *side = (x, difference);
                self.steps += 1;
            }
        }
        let is_narrow = matches!(self.bracket, [Some(low), Some(high)] if high.0 - low.0 <= NARROWEST);
        self.is_done |= difference.abs() <= CLOSE || is_narrow;
    }
}

#[cfg(test)]
mod tests;
