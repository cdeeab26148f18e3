//! The second reader, scripts/reader, which knows the format's pages alone: what it makes of an asset is what `evaluate` makes of it.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Stdio};

use glam::DVec3;

use crate::common::{Folder, called};
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;

/// RMS difference over the RMS of `evaluate`.
const SAME: f64 = 1e-4;

/// The same between reference points, whose weights `evaluate` rounds to 1/16384 and whose lights to 16 bits.
const ROUNDED: f64 = 2e-4;

const SUN: &str = "directional:from=1,2,3:irradiance=3,2,1";
const LAMP: &str = "point:at=10,12,38:intensity=400";
const SKY: &str = "env:path=sky.hdr:rotate=30";
const WHITE: &str = "constant:radiance=1";

/// A Python with numpy and zstandard.
fn python() -> Option<&'static str> {
    let has = |name: &&str| {
        let mut command = Command::new(name);
        command.args(["-c", "import numpy, zstandard"]).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    let found = ["python3", "/usr/bin/python3"].into_iter().find(has);
    if found.is_none() {
        println!("SKIPPED: no Python with numpy and zstandard");
    }
    found
}

/// An ellipsoid, on whose convex surface nothing shadows anything.
fn ellipsoid(subdivisions: u32) -> SourceModel {
    let mut model = shapes::icosphere(1.0, subdivisions);
    model.positions.iter_mut().for_each(|p| *p *= DVec3::new(5.0, 4.0, 3.0));
    model
}

/// A body without symmetry, whose points are at no two equal distances.
fn potato(subdivisions: u32) -> SourceModel {
    let mut model = ellipsoid(subdivisions);
    for p in &mut model.positions {
        let waves =
            [(0.11, 0.7 * p.x + 0.3 * p.y + 0.4), (0.07, 0.9 * p.y - 0.5 * p.z + 1.6), (0.05, 0.8 * p.z + 0.2 * p.x)];
        *p *= 1.0 + waves.iter().map(|(size, phase)| size * phase.sin()).sum::<f64>();
    }
    model
}

/// A Radiance picture of 16 x 8 pixels of many colours.
fn sky() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n".to_vec();
    for i in 0..128u32 {
        let byte = |k: u32, least: u32, range: u32| (least + (i * k + i * i * 7) % range) as u8;
        bytes.extend([byte(37, 1, 255), byte(59, 1, 255), byte(83, 128, 128), byte(11, 126, 4)]);
    }
    bytes
}

/// Bakes the model, and compares what the reader makes of it under each set of lights.
fn agree(model: &SourceModel, bake: &str, lights: &[&str], most: f64) {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    folder.obj("body.obj", model).write("sky.hdr", sky());
    folder.run(&format!("bake body.obj -o a.tlux -q {bake}")).ok();
    let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/reader/read.py");
    let mut command = Command::new(python);
    command.current_dir(folder.path(".")).arg(reader).args(["a.tlux", "--most", &most.to_string()]);
    for (i, lights) in lights.iter().enumerate() {
        let arguments: String = lights.split('+').map(|light| format!(" --light {light}")).collect();
        folder.run(&format!("evaluate a.tlux -q -o {i}.ply{arguments}")).ok();
        command.args(["--case", lights, &format!("{i}.ply")]);
    }
    let output = command.env("PYTHONDONTWRITEBYTECODE", "1").output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    println!("{bake}\n{said}");
    assert!(output.status.success(), "{bake}: {said}");
    assert!(said.matches(" RMS").count() >= lights.len(), "{said}");
}

/// The files that no change may make unreadable, with sections of every type. That of 0.2 has a name of a form with four bytes more than a
/// string, which only whoever opens the form looks at: the reader refuses it.
#[test]
fn frozen_files_are_read() {
    let Some(python) = python() else { return };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in ["v0_0_full", "v0_1_full"] {
        let run = |file: &Path| {
            let reader = root.join("scripts/reader/read.py");
            Command::new(python).env("PYTHONDONTWRITEBYTECODE", "1").arg(reader).arg(file).output().unwrap()
        };
        let path = root.join(format!("formats/tests/data/{name}.tlux"));
        let output = run(&path);
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        // Its checks see a flipped bit.
        let folder = Folder::new();
        let mut bytes = std::fs::read(&path).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        folder.write("broken.tlux", bytes);
        assert_eq!(run(&folder.path("broken.tlux")).status.code(), Some(2), "{name}");
    }
}

#[test]
fn samples_read_as_the_pages_say() {
    let bake = "--unit mm --material skin1 --method reference --samples 600";
    agree(&ellipsoid(1), bake, &[SUN, LAMP, WHITE], SAME);
    // Two media, each with its samples, and a slab behind them.
    let place = |model: SourceModel, name: &str, at: DVec3| (called(model, name), at);
    let two = shapes::compose(&[
        place(ellipsoid(1), "wax", DVec3::ZERO),
        place(potato(1), "soap", DVec3::new(30.0, 0.0, 0.0)),
        place(shapes::cuboid(DVec3::new(60.0, 1.0, 20.0), 2), "slab", DVec3::new(15.0, -15.0, 0.0)),
    ]);
    let media = "--unit mm --material wax=marble --material soap=skin1 --opaque slab --method reference --samples 800";
    agree(&two, media, &["directional:from=0,1,0.1:irradiance=1"], SAME);
}

#[test]
fn rows_for_environments_read_as_the_page_says() {
    let bake = "--size-mm 24 --material skin1 --method editable --samples 600 --max-rms 0.1%";
    agree(&ellipsoid(1), bake, &[SKY, WHITE, SUN], SAME);
}

#[test]
fn the_far_field_reads_as_the_page_says() {
    let bake = "--size-mm 24 --material skin1 --method editable --samples 300 --max-rms 0.1% --set transport=stored";
    agree(&ellipsoid(1), bake, &[SUN, LAMP, SKY], SAME);
}

#[test]
fn sets_of_lights_read_as_the_page_says() {
    let bake = "--size-mm 24 --material skin1 --method quantized_lights --samples 1000 --set lights=60 --max-rms 0.3% \
                --for-lights directional,point,environment,constant";
    agree(&potato(2), bake, &[SUN, LAMP, SKY, WHITE], ROUNDED);
}

#[test]
fn harmonics_and_rows_of_distant_light_read_as_the_pages_say() {
    for (set, most) in [("basis=sh", ROUNDED), ("basis=haar", SAME), ("basis=haar --set transform=texels", SAME)] {
        let bake = format!(
            "--size-mm 24 --material skin1 --method all_frequency --samples 1000 --max-rms 0.1% \
             --set single-scattering=isotropic --for-lights directional,environment,constant --set {set}"
        );
        // Every vertex is a reference point, of this model and of a finer one.
        agree(&potato(1), &bake, &[SUN, SKY], most);
    }
}

#[test]
fn filtered_normals_read_as_the_page_says() {
    for set in ["filter=heat", "response=exponential", "filter=spectral --set response=gaussian"] {
        let bake = format!(
            "--size-mm 24 --material skin1 --method filtered_normals --samples 1000 --set length=unit --set shadows=off --set {set}"
        );
        agree(&potato(2), &bake, &[SUN], SAME);
    }
}

#[test]
fn atlases_and_light_in_their_texels_read_as_the_pages_say() {
    for sampling in ["shared", "clusters"] {
        let set = format!("--set sampling={sampling} --set resolution=32");
        let bake = format!("--size-mm 24 --material skin1 --method texture_space --samples 150 {set}");
        agree(&ellipsoid(1), &bake, &[SUN, LAMP, WHITE], SAME);
    }
}
