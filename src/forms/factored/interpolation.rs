//! Error of interpolating the far field, and the spacing of its points.

use std::collections::BTreeSet;

use glam::DVec3;

use super::choice::Tuning;
use super::far_sums::Fill;
use super::levels::levels;
use super::ordered_samples::{Work, spacing_mm};
use super::points::{FarPoints, Row};
use super::sources::FarRadiosity;
use super::subset::{Projected, Subset};
use crate::math::statistics::VertexError;
use crate::transport::far_field::LANES;
use crate::transport::receivers::Receivers;

/// Receivers that a choice is made on.
const RECEIVERS: usize = 96;

/// Number of spacings that are tried, and range of the factor from one to the next.
const TRIALS: usize = 5;
const CLOSER: (f64, f64) = (0.5, 0.85);

/// Functions (bit k) that a point takes from other points.
struct Taken {
    functions: u16,
    point: u32,
    row: Row,
}

/// Receivers, and the points that they are interpolated from.
pub(super) struct Between {
    targets: Subset,
    /// All points that anything is interpolated from, ascending; `sources` are their positions.
    points: Vec<u32>,
    sources: Receivers,
    /// Interpolation weights of each target.
    weights: Vec<Row>,
    taken: Vec<Taken>,
    materials: Vec<Projected>,
}

impl Between {
    /// About `count` receivers of a phase, between some points; `None` where every receiver is a point.
    pub(super) fn new(work: Work, points: &FarPoints, (count, phase): (usize, usize)) -> Option<Self> {
        let Work { scene, ordered, .. } = work;
        let shared = points.weights.as_ref()?;
        let areas = ordered.receivers.areas_mm2(&scene.mesh);
        let (receivers, probes) = ordered.receivers.probe_points(&areas, (count, phase));
        let of = |&i: &u32| shared.of(i as usize).map(|(point, w)| (point, f64::from(w))).collect();
        let weights: Vec<Row> = probes.indices.iter().map(of).collect();
        let of_rows = |rows: &mut dyn Iterator<Item = &Row>| -> BTreeSet<u32> {
            rows.flatten().map(|(point, _)| *point).collect()
        };
        let between = of_rows(&mut weights.iter());
        let take = |fill: &Fill| -> Vec<Taken> {
            let functions = fill.functions;
            let take = |&point: &u32| points.row_of(fill, point).map(|row| Taken { functions, point, row });
            between.iter().filter_map(take).collect()
        };
        let taken: Vec<Taken> = points.fills.iter().flat_map(take).collect();
        let all: Vec<u32> = of_rows(&mut weights.iter().chain(taken.iter().map(|t| &t.row))).into_iter().collect();
        let sources = points.receivers.only(&all, LANES);
        let targets = Subset { receivers, points: probes };
        let materials = Subset::materials(work);
        Some(Self { targets, points: all, sources, weights, taken, materials })
    }

    /// Number of receivers.
    pub(super) fn targets(&self) -> usize {
        self.targets.receivers.len()
    }

    /// Error of interpolation alone, the worst of some lights and all materials.
    pub(super) fn error(&self, work: Work, irradiances: &[&[DVec3]]) -> VertexError {
        let Work { ordered, table, .. } = work;
        let exact = ordered.merged.far_radiosity(table, &self.targets.receivers, irradiances);
        let known = ordered.merged.far_radiosity(table, &self.sources, irradiances);
        let place = |point: u32| self.points.partition_point(|p| *p < point);
        let near = self.targets.near(work, &self.materials);
        let of_light = |((irradiance, exact), known): ((&&[DVec3], &FarRadiosity), &FarRadiosity)| {
            let sum = |row: &Row, values: &FarRadiosity, k: usize| -> f64 {
                row.iter().map(|&(point, w)| w * values[place(point)][k]).sum()
            };
            let mut given = known.clone();
            for Taken { functions, point, row } in &self.taken {
                let functions = (0..table.terms()).filter(|k| functions >> k & 1 == 1);
                functions.for_each(|k| given[place(*point)][k] = sum(row, known, k));
            }
            let of_target = |row: &Row| (0..table.terms()).map(|k| sum(row, &given, k)).collect();
            let found: FarRadiosity = self.weights.iter().map(of_target).collect();
            let near = near.under(irradiance);
            let of_material = |(material, near): (&Projected, Vec<DVec3>)| {
                self.targets.points.error(&material.add(&found, near.clone()), &material.add(exact, near))
            };
            self.materials.iter().zip(near).map(of_material).fold(VertexError::default(), VertexError::max)
        };
        irradiances.iter().zip(&exact).zip(&known).map(of_light).fold(VertexError::default(), VertexError::max)
    }
}

/// Points at the spacing of the settings or, where they give none, at the widest that the asked error allows under some
/// lights; each function at the widest level of spacing.
pub(super) fn choose_points(work: Work, lights: &[Tuning]) -> FarPoints {
    let sample_mm = spacing_mm(&work.ordered.patches);
    let spacing = work.form.far_spacing.unwrap_or_else(|| widest(work, lights));
    let levels = levels(work, lights, spacing * sample_mm);
    FarPoints::choose(&work.ordered.receivers, spacing * sample_mm, &levels)
}

/// The widest spacing that keeps the error, in sample spacings.
fn widest(work: Work, lights: &[Tuning]) -> f64 {
    let Work { ordered, form, .. } = work;
    let sample_mm = spacing_mm(&ordered.patches);
    let irradiances: Vec<&[DVec3]> = lights.iter().map(|light| light.irradiance.as_slice()).collect();
    let mut spacing = form.widest_far_spacing;
    for _ in 0..TRIALS {
        let points = FarPoints::choose(&ordered.receivers, spacing * sample_mm, &[]);
        let Some(between) = Between::new(work, &points, (RECEIVERS, 2)) else { return spacing };
        let error = between.error(work, &irradiances).rms;
        if error <= form.interpolation {
            return spacing;
        }
        spacing *= (0.9 * form.interpolation / error).sqrt().clamp(CLOSER.0, CLOSER.1);
    }
    0.0
}
