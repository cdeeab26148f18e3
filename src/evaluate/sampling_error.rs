//! What sampling costs: the error of a sample set and its shadow rays, extrapolated from a second set.

use glam::DVec3;

use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::geometry::samples::{self, Samples};
use crate::light::Light;
use crate::math::statistics::vertex_error;
use crate::medium::material::Medium;
use crate::progress::{Progress, Silent};
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Receivers that measure the error; the third of them that no tuning sees (see [`Receivers::subset`]).
const PROBES: usize = 384;

/// A lit sample set.
pub struct Sampled<'a> {
    /// The samples.
    pub surface: Surface<'a>,
    /// Media in force.
    pub media: &'a [Medium],
    /// Kernels of the media, where they are not those of the dipole.
    pub kernels: Option<&'a [MediumKernel]>,
    /// Lights in force.
    pub lights: &'a [Light],
    /// Irradiance of each sample, RGB, and of the pieces of those that are not lit evenly.
    pub irradiance: (&'a [DVec3], &'a Pieces),
    /// How it was sampled.
    pub sampling: LightSampling,
    /// How near samples are integrated.
    pub near: NearField,
    /// Receivers.
    pub receivers: &'a Receivers,
    /// Area around each of them, mm^2.
    pub areas: &'a [f64],
}

impl Sampled<'_> {
    /// For the media or the kernels in force, on these samples or others.
    pub fn gather<'a>(&self, surface: &'a Surface<'a>, tree: &'a SampleTree) -> Gather<'a> {
        match self.kernels {
            Some(kernels) => Gather::with_kernels(surface, tree, kernels.to_vec(), self.near),
            None => Gather::new(surface, tree, self.media, self.near),
        }
    }

    /// Enters the error of sampling into the ledger. An error that falls in proportion to the number of samples is taken
    /// for granted.
    ///
    /// # Errors
    /// As [`Illumination::new`].
    pub fn enter(&self, ledger: &mut Ledger, progress: &dyn Progress) -> Result<()> {
        let (samples, domain) = (self.surface.samples, self.surface.domain);
        let other = Samples::new(domain.mesh, domain.parts, comparison_count(samples.len(), domain.parts));
        let patches = samples::patches(domain.mesh, &other);
        let surface = Surface { domain, bvh: self.surface.bvh, samples: &other, patches: &patches };
        // Other shadow rays too: patches that both sets share would agree on the errors of theirs.
        let points_per_patch = 4 * self.sampling.points_per_patch;
        let sampling = LightSampling { points_per_patch, ..self.sampling };
        let etas: Vec<f64> = self.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let irradiance = Illumination::new(&surface, self.lights, &etas, sampling)?.all_with_pieces(progress);
        let (subset, indices) = self.receivers.subset(PROBES, 2);
        let sum = |surface: &Surface, (irradiance, pieces): (&[DVec3], &Pieces)| {
            // All pairs need no tree.
            let tree = SampleTree::default();
            let gather = self.gather(surface, &tree);
            gather.radiosity(&subset, &gather.light_with_pieces(irradiance, pieces), Scheme::AllPairs, &Silent)
        };
        let theirs = sum(&surface, (&irradiance.0, &irradiance.1));
        let ours = sum(&self.surface, self.irradiance);
        let areas: Vec<f64> = indices.iter().map(|&i| self.areas[i as usize]).collect();
        let (n, m) = (samples.len() as f64, other.len() as f64);
        // e(N) = k / N: the difference is |k / m - k / n|.
        let factor = if m == n { 1.0 } else { m / (n - m).abs() };
        let note = format!("extrapolated from {} samples, on vertices of their own", other.len());
        ledger.add("sampling", vertex_error(&theirs, &ours, &areas).scaled(factor), note);
        Ok(())
    }
}

/// Samples of the set that tells the error of `count`: half as many, but one for each triangle where `count` has them,
/// since clusters of triangles err in another way; twice as many where there cannot be fewer.
fn comparison_count(count: usize, parts: &PartTable) -> usize {
    let transferring = parts.parts.iter().filter(|p| p.transfers());
    let (parts, triangles) = transferring.fold((0, 0), |(n, t), p| (n + 1, t + p.triangle_count));
    if count < 2 * parts {
        2 * count
    } else if (count / 2..=count / 4 * 3).contains(&triangles) {
        triangles
    } else {
        count / 2
    }
}

/// A third of the area of the triangles around each receiver, mm^2.
pub fn receiver_areas(mesh: &Mesh, receivers: &Receivers) -> Vec<f64> {
    let mut areas = vec![0.0; receivers.len()];
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let third = mesh.cross_mm2(index as u32).length() / 6.0;
        for &v in triangle {
            if let Some(area) = areas.get_mut(receivers.of_vertex[v as usize] as usize) {
                *area += third;
            }
        }
    }
    areas
}
