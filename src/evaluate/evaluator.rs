//! The traits of an asset at run time: lights in, radiosity out, on the CPU or on a device.

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
    /// The edits that are allowed.
    fn capabilities(&self) -> Capabilities;

    /// Size of what the evaluator holds.
    fn cost(&self) -> Cost;

    /// The scene that the asset describes, with the media in force.
    fn scene(&self) -> &Scene;

    /// Ray-tracing hierarchy of the scene's occluders, which also serves drawing.
    fn bvh(&self) -> &Bvh;

    /// Replaces the lights.
    ///
    /// # Errors
    /// Lights that the asset does not carry (`Unsupported`).
    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()>;

    /// Replaces the lights by the same ones that have moved, as in an animation. What is as it was may be kept, so that radiosity may depend on the
    /// lights before; [`Self::set_lights`] forgets them.
    ///
    /// # Errors
    /// As [`Self::set_lights`].
    fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.set_lights(lights, progress)
    }

    /// Replaces the media, one for each of the scene's.
    ///
    /// # Errors
    /// `Unsupported` where the material is baked in or out of the asset's range.
    fn set_media(&mut self, media: Vec<Medium>) -> Result<()>;

    /// Puts another radial profile in the dipole's place, for the media in force and those to come.
    ///
    /// # Errors
    /// `Unsupported` where the transport is that of a dipole; errors of the profile for the media.
    fn set_profile(&mut self, _profile: LoadedProfile) -> Result<()> {
        Err(Error::unsupported(
            "the transport in this asset is that of dipoles; an asset of --method editable stores none and takes any profile",
        ))
    }

    /// Spends memory and time now, so that later edits of the media under one light are fast. The sums may become
    /// coarser, by far less than the error that was asked for.
    fn prepare_for_edits(&mut self, _progress: &dyn Progress) {}

    /// Keeps, of so many lights that were set last, what does not depend on the media: where the same lights come in turn in one material after
    /// the other, rays towards each are cast once. The radiosity stays what it is.
    fn remember_lights(&mut self, _count: usize) {}

    /// Lets new media answer at once, by what is known of them without long work; [`Self::refine`] brings the rest.
    fn answer_at_once(&mut self) {}

    /// Takes what work in the background has brought since the media changed, and starts that work where it is missing.
    ///
    /// # Errors
    /// Failures of the work.
    fn refine(&mut self) -> Result<Refined> {
        Ok(Refined::Done)
    }

    /// Radiosity of every source vertex, RGB; zero for vertices without transferring area. As an [`Exitance`] it is
    /// linear over each triangle.
    ///
    /// # Errors
    /// Failures of the work.
    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>>;

    /// [`Self::radiosity`] of some source vertices, in their order, for as little work as that takes.
    ///
    /// # Errors
    /// Failures of the work.
    fn radiosity_of(&mut self, vertices: &[u32], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let all = self.radiosity(progress)?;
        Ok(vertices.iter().map(|&vertex| all.get(vertex as usize).copied().unwrap_or_default()).collect())
    }

    /// Single scattering of every source vertex along the inverse normal, isotropic, RGB: `s = pi C L1 / F_t(w_o)`, in
    /// the unit of the radiosity and beside it (never part of it), in its order and with its welds. None where the
    /// method or the asset has none, or none that an eye would not change.
    ///
    /// # Errors
    /// Failures of the work.
    fn single_scattering(&mut self, _progress: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        Ok(None)
    }

    /// The place of single scattering, without the work of computing it.
    fn single_scattering_is(&self) -> SingleScattering {
        SingleScattering::None
    }

    /// Single scattering under the lights and media in force as seen by an eye, where it differs from
    /// [`Self::single_scattering`].
    ///
    /// # Errors
    /// Failures of the work.
    fn towards_eye(&self) -> Result<Option<Box<dyn TowardsEye + '_>>> {
        Ok(None)
    }

    /// Sets the position of the eye, mm, for light that leaves the surface towards it alone. Returns whether
    /// [`Self::radiosity`] depends on it.
    fn set_eye(&mut self, _at_mm: DVec3) -> bool {
        false
    }

    /// Prepares [`Self::exitance_at_points`] until lights or media change. Only forms that gather from samples at run
    /// time support it.
    ///
    /// # Errors
    /// `Unsupported` where transport ends at the vertices that it was computed for; failures of the work.
    fn prepare_points(&mut self, _progress: &dyn Progress) -> Result<()> {
        Err(Error::unsupported(
            "the transport in this asset ends at its own vertices; an asset of --method editable stores none and serves any point of the \
             surface and other meshes, as those of two_pass, reference and texture_space do",
        ))
    }

    /// Exitance at any point of the parts under the lights and media in force, after [`Self::prepare_points`];
    /// otherwise none.
    fn exitance_at_points(&self) -> Option<Box<dyn Exitance + '_>> {
        None
    }

    /// The evaluator's own error for the lights and media in force, by stage, measured on vertices that no choice saw.
    /// Stages that were tuned for these lights are measured under the `unseen` ones as well.
    ///
    /// # Errors
    /// Failures of the work.
    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger>;

    /// Radiosity of every source vertex under the lights and media in force, RGB, from all pairs of the evaluator's
    /// samples, the near field integrated as finely as in the truth. The difference from it is the error of the
    /// evaluator's transport.
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

/// How far the work in the background is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refined {
    /// There is none.
    Done,
    /// It goes on.
    Working,
    /// It is done and has changed the radiosity.
    Changed,
}

/// An evaluator whose radiosity lies in the memory of a device, to be drawn there.
#[cfg(feature = "gpu")]
pub trait DeviceEvaluator: Evaluator {
    /// Brings the buffer up to date with the lights and the media in force. Its commands are enqueued before later
    /// submissions.
    ///
    /// # Errors
    /// Failures of the work, a lost device among them.
    fn update(&mut self, progress: &dyn Progress) -> Result<()>;

    /// The radiosity and where it lies.
    fn held(&self) -> Held<'_>;

    /// Where the transport is computed, in words.
    fn transport(&self) -> String {
        self.held().device.describe()
    }

    /// Updates the buffer and reads back the radiosity of every source vertex, for [`Evaluator::radiosity`].
    ///
    /// # Errors
    /// As [`Self::update`].
    fn read_back(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.update(progress)?;
        progress.start("read back", 0);
        let Held { device, radiosity, scale, receiver_of_vertex } = self.held();
        let bytes = device.read(radiosity, radiosity.size())?;
        let values: &[[f32; 4]] = &bytemuck::pod_collect_to_vec(&bytes);
        let of = |&receiver: &u32| match values.get(receiver as usize) {
            Some(&[r, g, b, _]) => glam::Vec3::new(r, g, b).as_dvec3() * scale,
            None => DVec3::ZERO,
        };
        let radiosity = receiver_of_vertex.iter().map(of).collect();
        progress.finish();
        Ok(radiosity)
    }
}

/// Radiosity in the memory of a device.
#[cfg(feature = "gpu")]
pub struct Held<'a> {
    /// The device.
    pub device: &'a Arc<Device>,
    /// Radiosity of every receiver over the scale, four floats each (RGB and 0); the same buffer as long as the
    /// evaluator lives. It stands for [`Exitance`] where a device draws, which interpolates it between the vertices.
    pub radiosity: &'a wgpu::Buffer,
    /// Factor from the buffer's values to radiosity: a power of two that keeps them in the range of single precision.
    /// May change with every update.
    pub scale: f64,
    /// Receiver of each source vertex; `u32::MAX` for vertices that have none, whose radiosity is 0.
    pub receiver_of_vertex: &'a [u32],
}
