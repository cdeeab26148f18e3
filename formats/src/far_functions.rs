//! Rows of a far field with only some of the basis functions: wide functions need fewer receivers than narrow ones.

use std::collections::BTreeMap;

use crate::asset::{RawSection, pick};
use crate::checks::{indices_below, invalid, same_length};
use crate::error::Result;
use crate::far_data::{FarField, all_functions, group_sizes, tags};
use crate::types::{Codec, Kind};

/// The sections of functions and rows; none where every group has every function.
pub(crate) fn sections(field: &FarField) -> Vec<RawSection> {
    let (kind, zstd) = (Kind::Method, Codec::Zstd);
    let masks: Vec<u16> = field.groups.iter().map(|group| group.functions).collect();
    let mut sections = Vec::new();
    if masks.iter().any(|&mask| mask != all_functions(field.terms)) {
        sections.push(RawSection::from_rows(tags::FUNCTIONS, kind, zstd, &masks));
    }
    if !field.others.is_empty() {
        sections.push(RawSection::from_rows(tags::ROWS, kind, zstd, &field.others));
    }
    sections
}

/// Sets the functions of the groups (all, without the section) and the receivers of the rows.
///
/// # Errors
/// Sections of another type, or functions of another number of groups.
pub(crate) fn read(sections: &[RawSection], field: &mut FarField) -> Result<()> {
    let masks = match pick(sections, [tags::FUNCTIONS], Kind::Method)? {
        Some([section]) => section.rows()?,
        None => vec![all_functions(field.terms); field.groups.len()],
    };
    same_length(tags::FUNCTIONS, "groups", masks.len(), field.groups.len())?;
    field.groups.iter_mut().zip(masks).for_each(|(group, mask)| group.functions = mask);
    if let Some([section]) = pick(sections, [tags::ROWS], Kind::Method)? {
        field.others = section.rows()?;
    }
    Ok(())
}

/// Checks that the first rows belong to the receivers, and the others to receivers of their part.
///
/// # Errors
/// [`crate::FormatError::Invalid`] with the tag of the section at fault.
pub(crate) fn check_rows(field: &FarField) -> Result<()> {
    let tag = tags::ROWS;
    if field.others.is_empty() {
        return Ok(());
    }
    let receivers = field.receivers();
    if !field.groups.iter().any(|group| group.rows_end as usize == receivers) {
        return invalid(tag, format!("{} rows, so that the first {receivers} end inside a group", field.others.len()));
    }
    indices_below(tag, field.others.iter().copied(), receivers)?;
    let part_of = |row: usize| {
        let group = field.groups.partition_point(|group| group.rows_end as usize <= row);
        field.groups.get(group).map(|group| group.part)
    };
    match field.others.iter().zip(receivers..).position(|(&receiver, row)| part_of(row) != part_of(receiver as usize)) {
        Some(i) => {
            invalid(tag, format!("row {} gathers from another part than receiver {}", receivers + i, field.others[i]))
        }
        None => Ok(()),
    }
}

/// Checks the functions of the groups: known ones and at least one, each in some group of each part, none twice for a
/// receiver, no coefficient or sum of a function that its group lacks. Lengths and orders have been checked.
///
/// # Errors
/// [`crate::FormatError::Invalid`] with the tag of the section at fault.
pub(crate) fn check(field: &FarField) -> Result<()> {
    let all = all_functions(field.terms);
    let mut of_part: BTreeMap<u32, u16> = BTreeMap::new();
    let mut of_receiver = vec![0u16; field.receivers()];
    let (mut masks, mut first) = (field.masks.iter(), 0);
    let mut sums = field.row_sums.chunks_exact(field.terms.max(1));
    for ((g, group), (rows, coefficients)) in field.groups.iter().enumerate().zip(group_sizes(&field.groups)) {
        let (functions, others) = (group.functions, !group.functions & all);
        if functions == 0 || functions & !all != 0 {
            let what = format!("group {g} has the functions {functions:x} of {} functions", field.terms);
            return invalid(tags::FUNCTIONS, what);
        }
        *of_part.entry(group.part).or_default() |= functions;
        for row in first..first + rows {
            let known = &mut of_receiver[field.receiver_of(row)];
            if *known & functions != 0 {
                return invalid(tags::ROWS, format!("row {row} has functions that its receiver has already"));
            }
            *known |= functions;
        }
        first += rows;
        if masks.by_ref().take(coefficients).fold(0, |all, mask| all | mask) & others != 0 {
            return invalid(tags::MASKS, format!("group {g} has coefficients of functions that it has not"));
        }
        let has_sums = |sums: &[f32]| (0..field.terms).any(|k| others >> k & 1 == 1 && sums[k] != 0.0);
        // All are taken: the next group begins behind them.
        if sums.by_ref().take(rows).filter(|sums| has_sums(sums)).count() > 0 {
            return invalid(tags::ROW_SUMS, format!("group {g} has sums of functions that it has not"));
        }
    }
    match of_part.iter().find(|(_, functions)| **functions != all) {
        Some((part, functions)) => {
            let none = all & !functions;
            invalid(tags::FUNCTIONS, format!("no group of part {part} has the functions {none:x}"))
        }
        None => Ok(()),
    }
}
