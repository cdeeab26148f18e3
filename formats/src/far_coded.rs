//! The coefficients of a far field, entropy-coded: the nodes of the tree that a group keeps, the functions of each, and
//! their values.
//!
//! Neighbouring groups keep nearly the same coefficients, children are like their parents, and functions at one node
//! have the same shape over the lanes. So the tree is walked from the root of each group, and every bit is coded under
//! a probability that depends on the last group that kept the node ("before"), on the node above ("parent"), on the
//! previous function at the same node ("beside") and on the row itself.

use crate::checks::invalid;
use crate::error::{FormatError, Result};
use crate::far_data::{FarField, Group, LANES, MOST_TERMS, Shape, tags};
use crate::far_values::bits;
use crate::range_coder::{Bit, Coder, Decoder, Encoder, Known, Lengths, MAGNITUDE_BITS, Mantissas, magnitude};
use crate::types::Budget;
use crate::varints;

/// Number of tree levels with probabilities of their own.
const LEVELS: usize = 20;

/// Number of bands of the lanes' transform: the mean, and four of details.
const BANDS: usize = 5;

/// Number of classes of expected magnitudes, half an octave each.
const CLASSES: usize = 14;

/// Largest number of streams, each for one thread. Four cost 0.5 % of the bytes of one.
const STREAMS: usize = 4;

/// Bytes of a coefficient besides its rows: node, mask, mask of the wide rows, first row.
const BYTES_PER_COEFFICIENT: u64 = 12;

/// Index that stands for no coefficient or no group.
const NONE: u32 = u32::MAX;

/// Band of each lane.
const BAND: [usize; LANES] = [0, 1, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4];

type Row = [i16; LANES];

/// Class of a size on a scale of half octaves: 0, 1, 2, 3, 4 to 5, 6 to 7, 8 to 11, ...
#[inline(always)]
fn class(size: u32) -> usize {
    if size < 4 {
        return size as usize;
    }
    let octave = size.ilog2();
    ((2 * octave + (size >> (octave - 1) & 1)) as usize).min(CLASSES - 1)
}

/// Class of a sign: zero, positive, negative.
#[inline(always)]
fn sign(value: i16) -> usize {
    if value == 0 { 0 } else { 1 + usize::from(value < 0) }
}

/// Everything learned so far.
struct Models {
    /// Models of whether anything is kept in a subtree: by level, by the number of functions that the parent keeps, and
    /// by earlier groups there.
    some: Vec<[[Bit; 3]; 4]>,
    /// Models of whether a function is kept: by function, and by whether before, parent, left sibling (none, no, yes)
    /// and the previous function keep it.
    kept: Vec<[[[[Bit; 2]; 3]; 3]; 3]>,
    /// Models of lengths by band, and by the size expected from the row itself and from the others.
    lengths: Vec<[[Lengths; CLASSES]; CLASSES]>,
    /// Models of mantissas by band and size.
    mantissas: Vec<[Mantissas; CLASSES]>,
    /// Models of signs by function, band, and the signs of beside, before and parent.
    signs: Vec<[[[[Bit; 3]; 3]; 3]; BANDS]>,
}

impl Models {
    fn new() -> Self {
        Self {
            some: vec![[[Bit::NEW; 3]; 4]; LEVELS],
            kept: vec![[[[[Bit::NEW; 2]; 3]; 3]; 3]; MOST_TERMS],
            lengths: vec![[[[Bit::NEW; MAGNITUDE_BITS]; CLASSES]; CLASSES]; BANDS],
            mantissas: vec![[[[Bit::NEW; 8]; MAGNITUDE_BITS]; CLASSES]; BANDS],
            signs: vec![[[[[Bit::NEW; 3]; 3]; 3]; BANDS]; MOST_TERMS],
        }
    }

