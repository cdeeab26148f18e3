//! From an opened asset and lights to radiosity: the traits that every method implements.

#[cfg(feature = "gpu")]
pub mod device;
pub mod environment;
pub mod far_field;
pub(crate) mod forward;
pub mod inter_reflection;
pub mod sampled;
pub mod sampling_error;
pub mod single_scattering;
pub mod source_fields;
pub mod summed;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::DVec3;

use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::light::{Light, LightKind};
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;
use crate::transport::receivers::Receivers;
use crate::transport::scene::{Medium, Scene};

/// A key that `--set key=value` takes.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Name.
    pub name: &'static str,
    /// Default, as it would be typed.
    pub default: &'static str,
    /// One line: effect, unit, values.
    pub help: &'static str,
}

/// Everything that determines a bake besides the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct BakeSettings {
    /// Surface samples, or as many as the method needs.
    pub samples: Option<usize>,
    /// Relative error that is asked for.
    pub max_rms: f64,
    /// Method-specific keys, all of them, resolved.
    pub values: BTreeMap<String, String>,
    /// Kinds of light that the asset is made for.
    pub for_lights: BTreeSet<LightKind>,
    /// Lights that choices and figures take.
    pub probes: Probes,
}

impl BakeSettings {
    /// A method's defaults for the values of its keys, for every kind of light, without probe lights.
    pub fn new(method: &dyn Method, values: BTreeMap<String, String>) -> Self {
        Self {
            samples: None,
            max_rms: method.default_max_rms(),
            values,
            for_lights: LightKind::ALL.into_iter().collect(),
            probes: Probes::default(),
        }
    }
}

/// Lights for the choices of a bake and for the figures of its ledger, which no choice sees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Probes {
    /// Lights that choices look at.
    pub tuning: Vec<Light>,
    /// Lights that errors are measured under.
    pub unseen: Vec<Light>,
}

/// What a bake makes of a scene.
pub struct AssetParts {
    /// The surface samples.
    pub samples: crate::geometry::samples::Samples,
    /// What each lossy stage added.
    pub ledger: Ledger,
    /// Sections of the method's own.
    pub sections: Vec<translux_format::RawSection>,
}

/// A precomputation method.
pub trait Method: Sync {
    /// Name on the command line and in the asset.
    fn name(&self) -> &'static str;

    /// One line for people.
    fn summary(&self) -> &'static str;

    /// Keys that `--set` takes.
    fn keys(&self) -> &'static [Key];

    /// Kinds of light that it serves; its evaluators refuse others.
    fn kinds(&self) -> &'static [LightKind] {
        &LightKind::ALL
    }

    /// Error that a bake aims at unless another one is asked for.
    fn default_max_rms(&self) -> f64 {
        0.005
    }

    /// Settings that charts compare, as options of `bake`, the defaults (no options) first: from fast or small to exact.
    fn ladder(&self) -> &'static [&'static str] {
        &[""]
    }

    /// Memory that a bake of this scene takes, in bytes, estimated before the work.
    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64;

    /// Precomputes.
    ///
    /// # Errors
    /// Values of keys that do not fit; failures of the work.
    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts>;

    /// Whether an asset baked with these settings holds transport, which belongs to the size and the mesh that it was computed for.
    fn stores_transport(&self, _settings: &BTreeMap<String, String>) -> bool {
        true
    }

    /// Makes the asset's evaluator.
    ///
    /// # Errors
    /// Sections that are missing or do not fit.
    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>>;
}

/// What an evaluator allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Capabilities {
    /// What may change about the material without a new bake.
    pub material: MaterialEdit,
    /// Whether another radial profile may take the dipole's place.
    pub profile: ProfileEdit,
    /// Whether area lights may go through source radiance fields ([`crate::light::source_field`]).
    pub source_fields: SourceFields,
}

/// What may change about the material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MaterialEdit {
    /// Nothing: the material is baked in.
    None,
    /// Every optical property.
    Any,
}

/// Whether area lights may go through source radiance fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SourceFields {
    /// No: there are no irradiance rows at the samples.
    None,
    /// Yes, in the media in force: their refractive indices are those that the rows serve.
    Any,
}

/// Which radial profiles an evaluator takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProfileEdit {
    /// The one that its transport was computed for.
    None,
    /// Any, on the CPU: the shaders know the dipole alone.
    OnCpu,
    /// Any, on devices as well.
    Any,
}

/// Size of what an evaluator holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Cost {
    /// Surface samples.
    pub samples: usize,
    /// Points where radiosity is gathered.
    pub receivers: usize,
    /// Bytes of the method's data in memory, mesh and occluders apart.
    pub resident_bytes: usize,
}

