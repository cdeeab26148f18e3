//! The balanced tree over the samples of each part, and the area-weighted Haar transform of irradiance on it.
//!
//! Samples are stored in the order of the tree, so that the tree needs no storage: the node over the samples `a..b`
//! splits in the middle, every second level of it makes the four equal children of a balanced quadtree (Hasan et al. 2006),
//! and a node is named by the first sample of its right child, which no other node shares.

use glam::DVec3;

use super::light_range::{CommonColour, LightRange};
use crate::geometry::samples::{Patch, Samples};

/// Ranges shorter than this are one task.
const TASK: usize = 4096;

/// A node: the samples `first..end` of one part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// First sample.
    pub first: u32,
    /// One past the last.
    pub end: u32,
}

impl Node {
    /// First sample of the right child: the name of a node of more than one sample.
    pub fn name(self) -> usize {
        middle(self.first as usize, self.end as usize)
    }

    /// True if the node is a single sample.
    pub fn is_leaf(self) -> bool {
        self.end - self.first <= 1
    }

    /// The two halves of a node that is not a leaf; the left one is larger where they differ.
    pub fn children(self) -> [Self; 2] {
        let middle = self.name() as u32;
        [Self { first: self.first, end: middle }, Self { first: middle, end: self.end }]
    }
}

fn middle(first: usize, end: usize) -> usize {
    first + (end - first).div_ceil(2)
}

/// Geometry of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Area-weighted centroid relative to the mesh's origin, mm.
    pub centre_mm: DVec3,
    /// Every sample's farthest corner lies within this distance of the centroid, mm.
    pub radius_mm: f64,
    /// Area, mm^2.
    pub area_mm2: f64,
}

impl From<&Patch> for Cell {
    fn from(patch: &Patch) -> Self {
        let Patch { centre_mm, radius_mm, area_mm2, .. } = *patch;
        Self { centre_mm, radius_mm, area_mm2 }
    }
}

/// Cells of the balanced trees of all parts.
#[derive(Clone, Debug, Default)]
pub struct BalancedTree {
    /// Cell of each node of more than one sample, by its name.
    cells: Vec<Cell>,
    part_offsets: Vec<u32>,
}

impl BalancedTree {
    /// The tree over samples in tree order.
    pub fn new(samples: &Samples, patches: &[Patch]) -> Self {
        let mut cells = vec![Cell::default(); patches.len()];
        for part in 0..samples.part_offsets.len().saturating_sub(1) {
            let range = samples.part(part);
            build(&patches[range.clone()], &mut cells[range]);
        }
        Self { cells, part_offsets: samples.part_offsets.clone() }
    }

    /// The node over all samples of a part; `None` if it has none.
    pub fn root(&self, part: usize) -> Option<Node> {
        let (first, end) = (*self.part_offsets.get(part)?, *self.part_offsets.get(part + 1)?);
        (first < end).then_some(Node { first, end })
    }

    /// Geometry of a node.
    pub fn cell(&self, node: Node, patches: &[Patch]) -> Cell {
        if node.is_leaf() { Cell::from(&patches[node.first as usize]) } else { self.cells[node.name()] }
    }
}

/// Writes the cells of all nodes of a range by name; returns that of the whole.
fn build(patches: &[Patch], cells: &mut [Cell]) -> Cell {
    match patches {
        [] => return Cell::default(),
        [patch] => return patch.into(),
        _ => {}
    }
    let half = middle(0, patches.len());
    let (left, right) = patches.split_at(half);
    let (left_cells, right_cells) = cells.split_at_mut(half);
    let (a, b) = if patches.len() > TASK {
        rayon::join(|| build(left, left_cells), || build(right, right_cells))
    } else {
        (build(left, left_cells), build(right, right_cells))
    };
    let area = a.area_mm2 + b.area_mm2;
    let centre = (a.area_mm2 * a.centre_mm + b.area_mm2 * b.centre_mm) / area.max(f64::MIN_POSITIVE);
    // From the samples themselves: spheres around spheres grow with every level.
    let reach = |p: &Patch| p.centre_mm.distance(centre) + p.radius_mm;
    let cell = Cell { centre_mm: centre, radius_mm: patches.iter().map(reach).fold(0.0, f64::max), area_mm2: area };
    right_cells[0] = cell;
    cell
}

