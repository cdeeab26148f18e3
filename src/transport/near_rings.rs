//! The near field of many media under one light: light around every receiver, ring by ring, so that a change of medium is a product.
//!
//! Inside the split radius the near part of a profile ([`FarProfile`]) is a sum of hat functions of the squared distance. How much
//! light falls on each hat depends on geometry and light alone. Coefficients are those of Galerkin: what the near part and its hats
//! sum is the same for every light that is itself a sum of hats, even light above all. Near triangles meet the rings in closed form,
//! distant ones are points at their centroids.
//!
//! Measured against [`super::near_field`]: see the tests, and `docs/editable.md`.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::balanced_tree::power_of_two_near;
use super::gather::NearField;
use super::irradiance::Pieces;
use super::near_field::{Around, Corners};
use super::receivers::{Group, Receivers};
use super::scene::{Medium, Surface};
use crate::geometry::ball::triangle_in_balls;
use crate::math::quadrature::gauss_legendre_cached;
use crate::math::simd::{Level, multiversion};
use crate::medium::dipole::Dipole;
use crate::medium::far_profile::FarProfile;
use crate::medium::fresnel::BoundaryFit;
use crate::progress::Progress;

/// Hat functions. With them and [`DENSER`] a shadow boundary anywhere costs at most 1e-3 of the light of a lit plane, waves of light
/// 2e-4, for free paths of 0.03 to 4 spacings of the samples and a split radius of 6.
const RINGS: usize = 20;

/// The k-th radius grows as this power of k: dense media are peaked at the receiver.
const DENSER: i32 = 3;

/// Besides the hats, light on `u = r^2 - split^2` and its square: of the pieces of uneven samples, of which the far field sees the mean.
const COLUMNS: usize = RINGS + 2;

/// Receivers side by side.
const LANES: usize = 16;

/// Points of a quadrature over an e-fold of the squared distance.
const ORDER: usize = 8;

/// Pieces of uneven samples are points from so many of their radii on.
const POINT_FROM: f32 = 3.0;

/// RGB and nothing.
type Rgb = [f32; 4];

/// Squared radii at which hats peak, mm^2; the last one, where near parts end, has none.
#[derive(Clone, Debug, PartialEq)]
struct Rings([f64; RINGS + 1]);

impl Rings {
    fn new(split_mm: f64) -> Self {
        Self(std::array::from_fn(|k| (split_mm * (k as f64 / RINGS as f64).powi(DENSER)).powi(2)))
    }

    /// The hat that peaks at or below a squared distance, and the share of the one after it; none from the split radius on.
    fn place(&self, r2: f64) -> Option<(usize, f64)> {
        let next = self.0.partition_point(|s| *s <= r2);
        let (from, to) = (*self.0.get(next.checked_sub(1)?)?, *self.0.get(next)?);
        Some((next - 1, (r2 - from) / (to - from)))
    }

    /// Adds a point to the columns of a receiver.
    fn point(&self, r2: f64, flux: Vec3, out: &mut [Rgb; COLUMNS]) {
        let Some((first, t)) = self.place(r2) else { return };
        add(out, first, (1.0 - t) as f32, flux);
        if first + 1 < RINGS {
            add(out, first + 1, t as f32, flux);
        }
    }

    /// Area of a triangle (relative to the receiver, mm) on every hat, mm^2; its part beyond the split radius is on none.
    fn areas(&self, corners: [DVec3; 3]) -> [f32; RINGS] {
        let mut areas = [0.0; RINGS + 1];
        let mut before = [0.0; 2];
        for (k, now) in triangle_in_balls(corners, &self.0[1..]).enumerate() {
            let (area, moment) = (now[0] - before[0], now[1] - before[1]);
            let (from, to) = (self.0[k], self.0[k + 1]);
            let beyond = ((moment - from * area) / (to - from)).clamp(0.0, area.max(0.0));
            areas[k] += area - beyond;
            areas[k + 1] += beyond;
            before = now;
        }
        std::array::from_fn(|k| areas[k].max(0.0) as f32)
    }

