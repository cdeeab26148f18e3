//! Texture space: the numbers beside the atlas.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{invalid, samples};
use crate::error::Result;
use crate::types::{Codec, Kind};

/// Tags of texture space.
pub mod tags {
    use crate::types::Tag;

    /// Numbers, a record.
    pub const NUMBERS: Tag = Tag::from_static("tex.rec");

    /// All tags, in the order of the file.
    pub const ALL: [Tag; 1] = [NUMBERS];
}

/// Least and largest number of texels along an edge.
const RESOLUTIONS: std::ops::RangeInclusive<u32> = 16..=4096;

/// Largest number of samples of a receiver.
const MOST_COUNT: u32 = 1 << 20;

/// Numbers of an asset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Numbers {
    /// Texels along each edge of the texture, a power of two.
    pub resolution: u32,
    /// Samples of each receiver.
    pub count: u32,
    /// Number of surface samples against which errors are measured.
    pub truth_samples: u32,
}

fn validate(numbers: &Numbers) -> Result<()> {
    let Numbers { resolution, count, truth_samples } = *numbers;
    samples(tags::NUMBERS, truth_samples)?;
    match resolution.is_power_of_two()
        && RESOLUTIONS.contains(&resolution)
        && (1..=MOST_COUNT).contains(&count)
        && truth_samples > 0
    {
        true => Ok(()),
        false => invalid(tags::NUMBERS, format!("{resolution} texels, {count} and {truth_samples} samples")),
    }
}

/// The section of valid numbers.
///
/// # Errors
/// [`crate::FormatError::Invalid`].
pub fn to_section(numbers: &Numbers) -> Result<RawSection> {
    validate(numbers)?;
    RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, numbers)
}

/// Reads the numbers among the sections of an asset; `None` where there are none.
///
/// # Errors
/// Any fault of their type or content.
pub fn from_sections(sections: &[RawSection]) -> Result<Option<Numbers>> {
    let Some([section]) = pick(sections, tags::ALL, Kind::Method)? else { return Ok(None) };
    let numbers = section.record()?;
    validate(&numbers)?;
    Ok(Some(numbers))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn numbers_survive_and_others_are_refused() {
        let numbers = Numbers { resolution: 256, count: 400, truth_samples: 32_768 };
        assert_eq!(from_sections(&[to_section(&numbers).unwrap()]).unwrap(), Some(numbers));
        assert_eq!(from_sections(&[]).unwrap(), None);
        for wrong in [
            Numbers { resolution: 300, ..numbers },
            Numbers { resolution: 8, ..numbers },
            Numbers { resolution: 8192, ..numbers },
            Numbers { count: 0, ..numbers },
            Numbers { truth_samples: 0, ..numbers },
        ] {
            assert!(to_section(&wrong).is_err(), "{wrong:?}");
            let section = RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, &wrong).unwrap();
            assert!(from_sections(&[section]).is_err(), "{wrong:?}");
        }
    }
}
