//! Rays at the corners of cells of a cube map, cells that are cut where the corners disagree, texels from what is between.

use glam::DVec3;

use super::shade::{Channel, add_channel, add_product};
use super::{Line, Request, VectorBaker, Work};
use crate::math::cube_map::{FACES, FRAMES};
use crate::medium::phase::LightTerms;

/// Cells along an edge of a face before any is cut: 11 degrees.
const COARSE: usize = 8;

/// No probe yet.
const NONE: u32 = u32::MAX;

/// Optical depths that differ by more than this over a cell are averaged as attenuations.
const UNEVEN: f32 = 0.5;

/// Directions of the corners of texels.
pub(super) struct Grid {
    side: usize,
    /// `[face][row][column]`, `side + 1` along each edge.
    directions: Vec<DVec3>,
}

impl Grid {
    pub(super) fn new(side: usize) -> Self {
        let at = |i: usize| 2.0 * i as f64 / side as f64 - 1.0;
        let corners = side + 1;
        let of = |i: usize| {
            let (face, y, x) = (i / corners / corners, i / corners % corners, i % corners);
            FRAMES[face % FACES].direction(at(x), at(y)).normalize()
        };
        Self { side, directions: (0..FACES * corners * corners).map(of).collect() }
    }

    fn corner(&self, face: usize, x: usize, y: usize) -> usize {
        (face * (self.side + 1) + y) * (self.side + 1) + x
    }
}

/// A square of texels at a depth.
#[derive(Clone, Copy, Debug)]
struct Cell {
    depth: u16,
    face: u8,
    x: u8,
    y: u8,
}

/// Memory of one thread.
#[derive(Default)]
pub(super) struct Memory {
    /// Probe of each corner, `[depth][corner]`.
    index: Vec<u32>,
    /// What each probe contributes at most in any channel, before the term.
    values: Vec<f32>,
    cells: Vec<Cell>,
    cut: Vec<Cell>,
    /// Whether anything arrives, `[depth][face]`.
    lit: Vec<bool>,
    /// `[depth]`.
    planes: Vec<super::shade::Planes>,
    picture: Vec<f32>,
}

/// One point.
pub(super) struct Adaptive<'a> {
    pub(super) baker: &'a VectorBaker<'a>,
    pub(super) line: &'a Line<'a>,
    pub(super) tolerance: f64,
}

