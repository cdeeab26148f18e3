//! A model with its size, parts and media: the arguments that every command with a MODEL takes, and the import that
//! they ask for.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use glam::DVec3;

use super::console::Console;
use super::media::{MediumArgs, tell, tell_from_file, without_transport};
use crate::error::Result;
use crate::geometry::mesh::{Scale, UpAxis};
use crate::geometry::parts::PartsRule;
use crate::import::materials::MaterialChoice;
use crate::import::{FAULT_NOTE, ImportOptions, Imported, REFINED_NOTE, Source};
use crate::measure::between_vertices::too_coarse;
use crate::measure::refine::{Goal, Refine, refine};
use crate::medium::inversion::Reflector;
use crate::report::text::{percent, significant};
use crate::transport::calibration::any_is_closed;

/// A model and what it is made of.
#[derive(Clone, Debug, Args)]
pub(super) struct ModelArgs {
    /// OBJ, glTF or GLB file
    pub(super) model: PathBuf,
    #[command(flatten)]
    media: MediumArgs,
    #[command(flatten)]
    placement: PlacementArgs,
    /// Split long edges of translucent parts, without moving the surface, for methods whose light ends at the vertices: auto (until light
    /// that is linear between the vertices is 2 % off, where it is more than 5 % off), off, or the longest edge in mm. The vertices of
    /// the model keep their numbers, new ones follow; none is added unasked, since engines count on them
    #[arg(
        long,
        value_name = "auto|off|MM",
        default_value_t,
        allow_negative_numbers = true,
        help_heading = "Size and parts"
    )]
    refine: Refine,
}

/// Size, parts, roles.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Size and parts")]
pub(super) struct PlacementArgs {
    /// Length of one unit of the model
    #[arg(long, group = "scale")]
    unit: Option<Unit>,
    #[arg(long, group = "scale", value_name = "MM", allow_negative_numbers = true, help = format!(
        "Scale the model so that the diagonal of its bounding box is this long, in mm; an asset likewise, with lights where they are. {}",
        without_transport()))]
    pub(super) size_mm: Option<f64>,
    /// Scale the model so that it is this high, in mm
    #[arg(long, group = "scale", value_name = "MM", allow_negative_numbers = true)]
    height_mm: Option<f64>,
    /// Axis of the model that --height-mm measures along
    #[arg(long, default_value = "y")]
    up: UpAxis,
    /// Which components share their light inside
    #[arg(long, default_value = "auto", value_name = "RULE")]
    parts: PartsRule,
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

impl ModelArgs {
    /// What is asked of the model, the files apart; looks are inverted through `reflector`.
    pub(super) fn options(&self, reflector: Reflector) -> ImportOptions {
        self.placement.options(self.media.choice(reflector))
    }

    /// How the mesh is refined, as it is typed; none where it is not.
    pub(super) fn refined(&self) -> Option<String> {
        (self.refine != Refine::Off).then(|| format!("--refine {}", self.refine))
    }

    /// Reads the model and resolves its size, parts and media; prints warnings and notes on standard error.
    pub(super) fn load(&self, reflector: Reflector, console: &Console) -> Result<Imported> {
        let options = self.options(reflector);
        let source = Source::read(&self.model, &options.materials, console)?;
        import(source, &options, Some(self.refine), console).map_err(|e| e.in_file(&self.model))
    }
}

/// Makes a scene of a source, refined as asked for, and prints warnings and notes. Colours are inverted through dipoles where no part is
/// closed, which keep theirs. Without a word on refinement nobody is told how coarse the mesh is.
pub(super) fn import(
    mut source: Source,
    options: &ImportOptions,
    how: Option<Refine>,
    console: &Console,
) -> Result<Imported> {
    // Before the import, which may fail for what they tell.
    std::mem::take(&mut source.model.warnings).iter().for_each(|warning| console.warn(warning));
    let again = (options.materials.reflector == Reflector::Volume).then(|| source.clone());
    let mut imported = source.import(options, console)?;
    let has_looks = !(imported.looks.is_empty() && imported.from_file.is_empty());
    if let Some(source) = again.filter(|_| has_looks && !any_is_closed(imported.scene.domain())) {
        let materials = MaterialChoice { reflector: Reflector::default(), ..options.materials.clone() };
        imported = source.import(&ImportOptions { materials, ..options.clone() }, console)?;
    }
    if let Some(choice) = imported.origin.notes.last().filter(|_| imported.check.components > 1) {
        console.note(choice);
    }
    imported.check.faults().iter().for_each(|fault| console.fault(fault));
    imported.check.warnings().iter().for_each(|warning| console.warn(warning));
    if let Some(how) = how {
        refine_mesh(&mut imported, how, console)?;
    }
    imported.warnings.iter().for_each(|warning| console.warn(warning));
    tell_from_file(&imported.from_file, console);
    tell(&imported.looks, console);
    let diagonal = imported.scene.mesh.diagonal_mm();
    let triple = |v: DVec3| v.to_array().map(significant).join(" ");
    for medium in &imported.scene.media {
        let (name, across) = (&medium.name, significant(diagonal));
        let length = |mm: DVec3| format!("{} mm ({} %)", triple(mm), triple(100.0 * mm / diagonal));
        let free = length(medium.properties.mean_free_path_mm());
        let diffusion = length(medium.properties.diffusion_length_mm());
        console.note(&format!(
            "SIZE {across} mm across | {name}: mean free path {free}, diffusion length {diffusion}, RGB"
        ));
    }
    Ok(imported)
}

