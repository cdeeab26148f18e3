//! Transport under spherical harmonics of the light at reference points, coded.

use glam::DVec3;
use translux_format::distant_transport::{Harmonics as File, tags};
use translux_format::quantised_lights::Set;

use super::evaluate::components;
use super::returned::{Returned, radiosity};
use crate::compress::ledger::Ledger;
use crate::compress::prediction::Net;
use crate::error::Result;
use crate::forms::baked_in::{Stored, relative};
use crate::forms::distant::{MOST_ORDER, SUN, Work, under_suns};
use crate::forms::projected::coding::{Radiosities, code};
use crate::forms::projected::references::{in_ascending_order, spacing, spatial_error};
use crate::forms::sampled_scene::{GROUP, SampledScene, parts};
use crate::forms::single_scattering::Folded;
use crate::light::Light;
use crate::light::harmonics::coefficients;
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::{Progress, Silent};
use crate::transport::irradiance::Illumination;
use crate::transport::irradiance_rows::texels::TexelBaker;
use crate::transport::many_lights::IrradianceRows;
use crate::transport::near_rule::NearField;

/// Shares of the asked error.
const SPATIAL: f64 = 0.44;
const CODED: f64 = 0.15;
const ORDER: f64 = 0.65;

/// Orders are compared with so many times fewer samples, but not fewer than these, at some receivers.
const COARSER: usize = 8;
const LEAST_SAMPLES: usize = 1 << 14;
const SOME: usize = 384;

/// Vertices that errors are measured at where single scattering is traced for them.
const MOST_TRACED: usize = 256;

/// The lowest order that is tried.
const FIRST_ORDER: usize = 3;

/// How much more the bands beyond the first count: a sun has half of the energy.
const OTHER_BANDS: f32 = 2.0;

/// Light that is not radiosity under the lights alone, but becomes part of it.
#[derive(Clone, Copy)]
struct Beside<'a> {
    folded: Option<&'a Folded<'a, 'a>>,
    returned: Option<&'a Returned>,
}

/// Radiosities `[point][channel][harmonic]` of the rows of a net.
struct AtReferences {
    functions: usize,
    values: Vec<f32>,
}

impl AtReferences {
    fn new(
        (work, beside): (&Work, Beside),
        points: &[u32],
        rows: &IrradianceRows,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let values = in_ascending_order(points, 3 * rows.lights, |ascending| {
            let receivers = work.sampled.receivers.only(ascending, GROUP);
            let areas = vec![1.0; receivers.len()];
            let mut values = work.transfer.towards(&receivers, &areas).radiosity(rows, progress).values;
            if let Some(returned) = beside.returned {
                returned.add(work, rows, ascending, &mut values, progress);
            }
            if let Some(folded) = beside.folded {
                folded.add(ascending, rows.lights.isqrt(), &mut values, progress);
            }
            Ok(values)
        })?;
        Ok(Self { functions: rows.lights, values })
    }

    /// Radiosity at the points under a light, from the first `order^2` harmonics.
    fn under(&self, light: &Light, order: usize) -> Result<Vec<DVec3>> {
        let vector = coefficients(light, order)?;
        let of_point = |row: &[f32]| {
            let sum = |c: usize| -> f64 {
                row[c * self.functions..].iter().zip(&vector).map(|(v, w)| f64::from(*v) * w[c]).sum()
            };
            DVec3::new(sum(0), sum(1), sum(2)).max(DVec3::ZERO)
        };
        Ok(self.values.chunks_exact((3 * self.functions).max(1)).map(of_point).collect())
    }
}

