//! `render` and `demo` as their users run them.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use common::{Folder, called};
use glam::DVec3;
use translux::geometry::shapes;
use translux::io::exr::read_exr_channels;
use translux::io::png::read_png;

fn baked() -> Folder {
    let folder = Folder::new();
    folder.obj("ball.obj", &called(shapes::bumpy_head(10.0, 4), "stone"));
    folder.run("bake ball.obj --unit mm --material marble --method two_pass -o ball.tlux -q").ok();
    folder
}

#[test]
fn pictures_come_from_the_asset_alone_and_have_every_layer() {
    let folder = baked();
    let line = "render ball.tlux --light sky --resolution 64x48 -q";
    folder.run(&format!("{line} -o a.exr -o a.png")).ok();
    let alone = Folder::new();
    alone.write("ball.tlux", folder.read("ball.tlux"));
    alone.run(&format!("{line} -o a.exr -o a.png")).ok();
    assert_eq!(folder.read("a.exr"), alone.read("a.exr"));
    assert_eq!(folder.read("a.png"), alone.read("a.png"));
    let planes = read_exr_channels(&folder.path("a.exr")).unwrap();
    assert!(planes.iter().all(|p| (p.width, p.height) == (64, 48)));
    for name in ["R", "G", "B", "A", "diffuse.R", "normal.X", "normal.Z", "depth.Z", "coverage.A"] {
        assert!(planes.iter().any(|p| p.name == name), "no channel {name}");
    }
    let png = read_png(&folder.path("a.png")).unwrap();
    assert_eq!((png.width, png.height), (64, 48));
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    let folder = baked();
    for threads in [1, 2, 8] {
        let outputs = format!("-o {threads}.exr -o {threads}.png");
        folder.run(&format!("render ball.tlux --threads {threads} --resolution 50x50 -q {outputs}")).ok();
    }
    for threads in [2, 8] {
        assert_eq!(folder.read("1.exr"), folder.read(&format!("{threads}.exr")));
        assert_eq!(folder.read("1.png"), folder.read(&format!("{threads}.png")));
    }
}

#[test]
fn a_material_edit_changes_the_picture_and_compare_says_by_how_much() {
    let folder = baked();
    let line = "render ball.tlux --light constant:radiance=1 --background none --resolution 40x40 -q";
    folder.run(&format!("{line} -o marble.exr")).ok();
    folder.run(&format!("{line} -o again.exr")).ok();
    folder.run(&format!("{line} --material skin1 -o skin.exr")).ok();
    folder.run("compare marble.exr again.exr").ok();
    folder.run("compare skin.exr marble.exr").fails(7, &[]);
    let report = folder.run("compare skin.exr marble.exr --fail-above 100% --json").ok().json();
    let rms = report["image"]["rms"].as_f64().unwrap();
    // Skin reflects 0.13 to 0.44, marble 0.75 to 0.83.
    assert!((0.2..0.9).contains(&rms), "{rms}");
}

#[test]
fn light_from_one_side_lights_that_side_of_the_picture() {
    let folder = baked();
    let line = "render ball.tlux --light directional:from=1,0,0.2:irradiance=3 --background none --resolution 40x40 -q";
    folder.run(&format!("{line} -o side.exr")).ok();
    let planes = read_exr_channels(&folder.path("side.exr")).unwrap();
    let red = planes.iter().find(|p| p.name == "diffuse.R").unwrap();
    let half = |from: usize| -> f32 {
        (0..40).flat_map(|y| (from..from + 20).map(move |x| (x, y))).map(|(x, y)| red.samples[y * 40 + x]).sum()
    };
    assert!(half(20) > 2.0 * half(0), "right {} left {}", half(20), half(0));
}

#[test]
fn wrong_pictures_are_refused_before_the_work() {
    let folder = baked();
    for (arguments, code, fragment) in [
        ("-o a.jpg", 1, ".exr"),
        ("--resolution 0x10 -o a.png", 1, "resolution"),
        ("--camera at=0,0,0:look=0,0,0 -o a.png", 1, "at"),
        ("--camera elsewhere=1 -o a.png", 1, "elsewhere"),
        ("--exposure bright -o a.png", 1, "bright"),
        ("--max-memory 1MB --resolution 8000x8000 -o a.png", 4, "--resolution"),
        ("-o nowhere/a.png", 2, "nowhere"),
    ] {
        folder.run(&format!("render ball.tlux {arguments}")).fails(code, &[fragment]);
    }
}

#[test]
fn the_demo_writes_what_it_says_and_its_advice_works() {
    let folder = Folder::new();
    let text = folder.run("demo -o show").ok().text();
    let mut names: Vec<String> = std::fs::read_dir(folder.path("show"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["demo.exr", "demo.png", "demo.tlux"]);
    let advised: Vec<&str> =
        text.lines().map(str::trim).filter(|l| l.starts_with("translux ") && l.contains("demo.tlux")).collect();
    assert!(advised.len() >= 3, "{text}");
    for line in advised {
        folder.run(line.trim_start_matches("translux ")).ok();
    }
    // The sun stands behind the model: its thin ears, at the sides, are brighter than its thick head.
    let png = read_png(&folder.path("show/demo.png")).unwrap();
    let at = |x: f64, y: f64| {
        let (x, y) = ((x * png.width as f64) as usize, (y * png.height as f64) as usize);
        DVec3::from_array(png.rgb[y * png.width + x].map(f64::from)).element_sum()
    };
    assert!(at(0.85, 0.3) > 1.2 * at(0.5, 0.4), "ear {} head {}", at(0.85, 0.3), at(0.5, 0.4));
}
