//! Single scattering at run time: looked up in harmonics or rows of the light, or by rays.

use glam::DVec3;
use translux_format::distant_transport::{DistantTransport, Single as File, tags};

use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::SingleScattering;
use crate::evaluate::form::read_error;
use crate::evaluate::single_scattering::{LitScene, Scattering, SeenPoint, TowardsEye, Traced};
use crate::evaluate::stages::{probe_points, worst};
use crate::forms::baked_in::{Beside, MeanCosine, Single as InAsset, Stored, StoredSingle};
use crate::forms::distant::{Distant, Integrand, Single, Terms};
use crate::forms::gathered::model::sections_of;
use crate::forms::projected::components::{Components, Weighted};
use crate::forms::projected::harmonics::{HarmonicBasis, components};
use crate::forms::rows::Rows;
use crate::forms::sampled_scene::GROUP;
use crate::light::Light;
use crate::math::statistics::VertexError;
use crate::medium::fresnel::transmittance;
use crate::medium::phase::LegendrePhase;
use crate::parallel::*;
use crate::scene::Scene;
use crate::transport::receivers::{ProbePoints, Receivers};
use crate::transport::single_scattering::radiance::{self, Path, Settings};
use crate::transport::single_scattering::{ExitPoint, inside_towards, radiosity_factor, vertex_points};

/// Scattering places inside for each pixel, by rays.
const PLACES: u32 = 128;

/// The same for every vertex.
const PLACES_OF_VERTICES: u32 = 32;

/// Relative L2 error of a phase function over the asked error; under light from a hemisphere it shrinks.
const PHASE: f64 = 20.0;

/// Terms of a phase function at most.
const MOST_TERMS: usize = translux_format::distant_transport::MOST_TERMS as usize;

/// Transport of light from far away as an asset holds it, with what is beside it.
pub(crate) struct Opened {
    pub(crate) scene: Scene,
    pub(crate) receivers: Receivers,
    pub(crate) file: DistantTransport,
    pub(crate) beside: Beside,
}

/// Opens an asset of light from far away.
pub(crate) fn opened(asset: &Asset, plan: &Distant) -> Result<Opened> {
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let file = DistantTransport::from_sections(&asset.sections, receivers.len())
        .map_err(read_error)?
        .ok_or_else(|| Error::input("an asset without its transport (sections aft.*); bake it again"))?;
    let beside = Beside {
        single: single(file.single.as_ref(), plan, &scene, &receivers)?,
        outside: plan.outside,
        calibration: sections_of(asset),
    };
    Ok(Opened { scene, receivers, file, beside })
}

/// Single scattering of an asset.
fn single(file: Option<&File>, plan: &Distant, scene: &Scene, receivers: &Receivers) -> Result<InAsset> {
    let Some(File { terms, harmonics, rows }) = file else {
        return Ok(match plan.single {
            Single::Off => InAsset::None,
            Single::Folded => InAsset::Folded(traced(Scattering::Isotropic, PLACES_OF_VERTICES, plan)),
            Single::Isotropic | Single::Phase(Terms::Stored(_)) => {
                return Err(Error::input("an asset without its sections afs.*; bake it again"));
            }
            Single::Phase(Terms::Auto | Terms::Rays) => {
                InAsset::Beside(Box::new(ByRays(traced(Scattering::OfMedium, PLACES, plan))))
            }
        });
    };
    let phase = match resolved(plan.single, scene, f64::INFINITY) {
        Single::Phase(_) => Scattering::OfMedium,
        Single::Off | Single::Isotropic | Single::Folded => Scattering::Isotropic,
    };
    let values = match (harmonics, rows) {
        (Some(harmonics), None) => {
            let shells = *terms as usize;
            Values::Harmonics(components(harmonics, (tags::SINGLE_SET, shells), scene, receivers)?, shells)
        }
        (None, Some(rows)) => Values::Rows(Rows::new(rows, plan.transform)?),
        _ => return Err(Error::input("an asset that needs a later version of this program")),
    };
    Ok(InAsset::Beside(Box::new(LookedUp { values, phase, integrand: plan.integrand })))
}

