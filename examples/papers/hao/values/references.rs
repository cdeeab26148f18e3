//! Reference points (the paper's section 4.2): values of some vertices in one byte each; every other vertex is a weighted sum of
//! three of them and spherical harmonics of what is left.

use glam::Vec3;
use rayon::prelude::*;
use translux_format::coefficients::{decode, encode};
use translux_format::quantised_values::{QuantisedValues as File, tags};
use translux_format::{Budget, FormatError};

use super::super::settings::ChosenBy;
use super::codes::{self, Table};
use super::harmonics::{Projection, integers, scales};
use super::matrix::{Cells, Matrix};
use super::prediction::Earlier;
use super::{CHANNELS, Topology};
use crate::hao::harmonic_fit::Window;
use crate::hao::reference_points::{Choice, Prediction, Weights, candidates, gather, predict, predictions};
use crate::hao::simplify::{Costs, Hierarchy, Level, Signal};
use translux::error::{Error, Result};
use translux::light::quantised::directions::DirectionSet;
use translux::progress::Silent;

/// Largest integer of a harmonic: one byte.
const MOST: f32 = 127.0;

/// Fitted weights are steps of 2^-8 from those that a reader knows: finer ones cost bytes and gain nothing.
const WEIGHT_STEP: i32 = 1 << 7;

/// Order of the harmonics that stand for the illumination where it chooses the reference points.
const SIGNAL_ORDER: usize = 3;

/// The squared distance that counts as much as a difference of full scale, in squared diagonals.
const SIGNAL_WEIGHT: f64 = 1.0 / 36.0;

/// How to choose reference points and what to keep of the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Recipe {
    pub(super) count: usize,
    pub(super) order: usize,
    pub(super) chosen_by: ChosenBy,
    pub(super) weights: Choice,
}

/// Reference points and the triangles between them, as a reader finds them.
struct Net {
    /// Receivers that are reference points, ascending.
    members: Vec<u32>,
    /// Receivers that are none, ascending.
    others: Vec<u32>,
    level: Level,
    /// Position among the members of each reference of the level.
    row: Vec<u32>,
}

impl Net {
    fn new(topology: &Topology, members: Vec<u32>) -> Result<Self> {
        let mut is_member = vec![false; topology.positions.len()];
        for &member in &members {
            match is_member.get_mut(member as usize) {
                Some(slot) => *slot = true,
                None => return Err(damaged("a reference point is no vertex")),
            }
        }
        let others = (0..is_member.len() as u32).filter(|v| !is_member[*v as usize]).collect();
        let level = Hierarchy::keeping(&topology.input(), &members, &Silent).levels.pop().unwrap_or_default();
        let place = |v: &u32| members.binary_search(v).map(|at| at as u32);
        let Ok(row) = level.references.iter().map(place).collect::<std::result::Result<_, _>>() else {
            return Err(damaged("a component of the mesh has no reference point"));
        };
        Ok(Self { members, others, level, row })
    }

    /// Triangles of another vertex by their number: that on which it lies, then those nearby; and the weights that are known.
    fn triangle(&self, vertex: u32, number: usize) -> Option<Prediction> {
        let anchor = self.level.anchors.get(vertex as usize).filter(|a| a.is_somewhere())?;
        match number.checked_sub(1) {
            None => Some(Prediction::from(anchor)),
            Some(at) => {
                let corners = *candidates(&self.level, anchor).get(at)?;
                Some(Prediction { corners, weights: Weights::quantise([1.0 / 3.0; 3]) })
            }
        }
    }

