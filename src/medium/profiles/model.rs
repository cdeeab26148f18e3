//! The choice of a profile: its text form, and the three channels for a medium.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use super::better_dipole::BetterDipole;
use super::burley::{Burley, BurleyFit};
use super::gaussians::{self, Gaussians, Lobe, SKIN};
use super::layer_file::{self, LayerSpec};
use super::layers::{Layer, Layers, THICKNESSES_MM};
use super::measured::{self, Interpolation, Measured};
use super::photon_beam::photon_beam;
use crate::error::{Error, Result};
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::OpticalProperties;
use crate::medium::profile::{Orders, Profile};

/// The profiles of red, green and blue.
pub type Channels = [Box<dyn Profile>; 3];

const FORMS: &str = "type dipole, dipole:from=2, better-dipole, photon-beam, burley, burley:fit=searchlight|diffuse|dmfp, slab:thickness=MM, \
                     layers:path=FILE.toml, gaussians:skin, gaussians:path=FILE.csv, \
                     measured:path=FILE.csv or measured:interpolation=linear:path=FILE.csv";

/// A profile as typed, before any file is read.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ProfileModel {
    /// The classical dipole, of all orders of scattering from 1 on.
    #[default]
    Dipole,
    /// The same of the orders from 2 on, beside single scattering.
    LaterDipole,
    /// The better dipole.
    BetterDipole,
    /// Photon beam diffusion at a right angle.
    PhotonBeam,
    /// Normalised diffusion.
    Burley(BurleyFit),
    /// A slab of the medium with air on both sides, thickness in mm.
    Slab(f64),
    /// A stack of layers from a file.
    Layers(PathBuf),
    /// The published Gaussians of skin.
    Skin,
    /// Gaussians from a file.
    Gaussians(PathBuf),
    /// A measured profile from a file.
    Measured(PathBuf, Interpolation),
}

/// A profile whose files have been read.
#[derive(Clone, Debug, PartialEq)]
pub enum LoadedProfile {
    /// A model that follows the medium alone: dipole, better dipole, photon beam, Burley, slab.
    OfMedium(ProfileModel),
    /// Layers from the top.
    Layers(Vec<LayerSpec>),
    /// Gaussians, independent of the medium.
    Gaussians([Gaussians; 3]),
    /// Measured channels, independent of the medium.
    Measured([Measured; 3]),
}

impl ProfileModel {
    /// Reads one of the forms: `dipole`, `dipole:from=2`, `better-dipole`, `photon-beam`, `burley[:fit=searchlight|diffuse|dmfp]` (or
    /// `burley:diffuse`), `slab:thickness=MM`, `layers:path=FILE.toml`, `gaussians:skin`, `gaussians:path=FILE.csv`,
    /// `measured[:interpolation=log|linear]:path=FILE.csv`; a bare path is layers (`.toml`) or measured (`.csv`).
    ///
    /// # Errors
    /// Command line for anything else.
    pub fn parse(text: &str) -> Result<Self> {
        let text = text.trim();
        read(text).map_err(|error| error.at(format!("profile `{text}`")))
    }

    /// Reads the files that the model names.
    ///
    /// # Errors
    /// Errors of the files: I/O, or invalid input with path and line.
    pub fn load(&self) -> Result<LoadedProfile> {
        Ok(match self {
            Self::Layers(path) => LoadedProfile::Layers(layer_file::read(path)?),
            Self::Skin => LoadedProfile::Gaussians(Gaussians::channels(&SKIN)?),
            Self::Gaussians(path) => {
                let lobes: Vec<Lobe> = gaussians::read_lobes(path)?;
                LoadedProfile::Gaussians(Gaussians::channels(&lobes).map_err(|error| error.in_file(path))?)
            }
            Self::Measured(path, interpolation) => LoadedProfile::Measured(measured::read(path, *interpolation)?),
            model => LoadedProfile::OfMedium(model.clone()),
        })
    }

