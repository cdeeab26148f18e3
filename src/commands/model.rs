//! A model with its size, parts and media: the arguments that every command with a MODEL takes, and what they resolve to.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;

use super::console::{Console, Verbosity, significant};
use crate::asset::{Asset, Input, Provenance};
use crate::error::{Error, Result};
use crate::evaluate::{BakeSettings, Method};
use crate::geometry::check::{self, MeanFreePath, MeshCheck};
use crate::geometry::mesh::{Mesh, Scale, UpAxis, material_indices, resolve_scale, skip_materials};
use crate::geometry::part_table::{PartEntry, PartTable};
use crate::geometry::parts::{Analysis, MaterialRoles, PartsRule};
use crate::geometry::source::SourceModel;
use crate::io;
use crate::medium::material::{Material, OpticalProperties, Overrides};
use crate::methods;
use crate::methods::settings::{resolve, share};
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

/// Optical properties.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Material")]
pub(super) struct MediumArgs {
    /// A measured material, a TOML file, or NAME=either for one material of the model; repeatable
    #[arg(long, value_name = "[NAME=]MATERIAL")]
    pub(super) material: Vec<String>,
    /// Scattering coefficient in 1/mm, unreduced: a number or R,G,B
    #[arg(long, value_name = "RGB", value_parser = rgb, allow_negative_numbers = true)]
    sigma_s: Option<DVec3>,
    /// Absorption coefficient in 1/mm: a number or R,G,B
    #[arg(long, value_name = "RGB", value_parser = rgb, allow_negative_numbers = true)]
    sigma_a: Option<DVec3>,
    /// Mean cosine of the phase function, -1 to 1; keeps the reduced scattering of a --material
    #[arg(long, allow_negative_numbers = true)]
    g: Option<f64>,
    /// Index of refraction, inside over outside
    #[arg(long, allow_negative_numbers = true)]
    eta: Option<f64>,
}

/// Size, parts, roles.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Size and parts")]
struct PlacementArgs {
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

/// What is baked and how.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Method")]
pub(super) struct BakeOptions {
    /// Surface samples (default: as many as the mean free path and the far field need)
    #[arg(long, value_name = "N")]
    samples: Option<usize>,
    /// Relative error to reach, such as 1% or 0.01
    #[arg(long, value_name = "E", default_value = "0.5%")]
    max_rms: String,
    /// A key of the method (see `translux methods`); repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl BakeOptions {
    /// All settings of a method.
    pub(super) fn resolve(&self, method: &dyn Method) -> Result<BakeSettings> {
        let pairs: Vec<(String, String)> = self
            .set
            .iter()
            .map(|text| match text.split_once('=') {
                Some((key, value)) if !key.is_empty() => Ok((key.to_owned(), value.to_owned())),
                _ => Err(Error::command_line(format!("--set {text}: key=value is needed"))),
            })
            .collect::<Result<_>>()?;
        if let Some(samples) = self.samples
            && !(1..=1 << 28).contains(&samples)
        {
            return Err(Error::command_line(format!("--samples {samples}: a number from 1 to 268435456 is needed")));
        }
        let max_rms = share(&self.max_rms, "--max-rms")?;
        Ok(BakeSettings { samples: self.samples, max_rms, values: resolve(method, &pairs)? })
    }
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
        let mut files = vec![self.model.clone()];
        if matches!(super::output::suffix(&self.model).as_str(), "gltf" | "glb") {
            files.extend(io::gltf::external_files(&self.model)?);
        }
        files.extend(self.media.files());
        let hash =
            |path: &PathBuf| std::fs::read(path).map(|bytes| Input::of(path, &bytes)).map_err(|e| Error::io(path, &e));
        let inputs = files.iter().map(hash).collect::<Result<_>>()?;
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

/// Media of a model and who has which.
struct ResolvedMedia {
    media: Vec<Medium>,
    by_name: Vec<(String, u32)>,
    rest: u32,
}

impl MediumArgs {
    fn overrides(&self) -> Overrides {
        Overrides {
            sigma_s_per_mm: self.sigma_s,
            sigma_a_per_mm: self.sigma_a,
            g: self.g,
            eta_inside_over_outside: self.eta,
            ..Overrides::default()
        }
    }

