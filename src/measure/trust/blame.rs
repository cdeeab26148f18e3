//! The error at one place, by stage, and what mends it.

use glam::DVec3;

use super::exact::{Exact, Subject, Which};
use super::map::{MOST_OWN_PAIRS, RESOLUTION, asked_rms, environment_is_stored, is_cut, own_samples};
use super::thickness::thickness;
use crate::compress::ledger::{BESIDE_RADIOSITY, ENVIRONMENT_STAGES, Ledger, MODEL, TOGETHER};
use crate::error::{Error, Result};
use crate::evaluate::exitance::MeshPoint;
use crate::forms::gathered::Far;
use crate::light::Light;
use crate::math::statistics::units;
use crate::measure::exact_sums::{is_soft, true_samples};
use crate::progress::{Progress, Silent};
use crate::scene::Scene;

/// Names of the stages.
const SAMPLING: &str = "sampling";
const ENVIRONMENT: &str = "environment";
const TRANSPORT: &str = "transport";
const JOINT: &str = "sampling and transport";
const BETWEEN: &str = "between vertices";

/// Setting of assets with stored irradiance rows that more of lose less.
const COEFFICIENTS: &str = "coefficients";

/// A place of the surface that is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The point.
    pub point: MeshPoint,
    /// The source vertex, where it is one.
    pub vertex: Option<u32>,
}

impl Place {
    /// A source vertex.
    ///
    /// # Errors
    /// Command line: no such vertex, or one on no translucent surface.
    pub fn vertex(scene: &Scene, vertex: u32) -> Result<Self> {
        let count = scene.mesh.local_mm.len();
        if vertex as usize >= count {
            let last = count.saturating_sub(1);
            return Err(Error::command_line(format!("the asset has the vertices 0 to {last}")));
        }
        let triangles = scene.mesh.triangles.iter().zip(0..).filter(|(_, index)| scene.parts.transfers(*index));
        for (corners, index) in triangles {
            let Some(corner) = corners.iter().position(|&v| v == vertex) else { continue };
            let weights = [0, 1, 2].map(|k| if k == corner { 1.0 } else { 0.0 });
            if let Some(point) = MeshPoint::new(&scene.mesh, index, weights) {
                return Ok(Self { point, vertex: Some(vertex) });
            }
        }
        Err(Error::command_line("the vertex is on no translucent surface, its radiosity is 0"))
    }

    /// A point between vertices.
    ///
    /// # Errors
    /// Command line: a point on no translucent part.
    pub fn point(scene: &Scene, point: MeshPoint) -> Result<Self> {
        if !scene.parts.transfers(point.triangle) {
            return Err(Error::command_line("the part there is opaque: it has no radiosity"));
        }
        Ok(Self { point, vertex: None })
    }
}

/// What a stage adds at a place.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StageError {
    /// Name of the stage.
    pub stage: String,
    /// Stages of the asset's ledger that are joint in it, because nothing tells them apart at one place; empty where it is one.
    pub joint: Vec<String>,
    /// What it adds to the radiosity, signed, over the RMS of the radiosity of each channel over the surface, RGB.
    pub error: [f64; 3],
}

/// The error at a place.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Blame {
    /// The source vertex, where the place is one.
    pub vertex: Option<u32>,
    /// Triangle of the place.
    pub triangle: u32,
    /// Weights of its corners.
    pub barycentric: [f64; 3],
    /// World position, mm.
    pub at_mm: [f64; 3],
    /// Radiosity that the asset gives there, RGB.
    pub radiosity: [f64; 3],
    /// Radiosity by exact sums, RGB.
    pub exact: [f64; 3],
    /// Error, signed, over the RMS of the radiosity of each channel over the surface, RGB.
    pub error: [f64; 3],
    /// Error, signed, over the exact radiosity there, RGB; none where that is black.
    pub local_error: Option<[f64; 3]>,
    /// The stages, whose errors add up to the error, in the order of the pipeline.
    pub stages: Vec<StageError>,
    /// Stage that adds the most.
    pub dominant: String,
    /// Whether a channel is cut off at 0 there, where the exact radiosity is above 0.1 % of its RMS.
    pub clamped: bool,
    /// Distance through the body along the inverse normal of the nearest vertex, in mean free paths of the channel where these are longest.
    pub thickness: f64,
    /// RMS error of the model of the light inside over the surface, kept apart: exact sums have it as well. None where the asset does not tell it.
    pub model_error: Option<f64>,
    /// Error that was asked of the asset.
    pub asked_rms: f64,
    /// Samples of the exact sums under sharp lights.
    pub samples: usize,
    /// What mends the dominant stage, as it is typed; none where the error is not above the asked one.
    pub mend: Option<String>,
}

