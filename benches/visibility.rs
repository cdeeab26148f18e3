//! Sub-texel decisions per second above the horizon, beside one shadow ray each.
//!
//! `cargo bench --bench visibility`: a closed bunny of the shared test data scaled to a diagonal of 30 mm with 131,072
//! samples, a generated knot where it is missing; then irradiance rows, their time, size and errors (`-- rows`: these
//! alone). Rates are over CPU time of all threads, and over elapsed time.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;
use translux::geometry::bvh::{Bvh, Ray};
use translux::geometry::mesh::{Mesh, Placement};
use translux::geometry::part_table::PartTable;
use translux::geometry::samples::{Samples, patches};
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::io::environment::load_environment;
use translux::light::Light;
use translux::light::cube_light::CubeLight;
use translux::light::sky::sky;
use translux::math::cube_map::{FACES, direction};
use translux::medium::entrance_basis::EntranceBasis;
use translux::medium::material::{Medium, preset};
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::irradiance::{Illumination, LightSampling};
use translux::transport::irradiance_rows::{RowBaker, RowSettings};
use translux::transport::surface::Surface;
use translux::transport::visibility::{GROUP, Observer, Occluders, Resolution, visit};
use translux_format::rows::IrradianceRows;
use translux_format::{AssetFile, Budget, Reader, Samples as FormatSamples};

const SAMPLES: usize = 131_072;
/// Decisions of a second on two cores that the project asks for.
const TARGET: f64 = 150e6;

fn main() {
    let shared = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let source = read(&shared.join("data/meshes/bunny_closed.obj")).unwrap_or_else(|| {
        println!("SKIPPED: bunny_closed is not there; a knot in its place");
        shapes::torus_knot(2, 3, 8.0, 3.0, 1.3, 700, 50)
    });
    let Ok((mesh, _)) = Mesh::from_source(source, &Placement { mm_per_unit: 1.0 }) else { return };
    let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("body".into(), Some(0))]);
    let (bvh, samples) = (Bvh::new(&mesh), Samples::new(&mesh, &parts, SAMPLES));
    let start = Instant::now();
    let occluders = Occluders::new(&mesh);
    println!("{} triangles, {} samples", mesh.triangles.len(), samples.len());
    println!("edges arranged in {:.0} ms, {:.1} MB", milliseconds(start), occluders.bytes() as f64 * 1e-6);
    let observers: Vec<Observer> =
        (0..samples.len()).into_par_iter().map(|i| Observer::of(&mesh, samples.patch(i))).collect();
    let asked: Vec<String> = std::env::args().filter(|a| a == "rows").collect();
    for resolution in [Resolution::Sub64, Resolution::Sub128].into_iter().filter(|_| asked.is_empty()) {
        let run = |observers: &[Observer]| {
            let (mut decisions, mut hidden) = (0, 0);
            visit(&occluders, &bvh, observers, resolution, |_, v| {
                decisions += v.decisions();
                hidden += v.decisions() - v.seen.iter().map(|w| u64::from(w.count_ones())).sum::<u64>();
            });
            (decisions, hidden)
        };
        let name = format!("2x2 of 6x{0}x{0}", resolution.side() / 2);
        rate(&format!("{name}, one thread"), || run(&observers[..observers.len() / 4]));
        let all = rate(&format!("{name}, {} threads", rayon::current_num_threads()), || {
            observers.par_chunks(GROUP).map(run).reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1))
        });
        if resolution == Resolution::Sub64 {
            let verdict = if all >= TARGET { "met" } else { "MISSED" };
            println!("{:.0} M decisions/s of elapsed time; target {:.0} M: {verdict}", all * 1e-6, TARGET * 1e-6);
        }
    }
    let side = Resolution::Sub64.side();
    let scene = scene_of(mesh.clone(), parts);
    rows(scene, &bvh, &samples, &shared);
    let directions: Vec<DVec3> =
        (0..FACES * side * side).map(|i| direction(side, i / side / side, i % side, i / side % side)).collect();
    rate("one ray each, one thread", || {
        let (mut decisions, mut hidden) = (0, 0);
        for o in observers.iter().step_by(SAMPLES / 256) {
            let rays: Vec<Ray> = directions.iter().filter(|d| o.normal.dot(**d) > 0.0).map(|d| o.ray(*d)).collect();
            let mut out = vec![false; rays.len()];
            bvh.occluded_many(&rays, &vec![o.triangle; rays.len()], &mut out);
            decisions += rays.len() as u64;
            hidden += out.iter().filter(|o| **o).count() as u64;
        }
        (decisions, hidden)
    });
}

