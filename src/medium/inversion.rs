//! From a colour and a length to a medium: inversion of what a flat body of it shows under constant light.
//!
//! Jensen and Buhler (2002) describe a medium by its diffuse reflectance and the distance that light scatters over, and
//! solve the dipole's total for alpha'. This module does the same for any profile, and for walks through the volume: at a
//! fixed length the coefficients of a channel depend on one number, which is found by a bracketing search on the total.
//!
//! A colour is the albedo that is seen: `C R`, with R the total reflectance of light that has entered and C the share
//! of constant light that enters ([`diffuse_transmittance`]). Light that leaves is shared over directions by the second
//! Fresnel term so that its sum is what the profile gives (C divides there), which is why C stands here once.
//!
//! The number is `x = sqrt(1 - alpha')`, 0 where nothing absorbs and 1 where nothing scatters: totals are smooth in it
//! even where they near 1, while in alpha' they end in a root that costs half the digits. The search is that of
//! Oliveira and Takahashi, "An Enhancement of the Bisection Method Average Performance Preserving Minmax Optimality"
//! (2020): a bisection that takes secants as long as they are no slower, because a total may stand for a table of
//! thousands of numbers.

use std::f64::consts::PI;
use std::str::FromStr;
use std::sync::Arc;

use glam::DVec3;

use super::fresnel::diffuse_transmittance;
use super::half_space;
use super::material::{LARGEST_SIGMA_PER_MM, OpticalProperties};
use super::profiles::burley::BurleyFit;
use super::profiles::model::{LoadedProfile, ProfileModel};
use crate::error::{Error, Result};

/// Accepted lengths (mm).
pub const RADII_MM: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// Difference of the totals below which a colour is reached.
pub const REACHED: f64 = 1e-6;

/// Difference of the totals at which a search ends.
const CLOSE: f64 = 1e-10;

/// Width in x of the last bracket.
const NARROWEST: f64 = 1e-14;

/// What tells the total reflectance of a medium.
#[derive(Clone, Debug, PartialEq)]
pub enum Reflector {
    /// The integral of a profile.
    Profile(Arc<LoadedProfile>),
    /// Transport in a half space, which is what kernels hold that walks have calibrated ([`half_space`]).
    Volume,
}

impl Default for Reflector {
    /// The dipole.
    fn default() -> Self {
        Self::from(LoadedProfile::OfMedium(ProfileModel::Dipole))
    }
}

impl From<LoadedProfile> for Reflector {
    fn from(profile: LoadedProfile) -> Self {
        Self::Profile(Arc::new(profile))
    }
}

impl Reflector {
    /// Total diffuse reflectance of a medium, of light that has entered, RGB.
    ///
    /// # Errors
    /// As [`LoadedProfile::channels`].
    pub fn totals(&self, properties: &OpticalProperties) -> Result<DVec3> {
        let totals = match self {
            Self::Profile(profile) => profile.channels(properties)?.map(|channel| channel.total()),
            Self::Volume => half_space::total_reflectance(&properties.validated()?),
        };
        let totals = DVec3::from_array(totals);
        if totals.is_finite() { Ok(totals) } else { Err(Error::runtime(format!("the profile reflects {totals}"))) }
    }

    /// The colour of a medium: the light that a flat body of it scatters back under constant light, over that light, RGB.
    ///
    /// # Errors
    /// As [`Self::totals`].
    pub fn colour(&self, properties: &OpticalProperties) -> Result<DVec3> {
        Ok(self.totals(properties)? * diffuse_transmittance(properties.eta_inside_over_outside))
    }

    /// Returns whether a medium's coefficients change what is reflected.
    pub fn follows_medium(&self) -> bool {
        match self {
            Self::Volume => true,
            Self::Profile(profile) => match &**profile {
                LoadedProfile::OfMedium(model) => model.follows_medium(),
                LoadedProfile::Layers(layers) => layers.iter().any(|layer| layer.properties.is_none()),
                LoadedProfile::Gaussians(_) | LoadedProfile::Measured(_) => false,
            },
        }
    }
}

