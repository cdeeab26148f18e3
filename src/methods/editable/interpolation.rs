//! What interpolation of the far field loses, and how far apart its points may be.

use glam::DVec3;
use rayon::prelude::*;

use super::bake::{Stage, spacing_mm};
use super::choice::Tuning;
use super::plan::Plan;
use super::points::FarPoints;
use super::subset::{Projected, Subset};
use crate::evaluate::sampling_error::receiver_areas;
use crate::math::statistics::{VertexError, vertex_error};
use crate::medium::profile_basis::{ProfileBasis, Table};
use crate::transport::far_field::{LANES, TERMS};
use crate::transport::receivers::Receivers;
use crate::transport::scene::Scene;

/// Far radiosity `[receiver][k]` under one light.
pub(super) type FarRadiosity = Vec<Vec<f64>>;

/// Receivers that a choice is made on.
const RECEIVERS: usize = 96;

/// Spacings that are tried, and how much closer the next one is.
const TRIALS: usize = 5;
const CLOSER: (f64, f64) = (0.5, 0.85);

/// Receivers, and the points that they are interpolated from.
pub(super) struct Between {
    targets: Subset,
    sources: Receivers,
    /// Weights of each target over the sources.
    weights: Vec<Vec<(usize, f64)>>,
    materials: Vec<Projected>,
}

impl Between {
    /// About so many receivers of a phase, between some points; none where every receiver is a point.
    pub(super) fn new(
        scene: &Scene,
        stage: &Stage,
        basis: &ProfileBasis,
        points: &FarPoints,
        (count, phase): (usize, usize),
    ) -> Option<Self> {
        let shared = points.weights.as_ref()?;
        let (receivers, indices) = stage.receivers.subset(count, phase);
        let areas = receiver_areas(scene, &stage.receivers);
        let areas = indices.iter().map(|&i| areas[i as usize]).collect();
        let of = |&i: &u32| shared.of(i as usize);
        let mut chosen: Vec<u32> = indices.iter().flat_map(of).map(|(source, _)| source).collect();
        chosen.sort_unstable();
        chosen.dedup();
        let place = |source: u32| chosen.partition_point(|&c| c < source);
        let row = |i: &u32| of(i).map(|(source, w)| (place(source), f64::from(w))).collect();
        let weights = indices.iter().map(row).collect();
        let sources = points.receivers.only(&chosen, LANES);
        let targets = Subset { receivers, indices, areas };
        let materials = targets.materials(scene, basis);
        Some(Self { targets, sources, weights, materials })
    }

    /// Number of receivers.
    pub(super) fn targets(&self) -> usize {
        self.targets.indices.len()
    }

    /// What interpolation loses where nothing else is lost, the worst of some lights and all materials.
    pub(super) fn error(
        &self,
        scene: &Scene,
        stage: &Stage,
        (plan, table): (&Plan, &Table),
        irradiances: &[&[DVec3]],
    ) -> VertexError {
        let exact = all_pairs(stage, table, &self.targets.receivers, irradiances);
        let known = all_pairs(stage, table, &self.sources, irradiances);
        let of_light = |((irradiance, exact), known): ((&&[DVec3], &FarRadiosity), &FarRadiosity)| {
            let terms = table.terms();
            let of_target = |weights: &Vec<(usize, f64)>| {
                (0..terms).map(|k| weights.iter().map(|&(source, w)| w * known[source][k]).sum()).collect::<Vec<f64>>()
            };
            let found: Vec<Vec<f64>> = self.weights.iter().map(of_target).collect();
            let near = self.targets.near(scene, stage, plan, &self.materials, irradiance);
            let of_material = |(material, near): (&Projected, Vec<DVec3>)| {
                vertex_error(&material.add(&found, near.clone()), &material.add(exact, near), &self.targets.areas)
            };
            self.materials.iter().zip(near).map(of_material).fold(VertexError::default(), VertexError::max)
        };
        irradiances.iter().zip(&exact).zip(&known).map(of_light).fold(VertexError::default(), VertexError::max)
    }
}

/// Points as far apart as the plan says or, where it does not, as the error that it allows lets them be under some lights.
pub(super) fn choose_points(
    scene: &Scene,
    stage: &Stage,
    plan: &Plan,
    (basis, table): (&ProfileBasis, &Table),
    lights: &[Tuning],
) -> FarPoints {
    let sample_mm = spacing_mm(&stage.patches);
    if let Some(asked) = plan.far_spacing {
        return FarPoints::choose(&stage.receivers, asked * sample_mm);
    }
    let irradiances: Vec<&[DVec3]> = lights.iter().map(|light| light.irradiance.as_slice()).collect();
    let mut spacing = plan.widest_far_spacing;
    for _ in 0..TRIALS {
        let points = FarPoints::choose(&stage.receivers, spacing * sample_mm);
        let Some(between) = Between::new(scene, stage, basis, &points, (RECEIVERS, 2)) else { return points };
        let error = between.error(scene, stage, (plan, table), &irradiances).rms;
        if error <= plan.interpolation {
            return points;
        }
        spacing *= (0.9 * plan.interpolation / error).sqrt().clamp(CLOSER.0, CLOSER.1);
    }
    FarPoints::choose(&stage.receivers, 0.0)
}

/// Far radiosity of each basis function from every sample at some receivers, under the first channel of each light.
pub(super) fn all_pairs(
    stage: &Stage,
    table: &Table,
    receivers: &Receivers,
    irradiances: &[&[DVec3]],
) -> Vec<FarRadiosity> {
    let terms = table.terms();
    let of_receiver = |(receiver, part): (DVec3, u32)| {
        let mut sums = vec![vec![0.0; terms]; irradiances.len()];
        let mut values = [0.0; TERMS];
        for index in stage.samples.part(part as usize) {
            let patch = &stage.patches[index];
            table.evaluate(patch.centre_mm.distance_squared(receiver) as f32, &mut values);
            for (sums, irradiance) in sums.iter_mut().zip(irradiances) {
                let flux = irradiance[index].x * patch.area_mm2;
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += flux * f64::from(value));
            }
        }
        sums
    };
    let places: Vec<(DVec3, u32)> =
        receivers.groups.iter().flat_map(|g| receivers.positions[g.run.range()].iter().map(|&p| (p, g.part))).collect();
    let rows: Vec<Vec<Vec<f64>>> = places.into_par_iter().map(of_receiver).collect();
    (0..irradiances.len()).map(|light| rows.iter().map(|row| row[light].clone()).collect()).collect()
}
