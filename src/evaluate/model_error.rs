//! The error of the model itself: what an evaluator says against random walks through the volume that it never used.

use glam::DVec3;

use super::Evaluator;
use crate::compress::ledger::{Ledger, MODEL};
use crate::error::{ExitCode, Result};
use crate::light::Light;
use crate::math::statistics::VertexError;
use crate::progress::Progress;
use crate::transport::random_walk::exitance::{Effort, exitance};
use crate::transport::random_walk::model_error::over_places;

/// Photons of each channel, light and half.
const PHOTONS: u64 = 40_000;

/// Places of the surface that light is compared at: few, so that few walks are enough.
const PLACES: usize = 256;

/// Seeds of the halves; calibrations have others.
const SEEDS: [u64; 2] = [0x6d6f_6465_6c00, 0x6d6f_6465_6c01];

/// Enters the error of the model under a light from one direction and one from all around, the worse of them; nothing where a
/// part lets light out, which walks refuse.
///
/// # Errors
/// Failures of the evaluator.
pub(super) fn enter(evaluator: &mut dyn Evaluator, ledger: &mut Ledger, progress: &dyn Progress) -> Result<()> {
    let sun = Light::Directional { from: DVec3::new(0.5, 0.8, 0.4).normalize(), irradiance: DVec3::ONE };
    let mut worst = VertexError::default();
    for light in [sun, Light::Constant { radiance: DVec3::ONE }] {
        let walk = |seed: u64| {
            let domain = evaluator.scene().domain();
            exitance(domain, std::slice::from_ref(&light), Effort::Photons(PHOTONS), seed, progress)
        };
        let (first, second) = match (walk(SEEDS[0]), walk(SEEDS[1])) {
            (Ok(first), Ok(second)) => (first, second),
            (Err(error), _) | (_, Err(error)) if error.code() == ExitCode::InvalidInput => return Ok(()),
            (Err(error), _) | (_, Err(error)) => return Err(error),
        };
        evaluator.set_lights(vec![light.clone()], progress)?;
        let radiosity = evaluator.radiosity(progress)?;
        let error = over_places(evaluator.scene().domain(), [&first, &second], &radiosity, PLACES)?;
        if error.rms >= worst.rms {
            worst = error;
        }
    }
    let note = format!("against random walks through the volume over {PLACES} places, scattering orders from 1 on");
    ledger.add(MODEL, worst, note);
    Ok(())
}
