//! The compact part of a kernel, the facets of the samples that it is integrated over, and light on them.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::transport::kernel::radial_table::{LinearTable, Rgb};
use crate::transport::near_rule::NearRule;
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
