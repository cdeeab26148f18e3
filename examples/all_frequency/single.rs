//! Single scattering of a body in pictures: by rays along either path, and from baked vectors.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;
use rayon::prelude::*;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::evaluate::single_scattering::{SeenPoint, TowardsEye};
use translux::geometry::bvh::Bvh;
use translux::light::Light;
use translux::light::cube_light::CubeLight;
use translux::math::cube_map::direction;
use translux::measure::image_error::{ImageError, exposure, image_error};
use translux::medium::fresnel::transmittance;
use translux::medium::phase::{DirectionMaps, LegendrePhase, MOST_TERMS};
use translux::methods;
use translux::progress::Silent;
use translux::render::background::Background;
use translux::render::camera::{Camera, Resolution};
use translux::render::frame::{Frame, RenderSettings, Specular, render};
use translux::render::single::{Scattered, Single};
use translux::scene::Scene;
use translux::transport::single_scattering::ExitPoint;
use translux::transport::single_scattering::interface::refracted;
use translux::transport::single_scattering::radiance::{Path, Settings, SingleScattering};
use translux::transport::single_scattering::vectors::VectorBaker;

use crate::bench::Map;
use crate::common::bench::{Context, Recipe, bake_for};

/// Eye rays of a pixel, which share its samples.
const EYE_RAYS: u32 = 4;

/// Points of one task.
const CHUNK: usize = 64;

/// Faces of the cube map of lights that vectors are multiplied with.
pub(crate) const SIDE: usize = 32;

/// A sun at the centre of a texel (face, column, row), and an environment.
pub(crate) fn sun_and_sky(context: &Context, [face, x, y]: [usize; 3]) -> Result<[(&'static str, Light); 2]> {
    let sun = Light::Directional { from: direction(SIDE, face, x, y), irradiance: DVec3::splat(3.0) };
    Ok([("a sun", sun), ("Uffizi", Map::load(context, "debevec_uffizi_256.hdr")?.light(60.0))])
}

/// Who looks at a scene, and from where.
pub(crate) struct Stand {
    evaluator: Box<dyn Evaluator>,
    settings: RenderSettings,
    /// Side of the pictures.
    pub(crate) side: usize,
}

/// A picture of single scattering alone.
pub(crate) struct Picture {
    pub(crate) rgb: Vec<[f32; 3]>,
    coverage: Vec<f32>,
}

impl Picture {
    fn of(frame: &Frame) -> Self {
        Self {
            rgb: frame.pixels.iter().map(|p| p.single).collect(),
            coverage: frame.pixels.iter().map(|p| p.coverage).collect(),
        }
    }

    fn covered(&self) -> Vec<bool> {
        self.coverage.iter().map(|c| *c > 0.0).collect()
    }

    /// The image error against another.
    pub(crate) fn error(&self, reference: &Self) -> ImageError {
        image_error(&self.rgb, &reference.rgb, &reference.covered())
    }

    /// What brings its highlights to white.
    pub(crate) fn exposure(&self) -> f32 {
        exposure(&self.rgb, &self.covered()) as f32
    }

    /// Times a factor; the background white.
    pub(crate) fn shown(&self, factor: f32) -> Vec<[f32; 3]> {
        let pixel = |(rgb, coverage): (&[f32; 3], &f32)| rgb.map(|v| (v * factor + 1.0 - coverage).clamp(0.0, 1.0));
        self.rgb.iter().zip(&self.coverage).map(pixel).collect()
    }
}

impl Stand {
    pub(crate) fn new(scene: &Scene, side: usize) -> Result<Self> {
        // Nobody asks for its radiosity: a few samples do.
        let method = methods::built_in().method("two_pass")?;
        let recipe = Recipe { samples: Some(64), max_rms: 0.1, set: &[] };
        let asset = bake_for(translux::light::LightKind::Directional, method, scene, &recipe, &Silent)?;
        let resolution = Resolution::new(side, side)?;
        let settings = RenderSettings {
            samples_per_pixel: EYE_RAYS,
            background: Background::None,
            specular: Specular::Off,
            ..RenderSettings::new(Camera::framing(&scene.mesh, resolution)?, resolution)
        };
        Ok(Self { evaluator: methods::built_in().open(Arc::new(asset))?, settings, side })
    }

    /// A picture of what comes from `single`.
    pub(crate) fn picture(&self, single: Single) -> Result<Picture> {
        let radiosity = vec![DVec3::ZERO; self.evaluator.scene().mesh.local_mm.len()];
        let scattered = Scattered { exitance: &radiosity, single, texture: None };
        Ok(Picture::of(&render(self.evaluator.as_ref(), scattered, &[], &self.settings, &Silent)?))
    }

    /// By rays, along a path, with the random numbers of a key.
    pub(crate) fn traced(&self, (scene, bvh): (&Scene, &Bvh), light: &Light, by: Rays) -> Result<Picture> {
        let lights = std::slice::from_ref(light);
        let single = SingleScattering::new(scene.domain(), bvh, lights, by.settings)?;
        self.picture(Single::TowardsEye(&Traced { single, path: by.path, key: by.key }))
    }

    /// Which vertices are corners of triangles that are seen.
    pub(crate) fn seen(&self) -> Result<Vec<bool>> {
        let scene = self.evaluator.scene();
        let marks = Marks {
            triangles: &scene.mesh.triangles,
            seen: (0..scene.mesh.local_mm.len()).map(|_| AtomicBool::new(false)).collect(),
        };
        self.picture(Single::TowardsEye(&marks))?;
        Ok(marks.seen.into_iter().map(AtomicBool::into_inner).collect())
    }
}

/// How rays go.
#[derive(Clone, Copy)]
pub(crate) struct Rays {
    pub(crate) settings: Settings,
    pub(crate) path: Path,
    pub(crate) key: u64,
}

struct Traced<'a> {
    single: SingleScattering<'a>,
    path: Path,
    key: u64,
}

