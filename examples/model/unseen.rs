//! Models, materials and sizes that nothing was tuned on, against the program's own walks.

use glam::DVec3;
use translux::error::Result;
use translux::light::Light;
use translux::progress::Silent;
use translux::transport::calibration::surface::CalibratedSurface;
use translux::transport::calibration::{Told, Walks};
use translux::transport::random_walk::exitance::{Effort, exitance};
use translux::transport::random_walk::model_error::compare;

use crate::common::bench::{Context, table};
use crate::common::lit::percent;
use crate::common::runner::summary;
use crate::truth::{SAMPLES, SAMPLING, sun};

/// Noise of the walks that are compared with; it is taken out.
const NOISE: f64 = 0.05;

const CASES: [(&str, &str, f64); 4] =
    [("spot", "skin2", 30.0), ("spot", "cream", 10.0), ("suzanne", "ketchup", 30.0), ("igea_8k", "skin2", 10.0)];

pub(crate) fn run(context: &Context) -> Result<String> {
    let mut rows = Vec::new();
    let mut errors = Vec::new();
    for (model, material, size) in context.some(&CASES, 1) {
        let scene = context.sized_scene(model, material, size)?;
        let side = Light::Directional { from: DVec3::new(-0.8, 0.1, 0.4).normalize(), irradiance: DVec3::ONE };
        let body = CalibratedSurface::new(scene.domain(), SAMPLES, Walks::default(), &Silent)?;
        let dipole = CalibratedSurface::with(scene.domain(), SAMPLES, Told::nothing(scene.domain()), &Silent)?;
        let mut cells = vec![format!("{model}, {size} mm"), material.to_owned()];
        if body.calibrated.parts.iter().all(|part| part.is_none()) {
            cells.push("open: keeps its dipole".to_owned());
            rows.push(cells);
            continue;
        }
        for light in [sun(), side] {
            let walked =
                match exitance(scene.domain(), std::slice::from_ref(&light), Effort::Noise(NOISE), 4711, &Silent) {
                    Ok(walked) => walked,
                    Err(error) => {
                        context.say(error.message());
                        continue;
                    }
                };
            for body in [&dipole, &body] {
                let found = compare(&walked, &body.radiosity(std::slice::from_ref(&light), SAMPLING, &Silent)?)?;
                cells.push(found.rms.map(percent).join(" "));
                if !std::ptr::eq(body, &dipole) {
                    errors.extend(found.rms);
                }
            }
        }
        context.say(&cells.join(", "));
        rows.push(cells);
    }
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2).copied().unwrap_or_default();
    let worst = errors.last().copied().unwrap_or_default();
    let measured = format!("median {} %, worst {} %", percent(median), percent(worst));
    let head = ["model", "material", "sun: dipole", "calibrated", "from the side: dipole", "calibrated"];
    Ok(summary("meshes and materials that no tuning saw", "-", "median <= 4 %, worst <= 8 %", &measured)
        + &table(&head, &rows))
}