    /// Material files among the arguments.
    fn files(&self) -> impl Iterator<Item = PathBuf> {
        let texts = self.material.iter().map(|text| text.split_once('=').map_or(text.as_str(), |(_, text)| text));
        texts.map(PathBuf::from).filter(|path| super::output::suffix(path) == "toml")
    }

    /// A medium with what these arguments say in place of its own.
    fn changed(&self, medium: &Medium) -> Result<Medium> {
        let base = Material { name: medium.name.clone(), properties: medium.properties };
        let material = Material::from_flags(Some(base), &self.overrides())?;
        Ok(Medium { name: material.name, properties: material.properties })
    }

    /// The plain material of these arguments, if any.
    pub(super) fn plain(&self) -> Result<Option<Medium>> {
        let plain: Vec<&String> = self.material.iter().filter(|m| !m.contains('=')).collect();
        if let [_, second, ..] = plain[..] {
            return Err(Error::command_line(format!(
                "--material {second}: a second one without NAME=; only one material can be the rest's"
            )));
        }
        let base = plain.first().map(|text| Material::from_argument(text)).transpose()?;
        let overrides = self.overrides();
        if base.is_none() && overrides.is_empty() {
            return Ok(None);
        }
        let material = Material::from_flags(base, &overrides)?;
        Ok(Some(Medium { name: material.name, properties: material.properties }))
    }

    /// Materials given by name.
    pub(super) fn named(&self) -> Result<Vec<(String, Medium)>> {
        self.material
            .iter()
            .filter_map(|text| text.split_once('='))
            .map(|(name, text)| {
                let material = Material::from_argument(text)?;
                Ok((name.to_owned(), Medium { name: material.name, properties: material.properties }))
            })
            .collect()
    }

