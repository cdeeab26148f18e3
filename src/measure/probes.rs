//! Probe lights: the fixed set under which errors are measured. Tuning uses one half, reported figures the other.

use std::sync::Arc;

use glam::DVec3;

use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::{Evaluator, Probes};
use crate::geometry::mesh::Mesh;
use crate::light::Light;
use crate::light::quantised::directions::lattice;
use crate::light::sky::sky;
use crate::progress::Progress;
use crate::scene::Scene;

/// The halves of the probe lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// Lights that choices may look at.
    Tuning,
    /// Lights that figures are reported for.
    Figures,
}

/// Number of directional probe lights in both halves.
pub const DIRECTIONS: usize = 32;

/// Offset of the lattice of directions: points in the middle of their steps.
const MIDPOINTS: f64 = 0.5;

/// Directional lights of a half: every other direction of the lattice, irradiance 1.
pub fn directional(half: Half) -> Vec<Light> {
    let first = usize::from(half == Half::Figures);
    let directions = lattice(DIRECTIONS, MIDPOINTS).into_iter().skip(first).step_by(2);
    directions.map(|from| Light::Directional { from, irradiance: DVec3::ONE }).collect()
}

/// Directions that the figures of a ledger are measured under.
const OF_A_LEDGER: usize = 4;

/// So many of some directional lights, each the farthest from those before it. Every nth of a lattice would not do: eight steps of it
/// turn by no more than 20 degrees.
fn all_around(lights: &[Light], count: usize) -> Vec<Light> {
    let direction = |light: &Light| match light {
        Light::Directional { from, .. } => *from,
        _ => DVec3::ZERO,
    };
    let mut chosen: Vec<Light> = lights.iter().take(1).cloned().collect();
    while chosen.len() < count.min(lights.len()) {
        let nearest = |light: &&Light| chosen.iter().map(|c| direction(c).dot(direction(light))).fold(-1.0, f64::max);
        let Some(next) = lights.iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b))) else { break };
        chosen.push(next.clone());
    }
    chosen
}

/// Point lights of a half: corners of a cube at 1.5 (four corners) and 3 bounding radii (the other four) from the
/// centre, with the irradiance of 1 at the centre.
pub fn points(mesh: &Mesh, half: Half) -> Vec<Light> {
    let radius = 0.5 * mesh.diagonal_mm();
    let sign = |bit: usize| if bit == 0 { -1.0 } else { 1.0 };
    let first = usize::from(half == Half::Figures);
    (0..8)
        .map(|i| (i, DVec3::new(sign(i & 1), sign(i >> 1 & 1), sign(i >> 2 & 1))))
        .filter(|(i, _)| (i.count_ones() as usize + (i >> 2)) % 2 == first)
        .map(|(i, corner)| {
            let distance = radius * if (i ^ (i >> 2)) & 1 == 0 { 3.0 } else { 1.5 };
            let at_mm = mesh.origin_mm + corner.normalize() * distance;
            Light::Point { at_mm, intensity: DVec3::splat(distance * distance) }
        })
        .collect()
}

/// Point lights that neither half has: towards the faces and the edges of the same cube, at 1.6 and 3 bounding radii in turn, with the
/// irradiance of 1 at the centre. Corners of one half are the opposite of those of the other, so that what errs near them tells little.
pub fn points_between(mesh: &Mesh) -> Vec<Light> {
    const RADII: [f64; 2] = [1.6, 3.0];
    let radius = 0.5 * mesh.diagonal_mm();
    let of = |i: i32| DVec3::new(f64::from(i % 3 - 1), f64::from(i / 3 % 3 - 1), f64::from(i / 9 - 1));
    (0..27)
        .map(|i| (i, of(i)))
        .filter(|(_, towards)| (0.5..2.5).contains(&towards.length_squared()))
        .map(|(i, towards)| {
            let distance = radius * RADII[usize::from(i % 2 == 0)];
            let at_mm = mesh.origin_mm + towards.normalize() * distance;
            Light::Point { at_mm, intensity: DVec3::splat(distance * distance) }
        })
        .collect()
}

