//! Transport under spherical harmonics of the light at reference points, coded.

use std::ops::Range;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use translux_format::distant_transport::{Harmonics as File, tags};
use translux_format::quantised_lights::Set;

use super::evaluate::components;
use super::moved::{irradiance, moves};
use super::returned::{Returned, radiosity};
use crate::compress::ledger::Ledger;
use crate::compress::prediction::Net;
use crate::error::{Error, Result};
use crate::evaluate::BakeSettings;
use crate::evaluate::stage_cache::Key;
use crate::evaluate::stages::worst;
use crate::forms::baked_in::Stored;
use crate::forms::distant::{Distant, MOST_ORDER, Work, under_suns, with_work};
use crate::forms::projected::coding::{Radiosities, code};
use crate::forms::projected::components::Lit;
use crate::forms::projected::reach::allowed;
use crate::forms::projected::references::{in_ascending_order, in_order_of_rows, spacing, spatial_error, under};
use crate::forms::sampled_scene::{GROUP, SampledScene, parts};
use crate::forms::single_scattering::Folded;
use crate::forms::truths::Truths;
use crate::light::Light;
use crate::light::harmonics::coefficients;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::many_lights::IrradianceRows;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{ProbePoints, Receivers};

/// Shares of the asked error.
const SPATIAL: f64 = 0.44;
const CODED: f64 = 0.15;
const ORDER: f64 = 0.65;

/// Orders are compared on a set of samples coarser by this factor but with no fewer than the least, where the bake has these, at some
/// receivers.
const COARSER: usize = 8;
const LEAST_SAMPLES: usize = 1 << 14;

/// Triangles up to which each has a sample there too, where it has in the bake: clusters that go over sharp edges err under suns as no order
/// of harmonics could mend (8 % on a cube of 24,576 triangles, whose own samples are 0.3 % off).
const OWN_SAMPLES: usize = 1 << 15;
const SOME: usize = 384;

/// Orders up to which harmonics of moved light are tried, one after another: each takes as many directions as it has harmonics, several times.
const TRIED: [usize; 3] = [8, 16, MOST_ORDER];

/// Name of the stage of the harmonics.
const STAGE: &str = "harmonics";

/// Vertices that errors are measured at where single scattering is traced for them.
const MOST_TRACED: usize = 256;

/// The lowest order that is tried.
const FIRST_ORDER: usize = 3;

/// Weight of the bands beyond the first: a sun has half of the energy.
const OTHER_BANDS: f32 = 2.0;

/// Single scattering and inter-reflection that become part of the radiosity.
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
    /// Radiosities under the harmonics of an order; `truths` are computed ahead where several processes share the bake.
    fn new(
        (work, beside): (&Work, Beside),
        (points, order): (&[u32], usize),
        truths: Option<&Truths>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let functions = order * order;
        let chosen = |key: &mut Key| {
            work.tell(key);
            key.number(order as u64).rows(points);
        };
        let values = in_ascending_order(points, 3 * functions, |ascending| {
            let chunks = chunks(&work.sampled.receivers, ascending);
            let blocks = work.cache.blocks("transfer", chunks.len(), chosen);
            let needs_rows = blocks.are_computed() || beside.returned.is_some();
            let rows = match needs_rows {
                true => work.cache.common("irradiance of harmonics", chosen, || {
                    irradiance(work.sampled, (work.plan.resolution(), order), progress)
                })?,
                false => IrradianceRows::default(),
            };
            if let Some(truths) = truths {
                truths.ahead(progress)?;
                let shared = work.transfer.shared(&rows);
                blocks.ahead(progress, |chunk| {
                    let receivers = work.sampled.receivers.only(&ascending[chunks[chunk].clone()], GROUP);
                    let areas = vec![1.0; receivers.len()];
                    Ok(work.transfer.towards(&receivers, &areas).radiosity_of(&rows, &shared, &Silent).values)
                })?;
                work.cache.gather()?;
            }
            let mut values = Vec::with_capacity(ascending.len() * 3 * functions);
            if blocks.are_computed() {
                let receivers = work.sampled.receivers.only(ascending, GROUP);
                let areas = vec![1.0; receivers.len()];
                values = work.transfer.towards(&receivers, &areas).radiosity(&rows, progress).values;
            } else {
                for (index, chunk) in chunks.iter().enumerate() {
                    let gone = || Err::<Vec<f32>, _>(Error::runtime("a block is gone that was there"));
                    values.extend(blocks.rows((index, 3 * functions * chunk.len()), gone)?);
                }
            }
            if let Some(returned) = beside.returned {
                returned.add(work, &rows, ascending, &mut values, progress);
            }
            if let Some(folded) = beside.folded {
                folded.add(ascending, order, &mut values, progress);
            }
            Ok(values)
        })?;
        Ok(Self { functions, values })
    }

    /// Radiosity at the points under a light, from the first `order^2` harmonics.
    fn under(&self, light: &Light, order: usize) -> Result<Vec<DVec3>> {
        Ok(under(&self.values, self.functions, &coefficients(light, order)?))
    }
}

/// Blocks that receivers are cut into at most, which are computed one after another.
const BLOCKS: usize = 64;

