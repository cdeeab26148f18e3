//! Rays at the corners of cells of a cube map; cells are cut where corners disagree, texels are interpolated inside.

use glam::{DVec3, Vec3};

use super::super::interface::refracted;
use super::super::interior::Crossings;
use super::probes::{Line, Probe, ProbeMemory, Prober, Request};
use super::shade::{Channel, Medium, Planes, add_channel, add_product, refract};

use crate::math::cube_map::{FACES, FRAMES, direction};
use crate::medium::phase::{LightTerms, MOST_TERMS};

/// Cells along an edge of a face before any is cut: 11 degrees.
const COARSE: usize = 8;

/// No probe yet.
const NONE: u32 = u32::MAX;

/// Corners that contribute less than this share of the brightest of their cell are dark.
const DARK: f32 = 0.02;

/// Corners that contribute less than this share of the brightest weigh less in the plane of a cell.
const FAINT: f32 = 0.1;

/// A dark corner whose direction is at most this cosine above the plane of the others is below their horizon.
const HORIZON: f32 = 0.02;

/// Directions of the corners of texels.
pub(super) struct Grid {
    side: usize,
    /// Directions of the corners, `[face][row][column]`, `side + 1` along each edge.
    directions: Vec<DVec3>,
    /// Directions of the centres of texels.
    centres: Vec<Vec3>,
}

impl Grid {
    pub(super) fn new(side: usize) -> Self {
        let at = |i: usize| 2.0 * i as f64 / side as f64 - 1.0;
        let corners = side + 1;
        let of = |i: usize| {
            let (face, y, x) = (i / corners / corners, i / corners % corners, i % corners);
            FRAMES[face % FACES].direction(at(x), at(y)).normalize()
        };
        let centre = |i: usize| direction(side, i / side / side, i % side, i / side % side).as_vec3();
        Self {
            side,
            directions: (0..FACES * corners * corners).map(of).collect(),
            centres: (0..FACES * side * side).map(centre).collect(),
        }
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

/// Arrival of light at a corner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Light {
    /// The light arrives.
    Free,
    /// The light would arrive through the plane of the other corners, but does not.
    #[default]
    Hidden,
    /// The direction is below the horizon of the plane of the other corners.
    BelowHorizon,
}

/// The corners of a cell: upper left, upper right, lower left, lower right.
#[derive(Clone, Copy, Debug, Default)]
struct Patch {
    probes: [Probe; 4],
    light: [Light; 4],
    /// Weight of each corner in the plane of the cell.
    says: [f32; 4],
    /// The largest contribution.
    most: f32,
}

/// Memory of one thread.
#[derive(Default)]
pub(super) struct Memory {
    probing: ProbeMemory,
    /// Probe of each corner, `[depth][corner]`.
    index: Vec<u32>,
    cells: Vec<Cell>,
    cut: Vec<Cell>,
    /// True where any light arrives, `[depth][face]`.
    lit: Vec<bool>,
    /// Planes of each depth.
    planes: Vec<Planes>,
    picture: Vec<f32>,
}

/// The vector of one point, from shared rays.
pub(super) struct Adaptive<'a> {
    pub(super) prober: &'a Prober<'a>,
    pub(super) grid: &'a Grid,
    pub(super) line: &'a Line<'a>,
    pub(super) tolerance: f64,
}