    /// The profiles of a medium; files are read anew, see [`ProfileModel::load`].
    ///
    /// # Errors
    /// Errors of [`ProfileModel::load`] and [`LoadedProfile::channels`].
    pub fn channels(&self, properties: &OpticalProperties) -> Result<Channels> {
        self.load()?.channels(properties)
    }

    /// Returns whether a medium's coefficients change the profile.
    pub fn follows_medium(&self) -> bool {
        !matches!(self, Self::Skin | Self::Gaussians(_) | Self::Measured(..))
    }
}

impl LoadedProfile {
    /// The dipole of some orders of scattering.
    pub fn dipole(orders: Orders) -> Self {
        Self::OfMedium(match orders {
            Orders::FromOne => ProfileModel::Dipole,
            Orders::FromTwo => ProfileModel::LaterDipole,
        })
    }

    /// The same beside a stage of the first order: the dipole loses it, the other models do not hold it.
    #[must_use]
    pub fn beside_single_scattering(self) -> Self {
        if self == Self::dipole(Orders::FromOne) { Self::dipole(Orders::FromTwo) } else { self }
    }

    /// The profiles of a medium.
    ///
    /// # Errors
    /// Invalid input for properties that are not valid; run time, should a table fail.
    pub fn channels(&self, properties: &OpticalProperties) -> Result<Channels> {
        let properties = properties.validated()?;
        let make = |channel: usize| self.channel(&properties, channel);
        Ok([make(0)?, make(1)?, make(2)?])
    }

    fn channel(&self, properties: &OpticalProperties, channel: usize) -> Result<Box<dyn Profile>> {
        let own = LayerSpec { thickness_mm: None, properties: None }.channel(properties, channel);
        let Layer { sigma_s_reduced_per_mm: s, sigma_a_per_mm: a, eta_inside_over_outside: eta, .. } = own;
        Ok(match self {
            Self::Gaussians(channels) => Box::new(channels[channel].clone()),
            Self::Measured(channels) => Box::new(channels[channel].clone()),
            Self::Layers(specs) => {
                let layers: Vec<Layer> = specs.iter().map(|spec| spec.channel(properties, channel)).collect();
                Box::new(Layers::new(&layers, BoundaryFit::Published)?)
            }
            Self::OfMedium(model) => match model {
                ProfileModel::BetterDipole => Box::new(BetterDipole::new(s, a, eta)),
                ProfileModel::PhotonBeam => Box::new(photon_beam(s, a, eta)?),
                ProfileModel::Burley(fit) => Box::new(Burley::of_medium(s, a, eta, *fit)),
                ProfileModel::Slab(thickness) => {
                    let slab = Layer { thickness_mm: Some(*thickness), ..own };
                    Box::new(Layers::new(&[slab], BoundaryFit::Published)?)
                }
                ProfileModel::Dipole => Box::new(properties.dipoles(BoundaryFit::Published)[channel]),
                ProfileModel::LaterDipole => {
                    Box::new(properties.dipoles(BoundaryFit::Published)[channel].after_first())
                }
                file => return file.load()?.channel(properties, channel),
            },
        })
    }
}

impl FromStr for ProfileModel {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Self::parse(text)
    }
}

