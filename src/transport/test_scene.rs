//! Scenes for the tests of this layer.

use glam::DVec3;

use super::domain::Domain;
use super::kernel::{Block, Receiver};
use super::receivers::Receivers;
use super::surface::Surface;
use super::tree::SampleTree;
use crate::geometry::bvh::Bvh;
use crate::geometry::mesh::{Mesh, Placement};
use crate::geometry::part_table::PartTable;
use crate::geometry::samples::{Patch, Samples, patches};
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::medium::material::{Medium, OpticalProperties, preset};

/// A domain that owns its mesh, parts and media.
pub(super) struct TestScene {
    pub(super) mesh: Mesh,
    pub(super) parts: PartTable,
    pub(super) media: Vec<Medium>,
}

impl TestScene {
    pub(super) fn domain(&self) -> Domain<'_> {
        Domain { mesh: &self.mesh, parts: &self.parts, media: &self.media }
    }
}

/// A scene with everything that a [`Surface`] borrows.
pub(super) struct Fixture {
    pub(super) scene: TestScene,
    pub(super) bvh: Bvh,
    pub(super) samples: Samples,
    pub(super) patches: Vec<Patch>,
    pub(super) tree: SampleTree,
}

/// Mesh of a model in mm.
pub(super) fn mesh_of(source: SourceModel) -> Mesh {
    Mesh::from_source(source, &Placement { mm_per_unit: 1.0 }).unwrap().0
}

/// Optical properties of a published material.
pub(super) fn named(name: &str) -> OpticalProperties {
    preset(name).unwrap().properties()
}

/// A medium with these reduced scattering and absorption coefficients, 1/mm, whose phase function is isotropic.
pub(super) fn medium(sigma_s: DVec3, sigma_a: DVec3, eta_inside_over_outside: f64) -> OpticalProperties {
    let (sigma_s_reduced_per_mm, sigma_a_per_mm) = (sigma_s, sigma_a);
    OpticalProperties { sigma_s_reduced_per_mm, sigma_a_per_mm, g: 0.0, eta_inside_over_outside }
}

/// A block of receivers around a centre.
pub(super) fn block_of(centre: DVec3, receivers: &[DVec3]) -> Block {
    let mut block = Block::default();
    block.reset(centre, receivers.iter().map(|&at_mm| Receiver { at_mm, normal: DVec3::ZERO }));
    block
}

impl Fixture {
    /// A knot of marble, which hides parts of itself.
    pub(super) fn knot(samples: usize) -> Self {
        Self::new(shapes::torus_knot(2, 3, 10.0, 4.0, 1.5, 160, 16), named("marble"), samples)
    }

    /// A scene of one part of one medium.
    pub(super) fn new(source: SourceModel, properties: OpticalProperties, samples: usize) -> Self {
        Self::with_opaque(source, usize::MAX, properties, samples)
    }

    /// [`Self::new`] with triangles from `first_opaque` on that only cast shadows.
    pub(super) fn with_opaque(
        source: SourceModel,
        first_opaque: usize,
        properties: OpticalProperties,
        samples: usize,
    ) -> Self {
        let mesh = mesh_of(source);
        let triangle_part = (0..mesh.triangles.len()).map(|t| u32::from(t >= first_opaque)).collect();
        let parts = PartTable::new(&mesh, triangle_part, vec![("body".into(), Some(0)), ("opaque".into(), None)]);
        let scene = TestScene { mesh, parts, media: vec![Medium { name: "test".into(), properties }] };
        let bvh = Bvh::new(&scene.mesh);
        let samples = Samples::new(&scene.mesh, &scene.parts, samples);
        let patches = patches(&scene.mesh, &samples);
        let tree = SampleTree::new(&samples, &patches);
        Self { scene, bvh, samples, patches, tree }
    }

    pub(super) fn surface(&self) -> Surface<'_> {
        Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// The same with the samples in tree order.
    pub(super) fn in_tree_order(mut self) -> Self {
        self.samples = self.samples.in_tree_order(&self.scene.mesh, &self.scene.parts);
        self.patches = patches(&self.scene.mesh, &self.samples);
        self
    }

    /// A receiver for each vertex, in groups of at most `capacity`.
    pub(super) fn receivers(&self, capacity: usize) -> Receivers {
        Receivers::new(&self.scene.mesh, &self.scene.parts, capacity)
    }

    /// Refractive index of the medium.
    pub(super) fn eta(&self) -> f64 {
        self.scene.media[0].properties.eta_inside_over_outside
    }

    /// Flux into the samples, RGB.
    pub(super) fn flux(&self, irradiance: &[DVec3]) -> DVec3 {
        self.patches.iter().zip(irradiance).map(|(p, e)| p.area_mm2 * *e).sum()
    }
}

/// RMS of a difference over that of the reference, all channels together.
pub(super) fn relative_rms(values: &[DVec3], reference: &[DVec3]) -> f64 {
    let error: f64 = values.iter().zip(reference).map(|(a, b)| (*a - *b).length_squared()).sum();
    (error / reference.iter().map(|b| b.length_squared()).sum::<f64>()).sqrt()
}

/// RMS of a difference over that of the reference, worst channel.
pub(super) fn worst_rms(values: &[DVec3], reference: &[DVec3]) -> f64 {
    let square = |v: DVec3| v * v;
    let error: DVec3 = values.iter().zip(reference).map(|(a, b)| square(*a - *b)).sum();
    (error / reference.iter().map(|b| square(*b)).sum::<DVec3>()).max_element().sqrt()
}

/// Runs `work` on so many threads.
pub(super) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}
