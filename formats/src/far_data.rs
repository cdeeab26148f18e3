//! The far field as plain arrays: groups of receivers and their quantised Haar coefficients, independent of their
//! encoding.

use crate::samples::Samples;

/// Tags of the far field.
pub mod tags {
    use crate::types::Tag;

    /// Receiver of each vertex, u32.
    pub const RECEIVERS: Tag = Tag::from_static("far.rcv");
    /// Groups, u32 x 3.
    pub const GROUPS: Tag = Tag::from_static("far.grp");
    /// Nodes, varints in u8.
    pub const NODES: Tag = Tag::from_static("far.nod");
    /// Kept functions of each coefficient, u16.
    pub const MASKS: Tag = Tag::from_static("far.msk");
    /// Kept functions with 16-bit values, u16.
    pub const WIDE_MASKS: Tag = Tag::from_static("far.wid");
    /// Quantiser steps, f32.
    pub const STEPS: Tag = Tag::from_static("far.stp");
    /// Row sums, four planes of u8 for each function.
    pub const ROW_SUMS: Tag = Tag::from_static("far.sum");
    /// 8-bit values, i8 x 16.
    pub const NARROW: Tag = Tag::from_static("far.val");
    /// 16-bit values, u8 x 16: a plane of low and one of high bytes.
    pub const WIDE: Tag = Tag::from_static("far.big");

    /// Functions of each group, u16; only where some group lacks some.
    pub const FUNCTIONS: Tag = Tag::from_static("far.fun");
    /// Receiver of each additional row beyond the receivers' own, u32; only where there are any.
    pub const ROWS: Tag = Tag::from_static("far.row");
    /// Nodes, kept functions and values, entropy-coded, u8: replaces the five plain sections.
    pub const CODED: Tag = Tag::from_static("far.cod");

    /// The optional sections.
    pub const OPTIONAL: [Tag; 3] = [FUNCTIONS, ROWS, CODED];
    /// The five sections that [`CODED`] replaces.
    pub const REPLACED: [Tag; 5] = [NODES, MASKS, WIDE_MASKS, NARROW, WIDE];

    /// All mandatory sections of the plain layout, in the order of the file.
    pub const ALL: [Tag; 9] = [RECEIVERS, GROUPS, NODES, MASKS, WIDE_MASKS, STEPS, ROW_SUMS, NARROW, WIDE];
}

/// 1 / sqrt(2), rounded.
const HALF_ROOT: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// Orthonormal Haar transform over the lanes: the scaled mean, then the details from the coarsest on.
pub fn transform_lanes(mut lanes: [f32; LANES]) -> [f32; LANES] {
    let mut length = LANES;
    while length > 1 {
        let half = length / 2;
        let level = lanes;
        for i in 0..half {
            lanes[i] = (level[2 * i] + level[2 * i + 1]) * HALF_ROOT;
            lanes[half + i] = (level[2 * i + 1] - level[2 * i]) * HALF_ROOT;
        }
        length = half;
    }
    lanes
}

/// Undoes [`transform_lanes`]: from coefficients to the values of the lanes.
pub fn over_lanes(mut coefficients: [f32; LANES]) -> [f32; LANES] {
    let mut half = 1;
    while half < LANES {
        let level = coefficients;
        for i in 0..half {
            coefficients[2 * i] = (level[i] - level[half + i]) * HALF_ROOT;
            coefficients[2 * i + 1] = (level[i] + level[half + i]) * HALF_ROOT;
        }
        half *= 2;
    }
    coefficients
}

/// Largest number of basis functions: the bits of a mask.
pub const MOST_TERMS: usize = 16;

/// Number of neighbouring receivers in a coefficient.
pub const LANES: usize = 16;
/// Receiver index of a vertex without one.
pub const NO_RECEIVER: u32 = u32::MAX;

