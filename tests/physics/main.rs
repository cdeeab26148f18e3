//! The library: transport, methods, pictures and shaders against what is known and against separate truths. One binary, so that it
//! is linked once; a module for each matter.
#![allow(clippy::unwrap_used, missing_docs)]

#[path = "../common/mod.rs"]
mod common;
#[path = "../in_memory/mod.rs"]
mod in_memory;
#[cfg(feature = "gpu")]
#[path = "../on_device/mod.rs"]
mod on_device;
#[path = "../oracle/mod.rs"]
mod oracle;
#[path = "../rendering/mod.rs"]
mod rendering;

mod all_frequency;
mod all_frequency_single;
mod baked;
mod flip;
mod gpu_quantized_lights;
mod gpu_transport;
mod inter_reflection;
mod ledger;
mod oracle_agreement;
mod oracle_selfcheck;
mod profiles;
mod quantized_lights;
mod quantized_point_lights;
mod random_walk;
mod relight;
mod render;
mod single_scattering;
mod source_fields;
mod specular;
mod straight;
mod texture;
mod truth;