/// Some ascending receivers in runs of whole groups.
fn chunks(receivers: &Receivers, ascending: &[u32]) -> Vec<Range<usize>> {
    let each = ascending.len().div_ceil(BLOCKS).next_multiple_of(GROUP).max(GROUP);
    let of_part = |part: Range<usize>| {
        let [first, end] = [part.start, part.end].map(|bound| ascending.partition_point(|&i| (i as usize) < bound));
        (first..end).step_by(each).map(move |start| start..end.min(start + each))
    };
    parts(receivers).into_iter().flat_map(of_part).collect()
}

pub(super) fn harmonics(
    work: &Work,
    suns: &IrradianceRows,
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<File> {
    let (sampled, plan) = (work.sampled, work.plan);
    let folded = Folded::new(work)?;
    let tell = |key: &mut Key| work.tell(key);
    let Needed { order, reached } = work.cache.common("order", tell, || needed(work, progress))?;
    // What the harmonics cannot reach is not worth the bytes of the other stages.
    let allowed = allowed(work.max_rms, reached);
    let spacing_mm = match plan.spacing.asked_mm(sampled) {
        Some(asked) => asked,
        None => work.cache.common("spacing", tell, || {
            let under_suns = work.transfer.radiosity(suns, &Silent);
            let mut truth: Vec<Vec<DVec3>> = (0..suns.lights).map(|light| under_suns.under(light)).collect();
            folded.as_ref().map_or(Ok(()), |folded| folded.add_under_suns(&mut truth))?;
            Ok(spacing(sampled, &truth, work.sun * SPATIAL * allowed))
        })?,
    };
    let net = Net::new(&sampled.points, &parts(&sampled.receivers), spacing_mm);
    let returned = Returned::new(work, progress);
    let beside = Beside { folded: folded.as_ref(), returned: returned.as_ref() };
    let truth = |light: &Light| Ok(radiosity(work, returned.as_ref(), &sampled.by_rays(light)?));
    let truths = Truths::new(work.judges(), (&truth, sampled.receivers.len()), work.cache, tell);
    let values = AtReferences::new((work, beside), (&net.point, order), Some(&truths), progress)?;
    progress.start("coding", 0);
    let set = coded(&values.values, order, &net, coding_error(allowed))?;
    let file = File { order: order as u32, spacing_mm, set };
    progress.finish();
    measure((work, beside, &truths), (&net, &values, &file), ledger, progress)?;
    if let Some(entry) = ledger.entries.iter_mut().find(|entry| entry.stage == STAGE && reached > work.max_rms) {
        let least = 100.0 * reached;
        entry.note.push_str(&format!(
            "; the highest order, which reaches about {least:.2} %, and the other stages are no finer than is worth it beside that"
        ));
    }
    Ok(file)
}

/// Coefficients that a bake with these settings would code, at every receiver of a scene: the order n of the harmonics
/// and radiosities `[receiver][channel][harmonic]`.
///
/// # Errors
/// Errors of a bake.
pub fn everywhere(
    scene: &Scene,
    distant: &Distant,
    settings: &BakeSettings,
    progress: &dyn Progress,
) -> Result<(usize, Vec<f32>)> {
    with_work((scene, settings, distant), progress, |work, _, _| {
        let folded = Folded::new(work)?;
        let returned = Returned::new(work, progress);
        let beside = Beside { folded: folded.as_ref(), returned: returned.as_ref() };
        let points: Vec<u32> = (0..work.sampled.points.len() as u32).collect();
        let order = needed(work, progress)?.order;
        let values = AtReferences::new((work, beside), (&points, order), None, progress)?;
        Ok((order, values.values))
    })
}

/// Error allowed for coding in a bake at an asked error of `max_rms`: RMS over that of the rows, in units of channels
/// and harmonics.
pub fn coding_error(max_rms: f64) -> f64 {
    2.0 * CODED * max_rms
}

/// Codes radiosities in the order of the rows of `net`, so that their error is `error` times their RMS.
///
/// # Errors
/// Numbers that have no principal components, or more than a format holds.
pub fn coded(values: &[f32], order: usize, net: &Net, error: f64) -> Result<Set> {
    let mut units = vec![OTHER_BANDS; order * order];
    units[0] = 1.0;
    let radiosities = Radiosities { values: values.into(), shells: 1, directions: order * order, units };
    code(&radiosities, net, &Net::unpredicted(order * order), tags::SET, error)
}

/// An order of the harmonics, and what it reaches.
#[derive(Serialize, Deserialize)]
struct Needed {
    order: usize,
    /// Smallest error that a bake of this order could be asked for, as far as it was looked at.
    reached: f64,
}

/// The order that is asked for, or the lowest whose error under suns is small enough, at some receivers and on a coarser set of samples.
fn needed(work: &Work, progress: &dyn Progress) -> Result<Needed> {
    if let Some(order) = work.plan.order {
        return Ok(Needed { order, reached: 0.0 });
    }
    let (scene, own) = (work.sampled.scene, work.sampled.samples.len());
    let triangles = scene.mesh.triangles.len();
    let each = if triangles <= OWN_SAMPLES { triangles } else { 0 };
    let count = own.div_ceil(COARSER).max(LEAST_SAMPLES.max(each).min(own));
    let coarse = SampledScene::new(scene, count).with_model_of(work.sampled);
    coarse.with_transfer(NearField::for_error(work.max_rms), |transfer| {
        let (some, points) = coarse.receivers.probe_points(&coarse.areas, (SOME, 0));
        let transfer = transfer.towards(&some, &points.areas_mm2);
        let truth = transfer.radiosity(&coarse.irradiance(work.suns)?, &Silent);
        // What does not move takes one look at the surroundings, whatever the order.
        let tried = if moves(&coarse) { &TRIED[..] } else { &TRIED[TRIED.len() - 1..] };
        let (mut first, mut reached) = (FIRST_ORDER, 0.0);
        for &most in tried {
            let rows = irradiance(&coarse, (work.plan.resolution(), most), progress)?;
            let rows = transfer.radiosity(&rows, &Silent);
            let values = AtReferences { functions: rows.lights, values: rows.values };
            for order in first..=most {
                let [error] = worst(work.suns.iter().enumerate(), |(index, light)| {
                    Ok([points.error(&values.under(light, order)?, &truth.under(index))])
                })?;
                reached = error.rms / (work.sun * ORDER);
                if reached <= work.max_rms {
                    return Ok(Needed { order, reached });
                }
            }
            first = most + 1;
        }
        Ok(Needed { order: MOST_ORDER, reached })
    })
}

/// Radiosity before and after each stage under a light.
struct UnderLight<'a> {
    light: &'a Light,
    /// Radiosity of every receiver, without single scattering.
    truth: Vec<DVec3>,
    lit: Lit,
    /// Radiosity at some rows of the net: the truth, from all harmonics, from the stored coefficients.
    at_net: Vec<DVec3>,
    exact: Vec<DVec3>,
    coded: Vec<DVec3>,
}

