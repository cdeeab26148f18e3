//! The near field of many media under one light: light around every receiver, ring by ring, so that a change of medium is a product.
//!
//! Inside the split radius the near part of a profile ([`FarProfile`](crate::medium::far_profile::FarProfile)) is a sum of hat functions of the squared distance. How much
//! light falls on each hat depends on geometry and light alone. Coefficients are those of Galerkin: what the near part and its hats
//! sum is the same for every light that is itself a sum of hats, even light above all. Near triangles meet the rings in closed form,
//! distant ones are points at their centroids.
//!
//! Measured against [`super::near_field`]: see the tests, and `docs/editable.md`.

mod hats;

use glam::{DVec3, Vec3};

use self::hats::{Areas, COLUMNS, CURVATURE, RINGS, Rings, SLOPE, WIDTH, WINDOWS};
use super::balanced_tree::power_of_two_near;
use super::close_pairs::ClosePairs;
use super::irradiance::Pieces;
use super::kernel::medium::MediumKernel;
use super::light_range::{CommonColour, LightRange};
use super::near_field::Corners;
use super::near_rule::NearField;
use super::receivers::{Group, Receivers};
use super::surface::Surface;
use crate::math::simd::{InstructionSet, add_scaled, multiversion, prefetch};
use crate::parallel::*;
use crate::progress::Progress;

/// Receivers side by side.
const LANES: usize = 16;

/// Bytes of rows that are asked for before they are read.
const AHEAD: usize = 2048;

/// Stored value of a share of 1.
const WHOLE: f32 = u8::MAX as f32;

/// Triangles nearer than so many of their radii meet the rings in closed form.
const EXACT_BELOW: f64 = 1.5;

/// Light on the columns of one receiver, of each channel.
type Columns<const C: usize> = [[f32; COLUMNS]; C];

/// Steps of a place between two hats.
const PLACES: f32 = 3072.0;

/// Samples that are numbered together.
const NUMBERED: usize = 1 << u16::BITS;

/// A sample taken for a point: its place among the hats. Samples have numbers in the list of a group.
#[derive(Clone, Copy, Debug)]
struct Point {
    sample: u16,
    /// Number of the hat before it and share of the one after it, times [`PLACES`].
    place: u16,
}

/// A sample with an extent, in the first window: its areas on the hats, mm^2. Peaked profiles weight the first hats
/// strongly, however little of a sample is on them.
#[derive(Clone, Copy, Debug)]
struct Row {
    sample: u16,
    /// The upper halves of single-precision numbers.
    areas: [u16; WIDTH],
}

/// The same in the other windows, as shares of the sample's area: of [`WHOLE`].
#[derive(Clone, Copy, Debug)]
struct Shares {
    sample: u16,
    shares: [u8; WIDTH],
}

/// Samples around the receivers of one group, as points and as areas on the hats.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// Ends of each receiver's points, window after window of the columns, and of its rows in the first window, its
    /// shares in the others.
    ends: Vec<[[u32; 2]; WINDOWS]>,
    points: Vec<Point>,
    rows: Vec<Row>,
    shares: Vec<Shares>,
}

/// Areas of the samples around every receiver on the hats.
#[derive(Clone, Debug)]
pub struct NearRings {
    rings: Rings,
    rule: NearField,
    /// Samples seen by each group, for each [`NUMBERED`] samples around it.
    groups: Vec<Vec<Seen>>,
    /// Areas of the samples, mm^2.
    areas: Vec<f32>,
}

/// Moments of one irradiance on the columns of every receiver.
#[derive(Clone, Debug, Default)]
pub struct RingMoments {
    /// `[group][column][channel][receiver]`; one channel if the light has a colour.
    blocks: Vec<[f32; LANES]>,
    colour: Option<CommonColour>,
    scale: f64,
}

impl RingMoments {
    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.blocks.as_slice())
    }
}

/// Coefficients of one medium, `[column][channel]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RingCoefficients([[f32; 3]; COLUMNS]);

