//! Any bytes as a picture: Radiance HDR and OpenEXR as environments, OpenEXR by channels, PNG, JPEG and WebP as textures, and PLY as
//! radiosity of vertices. An error, or as many pixels as the picture says; and an environment has radiance that can be summed.
#![no_main]

use libfuzzer_sys::fuzz_target;
use translux::io::{environment, exr, photo, ply};
use translux::light::environment::EnvironmentMap;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(image) = environment::decode(bytes) {
        assert_eq!(image.pixels.len(), image.width * image.height);
        if let Ok(map) = EnvironmentMap::new(image.width, image.height, image.pixels) {
            assert!(map.pixels().iter().flatten().all(|value| value.is_finite() && *value >= 0.0));
        }
    }
    let _ = exr::decode_planes(bytes);
    let _ = photo::decode_photo(bytes);
    let _ = ply::parse_ply(bytes, "fuzzed.ply");
});
