//! Radiosities that another program computed, in the shared data beside the repository (or `TRANSLUX_SHARED`).

use super::hdr::read_hdr;
use super::vector::V3;
use super::{Oracle, OracleLight, OracleMedium, OracleMesh, OracleSettings};
use std::path::PathBuf;
use std::time::Instant;

fn medium(sigma_s_reduced: V3, sigma_a: V3, eta: f64) -> OracleMedium {
    OracleMedium { sigma_s_reduced, sigma_a, eta }
}

/// Media of Jensen et al. 2001 that the files name.
pub fn material(name: &str) -> OracleMedium {
    match name {
        "marble" => medium([2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071], 1.5),
        "skin1" => medium([0.74, 0.88, 1.01], [0.032, 0.17, 0.48], 1.3),
        "ketchup" => medium([0.18, 0.07, 0.03], [0.061, 0.97, 1.45], 1.3),
        "spectralon" => medium([11.6, 20.4, 14.9], [0.0; 3], 1.3),
        "cream" => medium([7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163], 1.3),
        _ => panic!("no medium {name}"),
    }
}

/// The file in the shared data, or None with a line that says so.
pub fn shared(relative: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join(relative);
    if path.exists() {
        return Some(path);
    }
    eprintln!("WITHOUT ../shared: {} is not there", path.display());
    None
}

/// What a truth file's header says, and the error that is expected of it.
pub struct Case {
    pub file: &'static str,
    pub mesh: &'static str,
    pub size_mm: f64,
    pub medium: &'static str,
    pub light: fn() -> Option<OracleLight>,
    pub limit: f64,
}

/// An environment of the shared data.
pub fn environment(file: &str, rotate_degrees: f64) -> Option<OracleLight> {
    let (width, height, pixels) = read_hdr(&shared(&format!("data/env/{file}"))?);
    Some(OracleLight::Environment { width, height, pixels, rotate_degrees, scale: [1.0; 3] })
}

/// Relative error against the file as the design defines it, worst channel; None without the shared data.
pub fn compare(case: &Case) -> Option<f64> {
    let text = std::fs::read_to_string(shared(&format!("truth/{}.csv", case.file))?).unwrap();
    let mesh = OracleMesh::read_obj(&shared(&format!("data/meshes/{}.obj", case.mesh))?).scaled(case.size_mm);
    let light = (case.light)()?;
    let rows: Vec<(usize, V3)> = rows_of(&text);
    assert!(rows.len() >= 50, "{} has {} rows", case.file, rows.len());
    let start = Instant::now();
    let oracle = Oracle::new(&mesh, &material(case.medium), &[light], OracleSettings::default());
    let prepared = start.elapsed().as_secs_f64();
    let found = oracle.radiosities(&rows.iter().map(|r| r.0).collect::<Vec<_>>());
    let gathered = start.elapsed().as_secs_f64() - prepared;
    let sum = |f: &dyn Fn(usize) -> V3| (0..rows.len()).fold([0.0; 3], |s, i| super::vector::add(s, f(i)));
    let squares = sum(&|i| rows[i].1.map(|b| b * b));
    let errors = sum(&|i| std::array::from_fn(|c| (found[i][c] - rows[i].1[c]).powi(2)));
    let bias = sum(&|i| std::array::from_fn(|c| found[i][c] - rows[i].1[c]));
    let brightest = squares.iter().fold(0.0_f64, |a, &b| a.max(b));
    let floor = squares.map(|s| s.max(1e-6 * brightest).sqrt());
    let relative: V3 = std::array::from_fn(|c| errors[c].sqrt() / floor[c]);
    let relative_bias: V3 = std::array::from_fn(|c| bias[c] / (rows.len() as f64).sqrt() / floor[c]);
    // The error the oracle states of itself, over a few of the vertices.
    let mut stated: V3 = [0.0; 3];
    let few: Vec<usize> = (0..rows.len()).step_by(rows.len().div_ceil(8)).collect();
    for &i in &few {
        let (_, e) = oracle.radiosity_with_error(rows[i].0);
        stated = std::array::from_fn(|c| stated[c] + e[c] * e[c]);
    }
    let stated: V3 =
        std::array::from_fn(|c| (stated[c] / few.len() as f64).sqrt() / (floor[c] / (rows.len() as f64).sqrt()));
    let worst = relative.iter().fold(0.0_f64, |a, &b| a.max(b));
    let show = |v: V3| v.map(|c| format!("{c:+.1e}")).join(" ");
    let (relative, relative_bias, stated) = (show(relative), show(relative_bias), show(stated));
    eprintln!(
        "{}: relative error {worst:.2e} ({relative}), bias {relative_bias}, stated {stated} \
         ({} vertices, prepared {prepared:.1} s, gathered {gathered:.1} s)",
        case.file,
        rows.len()
    );
    Some(worst)
}

/// Vertices and their radiosities in the text of a truth file.
pub fn rows_of(text: &str) -> Vec<(usize, V3)> {
    let rows = text.lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit()));
    rows.map(|l| {
        let mut words = l.split(',');
        let vertex = words.next().unwrap().parse().unwrap();
        (vertex, std::array::from_fn(|_| words.next().unwrap().parse().unwrap()))
    })
    .collect()
}
