//! Small pictures against stored ones: what changes a picture, changes it knowingly.
//!
//! A picture that is missing fails. After a wanted change, `TRANSLUX_BLESS=1 cargo test --release --test physics golden` writes them
//! anew; look at them before they are kept.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::in_memory;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::in_memory::{lit, open, scene, scene_of, try_bake};
use glam::DVec3;
use translux::evaluate::Evaluator;
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::io::exr::{ExrPlane, decode_planes};
use translux::io::exr_write::{ExrChannel, ExrImage, ExrLayer, SampleKind};
use translux::light::{Light, sky};
use translux::progress::Silent;
use translux::render::camera::{Camera, Resolution};
use translux::render::frame::{Frame, Pixel, RenderSettings, render};
use translux::transport::scene::Scene;

/// RMS difference over the stored picture's RMS that is put up with, for each layer of colour. Other machines' mathematical
/// libraries differ in last digits, which tips single eye rays over an outline and single samples of a compressed
/// asset over a threshold: a few pixels of 16384 by a sixteenth, below a tenth of a percent together. 16 bits round by
/// 0.02 %. A picture that is 1 % brighter, or turned by a tenth of a pixel, is far beyond it.
const TOLERANCE: f64 = 2e-3;
/// All stored pictures together.
const MOST_BYTES: u64 = 400_000;
const SIDE: usize = 128;
const SAMPLES: usize = 3000;
const LAYERS: [&str; 3] = ["", "diffuse.", "specular."];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/golden")
}

fn bless() -> bool {
    std::env::var("TRANSLUX_BLESS").is_ok_and(|v| v == "1")
}

fn head() -> Scene {
    scene(shapes::bumpy_head(1.0, 4), Scale::DiagonalMm(30.0), "skin1")
}

/// A ball in one medium on a slab of another.
fn still_life() -> Scene {
    let called = |mut model: SourceModel, name: &str| {
        model.materials = vec![name.to_owned()];
        model
    };
    let ball = called(shapes::icosphere(6.0, 4), "ball");
    let slab = called(shapes::cuboid(DVec3::new(22.0, 3.0, 22.0), 8), "slab");
    let model = shapes::compose(&[(ball, DVec3::new(0.0, 7.6, 0.0)), (slab, DVec3::ZERO)]);
    scene_of(model, Scale::MillimetresPerUnit(1.0), &[("ball", "wholemilk"), ("slab", "marble")])
}

fn picture(evaluator: &mut dyn Evaluator, light: Light) -> Vec<u8> {
    let radiosity = lit(evaluator, vec![light.clone()]);
    let resolution = Resolution::new(SIDE, SIDE).unwrap();
    let camera = Camera::framing(&evaluator.scene().mesh, resolution).unwrap();
    let view = RenderSettings::new(camera, resolution);
    colours(&render(evaluator, &radiosity, &[light], &view, &Silent).unwrap())
}

/// The layers of colour alone, so that the stored files are small.
fn colours(frame: &Frame) -> Vec<u8> {
    let layer = |name: &str, value: fn(&Pixel) -> [f32; 3]| {
        let channel = |c: usize| ExrChannel {
            name: ["R", "G", "B"][c].to_owned(),
            kind: SampleKind::Half,
            samples: frame.pixels.iter().map(|p| value(p)[c]).collect(),
        };
        ExrLayer { name: name.to_owned(), channels: (0..3).map(channel).collect() }
    };
    let layers = vec![layer("", |p| p.beauty), layer("diffuse", |p| p.diffuse), layer("specular", |p| p.specular)];
    let Resolution { width, height } = frame.resolution;
    ExrImage { width, height, layers, attributes: Vec::new() }.encode().unwrap()
}

/// Colours of a layer, channel after channel.
fn layer(planes: &[ExrPlane], prefix: &str) -> Vec<f64> {
    let plane = |c: &str| planes.iter().find(|p| p.name == format!("{prefix}{c}")).unwrap();
    ["R", "G", "B"].iter().flat_map(|c| plane(c).samples.iter().map(|v| f64::from(*v))).collect()
}

/// RMS difference over the RMS of the stored one; infinite where sizes differ or nothing is stored.
fn difference(picture: &[f64], stored: &[f64]) -> f64 {
    let square = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
    if picture.len() != stored.len() {
        return f64::INFINITY;
    }
    let differences: Vec<f64> = picture.iter().zip(stored).map(|(a, b)| a - b).collect();
    let relative = (square(&differences) / square(stored)).sqrt();
    if relative.is_finite() { relative } else { f64::INFINITY }
}

