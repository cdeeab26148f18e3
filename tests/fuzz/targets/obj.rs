//! Any bytes as an OBJ file: an error, or a model whose mesh is sound.
#![no_main]

use libfuzzer_sys::fuzz_target;
use translux::io::obj::parse_obj;

mod model;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(model) = parse_obj(bytes, "fuzzed.obj") {
        model::check(model);
    }
});
