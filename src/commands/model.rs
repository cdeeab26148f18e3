//! A model with its size, parts and media: the arguments that every command with a MODEL takes, and what they resolve to.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;

use super::console::{Console, Verbosity, significant};
use super::media::MediumArgs;
use crate::asset::{Input, Provenance};
use crate::error::{Error, Result};
use crate::geometry::check::{self, MeanFreePath, MeshCheck};
use crate::geometry::mesh::{Mesh, Scale, UpAxis, resolve_scale, skip_materials};
use crate::geometry::part_table::PartTable;
use crate::geometry::parts::{Analysis, MaterialRoles, PartsRule};
use crate::geometry::source::SourceModel;
use crate::io;
use crate::transport::scene::{Medium, Scene};

/// A model and what it is made of.
#[derive(Clone, Debug, Args)]
pub(super) struct ModelArgs {
    /// OBJ, glTF or GLB file
    pub(super) model: PathBuf,
    #[command(flatten)]
    media: MediumArgs,
    #[command(flatten)]
    placement: PlacementArgs,
}

/// Size, parts, roles.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Size and parts")]
pub(super) struct PlacementArgs {
    /// Length of one unit of the model
    #[arg(long, group = "scale")]
    unit: Option<Unit>,
    /// Scale the model so that the diagonal of its bounding box is this long, in mm
    #[arg(long, group = "scale", value_name = "MM", allow_negative_numbers = true)]
    size_mm: Option<f64>,
    /// Scale the model so that it is this high, in mm
    #[arg(long, group = "scale", value_name = "MM", allow_negative_numbers = true)]
    height_mm: Option<f64>,
    /// Axis of the model that --height-mm measures along
    #[arg(long, default_value = "y")]
    up: Up,
    /// Which components share their light inside
    #[arg(long, default_value = "auto", value_name = "RULE")]
    parts: PartsChoice,
    /// Materials of the model that only cast shadows, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    opaque: Vec<String>,
    /// Materials of the model that are left out, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    skip: Vec<String>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Unit {
    Mm,
    Cm,
    M,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum Up {
    #[default]
    Y,
    Z,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum PartsChoice {
    /// Components that touch or overlap are one part
    #[default]
    Auto,
    /// Every component is a part
    Separate,
    /// All components of a medium are one part
    Joined,
}

/// A model ready to bake.
pub(super) struct Loaded {
    pub(super) scene: Scene,
    pub(super) provenance: Provenance,
    pub(super) check: MeshCheck,
}

impl ModelArgs {
    /// Reads the model and resolves its size, parts and media; says what a user must know on standard error.
    pub(super) fn load(&self, console: &Console) -> Result<Loaded> {
        let source = console.stage("import", || read_model(&self.model))?;
        let inputs = hashed(files_of(&self.model)?.into_iter().chain(self.media.files()))?;
        self.prepare(source, inputs, console).map_err(|e| e.at(self.model.display()))
    }

    /// The same from a model in memory.
    fn prepare(&self, mut source: SourceModel, inputs: Vec<Input>, console: &Console) -> Result<Loaded> {
        for warning in std::mem::take(&mut source.warnings) {
            console.warn(&warning);
        }
        skip_materials(&mut source, &self.placement.skip)?;
        let scale = self.placement.scale();
        let unit = match scale {
            Some(Scale::MillimetresPerUnit(mm)) => format!("--unit, {mm} mm"),
            Some(Scale::DiagonalMm(mm)) => format!("--size-mm {mm}"),
            Some(Scale::HeightMm(mm, axis)) => format!("--height-mm {mm} along {axis:?}"),
            None => "the file's".to_owned(),
        };
        let opaque = &self.placement.opaque;
        let rest = self.media.resolve(&source.materials, &translucent(&source, opaque))?;
        let roles = MaterialRoles::resolve(&source.materials, &rest.by_name, rest.rest, opaque)?;
        let rule = self.placement.parts.rule();
        prepare(Prepare { scale, unit: &unit, roles, media: rest.media, rule, inputs }, source, console)
    }
}

/// What turns a source into a scene.
pub(super) struct Prepare<'a> {
    pub(super) scale: Option<Scale>,
    /// How the unit was fixed, for the provenance.
    pub(super) unit: &'a str,
    pub(super) roles: MaterialRoles,
    pub(super) media: Vec<Medium>,
    pub(super) rule: PartsRule,
    pub(super) inputs: Vec<Input>,
}

/// Names of the materials that triangles have, the opaque ones left out.
fn translucent<'a>(source: &'a SourceModel, opaque: &[String]) -> Vec<&'a str> {
    let mut used = vec![false; source.materials.len()];
    for &material in &source.triangle_material {
        if let Some(used) = used.get_mut(material as usize) {
            *used = true;
        }
    }
    let names = source.materials.iter().zip(used).filter(|(name, used)| *used && !opaque.contains(name));
    names.map(|(name, _)| name.as_str()).collect()
}