impl Adaptive<'_> {
    /// Adds the vector of the point to `out`.
    pub(super) fn run(&self, work: &mut Work, out: &mut [f32]) {
        let grid = &self.baker.grid;
        let depths = self.line.depths.len();
        let corners = grid.directions.len();
        let memory = &mut work.adaptive;
        memory.index.clear();
        memory.index.resize(depths * corners, NONE);
        memory.lit.clear();
        memory.lit.resize(depths * FACES, false);
        memory.values.clear();
        while memory.planes.len() < depths {
            let terms = if self.is_constant() { 0 } else { self.baker.settings.phase.count() };
            memory.planes.push(super::shade::Planes::new(self.baker.texels(), terms));
        }
        work.probes.clear();
        work.terms.clear();
        let mut size = (grid.side / COARSE).max(1);
        self.first(size, work);
        let peak = work.adaptive.values.iter().fold(0.0f32, |most, v| most.max(*v));
        let limit = (self.tolerance * f64::from(peak)) as f32;
        loop {
            work.adaptive.cut.clear();
            work.requests.clear();
            for i in 0..work.adaptive.cells.len() {
                let cell = work.adaptive.cells[i];
                let found = self.corners(cell, size, &work.adaptive);
                let values = found.map(|p| work.adaptive.values.get(p).copied().unwrap_or(0.0));
                let (least, most) = values.iter().fold((f32::INFINITY, 0.0f32), |(l, m), &v| (l.min(v), m.max(v)));
                if size == 1 || most - least <= limit {
                    self.fill(cell, size, found, work);
                } else {
                    self.split(cell, size, work);
                }
            }
            if work.adaptive.cut.is_empty() {
                break;
            }
            self.trace(work);
            std::mem::swap(&mut work.adaptive.cells, &mut work.adaptive.cut);
            size /= 2;
        }
        self.shade(work, out);
    }

    /// Whether the only term is the same everywhere.
    fn is_constant(&self) -> bool {
        self.baker.settings.phase == LightTerms::Isotropic
    }

    /// All corners and cells of the coarsest size; the depths of one direction together, as their rays are alike.
    fn first(&self, size: usize, work: &mut Work) {
        let grid = &self.baker.grid;
        let depths = self.line.depths.len();
        let count = grid.side / size;
        work.requests.clear();
        work.adaptive.cells.clear();
        for face in 0..FACES {
            for (y, x) in (0..=count).flat_map(|y| (0..=count).map(move |x| (y, x))) {
                for depth in 0..depths {
                    self.ask(depth, face, x * size, y * size, work);
                    if x < count && y < count {
                        let [x, y] = [x * size, y * size].map(|i| i as u8);
                        work.adaptive.cells.push(Cell { depth: depth as u16, face: face as u8, x, y });
                    }
                }
            }
        }
        self.trace(work);
    }

    /// Makes sure that a corner is looked at.
    fn ask(&self, depth: usize, face: usize, x: usize, y: usize, work: &mut Work) {
        let grid = &self.baker.grid;
        let corner = grid.corner(face, x, y);
        if let Some(slot) = work.adaptive.index.get_mut(depth * grid.directions.len() + corner)
            && *slot == NONE
        {
            *slot = (work.probes.len() + work.requests.len()) as u32;
            work.requests.push(Request { depth: depth as u32, direction: grid.directions[corner] });
        }
    }

    fn trace(&self, work: &mut Work) {
        let first = work.probes.len();
        self.baker.trace(self.line, &work.requests, &mut work.tracer, &mut work.probes, &mut work.terms);
        let least = self.line.optics.sigma_t_per_mm.min_element();
        for (request, probe) in work.requests.iter().zip(&work.probes[first..]) {
            let weight = self.line.depths.get(request.depth as usize).map_or(0.0, |d| d.weight.max_element());
            let through = probe.through.iter().fold(0.0f32, |m, t| m.max(*t));
            let attenuated = (-least * f64::from(probe.path_mm)).exp();
            work.adaptive.values.push((weight * f64::from(probe.gain * through) * attenuated) as f32);
        }
    }

    /// Probes at the corners: upper left, upper right, lower left, lower right.
    fn corners(&self, cell: Cell, size: usize, memory: &Memory) -> [usize; 4] {
        let grid = &self.baker.grid;
        let (depth, face, x, y) = (cell.depth as usize, cell.face as usize, cell.x as usize, cell.y as usize);
        [(0, 0), (size, 0), (0, size), (size, size)].map(|(dx, dy)| {
            let at = depth * grid.directions.len() + grid.corner(face, x + dx, y + dy);
            memory.index.get(at).map_or(usize::MAX, |&i| i as usize)
        })
    }

    /// Asks for the middles of edges and of the cell, and leaves its quarters to be looked at.
    fn split(&self, cell: Cell, size: usize, work: &mut Work) {
        let half = size / 2;
        let (depth, face, x, y) = (cell.depth as usize, cell.face as usize, cell.x as usize, cell.y as usize);
        for (dx, dy) in [(half, 0), (0, half), (half, half), (size, half), (half, size)] {
            self.ask(depth, face, x + dx, y + dy, work);
        }
        for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
            work.adaptive.cut.push(Cell { x: (x + dx) as u8, y: (y + dy) as u8, ..cell });
        }
    }

    /// Enters what is between the corners of a cell into the planes of its depth.
    fn fill(&self, cell: Cell, size: usize, found: [usize; 4], work: &mut Work) {
        let side = self.baker.grid.side;
        let (depth, face, x0, y0) = (cell.depth as usize, cell.face as usize, cell.x as usize, cell.y as usize);
        let Some(planes) = work.adaptive.planes.get_mut(depth) else { return };
        let probes = found.map(|i| work.probes.get(i).copied().unwrap_or_default());
        let gains = probes.map(|p| p.through.map(|t| p.gain * t));
        let most = gains.map(|[r, g, b]| r.max(g).max(b));
        let lit = most.iter().any(|g| *g > 0.0);
        if lit && let Some(flag) = work.adaptive.lit.get_mut(depth * FACES + face) {
            *flag = true;
        }
        let sigma = self.line.optics.sigma_t_per_mm.min_element() as f32;
        let seen = || probes.iter().zip(&most).filter(|(_, g)| **g > 0.0).map(|(p, _)| p.path_mm);
        let (near, far) = seen().fold((f32::INFINITY, 0.0f32), |(l, m), p| (l.min(p), m.max(p)));
        let uneven = sigma * (far - near) > UNEVEN;
        let attenuations = probes.map(|p| if uneven { (-sigma * (p.path_mm - near)).exp() } else { 1.0 });
        let equal = self.baker.interior.crossings() == super::Crossings::Occluded;
        let (count, texels) = (self.baker.settings.phase.count(), self.baker.texels());
        let step = 1.0 / size as f32;
        for (iy, ix) in (0..size).flat_map(|iy| (0..size).map(move |ix| (iy, ix))) {
            let (u, v) = ((ix as f32 + 0.5) * step, (iy as f32 + 0.5) * step);
            let shares = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
            let texel = (face * side + y0 + iy) * side + x0 + ix;
            // Weighted by what arrives, so that a corner in the dark has no say about the way of the light.
            let weights: [f32; 4] = std::array::from_fn(|i| shares[i] * most[i] * attenuations[i]);
            let sum = weights[0] + weights[1] + weights[2] + weights[3];
            let [mut path, mut factor] = [0.0, 1.0];
            if sum > 0.0 {
                path = (0..4).map(|i| weights[i] * probes[i].path_mm).sum::<f32>() / sum;
                if uneven {
                    // Makes the clearest channel exact.
                    factor = (sigma * (path - near)).exp();
                }
            }
            planes.path_mm[texel] = path;
            for channel in 0..if equal { 1 } else { 3 } {
                let arriving: f32 = (0..4).map(|i| shares[i] * gains[i][channel] * attenuations[i]).sum();
                planes.gain[channel][texel] = arriving * factor;
            }
            if sum > 0.0 && !self.is_constant() {
                for k in 0..count {
                    let value = |i: usize| work.terms.get(found[i] * count + k).copied().unwrap_or(0.0);
                    planes.terms[k * texels + texel] = (0..4).map(|i| weights[i] * value(i)).sum::<f32>() / sum;
                }
            }
        }
    }

    /// From planes to the vector.
    fn shade(&self, work: &mut Work, out: &mut [f32]) {
        let side = self.baker.grid.side;
        let (count, texels, face) = (self.baker.settings.phase.count(), self.baker.texels(), side * side);
        let equal = self.baker.interior.crossings() == super::Crossings::Occluded;
        let mut constant = [0.0];
        self.baker.settings.phase.evaluate(self.line.point.normal, &mut constant);
        let term = if self.is_constant() { constant[0] } else { 1.0 };
        let memory = &mut work.adaptive;
        for (index, (depth, planes)) in self.line.depths.iter().zip(&memory.planes).enumerate() {
            for (f, lit) in memory.lit[index * FACES..(index + 1) * FACES].iter().enumerate() {
                for channel in (0..3).filter(|&c| *lit && depth.weight[c] > 0.0) {
                    let range = f * face..(f + 1) * face;
                    let source = Channel {
                        gain: &planes.gain[if equal { 0 } else { channel }][range.clone()],
                        path_mm: &planes.path_mm[range.clone()],
                        angles: &self.baker.angles,
                        weight: (depth.weight[channel] * term) as f32,
                        sigma_t_per_mm: self.line.optics.sigma_t_per_mm[channel] as f32,
                    };
                    if self.is_constant() {
                        add_channel(self.baker.level, &source, &mut out[channel * texels..][range]);
                        continue;
                    }
                    memory.picture.clear();
                    memory.picture.resize(face, 0.0);
                    add_channel(self.baker.level, &source, &mut memory.picture);
                    for k in 0..count {
                        let terms = &planes.terms[k * texels..][range.clone()];
                        let target = &mut out[(k * 3 + channel) * texels..][range.clone()];
                        add_product(self.baker.level, &memory.picture, terms, target);
                    }
                }
            }
        }
    }
}
