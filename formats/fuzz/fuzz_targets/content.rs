//! A well-formed container whose sections, those of `editable` and of irradiance rows included, hold what the fuzzer
//! wants. The input is a list of (section, offset u16, length u8, that many bytes to put there; an offset beyond the end
//! appends).
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use translux_format::far_field::{FarField, Shape};
use translux_format::profile_basis::ProfileBasis;
use translux_format::rows::IrradianceRows;
use translux_format::{AssetFile, Budget, RawSection, scan};

#[path = "../../tests/common/mod.rs"]
mod common;

static SECTIONS: LazyLock<Vec<RawSection>> =
    LazyLock::new(|| common::sections_of(&common::full_asset_0_1().to_bytes().expect("the handmade asset is valid")));

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
    let file = common::build(&entries);
    let result = AssetFile::from_bytes(&file, Budget::bytes(16 << 20));
    let found = scan(&file, Budget::bytes(16 << 20));
    match &result {
        Ok(_) => assert!(found.errors.is_empty()),
        Err(error) => assert!(found.errors.contains(error)),
    }
    if let Ok(asset) = result {
        let written = asset.to_bytes().expect("what decodes can be written");
        assert_eq!(AssetFile::from_bytes(&written, Budget::default()).as_ref(), Ok(&asset));
        check_method(&asset);
    }
});

/// What the sections of the method hold: an error, or content that writes and reads back equal.
fn check_method(asset: &AssetFile) {
    let shape = Shape::new(asset.mesh.positions_mm.len(), &asset.samples);
    if let Ok(Some(field)) = FarField::from_sections(&asset.extra, &shape) {
        let written = field.to_sections(&shape).expect("what decodes can be written");
        let back = FarField::from_sections(&written, &shape).expect("what is written decodes");
        // Bits, because -0.0 and 0.0 are equal.
        assert_eq!(back.map(|back| back.to_sections(&shape)), Some(Ok(written)));
    }
    if let Ok(Some(basis)) = ProfileBasis::from_sections(&asset.extra) {
        let written = basis.to_sections().expect("what decodes can be written");
        assert_eq!(ProfileBasis::from_sections(&written), Ok(Some(basis)));
    }
    let patches = asset.samples.patch_count();
    if let Ok(Some(rows)) = IrradianceRows::from_sections(&asset.extra, patches) {
        let written = rows.to_sections().expect("what decodes can be written");
        let back = IrradianceRows::from_sections(&written, patches).expect("what is written decodes");
        assert_eq!(back.map(|back| back.to_sections()), Some(Ok(written)));
    }
}