    /// Codes a row of a function; returns `false` where a value is no i16.
    #[inline(always)]
    fn row<C: Coder>(&mut self, coder: &mut C, k: usize, [beside, before, parent]: [&Row; 3], row: &mut Row) -> bool {
        let size = |value: i16| u32::from(value.unsigned_abs());
        let mut fits = true;
        for lane in 0..LANES {
            let band = BAND[lane];
            let own = match lane {
                0 => size(beside[0]),
                1 => size(row[0]) / 2,
                // The coarser detail over the same lanes, and what the band has had.
                2 | 4 | 8 => 2 * size(row[lane / 2]),
                5 | 9 => size(row[lane / 2]) + size(row[lane - 1]),
                3 => size(row[1]) + size(row[2]),
                _ => (2 * size(row[lane / 2]) + size(row[lane - 1]) + size(row[lane - 2])) / 2,
            };
            let others = match lane {
                0 => size(before[0]),
                _ => (size(before[lane]) + size(beside[lane])) / 2 + size(parent[lane]) / 2,
            };
            let (own, others) = (class(own), class(others));
            let (lengths, mantissas) = (&mut self.lengths[band][own][others], &mut self.mantissas[band][others]);
            let size = magnitude(coder, Known::Nothing, lengths, mantissas, size(row[lane]));
            if size == 0 {
                row[lane] = 0;
                continue;
            }
            let signs = &mut self.signs[k][band][sign(beside[lane])][sign(before[lane])];
            let negative = coder.bit(&mut signs[sign(parent[lane])], row[lane] < 0);
            fits &= size <= i16::MAX as u32 + u32::from(negative);
            row[lane] = if negative { (size as i32).wrapping_neg() as i16 } else { size as i16 };
        }
        fits
    }
}

/// Coefficients in a given order, with the rows of their functions.
#[derive(Default)]
struct Coefficients {
    nodes: Vec<u32>,
    masks: Vec<u16>,
    /// First row of each coefficient.
    starts: Vec<u32>,
    rows: Vec<Row>,
}

impl Coefficients {
    /// The rows of a coefficient, function after function.
    fn rows(&self, coefficient: usize) -> &[Row] {
        let start = self.starts[coefficient] as usize;
        &self.rows[start..start + self.masks[coefficient].count_ones() as usize]
    }

    /// The row of a function; zeros where it is not kept or there is no coefficient.
    #[inline(always)]
    fn row(&self, coefficient: u32, k: usize) -> &Row {
        const ZEROS: Row = [0; LANES];
        let Some(&mask) = self.masks.get(coefficient as usize) else { return &ZEROS };
        if mask >> k & 1 == 0 {
            return &ZEROS;
        }
        let place = (mask & ((1 << k) - 1)).count_ones();
        self.rows.get((self.starts[coefficient as usize] + place) as usize).unwrap_or(&ZEROS)
    }
}

/// A walk through all groups, for coding or decoding.
struct Walk<'a, C> {
    coder: C,
    models: Models,
    terms: usize,
    /// The coefficients to code, in the order of the far field; empty for decoding.
    given: &'a Coefficients,
    /// The group's functions, as a mask.
    functions: u16,
    /// The coefficients coded so far, in the order of the walk.
    done: Coefficients,
    /// Largest numbers of coefficients of the group, and of rows in total.
    most: (usize, usize),
    /// Last coefficient of each node, and last group with one there or below.
    last: Vec<(u32, u32)>,
    group: u32,
}

/// Position of a walk in the tree.
#[derive(Clone, Copy)]
struct Place {
    first: u32,
    end: u32,
    level: usize,
    parent: u32,
    /// The left sibling and its coefficient.
    sibling: Sibling,
}

#[derive(Clone, Copy)]
enum Sibling {
    /// The node is a left child or the root.
    Left,
    /// The node is a right child; the left one has this coefficient or none.
    Of(u32),
}

