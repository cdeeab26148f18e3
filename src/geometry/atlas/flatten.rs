//! Other maps of charts than those that are as rigid as possible: conformal, and of even area.

use glam::{DVec2, DVec3};

use super::measure::squared_stretch;
use super::unwrap::{Charts, NONE};
use crate::geometry::mesh::Mesh;
use crate::parallel::*;

/// Most iterations of a linear solver: charts are small, and start from a map that is nearly right.
const MOST_ITERATIONS: usize = 2000;

/// Residual over its first at which a linear solver stops.
const TOLERANCE: f64 = 1e-8;

/// Most steps of the map of even area, of which the first few do nearly all.
const MOST_STEPS: usize = 30;

/// Most square roots that are taken of the stretch in a step: without any the step is the paper's, with them shorter.
const MOST_ROOTS: u32 = 2;

/// Which map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Conformal,
    Area,
}

/// One chart with numbers of its own for its points.
struct Chart {
    triangles: Vec<[u32; 3]>,
    corners: Vec<[DVec3; 3]>,
    places: Vec<DVec2>,
}

/// Gives each chart another map, which stays as it is where none is better.
pub(super) fn flatten(mesh: &Mesh, charts: &mut Charts, kind: Kind) {
    let mut order: Vec<(u32, u32)> = charts.of_triangle.iter().zip(0..).map(|(chart, t)| (*chart, t)).collect();
    order.retain(|(chart, _)| *chart != NONE);
    order.sort_unstable();
    let sets: Vec<&[(u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
    let of = |set: &&[(u32, u32)]| {
        let triangles = || set.iter().map(|(_, t)| charts.triangles[*t as usize]);
        let mut points: Vec<u32> = triangles().flatten().collect();
        points.sort_unstable();
        points.dedup();
        let local = |point: u32| points.partition_point(|p| *p < point) as u32;
        let mut chart = Chart {
            triangles: triangles().map(|corners| corners.map(local)).collect(),
            corners: set.iter().map(|(_, t)| mesh.corners_local_mm(*t)).collect(),
            places: points.iter().map(|p| charts.places[*p as usize]).collect(),
        };
        match kind {
            Kind::Conformal => chart.make_conformal(),
            Kind::Area => chart.make_even(),
        }
        (points, chart.places)
    };
    let places: Vec<(Vec<u32>, Vec<DVec2>)> = sets.par_iter().map(of).collect();
    for (points, places) in places {
        points.iter().zip(places).for_each(|(point, place)| charts.places[*point as usize] = place);
    }
}

impl Chart {
    fn doubled_area(&self, triangle: usize, places: &[DVec2]) -> f64 {
        let [a, b, c] = self.triangles[triangle].map(|p| places[p as usize]);
        (b - a).perp_dot(c - a)
    }

    /// Takes over other places unless a triangle turns over or nearly vanishes.
    fn accept(&mut self, places: Vec<DVec2>) -> bool {
        let areas = || (0..self.triangles.len()).map(|t| self.doubled_area(t, &places));
        let least = 1e-9 * areas().sum::<f64>() / self.triangles.len() as f64;
        let sound = places.iter().all(|p| p.is_finite()) && areas().all(|area| area > least);
        if sound {
            self.places = places;
        }
        sound
    }

    /// Least squares conformal map (Levy et al. 2002): least Dirichlet energy less area, two far points held.
    fn make_conformal(&mut self) {
        let edges: Vec<(usize, usize, f64)> = self.triangles.iter().zip(&self.corners).flat_map(cotangents).collect();
        let first = self.places[0];
        let farthest = |from: DVec2| {
            let far = |a: &usize, b: &usize| {
                let [a, b] = [a, b].map(|i| self.places[*i].distance_squared(from));
                a.total_cmp(&b)
            };
            (0..self.places.len()).max_by(far).unwrap_or(0)
        };
        let held = farthest(first);
        let held = [held, farthest(self.places[held])];
        let mut diagonal = vec![0.0; self.places.len()];
        for &(i, j, weight) in &edges {
            diagonal[i] += weight;
            diagonal[j] += weight;
        }
        let gradient = |x: &[DVec2], out: &mut [DVec2]| {
            out.fill(DVec2::ZERO);
            for &(i, j, weight) in &edges {
                let pull = weight * (x[i] - x[j]);
                // The area is half the sum of u_i v_j - u_j v_i over the edges.
                out[i] += pull + 0.5 * x[j].perp();
                out[j] -= pull + 0.5 * x[i].perp();
            }
            held.iter().for_each(|h| out[*h] = DVec2::ZERO);
        };
        let places = conjugate_gradients(gradient, &diagonal, self.places.clone());
        self.accept(places);
    }

    /// Evens out the stretch (Yoshizawa, Belyaev and Seidel 2004): each point is a weighted mean of its neighbours, and
    /// the weights are divided by the stretch around each neighbour as long as that lowers the whole. The boundary stays.
    ///
    /// The first weights are mean value coordinates (Floater 2003) in the map itself, so that it is what the steps begin
    /// with: the paper's first map onto a convex shape stretches more than they make good.
    fn make_even(&mut self) {
        let mut system = MeanSystem::new(&self.triangles, &self.places);
        let (mut least, mut stretch) = self.stretch();
        'steps: for _ in 0..MOST_STEPS {
            for roots in 0..=MOST_ROOTS {
                let (before, divided) = (self.places.clone(), system.divided(&stretch, roots));
                let solved = divided.solve(&self.places);
                if self.accept(solved) {
                    let (next, around) = self.stretch();
                    if next < least {
                        let gain = 1.0 - next / least;
                        (least, stretch, system) = (next, around, divided);
                        if gain < 1e-5 {
                            return;
                        }
                        continue 'steps;
                    }
                }
                self.places = before;
            }
            return;
        }
    }

    /// Squared stretch of the whole chart, mm^2, and the mean stretch around each point.
    fn stretch(&self) -> (f64, Vec<f64>) {
        let mut around = vec![[0.0; 2]; self.places.len()];
        let mut whole = 0.0;
        for (triangle, (points, corners)) in self.triangles.iter().zip(&self.corners).enumerate() {
            let map = points.map(|p| self.places[p as usize]);
            let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
            let stretch = area * squared_stretch(map, self.doubled_area(triangle, &self.places), *corners);
            whole += stretch;
            for p in points {
                around[*p as usize][0] += stretch;
                around[*p as usize][1] += area;
            }
        }
        (whole, around.iter().map(|[stretch, area]| (stretch / area).sqrt()).collect())
    }
}

/// The edges of a triangle with half the cotangent of the angle across.
fn cotangents((points, corners): (&[u32; 3], &[DVec3; 3])) -> [(usize, usize, f64); 3] {
    [0, 1, 2].map(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (a, b) = (corners[i] - corners[k], corners[j] - corners[k]);
        (points[i] as usize, points[j] as usize, 0.5 * a.dot(b) / a.cross(b).length())
    })
}

