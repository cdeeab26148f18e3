//! Spacing of the points of each function of the far field: every second, fourth or eighth of the points is enough for
//! wide functions.

use glam::DVec3;

use super::choice::Tuning;
use super::ordered_samples::Work;
use super::points::{FarPoints, Row};
use super::sources::FarRadiosity;
use super::subset::{Projected, Subset};
use crate::parallel::*;
use crate::transport::far_field::LANES;
use crate::transport::receivers::{Group, ProbePoints};

/// Groups of points that the choice is made on, and points of each.
const GROUPS: usize = 8;
const OF_A_GROUP: usize = 8;

/// Changes that interpolation from the points of each level makes to each function at some points.
struct Trial {
    materials: Vec<Projected>,
    points: ProbePoints,
    lights: Vec<UnderLight>,
}

struct UnderLight {
    /// Radiosity in each material.
    truths: Vec<Vec<DVec3>>,
    /// Changes of the far radiosity, `[level][target][k]`; 0 at level 0.
    changes: Vec<FarRadiosity>,
}

/// Level of each function: as coarse as the asked error allows at `spacing_mm` between the points of level 0.
pub(super) fn levels(work: Work, lights: &[Tuning], spacing_mm: f64) -> Vec<u8> {
    let Work { form, basis, .. } = work;
    let terms = basis.terms();
    let mut levels = vec![0; terms];
    if form.levels < 2 || spacing_mm <= 0.0 {
        return levels;
    }
    let Some(trial) = Trial::new(work, lights, spacing_mm) else { return levels };
    // Again and again the function for which the next level costs least.
    loop {
        let raised = |k: usize| {
            let mut levels = levels.clone();
            levels[k] += 1;
            (trial.error(&levels), k)
        };
        let can_rise: Vec<usize> = (0..terms).filter(|&k| usize::from(levels[k]) + 1 < form.levels).collect();
        let errors: Vec<(f64, usize)> = can_rise.into_par_iter().map(raised).collect();
        match errors.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((error, k)) if error <= form.levels_error => levels[k] += 1,
            _ => return levels,
        }
    }
}

impl Trial {
    /// None where there are no points.
    fn new(work: Work, lights: &[Tuning], spacing_mm: f64) -> Option<Self> {
        let Work { ordered, form, basis, table, .. } = work;
        // Points with a "function" for each level.
        let each: Vec<u8> = (0..form.levels as u8).collect();
        let nested = FarPoints::choose(&ordered.receivers, spacing_mm, &each);
        let groups = &nested.receivers.groups;
        let step = (groups.len() / GROUPS).max(1);
        let of_group = |group: &Group| (group.run.first..group.run.end).take(OF_A_GROUP);
        let finest: Vec<u32> = groups.iter().step_by(step).flat_map(of_group).collect();
        // A point of a level takes its own values.
        let own = |&point: &u32| vec![(point, 1.0)];
        let mut rows: Vec<Vec<Row>> = vec![finest.iter().map(own).collect(); form.levels];
        for fill in &nested.fills {
            let of_fill: Vec<Row> =
                finest.iter().map(|point| nested.row_of(fill, *point).unwrap_or_else(|| own(point))).collect();
            let levels = (0..form.levels).filter(|level| fill.functions >> level & 1 == 1);
            levels.for_each(|level| rows[level].clone_from(&of_fill));
        }
        if finest.is_empty() {
            return None;
        }
        let mut sources: Vec<u32> = rows.iter().flatten().flatten().map(|(source, _)| *source).collect();
        sources.sort_unstable();
        sources.dedup();
        let targets = Subset {
            receivers: nested.receivers.only(&finest, LANES),
            points: ProbePoints { areas_mm2: vec![1.0; finest.len()], all: finest.len(), indices: finest },
        };
        let materials = Subset::materials(work);
        let irradiances: Vec<&[DVec3]> = lights.iter().map(|light| light.irradiance.as_slice()).collect();
        let exact = ordered.merged.far_radiosity(table, &targets.receivers, &irradiances);
        let known = ordered.merged.far_radiosity(table, &nested.receivers.only(&sources, LANES), &irradiances);
        let terms = basis.terms();
        let near = targets.near(work, &materials);
        let under = |((irradiance, exact), known): ((&&[DVec3], &FarRadiosity), &FarRadiosity)| {
            let change = |(row, exact): (&Row, &Vec<f64>)| -> Vec<f64> {
                let from = |(source, w): &(u32, f64)| (&known[sources.partition_point(|s| s < source)], *w);
                let found = |k: usize| row.iter().map(from).map(|(values, w)| w * values[k]).sum::<f64>();
                (0..terms).map(|k| found(k) - exact[k]).collect()
            };
            let changes = rows.iter().map(|rows| rows.iter().zip(exact).map(change).collect()).collect();
            let near = near.under(irradiance);
            let truths = materials.iter().zip(near).map(|(material, near)| material.add(exact, near)).collect();
            UnderLight { truths, changes }
        };
        let lights = irradiances.iter().zip(&exact).zip(&known).map(under).collect();
        Some(Self { materials, points: targets.points, lights })
    }

    /// Relative RMS error, the worst of all lights and materials.
    fn error(&self, levels: &[u8]) -> f64 {
        let of_light = |light: &UnderLight| {
            let of_target = |target: usize| {
                let change = |(k, &level): (usize, &u8)| light.changes[usize::from(level)][target][k];
                levels.iter().enumerate().map(change).collect::<Vec<f64>>()
            };
            let changes: Vec<Vec<f64>> = (0..self.points.indices.len()).map(of_target).collect();
            let of_material = |(material, truth): (&Projected, &Vec<DVec3>)| {
                self.points.error(&material.add(&changes, truth.clone()), truth).rms
            };
            self.materials.iter().zip(&light.truths).map(of_material).fold(0.0, f64::max)
        };
        self.lights.iter().map(of_light).fold(0.0, f64::max)
    }
}
