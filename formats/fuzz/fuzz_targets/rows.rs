//! Sections of irradiance rows that hold what the fuzzer wants: an error, or rows that are valid, write, and read back
//! equal, with the places that the specification gives. The input is (patches, terms, length u16 and bytes of each section).
#![no_main]

use libfuzzer_sys::fuzz_target;
use translux_format::rows::{FACES, IrradianceRows, tags};
use translux_format::{Codec, Kind, RawSection};

/// Takes a length and that many bytes off the front, fewer at the end.
fn take<'a>(input: &mut &'a [u8]) -> &'a [u8] {
    let [low, high, rest @ ..] = *input else { return &[] };
    let (bytes, rest) = rest.split_at(rest.len().min(usize::from(u16::from_le_bytes([*low, *high]))));
    *input = rest;
    bytes
}

/// Whole numbers only: what is left over is dropped.
fn words<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> {
    bytes.as_chunks::<N>().0.iter().copied()
}

fn sections(mut input: &[u8], size: [u32; 2]) -> Vec<RawSection> {
    let kind = Kind::Environment;
    let section = |tag, bytes: &[u8]| RawSection::from_rows(tag, kind, Codec::Zstd, bytes);
    let counts: Vec<u16> = words(take(&mut input)).map(u16::from_le_bytes).collect();
    let places = section(tags::INDICES, take(&mut input));
    let values: Vec<i8> = take(&mut input).iter().map(|byte| *byte as i8).collect();
    let steps: Vec<f32> = words(take(&mut input)).map(f32::from_le_bytes).collect();
    let scaling = section(tags::SCALING, take(&mut input));
    let scaling_steps: Vec<f32> = words(take(&mut input)).map(f32::from_le_bytes).collect();
    let functions: Vec<f64> = words(take(&mut input)).map(f64::from_le_bytes).collect();
    vec![
        RawSection::from_rows(tags::DIMENSIONS, kind, Codec::Zstd, &[size]),
        RawSection::from_rows(tags::COUNTS, kind, Codec::Zstd, &counts),
        places,
        RawSection::from_rows(tags::VALUES, kind, Codec::Zstd, &values),
        RawSection::from_rows(tags::STEPS, kind, Codec::Zstd, &steps),
        scaling,
        RawSection::from_rows(tags::SCALING_STEPS, kind, Codec::Zstd, &scaling_steps),
        RawSection::from_scalars(tags::FUNCTIONS, kind, Codec::Zstd, 9, &functions),
    ]
}

/// Makes the lengths of the sections fit each other, so that the fuzzer gets past them.
fn fit(sections: &mut [RawSection], patches: usize, terms: usize) {
    let mut set = |tag, length: usize| {
        let section = sections.iter_mut().find(|section| section.tag == tag);
        section.map_or(0, |section| {
            section.bytes.resize(length, 0);
            words(&section.bytes).map(|count| usize::from(u16::from_le_bytes(count))).sum()
        })
    };
    let details = set(tags::COUNTS, 2 * patches);
    set(tags::INDICES, 2 * details);
    set(tags::VALUES, details * terms);
    set(tags::STEPS, 4 * patches);
    set(tags::SCALING, 2 * FACES * terms * patches);
    set(tags::SCALING_STEPS, 4 * patches);
    set(tags::FUNCTIONS, 72 * terms);
}

/// The places one after the other, as the specification has them.
fn check_places(rows: &IrradianceRows, sections: &[RawSection]) {
    let Some(section) = sections.iter().find(|section| section.tag == tags::INDICES) else { return };
    let (low, high) = section.bytes.split_at(section.bytes.len() / 2);
    for pair in rows.offsets.windows(2) {
        let mut next = 0;
        for i in pair[0] as usize..pair[1] as usize {
            let place = next + u64::from(low[i]) + 256 * u64::from(high[i]);
            assert_eq!(u64::from(rows.indices[i]), place);
            next = place + 1;
        }
    }
}

fn check(sections: &[RawSection], patches: usize) {
    let Ok(Some(rows)) = IrradianceRows::from_sections(sections, patches) else { return };
    rows.validate().expect("what decodes is valid");
    check_places(&rows, sections);
    let written = rows.to_sections().expect("what decodes can be written");
    // Bits, because -0.0 and 0.0 are equal.
    assert!(written == sections, "what is written is what was read");
    let back = IrradianceRows::from_sections(&written, patches).expect("what is written decodes");
    assert!(back.is_some_and(|back| back == rows));
}

fuzz_target!(|input: &[u8]| {
    let [patches, side, terms, rest @ ..] = input else { return };
    let (patches, side, terms) = (usize::from(*patches % 8), 1 << (side % 8), u32::from(*terms % 6));
    let mut sections = sections(rest, [side, terms]);
    check(&sections, patches);
    fit(&mut sections, patches, terms as usize);
    check(&sections, patches);
});
