//! The demonstration model: a small elephant with wide thin ears, which glow when the light is behind them.

use glam::DVec3;

use super::implicit::{Grid, mesh};
use crate::geometry::source::SourceModel;

/// Cell of the sampling grid in mm.
const SPACING_MM: f64 = 0.76;

/// A toy elephant of about 60 mm: closed, smooth, facing +Z, standing on y = 0; units are millimetres.
///
/// Its thick body lets little light through, its ears (about 2 mm thick), trunk and tail much.
pub fn demo_model() -> SourceModel {
    elephant(SPACING_MM)
}

/// The demonstration model of triangles about `spacing_mm` long. With a coarser spacing it is still closed, but a few
/// edges between thin parts have four faces (two at 1.5 mm).
pub fn elephant(spacing_mm: f64) -> SourceModel {
    let grid = Grid { min: DVec3::new(-32.0, -2.0, -30.0), max: DVec3::new(32.0, 50.0, 38.0), spacing: spacing_mm };
    let elephant = Elephant::new();
    let model = mesh(&|p| elephant.distance(p), &grid).of_material("elephant");
    SourceModel { metres_per_unit: Some(1e-3), ..model }
}

/// Smooth minimum over a blend of width `k` (cubic): joins two solids with a fillet.
fn blend(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * h * k / 6.0
}

/// Smooth maximum: the intersection of two solids with a rounded edge.
fn cut(a: f64, b: f64, k: f64) -> f64 {
    -blend(-a, -b, k)
}

/// About the distance from an ellipsoid with semi-axes `r`.
fn ellipsoid(p: DVec3, centre: DVec3, r: DVec3) -> f64 {
    let q = p - centre;
    let k0 = (q / r).length();
    let k1 = (q / (r * r)).length();
    if k1 > 0.0 { k0 * (k0 - 1.0) / k1 } else { -r.min_element() }
}

