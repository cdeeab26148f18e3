//! What each step of the coding saves: bytes against error of every vertex's row by itself, entropy-coded, over principal components,
//! predicted, at reference points alone, and in clusters.

mod clusters;
mod curves;
mod study;
mod uncoded;

use glam::DVec3;
use rayon::prelude::*;
use translux::compress::prediction::Net;
use translux::error::{Error, Result};
use translux::forms::projected::harmonics::coding_error;
use translux::progress::Silent;
use translux_format::distant_transport::DistantTransport;

use self::clusters::{Clustered, Rows, Shape, alone, packed, squared_error, with_differences};
use self::curves::{
    BAKED, CLOSER, CLUSTERS, COARSER, COMPONENTS, Curves, DEFAULT, ENTROPY, FIXED, FIXED_COMPONENTS, Measured,
    PREDICTED, REFERENCE_CLUSTERS, REFERENCES, alone_name,
};
use self::study::{Coded, EVERY_VERTEX, Exact, Numbers, Study, failed};
use crate::bench::{DEFAULT_RMS, bake, compared, open, percent, under};
use crate::common::bench::{Context, Recipe, bytes_per_vertex};

/// Errors that assets are asked for, the default first, on which clusters are chosen; all have the same harmonics.
const ASKED: [f64; 3] = [DEFAULT_RMS, 0.02, 0.04];

/// Steps that are tried for a squared error, and how near it is enough.
const TRIALS: usize = 12;
const NEAR: f64 = 0.02;

/// Clusters with differences that are tried at the default error; the one of fewest bytes is taken for all errors.
const MEMBERS: [usize; 3] = [8, 24, 72];
const DIRECTIONS: [usize; 3] = [0, 1, 4];

/// Distance of reference points over that of the default where the step is coarser.
const CLOSER_SPACING: f64 = 0.7;

/// Clusters alone: curves over their members, one for each number of directions.
const ALONE_MEMBERS: [usize; 3] = [256, 64, 16];
const ALONE_DIRECTIONS: [usize; 2] = [1, 4];

/// Squared error that a bake allows its rows.
fn budget(values: &[f32], error: f64) -> f64 {
    values
        .par_chunks(1 << 16)
        .map(|v| v.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>())
        .collect::<Vec<_>>()
        .iter()
        .sum::<f64>()
        * error
        * error
}

/// Digits, and what a reader makes of them, with one step whose squared error is an amount.
fn digits(net: &Net, values: &[f32], columns: usize, amount: f64) -> (Vec<i16>, Vec<f32>) {
    let with = |step: f64| {
        let found = net.quantise(values, &vec![step as f32; columns]);
        let chunks = values.par_chunks(1 << 16).zip(found.1.par_chunks(1 << 16));
        let error = chunks.map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>());
        (error.collect::<Vec<f64>>().iter().sum::<f64>(), found)
    };
    let mut step = (12.0 * amount / values.len().max(1) as f64).sqrt();
    let mut found = with(step);
    for _ in 0..TRIALS {
        if (found.0 / amount - 1.0).abs() <= NEAR {
            break;
        }
        let factor = (amount / found.0.max(f64::MIN_POSITIVE)).sqrt();
        step *= if factor > 1.0 { factor.powf(1.3).min(4.0) } else { factor };
        found = with(step);
    }
    found.1
}

/// Bytes of digits that have as many bits as the widest of their column, with a byte for each column that says so.
fn fixed_width(digits: &[i16], columns: usize) -> usize {
    let mut ranges = vec![(0i16, 0i16); columns];
    for row in digits.chunks_exact(columns) {
        ranges.iter_mut().zip(row).for_each(|(range, v)| *range = (range.0.min(*v), range.1.max(*v)));
    }
    let bits = |&(low, high): &(i16, i16)| (i32::from(high) - i32::from(low) + 1) as u32;
    let bits: u32 = ranges.iter().map(|range| bits(range).next_power_of_two().ilog2()).sum();
    (digits.len() / columns * bits as usize).div_ceil(8) + columns
}

