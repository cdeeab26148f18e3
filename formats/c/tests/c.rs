//! The header is what the code gives; the example in C compiles with it and says what the example in Rust says; and whatever C hands over,
//! the answer is a status.

#![allow(clippy::unwrap_used)]

// Its `main` is that of the example.
#[allow(dead_code)]
#[path = "../../examples/engine.rs"]
mod engine;

// What the tests of the format damage assets with.
#[path = "../../tests/common/mod.rs"]
mod common;

use std::ffi::{CStr, c_char};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::ptr::{null, null_mut};

use common::{Entry, Random, build, mutate, sections_of};
use translux_c::*;
use translux_format::{AssetFile, Budget};

/// Set to write the header.
const WRITE: &str = "TRANSLUX_WRITE_HEADER";

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Kept assets, one of each form, and those of earlier versions of the format.
fn assets() -> Vec<PathBuf> {
    let mut folders = vec![here("../tests/data")];
    folders.extend(std::fs::read_dir(here("../../fixtures/assets")).unwrap().map(|entry| entry.unwrap().path()));
    let files = folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()));
    let mut assets: Vec<PathBuf> = files.filter(|path| path.extension().is_some_and(|e| e == "tlux")).collect();
    assets.sort();
    assert!(assets.len() > 8, "{assets:?}");
    assets
}

#[test]
fn the_header_is_what_the_code_gives() {
    let config = cbindgen::Config::from_file(here("cbindgen.toml")).unwrap();
    let sources = ["src/views.rs", "src/error.rs", "src/asset.rs", "src/lib.rs"];
    let builder = sources.iter().fold(cbindgen::Builder::new().with_config(config), |b, file| b.with_src(here(file)));
    let mut made = Vec::new();
    builder.generate().unwrap().write(&mut made);
    let path = here("include/translux.h");
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == String::from_utf8(made).unwrap(),
        "the code gives another header: {WRITE}=1 cargo test --release -p translux-c writes it"
    );
}

/// The static library of this build: Cargo puts it beside the tests.
fn library() -> PathBuf {
    let folder = std::env::current_exe().unwrap().parent().unwrap().to_owned();
    let library = folder.join("libtranslux_c.a");
    assert!(library.is_file(), "{} is missing", library.display());
    library
}

#[test]
#[cfg(unix)]
fn the_example_in_c_says_what_the_example_in_rust_says() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("engine");
    let compiled = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off", "-I"])
        .arg(here("include"))
        .arg(here("../examples/engine.c"))
        .arg(library())
        .args(["-lpthread", "-ldl", "-lm", "-o"])
        .arg(&program)
        .output()
        .unwrap();
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let run = |asset: &Path| {
        let output = Command::new(&program).arg(asset).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let (mut far, mut rows) = (0, 0);
    for asset in assets() {
        let expected = engine::describe(&std::fs::read(&asset).unwrap()).unwrap();
        far += usize::from(expected.contains("far field: ") && expected.contains("  node "));
        rows += usize::from(expected.contains("irradiance rows: "));
        assert_eq!(run(&asset), (Some(0), expected, String::new()), "{}", asset.display());
    }
    assert!(far > 0 && rows > 0, "{far} {rows}");
    let cut = folder.path().join("cut.tlux");
    let whole = std::fs::read(&assets()[0]).unwrap();
    for length in [0, 7, 100, whole.len() - 1] {
        std::fs::write(&cut, &whole[..length]).unwrap();
        let error = AssetFile::from_bytes(&whole[..length], Budget::default()).unwrap_err();
        assert_eq!(run(&cut), (Some(3), String::new(), format!("{}: {error}\n", cut.display())));
    }
    assert_eq!(run(&folder.path().join("none.tlux")).0, Some(2));
}

/// What a call says of its fault, in memory that held something else.
fn failed(call: impl FnOnce(*mut Error) -> Status) -> (Status, String, String) {
    let mut error = Error { status: Status::Ok, section: [0x55; TAG_BYTES], message: [0x55; MESSAGE_BYTES] };
    let status = call(&mut error);
    assert_eq!(status, error.status);
    let text = |chars: &[c_char]| {
        let bytes: Vec<u8> = chars.iter().map(|c| *c as u8).collect();
        CStr::from_bytes_until_nul(&bytes).unwrap().to_str().unwrap().to_owned()
    };
    (status, text(&error.section), text(&error.message))
}

/// An open asset that is closed.
struct Open(*mut Asset);

impl Drop for Open {
    fn drop(&mut self) {
        // SAFETY: it comes from `translux_open`, or is null.
        unsafe { translux_close(self.0) };
    }
}

fn open(bytes: &[u8]) -> (Status, Open) {
    let mut asset = null_mut();
    // SAFETY: everything given is ours.
    let status = unsafe { translux_open(bytes.as_ptr(), bytes.len(), DEFAULT_BUDGET, &mut asset, null_mut()) };
    assert_eq!(status == Status::Ok, !asset.is_null());
    (status, Open(asset))
}

