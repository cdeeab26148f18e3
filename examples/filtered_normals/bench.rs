//! What the parts share: lights and bakes.

use std::sync::Arc;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::Result;
use translux::light::sky::sky;
use translux::light::{Light, LightKind};
use translux::methods;
use translux::progress::Silent;
use translux::scene::Scene;

use crate::common::bench::{Recipe, SIZE_MM, bake_for, parallel};

/// Four suns and two point lights, none of which a fit has seen.
pub(crate) fn six_lights(scene: &Scene) -> Result<Vec<(&'static str, Light)>> {
    let point = |x: f64, y: f64, z: f64| {
        let offset = DVec3::new(x, y, z).normalize() * 0.75 * SIZE_MM;
        Light::point(scene.mesh.origin_mm + offset, DVec3::splat(offset.length_squared()))
    };
    Ok(vec![
        ("sun from the front", parallel(DVec3::new(0.2, 0.3, 1.0))),
        ("sun from above", parallel(DVec3::new(0.1, 1.0, 0.2))),
        ("sun from the side", parallel(DVec3::new(1.0, 0.2, 0.1))),
        ("sun from behind", parallel(DVec3::new(-0.5, 0.4, -0.9))),
        ("point light, front left", point(-1.0, 0.6, 0.8)?),
        ("point light, low right", point(1.0, -0.2, 0.5)?),
    ])
}

/// Light from an area and from all around.
pub(crate) fn wide_lights(scene: &Scene) -> Result<Vec<(&'static str, Light)>> {
    let from = DVec3::new(-0.6, 0.9, 0.7).normalize();
    Ok(vec![
        (
            "area light",
            Light::area(scene.mesh.origin_mm + from * SIZE_MM, -from, [0.5 * SIZE_MM; 2], DVec3::splat(5.0), None)?,
        ),
        ("sky", Light::Environment { map: Arc::new(sky()), rotate_degrees: 63.0, scale: DVec3::ONE }),
        ("constant light", Light::Constant { radiance: DVec3::ONE }),
    ])
}

pub(crate) fn baked(scene: &Scene, set: &[(&str, &str)]) -> Result<Asset> {
    let method = methods::built_in().method("filtered_normals")?;
    bake_for(LightKind::Directional, method, scene, &Recipe { samples: Some(32_768), max_rms: 0.05, set }, &Silent)
}