impl NearRings {
    /// Rings around receivers in groups of at most 16; `around` and `corners` are those of the near field with the same
    /// rule and split radius.
    pub fn new(
        surface: &Surface,
        (around, corners): (&ClosePairs, &Corners),
        receivers: &Receivers,
        (rule, split_mm): (NearField, f64),
        progress: &dyn Progress,
    ) -> Self {
        let rings = Rings::new(split_mm);
        progress.start("rings", receivers.len() as u64);
        let see = |receiver: DVec3, samples: &[u32], windows: &mut Windows| {
            for (&sample, number) in samples.iter().zip(0..=u16::MAX) {
                let patch = &surface.patches[sample as usize];
                let offset = patch.centre_mm - receiver;
                let near = offset.length() / patch.radius_mm;
                if near >= rule.three_points_below {
                    if let Some((first, t)) = rings.place(offset.length_squared()) {
                        windows.push_point(number, first, t);
                    }
                    continue;
                }
                let mut areas = [0.0; RINGS + 1];
                for facet in corners.of(surface.samples, sample) {
                    let seen = facet.map(|c| offset + Vec3::from(c).as_dvec3());
                    if near < EXACT_BELOW {
                        rings.triangle(seen, &mut areas);
                    } else {
                        rings.three_points(seen, &mut areas);
                    }
                }
                windows.push_areas(number, &areas, patch.area_mm2);
            }
        };
        let of_group = |(index, group): (usize, &Group)| {
            let mut windows = Windows::default();
            let of_samples = |samples: &[u32]| {
                let mut seen = Seen::default();
                for receiver in &receivers.positions[group.run.range()] {
                    see(*receiver, samples, &mut windows);
                    seen.take(&mut windows);
                }
                seen
            };
            let seen: Vec<Seen> = around.of(index).chunks(NUMBERED).map(of_samples).collect();
            progress.advance(group.run.range().len() as u64);
            seen
        };
        let groups = receivers.groups.par_iter().enumerate().map(of_group).collect();
        progress.finish();
        let areas = surface.patches.iter().map(|patch| patch.area_mm2 as f32).collect();
        Self { rings, rule, groups, areas }
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        let of_group = |g: &Seen| {
            size_of_val(g.ends.as_slice())
                + size_of_val(g.points.as_slice())
                + size_of_val(g.rows.as_slice())
                + size_of_val(g.shares.as_slice())
        };
        self.groups.iter().flatten().map(of_group).sum::<usize>() + size_of_val(self.areas.as_slice())
    }

    /// Coefficients of a medium.
    pub fn coefficients(&self, medium: &MediumKernel) -> RingCoefficients {
        let channels = medium.profiles().each_ref().map(|p| self.rings.coefficients(p.as_ref(), medium.smooth_mm()));
        RingCoefficients(std::array::from_fn(|column| channels.each_ref().map(|of_channel| of_channel[column])))
    }

    /// Moments of one irradiance of each sample, RGB, around the receivers that these were made for. `pieces` are those
    /// of the same light, or the default; the range covers both.
    pub fn moments(
        &self,
        surface: &Surface,
        around: &ClosePairs,
        receivers: &Receivers,
        (irradiance, pieces): (&[DVec3], &Pieces),
        LightRange { brightest, colour }: LightRange,
    ) -> RingMoments {
        let scale = power_of_two_near(brightest).recip();
        let gathering = Gathering { rings: self, surface, around, receivers, irradiance, pieces, scale };
        let blocks = match colour {
            Some(CommonColour { channel, .. }) => gathering.run([channel], gather_one as Gather<1, 2>),
            None => gathering.run([0, 1, 2], gather as Gather<3, 6>),
        };
        RingMoments { blocks, colour, scale }
    }