/// From a source to a scene, with everything that a user must be told.
pub(super) fn prepare(how: Prepare, source: SourceModel, console: &Console) -> Result<Loaded> {
    let Prepare { scale, unit, roles, media, rule, inputs } = how;
    let placement = resolve_scale(&source, scale)?;
    let (scene, check, notes) = console.stage("mesh", || -> Result<_> {
        let (mut mesh, mut repairs) = Mesh::from_source(source, &placement)?;
        let analysis = Analysis::new(&mut mesh, &roles, rule, &mut repairs);
        let free_paths: Vec<MeanFreePath> = media.iter().map(free_path).collect();
        let check = check::check(&mesh, &analysis, &repairs, Some(&free_paths));
        let mut notes = repairs.lines();
        notes.push(analysis.parts.description());
        let parts = PartTable::of(&mesh, &analysis.parts);
        Ok((Scene { mesh, parts, media }, check, notes))
    })?;
    if let Some(choice) = notes.last().filter(|_| check.components > 1) {
        console.note(choice);
    }
    for warning in check.warnings() {
        console.warn(&warning);
    }
    if !scene.parts.parts.iter().any(|p| p.transfers()) {
        return Err(Error::input("every part is opaque: nothing scatters light"));
    }
    print_sizes(&scene, console);
    let provenance = Provenance {
        method: String::new(),
        settings: Default::default(),
        inputs,
        source_unit: unit.to_owned(),
        mm_per_source_unit: placement.mm_per_unit,
        notes,
    };
    Ok(Loaded { scene, provenance, check })
}

/// Mean free paths over the channels of a medium.
fn free_path(medium: &Medium) -> MeanFreePath {
    let paths = medium.properties.mean_free_path_mm();
    MeanFreePath { shortest_mm: paths.min_element(), longest_mm: paths.max_element() }
}

/// The line nobody can miss: the size against the lengths of the medium.
fn print_sizes(scene: &Scene, console: &Console) {
    if console.verbosity == Verbosity::Quiet {
        return;
    }
    let diagonal = scene.mesh.diagonal_mm();
    let triple = |v: DVec3| v.to_array().map(significant).join(" ");
    for medium in &scene.media {
        let (free, diffusion) = (medium.properties.mean_free_path_mm(), medium.properties.diffusion_length_mm());
        console.note(&format!(
            "SIZE {} mm across | {}: mean free path {} mm ({} %), diffusion length {} mm ({} %), RGB",
            significant(diagonal),
            medium.name,
            triple(free),
            triple(100.0 * free / diagonal),
            triple(diffusion),
            triple(100.0 * diffusion / diagonal),
        ));
    }
}

impl PlacementArgs {
    /// As they were typed.
    pub(super) fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        let mut option = |name: &str, value: String| words.extend([name.to_owned(), value]);
        if let Some(unit) = self.unit.and_then(|u| u.to_possible_value()) {
            option("--unit", unit.get_name().to_owned());
        }
        if let Some(mm) = self.size_mm {
            option("--size-mm", mm.to_string());
        }
        if let Some(mm) = self.height_mm {
            option("--height-mm", mm.to_string());
            option("--up", self.up.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned()));
        }
        if let Some(rule) = self.parts.to_possible_value() {
            option("--parts", rule.get_name().to_owned());
        }
        if !self.opaque.is_empty() {
            option("--opaque", self.opaque.join(","));
        }
        if !self.skip.is_empty() {
            option("--skip", self.skip.join(","));
        }
        words
    }

    fn scale(&self) -> Option<Scale> {
        let axis = match self.up {
            Up::Y => UpAxis::Y,
            Up::Z => UpAxis::Z,
        };
        match (self.unit, self.size_mm, self.height_mm) {
            (Some(unit), ..) => Some(Scale::MillimetresPerUnit(match unit {
                Unit::Mm => 1.0,
                Unit::Cm => 10.0,
                Unit::M => 1000.0,
            })),
            (_, Some(size), _) => Some(Scale::DiagonalMm(size)),
            (.., Some(height)) => Some(Scale::HeightMm(height, axis)),
            _ => None,
        }
    }
}

impl PartsChoice {
    fn rule(self) -> PartsRule {
        match self {
            Self::Auto => PartsRule::Auto,
            Self::Separate => PartsRule::Separate,
            Self::Joined => PartsRule::Joined,
        }
    }
}

/// A model's file and those that it refers to.
pub(super) fn files_of(model: &Path) -> Result<Vec<PathBuf>> {
    let mut files = vec![model.to_owned()];
    if matches!(super::output::suffix(model).as_str(), "gltf" | "glb") {
        files.extend(io::gltf::external_files(model)?);
    }
    Ok(files)
}

/// Files as reports and assets name them.
pub(super) fn hashed(files: impl IntoIterator<Item = PathBuf>) -> Result<Vec<Input>> {
    let hash = |path: PathBuf| match std::fs::read(&path) {
        Ok(bytes) => Ok(Input::of(&path, &bytes)),
        Err(e) => Err(Error::io(&path, &e)),
    };
    files.into_iter().map(hash).collect()
}

/// Reads a model by the suffix of its name.
pub(super) fn read_model(path: &Path) -> Result<SourceModel> {
    match super::output::suffix(path).as_str() {
        "obj" => io::obj::read_obj(path),
        "gltf" | "glb" => io::gltf::read_gltf(path),
        _ => Err(Error::unsupported(format!("{}: models are .obj, .gltf or .glb files", path.display()))),
    }
}
