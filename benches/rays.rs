//! Shadow rays per second on one thread, with the fraction that hits beside every rate.
//!
//! `cargo bench --bench rays [-- FILE.obj ...]`; without files a generated mesh of 70,000 triangles, and the meshes of
//! the shared test data where they are present. Times are CPU times of the process, so other load hardly matters.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use translux::geometry::bvh::{Bvh, NO_TRIANGLE, Ray, offset_origin};
use translux::math::random::uniform;

type Corners = Vec<[Vec3; 3]>;

fn main() {
    let files: Vec<PathBuf> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).map(PathBuf::from).collect();
    println!("{:<16} {:<28} {:>9} {:>9} {:>8}", "mesh", "rays", "Mrays/s", "rays", "hits %");
    if files.is_empty() {
        measure("torus knot 70k", &knot(700, 50));
        let shared = std::env::var_os("TRANSLUX_SHARED")
            .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
        for name in ["bunny_closed", "dragon_res2"] {
            match parse(&shared.join(format!("data/meshes/{name}.obj"))) {
                Some(corners) => measure(name, &corners),
                None => println!("SKIPPED: {name} is not there"),
            }
        }
    }
    for file in files {
        match parse(&file) {
            Some(corners) => measure(&file.display().to_string(), &corners),
            None => println!("SKIPPED: {} has no triangles", file.display()),
        }
    }
}

fn parse(path: &Path) -> Option<Corners> {
    let text = std::fs::read_to_string(path).ok()?;
    let rows = |tag: &'static str| {
        text.lines().filter_map(move |l| l.strip_prefix(tag)?.strip_prefix(' ')).map(|l| l.split_whitespace())
    };
    let points: Vec<Vec3> = rows("v")
        .filter_map(|mut w| {
            let mut next = || w.next()?.parse().ok();
            Some(Vec3::new(next()?, next()?, next()?))
        })
        .collect();
    let mut corners = Vec::new();
    for row in rows("f") {
        let face: Vec<Vec3> = row
            .filter_map(|w| points.get(w.split('/').next()?.parse::<usize>().ok()?.checked_sub(1)?).copied())
            .collect();
        corners.extend((2..face.len()).map(|i| [face[0], face[i - 1], face[i]]));
    }
    (!corners.is_empty()).then_some(corners)
}

/// A (2, 3) torus knot: a closed tube that shadows itself.
fn knot(along: usize, around: usize) -> Corners {
    let centre = |s: f64| {
        let (r, a) = (2.0 + (3.0 * s).cos(), 2.0 * s);
        DVec3::new(r * a.cos(), r * a.sin(), (3.0 * s).sin())
    };
    let at = |i: usize, j: usize| {
        let (s, a) = (TAU * (i % along) as f64 / along as f64, TAU * (j % around) as f64 / around as f64);
        let tangent = (centre(s + 1e-4) - centre(s - 1e-4)).normalize();
        let x = tangent.cross(DVec3::new(0.3, 0.5, 0.8)).normalize();
        (centre(s) + 0.45 * (x * a.cos() + tangent.cross(x) * a.sin())).as_vec3()
    };
    let cell = |(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, c, b], [a, d, c]]
    };
    (0..along).flat_map(|i| (0..around).map(move |j| (i, j))).flat_map(cell).collect()
}

fn measure(name: &str, corners: &Corners) {
    let mut fastest = f64::INFINITY;
    for _ in 0..5 {
        let start = cpu_seconds();
        std::hint::black_box(Bvh::from_triangles(corners));
        fastest = fastest.min(cpu_seconds() - start);
    }
    let bvh = Bvh::from_triangles(corners);
    let triangles = corners.len();
    println!("{name:<16} {triangles} triangles, build {:.1} ms, {:.1} MB", fastest * 1e3, bvh.bytes() as f64 * 1e-6);
    for (kind, make) in [
        ("cosine hemisphere", cosine as fn(&Corners, u64) -> (Ray, u32)),
        ("cosine, random origins", scattered),
        ("one direction", parallel),
        ("one origin, 32 x 32", fans),
    ] {
        let n = 2_000_000;
        let (rays, skip): (Vec<Ray>, Vec<u32>) = (0..n).map(|i| make(corners, i)).unzip();
        let mut out = vec![false; rays.len()];
        run(name, kind, &rays, |()| {
            for ((ray, &skip), out) in rays.iter().zip(&skip).zip(&mut out) {
                *out = bvh.occluded(ray, skip);
            }
            out.iter().filter(|&&o| o).count()
        });
        let single = out.clone();
        run(name, &format!("{kind}, many"), &rays, |()| {
            bvh.occluded_many(&rays, &skip, &mut out);
            out.iter().filter(|&&o| o).count()
        });
        assert!(single == out, "packets and single rays differ");
        if kind == "cosine hemisphere" {
            run(name, "cosine, closest", &rays, |()| rays.iter().filter(|r| bvh.closest(r).is_some()).count());
        }
    }
    let inside: Vec<Ray> = (0..200_000).map(|i| cosine(corners, i).0).collect();
    let hits = inside.iter().filter(|r| bvh.occluded(r, NO_TRIANGLE)).count();
    println!("{name:<16} without skip {:.2} % hit", 100.0 * hits as f64 / inside.len() as f64);
}