/// About the distance from a limb whose radius goes from `ra` at `a` to `rb` at `b`.
fn limb(p: DVec3, a: DVec3, b: DVec3, ra: f64, rb: f64) -> f64 {
    let axis = b - a;
    let t = ((p - a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    p.distance(a + axis * t) - (ra + (rb - ra) * t)
}

/// A limb along a smooth curve, as many short pieces, in a box.
struct Curve {
    nodes: Vec<(DVec3, f64)>,
    centre: DVec3,
    reach: f64,
}

impl Curve {
    /// The Catmull-Rom spline through points and radii.
    fn new(through: &[(DVec3, f64)]) -> Self {
        const PIECES: i32 = 4;
        let last = through.len() as i32 - 1;
        let at = |i: i32| through[i.clamp(0, last) as usize];
        let mut nodes = Vec::new();
        for i in 0..last {
            let [a, b, c, d] = [at(i - 1), at(i), at(i + 1), at(i + 2)];
            for k in 0..PIECES {
                let t = f64::from(k) / f64::from(PIECES);
                let weight = [
                    0.5 * t * (t * (2.0 - t) - 1.0),
                    0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
                    0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
                    0.5 * t * t * (t - 1.0),
                ];
                nodes.push((
                    a.0 * weight[0] + b.0 * weight[1] + c.0 * weight[2] + d.0 * weight[3],
                    a.1 * weight[0] + b.1 * weight[1] + c.1 * weight[2] + d.1 * weight[3],
                ));
            }
        }
        nodes.push(at(last));
        let centre = nodes.iter().map(|n| n.0).sum::<DVec3>() / nodes.len() as f64;
        let reach = nodes.iter().map(|n| n.0.distance(centre) + n.1).fold(0.0, f64::max);
        Self { nodes, centre, reach }
    }

    fn distance(&self, p: DVec3) -> f64 {
        // Far away the bounding sphere will do: no blend reaches that far.
        let far = p.distance(self.centre) - self.reach;
        if far > 8.0 {
            return far;
        }
        self.nodes.windows(2).map(|n| limb(p, n[0].0, n[1].0, n[0].1, n[1].1)).fold(f64::INFINITY, f64::min)
    }
}

/// A shape and its mirror image in the plane x = 0, without a crease between them.
fn pair(p: DVec3, k: f64, shape: impl Fn(DVec3) -> f64) -> f64 {
    blend(shape(p), shape(v(-p.x, p.y, p.z)), k)
}

const fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

const TRUNK: [(DVec3, f64); 8] = [
    (v(0.0, 29.0, 17.0), 5.0),
    (v(0.0, 23.5, 21.5), 4.2),
    (v(0.2, 17.5, 24.0), 3.6),
    (v(0.9, 12.0, 25.6), 3.1),
    (v(2.3, 8.2, 27.8), 2.75),
    (v(4.6, 7.4, 30.4), 2.5),
    (v(6.9, 9.6, 32.2), 2.3),
    (v(8.0, 13.0, 32.6), 2.25),
];

const TUSK: [(DVec3, f64); 3] = [(v(4.4, 25.0, 17.5), 1.7), (v(5.7, 20.5, 21.5), 1.5), (v(6.0, 18.6, 25.0), 1.25)];

const TAIL: [(DVec3, f64); 4] =
    [(v(0.0, 24.0, -20.0), 1.9), (v(0.3, 19.0, -24.0), 1.5), (v(1.2, 13.5, -25.3), 1.35), (v(2.4, 10.5, -25.6), 1.7)];

/// The whole animal.
struct Elephant {
    trunk: Curve,
    tail: Curve,
    tusk: Curve,
}

impl Elephant {
    fn new() -> Self {
        Self { trunk: Curve::new(&TRUNK), tail: Curve::new(&TAIL), tusk: Curve::new(&TUSK) }
    }

    /// About the distance from its surface, negative inside.
    fn distance(&self, p: DVec3) -> f64 {
        let body = blend(
            ellipsoid(p, v(0.0, 21.0, -9.0), v(13.0, 12.5, 13.5)),
            ellipsoid(p, v(0.0, 22.0, 1.0), v(11.5, 11.5, 10.5)),
            8.0,
        );
        let legs = pair(p, 3.0, |p| {
            let front = limb(p, v(6.6, 15.0, 4.0), v(7.2, 1.0, 5.0), 5.0, 5.4);
            front.min(limb(p, v(7.0, 15.0, -13.0), v(7.6, 1.0, -13.5), 5.6, 5.6))
        });
        // Feet are flat on the ground.
        let standing = cut(blend(body, legs, 5.0), -p.y, 1.6);
        let domes = pair(p, 5.0, |p| ellipsoid(p, v(3.4, 38.2, 10.0), v(5.0, 4.5, 5.2)));
        let head = blend(ellipsoid(p, v(0.0, 31.5, 11.0), v(9.8, 10.0, 9.4)), domes, 5.0);
        let cheeks = pair(p, 3.0, |p| ellipsoid(p, v(4.2, 26.5, 15.0), v(4.6, 4.2, 4.6)));
        let face = blend(blend(head, cheeks, 4.0), self.trunk.distance(p), 4.5);
        // These are far from the plane of symmetry: a mirrored point needs no blend.
        let m = v(p.x.abs(), p.y, p.z);
        let eye = m.distance(v(6.1, 32.6, 18.0)) - 1.4;
        let front = blend(blend(blend(face, self.tusk.distance(m), 1.4), eye, 0.5), ear(m), 2.6);
        blend(blend(standing, front, 5.0), self.tail.distance(p), 1.8)
    }
}

/// The ear on the +X side: a cupped plate, thick at the head and thin at the rim.
fn ear(m: DVec3) -> f64 {
    // Plate axes: `across` away from the head and a little backwards, `up`, and the normal to the front.
    const ACROSS: DVec3 = v(0.939_692_620_785_908_4, 0.0, -0.342_020_143_325_668_7);
    const FRONT: DVec3 = v(0.342_020_143_325_668_7, 0.0, 0.939_692_620_785_908_4);
    let q = m - v(7.6, 32.5, 9.5);
    let (x, y, z) = (q.dot(ACROSS), q.y, q.dot(FRONT));
    // The rim bends forwards, the lower lobe more.
    let bend = 0.012 * (x - 4.0) * (x - 4.0) + 0.006 * (y - 2.0) * (y - 2.0);
    let disc = |cx: f64, cy: f64, rx: f64, ry: f64| {
        let (dx, dy) = ((x - cx) / rx, (y - cy) / ry);
        ((dx * dx + dy * dy).sqrt() - 1.0) * rx.min(ry)
    };
    let outline = blend(disc(9.0, 2.5, 11.0, 10.5), disc(7.0, -7.5, 6.6, 8.5), 5.0);
    let half_thickness = 1.9 - 0.85 * (x / 12.0).clamp(0.0, 1.0);
    cut((z - bend).abs() - half_thickness, outline, 1.6)
}
