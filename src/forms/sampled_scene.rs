//! A scene with its samples, for bakes of a baked-in material.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use translux_format::RawSection;

use super::density::Density;
use super::gathered::model;
use super::sample_count::samples_for;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::sampling_error::Sampled;
use crate::evaluate::{BakeSettings, Model};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::geometry::scattered::OrientedPoint;
use crate::light::Light;
use crate::medium::profile::Orders;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::calibration::{Calibrated, CalibratedSamples, Walks};
use crate::transport::gather::Gather;
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{ProbePoints, Receivers};
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Receivers that share a traversal of the tree.
pub const GROUP: usize = 16;

/// Rays of the lights near the scene; scattering and the number of samples smooth the single ray of each sample.
const SAMPLING: LightSampling = LightSampling { points_per_patch: 1, ..LightSampling::FAST };

/// The vertices as points of the surface.
pub fn oriented(scene: &Scene, receivers: &Receivers) -> Vec<OrientedPoint> {
    let mut normals = vec![DVec3::ZERO; receivers.len()];
    for (index, triangle) in scene.mesh.triangles.iter().enumerate() {
        let cross = scene.mesh.cross_mm2(index as u32);
        for &v in triangle {
            if let Some(normal) = normals.get_mut(receivers.of_vertex[v as usize] as usize) {
                *normal += cross;
            }
        }
    }
    let point = |(at_mm, normal): (&DVec3, &DVec3)| OrientedPoint { at_mm: *at_mm, normal: normal.normalize_or_zero() };
    receivers.positions.iter().zip(&normals).map(point).collect()
}

/// Receivers of each part.
pub fn parts(receivers: &Receivers) -> Vec<Range<usize>> {
    let run = |groups: &[crate::transport::receivers::Group]| {
        let end = groups.last().map_or(0, |g| g.run.end as usize);
        groups.first().map_or(0, |g| g.run.first as usize)..end
    };
    receivers.groups.chunk_by(|a, b| a.part == b.part).map(run).collect()
}

/// A scene, its samples in a tree, and its receivers.
pub struct SampledScene<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// BVH of its triangles.
    pub bvh: Bvh,
    /// Samples of its surface.
    pub samples: Samples,
    /// Patches of the samples.
    pub patches: Vec<Patch>,
    /// The samples in a tree.
    pub tree: SampleTree,
    /// Vertices that receive.
    pub receivers: Receivers,
    /// A third of the triangles around each receiver, mm^2.
    pub areas: Vec<f64>,
    /// The receivers as points of the surface.
    pub points: Vec<OrientedPoint>,
    /// Rays towards a light.
    pub sampling: LightSampling,
    /// Calibrated kernels in place of the dipole's.
    pub model: Option<CalibratedSamples>,
    /// Orders of scattering that the kernels hold.
    orders: Orders,
}