/// What a call writes.
fn got<T>(call: impl FnOnce(*mut T) -> Status) -> Result<T, Status> {
    let mut value = std::mem::MaybeUninit::uninit();
    match call(value.as_mut_ptr()) {
        // SAFETY: a call that succeeds writes its value.
        Status::Ok => Ok(unsafe { value.assume_init() }),
        status => Err(status),
    }
}

/// The bits of a lent array's elements, added up: every one of them is read.
fn sum<T: Copy>(array: *const T, length: usize) -> u64 {
    if length == 0 || array.is_null() {
        assert!(length == 0 && array.is_null());
        return 0;
    }
    // SAFETY: the library says that it lends so many, and no element has padding but `Group`'s, which is not read here.
    let bytes = unsafe { std::slice::from_raw_parts(array.cast::<u8>(), length * size_of::<T>()) };
    bytes.iter().map(|byte| u64::from(*byte)).sum()
}

/// Reads everything that an open asset lends, and returns the sections of its method as (tag, bytes).
#[expect(clippy::undocumented_unsafe_blocks, reason = "what is said of the first holds for each")]
fn read_all(asset: *const Asset) -> Vec<(String, usize)> {
    let none = null_mut();
    // SAFETY (of this and all below): the asset is open, and what is written to is ours.
    let info = got(|out| unsafe { translux_info(asset, out, none) }).unwrap();
    sum(info.method.data, info.method.length);
    sum(info.form.data, info.form.length);
    let mesh = got(|out| unsafe { translux_mesh(asset, out, none) }).unwrap();
    sum(mesh.positions_mm, mesh.vertices);
    sum(mesh.weld, mesh.vertices);
    sum(mesh.corners, mesh.triangles);
    sum(mesh.triangle_part, mesh.triangles);
    sum(mesh.triangle_material, mesh.triangles);
    sum(mesh.normal_values, mesh.normals);
    sum(mesh.normal_corners, if mesh.normals == 0 { 0 } else { mesh.triangles });
    sum(mesh.uv_values, mesh.uvs);
    sum(mesh.uv_corners, if mesh.uvs == 0 { 0 } else { mesh.triangles });
    for i in 0..info.parts {
        let part = got(|out| unsafe { translux_part(asset, i, out, none) }).unwrap();
        sum(part.name.data, part.name.length);
    }
    for i in 0..info.media {
        let medium = got(|out| unsafe { translux_medium(asset, i, out, none) }).unwrap();
        sum(medium.name.data, medium.name.length);
    }
    let samples = got(|out| unsafe { translux_samples(asset, out, none) }).unwrap();
    sum(samples.facet, samples.facets);
    sum(samples.patch_offsets, samples.patches + 1);
    sum(samples.part_offsets, info.parts + 1);
    if let Ok(rows) = got(|out| unsafe { translux_irradiance_rows(asset, out, none) }) {
        assert_eq!(rows.patches, samples.patches);
        sum(rows.offsets, rows.patches + 1);
        sum(rows.indices, rows.coefficients);
        sum(rows.values, rows.coefficients * rows.terms);
        sum(rows.steps, rows.patches);
        sum(rows.scaling, rows.patches * rows.terms * 6);
        sum(rows.scaling_steps, rows.patches);
        sum(rows.functions, rows.terms);
    }
    if let Ok(far) = got(|out| unsafe { translux_far_field(asset, out, none) }) {
        sum(far.receiver_of_vertex, far.vertices);
        sum(far.receiver_of_other, far.others);
        sum(far.nodes, far.coefficients);
        sum(far.masks, far.coefficients);
        sum(far.wide_masks, far.coefficients);
        sum(far.steps, far.terms);
        sum(far.narrow, far.narrow_rows);
        sum(far.wide, far.wide_rows);
        sum(far.row_sums, (far.receivers + far.others) * far.terms);
        if far.groups > 0 {
            let groups = unsafe { std::slice::from_raw_parts(far.group, far.groups) };
            assert_eq!(groups[far.groups - 1].rows_end as usize, far.receivers + far.others);
            assert_eq!(groups[far.groups - 1].coefficients_end as usize, far.coefficients);
        }
    }
    let sections = (0..info.sections).map(|i| {
        let section = got(|out| unsafe { translux_section(asset, i, out, none) }).unwrap();
        sum(section.data, section.length);
        let found = got(|out| unsafe { translux_find_section(asset, section.tag.as_ptr(), out, none) }).unwrap();
        assert_eq!((found.data, found.length, found.rows), (section.data, section.length, section.rows));
        let tag: Vec<u8> = section.tag.iter().map(|c| *c as u8).collect();
        (CStr::from_bytes_until_nul(&tag).unwrap().to_str().unwrap().to_owned(), section.length)
    });
    sections.collect()
}

