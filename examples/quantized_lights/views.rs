//! Image errors over random views: what each pixel sees is worked out once for a scene.

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use translux::error::Result;
use translux::geometry::bvh::{Bvh, Ray};
use translux::measure::image_error::{exposure, image_error};
use translux::render::camera::{Camera, DEFAULT_FOV_DEGREES, Resolution};
use translux::render::exit::{ExitFresnel, ExitRadiance};
use translux::render::normals::ShadingNormals;
use translux::scene::Scene;

use crate::bench::random_direction;

/// Side of a picture in pixels.
pub(crate) const SIDE: usize = 256;

/// Random numbers of the views.
const STAGE: u64 = 0x7669_6577_7300;

/// The renderer's limit of exit cosines: a share of the geometric one.
const LEAST_COSINE_SHARE: f64 = 0.5;

/// Vertices that a covered pixel sees through its centre, and what each adds to the diffuse radiance.
type Seen = ([u32; 3], [f32; 3]);

/// A picture's covered pixels.
type Picture = Vec<[f32; 3]>;

/// Random views of a scene.
pub(crate) struct Views {
    views: Vec<Vec<Seen>>,
}

/// Pictures of one radiosity in all views, and the factors that scale them.
pub(crate) struct Pictures {
    pictures: Vec<(Picture, f64)>,
    /// The factor that all views together would have.
    together: f64,
}

/// Image RMS in the worst view.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ImageRms {
    pub(crate) covered: f64,
    pub(crate) with_background: f64,
    /// With background, and the factor that brings the 99.5th percentile of all views together to 1: views of the dark side are
    /// not brightened.
    pub(crate) one_exposure: f64,
}

impl Views {
    pub(crate) fn new(scene: &Scene, count: usize) -> Result<Self> {
        let (bvh, normals) = (Bvh::new(&scene.mesh), ShadingNormals::new(scene));
        let exit: Vec<ExitRadiance> = scene
            .media
            .iter()
            .map(|m| ExitRadiance::new(m.properties.eta_inside_over_outside, ExitFresnel::Normalised))
            .collect();
        let resolution = Resolution::new(SIDE, SIDE)?;
        let [low, high] = scene.mesh.bounds_local_mm();
        let centre = 0.5 * (low + high) + scene.mesh.origin_mm;
        let view = |index: usize| {
            let towards = random_direction(STAGE, index as u64);
            let up = if towards.y.abs() > 0.99 { DVec3::X } else { DVec3::Y };
            let camera = Camera::framing_from(&scene.mesh, resolution, towards, centre, up, DEFAULT_FOV_DEGREES)?;
            let eye = (camera.at_mm() - scene.mesh.origin_mm).as_vec3();
            let pixels = (0..resolution.pixels()).filter_map(|pixel| {
                let middle = DVec2::new((pixel % SIDE) as f64 + 0.5, (pixel / SIDE) as f64 + 0.5);
                let direction = camera.direction(middle, resolution);
                seen(scene, &bvh, &normals, &exit, (eye, direction))
            });
            Ok(pixels.collect())
        };
        Ok(Self { views: (0..count).into_par_iter().map(view).collect::<Result<_>>()? })
    }

    fn pictures_of(&self, radiosity: &[DVec3]) -> impl IndexedParallelIterator<Item = Picture> {
        let narrow: Vec<Vec3> = radiosity.iter().map(|b| b.as_vec3()).collect();
        self.views.par_iter().map(move |view| {
            let pixel = |(corners, weights): &Seen| {
                (0..3).map(|k| narrow[corners[k] as usize] * weights[k]).sum::<Vec3>().to_array()
            };
            view.iter().map(pixel).collect()
        })
    }

    /// Pictures that others are compared with.
    pub(crate) fn reference(&self, radiosity: &[DVec3]) -> Pictures {
        let of_view = |picture: Picture| {
            let scale = exposure(&picture, &vec![true; picture.len()]);
            (picture, scale)
        };
        let pictures: Vec<(Picture, f64)> = self.pictures_of(radiosity).map(of_view).collect();
        let all: Picture = pictures.iter().flat_map(|(picture, _)| picture.iter().copied()).collect();
        Pictures { together: exposure(&all, &vec![true; all.len()]), pictures }
    }

