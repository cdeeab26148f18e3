//! The compact part of a kernel, the facets of the samples that it is integrated over, light on them, and those near a group of
//! receivers, prepared for the sums of each of them.

use glam::{DVec3, Vec3};

use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::parallel::*;
use crate::transport::kernel::radial_table::{LinearTable, Rgb};
use crate::transport::near_rule::{NearRule, PIECE_IS_POINT, THREE_BEYOND, THREE_POINTS, near_square};
use crate::transport::sample_light::SampleLight;

/// A facet about its centroid.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Facet {
    /// Centroid relative to that of the sample, mm.
    pub(super) middle: [f32; 3],
    pub(super) area: f32,
    /// Corners relative to the centroid, mm: x, y, z of the three.
    pub(super) corners: [[f32; 3]; 3],
    /// Squared distances of the corners from the centroid, mm^2.
    corner2: [f32; 3],
}

impl Facet {
    fn new(corners: [DVec3; 3], centre: DVec3) -> Self {
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let from_middle = corners.map(|c| (c - middle).as_vec3());
        Self {
            middle: (middle - centre).as_vec3().to_array(),
            area: (0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length()) as f32,
            corners: [0, 1, 2].map(|axis| from_middle.map(|c| c[axis])),
            corner2: from_middle.map(Vec3::length_squared),
        }
    }

    /// Squared distance of the farthest corner from the centroid, mm^2.
    #[inline(always)]
    pub(super) fn radius2(&self) -> f32 {
        self.corner2[0].max(self.corner2[1]).max(self.corner2[2])
    }
}

/// Facets of the samples, prepared for integration.
pub(super) struct Facets {
    pub(super) facets: Vec<Facet>,
    /// Sample `i` holds `facets[offsets[i]..offsets[i + 1]]`.
    pub(super) offsets: Vec<u32>,
    /// Centroid of each sample relative to the mesh's origin, and radius, mm.
    pub(super) places: Vec<([f32; 3], f32)>,
}

impl Facets {
    pub(super) fn new(mesh: &Mesh, samples: &Samples, patches: &[Patch]) -> Self {
        let of_patch = |(index, patch): (usize, &Patch)| {
            let facet = |f: &samples::Facet| Facet::new(f.corners_local_mm(mesh), patch.centre_mm);
            samples.patch(index).iter().map(facet).collect::<Vec<_>>()
        };
        Self {
            facets: patches.par_iter().enumerate().flat_map_iter(of_patch).collect(),
            offsets: samples.patch_offsets.clone(),
            places: patches.iter().map(|p| (p.centre_mm.as_vec3().to_array(), p.radius_mm as f32)).collect(),
        }
    }

    pub(super) fn of(&self, sample: usize) -> &[Facet] {
        let Some(&[first, end]) = self.offsets.get(sample..sample + 2).and_then(|o| o.first_chunk::<2>()) else {
            return &[];
        };
        self.facets.get(first as usize..end as usize).unwrap_or(&[])
    }

    /// Mean of the squared distance from a sample's centroid over some samples, mm^2, weighted by area.
    pub(super) fn mean_square(&self, samples: std::ops::Range<usize>) -> f64 {
        let (mut moment, mut area) = (0.0, 0.0);
        for facet in samples.flat_map(|sample| self.of(sample)) {
            let middle2: f32 = facet.middle.iter().map(|x| x * x).sum();
            let own: f32 = facet.corner2.iter().sum::<f32>() / 12.0;
            moment += f64::from(facet.area) * f64::from(own + middle2);
            area += f64::from(facet.area);
        }
        if area > 0.0 { moment / area } else { 0.0 }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.facets.as_slice()) + size_of_val(self.offsets.as_slice()) + size_of_val(self.places.as_slice())
    }
}

/// Light on the samples.
#[derive(Clone, Copy)]
pub(super) struct Shine<'a> {
    /// E times area of every sample, scaled.
    pub(super) flux: &'a [Rgb],
    pub(super) light: SampleLight<'a>,
}

/// The compact part of three profiles.
pub(crate) struct Compact {
    /// Kernel at a point.
    pub(crate) point: LinearTable,
    /// Mean of the kernel over the disc that stands for a sample.
    pub(crate) disc: LinearTable,
    /// Depth of the shallowest real source, mm.
    pub(crate) smooth_mm: f64,
    pub(crate) rule: NearRule,
    /// Distance over a piece's radius above which six points are enough.
    pub(crate) split_below: f32,
}

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
