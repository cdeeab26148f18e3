//! Any bytes: decode, and what decodes is valid, writes, and reads back equal. Once as they are and once with the
//! checksums made right, so that the fuzzer gets past them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use translux_format::{AssetFile, Budget, Reader, scan};

#[path = "../../tests/common/mod.rs"]
mod common;

const BUDGET: Budget = Budget::bytes(16 << 20);

fn check(bytes: &[u8]) {
    if let Ok(reader) = Reader::parse(bytes, BUDGET) {
        for section in reader.sections() {
            let decoded = reader.bytes(section.tag);
            assert!(decoded.is_err() || decoded.is_ok_and(|bytes| bytes.len() as u64 == section.decoded_bytes));
        }
    }
    let result = AssetFile::from_bytes(bytes, BUDGET);
    let found = scan(bytes, BUDGET);
    match &result {
        Ok(asset) => assert_eq!(found.into_asset().as_ref(), Some(asset)),
        Err(error) => assert!(found.errors.contains(error)),
    }
    if let Ok(asset) = result {
        let written = asset.to_bytes().expect("what decodes can be written");
        assert_eq!(AssetFile::from_bytes(&written, Budget::default()).as_ref(), Ok(&asset));
        assert_eq!(asset.to_bytes().as_ref(), Ok(&written));
    }
}

fuzz_target!(|bytes: &[u8]| {
    check(bytes);
    let mut sealed = bytes.to_vec();
    if sealed.len() >= 32 {
        sealed[0..8].copy_from_slice(&translux_format::MAGIC);
        let length = sealed.len() as u64;
        sealed[16..24].copy_from_slice(&length.to_le_bytes());
        common::seal(&mut sealed);
        check(&sealed);
    }
});
