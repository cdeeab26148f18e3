//! Irradiance rows over a cube map: sparse quantised Haar coefficients of the light that every patch receives from far
//! away.
//!
//! [`IrradianceRows::from_sections`] checks while it decodes, in one pass over the bytes. 131,072 patches of 122
//! details and two terms take 14 ms into memory that the process already has, 25 to 45 ms into fresh memory (64 MB),
//! because of page faults; copies of the sections and a detail at a time took 70 ms. A second thread saved nothing:
//! page faults wait for each other.

use crate::asset::{RawSection, pick};
use crate::checks::{Ranges, in_range, invalid, offsets, same_length};
use crate::error::Result;
use crate::types::{Codec, Kind, Tag};

/// Tags of the rows.
pub mod tags {
    use crate::types::Tag;

    /// Texels along an edge of a face and number of terms, u32 x 2, one row.
    pub const DIMENSIONS: Tag = Tag::from_static("rows.dim");
    /// Number of coefficients of each patch, u16.
    pub const COUNTS: Tag = Tag::from_static("rows.cnt");
    /// Indices: differences less one, low bytes of all, then high bytes; u8.
    pub const INDICES: Tag = Tag::from_static("rows.idx");
    /// Values, term after term, i8.
    pub const VALUES: Tag = Tag::from_static("rows.val");
    /// Step of the values of each patch, f32.
    pub const STEPS: Tag = Tag::from_static("rows.stp");
    /// Scaling coefficients, low bytes of all, then high bytes; u8.
    pub const SCALING: Tag = Tag::from_static("rows.sca");
    /// Step of the scaling coefficients of each patch, f32.
    pub const SCALING_STEPS: Tag = Tag::from_static("rows.scs");
    /// Functions of the angle, f64 x 9.
    pub const FUNCTIONS: Tag = Tag::from_static("rows.fun");
    /// Replaces [`DIMENSIONS`] where rows are in blocks: the same numbers and the largest number of patches of a block,
    /// u32 x 3, one row.
    pub const BLOCKS: Tag = Tag::from_static("rows.blk");

    /// Tags of the rows of patches, in the order of the file.
    pub const ALL: [Tag; 8] = IRRADIANCE.all();

    /// Tags of the rows of one use.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Set {
        /// As [`DIMENSIONS`].
        pub dimensions: Tag,
        /// As [`BLOCKS`]; `None` where rows are never in blocks.
        pub blocks: Option<Tag>,
        /// As [`COUNTS`].
        pub counts: Tag,
        /// As [`INDICES`].
        pub indices: Tag,
        /// As [`VALUES`].
        pub values: Tag,
        /// As [`STEPS`].
        pub steps: Tag,
        /// As [`SCALING`].
        pub scaling: Tag,
        /// As [`SCALING_STEPS`].
        pub scaling_steps: Tag,
        /// As [`FUNCTIONS`].
        pub functions: Tag,
    }

    /// Tags of rows of patches: irradiance.
    pub const IRRADIANCE: Set = Set {
        dimensions: DIMENSIONS,
        blocks: Some(BLOCKS),
        counts: COUNTS,
        indices: INDICES,
        values: VALUES,
        steps: STEPS,
        scaling: SCALING,
        scaling_steps: SCALING_STEPS,
        functions: FUNCTIONS,
    };

    /// Tags of rows of vertices: radiosity, whose terms are the channels R, G, B.
    pub const TRANSPORT: Set = Set {
        dimensions: Tag::from_static("aft.dim"),
        blocks: None,
        counts: Tag::from_static("aft.cnt"),
        indices: Tag::from_static("aft.idx"),
        values: Tag::from_static("aft.val"),
        steps: Tag::from_static("aft.vst"),
        scaling: Tag::from_static("aft.sca"),
        scaling_steps: Tag::from_static("aft.scs"),
        functions: Tag::from_static("aft.fun"),
    };

    /// Tags of rows of vertices: single scattering, whose terms are the channels R, G, B.
    pub const SINGLE: Set = Set {
        dimensions: Tag::from_static("afs.dim"),
        blocks: None,
        counts: Tag::from_static("afs.cnt"),
        indices: Tag::from_static("afs.idx"),
        values: Tag::from_static("afs.val"),
        steps: Tag::from_static("afs.vst"),
        scaling: Tag::from_static("afs.sca"),
        scaling_steps: Tag::from_static("afs.scs"),
        functions: Tag::from_static("afs.fun"),
    };

    impl Set {
        /// Tags of rows without blocks, in the order of the file.
        pub const fn all(self) -> [Tag; 8] {
            [
                self.dimensions,
                self.counts,
                self.indices,
                self.values,
                self.steps,
                self.scaling,
                self.scaling_steps,
                self.functions,
            ]
        }
    }
}

