//! `translux export A.tlux --as sh2 -o M.glb`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde_json::Value;

use super::console::{Console, in_range};
use super::light_map::{LightMap, SIDE, check_side};
use super::lights::{LightArgs, ResolvedLights, warn_of_places};
use super::opening::{AssetArgs, Opened};
use super::output;
use super::page::PageArgs;
use crate::asset::Provenance;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::summed::Summed;
use crate::evaluate::{Evaluator, SingleScattering};
use crate::export::basis::{Basis, Edit, FACTORS};
use crate::export::colours::{Exposed, vertex_colours};
use crate::export::harmonics::{Flattening, Order, Transfer, of_light};
use crate::export::{VertexData, fresh, onto};
use crate::import::file::{Input, read_model, suffix};
use crate::io::gltf::PlacedMesh;
use crate::io::gltf::written::Document;
use crate::render::film::Exposure;
use crate::report::export::{BasisReport, ExportReport, ExposureReport};
use crate::report::radiosity_ply::check_range;
use crate::report::text::significant;
use crate::scene::Scene;

/// Largest factors of edits where nothing else is asked for.
const ABSORPTION: f64 = 4.0;
const LARGER: f64 = 2.0;

/// Distance of vertices of a file from those of the asset, over the diagonal, beyond which it is another model.
const SAME_PLACE: f64 = 1e-4;

#[derive(Clone, Debug, Args)]
pub(super) struct ExportArgs {
    #[command(flatten)]
    asset: AssetArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// What engines get; without it, -o FILE.html is a page
    #[arg(long = "as", value_name = "WHAT")]
    kind: Option<Kind>,
    /// glTF file that the asset was made of: what is exported is added to its meshes, and all else in it stays. Without it a
    /// file is made of the asset's own mesh
    #[arg(long, value_name = "MODEL")]
    scene: Option<PathBuf>,
    /// Brightness of colours that end at 1: auto (the 99.5th percentile of the object becomes white) or stops
    #[arg(long, value_name = "auto|EV", allow_hyphen_values = true)]
    exposure: Option<Exposure>,
    #[arg(long, value_name = "N", help = format!("Texels of a side of the light map [default: {SIDE}]"))]
    resolution: Option<u32>,
    #[arg(long, value_name = "F", help = format!("Largest factor of the absorption that --as basis knows; its inverse is the least [default: {ABSORPTION}]"))]
    absorption_range: Option<f64>,
    #[arg(long, value_name = "F", help = format!("The same for the size, 1 for that of the asset alone [default: {LARGER}]"))]
    size_range: Option<f64>,
    /// Which attributes of vertices: those named in docs/export.md, or those that an engine's importer takes
    #[arg(long, default_value = "any")]
    engine: Engine,
    #[command(flatten)]
    page: PageArgs,
    /// GLB to write, a page (.html), with --as lightmap OpenEXR (radiosity) and PNG (exposed), with --as basis its table as JSON; `-` for a GLB on standard output; repeatable
    #[arg(short, long, required = true, value_name = "FILE")]
    output: Vec<PathBuf>,
}

/// What engines get.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Radiosity under the lights: COLOR_0, exposed, and _TLX_E
    VertexColors,
    /// Radiosity under the lights in a texture
    Lightmap,
    /// Transfer for any distant light: harmonics of the bands 0 and 1, 12 floats a vertex
    Sh1,
    /// The same with band 2, 27 floats a vertex
    Sh2,
    /// Functions of the vertex whose weights follow any distant light, the absorption and the size
    Basis,
    /// A page for browsers in one file, with a light that turns
    Page,
}

impl Kind {
    fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }

    fn order(self) -> Option<Order> {
        match self {
            Self::VertexColors | Self::Lightmap | Self::Page => None,
            Self::Sh1 => Some(Order::One),
            Self::Sh2 | Self::Basis => Some(Order::Two),
        }
    }
}

/// Whose importer the attributes are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Engine {
    /// Attributes by name, as three.js and Bevy read them
    Any,
    /// Texture coordinates 2 to 7, which Godot reads as CUSTOM0 to CUSTOM2
    Godot,
}

