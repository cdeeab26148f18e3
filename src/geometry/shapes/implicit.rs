//! Closed meshes from implicit functions: a dual grid of quads (naive surface nets, Gibson 1998), relaxed on the surface.

use glam::{DVec3, IVec3};

use crate::geometry::source::SourceModel;
use crate::parallel::*;

/// Grid that an implicit function is sampled on.
pub(super) struct Grid {
    /// Corner with the smallest coordinates.
    pub min: DVec3,
    /// Corner with the largest coordinates, at least; the surface must lie strictly inside.
    pub max: DVec3,
    /// Edge of a cell.
    pub spacing: f64,
}

/// Rounds of relaxation: evens out the triangles, then returns the vertices to the surface.
const RELAXATIONS: usize = 8;

/// Meshes the zero set of `f` (negative inside, and near the surface about the distance from it).
pub(super) fn mesh(f: &(dyn Fn(DVec3) -> f64 + Sync), grid: &Grid) -> SourceModel {
    let cells = ((grid.max - grid.min) / grid.spacing).ceil().as_ivec3();
    let lattice = cells + IVec3::ONE;
    let index = |i: IVec3| ((i.z * lattice.y + i.y) * lattice.x + i.x) as usize;
    let at = |i: IVec3| grid.min + i.as_dvec3() * grid.spacing;
    let values = sample(f, grid, lattice);

    let (mut positions, vertex_of) = cell_vertices(&values, cells, &index, &at);
    let quads = quads(&values, lattice, &index, &vertex_of);
    let neighbours = neighbours(&quads, positions.len());
    for _ in 0..RELAXATIONS {
        positions = (0..positions.len())
            .into_par_iter()
            .map(|v| relaxed(f, &positions, positions[v], &neighbours[v], grid.spacing))
            .collect();
    }
    positions.par_iter_mut().for_each(|p| {
        for _ in 0..3 {
            let g = gradient(f, *p, grid.spacing);
            *p = onto_surface(f, *p, g, grid.spacing);
        }
    });
    let triangles = quads.iter().flat_map(|&quad| cut(quad, &positions)).collect();
    SourceModel::new(positions, triangles)
}

/// Cells along the edge of a block that is sampled or skipped as one.
const BLOCK: i32 = 8;

/// Values at the lattice points. A block whose centre is far from the surface is filled with the value there: only signs
/// and the neighbourhood of the surface matter.
fn sample(f: &(dyn Fn(DVec3) -> f64 + Sync), grid: &Grid, lattice: IVec3) -> Vec<f64> {
    let at = |i: IVec3| grid.min + i.as_dvec3() * grid.spacing;
    let reach = 0.5 * f64::from(BLOCK) * grid.spacing * 3f64.sqrt();
    let blocks = (lattice + IVec3::splat(BLOCK - 1)) / BLOCK;
    let slab = |bz: i32| {
        let depth = BLOCK.min(lattice.z - bz * BLOCK);
        let mut slab = vec![0.0; (lattice.x * lattice.y * depth) as usize];
        for (by, bx) in (0..blocks.y).flat_map(|by| (0..blocks.x).map(move |bx| (by, bx))) {
            let first = IVec3::new(bx, by, bz) * BLOCK;
            let last = (first + IVec3::splat(BLOCK)).min(lattice);
            let centre = f(0.5 * (at(first) + at(first + IVec3::splat(BLOCK - 1))));
            // Twice the reach: the functions are distances only nearly.
            let skip = centre.abs() > 2.0 * reach;
            for z in first.z..last.z {
                for y in first.y..last.y {
                    for x in first.x..last.x {
                        let value = if skip { centre } else { f(at(IVec3::new(x, y, z))) };
                        slab[(((z - first.z) * lattice.y + y) * lattice.x + x) as usize] = value;
                    }
                }
            }
        }
        slab
    };
    (0..blocks.z).into_par_iter().flat_map_iter(slab).collect()
}

