//! Forms: the ways in which transport is kept and evaluated. The typed settings of a form are its record in the asset;
//! they know how to bake it and how to open it.

use std::any::Any;
use std::collections::BTreeSet;
use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;
use translux_format::metadata::tags;
use translux_format::{Codec, FormatError, Kind, RawSection, Tag};

use super::capabilities::Capabilities;
use super::evaluator::Evaluator;
use super::forecast::Forecast;
use super::guarded::Guarded;
use super::memory;
use super::model_error::ModelWalks;
use super::stage_cache::StageCache;
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::geometry::samples::Samples;
use crate::light::{Light, LightKind};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::calibration::Walks;

/// The model of the light inside that kernels follow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Model {
    /// The dipole of the papers, made for a half space.
    #[default]
    Dipole,
    /// The dipole, calibrated by walks through the body.
    Calibrated(Walks),
}

/// Settings of a bake that all forms share.
#[derive(Clone, Debug, PartialEq)]
pub struct BakeSettings {
    /// Number of surface samples; none for as many as the form needs.
    pub samples: Option<usize>,
    /// Whether the file holds samples that could be made again from the mesh.
    pub samples_stored: bool,
    /// Largest relative RMS error that is asked for.
    pub max_rms: f64,
    /// Kinds of light that the asset is made for.
    pub for_lights: BTreeSet<LightKind>,
    /// Model of the light inside.
    pub model: Model,
    /// Sections of calibrated kernels that are ready, of the scene of the bake; those of other walks than the model's are not used.
    pub kernels: Vec<RawSection>,
    /// Walks through the same scene that tell the error of its model, where there are some already.
    pub walks: Option<Arc<ModelWalks>>,
    /// Whether the ledger tells the error of a model that can be told it.
    pub tells_model: bool,
    /// Probe lights for choices and for reported errors.
    pub probes: Probes,
    /// Results of stages of earlier bakes.
    pub cache: StageCache,
}

impl BakeSettings {
    /// Settings for every kind of light that can be stored, as many samples as are needed, no probe lights.
    pub fn new(max_rms: f64) -> Self {
        Self {
            samples: None,
            samples_stored: false,
            max_rms,
            for_lights: LightKind::STORABLE.into_iter().collect(),
            model: Model::Dipole,
            kernels: Vec::new(),
            walks: None,
            tells_model: true,
            probes: Probes::default(),
            cache: StageCache::default(),
        }
    }

    /// The settings with those of the unseen probe lights that the asset is made for: points where point, spot or area lights are asked for,
    /// environments where environments or constant light are, directions in any case.
    #[must_use]
    pub fn with_probes_of_kinds(&self) -> Self {
        let soft = self.is_for(LightKind::Environment) || self.is_for(LightKind::Constant);
        let near = [LightKind::Point, LightKind::Area, LightKind::Spot].iter().any(|kind| self.is_for(*kind));
        let mut settings = self.clone();
        settings.probes.unseen.retain(|light| match light.kind() {
            LightKind::Directional => true,
            LightKind::Point | LightKind::Area => near,
            LightKind::Spot => self.is_for(LightKind::Spot),
            LightKind::Environment | LightKind::Constant => soft,
        });
        settings
    }

    /// Returns whether the asset is made for a kind of light.
    pub fn is_for(&self, kind: LightKind) -> bool {
        self.for_lights.contains(&kind)
    }
}

/// Probe lights: one set for the choices of a bake, another for the errors of its ledger, which no choice sees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Probes {
    /// Lights that choices look at.
    pub tuning: Vec<Light>,
    /// Lights that errors are measured under.
    pub unseen: Vec<Light>,
}

/// Opens the finished asset of a bake.
pub type Opener = Box<dyn FnOnce(Arc<Asset>) -> Result<Box<dyn Evaluator>>>;

/// The result of a form's bake.
pub struct AssetParts {
    /// The surface samples; empty for forms that evaluate none.
    pub samples: Samples,
    /// The error that each lossy stage added.
    pub ledger: Ledger,
    /// Sections of the form's own.
    pub sections: Vec<RawSection>,
    /// What opens the asset as [`Form::open`] does, with what the bake has made already; none where that spares no work.
    pub opener: Option<Opener>,
}

impl AssetParts {
    /// Parts without samples, of a form whose evaluator reads none.
    pub fn without_samples(scene: &Scene, ledger: Ledger, sections: Vec<RawSection>) -> Self {
        let part_offsets = vec![0; scene.parts.parts.len() + 1];
        let samples = Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets };
        Self { samples, ledger, sections, opener: None }
    }
}