impl<C: Coder> Walk<'_, C> {
    /// Codes a node and its subtree, whose given coefficients are `range`. Returns the coefficient of the node, or
    /// [`NONE`] without one; `None` where the stream cannot come from the encoder.
    fn visit(&mut self, place: Place, range: std::ops::Range<usize>) -> Option<u32> {
        let Place { first, end, level, parent, sibling } = place;
        if end - first <= 1 {
            return Some(NONE);
        }
        let middle = first + (end - first).div_ceil(2);
        let (before, seen) = self.last[middle as usize];
        let parent_mask = self.done.masks.get(parent as usize).copied().unwrap_or(0);
        let above =
            [0, 1, 1, 2, 2, 2][(parent_mask.count_ones() as usize).min(5)] + usize::from(parent_mask.count_ones() > 6);
        let history = if seen == NONE { 0 } else { 1 + usize::from(seen + 1 == self.group) };
        let some = &mut self.models.some[level.min(LEVELS - 1)][above][history];
        if !self.coder.bit(some, !range.is_empty()) {
            return Some(NONE);
        }
        self.last[middle as usize].1 = self.group;
        let had = self.done.nodes.len();
        let nodes = self.given.nodes.get(range.clone()).unwrap_or(&[]);
        let at = range.start + nodes.partition_point(|&node| node < middle);
        let is_there = self.given.nodes.get(at) == Some(&middle) && at < range.end;
        let given = if is_there { self.given.masks[at] } else { 0 };
        let mask = self.mask(given, before, parent_mask, parent != NONE, sibling);
        let mut coefficient = NONE;
        if mask != 0 {
            coefficient = self.done.nodes.len() as u32;
            let start = self.done.rows.len();
            if self.done.nodes.len() >= self.most.0 || start + mask.count_ones() as usize > self.most.1 {
                return None;
            }
            let mut beside: Row = [0; LANES];
            for (i, k) in bits(mask).enumerate() {
                let mut row = if is_there { self.given.rows(at)[i] } else { [0; LANES] };
                let (before, parent) = (self.done.row(before, k), self.done.row(parent, k));
                if !self.models.row(&mut self.coder, k, [&beside, before, parent], &mut row) {
                    return None;
                }
                beside = row;
                self.done.rows.push(row);
            }
            self.done.nodes.push(middle);
            self.done.masks.push(mask);
            self.done.starts.push(start as u32);
            self.last[middle as usize].0 = coefficient;
        }
        let (left, right) = (range.start..at, at + usize::from(is_there)..range.end);
        let child = Place { first, end: middle, level: level + 1, parent: coefficient, sibling: Sibling::Left };
        let sibling = self.visit(child, left)?;
        self.visit(Place { first: middle, end, sibling: Sibling::Of(sibling), ..child }, right)?;
        (self.done.nodes.len() > had).then_some(coefficient)
    }

    fn mask(&mut self, given: u16, before: u32, parent: u16, has_parent: bool, sibling: Sibling) -> u16 {
        let before = self.done.masks.get(before as usize).copied();
        let sibling = match sibling {
            Sibling::Left => None,
            Sibling::Of(coefficient) => Some(self.done.masks.get(coefficient as usize).copied().unwrap_or(0)),
        };
        let parent = has_parent.then_some(parent);
        let state = |mask: Option<u16>, k: usize| mask.map_or(0, |mask| 1 + usize::from(mask >> k & 1));
        let (mut mask, mut last) = (0, false);
        for (k, models) in self.models.kept.iter_mut().enumerate().take(self.terms) {
            if self.functions >> k & 1 == 0 {
                last = false;
                continue;
            }
            let models = &mut models[state(before, k)][state(parent, k)][state(sibling, k)];
            last = self.coder.bit(&mut models[usize::from(last)], given >> k & 1 == 1);
            mask |= u16::from(last) << k;
        }
        mask
    }
}

