//! A texture atlas: the place of each corner of each triangle in the unit square.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid, same_length};
use crate::error::{FormatError, Result};
use crate::range_coder::{Bit, Coder, Decoder, Encoder, Signed};
use crate::types::{Budget, Codec, Kind};

/// Tags of the atlas.
pub mod tags {
    use crate::types::Tag;

    /// Numbers of the atlas, a record.
    pub const NUMBERS: Tag = Tag::from_static("atl.rec");
    /// Places of the wedges, coded.
    pub const PLACES: Tag = Tag::from_static("atl.uvs");
    /// The wedge of each corner, coded.
    pub const CORNERS: Tag = Tag::from_static("atl.crn");

    /// All tags, in the order of the file.
    pub const ALL: [Tag; 3] = [NUMBERS, PLACES, CORNERS];
}

/// Bytes in memory for each triangle while an atlas is read, about.
const BYTES_OF_A_TRIANGLE: u64 = 160;

/// What the atlas was made for, and how it stretches.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Numbers {
    /// Number of charts.
    pub charts: u32,
    /// Whether the places are the mesh's own texture coordinates.
    pub own: bool,
    /// Texels of a side that gutters were made for.
    pub page: u32,
    /// Share of the unit square that is covered.
    pub occupancy: f64,
    /// Share of the mapped area that is covered more than once.
    pub overlap: f64,
    /// L2 stretch, 1 for an isometry.
    pub stretch: f64,
    /// The 1st and 99th percentile by surface of area in the map over area on the surface, over its mean.
    pub area_range: [f64; 2],
    /// The least such ratio of a triangle.
    pub smallest: f64,
    /// Number of triangles without area in the map.
    pub flat: u32,
}

/// A texture atlas; see `spec/atlas.md`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atlas {
    /// What the atlas was made for, and how it stretches.
    pub numbers: Numbers,
    /// Place of each corner of each triangle, u and v in 1/65535.
    pub corners: Vec<[[u16; 2]; 3]>,
}

/// The wedges of a mesh, each a place of a vertex, numbered in the order of their first corners.
#[derive(Default)]
struct Wedges {
    /// Wedge of each corner.
    corners: Vec<[u32; 3]>,
    /// First corner of each wedge: its triangle, and its number there.
    first: Vec<(u32, usize)>,
}

impl Wedges {
    /// Codes which wedge each corner has; the encoder has the places. `None` where a decoded one is not there.
    fn code<C: Coder>(coder: &mut C, triangles: &[[u32; 3]], places: Option<&[[[u16; 2]; 3]]>) -> Option<Self> {
        let mut vertices: HashMap<u32, Vertex> = HashMap::new();
        let mut known: HashMap<(u32, [u16; 2]), usize> = HashMap::new();
        let (mut same, mut halves) = ([[Bit::NEW; 3]; 3], [Signed::NEW; 2]);
        let mut result = Self::default();
        for (t, triangle) in triangles.iter().enumerate() {
            let (mut wedges, mut before) = ([0; 3], 0);
            for (k, name) in triangle.iter().enumerate() {
                let vertex = vertices.entry(*name).or_default();
                let count = vertex.wedges.len();
                let given = places.map_or(0, |places| *known.entry((*name, places[t][k])).or_insert(count));
                if count == 0 {
                    vertex.last = 0;
                } else if !coder.bit(&mut same[before][count.min(3) - 1], given != vertex.last) {
                    before = 1;
                } else {
                    // How far back: 0 for a new one.
                    let back = (count - given.min(count)) as u32;
                    let [low, high] = [back & 0xffff, back >> 16].map(|half| half as i32);
                    let [low, high] = [halves[0].code(coder, low), halves[1].code(coder, high)];
                    let back = usize::try_from(i64::from(high) << 16 | i64::from(low)).ok()?;
                    let other = count.checked_sub(back).filter(|other| *other != vertex.last)?;
                    (vertex.last, before) = (other, 2);
                }
                if vertex.last == count {
                    vertex.wedges.push(result.first.len() as u32);
                    result.first.push((t as u32, k));
                }
                wedges[k] = *vertex.wedges.get(vertex.last)?;
            }
            result.corners.push(wedges);
        }
        Some(result)
    }

