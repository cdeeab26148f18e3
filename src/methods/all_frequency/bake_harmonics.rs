//! Transport under spherical harmonics of the light at reference points, coded.

use glam::DVec3;
use translux_format::distant_transport::{Harmonics as File, tags};

use super::bake::{SUN, Work, under_suns};
use super::harmonics::components;
use super::plan::MOST_ORDER;
use crate::compress::ledger::Ledger;
use crate::compress::prediction::Net;
use crate::error::Result;
use crate::light::Light;
use crate::light::harmonics::coefficients;
use crate::math::statistics::{VertexError, vertex_error};
use crate::methods::baked_in::{Stored, relative};
use crate::methods::components::coding::{Radiosities, code};
use crate::methods::references::{in_ascending_order, spacing, spacing_of, spatial_error};
use crate::methods::stage::{GROUP, Stage, parts};
use crate::progress::{Progress, Silent};
use crate::transport::gather::NearField;
use crate::transport::irradiance::Illumination;
use crate::transport::irradiance_rows::texels::TexelBaker;
use crate::transport::many_lights::IrradianceRows;

/// Shares of the asked error.
const SPATIAL: f64 = 0.3;
const CODED: f64 = 0.25;
const ORDER: f64 = 0.65;

/// Orders are compared with so many times fewer samples, but not fewer than these, at some receivers.
const COARSER: usize = 8;
const LEAST_SAMPLES: usize = 1 << 14;
const SOME: usize = 384;

/// The lowest order that is tried.
const FIRST_ORDER: usize = 3;

/// How much more the bands beyond the first count: a sun has half of the energy.
const OTHER_BANDS: f32 = 2.0;

/// Radiosities `[point][channel][harmonic]` of the rows of a net.
struct AtReferences {
    functions: usize,
    values: Vec<f32>,
}

impl AtReferences {
    fn new(work: &Work, points: &[u32], rows: &IrradianceRows, progress: &dyn Progress) -> Result<Self> {
        let values = in_ascending_order(points, 3 * rows.lights, |ascending| {
            let receivers = work.stage.receivers.only(ascending, GROUP);
            let areas = vec![1.0; receivers.len()];
            Ok(work.transfer.towards(&receivers, &areas).radiosity(rows, progress).values)
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
    let (stage, plan) = (work.stage, work.plan);
    let radiosity = work.transfer.radiosity(suns, &Silent);
    let truth: Vec<Vec<DVec3>> = (0..suns.lights).map(|light| radiosity.under(light)).collect();
    let spacing_mm = match (plan.spacing_mm, plan.references) {
        (Some(spacing_mm), _) => spacing_mm,
        (None, Some(count)) => spacing_of(stage, count),
        (None, None) => spacing(stage, &truth, SUN * SPATIAL * work.max_rms),
    };
    let net = Net::new(&stage.points, &parts(&stage.receivers), spacing_mm);
    let surface = stage.surface();
    let baker = TexelBaker::new(&surface, plan.resolution);
    let order = match plan.order {
        Some(order) => order,
        None => needed(work, progress)?,
    };
    let rows = baker.harmonics(order, progress);
    let values = AtReferences::new(work, &net.point, &rows, progress)?;
    progress.start("coding", 0);
    let mut units = vec![OTHER_BANDS; order * order];
    units[0] = 1.0;
    let radiosities = Radiosities { values: (&values.values[..]).into(), shells: 1, directions: order * order, units };
    let set = code(&radiosities, &net, &Net::unpredicted(order * order), tags::SET, 2.0 * CODED * work.max_rms)?;
    let file = File { order: order as u32, spacing_mm, set };
    progress.finish();
    measure(work, (&net, &values, &file), ledger, progress)?;
    Ok(file)
}

/// The lowest order whose error under suns is allowed, at some receivers and on a coarser set of samples.
fn needed(work: &Work, progress: &dyn Progress) -> Result<usize> {
    let (scene, count) = (work.stage.scene, work.stage.samples.len().div_ceil(COARSER));
    let coarse = Stage::new(scene, count.max(LEAST_SAMPLES));
    coarse.with_transfer(NearField::for_error(work.max_rms), |transfer| {
        let (some, indices) = coarse.receivers.subset(SOME, 0);
        let areas: Vec<f64> = indices.iter().map(|&i| coarse.areas[i as usize]).collect();
        let transfer = transfer.towards(&some, &areas);
        let truth = transfer.radiosity(&coarse.irradiance(work.suns)?, &Silent);
        let surface = coarse.surface();
        let baker = TexelBaker::new(&surface, work.plan.resolution);
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
    work: &Work,
    (net, values, file): (&Net, &AtReferences, &File),
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let (stage, unseen) = (work.stage, &work.unseen);
    let surface = stage.surface();
    let etas: Vec<f64> = stage.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    let areas: Vec<f64> = net.point.iter().map(|&i| stage.areas[i as usize]).collect();
    let stored = components(file, (tags::SET, 1), stage.scene, &stage.receivers)?;
    let mut order: Vec<u32> = (0..net.point.len() as u32).collect();
    order.sort_unstable_by_key(|&row| net.point[row as usize]);
    let (mut errors, mut suns) = ([VertexError::default(); 3], VertexError::default());
    progress.start("errors", (unseen.environments.len() + unseen.suns.len()) as u64);
    for (index, light) in unseen.environments.iter().chain(&unseen.suns).enumerate() {
        let one = std::slice::from_ref(light);
        let rays = Illumination::new(&surface, one, &etas, stage.sampling)?.all(&Silent);
        let truth = work.transfer.under(&rays);
        let at_net: Vec<DVec3> = net.point.iter().map(|&i| truth[i as usize]).collect();
        let exact = values.under(light, file.order as usize)?;
        let sorted = stored.transport.at_references(&stored.light(one)?);
        let mut coded = vec![DVec3::ZERO; sorted.len()];
        order.iter().zip(sorted).for_each(|(&row, value)| coded[row as usize] = value);
        if index < unseen.environments.len() {
            let found = [
                vertex_error(&exact, &at_net, &areas),
                spatial_error(stage, net, file.spacing_mm, std::slice::from_ref(&truth)),
                vertex_error(&coded, &exact, &areas),
            ];
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
    ledger.add("reference points", errors[1], format!("interpolation from {} of them, as above", net.point.len()));
    ledger.add("coding", errors[2], format!("basis and quantiser, as above; all of it {}", under_suns(suns)));
    Ok(())
}
