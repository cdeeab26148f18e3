//! Rows for environments: bytes and errors of rows of their own and of rows in blocks of neighbours.

use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;
use translux::compress::rows::Rows;
use translux::error::{Error, Result};
use translux::geometry::bvh::Bvh;
use translux::geometry::samples::{Samples, patches};
use translux::io::environment::load_environment;
use translux::light::Light;
use translux::light::cube_light::CubeLight;
use translux::light::sky::sky;
use translux::math::statistics::vertex_error;
use translux::medium::entrance_basis::EntranceBasis;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::gather::{Gather, Scheme};
use translux::transport::irradiance_rows::{RowBaker, RowSettings};
use translux::transport::near_rule::NearField;
use translux::transport::receivers::Receivers;
use translux::transport::surface::Surface;
use translux::transport::tree::SampleTree;
use translux::transport::visibility::GROUP;
use translux_format::AssetFile;

use crate::bench::{media, percent};
use crate::common::bench::{Context, met, table};
use crate::common::runner::summary;

const MODEL: (&str, usize, usize) = ("gargoyle", 65_536, 131_072);
const QUICK: (&str, usize, usize) = ("bunny_3k", 0, 16_384);

const MAPS: [&str; 6] = [
    "debevec_grace_1k.exr",
    "debevec_uffizi_256.hdr",
    "museum.exr",
    "noon_grass_1k.hdr",
    "potsdamer_platz_1k.hdr",
    "st_peters_square_night_1k.hdr",
];

/// A map whose sun is smaller than a texel: what its rows lose is shown apart.
const BARE_SUN: &str = "noon_grass_1k.hdr";

const MATERIALS: [&str; 2] = ["marble", "skin1"];

/// Receivers that radiosity is compared at.
const PROBES: usize = 192;

/// Coefficients, and whether rows are in blocks.
const FORMS: [(usize, bool); 4] = [(128, false), (128, true), (256, true), (512, true)];

/// Form whose bytes are wanted, and how many.
const WANTED: ((usize, bool), f64) = ((128, true), 150.0);

/// So that no axis of a map lies along one of the cube.
const TURN_DEGREES: f64 = 20.0;

fn maps(context: &Context) -> Result<Vec<(String, Light)>> {
    let mut all = vec![("built-in sky".to_owned(), sky())];
    for name in context.some(&MAPS, 2) {
        all.push((name.to_owned(), load_environment(&context.data.join("env").join(name))?.value));
    }
    all.into_iter().map(|(name, map)| Ok((name, Light::environment(map.into(), TURN_DEGREES, DVec3::ONE)?))).collect()
}

/// Irradiance of every sample under every map from rows of which nothing is dropped, chunk by chunk.
fn whole(baker: &RowBaker, count: usize, maps: &[CubeLight], c: [f64; 4]) -> Result<Vec<Vec<DVec3>>> {
    let of_chunk = |first: usize| -> Result<Vec<Vec<DVec3>>> {
        let end = count.min(first + GROUP);
        let rows = Rows::new(baker.range(first..end), &[0, (end - first) as u32])?;
        maps.iter().map(|map| rows.irradiance_range(0..end - first, map, |_| c)).collect()
    };
    let starts: Vec<usize> = (0..count).step_by(GROUP).collect();
    let chunks: Vec<Vec<Vec<DVec3>>> = starts.into_par_iter().map(of_chunk).collect::<Result<_>>()?;
    Ok((0..maps.len()).map(|map| chunks.iter().flat_map(|chunk| &chunk[map]).copied().collect()).collect())
}

fn file_bytes(rows: &Rows) -> Result<usize> {
    let fail = |e: translux_format::FormatError| Error::runtime(e.to_string());
    let bytes = |file: &AssetFile| file.to_bytes().map(|bytes| bytes.len()).map_err(fail);
    let samples = translux_format::Samples::none(0);
    let empty = AssetFile { samples: samples.clone(), ..AssetFile::default() };
    Ok(bytes(&AssetFile { samples, extra: rows.data().to_sections().map_err(fail)?, ..AssetFile::default() })?
        - bytes(&empty)?)
}

/// Radiosity at the probes in each material.
struct Probed<'a> {
    surface: &'a Surface<'a>,
    scenes: Vec<Scene>,
    subset: Receivers,
    areas: Vec<f64>,
}

