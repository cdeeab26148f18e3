#![allow(clippy::unwrap_used)]

use super::*;
use crate::error::ExitCode;
use crate::io::reader_tests::shared_data;
use crate::light::parse::parse;

#[test]
fn real_maps_load() {
    let Some(folder) = shared_data("env") else { return };
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
    let Some(folder) = shared_data("env") else { return };
    let map = load_environment(&folder.join("noon_grass_1k.hdr")).unwrap().value;
    let strata = Strata::new(&map, StrataSettings::DEFAULT).unwrap();
    let map_energy = map.energy();
    assert!(((strata.energy() - map_energy) / map_energy).abs().max_element() < 1e-9);
    let brightest = strata.strata().iter().max_by(|a, b| a.energy.x.total_cmp(&b.energy.x)).unwrap();
    assert!(brightest.rows.end < map.height() / 2, "{brightest:?}");
    assert!(brightest.rows.len() * brightest.columns.len() <= 4, "{brightest:?}");
}

#[test]
fn strata_of_real_maps_give_the_irradiance_of_all_pixels() {
    use crate::light::environment::direction_of;
    use crate::light::strata::{Strata, StrataSettings};
    let Some(folder) = shared_data("env") else { return };
    for name in ["noon_grass_1k.hdr", "st_peters_square_night_1k.hdr", "debevec_grace_256.hdr", "museum.exr"] {
        let map = load_environment(&folder.join(name)).unwrap().value;
        let started = std::time::Instant::now();
        let strata = Strata::new(&map, StrataSettings::DEFAULT).unwrap();
        let seconds = started.elapsed().as_secs_f64();
        let normals: Vec<DVec3> =
            (0..12).map(|i| direction_of((f64::from(i) * 0.618).fract(), (f64::from(i) + 0.5) / 12.0)).collect();
        let mut truth = vec![DVec3::ZERO; normals.len()];
        for y in 0..map.height() {
            for x in 0..map.width() {
                let (energy, direction) = (map.pixel(x, y) * map.pixel_solid_angle_sr(y), map.pixel_direction(x, y));
                normals.iter().zip(&mut truth).for_each(|(n, sum)| *sum += energy * n.dot(direction).max(0.0));
            }
        }
        // `count` candidates from a random one on, as a run-time would take them.
        let sampled = |normal: DVec3, count: usize| -> DVec3 {
            (0..strata.strata().len())
                .flat_map(|i| {
                    let first = (crate::math::random::bits(1, i as u64, normal.x.to_bits()) % 64) as usize;
                    strata.candidates(i).iter().cycle().skip(first).take(count)
                })
                .map(|c| c.weight * c.direction.dot(normal).max(0.0) / count as f64)
                .sum()
        };
        let worst = |count: usize| {
            let error = |n: &DVec3, t: &DVec3| ((sampled(*n, count) - t) / t).abs().max_element();
            normals.iter().zip(&truth).map(|(n, t)| error(n, t)).fold(0.0, f64::max)
        };
        println!("{name}: {seconds:.3} s, worst error {:.4} (64), {:.4} (8), {:.4} (1)", worst(64), worst(8), worst(1));
        assert!(worst(64) < 0.01, "{name}: {}", worst(64));
        assert!(worst(1) < 0.2, "{name}: {}", worst(1));
    }
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