/// What was computed, before it is put into files.
struct Exported {
    data: Option<VertexData>,
    exposed: Option<Exposed>,
    map: Option<LightMap>,
    flattening: Option<Flattening>,
    edits: Option<Edited>,
}

/// What serves edits, beside the attributes.
struct Edited {
    table: Value,
    report: BasisReport,
}

pub(super) fn run(args: &ExportArgs, console: &Console) -> Result<ExitCode> {
    args.check(console)?;
    let lights = args.lights.load(console)?;
    let order = args.kind().order();
    let coefficients = order.map(|_| coefficients(&lights)).transpose()?;
    let file = args.scene.as_deref().map(Document::read).transpose()?;
    let Opened { provenance, evaluator } = args.asset.open(console)?;
    let same = |path: &PathBuf| same_model(path, &provenance, evaluator.scene());
    let input = args.scene.as_ref().map(same).transpose()?;
    if matches!(evaluator.single_scattering_is(), SingleScattering::TowardsEye | SingleScattering::TracedTowardsEye) {
        console.note("single scattering depends on the eye here (g is not 0): it is in pictures, and not in this file");
    }
    let mut evaluator = Summed::of(evaluator);
    if args.kind() == Kind::Page {
        return args.write_page(evaluator.as_mut(), &provenance, lights, console);
    }
    warn_of_places(evaluator.scene(), &lights.lights, evaluator.cost().samples, console);
    let mut exported = match (order, coefficients) {
        (Some(_), Some(coefficients)) if args.kind() == Kind::Basis => {
            args.basis(evaluator.as_mut(), &lights, &coefficients, console)?
        }
        (Some(order), Some(coefficients)) => harmonics(evaluator.as_mut(), order, &lights, &coefficients, console)?,
        _ if args.kind() == Kind::Lightmap => args.lightmap(evaluator.as_mut(), &lights, console)?,
        _ => args.vertex_colours(evaluator.as_mut(), &lights, console)?,
    };
    if args.engine == Engine::Godot {
        exported.data = exported.data.map(|data| data.for_godot()).transpose()?;
    }
    let scene = evaluator.scene();
    let mut report = args.report(&exported, &provenance, lights, scene);
    report.inputs.extend(input);
    report.cost = evaluator.cost();
    report.glb_bytes = args.write(&exported, file, (scene, &provenance), &report, console)?;
    explain(&report, args, &provenance, console);
    console.report("export", &report)
}

impl ExportArgs {
    /// Refuses what does not go together, before any work.
    fn check(&self, console: &Console) -> Result<()> {
        let is_map = self.kind() == Kind::Lightmap;
        let suffixes: &[&str] = match self.kind() {
            Kind::Lightmap => &["glb", "exr", "png"],
            Kind::Page => &["html"],
            Kind::Basis => &["glb", "json"],
            Kind::VertexColors | Kind::Sh1 | Kind::Sh2 => &["glb"],
        };
        if self.kind.is_none() && self.kind() != Kind::Page {
            let kinds: Vec<String> = Kind::value_variants().iter().map(|kind| kind.name()).collect();
            return Err(Error::command_line(format!("--as: say what is wanted, one of {}", kinds.join(", "))));
        }
        output::check(&self.output, suffixes, console)?;
        self.page.check(self.kind() == Kind::Page)?;
        let misplaced = |option: &str, belongs: &str| {
            Err(Error::command_line(format!("{option}: is of --as {belongs}, not of {}", self.kind().name())))
        };
        match self {
            Self { exposure: Some(_), .. } if self.kind().order().is_some() => {
                misplaced("--exposure", "vertex-colors, lightmap and page")
            }
            Self { resolution: Some(_), .. } if !is_map => misplaced("--resolution", "lightmap"),
            Self { engine: Engine::Godot, .. } if self.kind() == Kind::Page => {
                misplaced("--engine", "vertex-colors and sh1")
            }
            Self { absorption_range: Some(_), .. } if self.kind() != Kind::Basis => {
                misplaced("--absorption-range", "basis")
            }
            Self { size_range: Some(_), .. } if self.kind() != Kind::Basis => misplaced("--size-range", "basis"),
            Self { engine: Engine::Godot, kind: Some(Kind::Basis), .. } => Err(Error::unsupported(
                "--engine godot: basis has more than the 12 floats that Godot takes from a glTF file: --as sh1 has 12",
            )),
            Self { scene: Some(_), .. } if self.kind() == Kind::Page => {
                misplaced("--scene", "the kinds that write a GLB")
            }
            Self { engine: Engine::Godot, .. } if is_map => misplaced("--engine", "vertex-colors and sh1"),
            Self { engine: Engine::Godot, kind: Some(Kind::Sh2), .. } => Err(Error::unsupported(
                "--engine godot: the 27 floats of sh2 do not fit the 12 that Godot takes from a glTF file: --as sh1 has 12",
            )),
            Self { scene: Some(path), .. } if !self.output.iter().any(|path| is_glb(path)) => {
                let message = format!("--scene {}: no -o is a GLB, to which something could be added", path.display());
                Err(Error::command_line(message))
            }
            _ => Ok(()),
        }?;
        let most = self.most();
        in_range("--absorption-range", most[0], FACTORS)?;
        in_range("--size-range", most[1], FACTORS)?;
        if !is_map {
            return Ok(());
        }
        check_side("--resolution", self.side(), console)
    }