/// A form with its settings.
pub trait Form: Serialize + DeserializeOwned + Send + Sync + 'static {
    /// Name in the asset.
    const NAME: &'static str;

    /// Tags of sections that no other part of this crate knows, in assets that are evaluated without samples: those of
    /// a form from outside.
    const TAGS: &'static [Tag] = &[];

    /// Refuses settings out of range: those of a file may be anything.
    ///
    /// # Errors
    /// Invalid input: which setting, and what it may be.
    fn validate(&self) -> Result<()>;

    /// Kinds of light that its evaluators serve; they refuse others.
    fn kinds(&self) -> &'static [LightKind] {
        &LightKind::ALL
    }

    /// Returns whether its assets hold transport, which is valid only for the size and the mesh that it was computed
    /// for.
    fn holds_transport(&self) -> bool {
        true
    }

    /// Returns whether its evaluators give exitance at any point of the surface
    /// ([`Evaluator::exitance_at_points`]).
    fn serves_points(&self) -> bool {
        false
    }

    /// Returns whether its kernels can follow a model.
    fn serves(&self, model: Model) -> bool {
        model == Model::Dipole
    }

    /// Returns whether its bake has blocks that several processes can share ([`StageCache::gather`]).
    fn divides(&self) -> bool {
        false
    }

    /// The edits that the evaluators of an asset allow in the media that it was baked with, told by which sections there are; none where
    /// only an evaluator knows.
    fn edits(&self, _has: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        None
    }

    /// Memory that a bake of this scene takes, in bytes, estimated before the work.
    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64;

    /// Memory that the evaluator of an asset and its answer to a light take beside the asset, in bytes, estimated before the work.
    fn run_memory(&self, asset: &Asset) -> u64 {
        memory::of_evaluator(asset)
    }

    /// What an asset of this scene is expected to cost, estimated before the work; none where nobody has found out.
    fn forecast(&self, _scene: &Scene, _settings: &BakeSettings) -> Option<Forecast> {
        None
    }

    /// Precomputes the parts of an asset.
    ///
    /// # Errors
    /// Scenes or lights that do not fit; failures of the work.
    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts>;

    /// Makes the evaluator of an asset with these settings.
    ///
    /// # Errors
    /// Sections that are missing or do not fit.
    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>>;
}

/// A [`Form`] of any type; as `dyn Any` it is that type.
pub trait AnyForm: Any + Send + Sync {
    /// See [`Form::NAME`].
    fn name(&self) -> &'static str;

    /// The sections that name the form and hold its settings.
    ///
    /// # Errors
    /// Settings that no record holds.
    fn record(&self) -> Result<[RawSection; 2]>;

    /// See [`Form::kinds`].
    fn kinds(&self) -> &'static [LightKind];

    /// See [`Form::holds_transport`].
    fn holds_transport(&self) -> bool;

    /// See [`Form::serves_points`].
    fn serves_points(&self) -> bool;

    /// See [`Form::serves`].
    fn serves(&self, model: Model) -> bool;

    /// See [`Form::divides`].
    fn divides(&self) -> bool;

    /// See [`Form::edits`].
    fn edits(&self, has: &dyn Fn(Tag) -> bool) -> Option<Capabilities>;

    /// See [`Form::bake_memory`].
    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64;

    /// See [`Form::run_memory`].
    fn run_memory(&self, asset: &Asset) -> u64;

    /// See [`Form::forecast`].
    fn forecast(&self, scene: &Scene, settings: &BakeSettings) -> Option<Forecast>;

    /// See [`Form::bake`].
    ///
    /// # Errors
    /// Errors of the form.
    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts>;

    /// See [`Form::open`].
    ///
    /// # Errors
    /// Errors of the form.
    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>>;
}

impl<F: Form> AnyForm for F {
    fn name(&self) -> &'static str {
        F::NAME
    }

    fn record(&self) -> Result<[RawSection; 2]> {
        let name = RawSection::from_record(tags::FORM, Kind::Metadata, Codec::Zstd, &F::NAME).map_err(write_error)?;
        let settings = RawSection::from_record(tags::SETTINGS, Kind::Metadata, Codec::Zstd, self);
        Ok([name, settings.map_err(write_error)?])
    }

    fn kinds(&self) -> &'static [LightKind] {
        Form::kinds(self)
    }

    fn holds_transport(&self) -> bool {
        Form::holds_transport(self)
    }

    fn serves_points(&self) -> bool {
        Form::serves_points(self)
    }

    fn serves(&self, model: Model) -> bool {
        Form::serves(self, model)
    }

    fn divides(&self) -> bool {
        Form::divides(self)
    }

    fn edits(&self, has: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        Form::edits(self, has)
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        Form::bake_memory(self, scene, settings)
    }

    fn run_memory(&self, asset: &Asset) -> u64 {
        Form::run_memory(self, asset)
    }

    fn forecast(&self, scene: &Scene, settings: &BakeSettings) -> Option<Forecast> {
        Form::forecast(self, scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        let parts = Form::bake(self, scene, settings, progress)?;
        let guarded = |open: Opener| Box::new(|asset| open(asset).map(Guarded::of)) as Opener;
        Ok(AssetParts { opener: parts.opener.map(guarded), ..parts })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        Form::open(self, asset).map(Guarded::of)
    }
}

/// A form that assets may have.
#[derive(Clone, Copy)]
pub struct RegisteredForm {
    /// Its name in the asset.
    pub name: &'static str,
    /// See [`Form::TAGS`].
    pub tags: &'static [Tag],
    /// Reads and validates its settings.
    pub read: fn(&RawSection) -> Result<Box<dyn AnyForm>>,
}

impl RegisteredForm {
    /// The entry of a form.
    pub const fn of<F: Form>() -> Self {
        Self { name: F::NAME, tags: F::TAGS, read: read::<F> }
    }
}

/// The error for what no section holds (exit 4).
pub fn write_error(error: FormatError) -> Error {
    Error::runtime(format!("asset: {error}"))
}

/// The error for sections that cannot be read (exit 3).
pub fn read_error(error: FormatError) -> Error {
    Error::input(error.to_string())
}

fn read<F: Form>(section: &RawSection) -> Result<Box<dyn AnyForm>> {
    let form: F = section.record().map_err(read_error)?;
    form.validate().map_err(|e| Error::input(format!("section {}: {}", section.tag, e.message())))?;
    Ok(Box::new(form))
}