fn traced(scattering: Scattering, samples: u32, plan: &Distant) -> Traced {
    let Integrand { form, crossings } = plan.integrand;
    Traced { form, crossings, ..Traced::new(scattering, samples) }
}

/// Resolves automatic terms to those that the media need; isotropic where g is 0 in every medium.
pub(super) fn resolved(single: Single, scene: &Scene, max_rms: f64) -> Single {
    let Single::Phase(terms) = single else { return single };
    let g = largest_g(scene);
    let fits = |terms: &&usize| missing(g, **terms) <= PHASE * max_rms;
    match terms {
        Terms::Auto if g == 0.0 => Single::Isotropic,
        Terms::Auto => Single::Phase([1, 4, 9, 16].iter().find(fits).map_or(Terms::Rays, |k| Terms::Stored(*k))),
        Terms::Stored(_) | Terms::Rays => single,
    }
}

/// The largest |g| of the media in use.
pub(super) fn largest_g(scene: &Scene) -> f64 {
    let media = scene.parts.parts.iter().filter_map(|part| scene.media.get(part.medium? as usize));
    media.map(|m| m.properties.g.abs()).fold(0.0, f64::max)
}

/// Relative L2 error of Henyey and Greenstein's function cut to whole bands.
pub(super) fn missing(g: f64, terms: usize) -> f64 {
    let square = g * g;
    let energy = |l: usize| (2 * l + 1) as f64 * square.powi(l as i32);
    let kept: f64 = (0..terms.isqrt()).map(energy).sum();
    let all = (1.0 + square) / (1.0 - square).powi(2).max(f64::MIN_POSITIVE);
    (1.0 - kept / all).max(0.0).sqrt()
}

/// Stored transport.
pub(super) enum Values {
    /// Harmonics, and the number of terms.
    Harmonics(Components<HarmonicBasis>, usize),
    Rows(Rows),
}

/// Single scattering under some lights, term by term.
pub(super) struct LitTerms {
    /// `[term][receiver]`, RGB over the scale.
    terms: Vec<Vec<[f32; 4]>>,
    scale: f64,
}

impl Values {
    pub(super) fn lit(&self, lights: &[Light]) -> Result<LitTerms> {
        match self {
            Self::Harmonics(Components { basis, transport }, terms) => {
                let weights = basis.projected(lights)?;
                let of_term = |term: usize| {
                    let shell = |k: usize| if k == term { weights.clone() } else { Vec::new() };
                    Weighted { shells: (0..*terms).map(shell).collect(), factors: Vec::new() }
                };
                let lit = transport.lit((0..*terms).map(of_term).collect())?;
                Ok(LitTerms { terms: transport.of_parts(&lit), scale: lit.scale })
            }
            Self::Rows(rows) => {
                let cube = rows.light(lights)?;
                let mut sums = Vec::new();
                rows.sums(&cube, &mut sums);
                Ok(LitTerms { terms: vec![sums], scale: cube.scale })
            }
        }
    }

    fn bytes(&self) -> usize {
        match self {
            Self::Harmonics(components, _) => components.transport.bytes(),
            Self::Rows(rows) => rows.bytes(),
        }
    }
}

impl LitTerms {
    fn value(&self, term: usize, receiver: u32) -> DVec3 {
        match self.terms.get(term).and_then(|values| values.get(receiver as usize)) {
            Some(&[r, g, b, _]) => DVec3::new(r.into(), g.into(), b.into()) * self.scale,
            None => DVec3::ZERO,
        }
    }
}

/// Single scattering looked up in stored transport.
struct LookedUp {
    values: Values,
    phase: Scattering,
    integrand: Integrand,
}

impl StoredSingle for LookedUp {
    fn is(&self, _: &Scene) -> SingleScattering {
        match self.phase {
            Scattering::Isotropic => SingleScattering::PerVertex,
            Scattering::OfMedium => SingleScattering::TowardsEye,
        }
    }