/// A few lights of the half for figures: two directions and a point.
pub fn unseen(mesh: &Mesh) -> Vec<Light> {
    let directions = all_around(&directional(Half::Figures), 2);
    directions.into_iter().chain(points(mesh, Half::Figures).into_iter().take(1)).collect()
}

/// The built-in sky in two rotations for each half.
pub fn environments(half: Half) -> Vec<Light> {
    let first = if half == Half::Tuning { 0.0 } else { 63.0 };
    let map = Arc::new(sky());
    [first, first + 137.0]
        .map(|rotate_degrees| Light::Environment { map: Arc::clone(&map), rotate_degrees, scale: DVec3::ONE })
        .to_vec()
}

/// Turns of the suns that graze the largest flat area, in full turns: others than choices look at. The last two are those of small meshes,
/// where a light costs little and flat areas are large.
const GRAZING_TURNS: [f64; 4] = [0.17, 0.58, 0.07, 0.83];
const SMALL: usize = 8192;

/// A spot whose edge crosses the body, for bakes that are asked for spots: bounding radii from the centre, and of the place beside it that the
/// axis goes through; degrees; share of the half angle over which it falls off.
const SPOT: (f64, f64, f64, f64) = (2.0, 0.4, 25.0, 0.1);

/// The probe lights of a bake: the whole tuning half for its choices, a few of the other half, environments and suns edge-on to the
/// largest flat area for the figures of its ledger.
pub fn for_bake(scene: &Scene) -> Probes {
    let mesh = &scene.mesh;
    let tuning = directional(Half::Tuning).into_iter().chain(points(mesh, Half::Tuning)).collect();
    let directions = all_around(&directional(Half::Figures), OF_A_LEDGER).into_iter();
    let point = points(mesh, Half::Figures).into_iter().take(1);
    let turns = if mesh.local_mm.len() > SMALL { &GRAZING_TURNS[..2] } else { &GRAZING_TURNS[..] };
    let grazing = turns.iter().map(|turn| Light::Directional { from: scene.grazing(*turn), irradiance: DVec3::ONE });
    let soft = environments(Half::Figures).into_iter();
    Probes { tuning, unseen: directions.chain(point).chain(soft).chain(grazing).chain(spot(mesh)).collect() }
}

/// The error of an evaluator under the lights in force, by stage; stages tuned for these lights are measured under the
/// [`unseen`] ones as well.
///
/// # Errors
/// Failures of the work.
pub fn by_stage(evaluator: &mut dyn Evaluator, progress: &dyn Progress) -> Result<Ledger> {
    let unseen = unseen(&evaluator.scene().mesh);
    evaluator.measured_error(&unseen, progress)
}

/// The spot of a bake's figures; none on a mesh without extent.
fn spot(mesh: &Mesh) -> Option<Light> {
    let (distance, beside, degrees, blend) = SPOT;
    let (radius, from) = (0.5 * mesh.diagonal_mm(), DVec3::new(0.6, 0.5, -0.62).normalize());
    let (at, to) = (distance * radius * from, beside * radius * from.any_orthonormal_vector());
    let intensity = DVec3::splat((distance * radius).powi(2));
    Light::spot(mesh.origin_mm + at, mesh.origin_mm + to, degrees, blend, intensity).ok()
}

/// The constant light of radiance 1.
pub fn constant() -> Light {
    Light::Constant { radiance: DVec3::ONE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_spread_and_the_halves_disjoint() {
        let all = lattice(DIRECTIONS, MIDPOINTS);
        assert!(all.iter().sum::<DVec3>().length() / (DIRECTIONS as f64) < 0.02);
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                assert!(a.dot(*b) < 0.95);
            }
        }
        let few = all_around(&directional(Half::Figures), OF_A_LEDGER);
        let of = |light: &Light| match light {
            Light::Directional { from, .. } => *from,
            _ => panic!("{light:?}"),
        };
        assert_eq!(few.len(), OF_A_LEDGER);
        // At right angles at least, about: the corners of a tetrahedron are 109.5 degrees apart.
        assert!(few.iter().enumerate().all(|(i, a)| few[..i].iter().all(|b| of(a).dot(of(b)) < 0.1)), "{few:?}");
        assert_eq!(directional(Half::Tuning).len() + directional(Half::Figures).len(), DIRECTIONS);
    }
}
