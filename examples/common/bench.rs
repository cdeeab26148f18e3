//! Models, bakes in memory, numbers as text.

use std::path::PathBuf;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;
use translux::asset::{Asset, Provenance};
use translux::error::{Error, Result};
use translux::evaluate::{BakeSettings, Method};
use translux::geometry::mesh::{Mesh, Scale, resolve_scale};
use translux::geometry::part_table::PartTable;
use translux::geometry::parts::{Analysis, MaterialRoles, PartsRule};
use translux::geometry::source::SourceModel;
use translux::io::obj::read_obj;
use translux::light::{Light, LightKind};
use translux::measure::probes::{self, Half};
use translux::medium::material::{Medium, OpticalProperties, preset};
use translux::progress::Progress;
use translux::scene::Scene;

use super::finer::longest_edges_cut;

/// The diagonal of every model, mm.
pub(crate) const SIZE_MM: f64 = 30.0;

/// Where to read and write, and how much to do.
pub(crate) struct Context {
    pub(crate) data: PathBuf,
    pub(crate) pictures: PathBuf,
    /// One small mesh, few lights and views.
    pub(crate) quick: bool,
    pub(crate) start: Instant,
}

impl Context {
    /// A line of progress.
    pub(crate) fn say(&self, text: &str) {
        eprintln!("{:7.1} s  {text}", self.start.elapsed().as_secs_f64());
    }

    /// A model of one medium.
    pub(crate) fn scene(&self, model: &str, material: &str) -> Result<Scene> {
        self.sized_scene(model, material, SIZE_MM)
    }

    /// The same with another diagonal.
    pub(crate) fn sized_scene(&self, model: &str, material: &str, size_mm: f64) -> Result<Scene> {
        let source = read_obj(&self.data.join(format!("meshes/{model}.obj")))?;
        let medium = Medium { name: material.to_owned(), properties: properties(material)? };
        scene_of(source, Scale::DiagonalMm(size_mm), PartsRule::Auto, medium)
    }

    /// The same with its longest edges cut until it has so many vertices.
    pub(crate) fn finer_scene(&self, model: &str, vertices: usize, material: &str) -> Result<Scene> {
        let source = longest_edges_cut(read_obj(&self.data.join(format!("meshes/{model}.obj")))?, vertices);
        let medium = Medium { name: material.to_owned(), properties: properties(material)? };
        scene_of(source, Scale::DiagonalMm(SIZE_MM), PartsRule::Auto, medium)
    }

    /// Some of a list where little is to be done.
    pub(crate) fn some<T: Copy>(&self, all: &[T], few: usize) -> Vec<T> {
        all.iter().copied().take(if self.quick { few } else { all.len() }).collect()
    }

    /// The model of the parts that take one.
    pub(crate) fn model(&self) -> &'static str {
        if self.quick { "bunny_3k" } else { "bunny_closed" }
    }
}

/// Those of a preset.
pub(crate) fn properties(material: &str) -> Result<OpticalProperties> {
    let unknown = || Error::command_line(format!("no material `{material}`"));
    Ok(preset(material).ok_or_else(unknown)?.properties())
}

/// A scene of one medium.
pub(crate) fn scene_of(source: SourceModel, scale: Scale, rule: PartsRule, medium: Medium) -> Result<Scene> {
    let placement = resolve_scale(&source, Some(scale))?;
    let (mut mesh, mut report) = Mesh::from_source(source, &placement)?;
    let roles = MaterialRoles::single(mesh.materials.len());
    let parts = Analysis::new(&mut mesh, &roles, rule, &mut report).parts;
    let parts = PartTable::of(&mesh, &parts);
    Ok(Scene { mesh, parts, media: vec![medium] })
}

/// Parallel light of irradiance 1 from a direction of any length.
pub(crate) fn parallel(from: DVec3) -> Light {
    Light::Directional { from: from.normalize_or(DVec3::Y), irradiance: DVec3::ONE }
}

/// How an asset is baked.
#[derive(Clone, Copy)]
pub(crate) struct Recipe<'a> {
    pub(crate) samples: Option<usize>,
    pub(crate) max_rms: f64,
    pub(crate) set: &'a [(&'a str, &'a str)],
}

/// Bakes for one kind of light; no figures for a ledger.
pub(crate) fn bake_for(
    kind: LightKind,
    method: &dyn Method,
    scene: &Scene,
    recipe: &Recipe,
    progress: &dyn Progress,
) -> Result<Asset> {
    let given: Vec<(String, String)> = recipe.set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let mut probes = probes::for_bake(scene);
    probes.tuning = probes::directional(Half::Tuning);
    probes.unseen.clear();
    let settings = BakeSettings {
        samples: recipe.samples,
        for_lights: [kind].into(),
        probes,
        ..BakeSettings::new(recipe.max_rms)
    };
    method.recipe(&given, settings)?.bake(scene.clone(), Provenance::default(), progress)
}

/// Bytes of the method's sections in a file, for each vertex.
pub(crate) fn bytes_per_vertex(asset: &Asset) -> Result<f64> {
    let mut without = asset.clone();
    without.sections.clear();
    let bytes = asset.to_bytes()?.len() - without.to_bytes()?.len();
    Ok(bytes as f64 / asset.scene.mesh.local_mm.len() as f64)
}

/// The number before some words in the notes of an asset's ledger.
pub(crate) fn noted(asset: &Asset, words: &str) -> Option<f64> {
    let before = |note: &str| note.split(words).next().filter(|before| before.len() < note.len()).map(str::to_owned);
    let text = asset.ledger.entries.iter().find_map(|e| before(&e.note))?;
    text.split_whitespace().last()?.parse().ok()
}

/// Bytes a second of a parallel copy, read and written.
pub(crate) fn copy_bandwidth() -> f64 {
    const CHUNK: usize = 1 << 20;
    let from = vec![1u64; 1 << 25];
    let mut to = vec![0u64; from.len()];
    let once = |to: &mut Vec<u64>| {
        let start = Instant::now();
        to.par_chunks_mut(CHUNK).zip(from.par_chunks(CHUNK)).for_each(|(to, from)| to.copy_from_slice(from));
        start.elapsed().as_secs_f64()
    };
    let best = (0..7).map(|_| once(&mut to)).fold(f64::INFINITY, f64::min);
    (2 * size_of_val(from.as_slice())) as f64 / best
}

/// Rows of a table in Markdown, below its head.
pub(crate) fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", head.join(" | "), " --- |".repeat(head.len()));
    for row in rows {
        text.push_str(&format!("| {} |\n", row.join(" | ")));
    }
    text
}

/// Whether a figure is as wanted.
pub(crate) fn met(as_wanted: bool) -> &'static str {
    if as_wanted { "**met**" } else { "**not met**" }
}
