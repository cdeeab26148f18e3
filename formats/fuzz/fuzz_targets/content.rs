//! A well-formed container whose common sections hold what the fuzzer wants. The input is a list of
//! (section, offset u16, length u8, that many bytes to put there; an offset beyond the end appends).
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use translux_format::{AssetFile, Budget, RawSection};

#[path = "../../tests/common/mod.rs"]
mod common;

static SECTIONS: LazyLock<Vec<RawSection>> =
    LazyLock::new(|| common::sections_of(&common::full_asset().to_bytes().expect("the handmade asset is valid")));

fuzz_target!(|input: &[u8]| {
    let mut entries: Vec<_> = SECTIONS.iter().map(common::Entry::raw).collect();
    let mut rest = input;
    while let [section, low, high, length, tail @ ..] = rest {
        let (bytes, tail) = tail.split_at(tail.len().min(usize::from(*length)));
        let index = usize::from(*section) % entries.len();
        let stored = &mut entries[index].stored;
        let at = usize::from(u16::from_le_bytes([*low, *high])).min(stored.len());
        let end = (at + bytes.len()).min(stored.len());
        // An empty replacement cuts the section there.
        if bytes.is_empty() {
            stored.truncate(at)
        } else {
            drop(stored.splice(at..end, bytes.iter().copied()))
        }
        entries[index].decoded = entries[index].stored.len() as u64;
        rest = tail;
    }
    if let Ok(asset) = AssetFile::from_bytes(&common::build(&entries), Budget::bytes(16 << 20)) {
        let written = asset.to_bytes().expect("what decodes can be written");
        assert_eq!(AssetFile::from_bytes(&written, Budget::default()).as_ref(), Ok(&asset));
    }
});
