//! The error that lossy stages add, measured in one place. A stage supplies radiosity at some receivers under a light,
//! before and after itself; this module chooses the receivers and the lights, and the worst light counts.
//!
//! Whole evaluators are measured by [`super::measured`].

use crate::error::Result;
use crate::light::{Light, LightKind};
use crate::math::statistics::VertexError;
use crate::transport::receivers::{ProbePoints, Receivers};

/// Approximate number of receivers at which an error is measured.
const PROBES: usize = 192;

/// Phase of [`PROBES`] that no choice sees: choices use phase 0, errors of sampling phase 2.
const UNSEEN: usize = 1;

/// The receivers at which errors of stages are measured; `areas_mm2` are the areas around all receivers.
pub fn probe_points(receivers: &Receivers, areas_mm2: &[f64]) -> (Receivers, ProbePoints) {
    receivers.probe_points(areas_mm2, (PROBES, UNSEEN))
}

/// The lights of some kinds.
pub(crate) fn of_kinds(lights: &[Light], kinds: &[LightKind]) -> Vec<Light> {
    lights.iter().filter(|light| kinds.contains(&light.kind())).cloned().collect()
}

/// At most `count` lights, spread over all.
pub(crate) fn spread(lights: &[Light], count: usize) -> impl Iterator<Item = &Light> {
    lights.iter().step_by(lights.len().div_ceil(count).max(1))
}

/// The error that each stage adds under the worst of several lights; `added` measures it under one of them.
///
/// # Errors
/// Errors of `added`.
pub fn worst<L, const N: usize>(
    lights: impl IntoIterator<Item = L>,
    mut added: impl FnMut(L) -> Result<[VertexError; N]>,
) -> Result<[VertexError; N]> {
    let mut worst = [VertexError::default(); N];
    for light in lights {
        worst.iter_mut().zip(added(light)?).for_each(|(worst, added)| *worst = worst.max(added));
    }
    Ok(worst)
}

/// Like [`worst`] for an evaluator: under the lights in force together (`None`), and under each unseen light alone.
///
/// # Errors
/// Errors of `added`.
pub fn worst_and_unseen(
    unseen: &[Light],
    mut added: impl FnMut(Option<&Light>) -> Result<VertexError>,
) -> Result<VertexError> {
    let lights = std::iter::once(None).chain(unseen.iter().map(Some));
    worst(lights, |light| Ok([added(light)?])).map(|[worst]| worst)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::error::Error;

    #[test]
    fn each_stage_has_its_own_worst_light_and_failures_are_passed_on() {
        let error = |rms| VertexError { rms, bias: -rms, ..VertexError::default() };
        let found = worst([[0.3, 0.1], [0.2, 0.4]], |light| Ok(light.map(error))).unwrap();
        assert_eq!(found, [error(0.3), error(0.4)]);
        assert_eq!(worst([], |light: f64| Ok([error(light)])).unwrap(), [VertexError::default()]);
        assert!(worst([true, false], |light| if light { Ok([]) } else { Err(Error::input("no")) }).is_err());
        let lights = [glam::DVec3::X, glam::DVec3::Y].map(|from| Light::Directional { from, irradiance: from });
        assert_eq!(worst_and_unseen(&lights, |light| Ok(error(light.map_or(0.5, |_| 0.1)))).unwrap(), error(0.5));
        assert_eq!(spread(&lights, 1).chain(&of_kinds(&lights, &[LightKind::Point])).count(), 1);
    }
}
