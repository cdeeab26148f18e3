//! Lights that a plan looks at: one set for the choice, another for the verdict, of the kinds asked for and no others. Both hold
//! what methods fail at: suns from odd directions, edge-on to the largest flat area, from below and behind; an environment
//! with a sun in it.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;

use crate::error::Result;
use crate::light::quantised::directions::lattice;
use crate::light::sky::sky_with_sun;
use crate::light::{Light, LightKind};
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

/// Offset of the lattice of the verdict's directions.
const OFFSET: f64 = 0.31;

/// The lights, with those of a kind one after another.
pub(super) fn lights(scene: &Scene, kinds: &BTreeSet<LightKind>, purpose: Purpose) -> Result<Vec<Light>> {
    let mesh = &scene.mesh;
    let radius = 0.5 * mesh.diagonal_mm();
    // The same questions with other answers: turned about the flat area's normal, and seen from the other side.
    let (turn, side) = match purpose {
        Purpose::Choice => (0.0, 1.0),
        Purpose::Verdict { .. } => (0.37, -1.0),
    };
    let edge = scene.grazing(turn);
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
            LightKind::Spot => {
                // One that lights a part of the body from the side, one whose edge grazes it.
                for (from, distance, angle, off) in [(odd, 2.2, 16.0, 0.3), (below, 3.1, 30.0, 0.6)] {
                    let at_mm = mesh.origin_mm + distance * radius * from;
                    let to_mm = mesh.origin_mm + off * radius * side * from.any_orthonormal_vector();
                    result.push(Light::spot(at_mm, to_mm, angle, 0.15, DVec3::splat((distance * radius).powi(2)))?);
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