/// A new walk over the nodes of `samples` samples.
fn walk<C: Coder>(coder: C, given: &Coefficients, terms: usize, samples: usize) -> Walk<'_, C> {
    let (models, done, last) = (Models::new(), Coefficients::default(), vec![(NONE, NONE); samples]);
    Walk { coder, models, terms, given, functions: u16::MAX, done, most: (usize::MAX, usize::MAX), last, group: 0 }
}

/// The root of a part's tree.
fn root((first, end): (u32, u32)) -> Place {
    Place { first, end, level: 0, parent: NONE, sibling: Sibling::Left }
}

/// Number of samples of all parts.
fn samples(shape: &Shape<'_>) -> usize {
    shape.part_offsets.last().map_or(0, |end| *end as usize)
}

/// Encodes nodes, masks and values of a valid far field: varints (the number of streams, and groups, rows and bytes of
/// each), then the streams.
///
/// # Errors
/// [`FormatError::Invalid`] where a row of 16 bits fits 8, which a reader could not tell.
pub(crate) fn encode(field: &FarField, shape: &Shape<'_>) -> Result<Vec<u8>> {
    let given = joined(field)?;
    let runs: Vec<&[Group]> = field.groups.chunks(field.groups.len().div_ceil(STREAMS).max(1)).collect();
    let firsts = std::iter::once(0).chain(runs.iter().map(|run| end_of(run)));
    let jobs: Vec<(&[Group], usize)> = runs.iter().copied().zip(firsts).collect();
    let mut head = Vec::new();
    varints::push(&mut head, jobs.len() as u32);
    let mut body = Vec::new();
    for ((run, _), coded) in jobs.iter().zip(in_parallel(&jobs, |job| encode_run(&given, field.terms, *job, shape))) {
        let (rows, bytes) = coded?;
        let numbers = [run.len(), rows, bytes.len()].map(u32::try_from);
        let [Ok(groups), Ok(rows), Ok(length)] = numbers else {
            return invalid(tags::CODED, "the far field is too large for 32-bit numbers");
        };
        [groups, rows, length].into_iter().for_each(|number| varints::push(&mut head, number));
        body.extend(bytes);
    }
    head.extend(body);
    Ok(head)
}

/// The coefficients, with rows of one width.
fn joined(field: &FarField) -> Result<Coefficients> {
    let mut given = Coefficients { nodes: field.nodes.clone(), masks: field.masks.clone(), ..Coefficients::default() };
    let (mut narrow, mut wide) = (field.narrow.iter(), field.wide.iter());
    for (&mask, &wide_mask) in field.masks.iter().zip(&field.wide_masks) {
        given.starts.push(given.rows.len() as u32);
        for k in bits(mask) {
            let is_wide = wide_mask >> k & 1 == 1;
            let row = if is_wide { wide.next().copied() } else { narrow.next().map(|row| row.map(i16::from)) };
            let row = row.unwrap_or([0; LANES]);
            if is_wide && is_narrow(&row) {
                return invalid(tags::WIDE, "a row of 16-bit values fits 8 bits");
            }
            given.rows.push(row);
        }
    }
    Ok(given)
}

/// Encodes some groups, whose coefficients begin at `first`: number of rows, and stream.
fn encode_run(
    given: &Coefficients,
    terms: usize,
    (groups, mut first): (&[Group], usize),
    shape: &Shape<'_>,
) -> Result<(usize, Vec<u8>)> {
    let mut walk = walk(Encoder::new(), given, terms, samples(shape));
    for group in groups {
        let (part, end) = (shape.samples(group.part).unwrap_or_default(), group.coefficients_end as usize);
        walk.functions = group.functions;
        // Groups without coefficients are known from their ends.
        if first < end && walk.visit(root(part), first..end).is_none() {
            return invalid(tags::CODED, "the coefficients do not fit the tree");
        }
        first = end;
        walk.group += 1;
    }
    Ok((walk.done.rows.len(), walk.coder.finish()))
}