/// Enters the error of each stage under lights that no choice saw.
fn measure(
    (work, beside, truths): (&Work, Beside, &Truths),
    (net, values, file): (&Net, &AtReferences, &File),
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let (sampled, folded) = (work.sampled, beside.folded);
    work.enter_sampling(ledger, progress)?;
    // Rays of single scattering take their time.
    let most = if folded.is_some() { MOST_TRACED } else { usize::MAX };
    let chosen: Vec<usize> = (0..net.point.len()).step_by(net.point.len().div_ceil(most).max(1)).collect();
    let of_rows = |all: &[DVec3]| chosen.iter().map(|&row| all[row]).collect::<Vec<DVec3>>();
    let points = sampled.probes(chosen.iter().map(|&row| net.point[row]).collect());
    let between = folded.map(|_| sampled.probes(sampled.receivers.subset(MOST_TRACED, 1).1));
    let stored = components(file, (tags::SET, 1), sampled.scene, &sampled.receivers)?;
    let with_single = |light: &Light, points: &ProbePoints, truth: &[DVec3]| -> Result<Vec<DVec3>> {
        let mut values = points.of(truth);
        folded.map_or(Ok(()), |folded| folded.add_rays(light, &points.indices, &mut values))?;
        Ok(values)
    };
    let values = |index, light| {
        let truth = truths.under(index)?;
        let at_net = with_single(light, &points, &truth)?;
        let exact = of_rows(&values.under(light, file.order as usize)?);
        let lit = stored.light(std::slice::from_ref(light))?;
        let coded = of_rows(&in_order_of_rows(net, &stored.transport.at_references(&lit)));
        Ok(UnderLight { light, truth, lit, at_net, exact, coded })
    };
    let by_stage = |under: &UnderLight| {
        let UnderLight { light, truth, lit, at_net, exact, coded } = under;
        let spatial = match &between {
            None => spatial_error(sampled, net, file.spacing_mm, std::slice::from_ref(truth)),
            Some(between) => {
                let parts = stored.transport.of_parts(lit);
                let value =
                    |&[r, g, b, _]: &[f32; 4]| DVec3::new(r.into(), g.into(), b.into()).max(DVec3::ZERO) * lit.scale;
                let all = parts.first().map_or(&[] as &[[f32; 4]], Vec::as_slice);
                let found: Vec<DVec3> = between.of(all).iter().map(value).collect();
                between.error(&found, &with_single(light, between, truth)?)
            }
        };
        Ok([points.error(exact, at_net), spatial, points.error(coded, exact)])
    };
    let (errors, suns) = work.errors(progress, values, by_stage, |u| points.error(&u.coded, &u.at_net))?;
    let order = file.order;
    let under = work.judged_by();
    let note = format!("{} of order {order}, under {under} that no choice saw, against rays", order * order);
    ledger.add(STAGE, errors[0], note);
    let what = if folded.is_some() { "all of it on vertices between" } else { "interpolation from" };
    ledger.add("reference points", errors[1], format!("{what} {} of them, as above", net.point.len()));
    ledger.add("coding", errors[2], format!("basis and quantiser, as above; all of it {}", under_suns(suns)));
    work.enter_sun(ledger, suns);
    Ok(())
}
