//! Points of the far field, some of the receivers, a few sample spacings apart. It is smooth inside the split radius,
//! so that the receivers between are interpolated by kriging. Smoother functions are stored at every second, fourth or
//! eighth of the spacing only, and the other points interpolate them in the same way.

use std::collections::BTreeMap;

use glam::DVec3;
use translux_format::far_field::FarField;

use super::far_sums::Fill;
use crate::error::{Error, Result};
use crate::forms::projected::references::weights_among;
use crate::forms::sampled_scene::parts;
use crate::geometry::cluster::Run;
use crate::geometry::scattered::{Kriging, OrientedPoint, choose};
use crate::transport::far_field::LANES;
use crate::transport::interpolation::SharedWeights;
use crate::transport::receivers::{Group, NONE, Receivers};

/// Far-field interpolation. Closed bunny of 30 mm, points 4 sample spacings apart: 0.37 % from 32 sources, 0.72 % from
/// 16.
const FIT: Kriging = Kriging::SMOOTH;

/// Least points of a part that have a function, where it has as many: a spacing means nothing to a small part.
const LEAST_POINTS: usize = 64;

/// Points that something is interpolated from, and their weights.
pub(super) type Row = Vec<(u32, f64)>;

/// Points of the far field.
#[derive(serde::Serialize, serde::Deserialize)]
pub(super) struct FarPoints {
    /// The points, in groups; `of_vertex` has a point for their vertices alone.
    pub(super) receivers: Receivers,
    /// Level of each function, where chosen: its points are `2^level` times as far apart as all points.
    pub(super) levels: Vec<u8>,
    /// Stored rows: those of every point, then rows of other functions at some of the points.
    pub(super) rows: RowPlaces,
    /// Functions that points interpolate from the rows of others.
    pub(super) fills: Vec<Fill>,
    /// Weights of all receivers over the points; none where every receiver is a point.
    pub(super) weights: Option<SharedWeights>,
}

/// Rows in groups that lie close together, of similar values. Functions at every eighth of the points are grouped among
/// these points alone, those at every point among all.
#[derive(Default, serde::Serialize, serde::Deserialize)]
pub(super) struct RowPlaces {
    /// Places of the rows; no vertex takes their values.
    pub(super) places: Receivers,
    /// Functions of each group: bit k.
    pub(super) functions: Vec<u16>,
    /// Points of the rows behind those of all points.
    pub(super) others: Vec<u32>,
}

impl RowPlaces {
    /// The sets of functions that rows have, and the groups of each.
    pub(super) fn classes(&self) -> Vec<(u16, Vec<Group>)> {
        let mut classes: Vec<(u16, Vec<Group>)> = Vec::new();
        for (group, &functions) in self.places.groups.iter().zip(&self.functions) {
            match classes.iter_mut().find(|(known, _)| *known == functions) {
                Some((_, groups)) => groups.push(*group),
                None => classes.push((functions, vec![*group])),
            }
        }
        classes
    }

    /// The point of a row.
    pub(super) fn point(&self, row: u32) -> u32 {
        let points = self.places.len() - self.others.len();
        (row as usize).checked_sub(points).map_or(row, |i| self.others[i])
    }

    fn push(&mut self, all: &Receivers, part: u32, functions: u16, members: &[u32]) {
        for run in members.chunks(LANES) {
            let first = self.places.positions.len() as u32;
            self.places.positions.extend(run.iter().map(|&i| all.positions[i as usize]));
            let run = Run { first, end: self.places.positions.len() as u32 };
            self.places.groups.push(Group { run, part });
            self.functions.push(functions);
        }
    }
}

impl FarPoints {
    /// Chooses points among `all`, about `spacing_mm` apart; all of them at 0. Those of function k are `2^levels[k]`
    /// times as far apart.
    pub(super) fn choose(all: &Receivers, spacing_mm: f64, levels: &[u8]) -> Self {
        let places = places(all);
        let classes = classes(levels);
        let mut of_class: Vec<Vec<(u32, Vec<u32>)>> = vec![Vec::new(); classes.len()];
        for (range, group) in parts(all).into_iter().zip(all.groups.chunk_by(|a, b| a.part == b.part)) {
            let first = range.start as u32;
            let nested = match spacing_mm > 0.0 {
                true => choose(&places[range], spacing_mm),
                false => vec![(0..range.len() as u32).collect()],
            };
            for ((level, _), members) in classes.iter().zip(&mut of_class) {
                members.push((group[0].part, coarser(&nested, *level).map(|i| first + i).collect()));
            }
        }
        let mut rows = RowPlaces::default();
        let mut chosen: Vec<u32> = Vec::new();
        let mut index = vec![NONE; all.len()];
        for (class, ((_, functions), members)) in classes.iter().zip(&of_class).enumerate() {
            for (part, members) in members {
                rows.push(all, *part, *functions, members);
                if class == 0 {
                    members.iter().zip(chosen.len() as u32..).for_each(|(&i, point)| index[i as usize] = point);
                    chosen.extend(members);
                } else {
                    rows.others.extend(members.iter().map(|&i| index[i as usize]));
                }
            }
        }
        let of_vertex = all.of_vertex.iter().map(|&r| index.get(r as usize).copied().unwrap_or(NONE)).collect();
        Self { levels: levels.to_vec(), ..Self::new((all, &places), &chosen, of_vertex, rows) }
    }