/// Number of faces of a cube map.
pub const FACES: usize = 6;
/// Largest number of texels along an edge of a face.
pub const MOST_SIDE: usize = 64;
/// Largest number of terms.
pub const MOST_TERMS: usize = 4;
/// Degree of the functions of the angle.
pub const DEGREE: usize = 9;
/// Largest number of patches of a block.
pub const MOST_BLOCK: usize = 1024;

/// Blocks of neighbouring patches, first and one past the last: the patches of each part, halved (the left half is the
/// larger one) until no piece has more than `most`. Empty where `most` is 0.
pub fn blocks(part_offsets: &[u32], most: usize) -> Vec<[u32; 2]> {
    fn halve(first: u32, end: u32, most: u32, blocks: &mut Vec<[u32; 2]>) {
        if end - first <= most {
            blocks.push([first, end]);
            return;
        }
        let middle = first + (end - first).div_ceil(2);
        halve(first, middle, most, blocks);
        halve(middle, end, most, blocks);
    }
    let mut result = Vec::new();
    let most = most.min(u32::MAX as usize) as u32;
    for pair in part_offsets.windows(2).filter(|pair| pair[0] < pair[1] && most > 0) {
        halve(pair[0], pair[1], most, &mut result);
    }
    result
}

/// The rows of all patches. A coefficient of term `j` is `value * step` of its patch.
///
/// In [`blocks`] the first row of a block is the mean of its patches. A row at the first patch of the right half of a
/// block, or of a half of a half and so on, is the mean of the left half less that of the right one.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct IrradianceRows {
    /// Texels along an edge of a face: a power of two, 2 to [`MOST_SIDE`].
    pub side: usize,
    /// Number of functions of the angle, 1 to [`MOST_TERMS`].
    pub terms: usize,
    /// Largest number of patches of a block, 2 to [`MOST_BLOCK`]; 0 where every row is its patch's own.
    pub block: usize,
    /// Patch `i` has the coefficients `offsets[i]..offsets[i + 1]`; `len = patches + 1`.
    pub offsets: Vec<u32>,
    /// Position of each coefficient, `face * side^2 + row * side + column`: strictly ascending inside a patch, never
    /// the first of a face.
    pub indices: Vec<u16>,
    /// Values patch by patch: for each term the values of all its coefficients.
    pub values: Vec<i8>,
    /// Step of `values` for each patch, finite and at least 0.
    pub steps: Vec<f32>,
    /// The first coefficient of each face, `[patch][term][face]`.
    pub scaling: Vec<i16>,
    /// Step of `scaling` for each patch, finite and at least 0.
    pub scaling_steps: Vec<f32>,
    /// f_j of each term, `len = terms`: the finite coefficients of `mu`, `mu^2`, ... of a polynomial in the cosine `mu`
    /// with the normal.
    pub functions: Vec<[f64; DEGREE]>,
}

