//! Wavefront OBJ: polygon meshes with texture coordinates, normals and material names.
//!
//! Vertex i of the `v` lines is vertex i of the model, whether a face uses it or not.

use std::path::Path;

use glam::{Vec2, Vec3};

use crate::error::{Error, Result};
use crate::geometry::source::{CornerAttribute, SourceModel};
use crate::io::polygon;

mod parse;
mod statement;
#[cfg(test)]
mod tests;

use parse::{NONE, Parsed};

/// Reads an OBJ file. Lengths are in the unit of the file; material libraries are not read, names are kept.
///
/// # Errors
/// I/O where the file cannot be read; otherwise as [`parse_obj`].
pub fn read_obj(path: &Path) -> Result<SourceModel> {
    let bytes = std::fs::read(path).map_err(|error| Error::io(path, &error))?;
    let name = path.display().to_string();
    let parsed = parse::parse(&bytes, &name)?;
    let libraries = parsed.material_libraries.iter().filter(|library| !library_exists(path, library));
    let missing: Vec<String> = libraries
        .map(|library| format!("material library `{library}` is missing; the names of its materials are kept"))
        .collect();
    let mut model = build(parsed, &name)?;
    model.warnings.extend(missing);
    Ok(model)
}

/// Parses the bytes of an OBJ file; `name` stands in front of every error.
///
/// # Errors
/// Invalid input, with the line, where a statement is malformed, an index is out of range, a face uses a vertex that is
/// not finite, or the file holds no faces. Unsupported, where a polygon has more than
/// [`polygon::MAX_POLYGON_CORNERS`] corners or the counts do not fit 32 bits.
pub fn parse_obj(bytes: &[u8], name: &str) -> Result<SourceModel> {
    build(parse::parse(bytes, name)?, name)
}

/// Returns whether a material library exists. One `mtllib` may name several files, and names may hold spaces: either
/// reading will do.
fn library_exists(model: &Path, library: &str) -> bool {
    let folder = model.parent().unwrap_or(Path::new(""));
    let exists = |name: &str| folder.join(name.replace('\\', "/")).is_file();
    exists(library) || library.split_whitespace().all(exists)
}

/// Cuts polygons into triangles and brings the attributes that faces use to the corners of the triangles.
fn build(parsed: Parsed, name: &str) -> Result<SourceModel> {
    let Parsed { positions, uvs, normals, corners, faces, materials, warnings, .. } = parsed;
    let uses_uvs = corners.iter().any(|corner| corner.uv != NONE);
    let uses_normals = corners.iter().any(|corner| corner.normal != NONE);
    let mut model = SourceModel { positions, materials, warnings, ..SourceModel::default() };
    let mut cut_corners = Vec::with_capacity(corners.len());
    let mut start = 0;
    let mut outline = Vec::new();
    for face in &faces {
        let corners = &corners[start..face.end];
        start = face.end;
        if let &[a, b, c] = corners {
            cut_corners.push([a, b, c]);
        } else {
            outline.clear();
            outline.extend(corners.iter().map(|corner| model.positions[corner.vertex as usize]));
            cut_corners.extend(polygon::triangulate(&outline).iter().map(|t| t.map(|i| corners[i])));
        }
        model.triangle_material.resize(cut_corners.len(), face.material);
    }
    if cut_corners.len() >= NONE as usize {
        return Err(Error::unsupported(format!("{name}: more than {NONE} triangles; split the model")));
    }
    model.triangles = cut_corners.iter().map(|corners| corners.map(|c| c.vertex)).collect();
    if uses_uvs {
        let corners = cut_corners.iter().map(|corners| corners.map(|c| c.uv)).collect();
        model.uvs = Some(uv_attribute(uvs, corners, &mut model.warnings));
    }
    if uses_normals {
        let corners = cut_corners.iter().map(|corners| corners.map(|c| c.normal)).collect();
        model.normals = Some(normal_attribute(normals, corners, &mut model.warnings));
    }
    Ok(model)
}

fn uv_attribute(mut values: Vec<Vec2>, corners: Vec<[u32; 3]>, warnings: &mut Vec<String>) -> CornerAttribute<Vec2> {
    let mut broken = 0;
    for value in values.iter_mut().filter(|value| !value.is_finite()) {
        *value = Vec2::ZERO;
        broken += 1;
    }
    if broken > 0 {
        warnings.push(format!("{broken} texture coordinates are not finite; (0, 0) takes their place"));
    }
    fill_missing(CornerAttribute { values, corners }, Vec2::ZERO, "texture coordinate", warnings)
}

fn normal_attribute(values: Vec<Vec3>, corners: Vec<[u32; 3]>, warnings: &mut Vec<String>) -> CornerAttribute<Vec3> {
    let broken = values.iter().filter(|value| **value == Vec3::ZERO).count();
    if broken > 0 {
        warnings.push(format!("{broken} normals have no direction; the geometric normal takes their place"));
    }
    fill_missing(CornerAttribute { values, corners }, Vec3::ZERO, "normal", warnings)
}

/// Gives corners without a value one common extra entry.
fn fill_missing<T>(
    mut attribute: CornerAttribute<T>,
    neutral: T,
    what: &str,
    warnings: &mut Vec<String>,
) -> CornerAttribute<T> {
    let extra = attribute.values.len() as u32;
    let mut missing = 0;
    for corner in attribute.corners.iter_mut().flatten().filter(|corner| **corner == NONE) {
        *corner = extra;
        missing += 1;
    }
    if missing > 0 {
        attribute.values.push(neutral);
        warnings.push(format!("{missing} triangle corners have no {what}, though others have; zero takes its place"));
    }
    attribute
}
