//! Transport of the smooth far part of R_d: for a group of neighbouring receivers, the area-weighted Haar coefficients of
//! every basis function over the tree of samples.
//!
//! With `T_c = Int_c b_k(|x - y|) dA` over a child c of a node and A_c its area, the detail of the node is
//! `(T_left A_right - T_right A_left) / (A_left + A_right)`, which meets the difference of the children's mean irradiance.
//! Details vanish under a constant irradiance: whatever is dropped, the sum of a row is kept.

use glam::DVec3;

use super::balanced_tree::{BalancedTree, Cell, Node};
use super::receivers::Sphere;
use crate::geometry::samples::Patch;
use crate::medium::profile_basis::Table;

/// Receivers of a group, side by side.
pub const LANES: usize = 16;

/// Basis functions at most.
pub const TERMS: usize = 16;

/// One value for each basis function (padded with zeros) and receiver.
type Values = [[f32; TERMS]; LANES];

/// Precision of the integration of rows, and the significance of the details that are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precision {
    /// A cell whose radius is below this fraction of its distance is integrated by the centroids of its children.
    pub opening: f64,
    /// Cells whose details stay below this significance are not opened for their sake.
    pub threshold: f64,
    /// Details below this significance are dropped: the threshold, or less to measure the error of dropping.
    pub keep: f64,
}

/// Rows of one group.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Rows {
    /// Nodes of the kept coefficients, ascending.
    pub nodes: Vec<u32>,
    /// Kept basis functions of each coefficient, as bits k.
    pub masks: Vec<u16>,
    /// Kept details, `[coefficient][kept k][lane]`.
    pub values: Vec<[f32; LANES]>,
    /// Sum of each row, `[lane][k]`.
    pub sums: Vec<f32>,
}

/// Inputs shared by all groups.
pub struct FarTransport<'a> {
    /// Tree over the samples.
    pub tree: &'a BalancedTree,
    /// Samples in tree order.
    pub patches: &'a [Patch],
    /// The basis functions.
    pub table: &'a Table,
    /// Typical coefficient of each function in a material, over its total reflectance.
    pub spread: &'a [f64],
    /// Expected detail of the light at each node over its mean, by name.
    pub expected: &'a [f32],
    /// Lengths over which the functions change, where they change most, mm.
    pub smooth_mm: &'a [f64],
    /// Precision of the rows.
    pub precision: Precision,
}

/// Details of one node.
struct Found {
    node: u32,
    mask: u16,
    details: Box<Values>,
}

/// Squares of the significance of a node's details, summed over receivers.
type Significance = [f64; TERMS];

/// One traversal.
struct Walk<'a> {
    shared: &'a FarTransport<'a>,
    receivers: [[f32; 3]; LANES],
    count: usize,
    terms: usize,
    threshold2: f64,
    keep2: f64,
    sphere: Sphere,
    spread: [f32; TERMS],
    /// Least of the lengths over which the functions change.
    smooth_mm: f64,
    found: Vec<Found>,
}

impl FarTransport<'_> {
    /// Rows of some functions (bit k) for up to [`LANES`] receivers over the samples of a part; the sums of others are 0.
    pub fn rows(&self, receivers: &[DVec3], part: usize, functions: u16) -> Rows {
        let is_wanted = |k: usize| functions >> k & 1 == 1;
        let terms = self.spread.len().min(TERMS);
        let wanted = || (0..terms).filter(|&k| is_wanted(k));
        let count = receivers.len().min(LANES);
        let Some(root) = self.tree.root(part).filter(|_| count > 0) else {
            return Rows { sums: vec![0.0; count * terms], ..Rows::default() };
        };
        let sphere = Sphere::around(receivers);
        let relative = |i: usize| (receivers[i.min(count - 1)] - sphere.centre_mm).as_vec3().to_array();
        let mut walk = Walk {
            shared: self,
            receivers: std::array::from_fn(relative),
            count,
            terms,
            threshold2: self.precision.threshold * self.precision.threshold,
            keep2: self.precision.keep * self.precision.keep,
            sphere,
            // What nothing is made of has no significance.
            spread: std::array::from_fn(|k| self.spread.get(k).filter(|_| is_wanted(k)).map_or(0.0, |&s| s as f32)),
            smooth_mm: wanted().map(|k| self.smooth_mm[k]).fold(f64::INFINITY, f64::min),
            found: Vec::new(),
        };
        let sums = walk.visit(root);
        walk.found.sort_unstable_by_key(|found| found.node);
        let mut rows = Rows::default();
        for Found { node, mask, details } in &walk.found {
            rows.nodes.push(*node);
            rows.masks.push(*mask);
            for k in (0..terms).filter(|k| mask >> k & 1 == 1) {
                rows.values.push(std::array::from_fn(|lane| if lane < count { details[lane][k] } else { 0.0 }));
            }
        }
        let of_function = |(k, &sum): (usize, &f32)| if is_wanted(k) { sum } else { 0.0 };
        rows.sums = sums[..count].iter().flat_map(|s| s[..terms].iter().enumerate().map(of_function)).collect();
        rows
    }
}