    fn per_vertex(&self, lit: LitScene, receivers: &Receivers) -> Result<Option<Vec<DVec3>>> {
        if self.phase == Scattering::OfMedium {
            return Ok(None);
        }
        let terms = rayon::scope(|_| self.values.lit(lit.lights))?;
        Ok(Some(receivers.of_vertex.par_iter().map(|&r| terms.value(0, r).max(DVec3::ZERO)).collect()))
    }

    fn towards_eye<'a>(
        &'a self,
        lit: LitScene<'a>,
        receivers: &'a Receivers,
    ) -> Result<Option<Box<dyn TowardsEye + 'a>>> {
        if self.phase == Scattering::Isotropic {
            return Ok(None);
        }
        Ok(Some(Box::new(LitFromOutside::new(self.values.lit(lit.lights)?, lit.scene, receivers))))
    }

    fn mean_cosine(&self) -> MeanCosine {
        match self.phase {
            Scattering::Isotropic => MeanCosine::Stays,
            Scattering::OfMedium => MeanCosine::Free,
        }
    }

    fn enter_error(&self, lit: LitScene, receivers: &Receivers, ledger: &mut Ledger) -> Result<()> {
        let error = Probe::new(lit, receivers, self.integrand).error(&self.values, self.phase, lit.lights)?;
        ledger.add(
            "single scattering",
            error,
            "against rays along the inverse normal, relative to single scattering alone",
        );
        Ok(())
    }

    fn bytes(&self) -> usize {
        self.values.bytes()
    }
}

/// Terms under lights, evaluated towards eyes.
struct LitFromOutside<'a> {
    terms: LitTerms,
    scene: &'a Scene,
    receivers: &'a Receivers,
    /// For each medium: its phase function and `1 / (pi C)`.
    phases: Vec<(LegendrePhase, f64)>,
}

impl<'a> LitFromOutside<'a> {
    fn new(terms: LitTerms, scene: &'a Scene, receivers: &'a Receivers) -> Self {
        let count = terms.terms.len().min(MOST_TERMS);
        let of_medium = |m: &crate::medium::material::Medium| {
            let phase = LegendrePhase::henyey_greenstein(m.properties.g, count);
            (phase, 1.0 / radiosity_factor(m.properties.eta_inside_over_outside))
        };
        Self { phases: scene.media.iter().map(of_medium).collect(), terms, scene, receivers }
    }

    /// `L1` towards an eye at a point interpolated from receivers with weights.
    fn towards(&self, exit: &ExitPoint, to_eye: DVec3, corners: &[(u32, f64)]) -> DVec3 {
        let medium = self.scene.parts.parts.get(exit.part as usize).and_then(|part| part.medium);
        let Some(medium) = medium.map(|m| m as usize) else { return DVec3::ZERO };
        let (Some(of), Some((phase, factor))) = (self.scene.media.get(medium), self.phases.get(medium)) else {
            return DVec3::ZERO;
        };
        let eta = of.properties.eta_inside_over_outside;
        let Some(inside) = inside_towards(eta, to_eye, exit) else { return DVec3::ZERO };
        let mut view = [0.0; MOST_TERMS];
        phase.view(inside, &mut view);
        let sum: DVec3 = (0..self.terms.terms.len().min(MOST_TERMS))
            .map(|k| view[k] * corners.iter().map(|&(receiver, w)| w * self.terms.value(k, receiver)).sum::<DVec3>())
            .sum();
        // A series of few terms is negative in places.
        transmittance(eta, exit.normal.dot(to_eye)) * factor * sum.max(DVec3::ZERO)
    }
}

impl TowardsEye for LitFromOutside<'_> {
    fn radiance(&self, seen: &SeenPoint) -> DVec3 {
        let Some(triangle) = self.scene.mesh.triangles.get(seen.triangle as usize) else { return DVec3::ZERO };
        let receiver = |v: u32| self.receivers.of_vertex.get(v as usize).copied().unwrap_or(u32::MAX);
        let corners = [0, 1, 2].map(|k| (receiver(triangle[k]), seen.weights[k]));
        self.towards(&seen.exit, seen.to_eye, &corners)
    }

    fn paths_per_pixel(&self, _: u32) -> u64 {
        0
    }
}

