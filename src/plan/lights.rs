//! Lights that a plan looks at: one set for the choice, another for the verdict, of the kinds asked for and no others. Both hold
//! what methods fail at: suns from odd directions, edge-on to the largest flat area, from below and behind; an environment
//! with a sun in it.

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;

use crate::error::Result;
use crate::light::quantised::directions::lattice;
use crate::light::sky::sky_with_sun;
use crate::light::{Light, LightKind};
use crate::math::cube_map::{self, FACES};
use crate::scene::Scene;

/// For what a set of lights is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// The choice of a method.
    Choice,
    /// The verdict on an asset: no choice saw them. More directions where time allows.
    Verdict {
        /// Number of further directions.
        directions: usize,
    },
}

/// Height of the edge-on suns above the plane of the flat area, as a sine.
const GRAZING: f64 = 0.05;

/// Cells of a face of the cube on which normals are counted.
const CELLS: usize = 8;

/// Offset of the lattice of the verdict's directions.
const OFFSET: f64 = 0.31;

/// The lights, with those of a kind one after another.
pub(super) fn lights(scene: &Scene, kinds: &BTreeSet<LightKind>, purpose: Purpose) -> Result<Vec<Light>> {
    let mesh = &scene.mesh;
    let radius = 0.5 * mesh.diagonal_mm();
    let flat = largest_flat_normal(scene);
    let along = flat.any_orthonormal_vector();
    // The same questions with other answers: turned about the flat area's normal, and seen from the other side.
    let (turn, side) = match purpose {
        Purpose::Choice => (0.0, 1.0),
        Purpose::Verdict { .. } => (0.37 * TAU, -1.0),
    };
    let edge = (along * f64::cos(turn) + flat.cross(along) * f64::sin(turn) + GRAZING * flat).normalize();
    let odd = DVec3::new(0.521 * side, 0.683, 0.512).normalize();
    let below = DVec3::new(0.31 * side, -0.9, 0.2).normalize();
    let behind = DVec3::new(0.2, 0.25 * side, -0.9).normalize();
    let mut result = Vec::new();
    for kind in kinds {
        match kind {
            LightKind::Constant => result.push(Light::Constant { radiance: DVec3::ONE }),
            LightKind::Directional => {
                let mut from = vec![odd, edge, below, behind];
                if let Purpose::Verdict { directions } = purpose {
                    from.extend(lattice(directions, OFFSET));
                }
                result.extend(from.into_iter().map(|from| Light::Directional { from, irradiance: DVec3::ONE }));
            }
            LightKind::Point => {
                for (from, distance) in [(odd, 1.6), (below, 3.1), (edge, 1.6)] {
                    let distance = distance * radius;
                    let at_mm = mesh.origin_mm + distance * from;
                    result.push(Light::Point { at_mm, intensity: DVec3::splat(distance * distance) });
                }
            }
            LightKind::Area => {
                let from = (odd + 0.5 * behind).normalize();
                let (at_mm, size) = (mesh.origin_mm + 2.2 * radius * from, 0.8 * radius);
                let (normal, u) = (-from, from.any_orthonormal_vector());
                result.push(Light::Area { at_mm, normal, u, size_mm: [size; 2], radiance: DVec3::ONE, field: None });
            }
            LightKind::Environment => {
                let rotate = if side > 0.0 { 25.0 } else { 152.0 };
                result.push(Light::environment(Arc::new(sky_with_sun()), rotate, DVec3::ONE)?);
            }
        }
    }
    Ok(result)
}

/// Normal of the largest flat area of the translucent parts: the mean over the cell of directions that most area faces.
fn largest_flat_normal(scene: &Scene) -> DVec3 {
    let Scene { mesh, parts, .. } = scene;
    let mut sums = vec![DVec3::ZERO; FACES * CELLS * CELLS];
    for (triangle, &part) in parts.triangle_part.iter().enumerate().take(mesh.triangles.len()) {
        if parts.parts.get(part as usize).is_some_and(|part| part.transfers()) {
            let cross = mesh.cross_mm2(triangle as u32);
            if cross != DVec3::ZERO {
                sums[cube_map::texel_of(CELLS, cross.normalize_or(DVec3::Y))] += cross;
            }
        }
    }
    let largest = sums.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    largest.unwrap_or_default().normalize_or(DVec3::Y)
}