impl<'a> SampledScene<'a> {
    /// A scene with about `count` samples.
    pub fn new(scene: &'a Scene, count: usize) -> Self {
        let samples = Samples::new(&scene.mesh, &scene.parts, count);
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || samples::patches(&scene.mesh, &samples));
        let tree = SampleTree::new(&samples, &patches);
        let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        let areas = receivers.areas_mm2(&scene.mesh);
        let points = oriented(scene, &receivers);
        let (sampling, model, orders) = (SAMPLING, None, Orders::FromOne);
        Self { scene, bvh, samples, patches, tree, receivers, areas, points, sampling, model, orders }
    }

    /// A scene with as many samples as are asked for, or as the asked error needs.
    ///
    /// # Errors
    /// As [`samples_for`].
    pub fn with_density(scene: &'a Scene, density: Density, settings: &BakeSettings) -> Result<Self> {
        Ok(Self::new(scene, samples_for(scene, (density, SAMPLING), settings, &[])?))
    }

    /// The same with the kernels of a bake, which hold some orders; where these are calibrated also the sections that say so.
    ///
    /// # Errors
    /// As [`Calibrated::by_walks`].
    pub fn with_model(
        mut self,
        settings: &BakeSettings,
        orders: Orders,
        progress: &dyn Progress,
    ) -> Result<(Self, Vec<RawSection>)> {
        self.orders = orders;
        let Model::Calibrated(walks) = settings.model else { return Ok((self, Vec::new())) };
        let walks = (Walks { orders, ..walks }, settings.kernels.as_slice());
        let (calibrated, sections) = model::bake(self.scene, &self.bvh, walks, progress)?;
        Ok((self.calibrated(Arc::new(calibrated)), model::without_factors(sections)))
    }

    /// The same with the kernels of other samples of the same scene.
    #[must_use]
    pub fn with_model_of(mut self, other: &Self) -> Self {
        self.orders = other.orders;
        match &other.model {
            Some(model) => self.calibrated(Arc::clone(&model.calibrated)),
            None => self,
        }
    }

    fn calibrated(mut self, calibrated: Arc<Calibrated>) -> Self {
        self.receivers = calibrated.at_vertices(self.receivers);
        let model = CalibratedSamples::new(calibrated, &self.surface());
        model.entry.prepare(&self.surface());
        self.model = Some(model);
        self
    }

    /// The surface that light falls on.
    pub fn surface(&self) -> Surface<'_> {
        Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// Irradiance of every sample under each light, RGB lights as their first channel.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub fn irradiance(&self, lights: &[Light]) -> Result<IrradianceRows> {
        let mut values = vec![0.0; self.samples.len() * lights.len()];
        for (column, light) in lights.iter().enumerate() {
            for (row, e) in values.chunks_exact_mut(lights.len()).zip(&self.received(light)?) {
                row[column] = e.x as f32;
            }
        }
        Ok(self.moved_rows(lights, IrradianceRows { lights: lights.len(), by_channel: false, values }))
    }

    /// Irradiance under lights where it first scatters, if kernels are calibrated: each channel has its own then.
    pub(crate) fn moved_rows(&self, lights: &[Light], rows: IrradianceRows) -> IrradianceRows {
        match &self.model {
            Some(model) => model.entry.moved_rows(&self.surface(), lights, rows),
            None => rows,
        }
    }

    /// Irradiance of every sample under a light by rays, RGB, where it first scatters if kernels are calibrated.
    pub(crate) fn by_rays(&self, light: &Light) -> Result<Vec<DVec3>> {
        let Some(model) = &self.model else { return self.received(light) };
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let rays = (etas.as_slice(), self.sampling);
        let (irradiance, _) =
            model.entry.entered_by_rays(&self.surface(), std::slice::from_ref(light), rays, &Silent)?;
        Ok(irradiance)
    }

    /// The same where it enters.
    fn received(&self, light: &Light) -> Result<Vec<DVec3>> {
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        Ok(Illumination::new(&self.surface(), std::slice::from_ref(light), &etas, self.sampling)?.all(&Silent))
    }

    /// Receivers that are points of a net or some of them, given by their indices.
    pub(crate) fn probes(&self, indices: Vec<u32>) -> ProbePoints {
        ProbePoints::new(indices, &self.areas)
    }

    /// Calls `work` with the transfer of the samples to the receivers, not tuned yet.
    ///
    /// # Errors
    /// Errors of the work.
    pub fn with_transfer<T>(&self, near: NearField, work: impl FnOnce(ManyLights) -> Result<T>) -> Result<T> {
        let surface = self.surface();
        let gather = match &self.model {
            Some(CalibratedSamples { calibrated, factors, .. }) => {
                Gather::calibrated(&surface, &self.tree, (&calibrated.kernels, factors), near)
            }
            None => Gather::with_kernels(&surface, &self.tree, self.kernels(), near),
        };
        work(ManyLights::new(&gather, &self.tree, &self.receivers, &self.areas))
    }

    /// The dipoles of the orders of the kernels.
    fn kernels(&self) -> Vec<MediumKernel> {
        MediumKernel::of_orders(&self.scene.media, self.orders, self.scene.mesh.diagonal_mm())
    }

    /// Enters the error of the samples, the worst of some lights; see [`Sampled::enter`].
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(crate) fn enter_sampling(
        &self,
        lights: &[Light],
        near: NearField,
        ledger: &mut Ledger,
        progress: &dyn Progress,
    ) -> Result<()> {
        let kernels = self.kernels();
        let mut worst = Ledger::default();
        progress.start("errors of samples", lights.len() as u64);
        for light in lights {
            let irradiance = self.by_rays(light)?;
            let sampled = Sampled {
                surface: self.surface(),
                kernels: Some(&kernels),
                calibrated: self.model.as_ref().map(|model| model.calibrated.as_ref()),
                lights: std::slice::from_ref(light),
                irradiance: (&irradiance, &Pieces::NONE),
                stored: None,
                sampling: self.sampling,
                near,
                receivers: &self.receivers,
                areas: &self.areas,
            };
            let mut of_light = Ledger::default();
            sampled.enter(&mut of_light, &Silent)?;
            worst.worst_of(of_light);
            progress.advance(1);
        }
        progress.finish();
        ledger.entries.extend(worst.entries);
        Ok(())
    }
}
