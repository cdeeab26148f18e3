//! Bake of single scattering: vectors over the texels of a cube map, in harmonics at reference points or in Haar
//! coefficients of every vertex.

use glam::DVec3;
use translux_format::distant_transport::{Harmonics as File, Single as SingleFile, tags};
use translux_format::rows::{FACES, IrradianceRows};

use super::evaluate::{Probe, Values, exits, largest_g, missing, resolved};
use crate::compress::ledger::Ledger;
use crate::compress::prediction::Net;
use crate::error::Result;
use crate::evaluate::single_scattering::LitScene;
use crate::forms::distant::{Basis, Choice, Integrand, MOST_ORDER, Single, Terms, Work, under_suns};
use crate::forms::projected::coding::{Radiosities, code};
use crate::forms::projected::harmonics::components;
use crate::forms::projected::references::{in_ascending_order, spacing};
use crate::forms::rows::{Rows, expected_light};
use crate::forms::sampled_scene::parts;
use crate::light::Light;
use crate::medium::fresnel::diffuse_transmittance;
use crate::medium::material::Medium;
use crate::medium::phase::LightTerms;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::cube_harmonics::{CubeHarmonics, Product};
use crate::transport::irradiance_rows::row::Keep;
use crate::transport::irradiance_rows::vectors::{RowWriter, Selection, joined};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::single_scattering::plane::PlaneMedium;
use crate::transport::single_scattering::radiance::{DepthSampling, Settings, SingleScattering};
use crate::transport::single_scattering::vectors::{VectorBaker, VectorSettings};
use crate::transport::single_scattering::{Coefficients, ExitPoint, Form, Optics, radiosity_factor};

/// Cap on the allowed error of single scattering over that of the radiosity; below it, single scattering may err by as
/// many times more as it is darker.
const MOST_OWN: f64 = 8.0;

/// Shares of the error of single scattering.
const SPATIAL: f64 = 0.3;
const CODED: f64 = 0.25;

/// Suns that the spacing of reference points is chosen by, and distances inside under them.
const SUNS: usize = 4;
const PLACES: u32 = 8;

/// Order of the harmonics at most where there are several terms.
const ORDER_OF_TERMS: usize = 16;

/// Reference points of one task.
const CHUNK: usize = 16;

/// Error of single scattering over the relative error of the truncated phase function.
const OF_CUT: f64 = 0.25;