#[test]
fn what_is_lent_is_the_asset() {
    for path in assets() {
        let bytes = std::fs::read(&path).unwrap();
        let file = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
        let (status, asset) = open(&bytes);
        assert_eq!(status, Status::Ok, "{}", path.display());
        let sections = read_all(asset.0);
        let expected: Vec<_> = file.extra.iter().map(|s| (s.tag.to_string(), s.bytes.len())).collect();
        assert_eq!(sections, expected);
        // SAFETY: the asset is open, and what is written to is ours.
        let mesh = got(|out| unsafe { translux_mesh(asset.0, out, null_mut()) }).unwrap();
        let bits = |array: &[[f32; 3]]| sum(array.as_ptr(), array.len());
        assert_eq!(sum(mesh.positions_mm, mesh.vertices), bits(&file.mesh.positions_mm));
        assert_eq!((mesh.triangles, mesh.origin_mm), (file.mesh.triangles.len(), file.mesh.origin_mm));
        // Two readers at once get the same arrays.
        let address = asset.0 as usize;
        let far = || {
            // SAFETY: as above; whoever drops the asset waits for both.
            let far = got(|out| unsafe { translux_far_field(address as *const Asset, out, null_mut()) });
            far.map(|far| far.nodes as usize)
        };
        let both =
            std::thread::scope(|scope| [scope.spawn(far), scope.spawn(far)].map(|thread| thread.join().unwrap()));
        assert_eq!(both[0], both[1]);
    }
}

#[test]
fn what_is_missing_or_null_is_a_status() {
    let bytes = std::fs::read(here("../tests/data/v0_2_full.tlux")).unwrap();
    let (_, asset) = open(&bytes);
    let mut slot: *mut Asset = null_mut();
    let to = &raw mut slot;
    // SAFETY: null pointers are allowed, all others are ours.
    unsafe {
        let is_null = |call: &dyn Fn(*mut Error) -> Status, what: &str| {
            assert_eq!(failed(call), (Status::NullArgument, String::new(), format!("{what} is null")));
            assert_eq!(call(null_mut()), Status::NullArgument);
        };
        is_null(&|e| translux_open(null(), 0, DEFAULT_BUDGET, to, e), "bytes");
        is_null(&|e| translux_open(bytes.as_ptr(), bytes.len(), DEFAULT_BUDGET, null_mut(), e), "asset");
        let wide = failed(|e| translux_open(bytes.as_ptr(), usize::MAX, DEFAULT_BUDGET, to, e));
        assert_eq!(wide.0, Status::OutOfRange);
        assert_eq!(failed(|e| translux_open(bytes.as_ptr(), bytes.len(), 100, to, e)).0, Status::OverBudget);
        assert!(slot.is_null());
        translux_close(null_mut());
        for (asset, what) in [(null(), "asset"), (asset.0.cast_const(), "out")] {
            is_null(&|e| translux_info(asset, null_mut(), e), what);
            is_null(&|e| translux_mesh(asset, null_mut(), e), what);
            is_null(&|e| translux_part(asset, 0, null_mut(), e), what);
            is_null(&|e| translux_medium(asset, 0, null_mut(), e), what);
            is_null(&|e| translux_samples(asset, null_mut(), e), what);
            is_null(&|e| translux_irradiance_rows(asset, null_mut(), e), what);
            is_null(&|e| translux_far_field(asset, null_mut(), e), what);
            is_null(&|e| translux_section(asset, 0, null_mut(), e), what);
            let first = c"form.nam".as_ptr();
            is_null(&|e| translux_find_section(asset, first, null_mut(), e), what);
        }
        let (mut section, mut part) = (std::mem::zeroed::<Section>(), std::mem::zeroed::<Part>());
        let section = &raw mut section;
        is_null(&|e| translux_find_section(asset.0, null(), section, e), "tag");
        is_null(&|e| translux_over_lanes(null(), null_mut(), e), "coefficients");
        is_null(&|e| translux_over_lanes([0.0; LANES].as_ptr(), null_mut(), e), "out");
        let beyond = failed(|e| translux_part(asset.0, usize::MAX, &raw mut part, e));
        assert!(beyond.0 == Status::OutOfRange && beyond.2.starts_with("part 18446744073709551615: there are "));
        assert_eq!(translux_section(asset.0, 1 << 40, section, null_mut()), Status::OutOfRange);
        for tag in [c"none", c"", c"longer than a tag", c"\xff\xfe"] {
            assert_eq!(translux_find_section(asset.0, tag.as_ptr(), section, null_mut()), Status::Absent);
        }
        assert_eq!((translux_abi(), CStr::from_ptr(translux_status_name(101))), (ABI, c"NullArgument"));
    }
}

/// Every length, and many changed bytes under right checksums: a status, or an asset that can be read to its end.
#[test]
fn hostile_bytes_are_a_status() {
    let mut random = Random(32);
    let mut opened = 0;
    for path in assets() {
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(1 + whole.len() / 100) {
            assert_ne!(open(&whole[..length]).0, Status::Ok);
        }
        let sections = sections_of(&whole);
        for _ in 0..200 {
            let mut changed: Vec<Entry> = sections.iter().map(Entry::raw).collect();
            let entry = &mut changed[random.below(sections.len())];
            mutate(&mut random, &mut entry.stored);
            entry.decoded = entry.stored.len() as u64;
            let (status, asset) = open(&build(&changed));
            if status == Status::Ok {
                read_all(asset.0);
                opened += 1;
            }
        }
    }
    assert!(opened > 100, "{opened}");
}