/// What is wrong with a picture.
fn judge(name: &str, picture: &[u8], stored: Option<&[u8]>) -> Result<(), String> {
    let Some(stored) = stored else {
        return Err(format!(
            "fixtures/golden/{name}.exr is missing; TRANSLUX_BLESS=1 cargo test --release --test physics golden makes it"
        ));
    };
    let (picture, stored) = (decode_planes(picture).unwrap(), decode_planes(stored).map_err(|e| e.to_string())?);
    for prefix in LAYERS {
        let found = difference(&layer(&picture, prefix), &layer(&stored, prefix));
        println!("{name} {prefix}: {:.4} %", 100.0 * found);
        if found > TOLERANCE {
            let layer = if prefix.is_empty() { "beauty" } else { prefix.trim_end_matches('.') };
            return Err(format!("{name}: {layer} differs by {:.3} % from the stored one", 100.0 * found));
        }
    }
    Ok(())
}

fn check(name: &str, evaluator: &mut dyn Evaluator, light: Light) {
    let made = picture(evaluator, light);
    let path = folder().join(format!("{name}.exr"));
    if bless() {
        std::fs::create_dir_all(folder()).unwrap();
        std::fs::write(&path, &made).unwrap();
    }
    if let Err(what) = judge(name, &made, std::fs::read(&path).ok().as_deref()) {
        let actual = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.exr"));
        std::fs::write(&actual, &made).unwrap();
        panic!("{what}; the new one is {}", actual.display());
    }
}

#[test]
fn pictures_are_the_stored_ones() {
    let mut evaluator = open("editable", head(), Some(SAMPLES));
    let evaluator = evaluator.as_mut();
    check("head_sky", evaluator, Light::environment(Arc::new(sky::sky()), 0.0, DVec3::ONE).unwrap());
    let back = Light::directional(DVec3::new(-0.6, 0.5, -1.0), DVec3::new(3.0, 2.9, 2.7)).unwrap();
    check("head_back", evaluator, back);
    let editable = in_memory::method("editable");
    let stored = try_bake(editable, still_life(), Some(SAMPLES), &[("transport".into(), "stored".into())]).unwrap();
    let mut evaluator = in_memory::registry().open(Arc::new(stored)).unwrap();
    let evaluator = evaluator.as_mut();
    check("still_life_point", evaluator, Light::point(DVec3::new(-15.0, 25.0, 20.0), DVec3::splat(2000.0)).unwrap());
    let (at, size) = (DVec3::new(20.0, 25.0, 5.0), [12.0, 8.0]);
    let area = Light::area(at, DVec3::new(0.0, 5.0, 0.0) - at, size, DVec3::new(4.0, 4.2, 4.5), None).unwrap();
    check("still_life_area", evaluator, area);
}

#[test]
fn stored_pictures_are_small() {
    let entries = std::fs::read_dir(folder()).unwrap();
    let bytes: u64 = entries.map(|e| e.unwrap().metadata().unwrap().len()).sum();
    assert!((1..=MOST_BYTES).contains(&bytes), "{bytes} bytes");
}

/// The comparison itself: it sees a planted change of any layer, and a picture that is not there.
#[test]
fn a_changed_or_missing_picture_is_noticed() {
    let mut evaluator =
        open("reference", scene(shapes::icosphere(5.0, 2), Scale::DiagonalMm(10.0), "marble"), Some(500));
    let light = Light::directional(DVec3::new(0.3, 0.8, 0.5), DVec3::ONE).unwrap();
    let radiosity = lit(evaluator.as_mut(), vec![light.clone()]);
    let resolution = Resolution::new(32, 32).unwrap();
    let view = RenderSettings::new(Camera::framing(&evaluator.scene().mesh, resolution).unwrap(), resolution);
    let frame = render(evaluator.as_ref(), &radiosity, &[light], &view, &Silent).unwrap();
    let stored = colours(&frame);
    assert_eq!(judge("same", &stored, Some(&stored)), Ok(()));
    assert!(judge("missing", &stored, None).unwrap_err().contains("TRANSLUX_BLESS=1"));
    let brighter = |colour: [f32; 3]| colour.map(|c| 1.01 * c);
    for changed in 0..3 {
        let mut other = frame.clone();
        for p in &mut other.pixels {
            match changed {
                0 => p.beauty = brighter(p.beauty),
                1 => p.diffuse = brighter(p.diffuse),
                _ => p.specular = brighter(p.specular),
            }
        }
        let found = judge("brighter", &colours(&other), Some(&stored));
        assert!(found.unwrap_err().contains(["beauty", "diffuse", "specular"][changed]));
    }
    let mut shifted = frame.clone();
    shifted.pixels.rotate_right(1);
    assert!(judge("shifted", &colours(&shifted), Some(&stored)).is_err());
    assert_eq!(difference(&[1.0], &[0.0]), f64::INFINITY);
    assert_eq!(difference(&[1.0], &[1.0, 1.0]), f64::INFINITY);
}