    /// What was asked for, or follows from the names of the files.
    fn kind(&self) -> Kind {
        let of_names =
            if self.output.iter().all(|path| suffix(path) == "html") { Kind::Page } else { Kind::VertexColors };
        self.kind.unwrap_or(of_names)
    }

    /// The largest factors of absorption and size.
    fn most(&self) -> [f64; 2] {
        [self.absorption_range.unwrap_or(ABSORPTION), self.size_range.unwrap_or(LARGER)]
    }

    fn side(&self) -> u32 {
        self.resolution.unwrap_or(SIDE)
    }

    fn write_page(
        &self,
        evaluator: &mut dyn Evaluator,
        provenance: &Provenance,
        lights: ResolvedLights,
        console: &Console,
    ) -> Result<ExitCode> {
        let (asset, exposure) = (self.asset.asset.as_path(), self.exposure.unwrap_or_default());
        let (bytes, page) = self.page.make(
            evaluator,
            (asset, provenance),
            (&lights, self.lights.light.is_empty()),
            exposure,
            console,
        )?;
        let nothing = Exported { data: None, exposed: None, map: None, flattening: None, edits: None };
        let mut report = self.report(&nothing, provenance, lights, evaluator.scene());
        report.cost = evaluator.cost();
        report.page = Some(page);
        output::write(&self.output, console, || Ok(bytes))?;
        report.lines().iter().for_each(|line| console.note(line));
        console.report("export", &report)
    }

    fn exposed(&self, radiosity: &[DVec3], weights: &[f64]) -> Exposed {
        Exposed::new(self.exposure.unwrap_or_default(), radiosity, weights)
    }

    fn vertex_colours(
        &self,
        evaluator: &mut dyn Evaluator,
        lights: &ResolvedLights,
        console: &Console,
    ) -> Result<Exported> {
        evaluator.set_lights(lights.lights.clone(), console)?;
        let radiosity = evaluator.radiosity(console)?;
        check_range("radiosity", &radiosity)?;
        let exposed = self.exposed(&radiosity, &evaluator.scene().vertex_areas_mm2());
        let data = Some(vertex_colours(&radiosity, &exposed));
        Ok(Exported { data, exposed: Some(exposed), map: None, flattening: None, edits: None })
    }

    fn basis(
        &self,
        evaluator: &mut dyn Evaluator,
        lights: &ResolvedLights,
        coefficients: &[DVec3; 9],
        console: &Console,
    ) -> Result<Exported> {
        let (vertices, samples) = (evaluator.scene().mesh.local_mm.len(), evaluator.cost().samples);
        let media = evaluator.scene().media.len();
        console.check_memory(Basis::memory(vertices, samples, media), "raise --max-memory")?;
        let basis = Basis::new(evaluator, self.most(), console)?;
        let errors = basis.errors(evaluator, self.most(), console)?;
        evaluator.set_lights(lights.lights.clone(), console)?;
        let asset = evaluator.radiosity(console)?;
        let unedited = basis.weights(&Edit { absorption: DVec3::ONE, size: 1.0 }, coefficients);
        let areas = evaluator.scene().vertex_areas_mm2();
        let flattening = Flattening::new(&basis.radiosity(&unedited), &asset, &areas)?;
        let [absorption, size] = basis.points().clone();
        let report = BasisReport { functions: basis.functions(), absorption, size, errors };
        let edits = Some(Edited { table: basis.table(), report });
        let data = Some(basis.into_data());
        Ok(Exported { data, exposed: None, map: None, flattening: Some(flattening), edits })
    }

