//! How far a pose of a mesh is from its rest pose, in figures.

use glam::{DMat3, DQuat, DVec3};

use super::mesh::{EdgeTable, Mesh};
use crate::error::Result;
use crate::math::eigen::symmetric_eigen;

/// What a pose does to a mesh, over the triangles that count.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Deformation {
    /// Mean displacement of the vertices by area, mm.
    pub mean_mm: f64,
    /// Largest displacement, mm.
    pub max_mm: f64,
    /// The same beyond the rigid motion that fits the displacement best, if one brings the vertices nearer.
    pub mean_beyond_rigid_mm: f64,
    /// The same, of the vertex where it is largest.
    pub max_beyond_rigid_mm: f64,
    /// Length of an edge over that in the rest pose, of the edge that is stretched the most.
    pub longest_edge: f64,
    /// The same of the edge that is shortened the most.
    pub shortest_edge: f64,
    /// Area over that in the rest pose, less 1.
    pub area_change: f64,
    /// Volume over that in the rest pose, less 1; none where the surface is open or encloses nothing.
    pub volume_change: Option<f64>,
    /// Largest distance between vertices at one place of the rest pose, mm: above 0 where the pose tears the surface.
    pub torn_mm: f64,
}

impl Deformation {
    /// Compares two poses of a mesh; `counts` tells the triangles that do.
    ///
    /// # Errors
    /// Positions so large that their squares are not finite.
    pub fn new(rest: &Mesh, pose: &Mesh, counts: impl Fn(u32) -> bool) -> Result<Self> {
        let mut result = Self { longest_edge: 1.0, shortest_edge: 1.0, ..Self::default() };
        let mut areas = vec![0.0; rest.local_mm.len()];
        let (mut area, mut posed_area) = (0.0, 0.0);
        let (mut volume, mut posed_volume) = (0.0, 0.0);
        let mut stretch: Option<[f64; 2]> = None;
        let signed = |mesh: &Mesh, t: u32| mesh.corners_local_mm(t)[0].dot(mesh.cross_mm2(t)) / 6.0;
        for triangle in (0..rest.triangles.len() as u32).filter(|&t| counts(t)) {
            let own = rest.area_mm2(triangle);
            area += own;
            posed_area += pose.area_mm2(triangle);
            volume += signed(rest, triangle);
            posed_volume += signed(pose, triangle);
            rest.triangles[triangle as usize].iter().for_each(|&v| areas[v as usize] += own / 3.0);
            let (before, after) = (rest.corners_local_mm(triangle), pose.corners_local_mm(triangle));
            for (k, l) in [(0, 1), (1, 2), (2, 0)] {
                let ratio = after[k].distance(after[l]) / before[k].distance(before[l]).max(f64::MIN_POSITIVE);
                let [least, most] = stretch.unwrap_or([ratio; 2]);
                stretch = Some([least.min(ratio), most.max(ratio)]);
            }
        }
        if let Some([least, most]) = stretch {
            (result.shortest_edge, result.longest_edge) = (least, most);
        }
        if area > 0.0 {
            result.area_change = posed_area / area - 1.0;
        }
        let closed = || {
            EdgeTable::new(rest).edges().all(|edge| {
                let directions = edge.triangles().filter(|(t, _)| counts(*t)).map(|(_, direction)| direction);
                directions.sum::<i32>() == 0
            })
        };
        // Cancelled to rounding, a volume tells nothing.
        if volume.abs() > 1e-6 * area.powf(1.5) && closed() {
            result.volume_change = Some(posed_volume / volume - 1.0);
        }
        for (vertex, &weld) in rest.weld.iter().enumerate().filter(|(v, _)| areas[*v] > 0.0) {
            let apart = (pose.local_mm[vertex] - pose.local_mm[weld as usize]).as_dvec3().length();
            result.torn_mm = result.torn_mm.max(apart);
        }
        let places: Vec<(f64, DVec3, DVec3)> = areas
            .iter()
            .enumerate()
            .filter(|(_, weight)| **weight > 0.0)
            .map(|(v, weight)| (*weight, rest.position_mm(v as u32), pose.position_mm(v as u32)))
            .collect();
        let lengths = |moved: &dyn Fn(DVec3) -> DVec3| {
            let each = || places.iter().map(|(weight, from, to)| (weight, moved(*from).distance(*to)));
            let mean = each().map(|(weight, length)| weight * length).sum::<f64>();
            let weights = places.iter().map(|(weight, ..)| weight).sum::<f64>().max(f64::MIN_POSITIVE);
            (mean / weights, each().map(|(_, length)| length).fold(0.0, f64::max))
        };
        (result.mean_mm, result.max_mm) = lengths(&|from| from);
        if result.max_mm > 0.0 {
            let (turn, [before, after]) = rigid(&places)?;
            let (mean, max) = lengths(&|from| turn * (from - before) + after);
            // The fit is of squares: where most of the mesh stands still it may move that.
            let (mean, max) = if mean < result.mean_mm { (mean, max) } else { (result.mean_mm, result.max_mm) };
            (result.mean_beyond_rigid_mm, result.max_beyond_rigid_mm) = (mean, max);
        }
        Ok(result)
    }
}

