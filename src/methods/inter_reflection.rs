//! The keys of inter-reflection outside the medium.

use std::collections::BTreeMap;

use super::settings::number;
use crate::error::{Error, Result};
use crate::evaluate::Key;
use crate::evaluate::inter_reflection::Outside;
use crate::transport::interreflection::{InterReflection, LEAST_RAYS, MOST_RAYS};
use crate::transport::scene::Scene;

/// Whether light is followed outside, and how often.
pub(in crate::methods) const INTER_REFLECTION: Key = Key {
    name: "inter-reflection",
    default: "off",
    help: "light that leaves the surface and falls on it again from outside the medium, to be transferred again: off, once, \
           or a number of times from 1 to 16; each costs a transfer more",
};

/// Most times; of what is sent out a hundredth comes back 16 times only where almost nothing is absorbed or escapes.
const MOST_TIMES: u32 = 16;

/// How many rays look for it.
pub(in crate::methods) const fn rays(default: &'static str) -> Key {
    Key {
        name: "inter-reflection-rays",
        default,
        help: "rays of a sample that look for surfaces whose light falls on it, a power of two",
    }
}

/// What the keys describe.
///
/// # Errors
/// Command line: values out of range.
pub(in crate::methods) fn outside(values: &BTreeMap<String, String>, rays: &Key) -> Result<Option<Outside>> {
    let count = number(values, rays, LEAST_RAYS..=MOST_RAYS)?;
    if !count.is_power_of_two() {
        return Err(Error::command_line(format!("--set {}={count}: a power of two is needed", rays.name)));
    }
    let times = match values.get(INTER_REFLECTION.name).map_or(INTER_REFLECTION.default, String::as_str) {
        "off" => return Ok(None),
        "once" => 1,
        other => match other.trim().parse() {
            Ok(times) if (1..=MOST_TIMES).contains(&times) => times,
            _ => {
                let name = INTER_REFLECTION.name;
                return Err(Error::command_line(format!(
                    "--set {name}={other}: it is off, once or a number of times from 1 to {MOST_TIMES}"
                )));
            }
        },
    };
    Ok(Some(Outside { times, rays: count }))
}

/// Bytes that it takes at run time at most; nothing for values that are refused.
pub(in crate::methods) fn memory(scene: &Scene, samples: usize, values: &BTreeMap<String, String>, rays: &Key) -> u64 {
    let followed = outside(values, rays).ok().flatten();
    followed.map_or(0, |o| InterReflection::most_bytes(samples, o.rays, scene.mesh.triangles.len()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const RAYS: Key = rays("64");

    fn of(pairs: &[(&str, &str)]) -> Result<Option<Outside>> {
        outside(&pairs.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect(), &RAYS)
    }

    #[test]
    fn keys_mean_what_they_say() {
        assert_eq!(of(&[]).unwrap(), None);
        for (value, times) in [("once", 1), ("1", 1), ("16", 16)] {
            assert_eq!(of(&[("inter-reflection", value)]).unwrap(), Some(Outside { times, rays: 64 }));
        }
        let both = [("inter-reflection", "once"), ("inter-reflection-rays", "1024")];
        assert_eq!(of(&both).unwrap(), Some(Outside { times: 1, rays: 1024 }));
        for bad in ["", "0", "17", "twice", "-1", "1.5"] {
            assert!(of(&[("inter-reflection", bad)]).unwrap_err().message().contains("off, once"), "{bad}");
        }
        for bad in ["", "0", "4", "48", "2048"] {
            // Checked even where nothing is followed.
            assert!(of(&[("inter-reflection-rays", bad)]).is_err(), "{bad}");
        }
    }
}