    /// Points of a stored far field.
    ///
    /// # Errors
    /// Points that are not some of the receivers in their order (exit 3).
    pub(super) fn of(far: &FarField, all: &Receivers) -> Result<Self> {
        let apart = || Error::input("the far field and the mesh do not belong together; bake the asset again");
        let mut chosen = vec![NONE; far.receivers()];
        for (&point, &receiver) in far.receiver_of_vertex.iter().zip(&all.of_vertex) {
            if let Some(slot) = chosen.get_mut(point as usize) {
                *slot = receiver;
            }
        }
        if !chosen.is_sorted_by(|a, b| a < b) || chosen.last().is_some_and(|&last| last as usize >= all.len()) {
            return Err(apart());
        }
        let place = |row: usize| all.positions[chosen[far.receiver_of(row)] as usize];
        let mut rows = RowPlaces {
            places: Receivers { positions: (0..far.rows()).map(place).collect(), ..Receivers::default() },
            functions: far.groups.iter().map(|group| group.functions).collect(),
            others: far.others.clone(),
        };
        let mut first = 0;
        for group in &far.groups {
            rows.places.groups.push(Group { run: Run { first, end: group.rows_end }, part: group.part });
            first = group.rows_end;
        }
        let part_of = |index: u32| all.groups.get(all.groups.partition_point(|g| g.run.end <= index)).map(|g| g.part);
        let points = rows.places.groups.iter().filter(|g| g.run.range().end <= chosen.len());
        if !points.clone().all(|g| chosen[g.run.range()].iter().all(|&i| part_of(i) == Some(g.part))) {
            return Err(apart());
        }
        Ok(Self::new((all, &places(all)), &chosen, far.receiver_of_vertex.clone(), rows))
    }

    fn new(
        (all, places): (&Receivers, &[OrientedPoint]),
        chosen: &[u32],
        of_vertex: Vec<u32>,
        rows: RowPlaces,
    ) -> Self {
        let groups = rows.places.groups.iter().take_while(|group| group.run.range().end <= chosen.len());
        let receivers = Receivers {
            positions: rows.places.positions[..chosen.len()].to_vec(),
            normals: rows.places.normals.iter().take(chosen.len()).copied().collect(),
            groups: groups.copied().collect(),
            of_vertex,
            ..Receivers::default()
        };
        let weights = (chosen.len() != all.len()).then(|| {
            let targets: Vec<u32> = (0..all.len() as u32).collect();
            between(places, &parts(all), (chosen, &targets))
        });
        let fills = fills(&receivers, &rows);
        Self { receivers, levels: Vec::new(), rows, fills, weights }
    }

    /// Interpolates values at the points to all receivers.
    pub(super) fn expand(&self, values: Vec<DVec3>) -> Vec<DVec3> {
        let Some(weights) = &self.weights else { return values };
        let largest = values.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
        let scale = crate::transport::balanced_tree::power_of_two_near(largest);
        let single: Vec<[f32; 4]> = values.iter().map(|v| (*v / scale).extend(0.0).as_vec4().into()).collect();
        let mut gathered = Vec::new();
        weights.apply_signed(&single, &mut gathered);
        gathered.iter().map(|&[r, g, b, _]| DVec3::new(r.into(), g.into(), b.into()) * scale).collect()
    }

    /// Weights of a point for the functions of a fill; `None` where it has them itself.
    pub(super) fn row_of(&self, fill: &Fill, point: u32) -> Option<Row> {
        let place = fill.receivers.binary_search(&point).ok()?;
        Some(fill.weights.of(place).map(|(row, w)| (self.rows.point(row), f64::from(w))).collect())
    }