    /// Coefficients of the columns of one channel.
    fn coefficients(&self, dipole: &Dipole) -> [f32; COLUMNS] {
        let [whole, far] = [0.0, self.0[RINGS].sqrt()].map(|split_mm| FarProfile::new(dipole, split_mm));
        let near = |r2: f64| {
            let value = whole.reflectance_at_square(r2) - far.reflectance_at_square(r2);
            if value.is_finite() { value } else { 0.0 }
        };
        let (mut diagonal, mut beside, mut right) = ([0.0; RINGS + 1], [0.0; RINGS + 1], [0.0; RINGS + 1]);
        let smooth = dipole.poles().iter().map(|pole| pole.z_mm).fold(f64::MAX, f64::min);
        let scale2 = (smooth * smooth).max(1e-9 * self.0[1]);
        let rule = gauss_legendre_cached(ORDER);
        for k in 0..RINGS {
            let (from, to) = (self.0[k], self.0[k + 1]);
            let width = to - from;
            diagonal[k] += width / 3.0;
            diagonal[k + 1] += width / 3.0;
            beside[k] += width / 6.0;
            // Even in the logarithm of r^2 + s^2, s the scale on which the profile is smooth.
            let (low, high) = ((from + scale2).ln(), (to + scale2).ln());
            let pieces = (high - low).ceil().max(1.0);
            let half = 0.5 * (high - low) / pieces;
            for piece in 0..pieces as usize {
                let middle = low + (2.0 * piece as f64 + 1.0) * half;
                for node in rule {
                    let x = (middle + half * node.position).exp();
                    let r2 = (x - scale2).clamp(from, to);
                    let (weighted, t) = (node.weight * half * x * near(r2), (r2 - from) / width);
                    right[k] += weighted * (1.0 - t);
                    right[k + 1] += weighted * t;
                }
            }
        }
        // Thomas' algorithm: diagonally dominant. Nothing is left at the split radius.
        for k in 1..RINGS {
            let factor = beside[k - 1] / diagonal[k - 1];
            diagonal[k] -= factor * beside[k - 1];
            right[k] -= factor * right[k - 1];
        }
        let mut next = 0.0;
        let mut result = [0.0; COLUMNS];
        for k in (0..RINGS).rev() {
            let above = if k + 1 < RINGS { beside[k] * next } else { 0.0 };
            next = (right[k] - above) / diagonal[k];
            result[k] = next as f32;
        }
        let [_, slope, curvature] = far.polynomial();
        result[RINGS] = slope as f32;
        result[RINGS + 1] = curvature as f32;
        result
    }
}

#[inline(always)]
fn add(out: &mut [Rgb; COLUMNS], column: usize, share: f32, flux: Vec3) {
    let Some(out) = out.get_mut(column) else { return };
    out[0] += share * flux.x;
    out[1] += share * flux.y;
    out[2] += share * flux.z;
}

/// Areas of a sample on some hats, one after another.
#[derive(Clone, Copy, Debug)]
struct Entry {
    sample: u32,
    first: u8,
    count: u8,
}

/// What the receivers of one group see.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// Entries up to and with each receiver.
    ends: Vec<u32>,
    entries: Vec<Entry>,
    /// Of all entries, mm^2.
    areas: Vec<f32>,
}

/// Areas of the samples around every receiver on the hats.
#[derive(Clone, Debug)]
pub struct NearRings {
    rings: Rings,
    groups: Vec<Seen>,
}