/// Single scattering by rays; nothing is stored.
pub(super) struct ByRays(pub(super) Traced);

impl StoredSingle for ByRays {
    fn is(&self, scene: &Scene) -> SingleScattering {
        self.0.is(scene)
    }

    fn per_vertex(&self, lit: LitScene, _: &Receivers) -> Result<Option<Vec<DVec3>>> {
        self.0.per_vertex(lit, &crate::progress::Silent)
    }

    fn towards_eye<'a>(&'a self, lit: LitScene<'a>, _: &'a Receivers) -> Result<Option<Box<dyn TowardsEye + 'a>>> {
        self.0.towards_eye(lit).map(Some)
    }

    fn mean_cosine(&self) -> MeanCosine {
        MeanCosine::Free
    }

    fn enter_error(&self, lit: LitScene, _: &Receivers, ledger: &mut Ledger) -> Result<()> {
        self.0.enter_noise(lit, ledger)
    }

    fn bytes(&self) -> usize {
        0
    }
}

/// Point where light leaves for each receiver: as [`vertex_points`] has it for its first vertex.
pub(super) fn exits(scene: &Scene, receivers: &Receivers) -> Vec<ExitPoint> {
    let nowhere = ExitPoint { part: u32::MAX, ..ExitPoint::default() };
    let mut result = vec![nowhere; receivers.len()];
    for (exit, &receiver) in vertex_points(scene.domain()).into_iter().zip(&receivers.of_vertex).rev() {
        if let Some(slot) = result.get_mut(receiver as usize) {
            *slot = exit;
        }
    }
    result
}

/// Some receivers that errors are measured on.
pub(super) struct Probe<'a> {
    lit: LitScene<'a>,
    receivers: &'a Receivers,
    points: ProbePoints,
    /// Points where light leaves, one for each receiver.
    exits: Vec<ExitPoint>,
    integrand: Integrand,
}

impl<'a> Probe<'a> {
    pub(super) fn new(lit: LitScene<'a>, receivers: &'a Receivers, integrand: Integrand) -> Self {
        let (_, points) = probe_points(receivers, &receivers.areas_mm2(&lit.scene.mesh));
        let exits = points.of(&exits(lit.scene, receivers));
        Self { lit, receivers, points, exits, integrand }
    }

    /// Error relative to single scattering: isotropic, or towards eyes half way to the horizon.
    fn error(&self, values: &Values, phase: Scattering, lights: &[Light]) -> Result<VertexError> {
        let terms = values.lit(lights)?;
        let Integrand { form, crossings } = self.integrand;
        let settings = Settings { coefficients: phase.coefficients(), form, crossings, ..Settings::REFERENCE };
        let rays = radiance::SingleScattering::new(self.lit.scene.domain(), self.lit.bvh, lights, settings)?;
        let aslant = |n: DVec3| (n + n.any_orthonormal_vector()).normalize_or_zero();
        let points = || self.exits.par_iter().zip(&self.points.indices);
        let (found, expected): (Vec<DVec3>, Vec<DVec3>) = match phase {
            Scattering::Isotropic => {
                points().map(|(p, &r)| (terms.value(0, r).max(DVec3::ZERO), rays.per_point(p, r.into()))).collect()
            }
            Scattering::OfMedium => {
                let seen = LitFromOutside::new(terms, self.lit.scene, self.receivers);
                let of = |(p, &r): (&ExitPoint, &u32)| {
                    let eye = aslant(p.normal);
                    (seen.towards(p, eye, &[(r, 1.0)]), rays.radiance(p, eye, Path::InverseNormal, r.into()))
                };
                points().map(of).collect()
            }
        };
        Ok(self.points.error(&found, &expected))
    }

    /// Error of stored values, the worst of some lights, each alone.
    pub(super) fn worst(&self, values: &Values, single: Single, lights: &[Light]) -> Result<VertexError> {
        let phase = if single == Single::Isotropic { Scattering::Isotropic } else { Scattering::OfMedium };
        worst(lights.chunks(1), |light| Ok([self.error(values, phase, light)?])).map(|[worst]| worst)
    }
}
