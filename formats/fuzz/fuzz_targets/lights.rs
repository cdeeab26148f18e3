//! Sections of quantised lights, of quantised values and of distant light in harmonics that hold what the fuzzer wants: an error, or content that is valid,
//! writes, and reads back equal; and coded coefficients that decode to an error or to what encodes again. The input is a run of
//! (length u16, bytes) for each section in the order of the tags.
#![no_main]

use libfuzzer_sys::fuzz_target;
use translux_format::distant_transport::{self, DistantTransport};
use translux_format::quantised_lights::{QuantisedLights, tags};
use translux_format::quantised_values::{self, QuantisedValues};
use translux_format::{Budget, Codec, ElementType, Kind, RawSection, Tag, coefficients};

/// Takes a length and that many bytes off the front, fewer at the end.
fn take<'a>(input: &mut &'a [u8]) -> &'a [u8] {
    let [low, high, rest @ ..] = *input else { return &[] };
    let (bytes, rest) = rest.split_at(rest.len().min(usize::from(u16::from_le_bytes([*low, *high]))));
    *input = rest;
    bytes
}

/// A section of each tag that has bytes left, of the type and the size that its tag has.
fn sections(input: &mut &[u8], tags: &[(Tag, ElementType, usize)]) -> Vec<RawSection> {
    let section = |&(tag, element, size): &(Tag, ElementType, usize)| {
        let bytes = take(input);
        let whole = bytes.len() / size * size;
        let bytes = bytes[..whole].to_vec();
        RawSection { tag, kind: Kind::Method, codec: Codec::Raw, element, components: 1, bytes }
    };
    tags.iter().map(section).filter(|section| !section.bytes.is_empty()).collect()
}

const RECORD: (ElementType, usize) = (ElementType::Record, 1);
const F32: (ElementType, usize) = (ElementType::F32, 4);
const U16: (ElementType, usize) = (ElementType::U16, 2);
const U8: (ElementType, usize) = (ElementType::U8, 1);

/// Types of `quantised_lights::tags::Set` and of `quantised_values::tags::ALL`.
const OF_A_SET: [(ElementType, usize); 5] = [F32, F32, U8, U16, U8];
const OF_VALUES: [(ElementType, usize); 8] = [RECORD, F32, F32, U8, F32, U8, U8, U8];
/// Types of `distant_transport::tags::ALL`: the record and the set of all light, then of light that is scattered once.
const OF_DISTANT: [(ElementType, usize); 12] = [RECORD, F32, F32, U8, U16, U8, RECORD, F32, F32, U8, U16, U8];

/// Rows of distant light that none has.
const VERTICES: usize = 4;

fuzz_target!(|input: &[u8]| {
    let mut rest = input;
    let typed = |(tag, (element, size)): (Tag, (ElementType, usize))| (tag, element, size);
    let mut all = vec![typed((tags::NUMBERS, RECORD))];
    all.extend(tags::SETS.into_iter().flat_map(|set| set.all().into_iter().zip(OF_A_SET)).map(typed));
    if let Ok(Some(lights)) = QuantisedLights::from_sections(&sections(&mut rest, &all)) {
        let written = lights.to_sections().expect("what decodes can be written");
        assert!(QuantisedLights::from_sections(&written).expect("what is written decodes") == Some(lights));
    }
    let values: Vec<_> = quantised_values::tags::ALL.into_iter().zip(OF_VALUES).map(typed).collect();
    if let Ok(Some(values)) = QuantisedValues::from_sections(&sections(&mut rest, &values)) {
        let written = values.to_sections().expect("what decodes can be written");
        assert!(QuantisedValues::from_sections(&written).expect("what is written decodes") == Some(values));
    }
    let distant: Vec<_> = distant_transport::tags::ALL.into_iter().zip(OF_DISTANT).map(typed).collect();
    if let Ok(Some(distant)) = DistantTransport::from_sections(&sections(&mut rest, &distant), VERTICES) {
        let written = distant.to_sections().expect("what decodes can be written");
        assert!(DistantTransport::from_sections(&written, VERTICES).expect("what is written decodes") == Some(distant));
    }
    let tag = tags::SETS[0].coefficients;
    if let Ok(found) = coefficients::decode(tag, rest, None, Budget::default()) {
        let again = coefficients::encode(tag, found.rows, found.columns, &found.values, None).expect("it encodes");
        let back = coefficients::decode(tag, &again, None, Budget::default()).expect("what is written decodes");
        assert!(back.values == found.values);
    }
});