    fn lightmap(&self, evaluator: &mut dyn Evaluator, lights: &ResolvedLights, console: &Console) -> Result<Exported> {
        evaluator.set_lights(lights.lights.clone(), console)?;
        let lit = LightMap::new(evaluator, self.side(), console)?;
        let exposed = self.exposed(&lit.map.texels, &lit.map.covered);
        Ok(Exported { data: None, exposed: Some(exposed), map: Some(lit), flattening: None, edits: None })
    }

    fn report(
        &self,
        exported: &Exported,
        provenance: &Provenance,
        lights: ResolvedLights,
        scene: &Scene,
    ) -> ExportReport {
        let lightmap = exported.map.as_ref().map(LightMap::report);
        let exposure = exported.exposed.map(|exposed| ExposureReport {
            asked: self.exposure.unwrap_or_default().to_string(),
            factor: exposed.factor,
            clamped_share: exposed.clamped_share,
        });
        ExportReport {
            method: provenance.method.clone(),
            kind: self.kind().name(),
            materials: scene.media.iter().map(|medium| medium.name.clone()).collect(),
            lights: lights.text,
            inputs: lights.inputs,
            outputs: self.output.clone(),
            vertices: scene.mesh.local_mm.len(),
            attributes: exported.data.iter().flat_map(|data| &data.columns).map(|column| column.name.clone()).collect(),
            glb_bytes: None,
            mm_per_metre: if self.scene.is_some() { provenance.origin.mm_per_source_unit } else { 1000.0 },
            exposure,
            lightmap,
            flattening: exported.flattening,
            basis: exported.edits.as_ref().map(|edited| edited.report.clone()),
            page: None,
            cost: crate::evaluate::Cost::default(),
        }
    }

    /// Writes the files; returns the bytes of the GLB where there is one.
    fn write(
        &self,
        exported: &Exported,
        file: Option<(Document, Vec<PlacedMesh>)>,
        (scene, provenance): (&Scene, &Provenance),
        report: &ExportReport,
        console: &Console,
    ) -> Result<Option<usize>> {
        let of = |wanted: &str| -> Vec<&PathBuf> {
            let is = |path: &&PathBuf| if wanted == "glb" { is_glb(path) } else { suffix(path) == wanted };
            self.output.iter().filter(is).collect()
        };
        let (map, exposed) = (exported.map.as_ref().map(|lit| &lit.map), exported.exposed.unwrap_or_default());
        let png = map.map(|map| map.to_png(&exposed)).transpose()?;
        if let (Some(map), Some(png)) = (map, &png) {
            output::write(&of("exr"), console, || map.to_exr(report.attributes()))?;
            output::write(&of("png"), console, || Ok(png.clone()))?;
        }
        let table = exported.edits.as_ref().map(|edited| &edited.table);
        if let Some(table) = table {
            output::write(&of("json"), console, || Ok(format!("{table}\n").into_bytes()))?;
        }
        let glb = of("glb");
        let mut length = None;
        output::write(&glb, console, || {
            let extras = report.extras();
            let content = fresh::Content {
                data: exported.data.as_ref(),
                map: exported.map.as_ref().zip(png.as_deref()).map(|(lit, png)| (&lit.placed, png)),
                is_lit: self.kind().order().is_none(),
                extras: Some(&extras),
                table,
            };
            let document = match (file, &self.scene) {
                (Some((document, placed)), Some(path)) => {
                    onto::add(document, &placed, scene, &content).map_err(|e| e.in_file(path))?
                }
                _ => fresh::document(scene, &name_of(provenance), &content)?,
            };
            let bytes = document.to_glb()?;
            length = Some(bytes.len());
            Ok(bytes)
        })?;
        Ok(length)
    }
}

