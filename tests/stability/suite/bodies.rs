//! Bodies of the suite, by our own code: sound ones, and those that scans and hands leave.

use glam::{DMat3, DVec3};
use translux::geometry::shapes::{bumpy_head, compose, cuboid, icosphere, inside_out, plane, uv_sphere};
use translux::geometry::source::SourceModel;
use translux::math::random::uniform;

/// The head that most rows use: 642 vertices.
pub fn head() -> SourceModel {
    bumpy_head(1.0, 3)
}

/// A sheet of 30 x 30 x 0.6 in the plane z = 0.
pub fn sheet() -> SourceModel {
    cuboid(DVec3::new(30.0, 30.0, 0.6), 16)
}

/// Two slabs that face each other over a gap of 1.
pub fn facing_walls() -> SourceModel {
    let slab = || cuboid(DVec3::new(16.0, 16.0, 4.0), 8);
    compose(&[(slab(), DVec3::new(0.0, 0.0, -2.5)), (slab(), DVec3::new(0.0, 0.0, 2.5))])
}

/// A ball within another, each of a material of its own.
pub fn nested() -> SourceModel {
    let outer = icosphere(10.0, 3).of_material("outer");
    compose(&[(outer, DVec3::ZERO), (icosphere(5.0, 2).of_material("inner"), DVec3::ZERO)])
}

/// A ball with a bubble.
pub fn cavity() -> SourceModel {
    compose(&[(icosphere(10.0, 3), DVec3::ZERO), (inside_out(icosphere(6.0, 3)), DVec3::ZERO)])
}

/// Two cubes face to face.
pub fn touching() -> SourceModel {
    let cube = || cuboid(DVec3::splat(10.0), 8);
    compose(&[(cube(), DVec3::new(-5.0, 0.0, 0.0)), (cube(), DVec3::new(5.0, 0.0, 0.0))])
}

/// The upper half of a ball, open below.
pub fn open() -> SourceModel {
    kept(icosphere(10.0, 3), |centre| centre.y > 0.0)
}

/// An open plane.
pub fn open_plane() -> SourceModel {
    plane(20.0, 20.0, 16)
}

/// Two cubes that share an edge of four triangles.
pub fn non_manifold() -> SourceModel {
    let cube = || cuboid(DVec3::splat(10.0), 6);
    compose(&[(cube(), DVec3::ZERO), (cube(), DVec3::new(10.0, 10.0, 0.0))])
}

/// Every triangle twice.
pub fn duplicated() -> SourceModel {
    compose(&[(icosphere(10.0, 3), DVec3::ZERO), (icosphere(10.0, 3), DVec3::ZERO)])
}

/// The head with 30 % of its triangles turned over.
pub fn mixed_winding() -> SourceModel {
    let mut model = head();
    for (index, triangle) in model.triangles.iter_mut().enumerate() {
        if uniform(91, index as u64, 0) < 0.3 {
            triangle.swap(1, 2);
        }
    }
    model
}

/// A ball whose triangles are 60 times as large at the bottom as at the top.
pub fn uneven() -> SourceModel {
    let mut model = icosphere(1.0, 3);
    for p in &mut model.positions {
        // Heights crowd towards the top; the points stay on the ball.
        let height = 1.0 - 2.0 * (0.5 * (1.0 - p.y)).powf(1.8);
        let around = DVec3::new(p.x, 0.0, p.z).normalize_or_zero();
        *p = (around * (1.0 - height * height).max(0.0).sqrt() + DVec3::Y * height) * 10.0;
    }
    model
}

/// A ball of long, thin triangles.
pub fn slivers() -> SourceModel {
    uv_sphere(10.0, 120, 6)
}

/// A cube of twelve triangles.
pub fn cube() -> SourceModel {
    cuboid(DVec3::splat(20.0), 1)
}

/// One triangle.
pub fn triangle() -> SourceModel {
    SourceModel::new(vec![DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.9, 0.3)], vec![[0, 1, 2]])
}

/// The head, turned by an odd angle.
pub fn turned() -> SourceModel {
    let mut model = head();
    let turn = DMat3::from_axis_angle(DVec3::new(0.3, 0.8, 0.52).normalize(), 0.7);
    model.positions.iter_mut().for_each(|p| *p = turn * *p);
    model
}

/// The head, far from the origin.
pub fn far_off() -> SourceModel {
    let mut model = head();
    model.positions.iter_mut().for_each(|p| *p += DVec3::new(3e4, -2e4, 1e4));
    model
}

/// The head with its vertices in another order.
pub fn shuffled() -> SourceModel {
    let model = head();
    let mut order: Vec<usize> = (0..model.positions.len()).collect();
    order.sort_by(|&a, &b| uniform(92, a as u64, 0).total_cmp(&uniform(92, b as u64, 0)));
    let mut place = vec![0u32; order.len()];
    order.iter().enumerate().for_each(|(new, &old)| place[old] = new as u32);
    let positions = order.iter().map(|&old| model.positions[old]).collect();
    let triangles = model.triangles.iter().rev().map(|t| t.map(|v| place[v as usize])).collect();
    SourceModel::new(positions, triangles)
}

/// 1.3 million triangles.
pub fn a_million() -> SourceModel {
    bumpy_head(1.0, 8)
}

/// The triangles whose centre passes a test, with their vertices alone.
fn kept(model: SourceModel, passes: impl Fn(DVec3) -> bool) -> SourceModel {
    let centre = |t: &[u32; 3]| t.iter().map(|&v| model.positions[v as usize]).sum::<DVec3>() / 3.0;
    let mut place = vec![u32::MAX; model.positions.len()];
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for triangle in model.triangles.iter().filter(|t| passes(centre(t))) {
        triangles.push(triangle.map(|v| {
            let place = &mut place[v as usize];
            if *place == u32::MAX {
                *place = positions.len() as u32;
                positions.push(model.positions[v as usize]);
            }
            *place
        }));
    }
    SourceModel::new(positions, triangles)
}
