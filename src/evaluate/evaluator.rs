//! The traits of what an asset is at run time: lights in, radiosity out, on the CPU or on a device.

#[cfg(feature = "gpu")]
use std::sync::Arc;

use glam::DVec3;

use super::capabilities::{Capabilities, Cost, SingleScattering};
#[cfg(feature = "gpu")]
use super::device::adapter::Device;
use super::exitance::Exitance;
use super::single_scattering::TowardsEye;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;
use crate::scene::Scene;

/// An asset at run time: lights in, radiosity out. Linear in the lights.
pub trait Evaluator: Send {
    /// What may change.
    fn capabilities(&self) -> Capabilities;

    /// Size of what is held.
    fn cost(&self) -> Cost;

    /// The scene that the asset describes, with the media in force.
    fn scene(&self) -> &Scene;

    /// Occluders of the scene, for whoever looks at it.
    fn bvh(&self) -> &Bvh;

    /// Replaces the lights.
    ///
    /// # Errors
    /// Lights that the asset does not carry (`Unsupported`).
    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()>;

    /// Replaces the media, one for each of the scene's.
    ///
    /// # Errors
    /// `Unsupported` where the material is baked in or out of the asset's range.
    fn set_media(&mut self, media: Vec<Medium>) -> Result<()>;

    /// Puts another radial profile in the dipole's place, for the media in force and those to come.
    ///
    /// # Errors
    /// `Unsupported` where the transport is that of a dipole; what the profile says of the media.
    fn set_profile(&mut self, _profile: LoadedProfile) -> Result<()> {
        Err(Error::unsupported(
            "the transport in this asset is that of dipoles; an asset of --method editable stores none and takes any profile",
        ))
    }

    /// Spends memory and time now, so that edits of the media under one light are fast from here on. What is summed may be coarser than
    /// without, by far less than the error that was asked for.
    fn prepare_for_edits(&mut self, _progress: &dyn Progress) {}

    /// Radiosity of every source vertex, RGB; zero for vertices without transferring area. Whoever draws takes it as [`Exitance`] that
    /// is linear over each triangle.
    ///
    /// # Errors
    /// Failures of the work.
    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>>;

    /// Single scattering of every source vertex along the inverse normal, isotropic, RGB: `s = pi C L1 / F_t(w_o)`, in the
    /// unit of the radiosity and beside it (never part of it), in its order and with its welds. None where the method or
    /// the asset has none, or none that an eye would not change.
    ///
    /// # Errors
    /// Failures of the work.
    fn single_scattering(&mut self, _progress: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        Ok(None)
    }

    /// Where single scattering is, without the work of computing it.
    fn single_scattering_is(&self) -> SingleScattering {
        SingleScattering::None
    }

    /// Single scattering under the lights and media in force as eyes see it, where that is more than
    /// [`Self::single_scattering`].
    ///
    /// # Errors
    /// Failures of the work.
    fn towards_eye(&self) -> Result<Option<Box<dyn TowardsEye + '_>>> {
        Ok(None)
    }

    /// Puts the eye somewhere, mm, for what leaves the surface towards it alone; whether that is anything, so that
    /// [`Self::radiosity`] has changed.
    fn set_eye(&mut self, _at_mm: DVec3) -> bool {
        false
    }

    /// Makes ready what [`Self::exitance_at_points`] gives until lights or media change. Only what gathers from samples when it is
    /// evaluated can do so.
    ///
    /// # Errors
    /// `Unsupported` where transport ends at the vertices that it was computed for; failures of the work.
    fn prepare_points(&mut self, _progress: &dyn Progress) -> Result<()> {
        Err(Error::unsupported(
            "the transport in this asset ends at its own vertices; an asset of --method editable stores none and serves other meshes",
        ))
    }

    /// Exitance at any point of the parts under the lights and media in force, after [`Self::prepare_points`]; none without.
    fn exitance_at_points(&self) -> Option<Box<dyn Exitance + '_>> {
        None
    }

    /// What the evaluator measures of its own error for the lights and media in force, on vertices that no choice saw;
    /// what was tuned for these lights is measured under the `unseen` ones as well.
    ///
    /// # Errors
    /// Failures of the work.
    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger>;

    /// Radiosity of every source vertex under the lights and media in force, RGB, as the samples alone would have it: all
    /// pairs, the near field integrated as finely as the truth does. What the evaluator's own transport is off by.
    ///
    /// # Errors
    /// Failures of the work.
    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>>;

    /// The same evaluator with its transport in compute shaders.
    ///
    /// # Errors
    /// `Unsupported` where the method has no shaders, or the adapter no room.
    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, _device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Err(Error::unsupported("this method has no compute shaders; use --device cpu"))
    }
}

/// An evaluator whose radiosity lies in the memory of a device, for whoever draws it there.
#[cfg(feature = "gpu")]
pub trait DeviceEvaluator: Evaluator {
    /// The device.
    fn device(&self) -> &Arc<Device>;

    /// Brings the buffer up to date with the lights and the media in force; what it enqueues comes before later
    /// submissions.
    ///
    /// # Errors
    /// Failures of the work, a lost device among them.
    fn update(&mut self, progress: &dyn Progress) -> Result<()>;

    /// Radiosity of every receiver over [`Self::scale`], four floats each (RGB and 0); the same buffer as long as the
    /// evaluator lives. It stands for [`Exitance`] where a device draws: [`Self::receiver_of_vertex`] takes it to the vertices,
    /// between which the rasteriser interpolates.
    fn radiosity_buffer(&self) -> &wgpu::Buffer;

    /// What the buffer's values are multiplied by: a power of two that keeps them in the range of single precision. May
    /// change with every update.
    fn scale(&self) -> f64;

    /// Receiver of each source vertex; `u32::MAX` for vertices that have none, whose radiosity is 0.
    fn receiver_of_vertex(&self) -> &[u32];

    /// Where the transport is computed, as a person would say it.
    fn transport(&self) -> String;
}
