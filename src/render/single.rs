//! Scattered light that leaves a surface, and single scattering towards the eye.

use glam::DVec3;

use super::exit::{ExitFresnel, ExitRadiance};
use super::texture::Texture;
use crate::error::{Error, Result};
use crate::evaluate::exitance::{Exitance, MeshPoint};
use crate::evaluate::single_scattering::{SeenPoint, TowardsEye};
use crate::math::random;
use crate::scene::Scene;
use crate::transport::single_scattering::ExitPoint;
use crate::transport::single_scattering::radiance::Share;

/// Key of the random numbers of this stage.
const STAGE: u64 = 0x7369_6e67_6c65;

/// Source of a picture's single scattering.
#[derive(Clone, Copy, Default)]
pub enum Single<'a> {
    /// The picture has none.
    #[default]
    None,
    /// A value `s` for each source vertex: `L = F_t(w_o) s / (pi C)`, whatever the normalisation of the exit Fresnel
    /// factor, since s was made with C.
    PerVertex(&'a [DVec3]),
    /// Radiance from an evaluator for each eye ray.
    TowardsEye(&'a dyn TowardsEye),
}

/// Scattered light that leaves a surface.
#[derive(Clone, Copy)]
pub struct Scattered<'a> {
    /// Exitance of light scattered more than once, and of single scattering where the evaluator's radiosity includes
    /// it.
    pub exitance: &'a dyn Exitance,
    /// Single scattering that the exitance does not include.
    pub single: Single<'a>,
    /// The texture that multiplies both.
    pub texture: Option<&'a Texture>,
}

impl<'a> From<&'a dyn Exitance> for Scattered<'a> {
    fn from(exitance: &'a dyn Exitance) -> Self {
        Self { exitance, single: Single::None, texture: None }
    }
}

impl<'a> From<&'a Vec<DVec3>> for Scattered<'a> {
    fn from(radiosity: &'a Vec<DVec3>) -> Self {
        Self::from(radiosity as &dyn Exitance)
    }
}

impl Scattered<'_> {
    /// Checks that there is one finite value for each vertex, where values are given at vertices.
    pub(super) fn check(&self, scene: &Scene) -> Result<()> {
        let vertices = scene.mesh.local_mm.len();
        let check = |name: &str, values: &[DVec3]| {
            if values.len() != vertices {
                let given = values.len();
                return Err(Error::runtime(format!(
                    "{given} values of {name} for the {vertices} vertices of the mesh"
                )));
            }
            match values.iter().position(|b| !b.is_finite()) {
                Some(vertex) => Err(Error::runtime(format!("the {name} of vertex {vertex} is {}", values[vertex]))),
                None => Ok(()),
            }
        };
        self.exitance.at_vertices().map_or(Ok(()), |values| check("radiosity", values))?;
        match self.single {
            Single::PerVertex(values) => check("single scattering", values),
            Single::None | Single::TowardsEye(_) => Ok(()),
        }
    }
}

/// A point of the surface that an eye ray sees from its front.
pub(super) struct Spot<'a> {
    pub(super) point: &'a MeshPoint,
    pub(super) exit: ExitPoint,
    pub(super) to_eye: DVec3,
    /// Cosine of the shading normal to the eye.
    pub(super) cosine: f64,
    /// Index of the medium.
    pub(super) medium: usize,
}

/// An eye ray: its pixel and its number among the pixel's rays.
#[derive(Clone, Copy)]
pub(super) struct EyeRay {
    pub(super) pixel: u64,
    pub(super) sample: u32,
    pub(super) of: u32,
}

impl EyeRay {
    /// The ray's share of the strata. Their order differs from pixel to pixel, so that the rays at one place of all
    /// pixels cover all strata.
    fn share(self) -> Share {
        let turn = (random::bits(STAGE, self.pixel, 0) >> 32) as u32 % self.of.max(1);
        Share::new((self.sample + turn) % self.of.max(1), self.of)
    }

    fn key(self) -> u64 {
        self.pixel.wrapping_mul(u64::from(self.of)).wrapping_add(self.sample.into())
    }
}

/// Single scattering of a scene.
pub(super) struct SingleRadiance<'a> {
    single: Single<'a>,
    /// Exit radiance of each medium.
    exits: Vec<ExitRadiance>,
}

impl<'a> SingleRadiance<'a> {
    pub(super) fn new(scene: &Scene, single: Single<'a>) -> Self {
        let exit = |eta: f64| ExitRadiance::new(eta, ExitFresnel::Normalised);
        Self { single, exits: scene.media.iter().map(|m| exit(m.properties.eta_inside_over_outside)).collect() }
    }

    /// Single scattering towards the eye, RGB.
    pub(super) fn at(&self, spot: &Spot, ray: EyeRay) -> DVec3 {
        match self.single {
            Single::None => DVec3::ZERO,
            Single::PerVertex(values) => {
                let exit = self.exits.get(spot.medium).map_or(0.0, |e| e.per_radiosity(spot.cosine));
                let corner = |k: usize| values.get(spot.point.vertices[k] as usize).copied().unwrap_or(DVec3::ZERO);
                exit * (0..3).map(|k| corner(k) * spot.point.barycentric[k]).sum::<DVec3>()
            }
            Single::TowardsEye(eye) => eye.radiance(&SeenPoint {
                exit: spot.exit,
                triangle: spot.point.triangle,
                weights: spot.point.barycentric,
                to_eye: spot.to_eye,
                key: ray.key(),
                share: ray.share(),
            }),
        }
    }
}
