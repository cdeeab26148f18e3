//! Radiosity read back from a device.

use glam::DVec3;

use crate::error::Result;
use crate::evaluate::evaluator::DeviceEvaluator;
use crate::progress::Progress;

/// Updates a device evaluator and reads back the radiosity of every source vertex, for
/// [`radiosity`](crate::evaluate::Evaluator::radiosity).
///
/// # Errors
/// As [`DeviceEvaluator::update`].
pub fn read_radiosity(evaluator: &mut dyn DeviceEvaluator, progress: &dyn Progress) -> Result<Vec<DVec3>> {
    evaluator.update(progress)?;
    progress.start("read back", 0);
    let buffer = evaluator.radiosity_buffer();
    let bytes = evaluator.device().read(buffer, buffer.size())?;
    let values: &[[f32; 4]] = &bytemuck::pod_collect_to_vec(&bytes);
    let scale = evaluator.scale();
    let of = |&receiver: &u32| match values.get(receiver as usize) {
        Some(&[r, g, b, _]) => glam::Vec3::new(r, g, b).as_dvec3() * scale,
        None => DVec3::ZERO,
    };
    let radiosity = evaluator.receiver_of_vertex().iter().map(of).collect();
    progress.finish();
    Ok(radiosity)
}