    /// The integers of a prediction: triangle and steps of the weights. None where they are too large.
    fn encode(&self, vertex: u32, prediction: &Prediction) -> Option<[i16; 3]> {
        let anchor = self.level.anchors.get(vertex as usize)?;
        let number = match prediction.corners == anchor.corners {
            true => 0,
            false => 1 + candidates(&self.level, anchor).iter().position(|face| *face == prediction.corners)?,
        };
        let known = self.triangle(vertex, number)?.weights.stored();
        let step = |i: usize| {
            let difference = i32::from(prediction.weights.stored()[i]) - i32::from(known[i]);
            let steps = (f64::from(difference) / f64::from(WEIGHT_STEP)).round() as i32;
            let (least, most) = (-i32::from(known[i]) / WEIGHT_STEP, (0xffff - i32::from(known[i])) / WEIGHT_STEP);
            steps.clamp(least, most) as i16
        };
        Some([i16::try_from(number).ok()?, step(0), step(1)])
    }

    /// Undoes [`Self::encode`].
    fn decode(&self, vertex: u32, place: &[i16]) -> Option<Prediction> {
        let &[number, a, b] = place else { return None };
        let known = self.triangle(vertex, usize::try_from(number).ok()?)?;
        let stored = known.weights.stored();
        let weight = |i: usize, steps: i16| (i32::from(stored[i]) + i32::from(steps) * WEIGHT_STEP) as u16;
        Some(Prediction { weights: Weights::from_stored([weight(0, a), weight(1, b)]), ..known })
    }
}

fn damaged(what: &str) -> Error {
    Error::input(format!("{what}: the mesh and its transport do not belong together"))
}

/// The values of all receivers, `[receiver][channel][light]`.
pub(super) struct Values<'a> {
    pub(super) cells: &'a [f32],
    pub(super) directions: &'a DirectionSet,
    pub(super) shells: usize,
}

impl Values<'_> {
    fn lights(&self) -> usize {
        self.directions.count() * self.shells
    }

    fn dimension(&self) -> usize {
        CHANNELS * self.lights()
    }
}

/// Chooses about `count` reference points; vertices on no triangle are all among them.
fn choose(topology: &Topology, values: &Values, recipe: &Recipe) -> Result<Vec<u32>> {
    let signal = match recipe.chosen_by {
        ChosenBy::Geometry => Vec::new(),
        ChosenBy::Illumination => signal(values)?,
    };
    let (low, high) = topology
        .positions
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    let weight_mm2 = SIGNAL_WEIGHT * (high - low).as_dvec3().length_squared();
    let dimension = SIGNAL_ORDER * SIGNAL_ORDER;
    let signal = (!signal.is_empty()).then_some(Signal { values: &signal, dimension, weight_mm2 });
    let costs = Costs { signal, ..Costs::default() };
    let count = recipe.count.min(topology.positions.len());
    let level = Hierarchy::new(&topology.input(), &costs, &[count], &Silent).levels.pop().unwrap_or_default();
    let nowhere = level.anchors.iter().enumerate().filter(|(_, a)| !a.is_somewhere()).map(|(v, _)| v as u32);
    let mut members: Vec<u32> = level.references.iter().copied().chain(nowhere).collect();
    members.sort_unstable();
    members.dedup();
    Ok(members)
}

/// The brightness of each receiver as harmonics of the direction of parallel light, from 0 to about 1.
fn signal(values: &Values) -> Result<Vec<f32>> {
    let (count, size) = (values.directions.count(), SIGNAL_ORDER * SIGNAL_ORDER);
    let projection = Projection::new(values.directions, SIGNAL_ORDER, Window::None)?;
    let full = values.cells.iter().fold(0.0f32, |a, v| a.max(*v)).max(f32::MIN_POSITIVE);
    // Harmonics are orthonormal over 4 pi; a mean over eight lights is what the weight was found for.
    let unit = (8.0 / (4.0 * std::f32::consts::PI)).sqrt() / (CHANNELS as f32 * full);
    let rows: Vec<&[f32]> = values.cells.chunks_exact(values.dimension().max(1)).collect();
    let mut signal = vec![0.0f32; rows.len() * size];
    signal.par_chunks_exact_mut(size).zip(&rows).for_each(|(out, row)| {
        let mut sum = vec![0.0f32; count];
        for channel in row.chunks_exact(values.lights()) {
            sum.iter_mut().zip(channel).for_each(|(sum, v)| *sum += unit * v);
        }
        projection.apply(&sum, out);
    });
    Ok(signal)
}