    /// Adds the near field of media, given for each group of the receivers, to the radiosity of every receiver.
    pub fn add<'a>(
        &self,
        moments: &RingMoments,
        receivers: &Receivers,
        of_group: impl Fn(&Group) -> Option<&'a RingCoefficients> + Sync,
        radiosity: &mut [DVec3],
    ) {
        let channels = if moments.colour.is_some() { 1 } else { 3 };
        let rgb = moments.colour.map_or(DVec3::ONE, |colour| colour.rgb);
        let blocks = moments.blocks.par_chunks(COLUMNS * channels);
        let jobs = receivers.groups.par_iter().zip(blocks).zip(receivers.cut(radiosity, 1));
        let (level, scale) = (InstructionSet::detect(), moments.scale.recip() * rgb);
        jobs.with_min_len(64).for_each(|((group, block), out)| {
            let Some(coefficients) = of_group(group) else { return };
            let mut sums = [[0.0; LANES]; 3];
            product(level, block, &coefficients.0, &mut sums);
            for (lane, out) in out.iter_mut().enumerate() {
                *out += DVec3::from_array(sums.map(|row| f64::from(row[lane % LANES]))) * scale;
            }
        });
    }
}

/// Adds light to the columns of one group, `[column][channel][receiver]`. Light of each numbered sample: some channels of its
/// irradiance, and the same times its area.
type Gather<const C: usize, const L: usize> = fn(InstructionSet, &Seen, &[[f32; L]], &mut [[f32; LANES]]);

/// The columns of one group, the group, and the samples it sees.
type Columned<'a> = (&'a mut [[f32; LANES]], (&'a Group, &'a Vec<Seen>));

/// Inputs of gathering light on the rings.
struct Gathering<'a> {
    rings: &'a NearRings,
    surface: &'a Surface<'a>,
    around: &'a ClosePairs,
    receivers: &'a Receivers,
    irradiance: &'a [DVec3],
    pieces: &'a Pieces,
    scale: f64,
}

impl Gathering<'_> {
    /// Gathers some channels on the columns, `[group][column][channel][receiver]`.
    fn run<const C: usize, const L: usize>(&self, channels: [usize; C], gather: Gather<C, L>) -> Vec<[f32; LANES]> {
        let of_sample = |(e, area): (&DVec3, &f32)| {
            let mut light = [0.0; L];
            for (i, c) in channels.into_iter().enumerate() {
                light[i] = (e[c] * self.scale) as f32;
                light[C + i] = light[i] * area;
            }
            light
        };
        let light: Vec<[f32; L]> = self.irradiance.par_iter().zip(&self.rings.areas).map(of_sample).collect();
        let mut blocks = vec![[0.0; LANES]; self.receivers.groups.len() * COLUMNS * C];
        let level = InstructionSet::detect();
        let groups = self.receivers.groups.par_iter().zip(&self.rings.groups);
        let of_group = |(uneven, around): &mut (Vec<u32>, Vec<[f32; L]>), (index, columned): (usize, Columned)| {
            let (block, (group, seen)) = columned;
            let samples = self.around.of(index);
            uneven.clear();
            if !self.pieces.deviations().is_empty() {
                uneven.extend(samples.iter().filter(|&&sample| self.pieces.is_uneven(sample as usize)));
            }
            for (samples, seen) in samples.chunks(NUMBERED).zip(seen) {
                around.clear();
                around.extend(samples.iter().map(|&sample| light[sample as usize]));
                // Without a decision for each.
                let bits = |any: u32, light: &[f32; L]| light[..C].iter().fold(any, |any, e| any | e.to_bits());
                if around.iter().fold(0, bits) << 1 != 0 {
                    gather(level, seen, around, block);
                }
            }
            if uneven.is_empty() {
                return;
            }
            for (lane, receiver) in self.receivers.positions[group.run.range()].iter().enumerate() {
                let mut columns = [[0.0; COLUMNS]; C];
                for &sample in uneven.iter() {
                    let patch = &self.surface.patches[sample as usize];
                    let offset = (patch.centre_mm - *receiver).as_vec3();
                    if f64::from(offset.length()) < self.rings.rule.three_points_below * patch.radius_mm {
                        self.uneven(offset, (sample, channels), &mut columns);
                    }
                }
                for (column, block) in block.chunks_exact_mut(C).enumerate() {
                    for c in 0..C {
                        block[c][lane % LANES] += columns[c][column];
                    }
                }
            }
        };
        blocks.par_chunks_mut(COLUMNS * C).zip(groups).enumerate().for_each_init(Default::default, of_group);
        blocks
    }

    /// Adds the deviation of a sample's pieces from the light of the whole.
    fn uneven<const C: usize>(&self, offset: Vec3, (sample, channels): (u32, [usize; C]), columns: &mut Columns<C>) {
        let rings = &self.rings.rings;
        let split2 = rings.0[RINGS];
        for (deviation, corners) in self.pieces.of(sample as usize).into_iter().flatten() {
            let e = channels.map(|c| (deviation[c] * self.scale) as f32);
            let [a, b, c] = corners.map(|corner| offset + Vec3::from(corner));
            let (centre, area) = ((a + b + c) / 3.0, 0.5 * (b - a).cross(c - a).length());
            let r2 = centre.length_squared();
            let size2 = [a, b, c].map(|corner| corner.distance_squared(centre)).into_iter().fold(0.0, f32::max);
            let mut areas = [0.0; RINGS + 1];
            let near2 = EXACT_BELOW * EXACT_BELOW * f64::from(size2);
            if f64::from(r2) < near2 {
                rings.triangle([a, b, c].map(|corner| corner.as_dvec3()), &mut areas);
            } else {
                rings.point(f64::from(r2), f64::from(area), &mut areas);
            }
            let u = (f64::from(r2) - split2) as f32;
            for (columns, e) in columns.iter_mut().zip(e) {
                columns.iter_mut().zip(&areas).for_each(|(column, area)| *column += area * e);
                columns[SLOPE] += area * u * e;
                columns[CURVATURE] += area * u * u * e;
            }
        }
    }
}

