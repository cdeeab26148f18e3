//! A few groups of receivers on which choices are made or errors measured, and materials projected onto the basis.

use glam::DVec3;

use super::ordered_samples::Work;
use super::points::FarPoints;
use crate::geometry::cluster::Run;
use crate::medium::dipole::Dipole;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::{Medium, PRESETS};
use crate::parallel::*;
use crate::progress::Silent;
use crate::scene::Scene;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::close_pairs::ClosePairs;
use crate::transport::far_field::Rows;
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::light_range::LightRange;
use crate::transport::near_field::around;
use crate::transport::near_rings::{NearRings, RingCoefficients};
use crate::transport::receivers::{Group, ProbePoints, Receivers};
use crate::transport::surface::Surface;

/// A few groups of receivers, spread over all of them.
pub(super) struct Subset {
    pub(super) receivers: Receivers,
    pub(super) points: ProbePoints,
}

/// A few groups of the rows that have the same functions of the far field.
pub(super) struct OfFunctions {
    pub(super) subset: Subset,
    /// Functions of the rows: bit k.
    pub(super) functions: u16,
}

/// A material and its coefficients.
pub(super) struct Projected {
    pub(super) medium: Medium,
    pub(super) dipoles: [Dipole; 3],
    /// `[channel][k]`.
    coefficients: [Vec<f64>; 3],
}

/// Near field of some receivers in many materials, from rings, off by a thousandth or less: errors are relative to it,
/// and it cancels in them.
pub(super) struct NearOfMaterials<'a> {
    surface: Surface<'a>,
    receivers: &'a Receivers,
    around: ClosePairs,
    rings: NearRings,
    coefficients: Vec<RingCoefficients>,
}

impl Subset {
    /// About `count` groups of rows, with the areas of all rows; phases 0 and 1 give different groups where there are
    /// enough.
    fn new(places: &Receivers, groups: &[Group], areas: &[f64], (count, phase): (usize, usize)) -> Self {
        let step = (groups.len() / count).max(1);
        let mut receivers = Receivers::default();
        let mut indices = Vec::new();
        for group in groups.iter().skip(phase * step / 2).step_by(step) {
            let first = receivers.positions.len() as u32;
            receivers.positions.extend_from_slice(&places.positions[group.run.range()]);
            indices.extend(group.run.first..group.run.end);
            let run = Run { first, end: receivers.positions.len() as u32 };
            receivers.groups.push(Group { run, part: group.part });
        }
        Self { receivers, points: ProbePoints::new(indices, areas) }
    }

    /// About `count` groups of the first set of functions, and half as many of the others.
    pub(super) fn of_functions(scene: &Scene, points: &FarPoints, (count, phase): (usize, usize)) -> Vec<OfFunctions> {
        let of_points = points.receivers.areas_mm2(&scene.mesh);
        let rows = &points.rows;
        let areas: Vec<f64> = (0..rows.places.len() as u32).map(|row| of_points[rows.point(row) as usize]).collect();
        let subset = |(class, (functions, groups)): (usize, (u16, Vec<Group>))| {
            let count = if class == 0 { count } else { count.div_ceil(2) };
            OfFunctions { subset: Self::new(&rows.places, &groups, &areas, (count, phase)), functions }
        };
        rows.classes().into_iter().enumerate().map(subset).collect()
    }

    /// Every published material and those of the scene.
    pub(super) fn materials(Work { scene, basis, .. }: Work) -> Vec<Projected> {
        let presets = PRESETS.iter().map(|m| Medium { name: m.name.to_owned(), properties: m.properties() });
        let project = |medium: Medium| {
            let dipoles = medium.properties.dipoles(BoundaryFit::Published);
            let coefficients = dipoles.each_ref().map(|d| basis.project(d).coefficients);
            Projected { medium, dipoles, coefficients }
        };
        presets.chain(scene.media.iter().cloned()).map(project).collect()
    }

    /// The near field of the receivers in each material.
    pub(super) fn near<'a>(&'a self, work: Work<'a>, materials: &[Projected]) -> NearOfMaterials<'a> {
        let Work { scene, ordered, form, .. } = work;
        let (surface, receivers) = (ordered.surface(scene), &self.receivers);
        let around = around(&surface, receivers, form.near, ordered.split_mm);
        let rule = (form.near, ordered.split_mm);
        let rings = NearRings::new(&surface, (&around, &ordered.corners), receivers, rule, &Silent);
        let coefficients =
            materials.iter().map(|material| rings.coefficients(&MediumKernel::new(&material.medium))).collect();
        NearOfMaterials { surface, receivers, around, rings, coefficients }
    }

    /// Far radiosity of each receiver and function under the first channel of a light, from rows of every group.
    pub(super) fn rebuilt(&self, rows: &[Rows], terms: usize, light: &LightDetails) -> Vec<Vec<f64>> {
        let of_group = |(group, rows): (&Group, &Rows)| {
            let mean = f64::from(light.means[group.part as usize][0]);
            let scaled = |sums: &[f32]| sums.iter().map(|&v| f64::from(v) * mean).collect::<Vec<f64>>();
            let mut sums: Vec<Vec<f64>> = rows.sums.chunks_exact(terms.max(1)).map(scaled).collect();
            let mut values = rows.values.iter();
            for (&node, &mask) in rows.nodes.iter().zip(&rows.masks) {
                let detail = f64::from(light.details[node as usize][0]);
                for k in (0..terms).filter(|k| mask >> k & 1 == 1) {
                    let Some(row) = values.next() else { break };
                    for (sum, value) in sums.iter_mut().zip(row) {
                        sum[k] += f64::from(*value) * detail;
                    }
                }
            }
            sums.iter_mut().flatten().for_each(|v| *v *= light.scale);
            sums
        };
        self.receivers.groups.par_iter().zip(rows).flat_map_iter(of_group).collect()
    }
}

impl NearOfMaterials<'_> {
    /// Radiosity `[material][receiver]` under one light, RGB.
    pub(super) fn under(&self, irradiance: &[DVec3]) -> Vec<Vec<DVec3>> {
        let pieces = Pieces::default();
        let range = LightRange::new(irradiance, pieces.deviations());
        let moments = self.rings.moments(&self.surface, &self.around, self.receivers, (irradiance, &pieces), range);
        let of_material = |coefficients: &RingCoefficients| {
            let mut values = vec![DVec3::ZERO; self.receivers.len()];
            self.rings.add(&moments, self.receivers, |_| Some(coefficients), &mut values);
            values
        };
        self.coefficients.iter().map(of_material).collect()
    }
}

impl Projected {
    /// Adds the far radiosity of each receiver's functions to values, RGB.
    pub(super) fn add(&self, far: &[Vec<f64>], mut values: Vec<DVec3>) -> Vec<DVec3> {
        for (value, far) in values.iter_mut().zip(far) {
            for c in 0..3 {
                value[c] += self.coefficients[c].iter().zip(far).map(|(s, v)| s * v).sum::<f64>();
            }
        }
        values
    }
}
