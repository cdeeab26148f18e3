//! Builds the mesh that every stage works on from a source model: scale, rounding, welding and repairs, all counted.

use glam::{DVec3, Vec2, Vec3};
use serde::Serialize;

use super::scale::{MAX_DIAGONAL_MM, MIN_DIAGONAL_MM, used_bounds};
use super::{Mesh, POSITION_RESOLUTION, Placement};
use crate::error::{Error, Result};
use crate::geometry::buckets::Buckets;
use crate::geometry::source::{CornerAttribute, SourceModel};
use crate::math::random::mix;

/// Indices of half-edges must fit 32 bits.
const MAX_TRIANGLES: usize = 1 << 30;

/// Largest coordinate of a model's centre, mm: what files hold.
pub(super) const MAX_ORIGIN_MM: f64 = 1e12;

/// Counts of the defects and repairs between the source and the mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RepairReport {
    /// Vertices of the source.
    pub source_vertices: usize,
    /// Triangles of the source, polygons cut.
    pub source_triangles: usize,
    /// Vertices at the place of an earlier vertex, joined with it for geometry.
    pub welded_vertices: usize,
    /// Vertices that no triangle of the source names.
    pub unreferenced_vertices: usize,
    /// Vertices at whose place no triangle of the mesh has a corner: they get the value 0.
    pub vertices_without_area: usize,
    /// Removed: triangles with two corners at the same place.
    pub collapsed_triangles: usize,
    /// Removed: triangles with three distinct corners and no area that single-precision positions resolve.
    pub zero_area_triangles: usize,
    /// Removed: triangles with the same corners in the same orientation as an earlier one.
    pub duplicate_triangles: usize,
    /// Kept: pairs of triangles with the same corners in opposite orientation.
    pub reversed_twins: usize,
    /// Turned round: closed components whose normals all pointed inwards.
    pub flipped_components: usize,
    /// Triangles of those components.
    pub flipped_triangles: usize,
}

impl RepairReport {
    /// One line for each repair that happened.
    pub fn lines(&self) -> Vec<String> {
        let lines = [
            (self.welded_vertices, "vertices at the same place as an earlier one: welded for geometry"),
            (self.unreferenced_vertices, "vertices that no triangle uses: kept in the output with value 0"),
            (self.collapsed_triangles, "triangles with two corners at the same place: removed"),
            (self.zero_area_triangles, "triangles without area: removed"),
            (self.duplicate_triangles, "triangles that repeat an earlier one: removed"),
            (self.reversed_twins, "pairs of triangles back to back: kept"),
            (self.flipped_components, "closed components with their normals inwards: turned round"),
        ];
        lines.into_iter().filter(|(count, _)| *count > 0).map(|(count, text)| format!("{count} {text}")).collect()
    }
}

impl Mesh {
    /// Scales, rounds, welds and repairs a model.
    ///
    /// Positions become `f32(p * mm_per_unit - origin)` with the centre of the used vertices' bounding box as origin.
    /// Vertices are welded where these are equal (-0 is 0). Removed are triangles with two corners in one place, with
    /// twice their area at most (2^-24 of the diagonal)^2, and repetitions of an earlier triangle in the same
    /// orientation. Vertices are never removed or moved in order.
    ///
    /// # Errors
    /// Invalid input: indices out of range, non-finite vertices, a diagonal outside 1e-6 to 1e9 mm, or no triangle
    /// left. Unsupported: more than 2^30 triangles.
    pub fn from_source(source: SourceModel, placement: &Placement) -> Result<(Mesh, RepairReport)> {
        validate(&source)?;
        let (min, max) = used_bounds(&source)?;
        let scale = placement.mm_per_unit;
        let diagonal_mm = ((max - min) * scale).length();
        if !(MIN_DIAGONAL_MM..=MAX_DIAGONAL_MM).contains(&diagonal_mm) {
            return Err(Error::input(format!(
                "the model's diagonal is {diagonal_mm:.3e} mm, outside {MIN_DIAGONAL_MM:.0e} to {MAX_DIAGONAL_MM:.0e} \
                 mm: check --unit, or give --size-mm"
            )));
        }
        let origin_mm = 0.5 * (min * scale + max * scale);
        if !(origin_mm.is_finite() && origin_mm.abs().max_element() <= MAX_ORIGIN_MM) {
            return Err(Error::input(format!(
                "the model's centre lies more than {MAX_ORIGIN_MM:e} mm away at {scale} mm per unit: give --size-mm, or move the \
                 model to its origin"
            )));
        }
        let mut report = RepairReport {
            source_vertices: source.positions.len(),
            source_triangles: source.triangles.len(),
            ..RepairReport::default()
        };
        let used = used_vertices(&source.triangles, source.positions.len());
        report.unreferenced_vertices = used.iter().filter(|&&u| !u).count();
        let rounded = round_positions(&source.positions, scale, origin_mm);
        let weld = weld(&rounded);
        report.welded_vertices = weld.iter().enumerate().filter(|&(i, &w)| i as u32 != w).count();

        let mut mesh = Mesh {
            origin_mm,
            local_mm: rounded.into_iter().map(Option::unwrap_or_default).collect(),
            triangles: source.triangles,
            triangle_material: source.triangle_material,
            materials: source.materials,
            normals: source.normals,
            uvs: source.uvs,
            weld,
        };
        let keep = triangles_to_keep(&mesh, &mut report);
        mesh.retain(&keep);
        if mesh.triangles.is_empty() {
            return Err(Error::input(format!(
                "none of the model's {} triangles has an area: {} have two corners in one place, {} are lines",
                report.source_triangles, report.collapsed_triangles, report.zero_area_triangles
            )));
        }
        let mut has_area = vec![false; mesh.weld.len()];
        for v in mesh.triangles.iter().flatten() {
            has_area[mesh.weld[*v as usize] as usize] = true;
        }
        report.vertices_without_area = mesh.weld.iter().filter(|&&w| !has_area[w as usize]).count();
        Ok((mesh, report))
    }