fn is_narrow(row: &Row) -> bool {
    row.iter().all(|value| i8::try_from(*value).is_ok())
}

fn end_of(groups: &[Group]) -> usize {
    groups.last().map_or(0, |group| group.coefficients_end as usize)
}

/// Results of the jobs, in their order; several jobs run on a thread each.
fn in_parallel<J: Sync, T: Send>(jobs: &[J], work: impl Fn(&J) -> Result<T> + Sync) -> Vec<Result<T>> {
    if jobs.len() < 2 {
        return jobs.iter().map(work).collect();
    }
    std::thread::scope(|scope| {
        let work = &work;
        let threads: Vec<_> = jobs.iter().map(|job| scope.spawn(move || work(job))).collect();
        let ended = threads.into_iter().map(|thread| thread.join());
        // No thread panics; if one did, its coefficients would be missing.
        ended.map(|result| result.unwrap_or_else(|_| invalid(tags::CODED, "a thread ended early"))).collect()
    })
}

/// A stream with its groups.
struct Job<'a> {
    groups: &'a [Group],
    first: usize,
    rows: usize,
    stream: &'a [u8],
}

/// The streams; together they have all groups, and nothing follows the last.
fn jobs<'a>(mut bytes: &'a [u8], groups: &'a [Group]) -> Option<Vec<Job<'a>>> {
    let count = varints::take(&mut bytes).filter(|count| *count as usize <= STREAMS)?;
    let mut numbers = Vec::new();
    for _ in 0..count {
        numbers.push([varints::take(&mut bytes)?, varints::take(&mut bytes)?, varints::take(&mut bytes)?]);
    }
    let (mut rest, mut first, mut jobs) = (groups, 0, Vec::new());
    for numbers in numbers {
        let [count, rows, length] = numbers.map(|number| number as usize);
        let (groups, others) = rest.split_at_checked(count)?;
        let (stream, behind) = bytes.split_at_checked(length)?;
        jobs.push(Job { groups, first, rows, stream });
        (rest, bytes, first) = (others, behind, end_of(groups).max(first));
    }
    (rest.is_empty() && bytes.is_empty()).then_some(jobs)
}

/// Undoes [`encode`]: nodes, masks and values of a far field whose groups and steps are valid. Takes the memory of the
/// rows in 16 bits, which the budget limits, as much again for the result, and 8 bytes for each sample and stream.
///
/// # Errors
/// [`FormatError::OverBudget`] and [`FormatError::OutOfMemory`] before memory is taken, [`FormatError::Invalid`] for
/// bytes that [`encode`] does not write.
pub(crate) fn decode(bytes: &[u8], field: &mut FarField, shape: &Shape<'_>, budget: Budget) -> Result<()> {
    let tag = tags::CODED;
    let groups = std::mem::take(&mut field.groups);
    let Some(jobs) = jobs(bytes, &groups) else {
        return invalid(tag, "it does not begin with the groups, rows and bytes of its streams");
    };
    let rows: u64 = jobs.iter().map(|job| job.rows as u64).sum();
    let needed = end_of(&groups) as u64 * BYTES_PER_COEFFICIENT + rows * size_of::<Row>() as u64;
    if needed > budget.max_decoded_bytes {
        return Err(FormatError::OverBudget { tag, needed, budget: budget.max_decoded_bytes });
    }
    let terms = field.terms;
    let read = in_parallel(&jobs, |job| decode_run(job, terms, shape));
    for (job, done) in jobs.iter().zip(read) {
        let done = done?;
        let mut first = 0;
        for group in job.groups {
            let end = group.coefficients_end as usize - job.first;
            let mut order: Vec<usize> = (first..end).collect();
            order.sort_unstable_by_key(|&c| done.nodes[c]);
            order.into_iter().for_each(|c| push(field, &done, c));
            first = end;
        }
    }
    field.groups = groups;
    Ok(())
}

