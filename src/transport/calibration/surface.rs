//! A calibrated body under lights.

use glam::DVec3;

use super::{Calibrated, Told, Walks, walked};
use crate::error::Result;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::light::Light;
use crate::progress::Progress;
use crate::transport::domain::Domain;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::LightSampling;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Receivers of a group.
const GROUP: usize = 64;

/// Samples of a surface.
struct Cut {
    samples: Samples,
    patches: Vec<Patch>,
    tree: SampleTree,
}

impl Cut {
    fn new(domain: Domain, count: usize) -> Self {
        let samples = Samples::new(domain.mesh, domain.parts, count);
        let patches = samples::patches(domain.mesh, &samples);
        let tree = SampleTree::new(&samples, &patches);
        Self { samples, patches, tree }
    }

    fn surface<'a>(&'a self, domain: Domain<'a>, bvh: &'a Bvh) -> Surface<'a> {
        Surface { domain, bvh, samples: &self.samples, patches: &self.patches }
    }
}

/// The bodies of a domain with their calibrated kernels.
pub struct CalibratedSurface<'a> {
    domain: Domain<'a>,
    bvh: Bvh,
    cut: Cut,
    receivers: Receivers,
    /// Kernels and factors of points.
    pub calibrated: Calibrated,
    of_samples: Vec<DVec3>,
}

impl<'a> CalibratedSurface<'a> {
    /// Walks through the bodies and cuts their surface into so many samples.
    ///
    /// # Errors
    /// As [`Calibrated::new`].
    pub fn new(domain: Domain<'a>, samples: usize, walks: Walks, progress: &dyn Progress) -> Result<Self> {
        let told = walked(domain, walks, progress);
        Self::with(domain, samples, told, progress)
    }

    /// The same with what walks told before.
    ///
    /// # Errors
    /// As [`Calibrated::new`].
    pub fn with(domain: Domain<'a>, samples: usize, told: Told, progress: &dyn Progress) -> Result<Self> {
        let (bvh, cut) = rayon::join(|| Bvh::new(domain.mesh), || Cut::new(domain, samples));
        let calibrated = Calibrated::new(domain, &bvh, told, progress)?;
        let of_samples = calibrated.of_samples(&cut.surface(domain, &bvh));
        let receivers = calibrated.at_vertices(Receivers::new(domain.mesh, domain.parts, GROUP));
        Ok(Self { domain, bvh, cut, receivers, calibrated, of_samples })
    }

    /// Radiosity of every source vertex under lights, RGB, over all pairs.
    ///
    /// # Errors
    /// Lights that cannot be sampled.
    pub fn radiosity(&self, lights: &[Light], sampling: LightSampling, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let surface = self.cut.surface(self.domain, &self.bvh);
        let etas: Vec<f64> = self.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let entry = self.calibrated.entry(&surface);
        let (irradiance, pieces) = entry.entered_by_rays(&surface, lights, (&etas, sampling), progress)?;
        let model = (&self.calibrated.kernels, self.of_samples.as_slice());
        let gather = Gather::calibrated(&surface, &self.cut.tree, model, NearField::REFERENCE);
        let values = gather.radiosity(
            &self.receivers,
            &gather.light_with_pieces(&irradiance, &pieces),
            Scheme::AllPairs,
            progress,
        );
        Ok(self.receivers.expand(&values))
    }
}
