//! Collisions per second of the random walk, with the reflectance that they give beside every rate.
//!
//! `cargo bench --bench walk [-- FILE.obj ...]`: a half space, a sphere and generated meshes of 30 mm; the bunny of the
//! shared test data where it is present. Rates are for a second of CPU time, so other load hardly matters; times two for
//! two cores, which share nothing but the mesh.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use translux::geometry::mesh::{Mesh, Scale, resolve_scale};
use translux::geometry::part_table::PartTable;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::io::obj::read_obj;
use translux::light::Light;
use translux::medium::material::{Medium, OpticalProperties, preset};
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::random_walk::boundary::{HalfSpace, Sphere};
use translux::transport::random_walk::exitance::{Effort, budget, exitance};
use translux::transport::random_walk::tally::Budget;
use translux::transport::random_walk::walk::{Start, WalkMedium};

/// Diagonal of the meshes in mm.
const SIZE_MM: f64 = 30.0;

fn main() {
    let files: Vec<PathBuf> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).map(PathBuf::from).collect();
    println!(
        "{:<28} {:>14} {:>10} {:>10} {:>12} {:>10}",
        "body, medium", "Mcoll/CPU s", "wall s", "Mcoll", "reflectance", "lost"
    );
    let marble = preset("marble").map(|p| p.properties()).unwrap_or_else(|| std::process::exit(1));
    let forward = OpticalProperties { g: 0.8, ..marble };
    for (name, properties) in [("marble", marble), ("marble, g 0.8", forward)] {
        let medium = WalkMedium::new(&properties, 0);
        let start = Start { at_mm: DVec3::ZERO, direction: -DVec3::Z };
        report(&format!("half space, {name}"), || budget(&HalfSpace, &medium, 100_000, 1, |_| start));
        let start = Start { at_mm: DVec3::Z * 14.999_999, direction: -DVec3::Z };
        report(&format!("sphere 15 mm, {name}"), || budget(&Sphere { radius_mm: 15.0 }, &medium, 50_000, 1, |_| start));
        if files.is_empty() {
            mesh(&format!("head 20k, {name}"), shapes::bumpy_head(10.0, 5), properties);
        }
    }
    let shared = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let default = ["bunny_closed", "bunny_3k"].map(|name| shared.join(format!("data/meshes/{name}.obj")));
    for file in if files.is_empty() { default.to_vec() } else { files } {
        match read_obj(&file) {
            Ok(source) => {
                let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                for (medium, properties) in [("marble", marble), ("marble, g 0.8", forward)] {
                    mesh(&format!("{name}, {medium}"), source.clone(), properties);
                }
            }
            Err(error) => println!("SKIPPED: {error}"),
        }
    }
}

fn mesh(name: &str, source: SourceModel, properties: OpticalProperties) {
    let made = resolve_scale(&source, Some(Scale::DiagonalMm(SIZE_MM))).and_then(|p| Mesh::from_source(source, &p));
    let Ok((mesh, _)) = made else { return println!("SKIPPED: {name} is no mesh") };
    let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("body".into(), Some(0))]);
    let scene = Scene { mesh, parts, media: vec![Medium { name: name.into(), properties }] };
    let Ok(light) = Light::constant(DVec3::ONE) else { return };
    report(name, || {
        match exitance(scene.domain(), std::slice::from_ref(&light), Effort::Photons(200_000), 1, &Silent) {
            Ok(walked) => walked.budget.iter().fold(Budget::default(), |sum, b| sum.plus(b)),
            Err(error) => {
                println!("FAILED: {error}");
                Budget::default()
            }
        }
    });
}

fn report(name: &str, work: impl Fn() -> Budget) {
    let (cpu, wall) = (cpu_seconds(), Instant::now());
    let got = work();
    let (cpu, wall) = (cpu_seconds() - cpu, wall.elapsed().as_secs_f64());
    let million = got.collisions as f64 * 1e-6;
    println!(
        "{name:<28} {:>14.1} {wall:>10.2} {million:>10.1} {:>12.4} {:>10.1e}",
        million / cpu,
        got.reflectance(),
        got.share(got.lost)
    );
}

/// CPU seconds of all threads of this process so far, on Linux; elapsed time elsewhere.
fn cpu_seconds() -> f64 {
    #[cfg(target_os = "linux")]
    if let Ok(tasks) = std::fs::read_dir("/proc/self/task") {
        let of = |task: std::fs::DirEntry| {
            let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
            text.split_whitespace().next()?.parse::<u64>().ok()
        };
        return tasks.flatten().filter_map(of).sum::<u64>() as f64 * 1e-9;
    }
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}