impl Probed<'_> {
    fn radiosity(&self, irradiance: &[DVec3]) -> Vec<Vec<DVec3>> {
        let of_material = |scene: &Scene| {
            let tree = SampleTree::default();
            let gather = Gather::new(self.surface, &tree, &scene.media, NearField::for_error(0.01));
            gather.radiosity(&self.subset, &gather.light(irradiance), Scheme::AllPairs, &Silent)
        };
        self.scenes.iter().map(of_material).collect()
    }

    /// The worst material.
    fn error(&self, found: &[DVec3], exact: &[Vec<DVec3>]) -> f64 {
        let pairs = self.radiosity(found);
        pairs.iter().zip(exact).map(|(f, e)| vertex_error(f, e, &self.areas).rms).fold(0.0, f64::max)
    }
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, vertices, count) = if context.quick { QUICK } else { MODEL };
    let scene = context.finer_scene(model, vertices, MATERIALS[0])?;
    let vertices = scene.mesh.local_mm.len();
    let samples = Samples::new(&scene.mesh, &scene.parts, count).in_tree_order(&scene.mesh, &scene.parts);
    let (patches, bvh) = (patches(&scene.mesh, &samples), Bvh::new(&scene.mesh));
    let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
    let (subset, indices) = Receivers::new(&scene.mesh, &scene.parts, 16).subset(PROBES, 1);
    let of_material = |name: &&str| Ok(Scene { media: media(&scene, name)?, ..scene.clone() });
    let scenes = MATERIALS.iter().map(of_material).collect::<Result<_>>()?;
    let probed = Probed { surface: &surface, scenes, areas: vec![1.0; indices.len()], subset };

    let side = RowSettings::DEFAULT.side();
    let maps = maps(context)?;
    let cubes: Vec<CubeLight> = maps.iter().map(|(_, light)| CubeLight::new(light, side)).collect::<Result<_>>()?;
    let c = EntranceBasis::new(RowSettings::DEFAULT.terms)
        .project(scene.media[0].properties.eta_inside_over_outside)?
        .coefficients;
    let settings = |coefficients| RowSettings { coefficients, ..RowSettings::DEFAULT };
    let exact = whole(&RowBaker::new(&surface, settings(6 * side * side))?, samples.len(), &cubes, c)?;
    let lit: Vec<Vec<Vec<DVec3>>> = exact.iter().map(|e| probed.radiosity(e)).collect();
    context.say("environment: all coefficients");

    let ones = vec![1.0; samples.len()];
    let (mut rows, mut text) = (Vec::new(), String::new());
    for (coefficients, in_blocks) in context.some(&FORMS, 2) {
        let start = Instant::now();
        let baker = RowBaker::new(&surface, settings(coefficients))?;
        let stored = if in_blocks { baker.in_blocks(&Silent)? } else { baker.all(&Silent)? };
        let seconds = start.elapsed().as_secs_f64();
        let bytes = file_bytes(&stored)? as f64 / vertices as f64;
        let (mut irradiance, mut radiosity, mut sun, mut milliseconds) = (0.0f64, 0.0f64, 0.0f64, f64::INFINITY);
        for ((((name, _), cube), exact), lit) in maps.iter().zip(&cubes).zip(&exact).zip(&lit) {
            let start = Instant::now();
            let found = stored.irradiance(cube, |_| c)?;
            milliseconds = milliseconds.min(start.elapsed().as_secs_f64() * 1e3);
            let error = probed.error(&found, lit);
            if name == BARE_SUN {
                sun = error;
            } else {
                irradiance = irradiance.max(vertex_error(&found, exact, &ones).rms);
                radiosity = radiosity.max(error);
            }
        }
        let form = if in_blocks { "in blocks" } else { "of their own" };
        let row = vec![
            format!("{coefficients}, {form}"),
            format!("{:.1}", stored.data().indices.len() as f64 / samples.len() as f64),
            format!("{bytes:.0}"),
            format!("{:.0}", stored.data().bytes() as f64 / vertices as f64),
            percent(irradiance),
            percent(radiosity),
            percent(sun),
            format!("{seconds:.0} s"),
            format!("{milliseconds:.0} ms"),
        ];
        context.say(&format!("environment: {}", row.join(", ")));
        rows.push(row);
        if (coefficients, in_blocks) == WANTED.0 {
            text += &summary(
                &format!(
                    "bytes/vertex of the rows for environments, {model}; RMS of the radiosity by dropped coefficients, the worst of {} maps",
                    maps.len() - 1
                ),
                "-",
                &format!("<= {:.0}", WANTED.1),
                &format!("{bytes:.0}; {}; {}", percent(radiosity), met(bytes <= WANTED.1)),
            );
        }
    }
    let head = [
        "coefficients",
        "details kept/sample",
        "bytes/vertex",
        "resident",
        "irradiance",
        "radiosity",
        "with a bare sun",
        "bake",
        "a new map",
    ];
    let title = format!("{model}, {vertices} vertices, {} samples:\n\n", samples.len());
    Ok(text + &title + &table(&head, &rows))
}
