//! Times of the shaders, where there is an adapter.

use super::timing::Repetitions;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::measure::chart::DeviceRow;
use crate::relight::choice::DeviceChoice;

/// The graphics adapter that is timed beside the processor, if any.
pub(super) struct Adapter {
    #[cfg(feature = "gpu")]
    device: Option<std::sync::Arc<crate::evaluate::device::Device>>,
}

#[cfg(feature = "gpu")]
impl Adapter {
    /// Looks for an adapter.
    ///
    /// # Errors
    /// No adapter, where one was asked for (exit 5).
    pub(super) fn open(wanted: DeviceChoice) -> Result<Self> {
        use crate::evaluate::device::Device;
        let device = match wanted {
            DeviceChoice::Cpu => None,
            DeviceChoice::Gpu => Some(Device::open()?),
            DeviceChoice::Auto => Device::open().ok().filter(|device| !device.is_software()),
        };
        Ok(Self { device })
    }

    /// Times a method, whose evaluator `open` makes; none without an adapter.
    pub(super) fn row(
        &self,
        open: impl Fn() -> Result<Box<dyn Evaluator>>,
        lights: &[(String, Light)],
        repetitions: Repetitions,
    ) -> Result<Option<DeviceRow>> {
        use crate::error::ExitCode;
        use crate::math::statistics::Quantiles;
        use crate::progress::Silent;
        let Some(device) = &self.device else { return Ok(None) };
        let mut evaluator = match open()?.on_device(device) {
            Ok(evaluator) => evaluator,
            // What the paper stores may have no shaders.
            Err(error) if error.code() == ExitCode::Unsupported => return Ok(None),
            Err(error) => return Err(error),
        };
        let mut times = Vec::new();
        for (_, light) in lights {
            times.extend(repetitions.times(|| {
                evaluator.set_lights(vec![light.clone()], &Silent)?;
                evaluator.update(&Silent)?;
                device.wait()
            })?);
        }
        let edit_ms = repetitions.edits(evaluator.as_mut(), |evaluator| {
            evaluator.update(&Silent)?;
            device.wait()
        })?;
        Ok(Some(DeviceRow { adapter: device.describe(), relight_ms: Quantiles::of(times), edit_ms }))
    }
}

#[cfg(not(feature = "gpu"))]
impl Adapter {
    /// An adapter for a build without shaders: there is none.
    ///
    /// # Errors
    /// An adapter was asked for (exit 5).
    pub(super) fn open(wanted: DeviceChoice) -> Result<Self> {
        match wanted {
            DeviceChoice::Auto | DeviceChoice::Cpu => Ok(Self {}),
            DeviceChoice::Gpu => Err(crate::error::Error::unsupported(
                "--device gpu: this program was built without the feature `gpu`; use --device cpu",
            )),
        }
    }

    /// No times.
    pub(super) fn row(
        &self,
        _open: impl Fn() -> Result<Box<dyn Evaluator>>,
        _lights: &[(String, Light)],
        _repetitions: Repetitions,
    ) -> Result<Option<DeviceRow>> {
        Ok(None)
    }
}