impl Walk<'_> {
    /// Integral over a node.
    fn visit(&mut self, node: Node) -> Values {
        let shared = self.shared;
        if node.is_leaf() {
            return self.centroid(&Cell::from(&shared.patches[node.first as usize]));
        }
        let cell = shared.tree.cell(node, shared.patches);
        let distance = (cell.centre_mm.distance(self.sphere.centre_mm) - self.sphere.radius_mm).max(0.0);
        // The functions change over lengths of about the distance, and no less than this.
        let length = distance.max(self.smooth_mm);
        let children = node.children();
        let cells = children.map(|child| shared.tree.cell(child, shared.patches));
        if cell.radius_mm <= shared.precision.opening * length {
            let [left, right] = cells.map(|c| self.centroid(&c));
            let (details, significance2) = self.details(&cells, &left, &right, node.name());
            let significant = significance2.iter().any(|&s| s > self.threshold2);
            if !significant || children.iter().all(|c| c.is_leaf()) {
                self.keep(node.name(), details, &significance2);
                return sum(&left, &right);
            }
        }
        let [left, right] = children.map(|child| self.visit(child));
        let (details, significance2) = self.details(&cells, &left, &right, node.name());
        self.keep(node.name(), details, &significance2);
        sum(&left, &right)
    }

    fn keep(&mut self, name: usize, details: Values, significance2: &Significance) {
        let mut mask = 0;
        for (k, &s) in significance2[..self.terms].iter().enumerate() {
            mask |= u16::from(s > self.keep2) << k;
        }
        if mask != 0 {
            self.found.push(Found { node: name as u32, mask, details: Box::new(details) });
        }
    }

    /// Details of a node and their significance.
    fn details(&self, cells: &[Cell; 2], left: &Values, right: &Values, name: usize) -> (Values, Significance) {
        let whole = (cells[0].area_mm2 + cells[1].area_mm2).max(f64::MIN_POSITIVE);
        let (a, b) = ((cells[1].area_mm2 / whole) as f32, (cells[0].area_mm2 / whole) as f32);
        let mut details = [[0.0; TERMS]; LANES];
        let mut squares = [0.0f32; TERMS];
        for lane in 0..self.count {
            for k in 0..TERMS {
                let detail = left[lane][k] * a - right[lane][k] * b;
                details[lane][k] = detail;
                let typical = detail * self.spread[k];
                squares[k] += typical * typical;
            }
        }
        let expected = f64::from(self.shared.expected[name]);
        (details, squares.map(|s| f64::from(s) * (expected * expected)))
    }

    /// Area of a cell times the functions at its centroid.
    fn centroid(&self, cell: &Cell) -> Values {
        let [x, y, z] = (cell.centre_mm - self.sphere.centre_mm).as_vec3().to_array();
        let area = cell.area_mm2 as f32;
        let mut values = [[0.0; TERMS]; LANES];
        for (value, at) in values.iter_mut().zip(&self.receivers[..self.count]) {
            let (dx, dy, dz) = (at[0] - x, at[1] - y, at[2] - z);
            self.shared.table.evaluate(dx * dx + dy * dy + dz * dz, value);
            for value in value {
                *value *= area;
            }
        }
        values
    }
}

fn sum(a: &Values, b: &Values) -> Values {
    std::array::from_fn(|lane| std::array::from_fn(|k| a[lane][k] + b[lane][k]))
}

#[cfg(test)]
#[path = "far_field_tests.rs"]
mod tests;