/// The sections that hold reference points, filled in.
pub(super) fn write(topology: &Topology, values: &Values, recipe: &Recipe, file: &mut File) -> Result<f64> {
    let (dimension, lights) = (values.dimension(), values.lights());
    let net = Net::new(topology, choose(topology, values, recipe)?)?;
    let own = gather(values.cells, dimension, &net.members);
    let coded = codes::quantised(&own, CHANNELS, lights, Table::Lloyd)?;
    let earlier = Earlier::new(net.members.len(), &faces(&net));
    (file.tables, file.codes) = codes::write(&coded.matrix, &earlier)?;
    // What a reader has: the quantiser's error is in what is left.
    let known = decoded(&coded.matrix);
    let references = gather(&known, dimension, &net.row);
    let found = predictions(&net.level, None, values.cells, &references, dimension, recipe.weights);
    let place = |&v: &u32| {
        let integers = found.get(v as usize).and_then(|prediction| net.encode(v, prediction)).unwrap_or_default();
        let prediction = net.decode(v, &integers).ok_or_else(|| damaged("a vertex lies on no triangle"))?;
        Ok((integers, prediction))
    };
    let places: Vec<([i16; 3], Prediction)> = net.others.par_iter().map(place).collect::<Result<_>>()?;
    let projection = Projection::new(values.directions, recipe.order, Window::None)?;
    let columns = CHANNELS * values.shells * recipe.order * recipe.order;
    let mut differences = vec![0.0f32; net.others.len() * columns];
    let rows = differences.par_chunks_exact_mut(columns).zip(&net.others).zip(&places);
    rows.for_each_init(
        || vec![0.0f32; dimension],
        |row, ((out, &v), (_, prediction))| {
            predict(&references, prediction, row);
            let own = values.cells.chunks_exact(dimension).nth(v as usize).unwrap_or(&[]);
            row.iter_mut().zip(own).for_each(|(p, v)| *p = v - *p);
            projection.apply(row, out);
        },
    );
    file.order = recipe.order as u8;
    file.scales = scales(&differences, columns, MOST);
    let fail = |e: FormatError| Error::runtime(format!("asset: {e}"));
    let integers = integers(&differences, &file.scales, MOST);
    file.harmonics = encode(tags::HARMONICS, net.others.len(), columns, &integers, None).map_err(fail)?;
    let mut members = vec![0i16; topology.positions.len()];
    net.members.iter().for_each(|&m| members[m as usize] = 1);
    file.members = encode(tags::MEMBERS, members.len(), 1, &members, None).map_err(fail)?;
    let places: Vec<i16> = places.iter().flat_map(|(integers, _)| *integers).collect();
    file.places = encode(tags::PLACES, net.others.len(), CHANNELS, &places, None).map_err(fail)?;
    Ok(coded.signal_to_noise_db)
}

/// Triangles between the members.
fn faces(net: &Net) -> Vec<[u32; 3]> {
    let row = |c: u32| net.row.get(c as usize).copied().unwrap_or(u32::MAX);
    net.level.faces.iter().map(|face| face.map(row)).collect()
}

/// All values of a matrix.
fn decoded(matrix: &Matrix) -> Vec<f32> {
    let (rows, planes, columns) = (matrix.rows(), matrix.planes, matrix.columns);
    let mut values = vec![0.0; rows * planes * columns];
    values.par_chunks_exact_mut((planes * columns).max(1)).enumerate().for_each(|(row, out)| {
        for (plane, out) in out.chunks_exact_mut(columns.max(1)).enumerate() {
            out.iter_mut().enumerate().for_each(|(column, out)| *out = matrix.value(row, plane, column));
        }
    });
    values
}

