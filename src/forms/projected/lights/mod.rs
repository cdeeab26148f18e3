//! `quantised_lights`: radiosity under a quantised set of lights at reference points; any light is interpolated from the set (Hao &
//! Varshney 2004).

mod bake;
mod evaluate;
mod light_set;
mod seen;
mod settings;

pub use self::bake::{TUNING, chosen};
pub use self::light_set::LightSet;
pub(crate) use self::light_set::parallel;
pub use self::seen::{Seen, irradiance_of_seen, neighbours, radiosity_of_set};
pub use self::settings::{LightSetSettings, MOST_DIRECTIONS, MOST_SHELLS, QuantisedLights};
