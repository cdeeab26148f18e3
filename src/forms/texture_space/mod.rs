//! `texture_space`: irradiance is gathered in the texels of an atlas and summed from few samples of them (Chang et al. 2008). Nothing
//! about light, material or size is stored: the asset holds the atlas alone.
//!
//! The texels cut the surface exactly: light arrives at the patches of each texel, a hierarchy over the texels holds
//! their flux. The paper draws N samples from it that all receivers share; by default each group of receivers descends it on
//! its own, to the clusters that matter to it.

mod bake;
mod carried;
mod descent;
#[cfg(feature = "gpu")]
mod device;
mod errors;
mod evaluate;
mod falloff;
mod forecast;
mod form;
mod hybrid;
mod kept;
mod light;
mod map;
mod samples;
mod settings;
mod state;
mod view;

pub use settings::{Far, Local, Sampling, TextureSpace};

#[cfg(test)]
mod tests;