    /// Number of points, and of those that some functions have, in words.
    pub(super) fn describe(&self) -> String {
        let points = self.receivers.len();
        let of_class = |(functions, groups): &(u16, Vec<Group>)| {
            let rows: usize = groups.iter().map(|group| group.run.range().len()).sum();
            let place = if rows == points { "all".to_owned() } else { rows.to_string() };
            format!("{} at {place}", functions.count_ones())
        };
        let classes: Vec<String> = self.rows.classes().iter().map(of_class).collect();
        match classes.len() {
            0 | 1 => format!("{points} points"),
            _ => format!("{points} points, of the functions {}", classes.join(", ")),
        }
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.weights.as_ref().map_or(0, SharedWeights::bytes)
            + self.fills.iter().map(Fill::bytes).sum::<usize>()
            + size_of_val(self.receivers.positions.as_slice())
    }
}

/// Positions without normals: kernels are smooth across an edge, and through something thin.
fn places(all: &Receivers) -> Vec<OrientedPoint> {
    all.positions.iter().map(|&at_mm| OrientedPoint { at_mm, normal: DVec3::ZERO }).collect()
}

/// Approximate spacing of `count` points among others, mm: affects only the speed of finding neighbours.
fn apart_mm(points: &[OrientedPoint], count: usize) -> f64 {
    let grow = |(low, high): (DVec3, DVec3), p: &OrientedPoint| (low.min(p.at_mm), high.max(p.at_mm));
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), grow);
    low.distance(high) / (count.max(1) as f64).sqrt()
}

fn between(
    places: &[OrientedPoint],
    parts: &[std::ops::Range<usize>],
    (sources, targets): (&[u32], &[u32]),
) -> SharedWeights {
    let spacing_mm = apart_mm(places, sources.len());
    SharedWeights::new(&weights_among(places, parts, (sources, targets), spacing_mm, FIT))
}

/// Functions that points interpolate because their own rows lack them.
fn fills(points: &Receivers, rows: &RowPlaces) -> Vec<Fill> {
    let places = places(points);
    let of_groups = |k: u32, groups: &[Group]| -> Vec<bool> {
        rows.functions.iter().take(groups.len()).map(|mask| mask >> k & 1 == 1).collect()
    };
    // Functions of the same groups share their weights.
    let mut functions_of: BTreeMap<Vec<bool>, u16> = BTreeMap::new();
    let all = rows.functions.iter().fold(0, |all, mask| all | mask);
    for k in (0..u16::BITS).filter(|k| all >> k & 1 == 1) {
        *functions_of.entry(of_groups(k, &rows.places.groups)).or_default() |= 1 << k;
    }
    let fill = |(has, functions): (Vec<bool>, u16)| {
        let members = |groups: &[Group], wanted: bool| -> Vec<u32> {
            let groups = groups.iter().zip(&has).filter(|(_, has)| **has == wanted);
            groups.flat_map(|(group, _)| group.run.first..group.run.end).collect()
        };
        let targets = members(&points.groups, false);
        // Part after part: the sort is stable, and points of a part lie together.
        let mut sources = members(&rows.places.groups, true);
        sources.sort_by_key(|&row| rows.point(row));
        let sources_at: Vec<u32> = sources.iter().map(|&row| rows.point(row)).collect();
        let mut weights = between(&places, &parts(points), (&sources_at, &targets));
        weights.rename_sources(&sources);
        Fill { functions, receivers: targets, weights }
    };
    functions_of.into_iter().map(fill).filter(|fill| !fill.receivers.is_empty()).collect()
}

/// The levels that functions have, the finest first, and the functions of each: bit k.
fn classes(levels: &[u8]) -> Vec<(u8, u16)> {
    let mut classes: BTreeMap<u8, u16> = BTreeMap::new();
    levels.iter().enumerate().for_each(|(k, &level)| *classes.entry(level).or_default() |= 1 << k);
    if classes.is_empty() {
        classes.insert(0, 0);
    }
    classes.into_iter().collect()
}

/// Points of a level of spacing or a coarser one, ascending; `nested` has those each level adds, the coarsest first.
fn coarser(nested: &[Vec<u32>], level: u8) -> impl Iterator<Item = u32> {
    let mut members = Vec::new();
    for (i, added) in nested.iter().enumerate() {
        if nested.len() - 1 - i >= usize::from(level) || members.len() < LEAST_POINTS {
            members.extend(added);
        }
    }
    members.sort_unstable();
    members.into_iter()
}

#[cfg(test)]
#[path = "points_tests.rs"]
mod tests;
