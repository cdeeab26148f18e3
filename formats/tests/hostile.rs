//! Any bytes give an error or a valid asset, never a panic, and never more memory than the budget.
#![allow(clippy::unwrap_used)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{Entry, Random, build, full_asset, full_asset_0_1, mutate, seal, sections_of};
use translux_format::far_field::{self, FarField, Shape};
use translux_format::profile_basis::{self, ProfileBasis};
use translux_format::rows::{self, IrradianceRows};
use translux_format::{AssetFile, Budget, COMMON_TAGS, FormatError, Reader, Tag, scan};

thread_local! {
    static LIVE: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// Counts the bytes that the current thread holds.
struct Counting;

fn count(change: isize) {
    let live = LIVE.get() + change;
    LIVE.set(live);
    PEAK.set(PEAK.get().max(live));
}

// SAFETY: every call goes to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // A move holds both blocks for a moment.
        count(size as isize);
        count(-(layout.size() as isize));
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const BUDGET: Budget = Budget::bytes(256 << 10);
/// What a reader may take beside its budget (see `Budget`).
const BESIDE: isize = 2 << 20;

/// Runs `work` and checks what memory it took.
fn within<T>(limit: isize, work: impl FnOnce() -> T) -> T {
    let before = LIVE.get();
    PEAK.set(before);
    let result = work();
    let peak = PEAK.get() - before;
    assert!(peak <= limit, "{peak} bytes, {limit} allowed");
    result
}

/// Decodes, and checks what must hold for any bytes.
fn decode(bytes: &[u8]) -> Result<AssetFile, FormatError> {
    let limit = BUDGET.max_decoded_bytes as isize + BESIDE;
    let result = within(limit, || AssetFile::from_bytes(bytes, BUDGET));
    match &result {
        Ok(asset) => {
            asset.validate().unwrap();
            decode_method(asset);
        }
        Err(error) => assert!((1..=21).contains(&error.code()) && !error.to_string().is_empty()),
    }
    if !COUNT.replace(COUNT.get() + 1).is_multiple_of(8) {
        return result;
    }
    // A look at the whole finds at least the error that stopped the reader, and none where there was none.
    let found = within(limit, || scan(bytes, BUDGET));
    match &result {
        Ok(asset) => assert_eq!(found.into_asset().as_ref(), Some(asset)),
        Err(error) => assert!(found.errors.contains(error), "{error} is not among {:?}", found.errors),
    }
    result
}

/// What the sections of the method hold: an error or valid content, within the memory that they promise.
fn decode_method(asset: &AssetFile) {
    let shape = Shape::new(asset.mesh.positions_mm.len(), &asset.samples);
    let total: usize = asset.extra.iter().map(|section| section.bytes.len()).sum();
    let limit = 5 * total as isize + (16 << 10);
    if let Ok(Some(field)) = within(limit, || FarField::from_sections(&asset.extra, &shape)) {
        field.validate(&shape).unwrap();
    }
    if let Ok(Some(basis)) = within(limit, || ProfileBasis::from_sections(&asset.extra)) {
        basis.validate().unwrap();
    }
    if let Ok(Some(rows)) = within(limit, || IrradianceRows::from_sections(&asset.extra, asset.samples.patch_count())) {
        rows.validate().unwrap();
    }
}

fn full() -> Vec<u8> {
    full_asset_0_1().to_bytes().unwrap()
}

#[test]
fn the_allocator_counts() {
    PEAK.set(LIVE.get());
    let before = LIVE.get();
    drop(std::hint::black_box(vec![1u8; 1 << 20]));
    assert!(PEAK.get() - before >= 1 << 20 && LIVE.get() == before);
    decode(&full()).unwrap();
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let bytes = full();
    for length in 0..bytes.len() {
        decode(&bytes[..length]).unwrap_err();
        let mut cut = bytes[..length].to_vec();
        if length >= 32 {
            cut[16..24].copy_from_slice(&(length as u64).to_le_bytes());
            seal(&mut cut);
            decode(&cut).unwrap_err();
        }
    }
}

#[test]
fn an_appended_byte_is_refused() {
    let mut bytes = full();
    bytes.push(0);
    assert_eq!(decode(&bytes).unwrap_err().code(), 4);
    let length = bytes.len() as u64;
    bytes[16..24].copy_from_slice(&length.to_le_bytes());
    seal(&mut bytes);
    assert_eq!(decode(&bytes).unwrap_err().code(), 12);
}

#[test]
fn every_flipped_bit_is_found() {
    // Every bit of the older asset's header and directory, and of what these check every third; of the newer one of each byte.
    for (mut bytes, every, step) in [(full_asset().to_bytes().unwrap(), true, 3), (full(), false, 9)] {
        let head = if every { 8 * (32 + 48 * common::u32_at(&bytes, 12) as usize) } else { 0 };
        for bit in (0..head).chain((head..8 * bytes.len()).step_by(step)) {
            bytes[bit / 8] ^= 1 << (bit % 8);
            let result = decode(&bytes);
            bytes[bit / 8] ^= 1 << (bit % 8);
            result.unwrap_err();
        }
    }
}

#[test]
fn a_field_of_the_header_or_directory_that_is_wrong_is_refused_with_a_right_checksum() {
    let good = full();
    let count = common::u32_at(&good, 12) as usize;
    let entry_fields = [(0, 8), (8, 1), (9, 1), (10, 2), (12, 1), (13, 3), (16, 8), (24, 8), (32, 8), (44, 4)];
    let mut fields = vec![(0, 8), (8, 2), (12, 4), (16, 8), (28, 4)];
    for entry in 0..count {
        fields.extend(entry_fields.iter().map(|(at, length)| (32 + 48 * entry + at, *length)));
    }
    let values = [0u64, 1, u64::MAX, u64::MAX / 2, 1 << 31, 1 << 62, 64];
    for (at, length) in fields {
        for value in values.iter().chain(&[u64::from(good[at]) + 1, u64::from(good[at]).wrapping_sub(1)]) {
            let mut bytes = good.clone();
            bytes[at..at + length].copy_from_slice(&value.to_le_bytes()[..length]);
            if bytes == good {
                continue;
            }
            seal(&mut bytes);
            let in_entry = at >= 32;
            let (entry, field) = (at.saturating_sub(32) / 48, at.saturating_sub(32) % 48);
            let tag = in_entry.then(|| Tag::from_bytes(good[32 + 48 * entry..40 + 48 * entry].try_into().unwrap()));
            let common = tag.flatten().is_none_or(|tag| COMMON_TAGS.contains(&tag));
            // A method's own section may as well have another name, type, width or purpose.
            let free = !common && matches!(field, 0 | 8 | 10 | 12);
            let result = decode(&bytes);
            assert!(free || result.is_err(), "{at}+{length} = {value}");
        }
    }
}

#[test]
fn every_flipped_bit_of_the_header_and_directory_with_a_right_checksum() {
    let good = full();
    let head = 32 + 48 * common::u32_at(&good, 12) as usize;
    // Every bit of the header and of the common sections, which come first; of the others, which the container has few opinions on,
    // every fifth, which are other bits of each.
    let common = 8 * (32 + 48 * 18);
    let (mut flips, mut refused) = (0, 0);
    for bit in (0..common).chain((common..8 * head).step_by(5)) {
        flips += 1;
        let mut bytes = good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        seal(&mut bytes);
        match decode(&bytes) {
            // The minor version, a checksum (made right again), or the description of a method's own section.
            Ok(asset) => {
                assert!(bytes == good || (10..12).contains(&(bit / 8)) || asset.extra != full_asset_0_1().extra);
            }
            Err(_) => refused += 1,
        }
    }
    assert!(4 * refused > 3 * flips, "{refused} of {flips} flips");
}

#[test]
fn a_checksum_of_a_section_is_looked_at() {
    let good = full();
    for entry in 0..common::u32_at(&good, 12) as usize {
        let mut bytes = good.clone();
        bytes[32 + 48 * entry + 40] ^= 1;
        bytes[24..28].fill(0);
        let head = 32 + 48 * common::u32_at(&good, 12) as usize;
        let crc = common::crc32(&bytes[..head]);
        bytes[24..28].copy_from_slice(&crc.to_le_bytes());
        assert_eq!(decode(&bytes).unwrap_err().code(), 16);
        assert_eq!(Reader::parse(&bytes, BUDGET).unwrap().verify_checksums().unwrap_err().code(), 16);
    }
}

#[test]
fn padding_must_be_zero() {
    let good = full();
    let reader = Reader::parse(&good, BUDGET).unwrap();
    let mut used = vec![false; good.len()];
    used[..32 + 48 * reader.sections().len()].fill(true);
    for section in reader.sections() {
        used[section.offset as usize..(section.offset + section.stored_bytes) as usize].fill(true);
    }
    let padding: Vec<usize> = (0..good.len()).filter(|&i| !used[i]).collect();
    assert!(padding.len() > 100);
    for at in padding {
        let mut bytes = good.clone();
        bytes[at] = 1;
        assert_eq!(decode(&bytes).unwrap_err(), FormatError::NotZero { offset: at as u64, place: "padding" });
    }
}

#[test]
fn limits_of_the_directory() {
    let entry = |tag: &str| Entry::zstd(tag, 1, 1, 2, 0, Vec::new());
    let code = |entries: &[Entry]| Reader::parse(&build(entries), Budget::bytes(u64::MAX)).map_err(|e| e.code()).err();
    assert_eq!(code(&[entry("a"), entry("b")]), None);
    assert_eq!(code(&[entry("a"), entry("b"), entry("a")]), Some(9));
    let many: Vec<Entry> = (0..1025).map(|i| entry(&format!("s{i}"))).collect();
    assert_eq!(code(&many[..1024]), None);
    assert_eq!(code(&many), Some(7));
    let record = |length: u64| Entry::zstd("r", 0, 1, 3, length, Vec::new());
    assert_eq!(code(&[record(64 << 20)]), None);
    assert_eq!(code(&[record((64 << 20) + 1)]), Some(13));
    assert_eq!(code(&[Entry::zstd("r", 0, 2, 3, 0, Vec::new())]), Some(10));
    assert_eq!(code(&[Entry::zstd("w", 11, u16::MAX, 2, u64::MAX, Vec::new())]), Some(13));
}

/// Reads again what was decoded, once written.
fn check_again(asset: &AssetFile) {
    let bytes = asset.to_bytes().unwrap();
    assert_eq!(&AssetFile::from_bytes(&bytes, Budget::default()).unwrap(), asset);
}

#[test]
fn ten_thousand_mutations_of_the_bytes() {
    let good = full();
    let mut random = Random(1);
    for i in 0..10_000 {
        let mut bytes = good.clone();
        mutate(&mut random, &mut bytes);
        // Most files get right checksums, and half a right length, so that the checks behind those are met.
        if i % 4 != 0 {
            if i % 2 == 0 && bytes.len() >= 32 {
                let length = bytes.len() as u64;
                bytes[16..24].copy_from_slice(&length.to_le_bytes());
            }
            seal(&mut bytes);
        }
        if let (Ok(asset), 0) = (decode(&bytes), i % 16) {
            check_again(&asset);
        }
    }
}

#[test]
fn ten_thousand_mutations_of_the_content() {
    let sections = sections_of(&full());
    let mut random = Random(2);
    let (mut accepted, mut codes) = (0, std::collections::BTreeMap::<u16, u32>::new());
    for _ in 0..10_000 {
        let mut entries: Vec<Entry> = sections.iter().map(Entry::raw).collect();
        for _ in 0..=random.below(2) {
            // The common sections come first; most of the checks are theirs.
            let entry = &mut entries[random.below(18)];
            mutate(&mut random, &mut entry.stored);
            entry.decoded = entry.stored.len() as u64;
        }
        match decode(&build(&entries)) {
            Ok(asset) => {
                accepted += 1;
                if accepted % 16 == 0 {
                    check_again(&asset);
                }
            }
            Err(error) => *codes.entry(error.code()).or_default() += 1,
        }
    }
    // The mutations are useless unless they reach what lies deepest, and unless some are harmless.
    assert!(accepted > 100 && codes[&20] > 100 && codes[&21] > 1000 && codes[&13] > 100, "{accepted} {codes:?}");
}

/// Every byte of the method's sections takes other values in a file that is right in all else.
#[test]
fn every_byte_of_the_method_sections_with_right_checksums() {
    let sections = sections_of(&full());
    let tags: Vec<Tag> =
        far_field::tags::ALL.into_iter().chain(profile_basis::tags::ALL).chain(rows::tags::ALL).collect();
    let shape_of = |asset: &AssetFile| asset.mesh.positions_mm.len();
    let (mut refused, mut accepted) = (0, 0);
    for index in (0..sections.len()).filter(|&i| tags.contains(&sections[i].tag)) {
        for at in 0..sections[index].bytes.len() {
            for change in [0x01, 0x80] {
                let mut entries: Vec<Entry> = sections.iter().map(Entry::raw).collect();
                entries[index].stored[at] ^= change;
                // The container has no opinion on what a method keeps.
                let asset = decode(&build(&entries)).unwrap();
                let shape = Shape::new(shape_of(&asset), &asset.samples);
                let field = FarField::from_sections(&asset.extra, &shape).map(drop);
                let rows = IrradianceRows::from_sections(&asset.extra, asset.samples.patch_count()).map(drop);
                match field.and(ProfileBasis::from_sections(&asset.extra).map(drop)).and(rows) {
                    Ok(()) => accepted += 1,
                    Err(error) => {
                        // Wrong ends of groups may be noticed at what they cut.
                        let blamed = [Some(sections[index].tag), error.tag()].map(|tag| tag.unwrap());
                        let together = [&far_field::tags::ALL[..], &rows::tags::ALL]
                            .map(|of_one| of_one.iter().filter(|tag| blamed.contains(tag)).count());
                        let fits = blamed[0] == blamed[1] || together.contains(&2);
                        assert!(error.code() == 21 && fits, "byte {at}: {error}");
                        refused += 1;
                    }
                }
            }
        }
    }
    assert!(refused > 100 && accepted > 100, "{refused} refused, {accepted} accepted");
}

/// Counts that claim far more than there is take no memory.
#[test]
fn method_sections_that_claim_much_take_no_memory() {
    let sections = sections_of(&full());
    for (tag, words) in
        [("far.grp", 3), ("far.grp", 6), ("far.rcv", 6), ("far.stp", 2), ("rows.dim", 2), ("rows.cnt", 1)]
    {
        for value in [u32::MAX, u32::MAX - 1, 1 << 31, (1 << 28) - 1] {
            for at in 0..words {
                let mut entries: Vec<Entry> = sections.iter().map(Entry::raw).collect();
                let index = sections.iter().position(|section| section.tag.as_str() == tag).unwrap();
                entries[index].stored[4 * at..4 * at + 4].copy_from_slice(&value.to_le_bytes());
                decode(&build(&entries)).unwrap();
            }
        }
    }
}

#[test]
fn a_scan_goes_on_behind_the_first_error() {
    let good = full();
    let reader = Reader::parse(&good, BUDGET).unwrap();
    let mut bytes = good.clone();
    let damaged = ["mesh.pos", "samp.fac", "x.f64", "meta.err"];
    for tag in damaged {
        let section = reader.section(Tag::new(tag).unwrap()).unwrap();
        bytes[(section.offset + section.stored_bytes) as usize - 1] ^= 1;
    }
    let found = scan(&bytes, BUDGET);
    let mut tags: Vec<String> = found.errors.iter().map(|error| error.tag().unwrap().to_string()).collect();
    tags.sort();
    assert_eq!(tags, ["mesh.pos", "meta.err", "samp.fac", "x.f64"]);
    assert!(found.errors.iter().all(|error| error.code() == 16));
    assert!(found.mesh.is_none() && found.samples.is_none() && found.ledger.is_none());
    assert_eq!(found.parts, Some(full_asset().parts));
    assert_eq!(found.provenance, Some(full_asset_0_1().provenance));
    assert_eq!(found.extra.len(), full_asset_0_1().extra.len() - 1);

    // A wrong entry does not hide the sections behind it, nor a wrong length of the file its content.
    let mut bytes = good.clone();
    bytes[32 + 48 * 3 + 8] = 99;
    bytes.push(7);
    bytes[28] = 1;
    let codes: Vec<u16> = scan(&bytes, BUDGET).errors.iter().map(FormatError::code).collect();
    assert_eq!(codes, [4, 5, 6, 10, 12]);
}

#[test]
fn the_half_of_an_attribute_that_is_missing_is_missed_whatever_the_other_one_holds() {
    for (there, missing) in [("mesh.nrm", "mesh.nri"), ("mesh.uvi", "mesh.uv")] {
        let mut bytes = full();
        let place = |bytes: &[u8], tag: &str| {
            let tag = Tag::new(tag).unwrap().to_bytes();
            (0..common::u32_at(bytes, 12) as usize)
                .map(|entry| 32 + 48 * entry)
                .find(|&at| bytes[at..at + 8] == tag)
                .unwrap()
        };
        let at = place(&bytes, missing);
        bytes[at] ^= 1;
        // Of a frame, its number of magic.
        let at = place(&bytes, there);
        let stored = common::u64_at(&bytes, at + 16) as usize;
        bytes[stored] ^= 1;
        seal(&mut bytes);
        let error = decode(&bytes).unwrap_err();
        assert_eq!(error, FormatError::MissingSection { tag: Tag::new(missing).unwrap() });
        let found = scan(&bytes, BUDGET).errors;
        assert!(found.contains(&error), "{found:?}");
        assert_eq!(found.len(), 2, "{found:?}");
    }
}

#[test]
fn a_wrong_type_is_told_of_a_section_that_does_not_decode() {
    let mut bytes = full();
    let tag = Tag::new("mesh.nri").unwrap();
    let entries = common::u32_at(&bytes, 12) as usize;
    let at = (0..entries).map(|entry| 32 + 48 * entry).find(|&at| bytes[at..at + 8] == tag.to_bytes()).unwrap();
    // Floats in the place of whole numbers, and a frame without its magic.
    bytes[at + 8] = translux_format::ElementType::F32.code();
    let stored = common::u64_at(&bytes, at + 16) as usize;
    bytes[stored] ^= 1;
    seal(&mut bytes);
    let error = decode(&bytes).unwrap_err();
    assert!(matches!(error, FormatError::WrongType { .. }), "{error}");
    let found = scan(&bytes, BUDGET).errors;
    assert!(found.len() == 2 && found[0] == error, "{found:?}");
}

#[test]
fn zstd_bombs_are_refused_before_memory_is_taken() {
    let zeros = vec![0u8; 64 << 20];
    let bomb = zstd::bulk::compress(&zeros, 19).unwrap();
    assert!(bomb.len() < 8 << 10);
    let tag = Tag::from_static("bomb");
    let read = |claim: u64, stored: &[u8], budget: u64| {
        let file = build(&[Entry::zstd("bomb", 1, 1, 2, claim, stored.to_vec())]);
        PEAK.set(LIVE.get());
        let before = LIVE.get();
        let result = Reader::parse(&file, Budget::bytes(budget)).and_then(|reader| reader.array::<u8>(tag));
        (result.map(|rows| rows.len()).map_err(|error| error.code()), PEAK.get() - before)
    };
    let full = zeros.len() as u64;
    let (result, peak) = read(full, &bomb, full);
    assert!(result == Ok(64 << 20) && peak < (64 << 20) + (1 << 16), "{result:?}, {peak} bytes");
    for (claim, budget, code) in
        [(full, full - 1, 14), (1000, 1 << 20, 17), (full - 1, full, 17), (full + 1, 2 * full, 17)]
    {
        let (result, peak) = read(claim, &bomb, budget);
        assert_eq!(result, Err(code), "claims {claim}");
        assert!(peak < 1 << 16, "{peak} bytes for a claim of {claim}");
    }
    // A frame whose header claims far more than its few blocks can hold: single segment, 8-byte content size.
    let mut liar = vec![0x28, 0xb5, 0x2f, 0xfd, 0xe0];
    liar.extend((1u64 << 40).to_le_bytes());
    liar.extend([0b011, 0, 0, 0]);
    let (result, peak) = read(1 << 40, &liar, 1 << 41);
    assert_eq!(result, Err(17));
    assert!(peak < 1 << 16);
}

#[test]
fn only_one_plain_zstd_frame_is_a_section() {
    let content = b"one frame and nothing else".to_vec();
    let frame = zstd::bulk::compress(&content, 3).unwrap();
    let length = content.len() as u64;
    let read = |stored: Vec<u8>| {
        let file = build(&[Entry::zstd("z", 1, 1, 2, length, stored)]);
        Reader::parse(&file, BUDGET).and_then(|reader| reader.array::<u8>(Tag::from_static("z"))).map_err(|e| e.code())
    };
    assert_eq!(read(frame.clone()), Ok(content.clone()));
    let skippable = [0x50, 0x2a, 0x4d, 0x18, 0, 0, 0, 0];
    assert_eq!(read([skippable.as_slice(), &frame].concat()), Err(17));
    assert_eq!(read([frame.as_slice(), &skippable].concat()), Err(17));
    assert_eq!(read([frame.as_slice(), &frame].concat()), Err(17));
    assert_eq!(read(frame[..frame.len() - 1].to_vec()), Err(17));
    assert_eq!(read(Vec::new()), Err(17));
    let nothing = build(&[Entry::zstd("z", 1, 1, 2, 0, skippable.to_vec())]);
    let reader = Reader::parse(&nothing, BUDGET).unwrap();
    assert_eq!(reader.array::<u8>(Tag::from_static("z")).unwrap_err().code(), 17);
    let unsized_frame = zstd::stream::encode_all(content.as_slice(), 3).unwrap();
    assert_eq!(read(unsized_frame), Err(17));
}

#[test]
fn a_record_that_claims_a_huge_list_takes_no_memory_for_it() {
    for claim in [u64::MAX, 1 << 40, 1 << 20] {
        let sections = sections_of(&full());
        for tag in ["mesh.mtn", "part.rec", "part.med", "meta.src", "meta.err"] {
            let mut entries: Vec<Entry> = sections.iter().map(Entry::raw).collect();
            let index = sections.iter().position(|section| section.tag.as_str() == tag).unwrap();
            let at = if tag == "meta.src" { 4 } else { 0 };
            entries[index].stored[at..at + 8].copy_from_slice(&claim.to_le_bytes());
            assert_eq!(decode(&build(&entries)).unwrap_err().code(), 20, "{tag} {claim}");
        }
    }
}

#[test]
fn a_record_of_many_small_things_stays_within_its_factor() {
    let mut asset = full_asset();
    asset.mesh.materials.resize(300_000, String::new());
    asset.parts.parts.resize(100_000, Default::default());
    asset.parts.parts.iter_mut().for_each(|part| part.opaque = true);
    asset.samples.part_offsets.resize(100_001, 3);
    asset.parts.media.resize(50_000, asset.parts.media[0].clone());
    asset.provenance.notes.resize(400_000, "n".into());
    asset.provenance.settings = (0..100_000).map(|i| (format!("{i:06}"), String::new())).collect();
    asset.provenance.inputs.resize(50_000, asset.provenance.inputs[0].clone());
    asset.ledger.resize(50_000, asset.ledger[0].clone());
    let bytes = asset.to_bytes().unwrap();
    let reader = Reader::parse(&bytes, Budget::default()).unwrap();
    let cost = |section: &translux_format::SectionInfo| {
        section.decoded_bytes * if section.element.code() == 0 { Budget::RECORD_FACTOR } else { 1 }
    };
    let total: u64 = reader.sections().iter().map(cost).sum();
    AssetFile::from_bytes(&bytes, Budget::bytes(total - 1)).unwrap_err();
    let before = LIVE.get();
    PEAK.set(before);
    let back = AssetFile::from_bytes(&bytes, Budget::bytes(total)).unwrap();
    let peak = PEAK.get() - before;
    assert!(peak <= total as isize + BESIDE, "{peak} bytes, budget {total}");
    assert!(back == asset);
}

/// Arrays are in memory once, however large.
#[test]
fn decoding_takes_the_decoded_bytes_and_little_else() {
    let mut asset = full_asset();
    asset.mesh.positions_mm.resize(500_000, [1.0; 3]);
    asset.mesh.weld = (0..500_000).collect();
    let bytes = asset.to_bytes().unwrap();
    let decoded: u64 =
        Reader::parse(&bytes, Budget::default()).unwrap().sections().iter().map(|section| section.decoded_bytes).sum();
    let before = LIVE.get();
    PEAK.set(before);
    let back = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
    let peak = PEAK.get() - before;
    assert!(peak < decoded as isize + (64 << 10), "{peak} bytes for {decoded}");
    assert!(back == asset);
}
