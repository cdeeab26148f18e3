//! Wavefront OBJ: polygon meshes with texture coordinates, normals and material names.
//!
//! The crate `tobj` parses the file. Before it sees a byte, our own preflight checks every statement (errors name the
//! line) and writes the geometry again in the narrow dialect that `tobj` reads without guessing. What `tobj` returns
//! is then compared with the preflight's own numbers.
//!
//! Vertex i of the `v` lines is vertex i of the model, whether a face uses it or not.

use std::path::Path;

use glam::{DVec2, DVec3, Vec2, Vec3};

use crate::error::{Error, Result};
use crate::geometry::source::{CornerAttribute, SourceModel};
use crate::io::polygon;

mod dialect;
mod preflight;
mod statement;
#[cfg(test)]
mod tests;

use preflight::{Checked, NONE};

/// Reads an OBJ file. Lengths are in the unit of the file; material libraries are not read, names are kept.
///
/// # Errors
/// I/O where the file cannot be read; otherwise as [`parse_obj`].
pub fn read_obj(path: &Path) -> Result<SourceModel> {
    let bytes = std::fs::read(path).map_err(|error| Error::io(path, &error))?;
    let checked = preflight::check(&bytes, &path.display().to_string())?;
    let missing: Vec<String> = checked
        .material_libraries
        .iter()
        .filter(|library| !library_exists(path, library))
        .map(|library| format!("material library `{library}` is missing; the names of its materials are kept"))
        .collect();
    let mut model = build(checked, &path.display().to_string())?;
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
    build(preflight::check(bytes, name)?, name)
}

/// One `mtllib` may name several files, and file names may hold spaces: either reading will do.
fn library_exists(model: &Path, library: &str) -> bool {
    let folder = model.parent().unwrap_or(Path::new(""));
    let exists = |name: &str| folder.join(name.replace('\\', "/")).is_file();
    exists(library) || library.split_whitespace().all(exists)
}

fn build(checked: Checked, name: &str) -> Result<SourceModel> {
    let mesh = parse_with_tobj(&checked, name)?;
    let positions = vec3s(&mesh.positions, checked.positions.len());
    let mut model = SourceModel { positions, warnings: checked.warnings, ..SourceModel::default() };
    model.materials = checked.materials;

    let mut cut_corners = Vec::with_capacity(checked.corners.len());
    let mut start = 0;
    let mut outline = Vec::new();
    for face in &checked.faces {
        let corners = &checked.corners[start..face.end];
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

    if checked.uses_uvs {
        let values = vec2s(&mesh.texcoords, checked.uv_count);
        let corners = cut_corners.iter().map(|corners| corners.map(|c| c.uv)).collect();
        model.uvs = Some(uv_attribute(&values, corners, &mut model.warnings));
    }
    if checked.uses_normals {
        let values = vec3s(&mesh.normals, checked.normal_count);
        let corners = cut_corners.iter().map(|corners| corners.map(|c| c.normal)).collect();
        model.normals = Some(normal_attribute(&values, corners, &mut model.warnings));
    }
    Ok(model)
}

/// Runs `tobj` over the checked text.
///
/// The text begins with one polygon whose corners count through all vertices, texture coordinates and normals: `tobj`
/// numbers values in the order of first use and drops the unused, so after this polygon its numbers are the file's.
fn parse_with_tobj(checked: &Checked, name: &str) -> Result<tobj::Mesh> {
    let options = tobj::LoadOptions { single_index: false, ..tobj::LoadOptions::default() };
    let no_library = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut checked.text.as_slice(), &options, no_library)
        .map_err(|error| Error::input(format!("{name}: {error}")))?;
    let mesh = models.into_iter().next().map(|model| model.mesh).unwrap_or_default();
    let counted = checked.counting_corners;
    let same_positions = mesh.positions.len() == 3 * checked.positions.len()
        && mesh.positions.chunks_exact(3).zip(&checked.positions).all(|(read, own)| read == own.to_array());
    let same_corners = mesh.indices.len() == counted + checked.corners.len()
        && mesh.indices[counted..].iter().zip(&checked.corners).all(|(&read, own)| read == own.vertex);
    let same_lengths = (!checked.uses_uvs || mesh.texcoords.len() == 2 * checked.uv_count)
        && (!checked.uses_normals || mesh.normals.len() == 3 * checked.normal_count);
    if same_positions && same_corners && same_lengths {
        Ok(mesh)
    } else {
        Err(Error::runtime(format!("{name}: two readings of this file differ; please report the file as a bug")))
    }
}

fn vec3s(flat: &[f64], capacity: usize) -> Vec<DVec3> {
    let mut values = Vec::with_capacity(capacity);
    values.extend(flat.chunks_exact(3).map(|c| DVec3::new(c[0], c[1], c[2])));
    values
}

fn vec2s(flat: &[f64], capacity: usize) -> Vec<DVec2> {
    let mut values = Vec::with_capacity(capacity);
    values.extend(flat.chunks_exact(2).map(|c| DVec2::new(c[0], c[1])));
    values
}

fn uv_attribute(values: &[DVec2], corners: Vec<[u32; 3]>, warnings: &mut Vec<String>) -> CornerAttribute<Vec2> {
    let mut broken = 0;
    let values = values.iter().map(|value| {
        let value = value.as_vec2();
        if value.is_finite() {
            value
        } else {
            broken += 1;
            Vec2::ZERO
        }
    });
    let values = values.collect();
    if broken > 0 {
        warnings.push(format!("{broken} texture coordinates are not finite; (0, 0) takes their place"));
    }
    fill_missing(CornerAttribute { values, corners }, Vec2::ZERO, "texture coordinate", warnings)
}

fn normal_attribute(values: &[DVec3], corners: Vec<[u32; 3]>, warnings: &mut Vec<String>) -> CornerAttribute<Vec3> {
    let mut broken = 0;
    let values = values.iter().map(|value| {
        // The largest component first: squares of the largest and smallest doubles leave the range.
        let unit = (*value / value.abs().max_element()).normalize_or_zero();
        if unit == DVec3::ZERO || !value.is_finite() {
            broken += 1;
            return Vec3::ZERO;
        }
        unit.as_vec3()
    });
    let values = values.collect();
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