/// A vertex in each cell that the surface crosses, at the mean of its crossings with the cell's edges.
fn cell_vertices(
    values: &[f64],
    cells: IVec3,
    index: &impl Fn(IVec3) -> usize,
    at: &impl Fn(IVec3) -> DVec3,
) -> (Vec<DVec3>, Vec<u32>) {
    let corner = |c: usize| IVec3::new((c & 1) as i32, (c >> 1 & 1) as i32, (c >> 2) as i32);
    let mut positions = Vec::new();
    let mut vertex_of = vec![u32::MAX; values.len()];
    for z in 0..cells.z {
        for y in 0..cells.y {
            for x in 0..cells.x {
                let cell = IVec3::new(x, y, z);
                let value: [f64; 8] = std::array::from_fn(|c| values[index(cell + corner(c))]);
                let inside = value.iter().filter(|v| **v < 0.0).count();
                if inside == 0 || inside == 8 {
                    continue;
                }
                let mut sum = DVec3::ZERO;
                let mut count = 0.0;
                for (a, b) in (0..8usize).flat_map(|a| [1, 2, 4].map(|bit| (a, a | bit))).filter(|(a, b)| a != b) {
                    if (value[a] < 0.0) != (value[b] < 0.0) {
                        let t = value[a] / (value[a] - value[b]);
                        sum += at(cell + corner(a)).lerp(at(cell + corner(b)), t);
                        count += 1.0;
                    }
                }
                vertex_of[index(cell)] = positions.len() as u32;
                positions.push(sum / count);
            }
        }
    }
    (positions, vertex_of)
}

/// A quad of the four cells around each lattice edge that crosses the surface, wound outwards.
fn quads(values: &[f64], lattice: IVec3, index: &impl Fn(IVec3) -> usize, vertex_of: &[u32]) -> Vec<[u32; 4]> {
    let mut quads = Vec::new();
    for z in 1..lattice.z - 1 {
        for y in 1..lattice.y - 1 {
            for x in 1..lattice.x - 1 {
                let i = IVec3::new(x, y, z);
                let here = values[index(i)] < 0.0;
                for axis in 0..3 {
                    if here == (values[index(i + IVec3::AXES[axis])] < 0.0) {
                        continue;
                    }
                    let (u, v) = (IVec3::AXES[(axis + 1) % 3], IVec3::AXES[(axis + 2) % 3]);
                    let quad = [i, i - u, i - u - v, i - v].map(|cell| vertex_of[index(cell)]);
                    // Counter-clockwise about +axis, which points outwards where this end is inside.
                    quads.push(if here { quad } else { [quad[0], quad[3], quad[2], quad[1]] });
                }
            }
        }
    }
    quads
}

fn neighbours(quads: &[[u32; 4]], vertices: usize) -> Vec<Vec<u32>> {
    let mut neighbours = vec![Vec::new(); vertices];
    for quad in quads {
        for k in 0..4 {
            neighbours[quad[k] as usize].push(quad[(k + 1) % 4]);
        }
    }
    neighbours
}

/// Moves a vertex towards the mean of its neighbours along the surface, then back onto the surface.
fn relaxed(f: &dyn Fn(DVec3) -> f64, positions: &[DVec3], p: DVec3, around: &[u32], spacing: f64) -> DVec3 {
    let mean = around.iter().map(|&n| positions[n as usize]).sum::<DVec3>() / around.len().max(1) as f64;
    let g = gradient(f, p, spacing);
    let normal = g.normalize_or_zero();
    let offset = mean - p;
    onto_surface(f, p + 0.5 * (offset - normal * offset.dot(normal)), g, spacing)
}

/// The gradient from four values around a point, at the corners of a tetrahedron.
fn gradient(f: &dyn Fn(DVec3) -> f64, p: DVec3, spacing: f64) -> DVec3 {
    let step = 1e-3 * spacing;
    let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(DVec3::from);
    corners.into_iter().map(|d| d * f(p + d * step)).sum::<DVec3>() / (4.0 * step)
}

/// One Newton step towards the surface, no longer than half a cell.
fn onto_surface(f: &dyn Fn(DVec3) -> f64, p: DVec3, gradient: DVec3, spacing: f64) -> DVec3 {
    let back = gradient * (f(p) / gradient.length_squared().max(1e-6));
    p - back.clamp_length_max(0.5 * spacing)
}

/// Two triangles of a quad, along its shorter diagonal.
fn cut([a, b, c, d]: [u32; 4], positions: &[DVec3]) -> [[u32; 3]; 2] {
    let length = |u: u32, v: u32| positions[u as usize].distance_squared(positions[v as usize]);
    if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[b, c, d], [b, d, a]] }
}