    /// Media for a model with these materials, of which `translucent` need one.
    fn resolve(&self, materials: &[String], translucent: &[&str]) -> Result<ResolvedMedia> {
        let mut media = Vec::new();
        let mut index_of = |medium: Medium| {
            let known = media.iter().position(|m| *m == medium).unwrap_or_else(|| {
                media.push(medium);
                media.len() - 1
            });
            known as u32
        };
        let plain = self.plain()?;
        let rest = plain.map(&mut index_of);
        let by_name: Vec<(String, u32)> =
            self.named()?.into_iter().map(|(name, medium)| (name, index_of(medium))).collect();
        let Some(rest) = rest.or_else(|| by_name.first().map(|(_, index)| *index)) else {
            return Err(Error::command_line(
                "what is it made of? say for example --material marble (see `translux materials`), or --sigma-s and --sigma-a",
            ));
        };
        let named: Vec<String> = by_name.iter().map(|(name, _)| name.clone()).collect();
        material_indices(materials, &named, "--material")?;
        if self.plain()?.is_none() {
            let left: Vec<&str> = translucent.iter().copied().filter(|m| !named.iter().any(|n| n == m)).collect();
            if !left.is_empty() {
                let left = left.join(", ");
                return Err(Error::command_line(format!(
                    "no material for {left}: add a plain --material for the rest, or --opaque or --skip them"
                )));
            }
        }
        Ok(ResolvedMedia { media, by_name, rest })
    }
}

/// Bakes a loaded model; the memory is checked before.
pub(super) fn bake(method: &dyn Method, loaded: Loaded, settings: &BakeSettings, console: &Console) -> Result<Asset> {
    let Loaded { scene, provenance, .. } = loaded;
    let needed = method.bake_memory(&scene, settings);
    let advice = match largest_fit(method, &scene, settings, console.max_memory) {
        Some(fitting) => format!("--samples {fitting} would fit, or raise --max-memory"),
        None => "no number of samples would fit, raise --max-memory".to_owned(),
    };
    console.check_memory(needed, &advice)?;
    methods::bake(method, scene, settings, provenance, console)
}

/// The largest number of samples that the memory limit allows, as a power of two.
fn largest_fit(method: &dyn Method, scene: &Scene, settings: &BakeSettings, limit: u64) -> Option<usize> {
    let mut trial = settings.clone();
    (0..28).rev().map(|power| 1usize << power).find(|&samples| {
        trial.samples = Some(samples);
        method.bake_memory(scene, &trial) <= limit
    })
}

/// Replaces the media of a scene by `--material` and its companions; `None` where they say nothing.
pub(super) fn edited_media(arguments: &MediumArgs, scene: &Scene) -> Result<Option<Vec<Medium>>> {
    if arguments.material.is_empty() && !arguments.overrides().is_empty() {
        return scene.media.iter().map(|m| arguments.changed(m)).collect::<Result<_>>().map(Some);
    }
    let (plain, named) = (arguments.plain()?, arguments.named()?);
    if plain.is_none() && named.is_empty() {
        return Ok(None);
    }
    let mut media = scene.media.clone();
    if let Some(plain) = plain {
        media.fill(plain);
    }
    for (name, medium) in named {
        let Some(index) = medium_named(scene, &name)? else {
            let mut known: Vec<&str> = scene.parts.parts.iter().map(|p| p.name.as_str()).collect();
            known.extend(scene.media.iter().map(|m| m.name.as_str()));
            let known = known.join(", ");
            return Err(Error::command_line(format!(
                "--material {name}=...: no such part or medium; there are {known}"
            )));
        };
        media[index] = medium;
    }
    Ok(Some(media))
}

/// The medium of a part of that name, or the medium itself.
///
/// Parts of equal material have one medium: to edit it through one of them would change the others in silence.
fn medium_named(scene: &Scene, name: &str) -> Result<Option<usize>> {
    let parts = &scene.parts.parts;
    let Some(medium) = parts.iter().find(|p| p.name == name).and_then(|p| p.medium) else {
        return Ok(scene.media.iter().position(|m| m.name == name));
    };
    let sharing = |p: &&PartEntry| p.medium == Some(medium) && p.name != name;
    let others: Vec<&str> = parts.iter().filter(sharing).map(|p| p.name.as_str()).collect();
    match scene.media.get(medium as usize) {
        Some(shared) if !others.is_empty() => {
            let (others, shared) = (others.join(", "), &shared.name);
            Err(Error::command_line(format!(
                "--material {name}=...: {name} and {others} are one medium; edit all of them by --material {shared}=..., \
                 or bake them with different materials"
            )))
        }
        _ => Ok(Some(medium as usize)),
    }
}

/// Reads a model by the suffix of its name.
pub(super) fn read_model(path: &Path) -> Result<SourceModel> {
    match super::output::suffix(path).as_str() {
        "obj" => io::obj::read_obj(path),
        "gltf" | "glb" => io::gltf::read_gltf(path),
        _ => Err(Error::unsupported(format!("{}: models are .obj, .gltf or .glb files", path.display()))),
    }
}

/// A number, or three separated by commas.
fn rgb(text: &str) -> std::result::Result<DVec3, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().map_err(|_| format!("`{part}` is not a number")))
        .collect::<std::result::Result<_, _>>()?;
    match numbers[..] {
        [v] => Ok(DVec3::splat(v)),
        [r, g, b] => Ok(DVec3::new(r, g, b)),
        _ => Err("one number or three separated by commas are needed".to_owned()),
    }
}

/// Optical properties as a report shows them.
#[derive(serde::Serialize)]
pub(super) struct MediumReport {
    name: String,
    #[serde(flatten)]
    properties: OpticalProperties,
    mean_free_path_mm: [f64; 3],
    /// Null where nothing absorbs.
    diffusion_length_mm: [Option<f64>; 3],
}

impl MediumReport {
    pub(super) fn of(medium: &Medium) -> Self {
        let finite = |v: f64| v.is_finite().then_some(v);
        Self {
            name: medium.name.clone(),
            properties: medium.properties,
            mean_free_path_mm: medium.properties.mean_free_path_mm().to_array(),
            diffusion_length_mm: medium.properties.diffusion_length_mm().to_array().map(finite),
        }
    }
}