fn scene_of(mesh: Mesh, parts: PartTable) -> Option<Scene> {
    let properties = preset("marble")?.properties();
    Some(Scene { mesh, parts, media: vec![Medium { name: "marble".into(), properties }] })
}

/// Times, sizes and errors of irradiance rows; errors are relative RMS over patches against shadow rays at native
/// resolution, which have an error of their own (two sets of rays are compared).
fn rows(scene: Option<Scene>, bvh: &Bvh, samples: &Samples, shared: &Path) {
    let Some(scene) = scene else { return };
    let patches = patches(&scene.mesh, samples);
    let surface = Surface { domain: scene.domain(), bvh, samples, patches: &patches };
    let mut lights = vec![("built-in sky".to_string(), sky())];
    for name in ["debevec_grace_1k.exr", "noon_grass_1k.hdr", "potsdamer_platz_1k.hdr", "debevec_uffizi_256.hdr"] {
        if let Ok(map) = load_environment(&shared.join("data/env").join(name)) {
            lights.push((name.to_string(), map.value));
        }
    }
    let lights: Vec<(String, Light)> = lights
        .into_iter()
        .filter_map(|(name, map)| Some((name, Light::environment(map.into(), 20.0, DVec3::ONE).ok()?)))
        .collect();
    let eta = 1.3;
    let truth: Vec<Vec<DVec3>> = lights.iter().map(|(_, light)| sampled(&surface, light, eta, 1024)).collect();
    for ((name, light), truth) in lights.iter().zip(&truth) {
        println!("{name}: rays themselves {:.2} %", 100.0 * error(&sampled(&surface, light, eta, 512), truth));
    }
    let own = [(2, 6144), (1, 128), (2, 128), (3, 128), (2, 64), (2, 256)].map(|(terms, count)| (terms, count, false));
    let in_blocks = [64, 128, 256, 512].map(|count| (2, count, true));
    for (terms, coefficients, in_blocks) in own.into_iter().chain(in_blocks) {
        let settings = RowSettings { terms, coefficients, ..RowSettings::DEFAULT };
        let (start, cpu) = (Instant::now(), cpu_seconds());
        let Ok(rows) = RowBaker::new(&surface, settings)
            .and_then(|baker| if in_blocks { baker.in_blocks(&Silent) } else { baker.all(&Silent) })
        else {
            return;
        };
        let (wall, cpu) = (start.elapsed().as_secs_f64(), cpu_seconds() - cpu);
        let form = if in_blocks { " in blocks" } else { "" };
        println!("{terms} terms, {coefficients} coefficients{form}: {wall:.2} s elapsed, {cpu:.2} s of CPU time");
        let Ok(projection) = EntranceBasis::new(terms).project(eta) else { return };
        for ((name, light), truth) in lights.iter().zip(&truth) {
            let start = Instant::now();
            let Ok(cube) = CubeLight::new(light, settings.side()) else { return };
            let prepared = milliseconds(start);
            let (start, cpu) = (Instant::now(), cpu_seconds());
            let Ok(values) = rows.irradiance(&cube, |_| projection.coefficients) else { return };
            let (wall, cpu) = (milliseconds(start), (cpu_seconds() - cpu) * 1e3);
            let values = probed(&values);
            println!(
                "  {name:<24} error {:.2} %, in local means {:.2} %; light {prepared:.0} ms, product {wall:.0} ms \
                 elapsed, {cpu:.0} ms of CPU time",
                100.0 * error(&values, truth),
                100.0 * error(&means(&values), &means(truth)),
            );
        }
        if coefficients <= 256 {
            stored(rows.data(), samples.len());
        }
    }
}

/// Runs of patches that errors are measured on, and how many are left out for each.
const PROBED: usize = 1024;
const EVERY: usize = 16;

fn sampled(surface: &Surface, light: &Light, eta: f64, directions: u32) -> Vec<DVec3> {
    let sampling = LightSampling { directions, ..LightSampling::FAST };
    let lights = std::slice::from_ref(light);
    let Ok(illumination) = Illumination::new(surface, lights, &[eta], sampling) else { return Vec::new() };
    let mut out = vec![DVec3::ZERO; surface.samples.len() / EVERY / PROBED * PROBED];
    let each = |(i, out): (usize, &mut [DVec3])| drop(illumination.range(i * EVERY * PROBED, out));
    out.par_chunks_mut(PROBED).enumerate().for_each(each);
    out
}

fn probed(values: &[DVec3]) -> Vec<DVec3> {
    values.chunks_exact(EVERY * PROBED).flat_map(|run| &run[..PROBED]).copied().collect()
}