    /// Drops the triangles whose flag is false, with their corners in every attribute.
    fn retain(&mut self, keep: &[bool]) {
        if keep.iter().all(|&k| k) {
            return;
        }
        retain(&mut self.triangles, keep);
        retain(&mut self.triangle_material, keep);
        retain_corners(&mut self.normals, &mut self.uvs, keep);
    }
}

/// Indices of the named materials.
///
/// # Errors
/// Command line: a name that no material has; the message lists those that exist.
pub fn material_indices(materials: &[String], names: &[String], flag: &str) -> Result<Vec<u32>> {
    let find = |name: &String| {
        materials.iter().position(|m| m == name).map(|i| i as u32).ok_or_else(|| {
            let known: Vec<String> = materials.iter().map(|m| format!("'{m}'")).collect();
            Error::command_line(format!(
                "{flag} names the material '{name}', which the model does not have; it has {}",
                if known.is_empty() { "none".to_string() } else { known.join(", ") }
            ))
        })
    };
    names.iter().map(find).collect()
}

/// Drops the triangles of the named materials (`--skip`); vertices and the list of materials stay.
///
/// # Errors
/// Command line: an unknown name. Invalid input: nothing is left.
pub fn skip_materials(source: &mut SourceModel, names: &[String]) -> Result<()> {
    if names.is_empty() {
        return Ok(());
    }
    let skipped = material_indices(&source.materials, names, "--skip")?;
    let keep: Vec<bool> = source.triangle_material.iter().map(|m| !skipped.contains(m)).collect();
    if keep.len() != source.triangles.len() {
        return Err(Error::input("the model does not give each triangle a material"));
    }
    if !keep.contains(&true) {
        return Err(Error::input("--skip leaves no triangle of the model"));
    }
    retain(&mut source.triangles, &keep);
    retain(&mut source.triangle_material, &keep);
    retain_corners(&mut source.normals, &mut source.uvs, &keep);
    Ok(())
}

type Corners<T> = Option<CornerAttribute<T>>;

fn retain_corners(normals: &mut Corners<Vec3>, uvs: &mut Corners<Vec2>, keep: &[bool]) {
    normals.iter_mut().for_each(|normals| retain(&mut normals.corners, keep));
    uvs.iter_mut().for_each(|uvs| retain(&mut uvs.corners, keep));
}

fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    values.retain(|_| flags.next().copied().unwrap_or(false));
}

fn validate(source: &SourceModel) -> Result<()> {
    let triangles = source.triangles.len();
    if triangles > MAX_TRIANGLES || source.positions.len() >= u32::MAX as usize {
        return Err(Error::unsupported(format!(
            "the model has {triangles} triangles and {} vertices; at most {MAX_TRIANGLES} and {} are supported",
            source.positions.len(),
            u32::MAX - 1
        )));
    }
    if source.triangle_material.len() != triangles {
        return Err(Error::input("the model does not give each triangle a material"));
    }
    if let Some(m) = source.triangle_material.iter().find(|&&m| m as usize >= source.materials.len()) {
        return Err(Error::input(format!("a triangle uses material {m} of {}", source.materials.len())));
    }
    validate_attribute(source.normals.as_ref(), triangles, "normal")?;
    validate_attribute(source.uvs.as_ref(), triangles, "texture coordinate")
}