/// Light of one irradiance on the columns of every receiver, `[group][column][channel][receiver]`.
#[derive(Clone, Debug, Default)]
pub struct RingMoments {
    blocks: Vec<[[[f32; LANES]; 3]; COLUMNS]>,
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
    /// Around receivers in groups of at most 16; `around` and `corners` are those of the near field with the same rule and split radius.
    pub fn new(
        surface: &Surface,
        (around, corners): (&Around, &Corners),
        receivers: &Receivers,
        (rule, split_mm): (NearField, f64),
        progress: &dyn Progress,
    ) -> Self {
        let rings = Rings::new(split_mm);
        progress.start("rings", receivers.len() as u64);
        let of_group = |(index, group): (usize, &Group)| {
            let mut seen = Seen::default();
            for receiver in &receivers.positions[group.run.range()] {
                for &sample in around.of(index) {
                    let (patch, facets) = (&surface.patches[sample as usize], corners.of(surface.samples, sample));
                    let offset = patch.centre_mm - *receiver;
                    let r2 = offset.length_squared();
                    let reach = rule.three_points_below * patch.radius_mm;
                    let mut areas = [0.0; RINGS];
                    if r2 < reach * reach {
                        for facet in facets {
                            let own = rings.areas(facet.map(|c| offset + Vec3::from(c).as_dvec3()));
                            areas.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
                        }
                    } else if let Some((k, t)) = rings.place(r2) {
                        areas[k] = (patch.area_mm2 * (1.0 - t)) as f32;
                        if let Some(next) = areas.get_mut(k + 1) {
                            *next = (patch.area_mm2 * t) as f32;
                        }
                    }
                    seen.push(sample, &areas);
                }
                seen.ends.push(seen.entries.len() as u32);
            }
            progress.advance(group.run.range().len() as u64);
            seen
        };
        let groups = receivers.groups.par_iter().enumerate().map(of_group).collect();
        progress.finish();
        Self { rings, groups }
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        let of_group = |g: &Seen| {
            size_of_val(g.ends.as_slice()) + size_of_val(g.entries.as_slice()) + size_of_val(g.areas.as_slice())
        };
        self.groups.iter().map(of_group).sum()
    }

    /// Of a medium.
    pub fn coefficients(&self, medium: &Medium) -> RingCoefficients {
        let channels = medium.properties.dipoles(BoundaryFit::Published).map(|dipole| self.rings.coefficients(&dipole));
        RingCoefficients(std::array::from_fn(|column| channels.each_ref().map(|of_channel| of_channel[column])))
    }

    /// Light of one irradiance for each sample, RGB, around the receivers that these were made for. `pieces` are those of the same
    /// light, or the default.
    pub fn moments(
        &self,
        surface: &Surface,
        around: &Around,
        receivers: &Receivers,
        (irradiance, pieces): (&[DVec3], &Pieces),
    ) -> RingMoments {
        let brightest = irradiance.iter().map(|e| e.max_element()).fold(0.0, f64::max);
        let scale = power_of_two_near(brightest).recip();
        let light: Vec<Rgb> = irradiance.par_iter().map(|e| (*e * scale).as_vec3().extend(0.0).to_array()).collect();
        let of_group = |(index, (group, seen)): (usize, (&Group, &Seen))| {
            let mut block = [[[0.0; LANES]; 3]; COLUMNS];
            let uneven: Vec<u32> =
                around.of(index).iter().copied().filter(|&sample| pieces.is_uneven(sample as usize)).collect();
            let (mut entry, mut area) = (0, 0);
            for (lane, (receiver, &end)) in receivers.positions[group.run.range()].iter().zip(&seen.ends).enumerate() {
                let entries = &seen.entries[entry..end as usize];
                let mut columns = [[0.0; 4]; COLUMNS];
                area += gather(entries, &seen.areas[area..], &light, &mut columns);
                entry = end as usize;
                for &sample in &uneven {
                    let offset = (surface.patches[sample as usize].centre_mm - *receiver).as_vec3();
                    self.uneven(offset, (pieces, sample, scale), &mut columns);
                }
                for (block, column) in block.iter_mut().zip(&columns) {
                    for (block, value) in block.iter_mut().zip(column) {
                        block[lane % LANES] = *value;
                    }
                }
            }
            block
        };
        let blocks = receivers.groups.par_iter().zip(&self.groups).enumerate().map(of_group).collect();
        RingMoments { blocks, scale }
    }

