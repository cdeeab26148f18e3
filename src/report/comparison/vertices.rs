//! Comparison of two PLY files: radiosity and single scattering of their vertices.

use std::path::Path;

use glam::DVec3;

use crate::error::{Error, ExitCode, Result};
use crate::io::ply::{PlyVertexTable, read_ply};
use crate::math::statistics::{VertexError, vertex_error};
use crate::report::radiosity_ply::{CALIBRATED, RANDOM_WALK, SINGLE_INCLUDED};

/// Errors of the first of two files against the second.
pub(super) struct Vertices {
    /// Whether all columns and triangles are the same.
    pub(super) equal: bool,
    /// The larger error of the radiosity and, where it is compared, of the sum with single scattering.
    pub(super) worst: VertexError,
    /// Error of single scattering alone, where both files have it.
    pub(super) single: Option<VertexError>,
    pub(super) notes: Vec<String>,
    pub(super) warnings: Vec<String>,
}

/// Columns of radiosity and of single scattering.
const B: [&str; 3] = ["b_r", "b_g", "b_b"];
const S: [&str; 3] = ["s_r", "s_g", "s_b"];

/// Compares two files.
pub(super) fn compare(paths: [&Path; 2]) -> Result<Vertices> {
    let [a, b] = [read_ply(paths[0])?, read_ply(paths[1])?];
    if a.vertex_count != b.vertex_count {
        let counts = format!("{} and {} vertices", a.vertex_count, b.vertex_count);
        return Err(Error::new(ExitCode::Difference, format!("the files have {counts}")));
    }
    let of = |table: &PlyVertexTable, path: &Path, names: [&str; 3]| -> Result<Vec<DVec3>> {
        let missing = || Error::input(format!("{}: no properties {}", path.display(), names.join(" ")));
        Ok(table.triples(names).ok_or_else(missing)?.into_iter().map(DVec3::from_array).collect())
    };
    let radiosity = [of(&a, paths[0], B)?, of(&b, paths[1], B)?];
    let single = [(&a, paths[0]), (&b, paths[1])].map(|(table, path)| of(table, path, S).ok());
    let included = [&a, &b].map(|table| table.comments.iter().any(|c| c == SINGLE_INCLUDED));
    // Equal weights for a file without faces.
    let areas = match b.triples(["x", "y", "z"]).filter(|_| !b.triangles.is_empty()) {
        Some(positions) => vertex_areas(|v| DVec3::from_array(positions[v as usize]), b.vertex_count, &b.triangles),
        None => vec![1.0; b.vertex_count],
    };
    let error = |values: [&Vec<DVec3>; 2]| vertex_error(values[0], values[1], &areas);
    let sum = |side: usize| match &single[side] {
        Some(single) => radiosity[side].iter().zip(single).map(|(b, s)| *b + *s).collect(),
        None => radiosity[side].clone(),
    };
    let has = [0, 1].map(|side| included[side] || single[side].is_some());
    let mut result = Vertices {
        equal: a.columns == b.columns && a.triangles == b.triangles,
        worst: VertexError::default(),
        single: None,
        notes: Vec::new(),
        warnings: Vec::new(),
    };
    for side in (0..2).filter(|&side| included[side] && !has[1 - side]) {
        let with = paths[side].display();
        let warning = format!("the radiosity of {with} has single scattering in it, that of the other file has not");
        result.warnings.push(warning);
    }
    let calibrated = [&a, &b].map(|table| table.comments.iter().any(|comment| comment == CALIBRATED));
    let of_walk = format!("translux {RANDOM_WALK}");
    let walked = [&a, &b].iter().any(|table| table.comments.contains(&of_walk));
    if calibrated[0] != calibrated[1] && !walked {
        let with = paths[usize::from(calibrated[1])].display();
        let warning = format!(
            "the kernels of {with} are calibrated, those of the other file are dipoles: most of the difference is that of the models"
        );
        result.warnings.push(warning);
    }
    let with_single = if included == [false; 2] { in_both(has, paths, &mut result.notes) } else { true };
    result.worst = match &single {
        _ if !with_single => error([&radiosity[0], &radiosity[1]]),
        [Some(own), Some(other)] => {
            result.single = Some(error([own, other]));
            error([&sum(0), &sum(1)]).max(error([&radiosity[0], &radiosity[1]]))
        }
        _ => error([&sum(0), &sum(1)]),
    };
    Ok(result)
}

/// Returns whether both files have single scattering; adds a note where only one has it.
pub(super) fn in_both(has: [bool; 2], paths: [&Path; 2], notes: &mut Vec<String>) -> bool {
    if has[0] != has[1] {
        let with = if has[0] { paths[0] } else { paths[1] };
        notes.push(format!("{} alone has single scattering, which is not compared", with.display()));
    }
    has == [true; 2]
}

/// A third of the area of the triangles around each vertex.
pub(crate) fn vertex_areas(at: impl Fn(u32) -> DVec3, vertices: usize, triangles: &[[u32; 3]]) -> Vec<f64> {
    let mut areas = vec![0.0; vertices];
    for &[a, b, c] in triangles {
        let third = (at(b) - at(a)).cross(at(c) - at(a)).length() / 6.0;
        for v in [a, b, c] {
            areas[v as usize] += third;
        }
    }
    areas
}
