//! `translux relight`: the animation without a window, and the window under a virtual display.
#![allow(clippy::unwrap_used)]

#[cfg(feature = "gui")]
mod window;

use std::process::Command;

use crate::common::Folder;
use translux::geometry::shapes;
use translux::io::png::read_png;

fn baked() -> Folder {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(10.0, 3));
    folder.run("bake ball.obj --unit mm --material marble --method two_pass --samples 500 -o ball.tlux -q").ok();
    folder
}

#[test]
fn every_frame_turns_the_lights_and_the_timings_are_complete() {
    let folder = baked();
    let lights = "--light directional:from=1,0.3,0:irradiance=3";
    for device in ["auto", "cpu"] {
        let line = format!(
            "relight ball.tlux --headless --frames 4 --out {device} --device {device} {lights} --background none \
             --resolution 60x40 --no-specular --json"
        );
        let report = folder.run(&line).ok().json();
        let text = String::from_utf8(folder.read(&format!("{device}/timings.json"))).unwrap();
        let timings: serde_json::Value = serde_json::from_str(&text).unwrap();
        crate::common::schema::check(&timings);
        assert_eq!(timings, report["animation"]);
        assert_eq!(timings["schema"], "translux.relight-timings.v1");
        assert_eq!(timings["frames"].as_array().unwrap().len(), 4);
        assert_eq!(timings["adapter"].is_null(), device == "cpu" || timings["adapter"].is_null());
        assert!(timings["vertices"].as_u64().unwrap() > 100 && timings["samples"].as_u64().unwrap() > 100);
        for frame in timings["frames"].as_array().unwrap() {
            let ms = |key: &str| frame[key].as_f64().unwrap();
            assert!((ms("light_ms") + ms("transport_ms") + ms("draw_ms") - ms("total_ms")).abs() < 1e-6);
        }
        assert!(timings["summary"]["total_ms"]["median"].as_f64().unwrap() > 0.0);
        // The light comes from the right, then from behind, then from the left, then from the front.
        let halves: Vec<[f64; 2]> = (0..4)
            .map(|frame| {
                let png = read_png(&folder.path(&format!("{device}/frame_000{frame}.png"))).unwrap();
                assert_eq!((png.width, png.height), (60, 40));
                assert!(png.alpha.is_some());
                let half = |from: usize| -> f64 {
                    let pixels = (0..40).flat_map(|y| (from..from + 30).map(move |x| y * 60 + x));
                    pixels.map(|i| f64::from(png.rgb[i][0])).sum()
                };
                [half(0), half(30)]
            })
            .collect();
        assert!(halves[0][1] > 1.5 * halves[0][0] && halves[2][0] > 1.5 * halves[2][1], "{device}: {halves:?}");
        assert!(halves[3].iter().sum::<f64>() > 1.3 * halves[1].iter().sum::<f64>(), "{device}: {halves:?}");
        let near = |a: f64, b: f64| (a - b).abs() < 0.1 * a.max(b);
        assert!(near(halves[0][1], halves[2][0]) && near(halves[3][0], halves[3][1]), "{device}: {halves:?}");
    }
}

#[test]
fn the_first_frame_is_exposed_as_render_does() {
    let folder = baked();
    let view = "--light sky --background none --resolution 60x40";
    let report = folder.run(&format!("render ball.tlux {view} --samples-per-pixel 4 -o a.png --json")).ok().json();
    let line = format!("relight ball.tlux {view} --headless --frames 1 --out one --device cpu --json");
    let timings = folder.run(&line).ok().json();
    assert_eq!(timings["animation"]["exposure_factor"], report["exposure_factor"]);
}