/// Samples around one receiver, window by window.
#[derive(Default)]
struct Windows {
    points: [Vec<Point>; WINDOWS],
    rows: Vec<Row>,
    shares: [Vec<Shares>; WINDOWS - 1],
}

impl Seen {
    /// Takes the samples around the next receiver.
    fn take(&mut self, Windows { points, rows, shares }: &mut Windows) {
        let mut ends = [[0; 2]; WINDOWS];
        for (end, points) in ends.iter_mut().zip(points) {
            self.points.append(points);
            end[0] = self.points.len() as u32;
        }
        self.rows.append(rows);
        ends[0][1] = self.rows.len() as u32;
        for (end, shares) in ends[1..].iter_mut().zip(shares) {
            self.shares.append(shares);
            end[1] = self.shares.len() as u32;
        }
        self.ends.push(ends);
    }
}

impl Windows {
    fn push_point(&mut self, sample: u16, first: usize, t: f64) {
        let point = Point { sample, place: ((first as f64 + t) * f64::from(PLACES)).round() as u16 };
        self.points[first / WIDTH].push(point);
        if first % WIDTH == WIDTH - 1 {
            self.points[first / WIDTH + 1].push(point);
        }
    }

    fn push_areas(&mut self, sample: u16, areas: &Areas, area_mm2: f64) {
        let (first, others) = areas.split_at(WIDTH);
        if first.iter().any(|area| *area > 0.0) {
            let mut row = Row { sample, areas: [0; WIDTH] };
            row.areas.iter_mut().zip(first).for_each(|(half, area)| *half = upper_half(*area));
            self.rows.push(row);
        }
        // What is rounded off one hat is given to the next: a sample keeps its area.
        let scale = f64::from(WHOLE) / area_mm2;
        let sum = |areas: &[f32]| areas.iter().map(|area| f64::from(*area)).sum::<f64>();
        let (mut exact, mut given) = (sum(first) * scale, (sum(first) * scale).round());
        for (rows, areas) in self.shares.iter_mut().zip(others.chunks(WIDTH)) {
            let mut row = Shares { sample, shares: [0; WIDTH] };
            for (share, area) in row.shares.iter_mut().zip(areas) {
                exact += f64::from(*area) * scale;
                *share = (exact.round() - given) as u8;
                given = exact.round();
            }
            if row.shares != [0; WIDTH] {
                rows.push(row);
            }
        }
    }
}

/// The upper half of a positive number, rounded to even.
fn upper_half(value: f32) -> u16 {
    let bits = value.to_bits();
    ((bits + 0x7fff + (bits >> 16 & 1)) >> 16) as u16
}