fn run(name: &str, kind: &str, rays: &[Ray], mut body: impl FnMut(()) -> usize) {
    let mut best = f64::INFINITY;
    let mut hits = 0;
    for _ in 0..5 {
        let start = cpu_seconds();
        hits = body(());
        best = best.min(cpu_seconds() - start);
    }
    let n = rays.len() as f64;
    println!("{name:<16} {kind:<28} {:>9.2} {:>9} {:>8.2}", n / best * 1e-6, rays.len(), 100.0 * hits as f64 / n);
}

fn surface(corners: &Corners, triangle: usize, index: u64) -> (Vec3, Vec3) {
    let [a, b, c] = corners[triangle];
    let (mut u, mut v) = (uniform(1, index, 0) as f32, uniform(1, index, 1) as f32);
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let normal = (b - a).cross(c - a).normalize_or_zero();
    (offset_origin(a + (b - a) * u + (c - a) * v, normal), normal)
}

/// Triangles in the order of the file, six rays from each.
fn cosine(corners: &Corners, index: u64) -> (Ray, u32) {
    hemisphere(corners, index as usize / 6 % corners.len(), index)
}

/// The same from random triangles: what no cache helps.
fn scattered(corners: &Corners, index: u64) -> (Ray, u32) {
    hemisphere(corners, (uniform(2, index, 0) * corners.len() as f64) as usize, index)
}

/// A direction with the density of the cosine, from a random point of a triangle.
fn hemisphere(corners: &Corners, triangle: usize, index: u64) -> (Ray, u32) {
    let (point, normal) = surface(corners, triangle, index);
    let (z, a) = (2.0 * uniform(2, index, 1) - 1.0, TAU * uniform(2, index, 2));
    let r = (1.0 - z * z).max(0.0).sqrt();
    let direction = (DVec3::new(r * a.cos(), r * a.sin(), z) + normal.as_dvec3()).normalize_or(normal.as_dvec3());
    (Ray::new(point, direction.as_vec3()), triangle as u32)
}

/// Triangles in the order of the file, all towards one light.
fn parallel(corners: &Corners, index: u64) -> (Ray, u32) {
    let triangle = (index as usize * 7 / 40) % corners.len();
    let (point, _) = surface(corners, triangle, index);
    (Ray::new(point, Vec3::new(0.3, 0.8, 0.52).normalize()), triangle as u32)
}

/// 1024 directions of a 32 x 32 grid over a face of a cube map from each origin, in tiles of 4 x 4.
fn fans(corners: &Corners, index: u64) -> (Ray, u32) {
    let origin = index / 1024;
    let triangle = (uniform(3, origin, 0) * corners.len() as f64) as usize;
    let (point, normal) = surface(corners, triangle, origin);
    let (tile, cell) = ((index / 16 % 64) as u32, (index % 16) as u32);
    let (x, y) = (tile % 8 * 4 + cell % 4, tile / 8 * 4 + cell / 4);
    let (s, t) = ((x as f32 + 0.5) / 16.0 - 1.0, (y as f32 + 0.5) / 16.0 - 1.0);
    let side = normal.any_orthonormal_vector();
    let direction = (normal + side * s + normal.cross(side) * t).normalize_or(normal);
    (Ray::new(point, direction), triangle as u32)
}

/// CPU seconds of this process so far, from the scheduler on Linux; elapsed time elsewhere.
fn cpu_seconds() -> f64 {
    #[cfg(target_os = "linux")]
    if let Ok(text) = std::fs::read_to_string("/proc/self/schedstat")
        && let Some(Ok(nanoseconds)) = text.split_whitespace().next().map(str::parse::<u64>)
    {
        return nanoseconds as f64 * 1e-9;
    }
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}
