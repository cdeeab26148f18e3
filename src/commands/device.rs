//! The device on which an evaluator computes.

use clap::ValueEnum;

use super::console::Console;
use crate::error::Result;
use crate::evaluate::Evaluator;

/// The processor or an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum DeviceArg {
    /// Processor
    Cpu,
    /// Compute shaders of a graphics adapter
    Gpu,
}

impl DeviceArg {
    /// Moves an evaluator to the device.
    pub(super) fn place(self, evaluator: Box<dyn Evaluator>, console: &Console) -> Result<Box<dyn Evaluator>> {
        match self {
            Self::Cpu => Ok(evaluator),
            Self::Gpu => on_adapter(evaluator, console),
        }
    }
}

#[cfg(feature = "gpu")]
fn on_adapter(evaluator: Box<dyn Evaluator>, console: &Console) -> Result<Box<dyn Evaluator>> {
    let device = console.stage("device", crate::evaluate::device::Device::open)?;
    console.note(&format!("DEVICE {}", device.describe()));
    let evaluator = console.stage("upload", || evaluator.on_device(&device))?;
    Ok(evaluator)
}

#[cfg(not(feature = "gpu"))]
fn on_adapter(_evaluator: Box<dyn Evaluator>, _console: &Console) -> Result<Box<dyn Evaluator>> {
    Err(crate::error::Error::unsupported(
        "--device gpu: this program was built without the feature `gpu`; use --device cpu, or build with --features gpu",
    ))
}