impl TowardsEye for Traced<'_> {
    fn radiance(&self, seen: &SeenPoint) -> DVec3 {
        self.single.share_of_radiance(&seen.exit, seen.to_eye, self.path, seen.key + self.key, seen.share)
    }

    fn paths_per_pixel(&self, _: u32) -> u64 {
        0
    }
}

/// Notes what is looked at.
struct Marks<'a> {
    triangles: &'a [[u32; 3]],
    seen: Vec<AtomicBool>,
}

impl TowardsEye for Marks<'_> {
    fn radiance(&self, seen: &SeenPoint) -> DVec3 {
        let corners = self.triangles.get(seen.triangle as usize).into_iter().flatten();
        corners.filter_map(|v| self.seen.get(*v as usize)).for_each(|mark| mark.store(true, Ordering::Relaxed));
        DVec3::ZERO
    }

    fn paths_per_pixel(&self, _: u32) -> u64 {
        0
    }
}

/// The view side of a phase function of few terms.
pub(crate) enum View<'a> {
    Legendre(&'a LegendrePhase),
    Separable(&'a DirectionMaps),
}

impl View<'_> {
    fn terms(&self) -> usize {
        match self {
            Self::Legendre(phase) => phase.terms(),
            Self::Separable(maps) => maps.terms(),
        }
    }

    fn evaluate(&self, towards_eye: DVec3, out: &mut [f64]) {
        match self {
            Self::Legendre(phase) => phase.view(towards_eye, out),
            Self::Separable(maps) => maps.evaluate(towards_eye, out),
        }
    }
}

/// `L1 = F_t(w_o) Sum_k h_k(w_o') T_k . L` from sums at the vertices.
pub(crate) struct Terms<'a> {
    pub(crate) triangles: &'a [[u32; 3]],
    /// `[vertex][term]` of `T_k . L`.
    pub(crate) sums: &'a [DVec3],
    /// Terms of a vertex in `sums`, which may be more than are used.
    pub(crate) stride: usize,
    pub(crate) view: View<'a>,
    pub(crate) eta: f64,
}

impl TowardsEye for Terms<'_> {
    fn radiance(&self, seen: &SeenPoint) -> DVec3 {
        let normal = seen.exit.normal;
        let Some(inside) = refracted(self.eta, seen.to_eye, normal) else { return DVec3::ZERO };
        let Some(corners) = self.triangles.get(seen.triangle as usize) else { return DVec3::ZERO };
        let mut view = [0.0; MOST_TERMS];
        self.view.evaluate(inside, &mut view);
        let mut sum = DVec3::ZERO;
        for (corner, weight) in corners.iter().zip(seen.weights) {
            let own = self.sums.get(*corner as usize * self.stride..).unwrap_or_default();
            sum += weight * own.iter().zip(&view).take(self.view.terms()).map(|(t, h)| *h * *t).sum::<DVec3>();
        }
        transmittance(self.eta, normal.dot(seen.to_eye)) * sum
    }

    fn paths_per_pixel(&self, _: u32) -> u64 {
        0
    }
}

/// `T_k . L` of every point under each light: `[light][point][term]`.
pub(crate) fn sums(baker: &VectorBaker, points: &[ExitPoint], lights: &[CubeLight]) -> Vec<Vec<DVec3>> {
    let (texels, terms) = (baker.texels(), baker.settings().phase.count());
    let radiance: Vec<[Vec<f64>; 3]> =
        lights.iter().map(|light| [0, 1, 2].map(|c| light.radiance().iter().map(|r| r[c]).collect())).collect();
    let of_chunk = |chunk: usize| {
        let mut out = vec![Vec::new(); lights.len()];
        let range = chunk * CHUNK..points.len().min((chunk + 1) * CHUNK);
        baker.range(points, range, |index, vector| {
            let dark = points.get(index).is_none_or(|p| p.normal == DVec3::ZERO);
            for (out, radiance) in out.iter_mut().zip(&radiance) {
                for own in vector.chunks_exact(3 * texels).take(terms) {
                    let channel = |c: usize| -> f64 {
                        let pairs = own[c * texels..][..texels].iter().zip(&radiance[c]);
                        pairs.map(|(t, l)| f64::from(*t) * l).sum()
                    };
                    out.push(if dark { DVec3::ZERO } else { DVec3::new(channel(0), channel(1), channel(2)) });
                }
            }
        });
        out
    };
    let chunks: Vec<Vec<Vec<DVec3>>> = (0..points.len().div_ceil(CHUNK)).into_par_iter().map(of_chunk).collect();
    let mut all = vec![Vec::with_capacity(points.len() * terms); lights.len()];
    for chunk in chunks {
        all.iter_mut().zip(chunk).for_each(|(all, own)| all.extend(own));
    }
    all
}

/// The paper's synthetic material, 1/mm.
pub(crate) const SYNTHETIC: [DVec3; 2] = [DVec3::new(0.75, 0.85, 1.0), DVec3::new(0.02, 0.04, 0.07)];
