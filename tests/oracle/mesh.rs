//! Triangle meshes: an OBJ reader for `v` and `f` lines, scaling, and a few generated shapes.

use super::vector::{V3, add, cross, distance, dot, mul, normalised, sub};
use std::collections::HashMap;
use std::path::Path;

/// Positions and counter-clockwise triangles; vertex `i` is the file's `i`-th `v` line.
#[derive(Clone, Debug, Default)]
pub struct OracleMesh {
    pub positions: Vec<V3>,
    pub triangles: Vec<[u32; 3]>,
}

impl OracleMesh {
    /// Reads the `v` and `f` lines of an OBJ. Polygons become fans, so concave ones are not for this reader.
    ///
    /// # Panics
    /// On any file that is not what a test should feed it.
    pub fn read_obj(path: &Path) -> Self {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        Self::parse_obj(&text, &path.display().to_string())
    }

    /// The same from the text of the file called `name`.
    pub fn parse_obj(text: &str, name: &str) -> Self {
        let mut mesh = Self::default();
        for (line_number, line) in text.lines().enumerate() {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    let c: Vec<f64> = words.take(3).map(|w| w.parse().unwrap()).collect();
                    mesh.positions.push([c[0], c[1], c[2]]);
                }
                Some("f") => {
                    let corners: Vec<u32> = words
                        .map(|w| {
                            let i: i64 = w.split('/').next().unwrap().parse().unwrap();
                            let index = if i < 0 { mesh.positions.len() as i64 + i } else { i - 1 };
                            u32::try_from(index).unwrap()
                        })
                        .collect();
                    assert!(corners.len() >= 3, "{name}:{}: face with too few corners", line_number + 1);
                    for k in 1..corners.len() - 1 {
                        mesh.triangles.push([corners[0], corners[k], corners[k + 1]]);
                    }
                }
                _ => {}
            }
        }
        mesh
    }

    /// Scaled about its own origin so that the bounding box of the surface has the diagonal `size_mm`.
    pub fn scaled(&self, size_mm: f64) -> Self {
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &v in self.triangles.iter().flatten() {
            for k in 0..3 {
                lo[k] = lo[k].min(self.positions[v as usize][k]);
                hi[k] = hi[k].max(self.positions[v as usize][k]);
            }
        }
        let s = size_mm / distance(lo, hi);
        let positions = self.positions.iter().map(|p| p.map(|c| c * s)).collect();
        Self { positions, triangles: self.triangles.clone() }
    }

    /// Icosahedron subdivided `levels` times, vertices on the sphere of radius `radius_mm`.
    pub fn icosphere(levels: u32, radius_mm: f64) -> Self {
        let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
        let mut points: Vec<V3> = Vec::new();
        for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
            points.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
        }
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        for i in 0..12u32 {
            for j in i + 1..12 {
                for k in j + 1..12 {
                    let (a, b, c) = (points[i as usize], points[j as usize], points[k as usize]);
                    if [distance(a, b), distance(b, c), distance(c, a)].iter().all(|d| (d - 2.0).abs() < 1e-9) {
                        let outward = dot(cross(sub(b, a), sub(c, a)), a);
                        triangles.push(if outward > 0.0 { [i, j, k] } else { [i, k, j] });
                    }
                }
            }
        }
        for _ in 0..levels {
            let mut middle: HashMap<(u32, u32), u32> = HashMap::new();
            let mut split = |points: &mut Vec<V3>, a: u32, b: u32| {
                *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    points.push(mul(add(points[a as usize], points[b as usize]), 0.5));
                    points.len() as u32 - 1
                })
            };
            triangles = triangles
                .iter()
                .flat_map(|&[a, b, c]| {
                    let (ab, bc, ca) = (split(&mut points, a, b), split(&mut points, b, c), split(&mut points, c, a));
                    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                })
                .collect();
            points.iter_mut().for_each(|p| *p = normalised(*p));
        }
        let positions = points.iter().map(|&p| normalised(p).map(|c| c * radius_mm)).collect();
        Self { positions, triangles }
    }

    /// Torus about +Y with `n_major` x `n_minor` quads, outward normals.
    pub fn torus(major_mm: f64, minor_mm: f64, n_major: u32, n_minor: u32) -> Self {
        let mut mesh = Self::default();
        for i in 0..n_major {
            let u = std::f64::consts::TAU * f64::from(i) / f64::from(n_major);
            for j in 0..n_minor {
                let v = std::f64::consts::TAU * f64::from(j) / f64::from(n_minor);
                let r = major_mm + minor_mm * v.cos();
                mesh.positions.push([r * u.cos(), minor_mm * v.sin(), r * u.sin()]);
            }
        }
        let at = |i: u32, j: u32| (i % n_major) * n_minor + j % n_minor;
        for i in 0..n_major {
            for j in 0..n_minor {
                let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    /// Square of edge `edge_mm` in the plane y = 0, facing +Y, `n` x `n` quads centred at the origin.
    pub fn plane(edge_mm: f64, n: u32) -> Self {
        let mut mesh = Self::default();
        for i in 0..=n {
            for j in 0..=n {
                let c = |k: u32| edge_mm * (f64::from(k) / f64::from(n) - 0.5);
                mesh.positions.push([c(j), 0.0, c(i)]);
            }
        }
        for i in 0..n {
            for j in 0..n {
                let at = |i: u32, j: u32| i * (n + 1) + j;
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    /// Both meshes in one; vertices of `other` follow.
    pub fn joined(&self, other: &Self) -> Self {
        let offset = self.positions.len() as u32;
        let mut mesh = self.clone();
        mesh.positions.extend(&other.positions);
        mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + offset)));
        mesh
    }

    /// The three corners of triangle `t`.
    pub fn corners(&self, t: usize) -> [V3; 3] {
        self.triangles[t].map(|v| self.positions[v as usize])
    }
}