/// The rotation, and the centres before and after, that bring weighted points nearest to others (Horn 1987, "Closed-form solution of
/// absolute orientation using unit quaternions").
fn rigid(places: &[(f64, DVec3, DVec3)]) -> Result<(DMat3, [DVec3; 2])> {
    let total = places.iter().map(|(weight, ..)| weight).sum::<f64>().max(f64::MIN_POSITIVE);
    let before = places.iter().map(|(weight, from, _)| *weight * *from).sum::<DVec3>() / total;
    let after = places.iter().map(|(weight, _, to)| *weight * *to).sum::<DVec3>() / total;
    // s[i][j]: products of component i before and j after.
    let mut s = [[0.0; 3]; 3];
    for (weight, from, to) in places {
        let (a, b) = (*from - before, *to - after);
        for (row, a) in s.iter_mut().zip(a.to_array()) {
            row.iter_mut().zip(b.to_array()).for_each(|(sum, b)| *sum += weight * a * b);
        }
    }
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = s;
    let matrix = [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ];
    let eigen = symmetric_eigen(&matrix.concat(), 4)?;
    let turn = match eigen.vectors.first().map(Vec::as_slice) {
        Some(&[w, x, y, z]) => DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()),
        _ => DMat3::IDENTITY,
    };
    Ok((turn, [before, after]))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::geometry::test_data::mesh_of;

    fn moved(mesh: &Mesh, to: impl Fn(DVec3) -> DVec3) -> Mesh {
        let positions: Vec<DVec3> = (0..mesh.local_mm.len() as u32).map(|v| to(mesh.position_mm(v))).collect();
        mesh.in_pose(&mesh.posed(&positions, 1.0).unwrap())
    }

    #[test]
    fn rigid_motions_are_taken_away_and_stretch_is_told() {
        let (mesh, _) = mesh_of(shapes::bumpy_head(8.0, 2));
        let none = Deformation::new(&mesh, &moved(&mesh, |p| p), |_| true).unwrap();
        let still =
            Deformation { longest_edge: 1.0, shortest_edge: 1.0, volume_change: Some(0.0), ..Deformation::default() };
        assert_eq!(none, still);
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 2.0);
        let rigid =
            Deformation::new(&mesh, &moved(&mesh, |p| turn * p + DVec3::new(3.0, 400.0, 0.0)), |_| true).unwrap();
        assert!(rigid.mean_mm > 300.0 && rigid.max_beyond_rigid_mm < 1e-4, "{rigid:?}");
        assert!((rigid.longest_edge - 1.0).abs() < 1e-4 && rigid.volume_change.unwrap().abs() < 1e-5, "{rigid:?}");
        let long = Deformation::new(&mesh, &moved(&mesh, |p| p * DVec3::new(1.0, 1.5, 1.0)), |_| true).unwrap();
        assert!((long.volume_change.unwrap() - 0.5).abs() < 1e-5, "{long:?}");
        assert!(long.longest_edge <= 1.5 + 1e-5 && long.longest_edge > 1.4 && long.shortest_edge > 0.99, "{long:?}");
        // A part that does not count does not.
        let nothing = Deformation::new(&mesh, &moved(&mesh, |p| 2.0 * p), |_| false).unwrap();
        assert_eq!((nothing.max_mm, nothing.volume_change), (0.0, None));
    }
}