impl IrradianceRows {
    /// Number of patches.
    pub fn patches(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.offsets[..])
            + size_of_val(&self.indices[..])
            + size_of_val(&self.values[..])
            + size_of_val(&self.steps[..])
            + size_of_val(&self.scaling[..])
            + size_of_val(&self.scaling_steps[..])
            + size_of_val(&self.functions[..])
    }

    /// Checks everything that [`IrradianceRows::from_sections`] guarantees.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        self.validate_as(&tags::IRRADIANCE)
    }

    pub(crate) fn validate_as(&self, tags: &tags::Set) -> Result<()> {
        self.validate_shape(tags)?;
        let face = self.side * self.side;
        for (patch, pair) in self.offsets.windows(2).enumerate() {
            let row = &self.indices[pair[0] as usize..pair[1] as usize];
            let ascending = row.windows(2).all(|pair| pair[0] < pair[1]);
            let inside = row.last().is_none_or(|last| usize::from(*last) < FACES * face);
            if !ascending || !inside || row.iter().any(|i| is_scaling(*i, face)) {
                return bad_indices(tags, patch);
            }
        }
        Ok(())
    }

    /// Checks everything except the indices.
    fn validate_shape(&self, tags: &tags::Set) -> Result<()> {
        check_dimensions(tags.dimensions, self.side, self.terms)?;
        check_block(tags, self.block)?;
        let (patches, count) = (self.patches(), self.indices.len());
        offsets(tags.counts, &self.offsets, count, Ranges::MayBeEmpty)?;
        if self.offsets.windows(2).any(|pair| pair[1] - pair[0] > u32::from(u16::MAX)) {
            return invalid(tags.counts, "a patch has more than 65535 coefficients");
        }
        same_length(tags.values, "values", self.values.len(), count.saturating_mul(self.terms))?;
        same_length(tags.scaling, "numbers", self.scaling.len(), patches.saturating_mul(FACES * self.terms))?;
        check_steps(tags.steps, &self.steps, patches)?;
        check_steps(tags.scaling_steps, &self.scaling_steps, patches)?;
        check_functions(tags, &self.functions, self.terms)
    }

    /// The sections, for [`crate::AssetFile::extra`].
    ///
    /// # Errors
    /// The rows are not valid.
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.to_sections_as(&tags::IRRADIANCE, Kind::Environment)
    }

    /// Like [`IrradianceRows::to_sections`], with other tags.
    ///
    /// # Errors
    /// The rows are not valid.
    pub fn to_sections_as(&self, tags: &tags::Set, kind: Kind) -> Result<Vec<RawSection>> {
        self.validate_as(tags)?;
        let counts: Vec<u16> = self.offsets.windows(2).map(|pair| (pair[1] - pair[0]) as u16).collect();
        let mut differences = Vec::with_capacity(self.indices.len());
        let mut values = Vec::with_capacity(self.values.len());
        for pair in self.offsets.windows(2) {
            let mut next = 0;
            for &index in &self.indices[pair[0] as usize..pair[1] as usize] {
                differences.push(index - next);
                next = index + 1;
            }
        }
        for term in 0..self.terms {
            for pair in self.offsets.windows(2) {
                let (first, count) = (pair[0] as usize, (pair[1] - pair[0]) as usize);
                let at = first * self.terms + term * count;
                values.extend_from_slice(&self.values[at..at + count]);
            }
        }
        let columns = FACES * self.terms;
        let scaling: Vec<u16> = (0..columns)
            .flat_map(|column| self.scaling.iter().skip(column).step_by(columns).map(|value| *value as u16))
            .collect();
        let codec = Codec::Zstd;
        let size = [self.side, self.terms, self.block].map(|number| number as u32);
        let dimensions = match tags.blocks {
            Some(tag) if self.block > 0 => RawSection::from_rows(tag, kind, codec, &[size]),
            _ => RawSection::from_rows(tags.dimensions, kind, codec, &[[size[0], size[1]]]),
        };
        Ok(vec![
            dimensions,
            RawSection::from_rows(tags.counts, kind, codec, &counts),
            RawSection::from_rows(tags.indices, kind, codec, &planes(&differences)),
            RawSection::from_rows(tags.values, kind, codec, &values),
            RawSection::from_rows(tags.steps, kind, codec, &self.steps),
            RawSection::from_rows(tags.scaling, kind, codec, &planes(&scaling)),
            RawSection::from_rows(tags.scaling_steps, kind, codec, &self.scaling_steps),
            RawSection::from_rows(tags.functions, kind, codec, &self.functions),
        ])
    }

    /// The rows of `patches` patches, `None` if the sections have none.
    ///
    /// # Errors
    /// Some of the sections are missing, of another type, or their content is not valid.
    pub fn from_sections(sections: &[RawSection], patches: usize) -> Result<Option<Self>> {
        Self::from_sections_as(sections, (&tags::IRRADIANCE, Kind::Environment), patches)
    }

    /// Like [`IrradianceRows::from_sections`], with other tags.
    ///
    /// # Errors
    /// Some of the sections are missing, of another type, or their content is not valid.
    pub fn from_sections_as(
        sections: &[RawSection],
        (tags, kind): (&tags::Set, Kind),
        patches: usize,
    ) -> Result<Option<Self>> {
        let mut all = tags.all();
        let is_there = |tag: Tag| sections.iter().any(|section| section.tag == tag);
        if let Some(blocks) = tags.blocks.filter(|tag| is_there(*tag)) {
            if is_there(all[0]) {
                return invalid(blocks, format!("there is {} as well", all[0]));
            }
            all[0] = blocks;
        }
        let Some(found) = pick(sections, all, kind)? else { return Ok(None) };
        let [size, counts, indices, values, steps, scaling, scaling_steps, functions] = found;
        let [side, terms, block] = dimensions(tags, size)?;
        let counts: Vec<u16> = counts.rows()?;
        same_length(tags.counts, "patches", counts.len(), patches)?;
        let total = counts.iter().map(|c| u64::from(*c)).sum::<u64>();
        let Some(count) = u32::try_from(total).ok().filter(|c| *c < u32::MAX).map(|c| c as usize) else {
            return invalid(tags.counts, format!("{total} coefficients are more than 2^32 - 2"));
        };
        let indices = indices.view::<u8>()?;
        same_length(tags.indices, "bytes", indices.len(), count.saturating_mul(2))?;
        let values = values.view::<i8>()?;
        same_length(tags.values, "values", values.len(), count.saturating_mul(terms))?;
        let columns = FACES * terms;
        let scaling = scaling.view::<u8>()?;
        same_length(tags.scaling, "bytes", scaling.len(), patches.saturating_mul(2 * columns))?;
        let steps = [(tags.steps, steps), (tags.scaling_steps, scaling_steps)].map(|(tag, section)| {
            let steps = section.rows::<f32>()?;
            check_steps(tag, &steps, patches)?;
            Ok(steps)
        });
        let [steps, scaling_steps] = steps;
        let functions: Vec<[f64; DEGREE]> = functions.rows()?;
        check_functions(tags, &functions, terms)?;
        let offsets = ends(&counts);
        Ok(Some(Self {
            side,
            terms,
            block,
            indices: places(tags, &offsets, indices.split_at(count), side * side)?,
            values: interleaved(&offsets, values, terms),
            steps: steps?,
            scaling: transposed(scaling, columns, patches),
            scaling_steps: scaling_steps?,
            functions,
            offsets,
        }))
    }
}