/// Where single scattering is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleScattering {
    /// Nowhere.
    None,
    /// In the radiosity, isotropic: what leaves is the same as with [`Self::PerVertex`], but nothing tells the two apart.
    Included,
    /// Beside it: [`Evaluator::single_scattering`].
    PerVertex,
    /// Beside it, for eyes alone, looked up: [`Evaluator::towards_eye`].
    TowardsEye,
    /// The same by rays.
    TracedTowardsEye,
}

/// An asset at run time: lights in, radiosity out. Linear in the lights.
pub trait Evaluator: Send {
    /// What may change.
    fn capabilities(&self) -> Capabilities;

    /// Size of what is held.
    fn cost(&self) -> Cost;

    /// The scene that the asset describes, with the media in force.
    fn scene(&self) -> &Scene;

    /// Occluders of the scene, for whoever looks at it.
    fn bvh(&self) -> &crate::geometry::bvh::Bvh;

    /// Replaces the lights.
    ///
    /// # Errors
    /// Lights that the asset does not carry (`Unsupported`).
    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()>;

    /// Replaces the media, one for each of the scene's.
    ///
    /// # Errors
    /// `Unsupported` where the material is baked in or out of the asset's range.
    fn set_media(&mut self, media: Vec<Medium>) -> Result<()>;

    /// Puts another radial profile in the dipole's place, for the media in force and those to come.
    ///
    /// # Errors
    /// `Unsupported` where the transport is that of a dipole; what the profile says of the media.
    fn set_profile(&mut self, _profile: LoadedProfile) -> Result<()> {
        Err(Error::unsupported(
            "the transport in this asset is that of dipoles; an asset of --method editable stores none and takes any profile",
        ))
    }

    /// Spends memory and time now, so that edits of the media under one light are fast from here on. What is summed may be coarser than
    /// without, by far less than the error that was asked for.
    fn prepare_for_edits(&mut self, _progress: &dyn Progress) {}

    /// Radiosity of every source vertex, RGB; zero for vertices without transferring area.
    ///
    /// # Errors
    /// Failures of the work.
    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>>;

    /// Single scattering of every source vertex along the inverse normal, isotropic, RGB: `s = pi C L1 / F_t(w_o)`, in the
    /// unit of the radiosity and beside it (never part of it), in its order and with its welds. None where the method or
    /// the asset has none, or none that an eye would not change.
    ///
    /// # Errors
    /// Failures of the work.
    fn single_scattering(&mut self, _progress: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        Ok(None)
    }

    /// Where single scattering is, without the work of computing it.
    fn single_scattering_is(&self) -> SingleScattering {
        SingleScattering::None
    }

    /// Single scattering under the lights and media in force as eyes see it, where that is more than
    /// [`Self::single_scattering`].
    ///
    /// # Errors
    /// Failures of the work.
    fn towards_eye(&self) -> Result<Option<Box<dyn single_scattering::TowardsEye + '_>>> {
        Ok(None)
    }

    /// Puts the eye somewhere, mm, for what leaves the surface towards it alone; whether that is anything, so that
    /// [`Self::radiosity`] has changed.
    fn set_eye(&mut self, _at_mm: DVec3) -> bool {
        false
    }

    /// Radiosity at any places of the parts under the lights and media in force, in the order of the receivers, RGB. Only what
    /// gathers from samples when it is evaluated can do so.
    ///
    /// # Errors
    /// `Unsupported` where transport ends at the vertices that it was computed for; failures of the work.
    fn radiosity_at(&mut self, _receivers: &Receivers, _progress: &dyn Progress) -> Result<Vec<DVec3>> {
        Err(Error::unsupported(
            "the transport in this asset ends at its own vertices; an asset of --method editable stores none and serves other meshes",
        ))
    }

    /// What the evaluator measures of its own error for the lights and media in force, on vertices that no choice saw;
    /// what was tuned for these lights is measured under the `unseen` ones as well.
    ///
    /// # Errors
    /// Failures of the work.
    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger>;

    /// Radiosity of every source vertex under the lights and media in force, RGB, as the samples alone would have it: all
    /// pairs, the near field integrated as finely as the truth does. What the evaluator's own transport is off by.
    ///
    /// # Errors
    /// Failures of the work.
    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>>;

    /// The same evaluator with its transport in compute shaders.
    ///
    /// # Errors
    /// `Unsupported` where the method has no shaders, or the adapter no room.
    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, _device: &Arc<device::Device>) -> Result<Box<dyn device::DeviceEvaluator>> {
        Err(Error::unsupported("this method has no compute shaders; use --device cpu"))
    }
}
