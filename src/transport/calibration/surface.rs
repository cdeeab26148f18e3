//! A calibrated body under lights.

use glam::DVec3;

use super::{Calibrated, Told, Walks, walked};
use crate::error::Result;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::light::Light;
use crate::progress::Progress;
use crate::transport::domain::Domain;
use crate::transport::gather::{Criterion, Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::moved_entry::moved;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Samples with which the factors of points are solved for at most; factors are smooth.
const SOLVING: usize = 8192;

/// Solid angle of clusters in those sums, sr.
const SOLVING_ANGLE: f64 = 0.03;

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
    /// What the walks told.
    pub told: Told,
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
        let scheme = Scheme::Hierarchical { criterion: Criterion::SolidAngle(SOLVING_ANGLE) };
        let solving = Cut::new(domain, samples.min(SOLVING));
        let (surface, how) = (solving.surface(domain, &bvh), (NearField::FAST, scheme));
        let calibrated = Calibrated::new(&surface, &solving.tree, &told, how, progress)?;
        let of_samples = calibrated.of_samples(&cut.surface(domain, &bvh));
        let receivers = Receivers::new(domain.mesh, domain.parts, GROUP);
        Ok(Self { domain, bvh, cut, receivers, told, calibrated, of_samples })
    }

    /// Radiosity of every source vertex under lights, RGB, over all pairs.
    ///
    /// # Errors
    /// Lights that cannot be sampled.
    pub fn radiosity(&self, lights: &[Light], sampling: LightSampling, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let surface = self.cut.surface(self.domain, &self.bvh);
        let etas: Vec<f64> = self.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let mut sum = vec![DVec3::ZERO; self.of_samples.len()];
        for light in lights {
            let of_light = Illumination::new(&surface, std::slice::from_ref(light), &etas, sampling)?.all(progress);
            let entered = moved(&surface, light, &of_light);
            sum.iter_mut().zip(entered).for_each(|(sum, e)| *sum += e);
        }
        sum.iter_mut().zip(&self.of_samples).for_each(|(e, s)| *e *= *s);
        let kernels = self.calibrated.kernels.clone();
        let gather = Gather::with_kernels_of_parts(&surface, &self.cut.tree, kernels, NearField::REFERENCE);
        let lit = gather.light(&sum);
        let values = gather.radiosity(&self.receivers, &lit, Scheme::AllPairs, progress);
        let of_vertices = self.calibrated.of_vertices();
        Ok(self.receivers.expand(&values).iter().zip(of_vertices).map(|(b, s)| *b * s).collect())
    }
}