/// Refines the mesh, and tells of a mesh that is too coarse. An asset keeps both, so that whoever validates it knows; the last note of an
/// import tells how components became parts.
fn refine_mesh(imported: &mut Imported, how: Refine, console: &Console) -> Result<()> {
    let before = imported.scene.mesh.triangles.len();
    if let Some(refined) = refine(&imported.scene, how, console)? {
        let (after, edges) = (refined.scene.mesh.triangles.len(), significant(refined.longest_mm));
        let mut note = format!("{before} triangles became {after} by --refine {how}, with edges of at most {edges} mm");
        if let Some([before, after]) = refined.error {
            let [before, after] = [before.rms, after.rms].map(percent);
            note.push_str(&format!("; light between vertices is {after} off, where it was {before}"));
        }
        if refined.is_short() {
            note.push_str(&format!(", and not better with up to {} triangles", Goal::BAKED.most_triangles));
        }
        console.note(&format!("{REFINED_NOTE}{note}"));
        imported.origin.notes.insert(0, format!("{REFINED_NOTE}{note}"));
        imported.scene = refined.scene;
    }
    if let Some(error) = too_coarse(&imported.scene, None, console)? {
        let [rms, worst] = [error.rms, error.worst].map(percent);
        let finer = match how {
            Refine::Off => "bake with --refine auto",
            Refine::EdgesMm(_) => "bake with --refine auto or a shorter length",
            Refine::Auto => "no finer mesh within what --refine auto may make is much better; bake a finer model",
        };
        let what = format!(
            "what is drawn between vertices, linear over each triangle, is {rms} off at centroids and mid-edges (worst {worst}), under a \
             few probe lights"
        );
        console.fault(&format!(
            "{what}: {finer}, or with a method that gathers at run time (--method editable), whose pictures take the exitance at each pixel"
        ));
        // As assets of this revision of the algorithms have it, whose bytes stay.
        let kept = format!("{what}: refine the mesh, or render with --exitance pixels");
        imported.origin.notes.insert(0, format!("{FAULT_NOTE}{kept}"));
    }
    Ok(())
}

/// The word of a value.
fn name(value: impl ValueEnum) -> Option<String> {
    value.to_possible_value().map(|value| value.get_name().to_owned())
}

impl PlacementArgs {
    /// The first of the options that was typed and is of models alone; an asset has a size, which may be another.
    pub(super) fn given_of_model(&self) -> Option<&'static str> {
        let given = [
            ("--unit", self.unit.is_some()),
            ("--height-mm", self.height_mm.is_some()),
            ("--parts", self.parts != PartsRule::default()),
            ("--opaque", !self.opaque.is_empty()),
            ("--skip", !self.skip.is_empty()),
        ];
        given.into_iter().find(|(_, is_given)| *is_given).map(|(option, _)| option)
    }

    /// The options as they were typed.
    pub(super) fn words(&self) -> Vec<String> {
        let list = |names: &[String]| (!names.is_empty()).then(|| names.join(","));
        let given = [
            ("--unit", self.unit.and_then(name)),
            ("--size-mm", self.size_mm.map(|mm| mm.to_string())),
            ("--height-mm", self.height_mm.map(|mm| mm.to_string())),
            ("--up", self.height_mm.and_then(|_| name(self.up))),
            ("--parts", name(self.parts)),
            ("--opaque", list(&self.opaque)),
            ("--skip", list(&self.skip)),
        ];
        let given = given.into_iter().filter_map(|(option, value)| Some([option.to_owned(), value?]));
        given.flatten().collect()
    }

    /// The options as resolved.
    pub(super) fn options(&self, materials: MaterialChoice) -> ImportOptions {
        let unit = self.unit.map(|unit| match unit {
            Unit::Mm => 1.0,
            Unit::Cm => 10.0,
            Unit::M => 1000.0,
        });
        let size = self.size_mm.map(Scale::DiagonalMm);
        let height = self.height_mm.map(|height| Scale::HeightMm(height, self.up));
        ImportOptions {
            scale: unit.map(Scale::MillimetresPerUnit).or(size).or(height),
            materials,
            parts: self.parts,
            opaque: self.opaque.clone(),
            skip: self.skip.clone(),
        }
    }
}