    /// The image error's RMS in the worst view.
    pub(crate) fn worst(&self, radiosity: &[DVec3], reference: &Pictures) -> ImageRms {
        let together = reference.together;
        let of_view = |(picture, (reference, scale)): (Picture, &(Picture, f64))| {
            let root = |scale: f64, pixels: usize| {
                let clamp = |v: f32| (f64::from(v) * scale).clamp(0.0, 1.0);
                let pairs = picture.as_flattened().iter().zip(reference.as_flattened());
                let sum: f64 = pairs.map(|(a, b)| (clamp(*a) - clamp(*b)).powi(2)).sum();
                (sum / (3 * pixels).max(1) as f64).sqrt()
            };
            let covered = root(*scale, picture.len());
            let share = picture.len() as f64 / (SIDE * SIDE) as f64;
            let one_exposure = root(together, SIDE * SIDE);
            ImageRms { covered, with_background: covered * share.sqrt(), one_exposure }
        };
        let all: Vec<ImageRms> = self.pictures_of(radiosity).zip(&reference.pictures).map(of_view).collect();
        all.into_iter().fold(ImageRms::default(), ImageRms::max)
    }

    /// The largest difference between [`Self::worst`] and the library's image error of the same pictures.
    pub(crate) fn check(&self, radiosity: &[DVec3], reference: &Pictures) -> f64 {
        let pairs = self.pictures_of(radiosity).zip(&reference.pictures);
        let errors: Vec<f64> = pairs.map(|(a, (b, _))| image_error(&a, b, &vec![true; a.len()]).rms).collect();
        (errors.into_iter().fold(0.0, f64::max) - self.worst(radiosity, reference).covered).abs()
    }
}

impl ImageRms {
    pub(crate) fn max(self, other: Self) -> Self {
        Self {
            covered: self.covered.max(other.covered),
            with_background: self.with_background.max(other.with_background),
            one_exposure: self.one_exposure.max(other.one_exposure),
        }
    }
}

/// Median and worst over lights.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spread {
    pub(crate) median: ImageRms,
    pub(crate) worst: ImageRms,
}

impl Spread {
    pub(crate) fn of(all: &[ImageRms]) -> Self {
        let median = |figure: fn(&ImageRms) -> f64| {
            let mut values: Vec<f64> = all.iter().map(figure).collect();
            values.sort_unstable_by(f64::total_cmp);
            let at = |index: usize| values.get(index).copied().unwrap_or(0.0);
            0.5 * (at(values.len() / 2) + at(values.len().saturating_sub(1) / 2))
        };
        Self {
            median: ImageRms {
                covered: median(|e| e.covered),
                with_background: median(|e| e.with_background),
                one_exposure: median(|e| e.one_exposure),
            },
            worst: all.iter().copied().fold(ImageRms::default(), ImageRms::max),
        }
    }
}

fn seen(
    scene: &Scene,
    bvh: &Bvh,
    normals: &ShadingNormals,
    exit: &[ExitRadiance],
    (eye, direction): (Vec3, DVec3),
) -> Option<Seen> {
    let hit = bvh.closest(&Ray::new(eye, direction.as_vec3()))?;
    let corners = *scene.mesh.triangles.get(hit.triangle as usize)?;
    let weights = [1.0 - f64::from(hit.u) - f64::from(hit.v), f64::from(hit.u), f64::from(hit.v)];
    let part = *scene.parts.triangle_part.get(hit.triangle as usize)?;
    let medium = scene.parts.parts.get(part as usize)?.medium?;
    let cos_geometric = -normals.geometric(hit.triangle).dot(direction);
    let cosine = (-normals.at(hit.triangle, weights).dot(direction)).max(LEAST_COSINE_SHARE * cos_geometric);
    let factor = if cos_geometric > 0.0 { exit.get(medium as usize)?.per_radiosity(cosine) } else { 0.0 };
    Some((corners, weights.map(|w| (w * factor) as f32)))
}