/// Irradiance in the basis of the tree.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct LightDetails {
    /// Mean irradiance of the left child less that of the right one, over `scale`, RGB, by the name of the node.
    pub details: Vec<[f32; 3]>,
    /// Area-weighted mean irradiance of each part over `scale`, RGB.
    pub means: Vec<[f32; 3]>,
    /// A power of two that brings the brightest irradiance near 1, into the range of single precision.
    pub scale: f64,
    /// Colour of all irradiance, if it has one.
    pub colour: Option<CommonColour>,
}

impl LightDetails {
    /// Transforms one irradiance for each sample, RGB.
    pub fn new(samples: &Samples, patches: &[Patch], irradiance: &[DVec3]) -> Self {
        Self::of_range(samples, patches, irradiance, LightRange::new(irradiance, &[]))
    }

    /// [`Self::new`] for irradiance whose range is known.
    pub fn of_range(samples: &Samples, patches: &[Patch], irradiance: &[DVec3], range: LightRange) -> Self {
        let LightRange { brightest, colour } = range;
        let scale = power_of_two_near(brightest);
        let mut details = vec![[0.0; 3]; patches.len()];
        let parts = samples.part_offsets.len().saturating_sub(1);
        let means = (0..parts).map(|part| {
            let range = samples.part(part);
            let (patches, irradiance) = (&patches[range.clone()], &irradiance[range.clone()]);
            let details = &mut details[range];
            match colour {
                Some(CommonColour { channel, rgb }) => {
                    let of_sample = |e: DVec3| [e[channel] * scale.recip()];
                    transform((patches, irradiance), of_sample, |[e]| (rgb * e).as_vec3().to_array(), details)
                }
                None => {
                    let of_sample = |e: DVec3| (e * scale.recip()).to_array();
                    transform((patches, irradiance), of_sample, |e| e.map(|e| e as f32), details)
                }
            }
        });
        let means = means.collect();
        Self { details, means, scale, colour }
    }
}

/// The power of two at or below a value, within 2^-1000..2^1000; 1 if the value is not positive and finite.
pub fn power_of_two_near(value: f64) -> f64 {
    let usable = value > 0.0 && value.is_finite();
    if usable { value.log2().floor().clamp(-1000.0, 1000.0).exp2() } else { 1.0 }
}

/// Flux of some channels and area.
type Flux<const C: usize> = ([f64; C], f64);

/// Mean of a range under scaled irradiance; writes its details.
fn transform<const C: usize>(
    (patches, irradiance): (&[Patch], &[DVec3]),
    of_sample: impl Fn(DVec3) -> [f64; C] + Copy + Sync,
    rgb: impl Fn([f64; C]) -> [f32; 3] + Copy + Sync,
    details: &mut [[f32; 3]],
) -> [f32; 3] {
    let transform = Transform { of_sample, rgb };
    let (flux, area) = transform.range(patches, irradiance, details);
    rgb(flux.map(|flux| flux / area.max(f64::MIN_POSITIVE)))
}

#[derive(Clone, Copy)]
struct Transform<S, R> {
    of_sample: S,
    rgb: R,
}