    /// Corners of other triangles across edges, by edge: the first two of each.
    fn across(&self) -> Vec<(Edge, u32, u32)> {
        let edge = |w: &[u32; 3], k: usize| Edge::new(w[(k + 1) % 3], w[(k + 2) % 3]);
        let of = |(w, t): (&[u32; 3], u32)| [0, 1, 2].map(|k| (edge(w, k), t, w[k]));
        let mut all: Vec<_> = self.corners.iter().zip(0..).flat_map(of).collect();
        all.sort_unstable();
        all
    }

    /// Codes the places of the wedges; `None` where a decoded one is outside.
    fn places<C: Coder>(&self, coder: &mut C, given: Option<&[[[u16; 2]; 3]]>) -> Option<Vec<[u16; 2]>> {
        let across = self.across();
        let mut around: Vec<(u32, u32)> = Vec::with_capacity(3 * self.corners.len());
        around.extend(self.corners.iter().zip(0..).flat_map(|(w, t)| w.map(|w| (w, t))));
        around.sort_unstable();
        around.dedup();
        let mut around = around.chunk_by(|a, b| a.0 == b.0);
        let mut models: [[[Signed; 2]; SIZES]; 3] = Default::default();
        let mut places: Vec<[u16; 2]> = Vec::with_capacity(self.first.len());
        for (wedge, (t, k)) in self.first.iter().enumerate() {
            let triangles = around.next()?.iter().map(|(_, t)| *t);
            let Guess { kind, size, place } = self.guess(wedge as u32, triangles, &across, &places);
            let models = &mut models[kind][size];
            let mut decoded = [0; 2];
            for axis in 0..2 {
                let rest = given.map_or(0, |given| i32::from(given[*t as usize][*k][axis]) - place[axis]);
                decoded[axis] = u16::try_from(place[axis] + models[axis].code(coder, rest)).ok()?;
            }
            places.push(decoded);
        }
        Some(places)
    }

    /// Where a wedge is expected from those before it: the mean of the parallelograms across edges, otherwise of the
    /// neighbours, otherwise the wedge before.
    fn guess(
        &self,
        wedge: u32,
        triangles: impl Iterator<Item = u32>,
        across: &[(Edge, u32, u32)],
        places: &[[u16; 2]],
    ) -> Guess {
        let at = |w: u32| places.get(w as usize).map(|place| place.map(i64::from));
        let (mut corners, mut beside) = (Mean::default(), Mean::default());
        let mut size = 0;
        for t in triangles {
            let own = self.corners[t as usize];
            let Some(k) = own.iter().position(|w| *w == wedge) else { continue };
            let (a, b) = (own[(k + 1) % 3], own[(k + 2) % 3]);
            [a, b].into_iter().filter_map(at).for_each(|place| beside.add(place));
            let (Some(a_at), Some(b_at)) = (at(a), at(b)) else { continue };
            let edge = Edge::new(a, b);
            let from = across.partition_point(|entry| entry.0 < edge);
            let of_edge = across[from..].iter().take(2).filter(|entry| entry.0 == edge && entry.1 != t);
            if let Some(c) = of_edge.filter_map(|entry| at(entry.2)).next() {
                corners.add([0, 1].map(|i| a_at[i] + b_at[i] - c[i]));
                size =
                    size.max((0..2).map(|i| (a_at[i] - b_at[i]).abs().max((a_at[i] - c[i]).abs())).max().unwrap_or(0));
            }
        }
        let octave = (64 - size.leading_zeros() as usize).min(SIZES - 1);
        if let Some(place) = corners.value() {
            return Guess { kind: 0, size: octave, place };
        }
        match beside.value() {
            Some(place) => Guess { kind: 1, size: 0, place },
            None => Guess { kind: 2, size: 0, place: places.last().map_or([0; 2], |place| place.map(i32::from)) },
        }
    }
}

/// Classes of the size of parallelograms, an octave each.
const SIZES: usize = 17;

/// The wedges of a vertex, and the last that was used.
#[derive(Default)]
struct Vertex {
    wedges: Vec<u32>,
    last: usize,
}

