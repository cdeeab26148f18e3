//! `quantised_lights`: radiosity under a quantised set of lights at reference points; any light is interpolated from the set (Hao &
//! Varshney 2004).

mod bake;
mod evaluate;
mod light_set;
mod sections;
mod seen;
mod settings;

pub use bake::{TUNING, chosen};
pub use light_set::LightSet;
pub use seen::{Seen, irradiance_of_seen, neighbours, radiosity_of_set};
pub use settings::{LightSetSettings, MOST_DIRECTIONS, MOST_SHELLS, QuantisedLights};