fn dot(a: &[DVec2], b: &[DVec2]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

/// Where a linear, positive semi-definite gradient vanishes, from a first guess.
fn conjugate_gradients(gradient: impl Fn(&[DVec2], &mut [DVec2]), diagonal: &[f64], mut x: Vec<DVec2>) -> Vec<DVec2> {
    let scaled = |r: &[DVec2]| -> Vec<DVec2> {
        r.iter().zip(diagonal).map(|(r, d)| if *d > 0.0 { *r / *d } else { *r }).collect()
    };
    let mut product = vec![DVec2::ZERO; x.len()];
    gradient(&x, &mut product);
    let mut residual: Vec<DVec2> = product.iter().map(|p| -*p).collect();
    let mut direction = scaled(&residual);
    let mut energy = dot(&residual, &direction);
    let end = energy * TOLERANCE * TOLERANCE;
    for _ in 0..MOST_ITERATIONS {
        gradient(&direction, &mut product);
        let curvature = dot(&direction, &product);
        if !(energy > end && curvature > 0.0) {
            break;
        }
        let step = energy / curvature;
        for i in 0..x.len() {
            x[i] += step * direction[i];
            residual[i] -= step * product[i];
        }
        let preconditioned = scaled(&residual);
        let next = dot(&residual, &preconditioned);
        direction.iter_mut().zip(&preconditioned).for_each(|(d, p)| *d = *p + (next / energy) * *d);
        energy = next;
    }
    x
}

/// Points as weighted means of their neighbours; those of the boundary are held.
#[derive(Clone)]
struct MeanSystem {
    /// For each inner point its neighbours, once a triangle, and their weights, positive; empty on the boundary.
    neighbours: Vec<Vec<(u32, f64)>>,
}

impl MeanSystem {
    /// Mean value coordinates of the inner points.
    fn new(triangles: &[[u32; 3]], places: &[DVec2]) -> Self {
        let edge = |t: &[u32; 3], k: usize| [t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3])];
        let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|t| [0, 1, 2].map(|k| edge(t, k))).collect();
        edges.sort_unstable();
        let mut held = vec![false; places.len()];
        for same in edges.chunk_by(|a, b| a == b).filter(|same| same.len() != 2) {
            same[0].iter().for_each(|point| held[*point as usize] = true);
        }
        let mut neighbours = vec![Vec::new(); places.len()];
        for triangle in triangles {
            for k in 0..3 {
                let [i, j, l] = [0, 1, 2].map(|m| triangle[(k + m) % 3]);
                if held[i as usize] {
                    continue;
                }
                let [a, b] = [j, l].map(|p| places[p as usize] - places[i as usize]);
                let tangent = (a.length() * b.length() - a.dot(b)) / a.perp_dot(b);
                neighbours[i as usize].extend([(j, tangent / a.length()), (l, tangent / b.length())]);
            }
        }
        Self { neighbours }
    }

    /// The system whose weights are divided by the stretch at the neighbours, or a root of it.
    fn divided(&self, stretch: &[f64], roots: u32) -> Self {
        let root = |n: u32| (0..roots).fold(stretch[n as usize], |value, _| value.sqrt());
        let row = |row: &Vec<(u32, f64)>| row.iter().map(|(n, weight)| (*n, weight / root(*n))).collect();
        Self { neighbours: self.neighbours.iter().map(row).collect() }
    }

    /// `x` less the means, over the inner points.
    fn residual(&self, x: &[DVec2], out: &mut [DVec2]) {
        for ((own, row), out) in x.iter().zip(&self.neighbours).zip(out) {
            let (mut sum, mut total) = (DVec2::ZERO, 0.0);
            for (n, weight) in row {
                sum += *weight * x[*n as usize];
                total += weight;
            }
            *out = if total > 0.0 { *own - sum / total } else { DVec2::ZERO };
        }
    }

    /// The places that meet the means, by stabilised biconjugate gradients (van der Vorst 1992) from a first guess.
    fn solve(&self, first: &[DVec2]) -> Vec<DVec2> {
        let (mut x, zero) = (first.to_vec(), vec![DVec2::ZERO; first.len()]);
        let (mut r, mut v, mut t, mut p) = (zero.clone(), zero.clone(), zero.clone(), zero);
        self.residual(&x, &mut r);
        r.iter_mut().for_each(|r| *r = -*r);
        let shadow = r.clone();
        let (mut rho, mut alpha, mut omega) = (1.0, 1.0, 1.0);
        let end = dot(&r, &r) * TOLERANCE * TOLERANCE;
        for _ in 0..MOST_ITERATIONS {
            let next = dot(&shadow, &r);
            let beta = next / rho * (alpha / omega);
            rho = next;
            for i in 0..p.len() {
                p[i] = r[i] + beta * (p[i] - omega * v[i]);
            }
            self.residual(&p, &mut v);
            alpha = rho / dot(&shadow, &v);
            r.iter_mut().zip(&v).for_each(|(r, v)| *r -= alpha * *v);
            self.residual(&r, &mut t);
            omega = dot(&t, &r) / dot(&t, &t);
            if !(alpha.is_finite() && omega.is_finite()) {
                break;
            }
            for i in 0..x.len() {
                x[i] += alpha * p[i] + omega * r[i];
                r[i] -= omega * t[i];
            }
            if dot(&r, &r) <= end {
                break;
            }
        }
        x
    }
}
