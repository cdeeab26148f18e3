//! Times of the shaders, where there is an adapter to be timed.

use super::{DeviceArg, Extent};
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::measure::chart::DeviceRow;

/// What is timed beside the processor.
pub(super) struct Adapter {
    #[cfg(feature = "gpu")]
    device: Option<std::sync::Arc<crate::evaluate::device::Device>>,
}

#[cfg(feature = "gpu")]
impl Adapter {
    /// Looks for one.
    ///
    /// # Errors
    /// None, where one was asked for (exit 5).
    pub(super) fn open(wanted: DeviceArg) -> Result<Self> {
        use crate::evaluate::device::Device;
        let device = match wanted {
            DeviceArg::Cpu => None,
            DeviceArg::Gpu => Some(Device::open()?),
            DeviceArg::Auto => Device::open().ok().filter(|device| !device.is_software()),
        };
        Ok(Self { device })
    }

    /// Times a method whose evaluator `open` makes; none without an adapter.
    pub(super) fn row(
        &self,
        open: impl Fn() -> Result<Box<dyn Evaluator>>,
        lights: &[(String, Light)],
        extent: &Extent,
    ) -> Result<Option<DeviceRow>> {
        use crate::error::ExitCode;
        use crate::evaluate::MaterialEdit;
        use crate::math::statistics::Quantiles;
        use crate::progress::Silent;
        use std::time::Instant;
        let Some(device) = &self.device else { return Ok(None) };
        let mut evaluator = match open()?.on_device(device) {
            Ok(evaluator) => evaluator,
            // What the paper stores may have no shaders.
            Err(error) if error.code() == ExitCode::Unsupported => return Ok(None),
            Err(error) => return Err(error),
        };
        let mut times = Vec::new();
        for (_, light) in lights {
            let begun = Instant::now();
            for repeat in 0..extent.repeats {
                if repeat > 0 && begun.elapsed().as_secs_f64() > extent.patience {
                    break;
                }
                let started = Instant::now();
                evaluator.set_lights(vec![light.clone()], &Silent)?;
                evaluator.update(&Silent)?;
                device.wait()?;
                times.push(1e3 * started.elapsed().as_secs_f64());
            }
        }
        let mut edits = Vec::new();
        if evaluator.capabilities().material != MaterialEdit::None {
            let before = evaluator.scene().media.clone();
            let other: Vec<_> = before.iter().map(super::row::edited).collect();
            for media in [&other, &before].into_iter().cycle().take(2 * extent.repeats.div_ceil(2)) {
                let started = Instant::now();
                evaluator.set_media(media.clone())?;
                evaluator.update(&Silent)?;
                device.wait()?;
                edits.push(1e3 * started.elapsed().as_secs_f64());
            }
        }
        Ok(Some(DeviceRow {
            adapter: device.describe(),
            relight_ms: Quantiles::of(times),
            edit_ms: (!edits.is_empty()).then(|| Quantiles::of(edits)),
        }))
    }
}

#[cfg(not(feature = "gpu"))]
impl Adapter {
    /// There is none in a build without shaders.
    ///
    /// # Errors
    /// One was asked for (exit 5).
    pub(super) fn open(wanted: DeviceArg) -> Result<Self> {
        match wanted {
            DeviceArg::Auto | DeviceArg::Cpu => Ok(Self {}),
            DeviceArg::Gpu => Err(crate::error::Error::unsupported(
                "--device gpu: this program was built without the feature `gpu`; use --device cpu",
            )),
        }
    }

    /// None.
    pub(super) fn row(
        &self,
        _open: impl Fn() -> Result<Box<dyn Evaluator>>,
        _lights: &[(String, Light)],
        _extent: &Extent,
    ) -> Result<Option<DeviceRow>> {
        Ok(None)
    }
}