/// Single scattering that a bake stores; `None` where there is none or rays are cast at run time.
pub(crate) fn stored(
    work: &Work,
    order: Option<usize>,
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<Option<SingleFile>> {
    let single = resolved(work.plan.single, work.sampled.scene, work.max_rms);
    let terms = match single {
        Single::Off | Single::Folded | Single::Phase(Terms::Rays | Terms::Auto) => return Ok(None),
        Single::Isotropic => LightTerms::Isotropic,
        Single::Phase(Terms::Stored(terms)) => LightTerms::Harmonics(terms),
    };
    let baked = Baked::new(work, single, terms)?;
    let (scene, receivers) = (work.sampled.scene, &work.sampled.receivers);
    let (file, values) = match work.plan.single_basis {
        Basis::Haar => {
            let rows = baked.rows(progress)?;
            let values = Values::Rows(Rows::new(&rows, work.plan.transform)?);
            (SingleFile { terms: 1, harmonics: None, rows: Some(rows) }, values)
        }
        Basis::Harmonics => {
            let file = baked.harmonics(order.unwrap_or(MOST_ORDER), progress)?;
            let terms = baked.terms();
            let values = Values::Harmonics(components(&file, (tags::SINGLE_SET, terms), scene, receivers)?, terms);
            (SingleFile { terms: terms as u32, harmonics: Some(file), rows: None }, values)
        }
    };
    let lit = LitScene { scene, bvh: &work.sampled.bvh, lights: &[] };
    let probe = Probe::new(lit, receivers, work.plan.integrand);
    progress.start("errors of single scattering", 0);
    let environments = probe.worst(&values, single, &work.unseen.environments)?;
    let suns = probe.worst(&values, single, &work.unseen.suns)?;
    progress.finish();
    let what = match &file.harmonics {
        Some(h) => format!("{} harmonics, {} terms", h.order * h.order, file.terms),
        None => "rows of every vertex".to_owned(),
    };
    let note = format!(
        "{what}, relative to single scattering alone, against rays along the inverse normal; {}",
        under_suns(suns)
    );
    ledger.add("single scattering", environments, note);
    Ok(Some(file))
}

/// Isotropic single scattering that becomes a part of the radiosity.
pub(crate) struct Folded<'a, 'b>(Baked<'a, 'b>);

impl<'a, 'b> Folded<'a, 'b> {
    /// The bake of folded single scattering, if it is asked for.
    pub(crate) fn new(work: &'a Work<'a, 'b>) -> Result<Option<Self>> {
        match work.plan.single {
            Single::Folded => Ok(Some(Self(Baked::new(work, Single::Isotropic, LightTerms::Isotropic)?))),
            Single::Off | Single::Isotropic | Single::Phase(_) => Ok(None),
        }
    }

    /// Adds single scattering of each receiver under some of the suns; `truth` is given for all suns.
    pub(crate) fn add_under_suns(&self, truth: &mut [Vec<DVec3>]) -> Result<()> {
        for (index, sun) in under_some(self.0.work.suns) {
            let single = self.0.under(sun)?;
            let Some(all) = truth.get_mut(index) else { continue };
            all.iter_mut().zip(single).for_each(|(sum, s)| *sum += s);
        }
        Ok(())
    }

    /// Adds single scattering to `[point][channel][harmonic]`, points in ascending order.
    pub(crate) fn add(&self, points: &[u32], order: usize, values: &mut [f32], progress: &dyn Progress) {
        let single = self.0.projected(points, order, progress);
        values.iter_mut().zip(single).for_each(|(sum, s)| *sum += s);
    }

    /// Adds single scattering by reference rays under a light to values at some receivers.
    pub(crate) fn add_rays(&self, light: &Light, points: &[u32], values: &mut [DVec3]) -> Result<()> {
        let sampled = self.0.work.sampled;
        let Integrand { form, crossings } = self.0.work.plan.integrand;
        let settings = Settings { form, crossings, ..Settings::REFERENCE };
        let rays = SingleScattering::new(sampled.scene.domain(), &sampled.bvh, std::slice::from_ref(light), settings)?;
        values.par_iter_mut().zip(points).for_each(|(value, &point)| {
            *value += rays.per_point(&self.0.exits[point as usize], point.into());
        });
        Ok(())
    }
}

/// Some of many suns with their indices.
fn under_some(suns: &[Light]) -> impl Iterator<Item = (usize, &Light)> {
    suns.iter().enumerate().step_by(suns.len().div_ceil(SUNS).max(1))
}

/// Inputs of the vectors of single scattering.
struct Baked<'a, 'b> {
    work: &'a Work<'a, 'b>,
    coefficients: Coefficients,
    exits: Vec<ExitPoint>,
    baker: VectorBaker<'a>,
    /// Allowed error over that of the radiosity.
    own: f64,
}

/// Ratio of all other light to single scattering, of half spaces under constant light, the least of channels and media.
fn darker(scene: &Scene, coefficients: Coefficients) -> f64 {
    let of_medium = |m: &Medium| {
        let eta = m.properties.eta_inside_over_outside;
        let (all, optics) =
            (MediumKernel::new(m).total() * diffuse_transmittance(eta), Optics::new(&m.properties, coefficients));
        let of_channel = |c: usize| {
            let plane = PlaneMedium {
                sigma_s_per_mm: optics.sigma_s_per_mm[c],
                sigma_t_per_mm: optics.sigma_t_per_mm[c],
                eta_inside_over_outside: eta,
                thickness_mm: f64::INFINITY,
            };
            all[c] / plane.albedo(Form::Physical).max(f64::MIN_POSITIVE)
        };
        (0..3).map(of_channel).fold(f64::INFINITY, f64::min)
    };
    scene.media.iter().map(of_medium).fold(f64::INFINITY, f64::min)
}

impl<'a, 'b> Baked<'a, 'b> {
    fn new(work: &'a Work<'a, 'b>, single: Single, phase: LightTerms) -> Result<Self> {
        let coefficients = match single {
            Single::Phase(_) => Coefficients::Unreduced,
            _ => Coefficients::Reduced,
        };
        let side = work.plan.resolution().side() / 2;
        let Integrand { form, crossings } = work.plan.integrand;
        let settings = VectorSettings { side, coefficients, phase, form, crossings, ..VectorSettings::DEFAULT };
        let sampled = work.sampled;
        let baker = VectorBaker::new(sampled.scene.domain(), &sampled.bvh, settings)?;
        let cut = match single {
            Single::Phase(Terms::Stored(terms)) => OF_CUT * missing(largest_g(sampled.scene), terms) / work.max_rms,
            _ => 0.0,
        };
        let own = darker(sampled.scene, coefficients).max(cut).clamp(1.0, MOST_OWN);
        Ok(Self { work, coefficients, exits: exits(sampled.scene, &sampled.receivers), baker, own })
    }

    fn terms(&self) -> usize {
        self.baker.settings().phase.count()
    }

    /// `pi C` of the medium of a point.
    fn factor(&self, point: &ExitPoint) -> f32 {
        let scene = self.work.sampled.scene;
        let medium = scene.parts.parts.get(point.part as usize).and_then(|part| part.medium);
        let properties = medium.and_then(|m| scene.media.get(m as usize)).map(|m| m.properties);
        properties.map_or(0.0, |p| radiosity_factor(p.eta_inside_over_outside) as f32)
    }

    /// Spacing of the reference points, mm.
    fn spacing(&self) -> Result<f64> {
        let Work { sampled, plan, suns, max_rms, .. } = self.work;
        if let Some(asked) = plan.spacing.asked_mm(sampled) {
            return Ok(asked);
        }
        let truth: Vec<Vec<DVec3>> = under_some(suns).map(|(_, sun)| self.under(sun)).collect::<Result<_>>()?;
        Ok(spacing(sampled, &truth, self.work.sun * self.own * SPATIAL * max_rms))
    }

    /// Single scattering of every receiver under a sun, by rays.
    fn under(&self, sun: &Light) -> Result<Vec<DVec3>> {
        let depths = DepthSampling::Deterministic(PLACES);
        let Integrand { form, crossings } = self.work.plan.integrand;
        let settings = Settings { depths, coefficients: self.coefficients, form, crossings, ..Settings::PAPER };
        let (sampled, lights) = (self.work.sampled, std::slice::from_ref(sun));
        Ok(SingleScattering::new(sampled.scene.domain(), &sampled.bvh, lights, settings)?
            .per_points(&self.exits, &Silent))
    }

    /// Single scattering `[point][channel][term][harmonic]` of some receivers.
    fn projected(&self, points: &[u32], order: usize, progress: &dyn Progress) -> Vec<f32> {
        let (terms, texels) = (self.terms(), self.baker.texels());
        let matrix = CubeHarmonics::of_integrals(self.baker.settings().side, order);
        let functions = matrix.functions();
        let size = 3 * terms * functions;
        let mut values = vec![0.0f32; points.len() * size];
        progress.start("single scattering", points.len() as u64);
        values.par_chunks_mut((CHUNK * size).max(1)).zip(points.par_chunks(CHUNK)).for_each(|(out, points)| {
            let own: Vec<ExitPoint> = points.iter().map(|&i| self.exits[i as usize]).collect();
            let mut by_term = vec![0.0f32; size];
            self.baker.range(&own, 0..own.len(), |index, vector| {
                let mut product = Product::new(&matrix);
                vector.chunks_exact(texels).for_each(|row| product.push(row, &mut by_term));
                product.finish(&mut by_term);
                let factor = self.factor(&own[index]);
                let out = &mut out[index * size..(index + 1) * size];
                for (row, values) in by_term.chunks_exact(functions).enumerate() {
                    let (term, channel) = (row / 3, row % 3);
                    let out = &mut out[(channel * terms + term) * functions..][..functions];
                    out.iter_mut().zip(values).for_each(|(out, v)| *out = factor * v);
                }
            });
            progress.advance(points.len() as u64);
        });
        progress.finish();
        values
    }

    fn harmonics(&self, order: usize, progress: &dyn Progress) -> Result<File> {
        let (sampled, terms) = (self.work.sampled, self.terms());
        let order = if terms > 1 { order.min(ORDER_OF_TERMS) } else { order };
        let spacing_mm = self.spacing()?;
        let net = Net::new(&sampled.points, &parts(&sampled.receivers), spacing_mm);
        let directions = order * order;
        let values = in_ascending_order(&net.point, 3 * terms * directions, |ascending| {
            Ok(self.projected(ascending, order, progress))
        })?;
        progress.start("coding", 0);
        let radiosities =
            Radiosities { values: (&values[..]).into(), shells: terms, directions, units: vec![1.0; directions] };
        let error = 2.0 * self.own * CODED * self.work.max_rms;
        let set = code(&radiosities, &net, &Net::unpredicted(directions), tags::SINGLE_SET, error)?;
        progress.finish();
        Ok(File { order: order as u32, spacing_mm, set })
    }

    /// Haar rows of every receiver.
    fn rows(&self, progress: &dyn Progress) -> Result<IrradianceRows> {
        let plan = self.work.plan;
        let importance = match plan.choice {
            Choice::Magnitude => None,
            // One threshold for all is a matter of the rows of the radiosity.
            Choice::Light | Choice::Rate => Some(expected_light(self.baker.settings().side, plan)?),
        };
        let keep = Keep::Largest(plan.row.saturating_sub(FACES));
        let selection = Selection { keep, importance: importance.as_deref() };
        let (side, transform) = (self.baker.settings().side, plan.transform);
        progress.start("single scattering", self.exits.len() as u64);
        let of_chunk = |points: &[ExitPoint]| -> Result<IrradianceRows> {
            let mut writer = RowWriter::new(side, transform)?;
            self.baker.range(points, 0..points.len(), |index, vector| {
                writer.push(vector, self.factor(&points[index]), selection);
            });
            progress.advance(points.len() as u64);
            Ok(writer.finish())
        };
        let chunks: Vec<IrradianceRows> = self.exits.par_chunks(CHUNK).map(of_chunk).collect::<Result<_>>()?;
        progress.finish();
        joined(side, chunks)
    }
}