/// A run of rows of neighbouring receivers of one part that share a list of coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Part whose samples the group gathers from.
    pub part: u32,
    /// End of its rows, which begin at the end of the previous group; at most [`LANES`].
    pub rows_end: u32,
    /// End of its coefficients, which begin at the end of the previous group.
    pub coefficients_end: u32,
    /// Basis functions of its rows, as a mask: bit k; not 0.
    pub functions: u16,
}

/// The mask of `terms` basis functions.
pub const fn all_functions(terms: usize) -> u16 {
    if terms >= MOST_TERMS { u16::MAX } else { (1 << terms) - 1 }
}

/// The far field; a quantised value means `value * steps[k]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FarField {
    /// Number of basis functions K.
    pub terms: usize,
    /// Receiver of each source vertex, or [`NO_RECEIVER`]: the vertex's far radiosity is interpolated from nearby
    /// receivers.
    pub receiver_of_vertex: Vec<u32>,
    /// The groups. Row i belongs to receiver i, as far as there are receivers.
    pub groups: Vec<Group>,
    /// Receivers of the additional rows, which have other functions than the receivers' own rows. A receiver without a
    /// row of a function gets it by interpolation from the receivers of the part that have one.
    pub others: Vec<u32>,
    /// Tree node of each coefficient, strictly ascending inside a group. A node is named by the first sample of its
    /// right child.
    pub nodes: Vec<u32>,
    /// Kept basis functions of each coefficient, as a mask: bit k; not 0.
    pub masks: Vec<u16>,
    /// Quantiser step of each basis function, positive.
    pub steps: Vec<f32>,
    /// Kept functions of each coefficient whose values need 16 bits, as a mask.
    pub wide_masks: Vec<u16>,
    /// Quantised 8-bit values: for each coefficient its functions, ascending, and for each of these the Haar transform
    /// over the lanes (see [`over_lanes`]).
    pub narrow: Vec<[i8; LANES]>,
    /// Quantised 16-bit values, in the same order.
    pub wide: Vec<[i16; LANES]>,
    /// Sum of each row, mm^2 times the unit of the basis: `[row][k]`; 0 for functions that its group lacks.
    pub row_sums: Vec<f32>,
}

/// Dimensions that a far field must fit, those of the mesh and the samples of its asset.
#[derive(Clone, Copy, Debug)]
pub struct Shape<'a> {
    /// Number of vertices.
    pub vertices: usize,
    /// Part `p` has the samples (patches) `part_offsets[p]..part_offsets[p + 1]`; never descending, `len = parts + 1`.
    pub part_offsets: &'a [u32],
}

impl<'a> Shape<'a> {
    /// The shape of a mesh with this many vertices and valid samples.
    pub fn new(vertices: usize, samples: &'a Samples) -> Self {
        Self { vertices, part_offsets: &samples.part_offsets }
    }

    /// First sample and end of a part with samples.
    pub(crate) fn samples(&self, part: u32) -> Option<(u32, u32)> {
        let first = self.part_offsets.get(part as usize)?;
        let end = self.part_offsets.get(part as usize + 1)?;
        (first < end).then_some((*first, *end))
    }
}

impl FarField {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.groups.last().map_or(0, |group| group.rows_end as usize)
    }

    /// Number of receivers of a field with valid rows.
    pub fn receivers(&self) -> usize {
        self.rows().saturating_sub(self.others.len())
    }

    /// The receiver of a row.
    pub fn receiver_of(&self, row: usize) -> usize {
        let other = row.checked_sub(self.receivers()).and_then(|i| self.others.get(i));
        other.map_or(row, |&receiver| receiver as usize)
    }
}

/// Numbers of rows and coefficients of each group; the groups' ends ascend.
pub(crate) fn group_sizes(groups: &[Group]) -> impl Iterator<Item = (usize, usize)> {
    groups.iter().scan((0, 0), |(rows, coefficients), group| {
        let ends = (group.rows_end as usize, group.coefficients_end as usize);
        let sizes = (ends.0 - *rows, ends.1 - *coefficients);
        (*rows, *coefficients) = ends;
        Some(sizes)
    })
}
