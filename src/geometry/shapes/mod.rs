//! Generated models: shapes with known areas and topology, and the demonstration model.
//!
//! Every coordinate comes from additions, multiplications, divisions and square roots alone, which IEEE 754 defines to
//! the bit: the same call gives the same model on every machine. All shapes are closed and wound outwards unless they
//! say otherwise, have one material named `default` and no unit.

mod demo;
mod implicit;

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use super::source::SourceModel;

pub use demo::{demo_model, elephant};

/// Cosine and sine of a share of a full turn, by Taylor series within an eighth of a turn (error below 1e-15).
pub fn cos_sin_of_turn(turns: f64) -> DVec2 {
    let eighths = 8.0 * (turns - turns.floor());
    let octant = (eighths.floor() as u32).min(7);
    let part = eighths - f64::from(octant);
    // Odd octants are mirrored, so that the angle stays within [0, pi/4].
    let x = std::f64::consts::FRAC_PI_4 * if octant % 2 == 1 { 1.0 - part } else { part };
    let x2 = x * x;
    let series = |first: f64, start: u32| {
        let mut term = first;
        let mut sum = term;
        for k in 0..9 {
            let n = f64::from(start + 2 * k);
            term *= -x2 / (n * (n + 1.0));
            sum += term;
        }
        sum
    };
    let (cos, sin) = (series(1.0, 1), series(x, 2));
    let [x, y] = match octant {
        0 => [cos, sin],
        1 => [sin, cos],
        2 => [-sin, cos],
        3 => [-cos, sin],
        4 => [-cos, -sin],
        5 => [-sin, -cos],
        6 => [sin, -cos],
        _ => [cos, -sin],
    };
    DVec2::new(x, y)
}

