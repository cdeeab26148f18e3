//! The far field as plain arrays: groups of receivers and their quantised Haar coefficients, without the bytes that hold them.

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
    /// Kept functions, u16.
    pub const MASKS: Tag = Tag::from_static("far.msk");
    /// Those of them with 16-bit values, u16.
    pub const WIDE_MASKS: Tag = Tag::from_static("far.wid");
    /// Quantiser steps, f32.
    pub const STEPS: Tag = Tag::from_static("far.stp");
    /// Row sums, four planes of u8 for each function.
    pub const ROW_SUMS: Tag = Tag::from_static("far.sum");
    /// 8-bit values, i8 x 16.
    pub const NARROW: Tag = Tag::from_static("far.val");
    /// 16-bit values, u8 x 16: a plane of low and one of high bytes.
    pub const WIDE: Tag = Tag::from_static("far.big");

    /// Functions that each group has, u16; only where some group has not all.
    pub const FUNCTIONS: Tag = Tag::from_static("far.fun");
    /// Receiver of each row beyond those that receivers have of their own, u32; only where there are any.
    pub const ROWS: Tag = Tag::from_static("far.row");
    /// Nodes, kept functions and values, entropy-coded, u8: in place of the five sections that hold them as they are.
    pub const CODED: Tag = Tag::from_static("far.cod");

    /// All that are not always there.
    pub const OPTIONAL: [Tag; 3] = [FUNCTIONS, ROWS, CODED];
    /// The five.
    pub const REPLACED: [Tag; 5] = [NODES, MASKS, WIDE_MASKS, NARROW, WIDE];

    /// All sections that the plain layout must have, in the order of the file.
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

/// Basis functions at most: the bits of a mask.
pub const MOST_TERMS: usize = 16;

/// Receivers side by side in a coefficient.
pub const LANES: usize = 16;
/// Receiver of a vertex that has none.
pub const NO_RECEIVER: u32 = u32::MAX;

/// A run of rows, of neighbouring receivers of one part, with one list of coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Part whose samples it gathers from.
    pub part: u32,
    /// Its rows end here (and begin where those of the group before end); at most [`LANES`] of them.
    pub rows_end: u32,
    /// Its coefficients end here (and begin where those of the group before end).
    pub coefficients_end: u32,
    /// Basis functions of its rows: bit k; not 0.
    pub functions: u16,
}

/// The mask of so many basis functions.
pub const fn all_functions(terms: usize) -> u16 {
    if terms >= MOST_TERMS { u16::MAX } else { (1 << terms) - 1 }
}

/// The far field; a value stands for `value * steps[k]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FarField {
    /// Number of basis functions K.
    pub terms: usize,
    /// For each source vertex its receiver, or [`NO_RECEIVER`]: its far radiosity is interpolated from the receivers around it.
    pub receiver_of_vertex: Vec<u32>,
    /// The groups. Row i is one of receiver i, as far as there are receivers.
    pub groups: Vec<Group>,
    /// Receivers of the rows behind these: they have other functions than the rows of their receivers before them. A receiver without a
    /// row of a function takes what is interpolated from the receivers of the part that have one.
    pub others: Vec<u32>,
    /// Tree node of each coefficient, strictly ascending inside a group. A node is named by the first sample of its right child.
    pub nodes: Vec<u32>,
    /// Which basis functions are kept of each coefficient: bit k; not 0.
    pub masks: Vec<u16>,
    /// Quantiser step of each basis function, positive.
    pub steps: Vec<f32>,
    /// Those of the kept functions whose values need 16 bits.
    pub wide_masks: Vec<u16>,
    /// Quantised values of the others: for each coefficient its functions, ascending, and for each of these the Haar
    /// transform over the lanes (see [`over_lanes`]).
    pub narrow: Vec<[i8; LANES]>,
    /// Quantised values that need 16 bits, likewise.
    pub wide: Vec<[i16; LANES]>,
    /// Sum of each row, mm^2 times the unit of the basis: `[row][k]`; 0 for functions that its group has not.
    pub row_sums: Vec<f32>,
}

/// What a far field must fit: the mesh and the samples of its asset.
#[derive(Clone, Copy, Debug)]
pub struct Shape<'a> {
    /// Number of vertices.
    pub vertices: usize,
    /// Part `p` has the samples (patches) `part_offsets[p]..part_offsets[p + 1]`; never descending, `len = parts + 1`.
    pub part_offsets: &'a [u32],
}

impl<'a> Shape<'a> {
    /// Of a mesh with this many vertices and valid samples.
    pub fn new(vertices: usize, samples: &'a Samples) -> Self {
        Self { vertices, part_offsets: &samples.part_offsets }
    }

    /// First sample and end of a part that has samples.
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

    /// Number of receivers: that of a field with valid rows.
    pub fn receivers(&self) -> usize {
        self.rows().saturating_sub(self.others.len())
    }

    /// The receiver of a row.
    pub fn receiver_of(&self, row: usize) -> usize {
        let other = row.checked_sub(self.receivers()).and_then(|i| self.others.get(i));
        other.map_or(row, |&receiver| receiver as usize)
    }
}

/// Rows and coefficients of each group; of groups whose ends ascend.
pub(crate) fn group_sizes(groups: &[Group]) -> impl Iterator<Item = (usize, usize)> {
    groups.iter().scan((0, 0), |(rows, coefficients), group| {
        let ends = (group.rows_end as usize, group.coefficients_end as usize);
        let sizes = (ends.0 - *rows, ends.1 - *coefficients);
        (*rows, *coefficients) = ends;
        Some(sizes)
    })
}