/// Errors of the stages at the corners of a place's triangle, together at the place, RGB, without unit.
#[derive(Default)]
struct Sums {
    radiosity: DVec3,
    /// All pairs of the asset's samples, where they are summed.
    pairs: DVec3,
    /// The same lit by rays, where the asset has stored irradiance.
    rays: DVec3,
    exact_of_corners: DVec3,
    exact: DVec3,
    rms: Vec<DVec3>,
}

/// The error of an asset at a place under some lights together.
///
/// # Errors
/// Lights that the asset does not carry; failures of the work; command line: lights that leave the surface black.
pub fn blame(mut subject: Subject, lights: &[Light], place: Place, progress: &dyn Progress) -> Result<Blame> {
    let scene = subject.evaluator.scene().clone();
    let (cost, asked) = (subject.evaluator.cost(), asked_rms(&subject));
    let samples = true_samples(&scene, asked, cost.samples);
    let apart = (cost.receivers * lights.len()) as f64 * own_samples(&subject) <= MOST_OWN_PAIRS;
    let stored = apart && environment_is_stored(&subject) && lights.iter().any(is_soft);
    let sums = sums(&mut subject, (lights, &place), (samples, apart, stored), progress)?;
    let unit = units(&sums.rms, &scene.vertex_areas_mm2());
    if unit.min_element() <= 0.0 {
        return Err(Error::command_line(
            "--light: no light arrives, the radiosity is 0 everywhere and nothing is relative to it",
        ));
    }
    let Sums { radiosity, pairs, rays, exact_of_corners, exact, .. } = sums;
    let others = others(&subject.asset.ledger);
    let stage = |name: &str, joint: &[String], error: DVec3| StageError {
        stage: name.to_owned(),
        joint: joint.to_vec(),
        error: (error / unit).to_array(),
    };
    let mut stages = Vec::new();
    if apart {
        let sampled = if stored { rays } else { pairs };
        stages.push(stage(SAMPLING, &[], sampled - exact_of_corners));
        if stored {
            stages.push(stage(ENVIRONMENT, &[], pairs - rays));
        }
        let joint = if others.len() > 1 { others.as_slice() } else { &[] };
        stages.push(stage(TRANSPORT, joint, radiosity - pairs));
    } else {
        let joint: Vec<String> = [SAMPLING.to_owned()].into_iter().chain(others).collect();
        stages.push(stage(JOINT, &joint, radiosity - exact_of_corners));
    }
    if place.vertex.is_none() {
        stages.push(stage(BETWEEN, &[], exact_of_corners - exact));
    }
    let error = (radiosity - exact) / unit;
    let size = |stage: &StageError| stage.error.iter().fold(0.0_f64, |most, e| most.max(e.abs()));
    let dominant = stages.iter().max_by(|a, b| size(a).total_cmp(&size(b))).map(|stage| stage.stage.clone());
    let dominant = dominant.unwrap_or_default();
    let depths = thickness(&scene, subject.evaluator.bvh());
    let MeshPoint { triangle, vertices, barycentric, at_mm } = place.point;
    let nearest = (0..3).max_by(|&a, &b| barycentric[a].total_cmp(&barycentric[b])).map_or(0, |k| vertices[k]);
    let found = Found { asked, error: error.abs().max_element(), samples: cost.samples };
    Ok(Blame {
        vertex: place.vertex,
        triangle,
        barycentric,
        at_mm: (scene.mesh.origin_mm + at_mm).to_array(),
        radiosity: radiosity.to_array(),
        exact: exact.to_array(),
        error: error.to_array(),
        local_error: (exact.min_element() > 0.0).then(|| ((radiosity - exact) / exact).to_array()),
        clamped: is_cut(radiosity, exact, unit),
        thickness: depths.get(nearest as usize).copied().unwrap_or_default(),
        model_error: subject.asset.ledger.entries.iter().find(|e| e.stage == MODEL).map(|e| e.error.rms),
        asked_rms: asked,
        samples,
        mend: found.mend(&dominant, &mut subject),
        stages,
        dominant,
    })
}