/// Whether an output is a GLB: standard output is.
fn is_glb(path: &Path) -> bool {
    suffix(path) == "glb" || path == Path::new("-")
}

/// The sum of the lights as coefficients.
fn coefficients(lights: &ResolvedLights) -> Result<[DVec3; 9]> {
    let mut sums = [DVec3::ZERO; 9];
    for (light, text) in lights.lights.iter().zip(&lights.text) {
        let of = of_light(light).map_err(|e| e.at(format!("--light {text}")))?;
        sums.iter_mut().zip(of).for_each(|(sum, value)| *sum += value);
    }
    Ok(sums)
}

fn harmonics(
    evaluator: &mut dyn Evaluator,
    order: Order,
    lights: &ResolvedLights,
    coefficients: &[DVec3; 9],
    console: &Console,
) -> Result<Exported> {
    let transfer = Transfer::new(evaluator, order, console)?;
    evaluator.set_lights(lights.lights.clone(), console)?;
    let asset = evaluator.radiosity(console)?;
    let areas = evaluator.scene().vertex_areas_mm2();
    let flattening = Flattening::new(&transfer.radiosity(coefficients), &asset, &areas)?;
    let data = Some(transfer.into_data());
    Ok(Exported { data, exposed: None, map: None, flattening: Some(flattening), edits: None })
}

/// Checks that a file is what the asset was made of; returns its record.
fn same_model(path: &Path, provenance: &Provenance, scene: &Scene) -> Result<Input> {
    if provenance.origin.is_refined() {
        return Err(Error::unsupported(format!(
            "--scene {}: the mesh of the asset was refined, and light has values at {} vertices, more than the file has: leave --scene out, \
             which writes the refined mesh, or bake without --refine",
            path.display(),
            scene.mesh.local_mm.len()
        )));
    }
    let input = Input::read(path)?;
    if provenance.origin.inputs.iter().any(|known| known.blake3 == input.blake3) {
        return Ok(input);
    }
    // Materials or names may have changed since; the vertices must not.
    let model = read_model(path)?;
    let mesh = &scene.mesh;
    let (count, expected) = (model.positions.len(), mesh.local_mm.len());
    if count != expected {
        let message =
            format!("it has {count} vertices, and the asset was made of {expected}: give the model that was baked");
        return Err(Error::input(message).in_file(path));
    }
    let most = SAME_PLACE * mesh.diagonal_mm();
    let scale = provenance.origin.mm_per_source_unit;
    let used = mesh.triangles.iter().flatten();
    let far = used
        .filter(|v| model.positions[**v as usize].mul_add(DVec3::splat(scale), -mesh.position_mm(**v)).length() > most);
    match far.min() {
        None => Ok(input),
        Some(vertex) => {
            let message = format!("vertex {vertex} is elsewhere than in the asset: give the model that was baked");
            Err(Error::input(message).in_file(path))
        }
    }
}

/// Name of the model, for the mesh and its node.
fn name_of(provenance: &Provenance) -> String {
    let name = provenance.origin.inputs.first().map_or("model", |input| input.name.as_str());
    Path::new(name).file_stem().map_or_else(|| "model".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// Prints what whoever uses the files must know.
fn explain(report: &ExportReport, args: &ExportArgs, provenance: &Provenance, console: &Console) {
    report.lines().iter().for_each(|line| console.note(line));
    if let (Some(path), true) = (&args.scene, (report.mm_per_metre / 1000.0 - 1.0).abs() > 1e-6) {
        console.note(&format!(
            "{} keeps its size in metres; light inside is that of the asset, in which one metre of it is {} mm",
            path.display(),
            significant(report.mm_per_metre)
        ));
    }
    let source = provenance.origin.inputs.first().map(|input| input.name.as_str()).unwrap_or_default();
    let is_gltf = matches!(suffix(Path::new(source)).as_str(), "glb" | "gltf");
    if args.scene.is_none() && report.glb_bytes.is_some() && is_gltf {
        console.note(&format!(
            "made of the asset's own mesh; --scene {source} keeps the nodes, materials and textures of that file"
        ));
    }
}