fn read(text: &str) -> Result<ProfileModel> {
    let fail = |what: String| Error::command_line(format!("{what}; {FORMS}"));
    let (kind, rest) = text.split_once(':').map_or((text, None), |(kind, rest)| (kind, Some(rest)));
    let path = |rest: Option<&str>| {
        let path = rest.and_then(|rest| rest.strip_prefix("path=")).map_or("", str::trim);
        if path.is_empty() { Err(fail(format!("`{kind}` takes a path"))) } else { Ok(PathBuf::from(path)) }
    };
    let alone = |model: ProfileModel| match rest {
        None => Ok(model),
        Some(_) => Err(fail(format!("`{kind}` has no keys"))),
    };
    match (kind, rest) {
        ("", None) => Err(fail("it is empty".into())),
        ("dipole", Some("from=2")) => Ok(ProfileModel::LaterDipole),
        ("dipole", None | Some("from=1")) => Ok(ProfileModel::Dipole),
        ("dipole", Some(other)) => {
            Err(fail(format!("dipole:{other}: its orders of scattering are from=1 or from=2 on")))
        }
        ("better-dipole", _) => alone(ProfileModel::BetterDipole),
        ("photon-beam", _) => alone(ProfileModel::PhotonBeam),
        ("burley", None) => Ok(ProfileModel::Burley(BurleyFit::default())),
        ("burley", Some(fit)) => match fit.strip_prefix("fit=").unwrap_or(fit) {
            "searchlight" => Ok(ProfileModel::Burley(BurleyFit::Searchlight)),
            "diffuse" => Ok(ProfileModel::Burley(BurleyFit::Diffuse)),
            "dmfp" => Ok(ProfileModel::Burley(BurleyFit::DiffuseMeanFreePath)),
            other => Err(fail(format!("`{other}` is no fit of burley"))),
        },
        ("slab", rest) => {
            let value = rest.and_then(|rest| rest.strip_prefix("thickness=")).unwrap_or("");
            match value.trim().parse::<f64>() {
                Ok(thickness) if THICKNESSES_MM.contains(&thickness) => Ok(ProfileModel::Slab(thickness)),
                _ => Err(fail(format!(
                    "slab:thickness={value}: a number of mm is needed, {:e} to {:e}",
                    THICKNESSES_MM.start(),
                    THICKNESSES_MM.end()
                ))),
            }
        }
        ("layers", rest) => path(rest).map(ProfileModel::Layers),
        ("gaussians", Some("skin")) => Ok(ProfileModel::Skin),
        ("gaussians", rest) => path(rest).map(ProfileModel::Gaussians),
        ("measured", rest) => {
            let all = rest.unwrap_or("");
            let (interpolation, rest) = if let Some(rest) = all.strip_prefix("interpolation=linear:") {
                (Interpolation::Linear, rest)
            } else {
                (Interpolation::LogLinear, all.strip_prefix("interpolation=log:").unwrap_or(all))
            };
            path(Some(rest)).map(|path| ProfileModel::Measured(path, interpolation))
        }
        _ if has_suffix(text, ".toml") => Ok(ProfileModel::Layers(text.into())),
        _ if has_suffix(text, ".csv") => Ok(ProfileModel::Measured(text.into(), Interpolation::default())),
        _ => Err(fail(format!("`{kind}` is no profile"))),
    }
}

fn has_suffix(text: &str, suffix: &str) -> bool {
    text.to_ascii_lowercase().ends_with(suffix)
}

/// The text form that [`ProfileModel::parse`] reads.
impl fmt::Display for ProfileModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dipole => f.write_str("dipole"),
            Self::LaterDipole => f.write_str("dipole:from=2"),
            Self::BetterDipole => f.write_str("better-dipole"),
            Self::PhotonBeam => f.write_str("photon-beam"),
            Self::Burley(BurleyFit::Searchlight) => f.write_str("burley"),
            Self::Burley(BurleyFit::Diffuse) => f.write_str("burley:fit=diffuse"),
            Self::Burley(BurleyFit::DiffuseMeanFreePath) => f.write_str("burley:fit=dmfp"),
            Self::Slab(thickness) => write!(f, "slab:thickness={thickness}"),
            Self::Layers(path) => write!(f, "layers:path={}", path.display()),
            Self::Skin => f.write_str("gaussians:skin"),
            Self::Gaussians(path) => write!(f, "gaussians:path={}", path.display()),
            Self::Measured(path, Interpolation::LogLinear) => write!(f, "measured:path={}", path.display()),
            Self::Measured(path, Interpolation::Linear) => {
                write!(f, "measured:interpolation=linear:path={}", path.display())
            }
        }
    }
}