/// Radiosity at a place under some lights, as far as each stage goes.
fn sums(
    subject: &mut Subject,
    (lights, place): (&[Light], &Place),
    (samples, apart, stored): (usize, bool, bool),
    progress: &dyn Progress,
) -> Result<Sums> {
    let mut exact = Exact::new(subject, Which::Finer(samples), Far::AllPairs);
    let mut own = stored.then(|| Exact::new(subject, Which::Own, Far::AllPairs));
    let MeshPoint { vertices, barycentric, triangle, .. } = place.point;
    let mesh = subject.evaluator.scene().mesh.clone();
    let corner = |k: usize| MeshPoint::new(&mesh, triangle, [0, 1, 2].map(|i| if i == k { 1.0 } else { 0.0 }));
    let points: Vec<MeshPoint> = (0..3).filter_map(corner).chain([place.point]).collect();
    let at_place = |values: &[DVec3]| -> DVec3 { values.iter().zip(barycentric).map(|(value, w)| w * *value).sum() };
    let of_all = |all: &[DVec3]| at_place(&vertices.map(|v| all.get(v as usize).copied().unwrap_or_default()));
    let mut found = Sums::default();
    progress.start("blame", lights.len() as u64);
    for light in lights {
        let served = subject.served(light, apart)?;
        let truth = exact.under(light, &Silent)?.at_points(&points, &Silent)?;
        found.radiosity += of_all(&served.radiosity);
        let pairs = of_all(&served.all_pairs);
        found.pairs += pairs;
        found.exact_of_corners += at_place(&truth);
        found.exact +=
            if place.vertex.is_some() { at_place(&truth) } else { truth.last().copied().unwrap_or_default() };
        found.rays += match own.as_mut().filter(|_| is_soft(light)) {
            Some(own) => at_place(&own.under(light, &Silent)?.at_points(&points, &Silent)?),
            None => pairs,
        };
        found.rms.resize(served.radiosity.len(), DVec3::ZERO);
        found.rms.iter_mut().zip(&served.radiosity).for_each(|(sum, b)| *sum += *b);
        progress.advance(1);
    }
    progress.finish();
    Ok(found)
}

/// Stages of a ledger that are neither of sampling nor of environments nor beside the radiosity.
fn others(ledger: &Ledger) -> Vec<String> {
    let apart = |name: &str| {
        [SAMPLING, ENVIRONMENT, TOGETHER].contains(&name)
            || ENVIRONMENT_STAGES.contains(&name)
            || BESIDE_RADIOSITY.contains(&name)
    };
    ledger.entries.iter().map(|entry| &entry.stage).filter(|name| !apart(name)).cloned().collect()
}

/// What an advice rests on.
struct Found {
    asked: f64,
    /// Error at the place, largest channel.
    error: f64,
    /// Samples of the asset.
    samples: usize,
}

impl Found {
    /// What to type against the dominant stage.
    fn mend(&self, dominant: &str, subject: &mut Subject) -> Option<String> {
        if self.error <= self.asked {
            return None;
        }
        let (settings, method) = (&subject.asset.provenance.settings, &subject.asset.provenance.method);
        let number = |key: &str| settings.get(key).and_then(|text| text.parse::<u64>().ok());
        let over = self.error / self.asked;
        let finer = format!("bake with --max-rms {}", two_digits(self.asked / over.max(2.0), f64::floor));
        let samples = format!("--samples {}", two_digits(self.samples as f64 * over.max(2.0), f64::ceil));
        let another = subject.asset.ledger.total_rms() > self.asked;
        Some(match dominant {
            SAMPLING if settings.contains_key(RESOLUTION) => match number(RESOLUTION) {
                Some(texels) => format!("bake with --method {method} --set {RESOLUTION}={}", texels.saturating_mul(2)),
                None => format!("bake with --method {method} and a larger --set {RESOLUTION}=N than the automatic one"),
            },
            SAMPLING => format!("bake with --method {method} {samples}"),
            ENVIRONMENT => match number(COEFFICIENTS) {
                Some(kept) => format!("bake with --method {method} --set {COEFFICIENTS}={}", kept.saturating_mul(2)),
                None => finer,
            },
            BETWEEN if subject.evaluator.prepare_points(&Silent).is_ok() => {
                "render with --exitance pixels, or bake with --refine auto".to_owned()
            }
            BETWEEN => "bake with --refine auto".to_owned(),
            JOINT => format!("{finer} --method {method} {samples}"),
            _ if another => format!(
                "bake with --method auto --max-rms {}: the ledger of the asset is above that in all",
                two_digits(self.asked, f64::floor)
            ),
            _ => finer,
        })
    }
}

/// A positive number with two digits, rounded one way.
fn two_digits(value: f64, round: fn(f64) -> f64) -> String {
    // Rounding errors of the division are none of the number's digits.
    const NOISE: f64 = 1e-9;
    let exponent = value.log10().floor() as i32 - 1;
    let digits = round(value / 10f64.powi(exponent) * (1.0 + NOISE));
    let places = usize::try_from(-exponent).unwrap_or(0);
    format!("{:.places$}", digits * 10f64.powi(exponent))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_typed_have_two_digits() {
        assert_eq!(two_digits(0.00333, f64::floor), "0.0033");
        assert_eq!(two_digits(0.01, f64::floor), "0.010");
        assert_eq!(two_digits(12_345.0, f64::ceil), "13000");
        assert_eq!(two_digits(40_000.0, f64::floor), "40000");
    }
}
