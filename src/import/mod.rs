//! From files to a scene: a source file with its unit, its parts and the media of its materials, and a record of its
//! origin.
//!
//! ```no_run
//! use std::path::Path;
//! use translux::geometry::mesh::Scale;
//! use translux::import::{self, ImportOptions, materials::MaterialChoice};
//! use translux::progress::Silent;
//!
//! # fn main() -> translux::error::Result<()> {
//! let options = ImportOptions {
//!     scale: Some(Scale::DiagonalMm(30.0)),
//!     materials: MaterialChoice::plain("marble"),
//!     ..ImportOptions::default()
//! };
//! let imported = import::load(Path::new("bunny.obj"), &options, &Silent)?;
//! println!("{} parts", imported.scene.parts.parts.len());
//! # Ok(())
//! # }
//! ```

pub mod file;
pub mod materials;
pub mod of_file;
pub mod poses;
mod size;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use self::file::{Input, files_of, read_model};
use self::materials::{AskedLook, MaterialChoice, ModelMedia};
use self::of_file::{FromFile, OfFile};
use crate::error::{Error, Result};
use crate::geometry::check::{self, MeanFreePath, MeshCheck};
use crate::geometry::mesh::{Mesh, Scale, diagonal_in_units, resolve_scale, skip_materials};
use crate::geometry::part_table::PartTable;
use crate::geometry::parts::{Analysis, MaterialRoles, Part, PartsRule};
use crate::geometry::source::SourceModel;
use crate::medium::material::Medium;
use crate::progress::{Progress, stage};
use crate::scene::Scene;

/// What notes begin with that tell of something for which results are wrong or poor.
pub const FAULT_NOTE: &str = "fault: ";

/// What the note of a mesh begins with that was refined after it was read.
pub const REFINED_NOTE: &str = "refined: ";

/// Unit, media, parts and roles that turn a source into a scene.
#[derive(Clone, Debug, Default)]
pub struct ImportOptions {
    /// Unit or size; without one the unit of the file, which an OBJ file does not have.
    pub scale: Option<Scale>,
    /// Media of the source's materials.
    pub materials: MaterialChoice,
    /// Rule that decides which components share their light inside.
    pub parts: PartsRule,
    /// Materials of the source that only cast shadows.
    pub opaque: Vec<String>,
    /// Materials of the source that are left out.
    pub skip: Vec<String>,
}

/// A source in memory, and the files that it was read from.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Polygons in the unit of the source, cut to triangles.
    pub model: SourceModel,
    /// The model's file, the files that it refers to and those of materials; none for a model made in memory.
    pub inputs: Vec<Input>,
}

/// The record of a scene's origin, independent of time and place.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Origin {
    /// Files that the scene was made from.
    pub inputs: Vec<Input>,
    /// Source of the unit, in words.
    pub source_unit: String,
    /// Millimetres in one source unit.
    pub mm_per_source_unit: f64,
    /// Repairs and choices that affect the result; the last one tells how components became parts.
    pub notes: Vec<String>,
}

impl Origin {
    /// Whether the mesh has more vertices than its source, which come after those of the source.
    pub fn is_refined(&self) -> bool {
        self.notes.iter().any(|note| note.starts_with(REFINED_NOTE))
    }
}

impl Default for Origin {
    fn default() -> Self {
        Self { inputs: Vec::new(), source_unit: "mm".to_owned(), mm_per_source_unit: 1.0, notes: Vec::new() }
    }
}

/// A scene, its origin and the checks of its mesh.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Mesh, parts and media.
    pub scene: Scene,
    /// Files, unit and repairs.
    pub origin: Origin,
    /// Check of the mesh against the lengths of its media.
    pub check: MeshCheck,
    /// Oddities of the files, one line each; those of the mesh are [`MeshCheck::faults`] and [`MeshCheck::warnings`].
    pub warnings: Vec<String>,
    /// Looks that were asked for, and the media that have them or come nearest.
    pub looks: Vec<AskedLook>,
    /// Materials of which only the file speaks, and what became of them.
    pub from_file: Vec<FromFile>,
}

/// Reads a model and makes a scene of it.
///
/// # Errors
/// Errors of [`Source::read`] and [`Source::import`]; the message starts with the path.
pub fn load(path: &Path, options: &ImportOptions, progress: &dyn Progress) -> Result<Imported> {
    Source::read(path, &options.materials, progress)?.import(options, progress).map_err(|e| e.in_file(path))
}

/// Reads another mesh in a known unit, such as a coarser level of detail of a scene's object. Returns it with the
/// warnings of the file and the repairs, one line each.
///
/// # Errors
/// As [`read_model`], and a mesh without area.
pub fn load_mesh(path: &Path, mm_per_unit: f64, progress: &dyn Progress) -> Result<(Mesh, [Vec<String>; 2])> {
    let mut model = stage(progress, "import", || read_model(path))?;
    let warnings = std::mem::take(&mut model.warnings);
    let mesh = resolve_scale(&model, Some(Scale::MillimetresPerUnit(mm_per_unit)))
        .and_then(|placement| Mesh::from_source(model, &placement));
    let (mesh, repairs) = mesh.map_err(|e| e.in_file(path))?;
    Ok((mesh, [warnings, repairs.lines()]))
}

