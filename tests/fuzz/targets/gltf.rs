//! Any bytes as a glTF file, text or binary: an error, or a model whose mesh is sound.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use translux::io::gltf::parse_gltf;

mod model;

fuzz_target!(|bytes: &[u8]| {
    // No buffer outside of the file is found there.
    if let Ok(model) = parse_gltf(bytes, Path::new("/nowhere/fuzzed.gltf")) {
        model::check(model);
    }
});