fn validate_attribute<T>(attribute: Option<&CornerAttribute<T>>, triangles: usize, what: &str) -> Result<()> {
    let Some(attribute) = attribute else { return Ok(()) };
    if attribute.corners.len() != triangles {
        return Err(Error::input(format!("{} triangles have a {what}, of {triangles}", attribute.corners.len())));
    }
    let count = attribute.values.len();
    match attribute.corners.iter().flatten().find(|&&i| i as usize >= count) {
        Some(i) => Err(Error::input(format!("a triangle uses {what} {i} of {count}"))),
        None => Ok(()),
    }
}

fn used_vertices(triangles: &[[u32; 3]], vertices: usize) -> Vec<bool> {
    let mut used = vec![false; vertices];
    for &v in triangles.iter().flatten() {
        used[v as usize] = true;
    }
    used
}

/// Offsets from the origin in single precision; none where they are not finite.
pub(super) fn round_positions(positions: &[DVec3], mm_per_unit: f64, origin_mm: DVec3) -> Vec<Option<Vec3>> {
    let round = |p: &DVec3| {
        let local = (*p * mm_per_unit - origin_mm).as_vec3();
        // Adding zero turns -0 into +0, so that equal places have equal bits.
        local.is_finite().then_some(local + Vec3::ZERO)
    };
    positions.iter().map(round).collect()
}

/// For each vertex the first vertex with the same bits; itself where it has no position.
fn weld(positions: &[Option<Vec3>]) -> Vec<u32> {
    const EMPTY: u32 = u32::MAX;
    let mask = (2 * positions.len()).next_power_of_two() - 1;
    let mut table = vec![EMPTY; mask + 1];
    let mut weld: Vec<u32> = (0..positions.len() as u32).collect();
    for (i, position) in positions.iter().enumerate() {
        let Some(p) = position else { continue };
        let low = u64::from(p.x.to_bits()) | u64::from(p.y.to_bits()) << 32;
        let mut slot = mix(mix(low) ^ u64::from(p.z.to_bits())) as usize & mask;
        loop {
            let other = table[slot];
            if other == EMPTY {
                table[slot] = i as u32;
                break;
            }
            if positions[other as usize] == *position {
                weld[i] = other;
                break;
            }
            slot = (slot + 1) & mask;
        }
    }
    weld
}

/// Flags of the triangles that stay; counts the others.
fn triangles_to_keep(mesh: &Mesh, report: &mut RepairReport) -> Vec<bool> {
    let resolution_mm = POSITION_RESOLUTION * mesh.diagonal_mm();
    let least_cross_mm2 = resolution_mm * resolution_mm;
    let mut keep = vec![true; mesh.triangles.len()];
    for (t, keep) in keep.iter_mut().enumerate() {
        let [a, b, c] = mesh.welded(t as u32);
        if a == b || b == c || c == a {
            report.collapsed_triangles += 1;
            *keep = false;
        } else if mesh.cross_mm2(t as u32).length() <= least_cross_mm2 {
            report.zero_area_triangles += 1;
            *keep = false;
        }
    }
    drop_duplicates(mesh, &mut keep, report);
    keep
}

/// Finds equal and reversed triangles: buckets by smallest corner, each sorted by the other two.
fn drop_duplicates(mesh: &Mesh, keep: &mut [bool], report: &mut RepairReport) {
    let kept: Vec<usize> = (0..keep.len()).filter(|&t| keep[t]).collect();
    // (second, third) corner in sorted order, then orientation and index.
    let row = |&t: &usize| {
        let ([smallest, second, third], reversed) = sorted_corners(mesh.welded(t as u32));
        (smallest, (u64::from(second) << 32 | u64::from(third), u64::from(reversed) << 32 | t as u64))
    };
    let rows = Buckets::new(mesh.weld.len(), || kept.iter().map(row)).sorted();
    for bucket in rows.all() {
        for pair in bucket.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            if pair[0].1 >> 32 == pair[1].1 >> 32 {
                keep[pair[1].1 as u32 as usize] = false;
                report.duplicate_triangles += 1;
            } else {
                report.reversed_twins += 1;
            }
        }
    }
}

/// The corners in ascending order, and whether the winding runs against it.
pub(super) fn sorted_corners(mut corners: [u32; 3]) -> ([u32; 3], bool) {
    let smallest = (0..3).min_by_key(|&i| corners[i]).unwrap_or(0);
    corners.rotate_left(smallest);
    let [first, second, third] = corners;
    ([first, second.min(third), second.max(third)], second > third)
}