fn push(field: &mut FarField, done: &Coefficients, c: usize) {
    field.nodes.push(done.nodes[c]);
    field.masks.push(done.masks[c]);
    let mut wide_mask = 0;
    for (k, row) in bits(done.masks[c]).zip(done.rows(c)) {
        if is_narrow(row) {
            field.narrow.push(row.map(|value| value as i8));
        } else {
            wide_mask |= 1 << k;
            field.wide.push(*row);
        }
    }
    field.wide_masks.push(wide_mask);
}

fn decode_run(job: &Job<'_>, terms: usize, shape: &Shape<'_>) -> Result<Coefficients> {
    let &Job { groups, first, rows, stream } = job;
    let tag = tags::CODED;
    let count = end_of(groups).saturating_sub(first);
    let nothing = Coefficients::default();
    let mut walk = walk(Decoder::new(stream), &nothing, terms, samples(shape));
    let done = &mut walk.done;
    let reserved = [
        done.nodes.try_reserve_exact(count),
        done.starts.try_reserve_exact(count),
        done.masks.try_reserve_exact(count),
        done.rows.try_reserve_exact(rows),
    ];
    if reserved.iter().any(|reserved| reserved.is_err()) {
        let bytes = count as u64 * BYTES_PER_COEFFICIENT + rows as u64 * size_of::<Row>() as u64;
        return Err(FormatError::OutOfMemory { tag, bytes });
    }
    for group in groups {
        let part = shape.samples(group.part).unwrap_or_default();
        let end = group.coefficients_end as usize - first;
        (walk.most, walk.functions) = ((end, rows), group.functions);
        let visited = walk.done.nodes.len() == end || walk.visit(root(part), 0..0).is_some();
        if !visited || walk.done.nodes.len() != end {
            return invalid(tag, "the coefficients of a group are damaged");
        }
        walk.group += 1;
    }
    let Walk { coder, done, .. } = walk;
    if done.rows.len() != rows || !coder.finish() {
        return invalid(tag, "the coefficients are damaged: their stream does not end as it must");
    }
    Ok(done)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Sizes and speed on a real asset: `TLUX=FILE cargo test --release -p translux-format --lib sizes -- --ignored
    /// --nocapture`.
    #[test]
    #[ignore = "prints sizes and times of the asset that TLUX names"]
    fn sizes() {
        let bytes = std::fs::read(std::env::var("TLUX").unwrap()).unwrap();
        let asset = crate::AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
        let shape = Shape::new(asset.mesh.positions_mm.len(), &asset.samples);
        let field = FarField::from_sections(&asset.extra, &shape).unwrap().unwrap();
        let plain = field.to_sections(&shape).unwrap();
        let coded = encode(&field, &shape).unwrap();
        let replaced = [tags::NODES, tags::MASKS, tags::WIDE_MASKS, tags::NARROW, tags::WIDE];
        let mut before = 0;
        for section in plain.iter().filter(|section| replaced.contains(&section.tag)) {
            let stored = zstd::bulk::compress(&section.bytes, crate::ZSTD_LEVEL).unwrap().len();
            println!("{}: {} bytes, zstd {stored}", section.tag, section.bytes.len());
            before += stored;
        }
        println!("zstd {before}, coded {} bytes: {:.3}", coded.len(), coded.len() as f64 / before as f64);
        for _ in 0..3 {
            let start = std::time::Instant::now();
            let mut back = FarField { groups: field.groups.clone(), terms: field.terms, ..FarField::default() };
            decode(&coded, &mut back, &shape, Budget::default()).unwrap();
            println!(
                "{} rows decoded in {:.0} ms",
                field.narrow.len() + field.wide.len(),
                1e3 * start.elapsed().as_secs_f64()
            );
            assert!(back.nodes == field.nodes && back.narrow == field.narrow && back.wide == field.wide);
            assert!(back.masks == field.masks && back.wide_masks == field.wide_masks);
        }
    }
}