/// Reference points as they are evaluated.
pub(super) struct References {
    members: Vec<u32>,
    /// Codes of the members.
    values: Matrix,
    others: Vec<u32>,
    /// Members that each other vertex is predicted from.
    corners: Vec<[u32; 3]>,
    weights: Vec<Weights>,
    /// Harmonics of what is left, `[other][channel][shell and coefficient]`.
    differences: Matrix,
}

impl References {
    /// Undoes [`write`].
    pub(super) fn read(file: &File, topology: &Topology) -> Result<Self> {
        let fail = |e: FormatError| Error::input(e.to_string());
        let column = |tag, bytes: &[u8]| Ok(decode(tag, bytes, None, Budget::default()).map_err(fail)?.values);
        let flags: Vec<i16> = column(tags::MEMBERS, &file.members)?;
        if flags.len() != topology.positions.len() || flags.iter().any(|f| !matches!(f, 0 | 1)) {
            return Err(damaged("the reference points are marked among other vertices"));
        }
        let members = flags.iter().enumerate().filter(|(_, flag)| **flag == 1).map(|(v, _)| v as u32).collect();
        let net = Net::new(topology, members)?;
        let earlier = Earlier::new(net.members.len(), &faces(&net));
        let values = codes::read(&file.codes, &file.tables, CHANNELS, file.lights(), &earlier)?;
        let places: Vec<i16> = column(tags::PLACES, &file.places)?;
        let harmonics: Vec<i16> = column(tags::HARMONICS, &file.harmonics)?;
        if places.len() != 3 * net.others.len() || harmonics.len() != file.columns() * net.others.len() {
            return Err(damaged("other vertices lie between the reference points"));
        }
        let of_vertex = |(&v, place): (&u32, &[i16])| {
            let found = net.decode(v, place).ok_or_else(|| damaged("a vertex lies on a triangle that is not there"))?;
            let corners = found.corners.map(|c| net.row.get(c as usize).copied().unwrap_or(u32::MAX));
            Ok((corners, found.weights))
        };
        let found: Vec<_> = net.others.iter().zip(places.chunks_exact(3)).map(of_vertex).collect::<Result<_>>()?;
        let bytes: Vec<i8> = harmonics.iter().map_while(|v| i8::try_from(*v).ok()).collect();
        if bytes.len() != harmonics.len() {
            return Err(Error::input(format!("section {}: a harmonic is no byte", tags::HARMONICS)));
        }
        let (corners, weights) = found.into_iter().unzip();
        let columns = file.columns() / CHANNELS;
        let differences = Matrix { planes: CHANNELS, columns, cells: Cells::Bytes(bytes) };
        Ok(Self { members: net.members, values, others: net.others, corners, weights, differences })
    }

    /// Reference points.
    pub(super) fn count(&self) -> usize {
        self.members.len()
    }

    /// RGB of every receiver under weights over the lights and over the harmonics.
    pub(super) fn radiosity(&self, lights: &[Vec<f32>], harmonics: &[Vec<f32>]) -> Vec<[f32; 4]> {
        let known = self.values.products(lights);
        let mut others = self.differences.products(harmonics);
        let places = self.corners.par_iter().zip(&self.weights);
        others.par_iter_mut().zip(places).with_min_len(256).for_each(|(out, (corners, weights))| {
            for (corner, weight) in corners.iter().zip(weights.values()) {
                let value = known.get(*corner as usize).copied().unwrap_or_default();
                (0..CHANNELS).for_each(|c| out[c] += weight * value[c]);
            }
        });
        let mut result = vec![[0.0; 4]; self.members.len() + self.others.len()];
        let all = self.members.iter().zip(&known).chain(self.others.iter().zip(&others));
        all.for_each(|(&v, value)| result[v as usize] = *value);
        result
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.values.bytes()
            + self.differences.bytes()
            + size_of_val(self.members.as_slice())
            + size_of_val(self.others.as_slice())
            + size_of_val(self.corners.as_slice())
            + size_of_val(self.weights.as_slice())
    }
}
