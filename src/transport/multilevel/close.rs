//! Samples near a group of receivers, prepared for the sums of each of them.

use glam::Vec3;

use super::compact::{Compact, Facets, Shine};
use crate::transport::kernel::radial_table::Rgb;
use crate::transport::near_rule::{PIECE_IS_POINT, THREE_BEYOND, THREE_POINTS, near_square};

/// Lit samples that some receiver of a group may be too near to for a disc, positions relative to its centre, mm.
#[derive(Default)]
pub(super) struct Close {
    pub(super) at: [Vec<f32>; 3],
    pub(super) flux: Vec<Rgb>,
    pub(super) sample: Vec<u32>,
    /// Squared distances below which the facets of a sample count, mm^2.
    pub(super) facets2: Vec<f32>,
    /// One past the last facet of each sample; a sample that is too far from all receivers has none.
    pub(super) ends: Vec<u32>,
    pub(super) facets: Vec<CloseFacet>,
    /// Samples that are not lit evenly, and squared distances below which their pieces count, mm^2.
    pub(super) uneven: Vec<(u32, f32)>,
    /// Pieces of each uneven sample, one after another, and the number of fours of each.
    pub(super) pieces: Vec<ClosePieces>,
    pub(super) fours: usize,
}

/// A facet of a close sample.
#[derive(Clone, Copy)]
pub(super) struct CloseFacet {
    /// Points of [`THREE_POINTS`], and the centroid, by axis.
    pub(super) points: [Rgb; 3],
    /// Flux of each point.
    pub(super) flux: Rgb,
    /// Squared distance below which it needs more points, mm^2.
    pub(super) more2: f32,
    /// Number among all facets.
    pub(super) facet: u32,
}

/// Four pieces of a close sample.
#[derive(Clone, Copy)]
pub(super) struct ClosePieces {
    /// Centroids of the pieces, by axis.
    pub(super) centroids: [[f32; 4]; 3],
    /// Flux of each piece beyond its share of the whole sample, RGB and 0.
    pub(super) flux: [Rgb; 4],
    /// Squared distances below which pieces are not taken for points, mm^2.
    pub(super) more2: [f32; 4],
}

impl Close {
    pub(super) fn clear(&mut self) {
        self.at.iter_mut().for_each(Vec::clear);
        self.flux.clear();
        self.sample.clear();
        self.facets2.clear();
        self.ends.clear();
        self.facets.clear();
        self.uneven.clear();
        self.pieces.clear();
    }

    /// Index of the first four of an uneven sample's pieces.
    #[inline(always)]
    pub(super) fn pieces_of(&self, uneven: usize) -> usize {
        uneven * self.fours
    }

    /// Adds a sample at a place relative to the centre of the receivers, of a radius, unless it is a disc to all receivers, which are
    /// within a radius of their centre, mm.
    #[inline(always)]
    pub(super) fn push(
        &mut self,
        sample: usize,
        (at, radius, receivers): ([f32; 3], f32, f32),
        compact: &Compact,
        facets: &Facets,
        light: Shine,
    ) {
        let smooth2 = (compact.smooth_mm * compact.smooth_mm) as f32;
        let below2 = |radii: f64| near_square(radii * f64::from(radius), compact.smooth_mm) as f32;
        let most = compact.rule.facets_below.max(compact.rule.pieces_below) as f32 * radius;
        let distance2 = at[0] * at[0] + at[1] * at[1] + at[2] * at[2];
        if most * most <= smooth2 || distance2 >= (most + receivers) * (most + receivers) {
            return;
        }
        let within = |special2: f32| {
            let reach = special2.max(0.0).sqrt() + receivers;
            special2 > 0.0 && distance2 < reach * reach
        };
        let facets2 = below2(compact.rule.facets_below);
        let pieces2 = below2(compact.rule.pieces_below).max(facets2);
        let (by_facets, by_pieces) = (within(facets2), light.light.is_uneven(sample) && within(pieces2));
        if !by_facets && !by_pieces {
            return;
        }
        if by_pieces {
            self.uneven.push((self.sample.len() as u32, pieces2));
            self.push_pieces(sample, at, smooth2, light);
        }
        for (list, x) in self.at.iter_mut().zip(at) {
            list.push(x);
        }
        self.flux.push(light.flux[sample]);
        // Without facets it stays a disc.
        self.facets2.push(if by_facets { facets2 } else { 0.0 });
        self.sample.push(sample as u32);
        if by_facets {
            let more2 = (THREE_BEYOND * compact.split_below).powi(2);
            self.push_facets(sample, at, (more2, smooth2), facets, light);
        }
        self.ends.push(self.facets.len() as u32);
    }

    fn push_facets(
        &mut self,
        sample: usize,
        at: [f32; 3],
        (more2, smooth2): (f32, f32),
        facets: &Facets,
        light: Shine,
    ) {
        let e = light.light.irradiance(sample).as_vec3();
        let (towards, weight) = THREE_POINTS;
        for (facet, number) in facets.of(sample).iter().zip(facets.offsets[sample]..) {
            let [red, green, blue] = (e * (weight * facet.area)).to_array();
            let mut points = [[0.0; 4]; 3];
            for (axis, points) in points.iter_mut().enumerate() {
                let middle = at[axis] + facet.middle[axis];
                *points = [middle; 4];
                points.iter_mut().zip(facet.corners[axis]).for_each(|(point, corner)| *point += towards * corner);
            }
            let more2 = more2 * facet.radius2() - smooth2;
            self.facets.push(CloseFacet { points, flux: [red, green, blue, 0.0], more2, facet: number });
        }
    }

    fn push_pieces(&mut self, sample: usize, at: [f32; 3], smooth2: f32, light: Shine) {
        self.fours = light.light.most_pieces().div_ceil(4);
        let before = self.pieces.len();
        let none = ClosePieces { centroids: [[0.0; 4]; 3], flux: [[0.0; 4]; 4], more2: [f32::NEG_INFINITY; 4] };
        self.pieces.resize(before + self.fours, none);
        let own = &mut self.pieces[before..];
        for (k, (deviation, corners)) in light.light.pieces(sample).into_iter().flatten().enumerate() {
            let (four, lane) = (&mut own[k / 4], k % 4);
            let [a, b, c] = corners.map(Vec3::from);
            let middle = (a + b + c) / 3.0;
            let radius2 = middle.distance_squared(a).max(middle.distance_squared(b)).max(middle.distance_squared(c));
            let area = 0.5 * (b - a).cross(c - a).length();
            let [red, green, blue] = (deviation.as_vec3() * area).to_array();
            for (axis, centroids) in four.centroids.iter_mut().enumerate() {
                centroids[lane] = at[axis] + middle[axis];
            }
            four.flux[lane] = [red, green, blue, 0.0];
            four.more2[lane] = PIECE_IS_POINT * PIECE_IS_POINT * radius2 - smooth2;
        }
    }
}
