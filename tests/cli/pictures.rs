//! `render` and `demo` as their users run them.
#![allow(clippy::unwrap_used, missing_docs)]

use std::sync::OnceLock;

use crate::common::{Folder, called};
use glam::DVec3;
use translux::geometry::shapes;
use translux::io::exr::read_exr_channels;
use translux::io::png::read_png;

/// A folder with `ball.tlux`, which is baked once for all tests.
fn baked() -> Folder {
    static ASSET: OnceLock<Vec<u8>> = OnceLock::new();
    let folder = Folder::new();
    let bytes = ASSET.get_or_init(|| {
        folder.obj("ball.obj", &called(shapes::bumpy_head(10.0, 4), "stone"));
        folder.run("bake ball.obj --unit mm --material marble --method two_pass --samples 6000 -o ball.tlux -q").ok();
        folder.read("ball.tlux")
    });
    folder.write("ball.tlux", bytes);
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
    for name in
        ["R", "G", "B", "A", "diffuse.R", "specular.B", "normal.X", "normal.Z", "depth.Z", "coverage.A", "part.ID"]
    {
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
fn exitance_is_evaluated_at_pixels_by_what_gathers_and_refused_by_the_rest() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(8.0, 3));
    let bake = "bake head.obj --unit mm --material marble --samples 4096 -q";
    folder.run(&format!("{bake} --method two_pass -o a.tlux")).ok();
    let line = "render a.tlux --light directional:from=1,2,3:irradiance=2 --no-specular --resolution 40x30";
    for threads in [1, 4] {
        let report =
            folder.run(&format!("{line} --threads {threads} --exitance pixels -o {threads}.exr --json")).ok().json();
        assert_eq!(report["exitance"], "pixels");
        assert!(report["timings"]["stages"].as_array().unwrap().iter().any(|stage| stage["stage"] == "transfer"));
    }
    assert_eq!(folder.read("1.exr"), folder.read("4.exr"));
    assert!(folder.read("1.exr").windows(24).any(|w| w == b"at what each pixel sees,"));
    let report = folder.run(&format!("{line} --exitance vertices -o vertices.exr --json")).ok().json();
    assert_eq!(report["exitance"], "vertices");
    // The vertices are near, not the same.
    folder.run("compare 1.exr vertices.exr").fails(7, &[]);
    folder.run("compare 1.exr vertices.exr --fail-above 20%").ok();
    // What is refused whatever its samples.
    let stored = bake.replace("--samples 4096", "--samples 500");
    folder
        .run(&format!("{stored} --method editable --set transport=stored --for-lights directional -o stored.tlux"))
        .ok();
    let refusal = ["--exitance pixels", "reference", "two_pass", "editable"];
    folder.run("render stored.tlux --exitance pixels --resolution 8x8 -o refused.exr").fails(5, &refusal);
    assert!(!folder.path("refused.exr").exists());
}

