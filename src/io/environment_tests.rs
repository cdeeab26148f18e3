#![allow(clippy::unwrap_used)]

use super::*;
use crate::error::ExitCode;
use crate::light::parse::parse;
use std::path::PathBuf;

/// The folder of shared test pictures, if this machine has it.
fn shared_env() -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let folder = root.join("data/env");
    if folder.is_dir() {
        Some(folder)
    } else {
        println!("SKIPPED: no test pictures in {}", folder.display());
        None
    }
}

#[test]
fn real_maps_load() {
    let Some(folder) = shared_env() else { return };
    for (name, width) in [
        ("noon_grass_1k.hdr", 1024),
        ("st_peters_square_night_1k.hdr", 1024),
        ("potsdamer_platz_1k.hdr", 1024),
        ("debevec_grace_256.hdr", 256),
        ("debevec_uffizi_256.hdr", 256),
        ("debevec_pisa_256.hdr", 256),
        ("museum.exr", 512),
        ("debevec_grace_1k.exr", 1024),
    ] {
        let loaded = load_environment(&folder.join(name)).unwrap();
        let map = &loaded.value;
        assert_eq!((map.width(), map.height()), (width, width / 2), "{name}");
        let energy = map.energy();
        assert!(energy.is_finite() && energy.min_element() > 0.0, "{name}: {energy}");
        println!("{name}: energy {energy:.3}, {:?}", loaded.warnings);
        if name.ends_with(".hdr") {
            let other = image::open(folder.join(name)).unwrap().into_rgb32f();
            assert!(map.pixels().as_flattened() == other.as_raw().as_slice(), "{name} differs from the image crate");
        }
    }
}

#[test]
fn the_noon_sun_is_above_the_horizon_and_in_a_small_stratum() {
    use crate::light::strata::{Strata, StrataSettings};
    let Some(folder) = shared_env() else { return };
    let map = load_environment(&folder.join("noon_grass_1k.hdr")).unwrap().value;
    let strata = Strata::new(&map, StrataSettings::DEFAULT).unwrap();
    let map_energy = map.energy();
    assert!(((strata.energy() - map_energy) / map_energy).abs().max_element() < 1e-9);
    let brightest = strata.strata().iter().max_by(|a, b| a.energy.x.total_cmp(&b.energy.x)).unwrap();
    assert!(brightest.rows.end < map.height() / 2, "{brightest:?}");
    assert!(brightest.rows.len() * brightest.columns.len() <= 4, "{brightest:?}");
}

#[test]
fn lights_are_loaded_and_errors_give_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a:b.hdr");
    let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n";
    std::fs::write(&path, [header.as_bytes(), &[128, 128, 128, 129, 128, 0, 0, 129]].concat()).unwrap();
    let light = load_light(&parse(&format!("{}:rotate=90:scale=2", path.display())).unwrap()).unwrap();
    assert!(light.warnings.is_empty());
    let Light::Environment { map, rotate_degrees, scale } = light.value else { panic!("wrong kind") };
    assert_eq!((map.width(), rotate_degrees, scale), (2, 90.0, DVec3::splat(2.0)));

    let error = load_light(&parse(&format!("env:path={}:rotat=9", path.display())).unwrap()).unwrap_err();
    assert_eq!(error.code(), ExitCode::Io);
    assert!(error.message().contains("keys path, rotate and scale"), "{error}");
    let error = load_light(&parse("no/such/light").unwrap()).unwrap_err();
    assert!(error.message().contains("constant:radiance=1"), "{error}");
    let error = load_environment(folder.path()).unwrap_err();
    assert_eq!(error.code(), ExitCode::Io, "{error}");
}

#[test]
fn the_first_bytes_tell_the_format() {
    for (bytes, code, part) in [
        (&b""[..], ExitCode::InvalidInput, "empty"),
        (b"\x89PNG\r\n", ExitCode::Unsupported, "8-bit"),
        (b"hello", ExitCode::InvalidInput, "neither"),
        (b"#?RADIANCE\n", ExitCode::InvalidInput, "header"),
        (&exr::MAGIC, ExitCode::InvalidInput, "OpenEXR"),
    ] {
        let error = decode(bytes).unwrap_err();
        assert_eq!(error.code(), code, "{error}");
        assert!(error.message().contains(part), "{error}");
    }
}

#[test]
fn warnings_name_the_path_and_what_is_odd() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("black.hdr");
    std::fs::write(&path, [&b"#?RGBE\n\n-Y 1 +X 1\n"[..], &[0; 4]].concat()).unwrap();
    let loaded = load_environment(&path).unwrap();
    assert_eq!(loaded.warnings.len(), 2);
    assert!(loaded.warnings.iter().all(|w| w.contains("black.hdr: ")), "{:?}", loaded.warnings);
}