pub(super) fn harmonics(
    work: &Work,
    suns: &IrradianceRows,
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<File> {
    let (sampled, plan) = (work.sampled, work.plan);
    let folded = Folded::new(work)?;
    let spacing_mm = match plan.asked_spacing_mm(sampled) {
        Some(asked) => asked,
        None => {
            let under_suns = work.transfer.radiosity(suns, &Silent);
            let mut truth: Vec<Vec<DVec3>> = (0..suns.lights).map(|light| under_suns.under(light)).collect();
            folded.as_ref().map_or(Ok(()), |folded| folded.add_under_suns(&mut truth))?;
            spacing(sampled, &truth, SUN * SPATIAL * work.max_rms)
        }
    };
    let net = Net::new(&sampled.points, &parts(&sampled.receivers), spacing_mm);
    let returned = Returned::new(work, progress);
    let beside = Beside { folded: folded.as_ref(), returned: returned.as_ref() };
    let (order, values) = at_points((work, beside), &net.point, progress)?;
    progress.start("coding", 0);
    let set = coded(&values.values, order, &net, coding_error(work.max_rms))?;
    let file = File { order: order as u32, spacing_mm, set };
    progress.finish();
    measure((work, beside), (&net, &values, &file), ledger, progress)?;
    Ok(file)
}

/// Radiosities of every receiver, and the order of the harmonics that they are under.
pub(super) fn everywhere(work: &Work, progress: &dyn Progress) -> Result<(usize, Vec<f32>)> {
    let folded = Folded::new(work)?;
    let returned = Returned::new(work, progress);
    let beside = Beside { folded: folded.as_ref(), returned: returned.as_ref() };
    let points: Vec<u32> = (0..work.sampled.points.len() as u32).collect();
    let (order, values) = at_points((work, beside), &points, progress)?;
    Ok((order, values.values))
}

/// Radiosities of some points, and the order of the harmonics that they are under.
fn at_points(
    (work, beside): (&Work, Beside),
    points: &[u32],
    progress: &dyn Progress,
) -> Result<(usize, AtReferences)> {
    let order = match work.plan.order {
        Some(order) => order,
        None => needed(work, progress)?,
    };
    let surface = work.sampled.surface();
    let rows = TexelBaker::new(&surface, work.plan.resolution()).harmonics(order, progress);
    Ok((order, AtReferences::new((work, beside), points, &rows, progress)?))
}

/// The error that coding may have.
pub(super) fn coding_error(max_rms: f64) -> f64 {
    2.0 * CODED * max_rms
}

/// Codes radiosities in the order of the rows of `net`, so that their error is `error` times their RMS.
pub(super) fn coded(values: &[f32], order: usize, net: &Net, error: f64) -> Result<Set> {
    let mut units = vec![OTHER_BANDS; order * order];
    units[0] = 1.0;
    let radiosities = Radiosities { values: values.into(), shells: 1, directions: order * order, units };
    code(&radiosities, net, &Net::unpredicted(order * order), tags::SET, error)
}

/// The lowest order whose error under suns is allowed, at some receivers and on a coarser set of samples.
fn needed(work: &Work, progress: &dyn Progress) -> Result<usize> {
    let (scene, count) = (work.sampled.scene, work.sampled.samples.len().div_ceil(COARSER));
    let coarse = SampledScene::new(scene, count.max(LEAST_SAMPLES));
    coarse.with_transfer(NearField::for_error(work.max_rms), |transfer| {
        let (some, indices) = coarse.receivers.subset(SOME, 0);
        let areas: Vec<f64> = indices.iter().map(|&i| coarse.areas[i as usize]).collect();
        let transfer = transfer.towards(&some, &areas);
        let truth = transfer.radiosity(&coarse.irradiance(work.suns)?, &Silent);
        let surface = coarse.surface();
        let baker = TexelBaker::new(&surface, work.plan.resolution());
        let rows = transfer.radiosity(&baker.harmonics(MOST_ORDER, progress), &Silent);
        let values = AtReferences { functions: rows.lights, values: rows.values };
        for order in FIRST_ORDER..MOST_ORDER {
            let mut worst = 0.0f64;
            for (index, light) in work.suns.iter().enumerate() {
                let error = vertex_error(&values.under(light, order)?, &truth.under(index), &areas);
                worst = worst.max(relative(error).rms);
            }
            if worst <= SUN * ORDER * work.max_rms {
                return Ok(order);
            }
        }
        Ok(MOST_ORDER)
    })
}

/// Enters what each stage loses under lights that no choice saw.
fn measure(
    (work, beside): (&Work, Beside),
    (net, values, file): (&Net, &AtReferences, &File),
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let (sampled, unseen, folded) = (work.sampled, &work.unseen, beside.folded);
    let surface = sampled.surface();
    let etas: Vec<f64> = sampled.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    // Rays of single scattering take their time.
    let most = if folded.is_some() { MOST_TRACED } else { usize::MAX };
    let chosen: Vec<usize> = (0..net.point.len()).step_by(net.point.len().div_ceil(most).max(1)).collect();
    let points: Vec<u32> = chosen.iter().map(|&row| net.point[row]).collect();
    let areas: Vec<f64> = points.iter().map(|&i| sampled.areas[i as usize]).collect();
    let some = Some(sampled.receivers.subset(MOST_TRACED, 1).1).filter(|_| folded.is_some()).unwrap_or_default();
    let stored = components(file, (tags::SET, 1), sampled.scene, &sampled.receivers)?;
    let mut order: Vec<u32> = (0..net.point.len() as u32).collect();
    order.sort_unstable_by_key(|&row| net.point[row as usize]);
    let (mut errors, mut suns) = ([VertexError::default(); 3], VertexError::default());
    progress.start("errors", (unseen.environments.len() + unseen.suns.len()) as u64);
    for (index, light) in unseen.environments.iter().chain(&unseen.suns).enumerate() {
        let one = std::slice::from_ref(light);
        let rays = Illumination::new(&surface, one, &etas, sampled.sampling)?.all(&Silent);
        let truth = radiosity(work, beside.returned, &rays);
        let with_single = |points: &[u32]| -> Result<Vec<DVec3>> {
            let mut values = points.iter().map(|&i| truth[i as usize]).collect::<Vec<_>>();
            folded.map_or(Ok(()), |folded| folded.add_rays(light, points, &mut values))?;
            Ok(values)
        };
        let at_net = with_single(&points)?;
        let all = values.under(light, file.order as usize)?;
        let exact: Vec<DVec3> = chosen.iter().map(|&row| all[row]).collect();
        let lit = stored.light(one)?;
        let sorted = stored.transport.at_references(&lit);
        let mut by_row = vec![DVec3::ZERO; sorted.len()];
        order.iter().zip(sorted).for_each(|(&row, value)| by_row[row as usize] = value);
        let coded: Vec<DVec3> = chosen.iter().map(|&row| by_row[row]).collect();
        if index < unseen.environments.len() {
            let spatial = match folded {
                None => spatial_error(sampled, net, file.spacing_mm, std::slice::from_ref(&truth)),
                Some(_) => {
                    let parts = stored.transport.of_parts(&lit);
                    let value = |&i: &u32| {
                        let [r, g, b, _] =
                            parts.first().and_then(|part| part.get(i as usize)).copied().unwrap_or_default();
                        DVec3::new(r.into(), g.into(), b.into()).max(DVec3::ZERO) * lit.scale
                    };
                    let areas: Vec<f64> = some.iter().map(|&i| sampled.areas[i as usize]).collect();
                    vertex_error(&some.iter().map(value).collect::<Vec<_>>(), &with_single(&some)?, &areas)
                }
            };
            let found = [vertex_error(&exact, &at_net, &areas), spatial, vertex_error(&coded, &exact, &areas)];
            errors.iter_mut().zip(found).for_each(|(worst, found)| *worst = worst.max(relative(found)));
        } else {
            suns = suns.max(relative(vertex_error(&coded, &at_net, &areas)));
        }
        progress.advance(1);
    }
    progress.finish();
    let order = file.order;
    ledger.add(
        "harmonics",
        errors[0],
        format!("{} of order {order}, under environments that no choice saw, against rays", order * order),
    );
    let what = if folded.is_some() { "all of it on vertices between" } else { "interpolation from" };
    ledger.add("reference points", errors[1], format!("{what} {} of them, as above", net.point.len()));
    ledger.add("coding", errors[2], format!("basis and quantiser, as above; all of it {}", under_suns(suns)));
    Ok(())
}