/// Forms of every vertex's row.
fn every_vertex(
    context: &Context,
    (study, exact): (&Study, &Exact),
    max_rms: f64,
    shape: &mut Option<Shape>,
    curves: &mut Curves,
) -> Result<()> {
    let what = format!("{} asked", percent(max_rms));
    let net = &study.every;
    let coded = study.coded(net, EVERY_VERTEX, max_rms)?;
    let columns = coded.set.columns.len();
    let numbers = Numbers { net, spacing_mm: EVERY_VERTEX, values: &coded.known, form: &coded.form };
    let found = study.measured((coded.light_bytes + coded.set.coefficients.len()) as f64, numbers)?;
    let fixed = (coded.light_bytes + fixed_width(&coded.digits, columns)) as f64 / study.vertices();
    {
        let (values, form) = study.plain(&coded.set);
        let columns = 3 * coded.set.units.len();
        let (digits, known) = digits(net, &values, columns, budget(&values, coding_error(max_rms)));
        let numbers = Numbers { values: &known, form: &form, ..numbers };
        let entropy = packed(net.point.len(), columns, &digits, None)?;
        // Units and steps.
        let beside = 4 * coded.set.units.len();
        let plain = study.measured((beside + entropy) as f64, numbers)?;
        let bytes = (beside + fixed_width(&digits, columns)) as f64 / study.vertices();
        curves.add(context, FIXED, &what, Measured { bytes, ..plain });
        curves.add(context, ENTROPY, &what, plain);
    }
    curves.add(context, FIXED_COMPONENTS, &what, Measured { bytes: fixed, ..found });
    curves.add(context, COMPONENTS, &what, found);
    let bytes = clustered(context, study, (&coded, exact, numbers), shape)?;
    curves.add(context, CLUSTERS, &what, bytes);
    let coded = study.coded(&study.predicted, EVERY_VERTEX, max_rms)?;
    let numbers = Numbers { net: &study.predicted, spacing_mm: EVERY_VERTEX, values: &coded.known, form: &coded.form };
    let found = study.measured((coded.light_bytes + coded.set.coefficients.len()) as f64, numbers)?;
    curves.add(context, PREDICTED, &what, found);
    Ok(())
}

/// Clusters with differences, of the shape that takes the fewest bytes where none is given.
fn clustered(
    context: &Context,
    study: &Study,
    (coded, exact, numbers): (&Coded, &Exact, Numbers),
    shape: &mut Option<Shape>,
) -> Result<Measured> {
    let places: Vec<DVec3> = numbers.net.point.iter().map(|&p| study.uncoded.points[p as usize].at_mm).collect();
    let values = exact.of(&coded.set);
    let rows = Rows { values: &values, columns: coded.set.columns.len(), places: &places };
    let amount = squared_error(&values, &coded.known);
    if shape.is_none() {
        let mut best: Option<(usize, Shape)> = None;
        for members in context.some(&MEMBERS, 2) {
            for directions in DIRECTIONS {
                let tried = Shape { members, directions };
                let Clustered { bytes, .. } = with_differences(&rows, tried, coded.set.step, amount)?;
                context.say(&format!("coding: {tried:?}: {:.2} bytes", bytes as f64 / study.vertices()));
                if best.is_none_or(|best| bytes < best.0) {
                    best = Some((bytes, tried));
                }
            }
        }
        *shape = best.map(|best| best.1);
    }
    let Some(shape) = *shape else { return Err(Error::runtime("no clusters were tried")) };
    let found = with_differences(&rows, shape, coded.set.step, amount)?;
    study.measured((coded.light_bytes + found.bytes) as f64, Numbers { values: &found.known, ..numbers })
}