/// Every file that a scene depends on: the model, what it refers to, material files.
///
/// # Errors
/// A glTF file that cannot be read.
pub fn dependencies(model: &Path, materials: &MaterialChoice) -> Result<Vec<PathBuf>> {
    Ok(files_of(model)?.into_iter().chain(materials.files()).collect())
}

impl Source {
    /// Reads a model by the suffix of its name (.obj, .gltf, .glb), and hashes every file that the scene depends on.
    ///
    /// # Errors
    /// I/O, an invalid or unsupported file; the message starts with its path.
    pub fn read(path: &Path, materials: &MaterialChoice, progress: &dyn Progress) -> Result<Self> {
        let model = stage(progress, "import", || read_model(path)).map_err(|e| e.of_file(path))?;
        let files = dependencies(path, materials)?;
        let inputs = files.iter().map(|file| Input::read(file)).collect::<Result<_>>()?;
        Ok(Self { model, inputs })
    }

    /// Resolves unit, parts and media, repairs the mesh and checks it.
    ///
    /// # Errors
    /// No unit or no material, names that the model does not have, a mesh without area, opaque parts only.
    pub fn import(self, options: &ImportOptions, progress: &dyn Progress) -> Result<Imported> {
        let Self { mut model, inputs } = self;
        let mut warnings = std::mem::take(&mut model.warnings);
        skip_materials(&mut model, &options.skip)?;
        // What is wrong with the materials is told before what is wrong with the size.
        let placement = resolve_scale(&model, options.scale);
        let media = {
            let mm_per_unit = placement.as_ref().map_or(1.0, |placement| placement.mm_per_unit);
            let diagonal_mm = diagonal_in_units(&model).unwrap_or(1.0) * mm_per_unit;
            let file = OfFile { materials: &model.materials, insides: &model.insides, mm_per_unit, diagonal_mm };
            options.materials.of_model(&model.materials, &translucent(&model, &options.opaque), &file)?
        };
        let ModelMedia { media, by_name, rest, looks, from_file } = media;
        let without_medium = from_file.iter().filter(|material| material.chosen.is_none());
        let opaque: Vec<String> =
            options.opaque.iter().chain(without_medium.map(|material| &material.name)).cloned().collect();
        let roles = MaterialRoles::resolve(&model.materials, &by_name, rest, &opaque)?;
        let placement = placement?;
        for FromFile { name, warnings: odd, .. } in &from_file {
            warnings.extend(odd.iter().map(|odd| format!("material '{name}': {odd}")));
        }
        let (scene, check, notes) = stage(progress, "mesh", || -> Result<_> {
            let (mut mesh, mut repairs) = Mesh::from_source(model, &placement)?;
            let analysis = Analysis::new(&mut mesh, &roles, options.parts, &mut repairs);
            let free_paths: Vec<MeanFreePath> = media.iter().map(free_path).collect();
            let check = check::check(&mesh, &analysis, &repairs, Some(&free_paths));
            let mut notes: Vec<String> = from_file.iter().map(FromFile::note).collect();
            notes.extend(repairs.lines());
            notes.extend(analysis.parts.parts.iter().filter_map(Part::turned));
            notes.extend(check.faults().into_iter().map(|fault| format!("{FAULT_NOTE}{fault}")));
            notes.push(analysis.parts.description());
            let parts = PartTable::of(&mesh, &analysis.parts);
            Ok((Scene { mesh, parts, media }, check, notes))
        })?;
        if !scene.parts.parts.iter().any(|p| p.transfers()) {
            return Err(Error::input("every part is opaque: nothing scatters light"));
        }
        let of_file: Vec<&str> = from_file.iter().filter(|m| m.chosen.is_some()).map(|m| m.name.as_str()).collect();
        warnings.extend(size::doubts(&scene, &check, (options.scale, placement.mm_per_unit), &of_file));
        let source_unit = match options.scale {
            Some(Scale::MillimetresPerUnit(mm)) => format!("--unit, {mm} mm"),
            Some(Scale::DiagonalMm(mm)) => format!("--size-mm {mm}"),
            Some(Scale::HeightMm(mm, axis)) => format!("--height-mm {mm} along {axis:?}"),
            None => "the file's".to_owned(),
        };
        let origin = Origin { inputs, source_unit, mm_per_source_unit: placement.mm_per_unit, notes };
        Ok(Imported { scene, origin, check, warnings, looks, from_file })
    }
}

/// Names of the materials that triangles have, without the opaque ones.
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

/// Range of the mean free path over the channels of a medium.
fn free_path(medium: &Medium) -> MeanFreePath {
    let paths = medium.properties.mean_free_path_mm();
    MeanFreePath { shortest_mm: paths.min_element(), longest_mm: paths.max_element() }
}