impl<const C: usize, S: Fn(DVec3) -> [f64; C] + Copy + Sync, R: Fn([f64; C]) -> [f32; 3] + Copy + Sync>
    Transform<S, R>
{
    fn range(self, patches: &[Patch], irradiance: &[DVec3], details: &mut [[f32; 3]]) -> Flux<C> {
        // The smallest ranges without a call for each sample, which takes longer than its arithmetic.
        match (patches, irradiance, &mut *details) {
            ([a], [e_a], _) => return self.leaf(a, e_a),
            ([a, b], [e_a, e_b], [_, detail]) => return self.node(self.leaf(a, e_a), self.leaf(b, e_b), detail),
            ([a, b, c], [e_a, e_b, e_c], [_, first, detail]) => {
                let left = self.node(self.leaf(a, e_a), self.leaf(b, e_b), first);
                return self.node(left, self.leaf(c, e_c), detail);
            }
            ([a, b, c, d], [e_a, e_b, e_c, e_d], [_, first, detail, second]) => {
                let left = self.node(self.leaf(a, e_a), self.leaf(b, e_b), first);
                let right = self.node(self.leaf(c, e_c), self.leaf(d, e_d), second);
                return self.node(left, right, detail);
            }
            ([], ..) => return ([0.0; C], 0.0),
            _ => {}
        }
        let half = middle(0, patches.len());
        let (left, right) = patches.split_at(half);
        let (left_e, right_e) = irradiance.split_at(half);
        let (left_d, right_d) = details.split_at_mut(half);
        let (a, b) = if patches.len() > TASK {
            rayon::join(|| self.range(left, left_e, left_d), || self.range(right, right_e, right_d))
        } else {
            (self.range(left, left_e, left_d), self.range(right, right_e, right_d))
        };
        self.node(a, b, &mut right_d[0])
    }

    #[inline(always)]
    fn leaf(self, patch: &Patch, irradiance: &DVec3) -> Flux<C> {
        ((self.of_sample)(*irradiance).map(|e| e * patch.area_mm2), patch.area_mm2)
    }

    #[inline(always)]
    fn node(self, (a, area_a): Flux<C>, (b, area_b): Flux<C>, detail: &mut [f32; 3]) -> Flux<C> {
        let difference = std::array::from_fn(|c| a[c] / area_a - b[c] / area_b);
        *detail = if area_a > 0.0 && area_b > 0.0 { (self.rgb)(difference) } else { [0.0; 3] };
        (std::array::from_fn(|c| a[c] + b[c]), area_a + area_b)
    }
}

/// Weight of the mean square at the node itself; the rest is that of all nodes of its size, because other lights draw
/// their shadows elsewhere.
const OWN_SHARE: f64 = 0.5;

/// RMS over lights of the detail at each node over the mean irradiance of its part, by the name of the node.
///
/// Takes the first channel of each light. Without lights every detail counts as much as the mean.
pub fn expected_details(tree: &BalancedTree, parts: usize, samples: usize, lights: &[LightDetails]) -> Vec<f32> {
    let mut expected = vec![0.0; samples];
    for part in 0..parts {
        let Some(root) = tree.root(part) else { continue };
        // Depth first, so that nodes of one size are found by their depth.
        let mut nodes = Vec::new();
        let mut stack = vec![(root, 0usize)];
        while let Some((node, depth)) = stack.pop() {
            if !node.is_leaf() {
                nodes.push((node.name(), depth));
                stack.extend(node.children().map(|child| (child, depth + 1)));
            }
        }
        let lit: Vec<(&LightDetails, f64)> =
            lights.iter().map(|l| (l, f64::from(l.means[part][0]))).filter(|(_, mean)| *mean > 0.0).collect();
        if lit.is_empty() {
            nodes.iter().for_each(|&(name, _)| expected[name] = 1.0);
            continue;
        }
        let own = |name: usize| {
            lit.iter().map(|(l, mean)| (f64::from(l.details[name][0]) / mean).powi(2)).sum::<f64>() / lit.len() as f64
        };
        let squares: Vec<f64> = nodes.iter().map(|&(name, _)| own(name)).collect();
        let mut levels: Vec<(f64, f64)> = Vec::new();
        for (&(_, depth), square) in nodes.iter().zip(&squares) {
            levels.resize(levels.len().max(depth + 1), (0.0, 0.0));
            levels[depth].0 += square;
            levels[depth].1 += 1.0;
        }
        for (&(name, depth), square) in nodes.iter().zip(&squares) {
            let level = levels[depth].0 / levels[depth].1;
            expected[name] = (OWN_SHARE * square + (1.0 - OWN_SHARE) * level).sqrt() as f32;
        }
    }
    expected
}

#[cfg(test)]
#[path = "balanced_tree_tests.rs"]
mod tests;