/// The length that is fixed while the albedo is sought.
///
/// Where a length depends on the albedo as well as on the extinction, the extinction follows the albedo in the search.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Radius {
    /// The mean free path 1 / sigma_t' of the reduced coefficients. Any albedo is possible with any mean free path.
    #[default]
    MeanFreePath,
    /// The diffusion length 1 / sigma_tr, sigma_tr = sqrt(3 sigma_a sigma_t'), whatever the profile. At a fixed length,
    /// a medium that absorbs little must scatter much, so that sigma_t' grows without bound towards a reflectance of 1;
    /// it is limited to [`LARGEST_SIGMA_PER_MM`]. What Cycles' Random Walk (Skin) takes.
    DiffusionLength,
    /// Radius times Scale of Blender's Cycles for Christensen-Burley and Random Walk: 4 pi mean free paths 1 / sigma_t',
    /// since Cycles divides by 4 pi to resemble its older models.
    Cycles,
    /// d of Christensen and Burley (2015), `R(r) = A (exp(-r / d) + exp(-r / (3 d))) / (8 pi d r)`: 1 / (s sigma_t') with
    /// their s(A) of a searchlight, A the total reflectance of light that has entered.
    Burley,
    /// subsurface_radius times subsurface_radius_scale of OpenPBR: the mean free path 1 / sigma_t, not reduced by g.
    OpenPbr,
}

impl Radius {
    /// All lengths.
    pub const ALL: [Self; 5] = [Self::MeanFreePath, Self::DiffusionLength, Self::Cycles, Self::Burley, Self::OpenPbr];

    /// Name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::MeanFreePath => "mean free path",
            Self::DiffusionLength => "diffusion length",
            Self::Cycles => "radius of Cycles",
            Self::Burley => "d of Burley",
            Self::OpenPbr => "radius of OpenPBR",
        }
    }

    /// Name on the command line and in material files.
    pub fn word(self) -> &'static str {
        match self {
            Self::MeanFreePath => "mfp",
            Self::DiffusionLength => "diffusion",
            Self::Cycles => "cycles",
            Self::Burley => "burley",
            Self::OpenPbr => "openpbr",
        }
    }

    /// The length of a medium in each channel, mm, within [`RADII_MM`]: an infinite one is the longest. `colour` is the
    /// medium's own.
    pub fn of_medium_mm(self, properties: &OpticalProperties, colour: DVec3) -> DVec3 {
        let reduced = properties.mean_free_path_mm();
        let length = match self {
            Self::MeanFreePath => reduced,
            Self::DiffusionLength => properties.diffusion_length_mm(),
            Self::Cycles => 4.0 * PI * reduced,
            Self::Burley => reduced / shape(colour, properties.eta_inside_over_outside),
            Self::OpenPbr => properties.sigma_t_per_mm().map(f64::recip),
        };
        length.clamp(DVec3::splat(*RADII_MM.start()), DVec3::splat(*RADII_MM.end()))
    }

    /// Smallest accepted x.
    fn least(self, radius_mm: f64) -> f64 {
        match self {
            Self::DiffusionLength => (3f64.sqrt() * radius_mm * LARGEST_SIGMA_PER_MM).recip().min(1.0),
            _ => 0.0,
        }
    }
}

/// s(A) of a colour, each channel.
fn shape(colour: DVec3, eta: f64) -> DVec3 {
    (colour / diffuse_transmittance(eta)).map(|total| BurleyFit::Searchlight.shape(total.clamp(0.0, 1.0)))
}

impl FromStr for Radius {
    type Err = Error;

    /// Reads a [`Self::word`].
    fn from_str(text: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|radius| radius.word() == text).ok_or_else(|| {
            let words = Self::ALL.map(Self::word).join(", ");
            Error::command_line(format!("`{text}` is no convention of a radius; there are {words}"))
        })
    }
}

/// The appearance that is asked of a medium; channels are linear sRGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// The light that a flat body (the half space, the slab, the layers) scatters back under constant light, over that
    /// light: what a white furnace shows of it, its highlight left out.
    pub colour: DVec3,
    /// Meaning of `radius_mm`.
    pub radius: Radius,
    /// Length of each channel in mm.
    pub radius_mm: DVec3,
    /// Mean cosine g; sigma_s' is reduced, so that only single scattering depends on it, and [`Radius::OpenPbr`].
    pub g: f64,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
}

impl Target {
    /// A target with a medium's own length, g and eta, and another colour; `own` is the colour of the medium.
    pub fn of_medium(properties: &OpticalProperties, radius: Radius, own: DVec3, colour: DVec3) -> Self {
        Self {
            colour,
            radius,
            radius_mm: radius.of_medium_mm(properties, own),
            g: properties.g,
            eta_inside_over_outside: properties.eta_inside_over_outside,
        }
    }