#[test]
fn twelve_triangles_are_shown_refined_where_light_is_gathered() {
    let folder = Folder::new();
    folder.obj("cube.obj", &shapes::cuboid(glam::DVec3::splat(20.0), 1));
    let bake = "bake cube.obj --unit mm --material marble --for-lights directional -q";
    let view = "--light directional:from=1,2,3:irradiance=2 --view three-quarter --no-specular --background none --resolution 60x60";
    let shown = |asset: &str| {
        let line = format!("relight {asset}.tlux {view} --headless --frames 1 --out {asset} --device cpu --json");
        let told = folder.run(&line).ok();
        let vertices = told.json()["animation"]["vertices"].as_u64().unwrap();
        (told.stderr, vertices, read_png(&folder.path(&format!("{asset}/frame_0000.png"))).unwrap())
    };
    // Samples alone, and samples with rows for environments beside them.
    for (asset, more) in [("two_pass", ""), ("editable", "--samples 8000 --for-lights environment,directional")] {
        let bake =
            bake.replace("--for-lights directional", if more.is_empty() { "--for-lights directional" } else { "" });
        folder.run(&format!("{bake} --method {asset} {more} -o {asset}.tlux")).ok();
        folder.run(&format!("render {asset}.tlux {view} --samples-per-pixel 4 -o {asset}.png -q")).ok();
        let (told, vertices, frame) = shown(asset);
        assert!(told.contains("12 triangles are shown as") && vertices > 1000, "{asset}: {told}");
        let picture = read_png(&folder.path(&format!("{asset}.png"))).unwrap();
        let differences = frame.rgb.iter().zip(&picture.rgb).map(|(a, b)| (f64::from(a[1]) - f64::from(b[1])).powi(2));
        let rms = (differences.sum::<f64>() / frame.rgb.len() as f64).sqrt();
        assert!(rms < 3.0, "{asset}: {rms} of 255");
    }
    // Where light ends at the vertices nothing is added, and that is told.
    folder.run(&format!("{bake} --method editable --set transport=stored --samples 4000 -o stored.tlux")).ok();
    let (told, vertices, _) = shown("stored");
    assert!(told.contains("--refine auto") && vertices == 8, "{told}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = baked();
    folder.write("file", "");
    for (arguments, code, fragment) in [
        ("--headless", 1, "--frames"),
        ("--headless --frames 3", 1, "--out"),
        ("--frames 3", 1, "--headless"),
        ("--out x", 1, "--headless"),
        ("--headless --frames 0 --out x", 1, "--frames 0"),
        ("--headless --frames 2 --out x --turn", 1, "--turn"),
        ("--headless --frames 2 --out x --roughness shiny", 1, "shiny"),
        ("--headless --frames 2 --out x --highlights blinn-phong:0", 1, "exponent 0"),
        ("--headless --frames 2 --out x --highlights blinn-phong:20 --roughness 0.3", 1, "leave --roughness out"),
        ("--highlights blinn-phong:20 --roughness 0.3", 1, "leave --roughness out"),
        ("--headless --frames 2 --out no/such", 2, "no/such"),
        ("--headless --frames 2 --out file", 2, "file"),
    ] {
        folder.run(&format!("relight ball.tlux {arguments}")).fails(code, &[fragment]);
    }
    assert!(!folder.names().contains(&"x".to_owned()));
}

#[test]
fn without_a_display_the_message_says_what_to_type() {
    let folder = baked();
    let output = Command::new(env!("CARGO_BIN_EXE_translux"))
        .current_dir(folder.path(""))
        .args(["relight", "ball.tlux"])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(5), "{stderr}");
    assert!(stderr.contains("--headless") && stderr.contains("render") && !stderr.contains("panicked"), "{stderr}");
}

#[test]
fn without_an_adapter_the_cpu_draws_unless_the_adapter_was_asked_for() {
    let folder = baked();
    let run = |device: &str| {
        let line =
            format!("relight ball.tlux --headless --frames 1 --out {device} --resolution 30x20 --device {device}");
        let output = Command::new(env!("CARGO_BIN_EXE_translux"))
            .current_dir(folder.path(""))
            .args(line.split_whitespace())
            // An interface that this system does not have.
            .env("WGPU_BACKEND", if cfg!(target_os = "linux") { "metal" } else { "none" })
            .output()
            .unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, stderr) = run("auto");
    assert_eq!(code, Some(0), "{stderr}");
    assert!(stderr.contains("drawn on the CPU"), "{stderr}");
    let (code, stderr) = run("gpu");
    assert_eq!(code, Some(5), "{stderr}");
    assert!(stderr.contains("--device cpu"), "{stderr}");
}