/// A sphere from an icosahedron whose triangles are cut in four `subdivisions` times: 20 * 4^n triangles, 10 * 4^n + 2
/// vertices on the sphere. At most 9 subdivisions are made.
pub fn icosphere(radius: f64, subdivisions: u32) -> SourceModel {
    let phi = 0.5 * (1.0 + 5f64.sqrt());
    // Corners of three rectangles at right angles, and the faces between them.
    let corners = [
        -1.0, phi, 0.0, 1.0, phi, 0.0, -1.0, -phi, 0.0, 1.0, -phi, 0.0, 0.0, -1.0, phi, 0.0, 1.0, phi, 0.0, -1.0, -phi,
        0.0, 1.0, -phi, phi, 0.0, -1.0, phi, 0.0, 1.0, -phi, 0.0, -1.0, -phi, 0.0, 1.0,
    ];
    let faces = [
        0, 11, 5, 0, 5, 1, 0, 1, 7, 0, 7, 10, 0, 10, 11, 1, 5, 9, 5, 11, 4, 11, 10, 2, 10, 7, 6, 7, 1, 8, 3, 9, 4, 3,
        4, 2, 3, 2, 6, 3, 6, 8, 3, 8, 9, 4, 9, 5, 2, 4, 11, 6, 2, 10, 8, 6, 7, 9, 8, 1,
    ];
    let mut positions: Vec<DVec3> =
        corners.as_chunks::<3>().0.iter().map(|p| DVec3::from_array(*p).normalize()).collect();
    let mut triangles: Vec<[u32; 3]> = faces.as_chunks::<3>().0.to_vec();
    for _ in 0..subdivisions.min(9) {
        let mut middle: HashMap<(u32, u32), u32> = HashMap::new();
        let mut cut = |a: u32, b: u32| {
            *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for [a, b, c] in triangles {
            let (ab, bc, ca) = (cut(a, b), cut(b, c), cut(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    positions.iter_mut().for_each(|p| *p *= radius);
    SourceModel::new(positions, triangles)
}

/// A surface of revolution about +Y from the outline (radius, height), bottom pole to top pole; both poles are given
/// with radius 0.
fn revolve(outline: &[DVec2], segments: u32) -> SourceModel {
    let rings = outline.len() as u32 - 2;
    let mut positions = vec![DVec3::new(0.0, outline[0].y, 0.0)];
    for ring in &outline[1..outline.len() - 1] {
        for s in 0..segments {
            let around = cos_sin_of_turn(f64::from(s) / f64::from(segments)) * ring.x;
            positions.push(DVec3::new(around.y, ring.y, around.x));
        }
    }
    positions.push(DVec3::new(0.0, outline[outline.len() - 1].y, 0.0));
    let top = positions.len() as u32 - 1;
    let at = |ring: u32, s: u32| 1 + ring * segments + s % segments;
    let mut triangles = Vec::new();
    for s in 0..segments {
        triangles.push([0, at(0, s + 1), at(0, s)]);
        for ring in 1..rings {
            let [a, b, c, d] = [at(ring - 1, s), at(ring - 1, s + 1), at(ring, s + 1), at(ring, s)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.push([at(rings - 1, s), at(rings - 1, s + 1), top]);
    }
    SourceModel::new(positions, triangles)
}

/// A sphere of meridians and parallels, poles on the Y axis; at least 3 segments and 2 rings of faces.
pub fn uv_sphere(radius: f64, segments: u32, rings: u32) -> SourceModel {
    let rings = rings.max(2);
    let outline: Vec<DVec2> = (0..=rings)
        .map(|r| {
            let c = cos_sin_of_turn(0.5 * f64::from(r) / f64::from(rings));
            DVec2::new(c.y, -c.x) * radius
        })
        .collect();
    revolve(&outline, segments.max(3))
}

/// An axis-aligned box about the origin with each face cut into `divisions` squared rectangles of two triangles.
pub fn cuboid(size: DVec3, divisions: u32) -> SourceModel {
    let n = divisions.clamp(1, 1024);
    let mut index: HashMap<[u32; 3], u32> = HashMap::new();
    let mut positions = Vec::new();
    let mut vertex = |lattice: [u32; 3]| {
        *index.entry(lattice).or_insert_with(|| {
            positions.push((DVec3::from(lattice.map(f64::from)) / f64::from(n) - 0.5) * size);
            positions.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [0, n] {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let mut corner = |di: u32, dj: u32| {
                    let mut lattice = [0; 3];
                    lattice[axis] = side;
                    lattice[(axis + 1) % 3] = i + di;
                    lattice[(axis + 2) % 3] = j + dj;
                    vertex(lattice)
                };
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                let [b, d] = if side == 0 { [d, b] } else { [b, d] };
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    SourceModel::new(positions, triangles)
}

/// An open rectangle in the plane y = 0, facing +Y, centred at the origin, of `divisions` squared rectangles.
pub fn plane(size_x: f64, size_z: f64, divisions: u32) -> SourceModel {
    let n = divisions.clamp(1, 4096);
    let coordinate = |i: u32| f64::from(i) / f64::from(n) - 0.5;
    let positions = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| DVec3::new(coordinate(i) * size_x, 0.0, coordinate(j) * size_z)))
        .collect();
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let triangles = (0..n)
        .flat_map(|j| (0..n).map(move |i| [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]))
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    SourceModel::new(positions, triangles)
}

/// A closed tube: `frame(u)` gives centre and the two unit axes of the circular cross section at a share of the way.
fn tube(radius: f64, along: u32, around: u32, frame: impl Fn(f64) -> [DVec3; 3]) -> SourceModel {
    let mut positions = Vec::new();
    for i in 0..along {
        let [centre, x, y] = frame(f64::from(i) / f64::from(along));
        for j in 0..around {
            let c = cos_sin_of_turn(f64::from(j) / f64::from(around)) * radius;
            positions.push(centre + x * c.x + y * c.y);
        }
    }
    let at = |i: u32, j: u32| (i % along) * around + j % around;
    let triangles = (0..along)
        .flat_map(|i| (0..around).map(move |j| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]))
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    SourceModel::new(positions, triangles)
}

/// A torus about the Y axis: `along` segments around the axis, `around` around the tube.
pub fn torus(major: f64, minor: f64, along: u32, around: u32) -> SourceModel {
    tube(minor, along.max(3), around.max(3), |u| {
        let c = cos_sin_of_turn(u);
        let out = DVec3::new(c.y, 0.0, c.x);
        [out * major, out, DVec3::Y]
    })
}

/// A tube along the (p, q) torus knot: p turns about the Y axis, q about the core of a torus; coprime p and q give one
/// knot. `major` and `minor` are the torus, `radius` is the tube.
pub fn torus_knot(p: u32, q: u32, major: f64, minor: f64, radius: f64, along: u32, around: u32) -> SourceModel {
    let (p, q) = (f64::from(p.max(1)), f64::from(q.max(1)));
    tube(radius, along.max(3), around.max(3), |u| {
        let (a, b) = (cos_sin_of_turn(p * u), cos_sin_of_turn(q * u));
        let ring = major + minor * b.x;
        let tangent = DVec3::new(
            p * a.x * ring - q * a.y * minor * b.y,
            q * minor * b.x,
            -p * a.y * ring - q * a.x * minor * b.y,
        )
        .normalize();
        // The torus's own normal is never parallel to the knot.
        let out = DVec3::new(a.y * b.x, b.y, a.x * b.x);
        let x = (out - tangent * out.dot(tangent)).normalize();
        [DVec3::new(a.y * ring, minor * b.y, a.x * ring), x, x.cross(tangent)]
    })
}

/// A head-like blob of about the given radius: a sphere with a nose, a chin, ears, brows and a few dozen bumps.
/// The vertices are those of [`icosphere`].
pub fn bumpy_head(radius: f64, subdivisions: u32) -> SourceModel {
    let mut head = icosphere(1.0, subdivisions);
    // Direction, height and width of each bump, relative to the radius.
    let mut bumps: Vec<(DVec3, f64, f64)> = [
        ([0.0, -0.05, 1.0], 0.28, 0.32),
        ([0.0, -0.75, 0.66], 0.16, 0.5),
        ([1.0, 0.0, 0.0], 0.22, 0.3),
        ([-1.0, 0.0, 0.0], 0.22, 0.3),
        ([0.35, 0.35, 0.87], 0.1, 0.3),
        ([-0.35, 0.35, 0.87], 0.1, 0.3),
        ([0.33, 0.12, 0.94], -0.1, 0.25),
        ([-0.33, 0.12, 0.94], -0.1, 0.25),
        ([0.0, 0.5, -0.86], 0.14, 0.9),
    ]
    .map(|(d, height, width)| (DVec3::from(d).normalize(), height, width))
    .to_vec();
    let direction = |i: u32| {
        // Points of a Fibonacci spiral; the golden ratio's fraction of a turn from one to the next.
        let y = 1.0 - (2.0 * f64::from(i) + 1.0) / 40.0;
        let c = cos_sin_of_turn(0.618_033_988_749_894_9 * f64::from(i)) * (1.0 - y * y).sqrt();
        DVec3::new(c.x, y, c.y)
    };
    bumps.extend((0..40).map(|i| (direction(i), if i % 3 == 0 { -0.04 } else { 0.05 }, 0.35)));
    for p in &mut head.positions {
        let rise: f64 = bumps
            .iter()
            .map(|(direction, height, width)| {
                let inside = (1.0 - p.distance_squared(*direction) / (width * width)).max(0.0);
                height * inside * inside * inside
            })
            .sum();
        *p *= radius * (1.0 + rise);
    }
    head
}

/// Several models in one, each moved by its offset; materials of the same name become one.
pub fn compose(models: &[(SourceModel, DVec3)]) -> SourceModel {
    let mut whole = SourceModel::default();
    for (part, offset) in models {
        let first = whole.positions.len() as u32;
        let material: Vec<u32> = part
            .materials
            .iter()
            .map(|name| {
                whole.materials.iter().position(|m| m == name).unwrap_or_else(|| {
                    whole.materials.push(name.clone());
                    whole.materials.len() - 1
                }) as u32
            })
            .collect();
        whole.positions.extend(part.positions.iter().map(|p| *p + *offset));
        whole.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + first)));
        whole.triangle_material.extend(part.triangle_material.iter().map(|&m| material[m as usize]));
    }
    whole
}

/// A group with everything that scanned models have: the thin ears and the trunk of an [`elephant`], the hole of a ring, a thin
/// plate that its neighbours shadow. Three closed parts of the materials `elephant`, `ring` and `plate`, 92 mm, in millimetres;
/// `spacing_mm` is the length of the elephant's edges.
pub fn still_life(spacing_mm: f64) -> SourceModel {
    let ring = torus(9.0, 3.0, 36, 12).of_material("ring");
    let plate = cuboid(DVec3::new(64.0, 1.5, 24.0), 8).of_material("plate");
    let places = [DVec3::ZERO, DVec3::new(38.0, 14.0, 12.0), DVec3::new(18.0, -6.0, 8.0)];
    let whole = compose(&[(elephant(spacing_mm), places[0]), (ring, places[1]), (plate, places[2])]);
    SourceModel { metres_per_unit: Some(1e-3), ..whole }
}

/// The shape with the winding of its triangles reversed.
pub fn inside_out(mut shape: SourceModel) -> SourceModel {
    shape.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    shape
}

#[cfg(test)]
mod tests;