/// Two wedges, the smaller one first.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge([u32; 2]);

impl Edge {
    fn new(a: u32, b: u32) -> Self {
        Self([a.min(b), a.max(b)])
    }
}

/// A place expected, and the models that code what is left.
struct Guess {
    kind: usize,
    size: usize,
    place: [i32; 2],
}

/// A mean of places.
#[derive(Default)]
struct Mean {
    sum: [i64; 2],
    count: i64,
}

impl Mean {
    fn add(&mut self, place: [i64; 2]) {
        self.sum = [0, 1].map(|i| self.sum[i] + place[i]);
        self.count += 1;
    }

    /// Rounded to the nearest, halves upwards, and within the unit square; none without places.
    fn value(&self) -> Option<[i32; 2]> {
        let mean = |sum: i64| (2 * sum + self.count).div_euclid(2 * self.count).clamp(0, i64::from(u16::MAX)) as i32;
        (self.count > 0).then(|| self.sum.map(mean))
    }
}

impl Atlas {
    /// Checks everything that [`Atlas::from_sections`] guarantees.
    ///
    /// # Errors
    /// [`FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        let Numbers { occupancy, overlap, stretch, area_range, smallest, flat, charts, .. } = &self.numbers;
        let [low, high] = *area_range;
        in_range(tags::NUMBERS, "a number", &[*occupancy, *overlap, *stretch, low, high, *smallest], 0.0)?;
        match self.corners.len().checked_sub((*flat).max(*charts) as usize) {
            Some(_) if *occupancy <= 1.0 + 1e-6 && low <= high => Ok(()),
            _ => invalid(tags::NUMBERS, "numbers out of range"),
        }
    }

    /// The sections of a valid atlas of a mesh with these triangles: any names of their vertices that the reader knows.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] as [`Atlas::validate`], or where the triangles are not as many.
    pub fn to_sections(&self, triangles: &[[u32; 3]]) -> Result<Vec<RawSection>> {
        self.validate()?;
        same_length(tags::CORNERS, "triangles", self.corners.len(), triangles.len())?;
        let (mut corners, mut places) = (Encoder::new(), Encoder::new());
        let wedges = Wedges::code(&mut corners, triangles, Some(&self.corners));
        if wedges.and_then(|wedges| wedges.places(&mut places, Some(&self.corners))).is_none() {
            return invalid(tags::CORNERS, "corners that cannot be coded");
        }
        Ok(vec![
            RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, &self.numbers)?,
            RawSection::from_rows(tags::PLACES, Kind::Method, Codec::Raw, &places.finish()),
            RawSection::from_rows(tags::CORNERS, Kind::Method, Codec::Raw, &corners.finish()),
        ])
    }

    /// Reads the atlas among the sections of an asset with these triangles; `None` where there is none. Other sections
    /// are ignored.
    ///
    /// # Errors
    /// Any fault of their type or content.
    pub fn from_sections(sections: &[RawSection], triangles: &[[u32; 3]], budget: Budget) -> Result<Option<Self>> {
        let Some([numbers, places, corners]) = pick(sections, tags::ALL, Kind::Method)? else { return Ok(None) };
        let needed = BYTES_OF_A_TRIANGLE.saturating_mul(triangles.len() as u64);
        if needed > budget.max_decoded_bytes {
            return Err(FormatError::OverBudget { tag: tags::CORNERS, needed, budget: budget.max_decoded_bytes });
        }
        let numbers: Numbers = numbers.record()?;
        let mut decoder = Decoder::new(corners.view()?);
        let wedges = Wedges::code(&mut decoder, triangles, None).filter(|_| decoder.finish());
        let Some(wedges) = wedges else { return invalid(tags::CORNERS, "the corners are damaged") };
        let mut decoder = Decoder::new(places.view()?);
        let places = wedges.places(&mut decoder, None).filter(|_| decoder.finish());
        let Some(places) = places else { return invalid(tags::PLACES, "the places are damaged") };
        let corners = wedges.corners.iter().map(|corners| corners.map(|wedge| places[wedge as usize])).collect();
        let result = Self { numbers, corners };
        result.validate()?;
        Ok(Some(result))
    }
}