fn error(values: &[DVec3], reference: &[DVec3]) -> f64 {
    let error: f64 = values.iter().zip(reference).map(|(a, b)| (*a - *b).length_squared()).sum();
    (error / reference.iter().map(|b| b.length_squared()).sum::<f64>()).sqrt()
}

/// Means of 64 neighbours in the order of the samples: about what scattering sees.
fn means(values: &[DVec3]) -> Vec<DVec3> {
    values.chunks(64).map(|chunk| chunk.iter().sum::<DVec3>() / chunk.len() as f64).collect()
}

/// Bytes in a file, and the time to read them back.
fn stored(rows: &IrradianceRows, patches: usize) {
    let start = Instant::now();
    let Ok(extra) = rows.to_sections() else { return };
    let asset = AssetFile { samples: FormatSamples::none(0), extra, ..AssetFile::default() };
    let Ok(bytes) = asset.to_bytes() else { return };
    let write = milliseconds(start);
    let start = Instant::now();
    let Ok(asset) = AssetFile::from_bytes(&bytes, Budget::default()) else { return };
    let unpacked = milliseconds(start);
    let same = matches!(IrradianceRows::from_sections(&asset.extra, patches), Ok(Some(back)) if back == *rows);
    println!(
        "  {:.1} bytes a sample in the file, {:.1} in memory; written in {write:.0} ms, unpacked in {unpacked:.0} ms, \
         all in {:.0} ms, same: {same}",
        bytes.len() as f64 / patches as f64,
        rows.bytes() as f64 / patches as f64,
        milliseconds(start)
    );
    if let Ok(reader) = Reader::parse(&bytes, Budget::default()) {
        let kept = reader.sections().iter().filter(|s| s.tag.as_str().starts_with("rows."));
        let sizes: Vec<String> =
            kept.map(|s| format!("{} {:.1}", s.tag, s.stored_bytes as f64 / patches as f64)).collect();
        println!("  {}", sizes.join(", "));
    }
}

/// Prints rates of the best of three; returns decisions per elapsed second.
fn rate(name: &str, run: impl Fn() -> (u64, u64)) -> f64 {
    let (mut cpu, mut wall, mut counts) = (f64::INFINITY, f64::INFINITY, (0, 0));
    for _ in 0..3 {
        let (start, cpu_start) = (Instant::now(), cpu_seconds());
        counts = run();
        wall = wall.min(start.elapsed().as_secs_f64());
        cpu = cpu.min(cpu_seconds() - cpu_start);
    }
    let decisions = counts.0 as f64;
    println!(
        "{name:<28} {:>8.1} M/s elapsed, {:>8.1} M/s of CPU time; {:.0} M decisions, {:.2} % hidden",
        decisions / wall * 1e-6,
        decisions / cpu * 1e-6,
        decisions * 1e-6,
        100.0 * counts.1 as f64 / decisions
    );
    decisions / wall
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// Triangles of an OBJ file, scaled to a diagonal of 30 mm.
fn read(path: &Path) -> Option<SourceModel> {
    let text = std::fs::read_to_string(path).ok()?;
    let rows = |tag: &'static str| {
        text.lines().filter_map(move |l| l.strip_prefix(tag)?.strip_prefix(' ')).map(|l| l.split_whitespace())
    };
    let mut positions: Vec<DVec3> = rows("v")
        .filter_map(|mut w| {
            let mut next = || w.next()?.parse().ok();
            Some(DVec3::new(next()?, next()?, next()?))
        })
        .collect();
    let triangles: Vec<[u32; 3]> = rows("f")
        .filter_map(|mut w| {
            let mut next = || w.next()?.split('/').next()?.parse::<u32>().ok()?.checked_sub(1);
            Some([next()?, next()?, next()?])
        })
        .collect();
    let first = *positions.first()?;
    let (low, high) = positions.iter().fold((first, first), |(l, h), p| (l.min(*p), h.max(*p)));
    positions.iter_mut().for_each(|p| *p *= 30.0 / (high - low).length());
    let triangle_material = vec![0; triangles.len()];
    Some(SourceModel {
        positions,
        triangles,
        triangle_material,
        materials: vec!["default".into()],
        ..Default::default()
    })
}

/// CPU seconds of all threads of this process, from the kernel on Linux; elapsed time elsewhere.
fn cpu_seconds() -> f64 {
    #[cfg(target_os = "linux")]
    if let Ok(tasks) = std::fs::read_dir("/proc/self/task") {
        let read = |entry: std::io::Result<std::fs::DirEntry>| {
            let text = std::fs::read_to_string(entry.ok()?.path().join("schedstat")).ok()?;
            text.split_whitespace().next()?.parse::<u64>().ok()
        };
        return tasks.filter_map(read).sum::<u64>() as f64 * 1e-9;
    }
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}
