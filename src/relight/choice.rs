//! Choice of the device for transport and drawing.

#[cfg(feature = "gpu")]
use std::sync::Arc;

use crate::error::Result;
use crate::evaluate::Evaluator;
#[cfg(feature = "gpu")]
use crate::evaluate::{
    DeviceEvaluator,
    device::{Device, Uploaded},
};

/// The device that a user asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum DeviceChoice {
    /// Shaders on a graphics adapter; on a software adapter, transport on the CPU; without any, all on the CPU.
    #[default]
    Auto,
    /// Transport in compute shaders.
    Gpu,
    /// Transport on the CPU.
    Cpu,
}

/// Opens the evaluator again, where a first attempt consumed it.
pub type Open<'a> = &'a dyn Fn() -> Result<Box<dyn Evaluator>>;

/// An evaluator on the CPU or on a device.
pub enum Place {
    /// On the CPU, with pictures drawn there.
    Cpu(Box<dyn Evaluator>),
    /// On a device that draws, with its radiosity there.
    #[cfg(feature = "gpu")]
    Device(Box<dyn DeviceEvaluator>),
}

/// Places the evaluator `first`; `open` makes it again if it is needed once more. Returns it with a note for the user where
/// the device is not the expected one.
///
/// # Errors
/// `Gpu` without an adapter, without shaders for the method or in a build without them (exit 5); those of `open`.
#[cfg(feature = "gpu")]
pub fn place(choice: DeviceChoice, first: Box<dyn Evaluator>, open: Open) -> Result<(Place, Option<String>)> {
    if choice == DeviceChoice::Cpu {
        return Ok((Place::Cpu(first), None));
    }
    match (Device::open(), choice) {
        (Ok(device), _) => {
            let (evaluator, note) = on(&device, choice, first, open)?;
            Ok((Place::Device(evaluator), note))
        }
        (Err(error), DeviceChoice::Gpu) => Err(error),
        (Err(error), _) => {
            let note = Some(format!("{}; pictures are drawn on the CPU", error.message()));
            Ok((Place::Cpu(first), note))
        }
    }
}

/// Places the evaluator in a build without shaders.
///
/// # Errors
/// `Gpu` (exit 5).
#[cfg(not(feature = "gpu"))]
pub fn place(choice: DeviceChoice, first: Box<dyn Evaluator>, _open: Open) -> Result<(Place, Option<String>)> {
    let missing = "this build has no graphics (cargo feature `gpu`)";
    if choice == DeviceChoice::Gpu {
        let message = format!("{missing}; the CPU does the same with --device cpu");
        return Err(crate::error::Error::unsupported(message));
    }
    let note = (choice == DeviceChoice::Auto).then(|| format!("{missing}; pictures are drawn on the CPU"));
    Ok((Place::Cpu(first), note))
}

/// Places the evaluator on a device; with `Cpu`, only its radiosity.
///
/// # Errors
/// `Gpu` without shaders for the method, a mesh that the device has no room for (exit 5); those of `open`.
#[cfg(feature = "gpu")]
pub fn on(
    device: &Arc<Device>,
    choice: DeviceChoice,
    first: Box<dyn Evaluator>,
    open: Open,
) -> Result<(Box<dyn DeviceEvaluator>, Option<String>)> {
    let uploaded =
        |evaluator| -> Result<Box<dyn DeviceEvaluator>> { Ok(Box::new(Uploaded::new(evaluator, Arc::clone(device))?)) };
    match choice {
        DeviceChoice::Cpu => Ok((uploaded(first)?, None)),
        DeviceChoice::Gpu => Ok((first.on_device(device)?, None)),
        // Measured: transport on the CPU is several times as fast as shaders that run there.
        DeviceChoice::Auto if device.is_software() => Ok((uploaded(first)?, None)),
        DeviceChoice::Auto => match first.on_device(device) {
            Ok(evaluator) => Ok((evaluator, None)),
            Err(error) if error.code() == crate::error::ExitCode::Unsupported => {
                Ok((uploaded(open()?)?, Some(format!("{}; transport runs on the CPU", error.message()))))
            }
            Err(error) => Err(error),
        },
    }
}