/// Side, terms and patches per block; 0 without blocks.
fn dimensions(tags: &tags::Set, section: &RawSection) -> Result<[usize; 3]> {
    let one = |rows: usize| invalid(section.tag, format!("{rows} rows, not 1"));
    let size = if section.tag == tags.dimensions {
        match section.rows::<[u32; 2]>()?[..] {
            [[side, terms]] => [side, terms, 0],
            ref rows => return one(rows.len()),
        }
    } else {
        match section.rows::<[u32; 3]>()?[..] {
            [[_, _, 0]] => return invalid(section.tag, "blocks of 0 patches"),
            [size] => size,
            ref rows => return one(rows.len()),
        }
    };
    let [side, terms, block] = size.map(|number| number as usize);
    check_dimensions(section.tag, side, terms)?;
    check_block(tags, block)?;
    Ok([side, terms, block])
}

fn check_dimensions(tag: Tag, side: usize, terms: usize) -> Result<()> {
    if !(side.is_power_of_two() && (2..=MOST_SIDE).contains(&side)) {
        return invalid(tag, format!("{side} texels along an edge: 2, 4, 8, ... {MOST_SIDE} are allowed"));
    }
    if !(1..=MOST_TERMS).contains(&terms) {
        return invalid(tag, format!("{terms} terms: 1 to {MOST_TERMS} are allowed"));
    }
    Ok(())
}

fn check_block(tags: &tags::Set, block: usize) -> Result<()> {
    match tags.blocks {
        _ if block == 0 => Ok(()),
        Some(_) if (2..=MOST_BLOCK).contains(&block) => Ok(()),
        Some(tag) => invalid(tag, format!("blocks of {block} patches: 2 to {MOST_BLOCK} are allowed")),
        None => invalid(tags.dimensions, "these rows are never in blocks"),
    }
}

fn check_steps(tag: Tag, steps: &[f32], patches: usize) -> Result<()> {
    same_length(tag, "patches", steps.len(), patches)?;
    match steps.iter().position(|step| !(step.is_finite() && *step >= 0.0)) {
        Some(i) => invalid(tag, format!("step {i} is not a finite number of at least 0")),
        None => Ok(()),
    }
}