#[test]
fn pictures_of_coarse_meshes_take_pixels_where_they_can_and_say_so() {
    let folder = Folder::new();
    folder.obj("cube.obj", &shapes::cuboid(DVec3::splat(20.0), 1));
    let bake = "bake cube.obj --unit mm --material marble --for-lights directional -q";
    folder.run(&format!("{bake} --method two_pass -o a.tlux")).ok();
    folder.run(&format!("{bake} --method reference --samples 20000 -o truth.tlux")).ok();
    let light = "--light directional:from=1,2,3:irradiance=2 --no-specular --resolution 48x48 --samples-per-pixel 4";
    let run = |asset: &str, more: &str| folder.run(&format!("render {asset}.tlux {light} {more} --json")).ok();
    let told = run("a", "-o auto.exr -o auto.png");
    assert!(
        told.stderr.contains("exitance at pixels") && told.stderr.contains("--exitance vertices"),
        "{}",
        told.stderr
    );
    let report = told.json();
    assert_eq!(report["exitance"], "pixels");
    assert!(report["between_vertices"]["rms"].as_f64().unwrap() > 0.3);
    let asked = run("a", "--exitance pixels -o pixels.exr").json();
    assert!(asked.get("between_vertices").is_none());
    assert_eq!(folder.read("auto.exr"), folder.read("pixels.exr"));
    run("truth", "--exitance pixels -o truth.exr");
    folder.run("compare auto.exr truth.exr --fail-above 2%").ok();
    // Sums of another kind, whose resolution the corners of the cube say nothing of.
    folder.run(&format!("{bake} --method editable -o editable.tlux")).ok();
    assert_eq!(run("editable", "-o editable.exr").json()["exitance"], "pixels");
    folder.run("compare editable.exr truth.exr --fail-above 2%").ok();
    run("a", "--exitance vertices -o vertices.exr");
    folder.run("compare vertices.exr truth.exr --fail-above 20%").fails(7, &[]);
    // The same cube is small beside the free path of light.
    assert_eq!(run("a", "--size-mm 0.3 -o small.exr").json()["exitance"], "vertices");
    // Transport that ends at the vertices: a picture, and a fault.
    folder.run(&format!("{bake} --method editable --set transport=stored -o stored.tlux")).ok();
    let told = run("stored", "-o stored.exr");
    assert!(
        told.stderr.contains("off between vertices") && told.stderr.contains("--method editable"),
        "{}",
        told.stderr
    );
    assert_eq!(told.json()["exitance"], "vertices");
    folder.run(&format!("render stored.tlux {light} -o strict.exr --strict")).fails(6, &["between vertices"]);
    // Nothing is measured of a mesh that is fine.
    let ball = baked();
    let report = ball.run("render ball.tlux --resolution 16x16 -o a.exr --json").ok().json();
    assert_eq!(report["exitance"], "vertices");
    assert!(report.get("between_vertices").is_none());
    // One sheet has both.
    let sheet = "sheet cube.obj --materials marble --sizes 0.3,20 --lights directional:from=1,2,3:irradiance=2";
    let told = folder.run(&format!("{sheet} --resolution 32x32 -o sheet.png --json")).ok();
    assert!(told.stderr.contains("exitance at pixels in 1 of 2 pictures"), "{}", told.stderr);
    let cells = told.json()["cells"].clone();
    assert_eq!((&cells[0]["exitance"], &cells[1]["exitance"]), (&"vertices".into(), &"pixels".into()));
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

fn plane(folder: &Folder, file: &str, name: &str) -> Vec<f32> {
    read_exr_channels(&folder.path(file)).unwrap().into_iter().find(|p| p.name == name).unwrap().samples
}

#[test]
fn specular_reflection_is_a_layer_that_can_be_made_rougher_or_left_out() {
    let folder = baked();
    let line = "render ball.tlux --light directional:from=0.2,0.5,1:irradiance=3 --resolution 40x40 -q";
    for (options, file) in [("", "a.exr"), ("--roughness 0.3", "b.exr"), ("--roughness 1", "rough.exr")] {
        folder.run(&format!("{line} {options} -o {file}")).ok();
    }
    let report = folder.run(&format!("{line} --no-specular -o off.exr --json")).ok().json();
    assert!(report["roughness"].is_null() && report["exr_type"] == "half", "{report}");
    assert_eq!(folder.read("a.exr"), folder.read("b.exr"), "0.3 is the default");
    let brightest = |file: &str| plane(&folder, file, "specular.G").into_iter().fold(0.0, f32::max);
    assert!(brightest("a.exr") > 4.0 * brightest("rough.exr") && brightest("rough.exr") > 0.0);
    assert_eq!(brightest("off.exr"), 0.0);
    assert_eq!(plane(&folder, "a.exr", "diffuse.R"), plane(&folder, "off.exr", "diffuse.R"));
    // Figures of errors are those of the diffuse layer.
    folder.run("compare a.exr rough.exr --fail-above 0").ok();
    for (bad, fragment) in [("--roughness 1.5", "from 0 (polished) to 1 (matt)"), ("--roughness -1", "matt")] {
        folder.run(&format!("{line} {bad} -o c.exr")).fails(1, &[fragment]);
    }
    folder.run(&format!("{line} --roughness 0.5 --no-specular -o c.exr")).fails(1, &["--no-specular"]);
}

#[test]
fn highlights_follow_the_model_that_is_asked_for() {
    let folder = baked();
    let line = "render ball.tlux --light directional:from=0.2,0.5,1:irradiance=3 --resolution 40x40 -q";
    for (options, file) in [
        ("", "a.exr"),
        ("--highlights ggx --roughness 0.3", "ggx.exr"),
        ("--highlights blinn-phong:20", "wide.exr"),
        ("--highlights blinn-phong:200", "narrow.exr"),
    ] {
        folder.run(&format!("{line} {options} -o {file}")).ok();
    }
    assert_eq!(folder.read("a.exr"), folder.read("ggx.exr"), "ggx is the default");
    let layer = |file: &str| plane(&folder, file, "specular.G");
    let brightest = |file: &str| layer(file).into_iter().fold(0.0, f32::max);
    let share = |file: &str| layer(file).into_iter().filter(|v| *v > 0.1 * brightest(file)).count();
    assert!(brightest("narrow.exr") > 5.0 * brightest("wide.exr"), "{}", brightest("wide.exr"));
    assert!(share("wide.exr") > 4 * share("narrow.exr") && share("narrow.exr") > 3, "{}", share("narrow.exr"));
    assert_eq!(plane(&folder, "a.exr", "diffuse.R"), plane(&folder, "wide.exr", "diffuse.R"));
    assert!(String::from_utf8_lossy(&folder.read("wide.exr")[..4096]).contains("blinn-phong:20"));
    let report = folder.run(&format!("{line} --highlights blinn-phong:20 -o b.exr --json")).ok().json();
    assert!(report["highlights"] == "blinn-phong:20" && report["roughness"].is_null(), "{report}");
    for exponent in ["0", "-20", "nan", "inf", "shiny", "", "10001"] {
        folder.run(&format!("{line} --highlights blinn-phong:{exponent} -o c.exr")).fails(1, &["for example"]);
    }
    folder.run(&format!("{line} --highlights phong -o c.exr")).fails(1, &["ggx or blinn-phong:EXPONENT"]);
    for other in ["--roughness 0.3", "--no-specular"] {
        folder.run(&format!("{line} --highlights blinn-phong:20 {other} -o c.exr")).fails(1, &[&other[..10]]);
    }
    // Told before the asset is read.
    folder
        .run("render no.tlux --highlights blinn-phong:20 --roughness 0.3 -o c.exr")
        .fails(1, &["leave --roughness out"]);
}

#[test]
fn colours_have_16_bits_or_32_and_what_is_cut_is_said() {
    let folder = baked();
    let line = "render ball.tlux --light constant:radiance=1e6 --resolution 24x24";
    let half = folder.run(&format!("{line} -o half.exr")).ok();
    assert!(half.stderr.contains("576 pixels have colours above 65504"), "{}", half.stderr);
    let float = folder.run(&format!("{line} --exr-type float -o float.exr")).ok();
    let png = folder.run(&format!("{line} -o a.png")).ok();
    assert!(!float.stderr.contains("65504") && !png.stderr.contains("65504"), "{}{}", float.stderr, png.stderr);
    assert_eq!((plane(&folder, "half.exr", "R")[0], plane(&folder, "float.exr", "R")[0]), (65_504.0, 1e6));
    assert_eq!(plane(&folder, "half.exr", "depth.Z"), plane(&folder, "float.exr", "depth.Z"));
    folder.run(&format!("{line} --exr-type double -o c.exr")).fails(1, &["half", "float"]);
}

#[test]
fn the_header_says_what_made_the_picture() {
    let folder = Folder::new();
    let parts = [
        (called(shapes::icosphere(5.0, 2), "wax"), DVec3::ZERO),
        (called(shapes::icosphere(3.0, 1), "wick"), DVec3::X * 20.0),
    ];
    folder.obj("two.obj", &shapes::compose(&parts));
    folder
        .run(
            "bake two.obj --unit mm --material wax=skin1 --opaque wick --method two_pass --samples 2000 -o two.tlux -q",
        )
        .ok();
    folder.run("render two.tlux --light constant:radiance=2 --resolution 48x24 -q -o two.exr").ok();
    let bytes = folder.read("two.exr");
    let head = String::from_utf8_lossy(&bytes[..4096.min(bytes.len())]).into_owned();
    for text in [
        concat!("translux ", env!("CARGO_PKG_VERSION")),
        "two_pass",
        "skin1: sigma_s'=0.74,0.88,1.01/mm sigma_a=0.032,0.17,0.48/mm eta=1.3 g=0",
        "1 wax (skin1); 2 wick (opaque)",
        "constant:radiance=2",
        "fov=28",
        "roughness",
        "two.obj blake3 ",
    ] {
        assert!(head.contains(text), "no `{text}` in {head:?}");
    }
    assert!(!head.contains(folder.path("").to_str().unwrap()), "{head:?}");
    let ids = plane(&folder, "two.exr", "part.ID");
    let coverage = plane(&folder, "two.exr", "coverage.A");
    for part in [0.0, 1.0, 2.0] {
        assert!(ids.contains(&part));
    }
    assert!(ids.iter().zip(&coverage).all(|(id, coverage)| (*id > 0.0) == (*coverage > 0.0)));
    // The opaque part is matte, and what is wax is not.
    let line = "render two.tlux --light constant:radiance=2 --light directional:from=0,1,0.2:irradiance=3 --resolution 48x24 -q";
    folder.run(&format!("{line} --opaque-color #804020 --ground --background none -o two.exr -o two.png")).ok();
    let matte = ["R", "G", "B"].map(|channel| plane(&folder, "two.exr", &format!("opaque.{channel}")));
    assert!(ids.iter().zip(&matte[0]).all(|(id, red)| *id == 0.0 || (*id == 2.0) == (*red > 0.0)));
    let sums = matte.map(|values| values.iter().sum::<f32>());
    assert!(sums[0] > 2.0 * sums[1] && sums[1] > 2.0 * sums[2], "{sums:?}");
    let shadow = plane(&folder, "two.exr", "shadow.A");
    assert!(shadow.iter().filter(|dark| **dark > 0.2).count() > 20);
    let png = folder.png("two.png");
    let covers = png.alpha.unwrap();
    let off = |((alpha, shadow), coverage): ((&f32, &f32), &f32)| (alpha - (shadow + coverage).min(1.0)).abs();
    assert!(covers.iter().zip(&shadow).zip(&coverage).map(off).fold(0.0, f32::max) < 0.003);
    // Curves are for PNG alone.
    let linear = |tone: &str| {
        folder.run(&format!("{line} --tone {tone} -o {tone}.exr -o {tone}.png")).ok();
        (plane(&folder, &format!("{tone}.exr"), "R"), folder.png(&format!("{tone}.png")).rgb)
    };
    let (none, agx) = (linear("none"), linear("agx"));
    assert!(none.0 == agx.0 && none.1 != agx.1);
    folder.run(&format!("{line} --tone aces -o a.png")).fails(1, &["none, filmic, agx"]);
}

/// A sheet has a picture of each material, size and group of lights, made of one bake.
#[test]
fn a_sheet_shows_materials_and_sizes_from_one_bake() {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(5.0, 2));
    let line = "sheet ball.obj --materials marble,jade,skin1 --sizes 5,20 --lights directional:from=0,1,1:irradiance=3 \
                --lights constant:radiance=1;point:at=0,90,90:intensity=9000 --resolution 24x20 -o s.png -o s.html --json";
    let report = folder.run(line).ok().json();
    let cells = report["cells"].as_array().unwrap();
    assert_eq!((cells.len(), &report["cells"][7]["material"]), (12, &"jade".into()));
    assert_eq!(
        report["cells"][7]["lights"].as_array().unwrap().len() + cells[5]["lights"].as_array().unwrap().len(),
        3
    );
    // Light leaves a small ball of skin on all sides, a large one where it falls: the mean of its vertices tells.
    let red = |index: usize| cells[index]["mean_radiosity"][0].as_f64().unwrap();
    assert!(red(8) < 0.9 * red(9), "{} {}", red(8), red(9));
    let page = String::from_utf8(folder.read("s.html")).unwrap();
    assert_eq!(page.matches("<img").count(), 12);
    let png = folder.png("s.png");
    assert!(png.width > 4 * 24 && png.height > 3 * 20);
    folder.run("sheet ball.obj --materials marbel --sizes 5 -o s.png").fails(1, &["did you mean marble"]);
    folder.run("sheet ball.obj --materials marble --sizes 5 --unit mm -o s.png").fails(1, &["leave one out"]);
    folder.run("sheet ball.obj --materials marble --sizes 5 --lights ; -o s.png").fails(1, &["no light"]);
    folder
        .run("sheet ball.obj --materials marble --sizes 1,2,3,4,5 --resolution 4000x100 -o s.png")
        .fails(1, &["--resolution"]);
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
    let pictures =
        ["apple.exr", "apple.png", "demo.png", "demo.tlux", "marble.exr", "marble.png", "skin1.exr", "skin1.png"];
    assert_eq!(names, pictures);
    let advised: Vec<&str> =
        text.lines().map(str::trim).filter(|l| l.starts_with("translux ") && l.contains("demo.tlux")).collect();
    assert!(advised.len() >= 3, "{text}");
    // The window of `relight` has tests of its own.
    for line in advised.into_iter().filter(|line| !line.contains(" relight ")) {
        // Every word of the advice, and a picture that is made sooner.
        let smaller = if line.starts_with("translux render ") { " --resolution 48x48" } else { "" };
        folder.run(&format!("{}{smaller}", line.trim_start_matches("translux "))).ok();
    }
    // A lamp stands behind the model: its thin ear on that side is brighter than its thick head, in every material.
    let png = read_png(&folder.path("show/demo.png")).unwrap();
    let at = |x: f64, y: f64| {
        let (x, y) = ((x * png.width as f64) as usize, (y * png.height as f64) as usize);
        DVec3::from_array(png.rgb[y * png.width + x].map(f64::from)).element_sum()
    };
    for picture in 0..3 {
        let at = |x: f64, y: f64| at((f64::from(picture) + x) / 3.0, y);
        let (ear, head) = (at(0.79, 0.44), at(0.55, 0.44));
        assert!(ear > 2.0 * head, "picture {picture}: ear {ear}, head {head}");
    }
}