impl Adaptive<'_> {
    /// Adds the vector of the point to `out`.
    pub(super) fn run(&self, memory: &mut Memory, out: &mut [f32]) {
        let grid = self.grid;
        let depths = self.line.depths.len();
        let corners = grid.directions.len();
        memory.index.clear();
        memory.index.resize(depths * corners, NONE);
        memory.lit.clear();
        memory.lit.resize(depths * FACES, false);
        while memory.planes.len() < depths {
            let terms = if self.is_constant() { 0 } else { self.prober.settings.phase.count() };
            memory.planes.push(Planes::new(self.prober.texels(), terms));
        }
        memory.probing.probes.clear();
        let mut size = (grid.side / COARSE).max(1);
        self.first(size, memory);
        let peak = memory.probing.probes.iter().fold(0.0f32, |most, p| most.max(p.value));
        let limit = (self.tolerance * f64::from(peak)) as f32;
        loop {
            memory.cut.clear();
            memory.probing.requests.clear();
            for i in 0..memory.cells.len() {
                let cell = memory.cells[i];
                let patch = self.patch(cell, size, memory);
                if size == 1 || self.difference(&patch) <= limit {
                    self.fill(cell, size, &patch, memory);
                } else {
                    self.split(cell, size, memory);
                }
            }
            if memory.cut.is_empty() {
                break;
            }
            self.trace(memory);
            std::mem::swap(&mut memory.cells, &mut memory.cut);
            size /= 2;
        }
        self.shade(memory, out);
    }

    /// True if the only term is the same everywhere.
    fn is_constant(&self) -> bool {
        self.prober.settings.phase == LightTerms::Isotropic
    }

    /// Traces all corners and lists all cells of the coarsest size; depths of one direction together (rays are alike).
    fn first(&self, size: usize, memory: &mut Memory) {
        let grid = self.grid;
        let depths = self.line.depths.len();
        let count = grid.side / size;
        memory.probing.requests.clear();
        memory.cells.clear();
        for face in 0..FACES {
            for (y, x) in (0..=count).flat_map(|y| (0..=count).map(move |x| (y, x))) {
                for depth in 0..depths {
                    self.ask(depth, face, x * size, y * size, memory);
                    if x < count && y < count {
                        let [x, y] = [x * size, y * size].map(|i| i as u8);
                        memory.cells.push(Cell { depth: depth as u16, face: face as u8, x, y });
                    }
                }
            }
        }
        self.trace(memory);
    }

    /// Requests a ray for a corner that has none.
    fn ask(&self, depth: usize, face: usize, x: usize, y: usize, memory: &mut Memory) {
        let grid = self.grid;
        let corner = grid.corner(face, x, y);
        if let Some(slot) = memory.index.get_mut(depth * grid.directions.len() + corner)
            && *slot == NONE
        {
            *slot = (memory.probing.probes.len() + memory.probing.requests.len()) as u32;
            memory.probing.requests.push(Request { depth: depth as u32, direction: grid.directions[corner] });
        }
    }

    fn trace(&self, memory: &mut Memory) {
        self.prober.trace(self.line, &mut memory.probing);
    }

    /// The probes of the corners of a cell, and the plane that they agree on.
    fn patch(&self, cell: Cell, size: usize, memory: &Memory) -> Patch {
        let grid = self.grid;
        let (depth, face, x, y) = (cell.depth as usize, cell.face as usize, cell.x as usize, cell.y as usize);
        let mut patch = Patch::default();
        let places = [(0, 0), (size, 0), (0, size), (size, size)];
        let corners = places.map(|(dx, dy)| grid.corner(face, x + dx, y + dy));
        for (probe, corner) in patch.probes.iter_mut().zip(corners) {
            let index = memory.index.get(depth * grid.directions.len() + corner);
            *probe = index.and_then(|&i| memory.probing.probes.get(i as usize)).copied().unwrap_or_default();
        }
        patch.most = patch.probes.iter().fold(0.0f32, |m, p| m.max(p.value));
        if patch.most == 0.0 {
            return patch;
        }
        let mut normal = Vec3::ZERO;
        for (say, probe) in patch.says.iter_mut().zip(&patch.probes) {
            *say = (probe.value / (FAINT * patch.most)).min(1.0);
            normal += *say * probe.normal;
        }
        for ((i, probe), corner) in patch.probes.iter().enumerate().zip(corners) {
            let dark = probe.value < DARK * patch.most;
            let above = normal.dot(grid.directions[corner].as_vec3()) > HORIZON * normal.length();
            patch.light[i] = match (dark, above) {
                (false, _) => Light::Free,
                (true, true) => Light::Hidden,
                (true, false) => Light::BelowHorizon,
            };
        }
        patch
    }

    /// Doubt about the contribution of a cell, in the unit of contributions.
    fn difference(&self, patch: &Patch) -> f32 {
        if patch.light.contains(&Light::Hidden) {
            return patch.most;
        }
        let free = || patch.probes.iter().zip(&patch.light).filter(|(_, l)| **l == Light::Free).map(|(p, _)| p);
        let heights = free().fold((f32::INFINITY, 0.0f32), |(l, m), p| (l.min(p.height_mm), m.max(p.height_mm)));
        let (low, high) =
            free().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p.normal), h.max(p.normal)));
        let most = patch.most;
        let through = free().fold((1.0f32, 0.0f32), |(l, m), p| {
            let t = p.through.iter().fold(0.0f32, |m, t| m.max(*t));
            (l.min(t), m.max(t))
        });
        if most == 0.0 {
            return 0.0;
        }
        let optical = self.line.least_per_mm as f32 * (heights.1 - heights.0);
        most * (optical.max((high - low).max_element()).min(1.0)).max(through.1 - through.0)
    }

    /// Requests the middles of the edges and of the cell, and lists its quarters.
    fn split(&self, cell: Cell, size: usize, memory: &mut Memory) {
        let half = size / 2;
        let (depth, face, x, y) = (cell.depth as usize, cell.face as usize, cell.x as usize, cell.y as usize);
        for (dx, dy) in [(half, 0), (0, half), (half, half), (size, half), (half, size)] {
            self.ask(depth, face, x + dx, y + dy, memory);
        }
        for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
            memory.cut.push(Cell { x: (x + dx) as u8, y: (y + dy) as u8, ..cell });
        }
    }

    /// Interpolates the corners of a cell into the planes of its depth.
    fn fill(&self, cell: Cell, size: usize, patch: &Patch, memory: &mut Memory) {
        let side = self.grid.side;
        let (depth, face, x0, y0) = (cell.depth as usize, cell.face as usize, cell.x as usize, cell.y as usize);
        let Some(planes) = memory.planes.get_mut(depth) else { return };
        if patch.most > 0.0
            && let Some(flag) = memory.lit.get_mut(depth * FACES + face)
        {
            *flag = true;
        }
        let channels = if self.prober.interior.crossings == Crossings::Occluded { 1 } else { 3 };
        let step = 1.0 / size as f32;
        for (iy, ix) in (0..size).flat_map(|iy| (0..size).map(move |ix| (iy, ix))) {
            let (u, v) = ((ix as f32 + 0.5) * step, (iy as f32 + 0.5) * step);
            let shares = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
            let inside_face = (y0 + iy) * side + x0 + ix;
            let texel = face * side * side + inside_face;
            if patch.most == 0.0 {
                planes.through.iter_mut().take(channels).for_each(|plane| plane[texel] = 0.0);
                continue;
            }
            // A corner in the dark has no say about the plane; one below the horizon none about shadows either.
            let (mut normal, mut height, mut says, mut judged) = (Vec3::ZERO, 0.0, 0.0, 0.0);
            let mut through = [0.0f32; 3];
            for (i, probe) in patch.probes.iter().enumerate() {
                let say = shares[i] * patch.says[i];
                normal += say * probe.normal;
                height += say * probe.height_mm;
                says += say;
                if patch.light[i] != Light::BelowHorizon {
                    judged += shares[i];
                }
                if patch.light[i] == Light::Free {
                    through.iter_mut().zip(&probe.through).for_each(|(sum, t)| *sum += shares[i] * t);
                }
            }
            let direction = self.grid.centres[texel];
            let length = normal.length();
            let valid = length > 0.0 && judged > 0.0 && says > 0.0;
            // The mean of the cosines, not the cosine of the mean normal: gains are concave, facets would add up to 1 % too much.
            planes.cosine[texel] = if valid { normal.dot(direction) / says } else { 0.0 };
            planes.height_mm[texel] = if says > 0.0 { height / says } else { 0.0 };
            for (plane, sum) in planes.through.iter_mut().zip(through).take(channels) {
                plane[texel] = if valid { sum / judged } else { 0.0 };
            }
            if !self.is_constant() && planes.cosine[texel] > 0.0 {
                self.terms(planes, texel, direction, normal / length);
            }
        }
    }

    /// Writes the light side of the phase function for a texel.
    fn terms(&self, planes: &mut Planes, texel: usize, direction: Vec3, normal: Vec3) {
        let (count, texels) = (self.prober.settings.phase.count(), self.prober.texels());
        let eta = self.line.optics.eta_inside_over_outside;
        let Some(inside) = refracted(eta, direction.as_dvec3(), normal.as_dvec3()) else { return };
        let mut values = [0.0; MOST_TERMS];
        self.prober.settings.phase.evaluate(inside, &mut values);
        for (k, value) in values.iter().take(count).enumerate() {
            planes.terms[k * texels + texel] = *value as f32;
        }
    }

    /// Adds the light of the planes to the vector.
    fn shade(&self, memory: &mut Memory, out: &mut [f32]) {
        let side = self.grid.side;
        let (count, texels, face) = (self.prober.settings.phase.count(), self.prober.texels(), side * side);
        let equal = self.prober.interior.crossings == Crossings::Occluded;
        let mut constant = [0.0];
        self.prober.settings.phase.evaluate(self.line.point.normal, &mut constant);
        let term = if self.is_constant() { constant[0] } else { 1.0 };
        let medium = Medium { form: self.prober.settings.form, eta: self.line.optics.eta_inside_over_outside as f32 };
        for (index, (depth, planes)) in self.line.depths.iter().zip(&mut memory.planes).enumerate() {
            for (f, lit) in memory.lit[index * FACES..(index + 1) * FACES].iter().enumerate() {
                if *lit {
                    let range = f * face..(f + 1) * face;
                    let (cosines, heights) = (&planes.cosine[range.clone()], &planes.height_mm[range.clone()]);
                    let (gains, paths) = (&mut planes.gain[range.clone()], &mut planes.path_mm[range]);
                    refract(self.prober.level, medium, cosines, heights, gains, paths);
                }
                for channel in (0..3).filter(|&c| *lit && depth.weight[c] > 0.0) {
                    let range = f * face..(f + 1) * face;
                    let source = Channel {
                        gain: &planes.gain[range.clone()],
                        through: &planes.through[if equal { 0 } else { channel }][range.clone()],
                        path_mm: &planes.path_mm[range.clone()],
                        angles: &self.prober.angles,
                        weight: (depth.weight[channel] * term) as f32,
                        sigma_t_per_mm: self.line.optics.sigma_t_per_mm[channel] as f32,
                    };
                    if self.is_constant() {
                        add_channel(self.prober.level, &source, &mut out[channel * texels..][range]);
                        continue;
                    }
                    memory.picture.clear();
                    memory.picture.resize(face, 0.0);
                    add_channel(self.prober.level, &source, &mut memory.picture);
                    for k in 0..count {
                        let terms = &planes.terms[k * texels..][range.clone()];
                        let target = &mut out[(k * 3 + channel) * texels..][range.clone()];
                        add_product(self.prober.level, &memory.picture, terms, target);
                    }
                }
            }
        }
    }
}