    /// Adds what the pieces of a sample receive more or less than the whole.
    fn uneven(&self, offset: Vec3, (pieces, sample, scale): (&Pieces, u32, f64), columns: &mut [Rgb; COLUMNS]) {
        let split2 = self.rings.0[RINGS];
        let Some(pieces) = pieces.of(sample as usize) else { return };
        if f64::from(offset.length_squared()) >= split2 {
            return;
        }
        for (deviation, corners) in pieces {
            let e = (deviation * scale).as_vec3();
            let [a, b, c] = corners.map(|corner| offset + Vec3::from(corner));
            let (centre, area) = ((a + b + c) / 3.0, 0.5 * (b - a).cross(c - a).length());
            let r2 = centre.length_squared();
            let size2 = [a, b, c].map(|corner| corner.distance_squared(centre)).into_iter().fold(0.0, f32::max);
            if r2 < POINT_FROM * POINT_FROM * size2 {
                let areas = self.rings.areas([a, b, c].map(|corner| corner.as_dvec3()));
                areas.iter().enumerate().for_each(|(column, area)| add(columns, column, *area, e));
            } else {
                self.rings.point(f64::from(r2), e * area, columns);
            }
            let u = (f64::from(r2) - split2) as f32;
            add(columns, RINGS, u, e * area);
            add(columns, RINGS + 1, u * u, e * area);
        }
    }

    /// Adds the near field of media, given for each group of the receivers, to the radiosity of every receiver.
    pub fn add<'a>(
        &self,
        moments: &RingMoments,
        receivers: &Receivers,
        of_group: impl Fn(&Group) -> Option<&'a RingCoefficients> + Sync,
        radiosity: &mut [DVec3],
    ) {
        let mut jobs = Vec::with_capacity(receivers.groups.len());
        let mut rest = radiosity;
        for (group, block) in receivers.groups.iter().zip(&moments.blocks) {
            let (mine, others) = rest.split_at_mut(group.run.range().len().min(rest.len()));
            rest = others;
            jobs.push((group, block, mine));
        }
        let (level, scale) = (Level::detect(), moments.scale.recip());
        jobs.into_par_iter().with_min_len(64).for_each(|(group, block, out)| {
            let Some(coefficients) = of_group(group) else { return };
            let mut sums = [[0.0; LANES]; 3];
            product(level, block, &coefficients.0, &mut sums);
            for (lane, out) in out.iter_mut().enumerate() {
                *out += DVec3::from_array(sums.map(|row| f64::from(row[lane % LANES]))) * scale;
            }
        });
    }
}

impl Seen {
    fn push(&mut self, sample: u32, areas: &[f32; RINGS]) {
        let Some(first) = areas.iter().position(|a| *a > 0.0) else { return };
        let last = areas.iter().rposition(|a| *a > 0.0).unwrap_or(first);
        self.entries.push(Entry { sample, first: first as u8, count: (last + 1 - first) as u8 });
        self.areas.extend_from_slice(&areas[first..=last]);
    }
}

/// Adds light on the samples of some entries to the columns of their receiver; returns how many areas these had.
fn gather(entries: &[Entry], areas: &[f32], light: &[Rgb], columns: &mut [Rgb; COLUMNS]) -> usize {
    let mut passed = 0;
    for entry in entries {
        let (first, count) = (usize::from(entry.first), usize::from(entry.count));
        let (Some(own), Some(e)) = (areas.get(passed..passed + count), light.get(entry.sample as usize)) else { break };
        passed += count;
        let Some(columns) = columns.get_mut(first..first + count) else { break };
        if *e != [0.0; 4] {
            for (column, area) in columns.iter_mut().zip(own) {
                for c in 0..4 {
                    column[c] += area * e[c];
                }
            }
        }
    }
    passed
}

#[inline(always)]
fn product_body(
    block: &[[[f32; LANES]; 3]; COLUMNS],
    coefficients: &[[f32; 3]; COLUMNS],
    sums: &mut [[f32; LANES]; 3],
) {
    for (block, coefficients) in block.iter().zip(coefficients) {
        for c in 0..3 {
            for i in 0..LANES {
                sums[c][i] += block[c][i] * coefficients[c];
            }
        }
    }
}

multiversion! {
    /// Adds columns times their coefficients.
    fn product(block: &[[[f32; LANES]; 3]; COLUMNS], coefficients: &[[f32; 3]; COLUMNS], sums: &mut [[f32; LANES]; 3]) => product_body
}

#[cfg(test)]
#[path = "near_rings_tests.rs"]
mod tests;