/// Numbers of the hats of each window.
const HATS: [[f32; WIDTH]; WINDOWS] = {
    let mut hats = [[0.0; WIDTH]; WINDOWS];
    let mut column = 0;
    while column < COLUMNS {
        hats[column / WIDTH][column % WIDTH] = column as f32;
        column += 1;
    }
    hats
};

#[inline(always)]
fn gather_body<const C: usize, const L: usize>(seen: &Seen, light: &[[f32; L]], block: &mut [[f32; LANES]]) {
    const ROWS_AHEAD: usize = AHEAD / size_of::<Row>();
    const SHARES_AHEAD: usize = AHEAD / size_of::<Shares>();
    let (mut points, mut rows, mut shares) = (0, 0, 0);
    for (lane, ends) in seen.ends.iter().enumerate() {
        for (window, (end, out)) in ends.iter().zip(block.chunks_exact_mut(WIDTH * C)).enumerate() {
            let mut sums = [[0.0f32; WIDTH]; C];
            let end = end.map(|end| end as usize);
            for point in &seen.points[points..end[0]] {
                let Some(light) = light.get(point.sample as usize) else { return };
                let place = f32::from(point.place) * (1.0 / PLACES);
                let mut on_hats = [0.0f32; WIDTH];
                for i in 0..WIDTH {
                    on_hats[i] = (1.0 - (place - HATS[window][i]).abs()).max(0.0);
                }
                for c in 0..C {
                    add_scaled(&mut sums[c], light[C + c], &on_hats);
                }
            }
            points = end[0];
            if window == 0 {
                for (i, row) in (rows..).zip(&seen.rows[rows..end[1]]) {
                    prefetch(&seen.rows, i + ROWS_AHEAD);
                    let Some(light) = light.get(row.sample as usize) else { return };
                    let areas = row.areas.map(|half| f32::from_bits(u32::from(half) << 16));
                    for c in 0..C {
                        add_scaled(&mut sums[c], light[c], &areas);
                    }
                }
                rows = end[1];
            } else {
                let mut of_shares = [[0.0f32; WIDTH]; C];
                for (i, row) in (shares..).zip(&seen.shares[shares..end[1]]) {
                    prefetch(&seen.shares, i + SHARES_AHEAD);
                    let Some(light) = light.get(row.sample as usize) else { return };
                    let on_hats = row.shares.map(f32::from);
                    for c in 0..C {
                        add_scaled(&mut of_shares[c], light[C + c], &on_hats);
                    }
                }
                for c in 0..C {
                    add_scaled(&mut sums[c], 1.0 / WHOLE, &of_shares[c]);
                }
                shares = end[1];
            }
            for i in 0..WIDTH {
                for c in 0..C {
                    out[i * C + c][lane % LANES] += sums[c][i];
                }
            }
        }
    }
}

multiversion! {
    /// Gathers all channels.
    fn gather(seen: &Seen, light: &[[f32; 6]], block: &mut [[f32; LANES]]) => gather_body::<3, 6>;

    /// Gathers one channel.
    fn gather_one(seen: &Seen, light: &[[f32; 2]], block: &mut [[f32; LANES]]) => gather_body::<1, 2>
}

#[inline(always)]
fn product_body(block: &[[f32; LANES]], coefficients: &[[f32; 3]; COLUMNS], sums: &mut [[f32; LANES]; 3]) {
    let channels = block.len() / COLUMNS;
    for (block, coefficients) in block.chunks_exact(channels.max(1)).zip(coefficients) {
        let block: [&[f32; LANES]; 3] =
            if let [red, green, blue] = block { [red, green, blue] } else { [&block[0]; 3] };
        for c in 0..3 {
            add_scaled(&mut sums[c], coefficients[c], block[c]);
        }
    }
}

multiversion! {
    /// Adds columns, of one channel or three, times their coefficients.
    fn product(block: &[[f32; LANES]], coefficients: &[[f32; 3]; COLUMNS], sums: &mut [[f32; LANES]; 3]) => product_body
}

#[cfg(test)]
#[path = "near_rings_tests.rs"]
mod tests;