fn check_functions(tags: &tags::Set, functions: &[[f64; DEGREE]], terms: usize) -> Result<()> {
    same_length(tags.functions, "terms", functions.len(), terms)?;
    in_range(tags.functions, "a coefficient", functions.as_flattened(), f64::NEG_INFINITY)
}

/// Low bytes of all numbers, then high bytes.
fn planes(numbers: &[u16]) -> Vec<u8> {
    numbers.iter().map(|n| *n as u8).chain(numbers.iter().map(|n| (n >> 8) as u8)).collect()
}

fn ends(counts: &[u16]) -> Vec<u32> {
    let mut end = 0;
    let ends = counts.iter().map(|count| {
        end += u32::from(*count);
        end
    });
    std::iter::once(0).chain(ends).collect()
}

/// Returns whether an index is the first of a face; `face` is a power of two.
fn is_scaling(index: u16, face: usize) -> bool {
    usize::from(index) & (face - 1) == 0
}

fn bad_indices<T>(tags: &tags::Set, patch: usize) -> Result<T> {
    invalid(tags.indices, format!("the indices of patch {patch} are not ascending places of details"))
}

/// Positions of all details from the low and the high bytes of their differences.
fn places(tags: &tags::Set, offsets: &[u32], (low, high): (&[u8], &[u8]), face: usize) -> Result<Vec<u16>> {
    let mut places = Vec::with_capacity(low.len());
    for (patch, pair) in offsets.windows(2).enumerate() {
        let (from, end) = (pair[0] as usize, pair[1] as usize);
        let bytes = low[from..end].iter().zip(&high[from..end]);
        places.extend(bytes.map(|(low, high)| u16::from_le_bytes([*low, *high])));
        if !add_up(&mut places[from..], face) {
            return bad_indices(tags, patch);
        }
    }
    Ok(places)
}

/// Turns the differences of a patch into positions; returns whether they are ascending positions of details.
fn add_up(row: &mut [u16], face: usize) -> bool {
    // At most 65535 numbers below 2^16.
    let end = row.iter().map(|difference| u32::from(*difference)).sum::<u32>() + row.len() as u32;
    if end as usize > FACES * face {
        return false;
    }
    // No sum of these is above `end`, so neither the lanes of the words below nor `next` overflow.
    let mut next = 0u16;
    let (words, rest) = row.as_chunks_mut::<4>();
    for word in words {
        let lanes = word.iter().rev().fold(0, |word, lane| word << 16 | u64::from(*lane));
        // Lane i of the product is the sum of lanes 0 to i; to it come the i places that lie between.
        let sums = lanes.wrapping_mul(0x0001_0001_0001_0001)
            + (u64::from(next) * 0x0001_0001_0001_0001 + 0x0003_0002_0001_0000);
        *word = std::array::from_fn(|i| (sums >> (16 * i)) as u16);
        next = word[3] + 1;
    }
    for place in rest {
        *place += next;
        next = *place + 1;
    }
    let mask = (face - 1) as u16;
    !row.iter().fold(false, |scaling, place| scaling | (place & mask == 0))
}

/// Reorders values from term after term to patch by patch.
fn interleaved(offsets: &[u32], planar: &[i8], terms: usize) -> Vec<i8> {
    let plane = planar.len() / terms;
    let mut values = Vec::with_capacity(planar.len());
    for pair in offsets.windows(2) {
        for term in 0..terms {
            values.extend_from_slice(&planar[term * plane..][pair[0] as usize..pair[1] as usize]);
        }
    }
    values
}

/// Converts byte planes of columns to numbers patch by patch, in blocks that stay in the nearest cache.
fn transposed(bytes: &[u8], columns: usize, patches: usize) -> Vec<i16> {
    const BLOCK: usize = 256;
    let (low, high) = bytes.split_at(bytes.len() / 2);
    let mut result = vec![0; columns * patches];
    for (i, block) in result.chunks_mut(BLOCK * columns).enumerate() {
        let count = block.len() / columns;
        for column in 0..columns {
            let from = column * patches + i * BLOCK;
            let plane = low[from..from + count].iter().zip(&high[from..from + count]);
            for (out, (low, high)) in block.iter_mut().skip(column).step_by(columns).zip(plane) {
                *out = i16::from_le_bytes([*low, *high]);
            }
        }
    }
    result
}