/// Forms of the rows of reference points.
fn reference_points(
    context: &Context,
    study: &Study,
    max_rms: f64,
    shape: &mut Option<Shape>,
    curves: &mut Curves,
) -> Result<()> {
    let what = format!("{} asked", percent(max_rms));
    let harmonics = study.uncoded.order.pow(2).to_string();
    let set = [("coefficients", harmonics.as_str())];
    let asset = bake(study.scene, &Recipe { max_rms, ..compared(context, &set) }, &Silent)?;
    let file = DistantTransport::from_sections(&asset.sections, study.uncoded.points.len()).map_err(failed)?;
    let baked = file.and_then(|file| file.harmonics).ok_or_else(|| Error::runtime("an asset without harmonics"))?;
    let spacing_mm = baked.spacing_mm;
    let net = study.uncoded.net(spacing_mm);
    context.say(&format!("coding: {} reference points", net.point.len()));
    let mut plain = Net::unpredicted(net.point.len());
    plain.point.clone_from(&net.point);
    plain.point.sort_unstable();
    let closer_mm = CLOSER_SPACING * spacing_mm;
    let closer = study.uncoded.net(closer_mm);
    let forms = [
        (REFERENCES, &plain, spacing_mm, 1.0),
        (DEFAULT, &net, spacing_mm, 1.0),
        (COARSER, &net, spacing_mm, 2.0),
        (CLOSER, &closer, closer_mm, 2.0),
    ];
    let mut coefficients = 0.0;
    for (name, net, spacing_mm, times) in forms {
        let coded = study.coded(net, spacing_mm, times * max_rms)?;
        let numbers = Numbers { net, spacing_mm, values: &coded.known, form: &coded.form };
        let found = study.measured((coded.light_bytes + coded.set.coefficients.len()) as f64, numbers)?;
        curves.add(context, name, &what, found);
        if name == DEFAULT {
            coefficients = coded.known.len() as f64;
        }
        if name == REFERENCES {
            let exact = study.exact(net, max_rms)?;
            let found = clustered(context, study, (&coded, &exact, numbers), shape)?;
            curves.add(context, REFERENCE_CLUSTERS, &what, found);
        }
    }
    let bytes = bytes_per_vertex(&asset)? * study.vertices();
    let mut evaluator = open(asset)?;
    curves.add(
        context,
        BAKED,
        &what,
        study.measured_under((bytes, coefficients), |lit| under(evaluator.as_mut(), &lit.lights))?,
    );
    Ok(())
}

/// Clusters alone, over the functions of the default error.
fn clusters_alone(context: &Context, study: &Study, exact: &Exact, curves: &mut Curves) -> Result<()> {
    let net = &study.every;
    let coded = study.coded(net, EVERY_VERTEX, DEFAULT_RMS)?;
    let places: Vec<DVec3> = net.point.iter().map(|&p| study.uncoded.points[p as usize].at_mm).collect();
    let values = exact.of(&coded.set);
    let rows = Rows { values: &values, columns: coded.set.columns.len(), places: &places };
    for directions in ALONE_DIRECTIONS {
        for members in context.some(&ALONE_MEMBERS, 2) {
            let found = alone(&rows, Shape { members, directions })?;
            let numbers = Numbers { net, spacing_mm: EVERY_VERTEX, values: &found.known, form: &coded.form };
            let clusters = places.len().div_ceil(members) * rows.columns * (1 + directions);
            let coefficients = (places.len() * directions + clusters) as f64 / study.vertices();
            let found = study.measured((coded.light_bytes + found.bytes) as f64, numbers)?;
            let found = Measured { coefficients, ..found };
            curves.add(context, &alone_name(directions), &format!("{members} members"), found);
        }
    }
    Ok(())
}

/// A chart and a table.
pub(crate) fn run(context: &Context) -> Result<String> {
    let scene = context.scene(context.model(), "marble")?;
    let study = Study::new(context, &scene)?;
    let exact = study.exact(&study.every, DEFAULT_RMS)?;
    let (mut every, mut references) = (None, None);
    let mut curves = Curves::default();
    for max_rms in context.some(&ASKED, 2) {
        reference_points(context, &study, max_rms, &mut references, &mut curves)?;
        every_vertex(context, (&study, &exact), max_rms, &mut every, &mut curves)?;
    }
    let shapes = [(CLUSTERS, every), (REFERENCE_CLUSTERS, references)];
    clusters_alone(context, &study, &exact, &mut curves)?;
    curves.page(context, &shapes)
}