    /// sigma_s' and sigma_a in 1/mm of a channel at an x.
    fn coefficients_per_mm(&self, channel: usize, x: f64) -> [f64; 2] {
        let (radius_mm, scattered) = (self.radius_mm[channel], (1.0 - x) * (1.0 + x));
        let extinction = match self.radius {
            Radius::MeanFreePath => 1.0 / radius_mm,
            Radius::DiffusionLength => 1.0 / (3f64.sqrt() * radius_mm * x),
            Radius::Cycles => 4.0 * PI / radius_mm,
            Radius::Burley => 1.0 / (radius_mm * shape(self.colour, self.eta_inside_over_outside)[channel]),
            Radius::OpenPbr => 1.0 / (radius_mm * (scattered / (1.0 - self.g) + x * x)),
        };
        let extinction = extinction.min(LARGEST_SIGMA_PER_MM);
        [extinction * scattered, extinction * (x * x)]
    }
}

/// Result of an inversion: a medium with its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inversion {
    /// The medium.
    pub properties: OpticalProperties,
    /// The colour that was asked for, RGB.
    pub asked: DVec3,
    /// The colour of the medium, RGB.
    pub achieved: DVec3,
}

impl Inversion {
    /// A medium as it is, its own colour being the asked one.
    ///
    /// # Errors
    /// As [`Reflector::totals`].
    pub fn of_medium(reflector: &Reflector, properties: &OpticalProperties) -> Result<Self> {
        let achieved = reflector.colour(properties)?;
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

/// The medium whose colour by `reflector` is nearest to the asked one, at the asked length.
///
/// Each channel is within 1e-10 of its target where this lies between the colours without scattering (0, or that
/// of other layers) and without absorption; otherwise it is the nearer of the two, and [`Inversion::gap`]
/// is the difference. Totals must rise with alpha' for that, as those of all models do.
///
/// # Errors
/// Unsupported for profiles that no medium changes; invalid input for a colour that is not finite, a length outside
/// [`RADII_MM`], and g and eta as [`OpticalProperties::validated`] has them; run time, should a profile's table fail.
pub fn invert(reflector: &Reflector, target: &Target) -> Result<Inversion> {
    if !reflector.follows_medium() {
        return Err(Error::unsupported(
            "this profile is the same whatever the medium: no coefficients give it another colour or radius; choose \
             dipole, better-dipole, photon-beam, burley, slab, or layers of which one is the medium",
        ));
    }
    // g and eta are in what follows.
    medium(target, [None; 3]).validated()?;
    let channels = ["red", "green", "blue"].into_iter().zip(target.colour.to_array());
    for ((name, colour), radius_mm) in channels.zip(target.radius_mm.to_array()) {
        if !colour.is_finite() {
            return Err(Error::input(format!("the {name} of the colour is {colour}; it must be a finite number")));
        }
        if !RADII_MM.contains(&radius_mm) {
            let radius = target.radius.name();
            let (least, most) = (RADII_MM.start(), RADII_MM.end());
            return Err(Error::input(format!(
                "the {radius} of the {name} channel is {radius_mm} mm; it must be between {least:e} and {most:e}"
            )));
        }
    }
    let mut searches = [0, 1, 2]
        .map(|i| Search::new(target.colour.to_array()[i], target.radius.least(target.radius_mm.to_array()[i])));
    loop {
        let asked = searches.each_ref().map(Search::next);
        if asked == [None; 3] {
            break;
        }
        // A channel without extinction costs nothing.
        let values = reflector.colour(&medium(target, asked))?.to_array();
        for ((search, x), value) in searches.iter_mut().zip(asked).zip(values) {
            if let Some(x) = x {
                search.learn(x, value);
            }
        }
    }
    let best = searches.each_ref().map(|search| search.best);
    let properties = medium(target, best.map(|known| known.map(|(x, _)| x))).validated()?;
    let achieved = DVec3::from_array(best.map(|known| known.map_or(0.0, |(_, value)| value)));
    Ok(Inversion { properties, asked: target.colour, achieved })
}

/// The medium with these x; channels without an x have no extinction.
fn medium(target: &Target, x: [Option<f64>; 3]) -> OpticalProperties {
    let [red, green, blue] = [0, 1, 2].map(|i| x[i].map_or([0.0; 2], |x| target.coefficients_per_mm(i, x)));
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
