//! What the program refuses, with which exit code and which words; values of `--set`; help.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::common::{Folder, called};
use glam::DVec3;
use translux::geometry::shapes;

const SUN: &str = "--light directional:from=1,2,3:irradiance=2";

/// A folder with a cube of 10 mm, and arguments that light it.
fn cube() -> Folder {
    let folder = Folder::new();
    folder.obj("cube.obj", &shapes::cuboid(DVec3::splat(10.0), 3));
    folder
}

#[test]
fn code_0_and_what_is_written() {
    let folder = cube();
    folder.run("bake cube.obj --method editable --unit mm --material marble --samples 300 -o a.tlux").ok();
    folder.run(&format!("evaluate a.tlux {SUN} -o b.ply")).ok();
    folder.run("compare b.ply b.ply").ok();
    assert_eq!(folder.names(), ["a.tlux", "b.ply", "cube.obj"]);
}

#[test]
fn code_1_for_wrong_command_lines() {
    let folder = cube();
    folder.obj("metre.obj", &shapes::cuboid(DVec3::splat(0.1), 1));
    let reference = "reference cube.obj --samples 64 -o out.ply";
    let all = format!("{reference} --unit mm --material marble");
    for (line, fragments) in [
        ("".to_owned(), &["Usage"][..]),
        ("frobnicate".to_owned(), &["frobnicate"]),
        (format!("{all} --frobnicate"), &["--frobnicate"]),
        (format!("{reference} --unit mm"), &["--material marble", "translux materials", "--sigma-s"]),
        (format!("{reference} --material marble"), &["cube.obj", "10.0 x 10.0 x 10.0", "--unit cm", "--size-mm"]),
        ("bake metre.obj -o a.tlux --material marble".to_owned(), &["metres", "--unit m"]),
        (format!("{all} --size-mm 30"), &["--size-mm", "--unit"]),
        (format!("{reference} --material marble --size-mm -5"), &["--size-mm", "-5", "positive"]),
        (format!("{reference} --material marble --size-mm nan"), &["--size-mm", "positive"]),
        (format!("{reference} --unit mm --material marbel"), &["marbel", "did you mean marble"]),
        (format!("{reference} --unit mm --material wax=marble"), &["wax", "default"]),
        (format!("{all} --material skin1"), &["skin1"]),
        (format!("{all} --sigma-a -1"), &["sigma_a", "-1"]),
        (format!("{all} --eta 7"), &["eta", "7", "3"]),
        (format!("{all} --g 1"), &["g is 1"]),
        (format!("{all} --opaque wax"), &["wax", "default"]),
        (format!("{all} --skip wax"), &["wax", "default"]),
        (format!("{all} --method two-pass"), &["two-pass", "two_pass", "reference"]),
        ("methods two-pass".to_owned(), &["two-pass", "two_pass", "reference"]),
        (format!("{all} --set bound=kernel"), &["bound", "`reference` has no such key", "points"]),
        (format!("{all} --set points"), &["points", "key=value"]),
        (format!("{all} --set points=1 --set points=2"), &["--set points: given twice, as 1 and as 2"]),
        (format!("{all} --max-rms 0"), &["--max-rms", "1%"]),
        (format!("{all} --max-rms 150%"), &["--max-rms", "1%"]),
        (format!("{all} --light constnt:radiance=1"), &["constnt", "constant"]),
        (format!("{all} --light constant:radiance=-1"), &["radiance", "-1"]),
        (format!("{all} --light constant:radiance=x"), &["radiance", "x"]),
        (format!("{all} --light constant:irradiance=1"), &["irradiance", "radiance"]),
        (format!("{all} --light point:at=0,0,0"), &["intensity"]),
        (format!("{all} --light directional:from=0,0,0:irradiance=1"), &["from", "zero"]),
        (format!("{all} --threads 0"), &["--threads"]),
        (format!("{all} --max-memory lots"), &["--max-memory", "4GiB"]),
        (format!("{all} --max-memory 300"), &["--max-memory 300", "unit", "300MB"]),
        (format!("{all} -o out.obj"), &["out.obj", ".ply"]),
        (format!("{all} -o out.ply"), &["out.ply", "twice"]),
        (format!("{all} -o - --json"), &["-o -", "--json"]),
        ("bake cube.obj --unit mm --material marble -o a.ply".to_owned(), &["a.ply", ".tlux"]),
        ("compare cube.obj cube.obj".to_owned(), &["cube.obj", ".ply"]),
    ] {
        folder.run(&line).fails(1, fragments);
    }
    assert_eq!(folder.names(), ["cube.obj", "metre.obj"]);
}

#[test]
fn code_2_for_files() {
    let folder = cube();
    std::fs::create_dir(folder.path("taken.ply")).unwrap();
    let all = "reference cube.obj --unit mm --material marble --samples 64";
    folder.run(&all.replace("cube", "sphere")).fails(1, &["--output"]);
    folder.run(&format!("{} -o b.ply", all.replace("cube", "sphere"))).fails(2, &["sphere.obj"]);
    folder.run(&format!("{all} -o no/such/b.ply")).fails(2, &["no/such/b.ply", "no folder"]);
    folder.run(&format!("{all} -o taken.ply")).fails(2, &["taken.ply", "folder"]);
    folder.run(&format!("{all} --light dusk.exr -o b.ply")).fails(2, &["dusk.exr"]);
    folder.run("evaluate a.tlux -o b.ply").fails(2, &["a.tlux"]);
    folder.run("inspect a.tlux").fails(2, &["a.tlux"]);
    folder.run("compare a.ply b.ply").fails(2, &["a.ply"]);
    assert_eq!(folder.names(), ["cube.obj", "taken.ply"]);
}

#[test]
fn code_3_for_invalid_input() {
    let folder = cube();
    folder.write("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
    folder.write("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    folder.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 1 1\n");
    folder.write("text.exr", "no picture");
    folder.write("text.ply", "no table");
    folder.write("text.tlux", "no asset");
    let rest = "--material marble --samples 64 -o b.ply";
    folder.run(&format!("reference index.obj --size-mm 9 {rest}")).fails(3, &["index.obj:4", "vertex 4"]);
    folder.run(&format!("reference nan.obj --size-mm 9 {rest}")).fails(3, &["nan.obj:4", "finite"]);
    folder.run(&format!("reference flat.obj --unit mm {rest}")).fails(3, &["flat.obj"]);
    folder.run(&format!("reference cube.obj --size-mm 1e300 {rest}")).fails(3, &["cube.obj", "diagonal"]);
    folder.run(&format!("reference cube.obj --unit mm --opaque default {rest}")).fails(3, &["cube.obj", "opaque"]);
    folder.run(&format!("reference cube.obj --unit mm --light text.exr {rest}")).fails(3, &["text.exr"]);
    folder.run("compare text.ply text.ply").fails(3, &["text.ply"]);
    folder.run("inspect text.tlux").fails(3, &["text.tlux"]);
    assert!(!folder.path("b.ply").exists());
}

/// Cut anywhere, or with any byte changed, an asset is refused: every byte is under a checksum.
#[test]
fn code_3_for_damaged_assets() {
    let folder = cube();
    folder.run("bake cube.obj --method editable --unit mm --material marble --samples 64 -o a.tlux").ok();
    let whole = folder.read("a.tlux");
    for step in 0..24 {
        let place = step * (whole.len() - 1) / 23;
        let mut damaged = whole.clone();
        damaged[place] ^= 0x40;
        folder.write("b.tlux", damaged);
        folder.run("inspect b.tlux --deep").fails(3, &["b.tlux"]);
        folder.write("b.tlux", &whole[..place]);
        folder.run("evaluate b.tlux -o b.ply").fails(3, &["b.tlux"]);
    }
    let mut longer = whole;
    longer.push(0);
    folder.write("b.tlux", longer);
    folder.run("inspect b.tlux").fails(3, &["b.tlux"]);
    assert!(!folder.path("b.ply").exists());
}

#[test]
fn code_4_names_the_samples_that_fit() {
    let folder = cube();
    let bake = "bake cube.obj --unit mm --material marble --method two_pass -o a.tlux";
    for limit in ["94MB", "56MB"] {
        let many = format!("{bake} --samples 4194304 --max-memory {limit}");
        let refused = folder.run(&many).fails(4, &["memory", "would fit"]);
        let words: Vec<&str> = refused.stderr.split_whitespace().collect();
        let flag = words.iter().position(|w| *w == "--samples").unwrap();
        let fitting: usize = words[flag + 1].parse().unwrap();
        folder.run(&format!("{bake} --max-memory {limit} --samples {fitting}")).ok();
        folder.run(&format!("{bake} --max-memory {limit} --samples {}", 2 * fitting)).fails(4, &["memory"]);
    }
    folder.run(&format!("{bake} --max-memory 1KB")).fails(4, &["no number of samples would fit", "--max-memory"]);
}

/// Errors as JSON: where no report was printed, on standard output.
#[test]
fn errors_are_json_too() {
    let folder = cube();
    folder.write("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
    folder.write("nan.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\nnine\n");
    let reference = "reference index.obj --size-mm 9 --material marble -o b.ply";
    for (line, exit, kind, path, at) in [
        ("inspect none.tlux".to_owned(), 2, "io", Some("none.tlux"), None),
        (reference.to_owned(), 3, "invalid-input", Some("index.obj"), Some(4)),
        ("compare nan.ply nan.ply".to_owned(), 3, "invalid-input", Some("nan.ply"), Some(6)),
        ("inspect cube.obj".to_owned(), 3, "invalid-input", Some("cube.obj"), None),
        (reference.replace("index", "cube").replace("-o b.ply", "-o b.obj"), 1, "command-line", None, None),
        ("bake cube.stl --unit mm --material marble -o a.tlux".to_owned(), 5, "unsupported", Some("cube.stl"), None),
        ("inspect".to_owned(), 1, "command-line", None, None),
        ("inspect --frobnicate a.tlux".to_owned(), 1, "command-line", None, None),
    ] {
        folder.write("cube.stl", "solid");
        let outcome = folder.run(&format!("{line} --json")).fails(exit, &[]);
        let error = outcome.json();
        assert_eq!((&error["schema"], &error["exit"]), (&"translux.error.v1".into(), &exit.into()), "{line}");
        assert_eq!(error["kind"], kind, "{line}");
        assert_eq!((error["path"].as_str(), error["line"].as_u64()), (path, at), "{line}: {error}");
        let message = error["message"].as_str().unwrap();
        assert!(!message.is_empty() && !message.contains('\n'), "{line}: {message}");
        assert!(folder.run(&line).stdout.is_empty(), "{line}");
    }
}

/// What a 32-bit file cannot hold is refused with a remedy, not written.
#[test]
fn code_4_for_light_beyond_all_bounds() {
    let folder = cube();
    let line = "reference cube.obj --unit mm --material marble --samples 64 -o b.ply --light constant:radiance=1e39";
    folder.run(line).fails(4, &["lights", "scale"]);
    assert!(!folder.path("b.ply").exists());
}

#[test]
fn code_5_for_what_is_not_supported() {
    let folder = cube();
    folder.write(
        "draco.gltf",
        r#"{"asset": {"version": "2.0"}, "extensionsUsed": ["KHR_draco_mesh_compression"],
            "extensionsRequired": ["KHR_draco_mesh_compression"]}"#,
    );
    folder.run("bake draco.gltf --material marble -o a.tlux").fails(5, &["draco.gltf", "KHR_draco_mesh_compression"]);
    folder.write("cube.stl", "solid");
    folder.run("bake cube.stl --unit mm --material marble -o a.tlux").fails(5, &["cube.stl", ".obj"]);
    folder.run("bake cube.obj --method editable --unit mm --material marble --samples 64 -o a.tlux").ok();
    // A backend that this system does not have: no adapter is found.
    let backend = if cfg!(target_os = "macos") { "vulkan" } else { "metal" };
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_translux"))
        .current_dir(folder.path(""))
        .args("evaluate a.tlux --device gpu -o b.ply".split(' '))
        .env("WGPU_BACKEND", backend)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(5), "{stderr}");
    assert!(stderr.contains("--device cpu"), "{stderr}");
}

#[test]
fn code_6_where_strict_asks_for_more_than_there_is() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(12.0, 2));
    let line = format!("reference head.obj --unit mm --material marble --samples 900 --max-rms 0.001% {SUN} -o b.ply");
    folder.run(&line).ok().fails(0, &["warning: measured error", "above the asked"]);
    folder.run(&format!("{line} --strict")).fails(6, &["measured error", "above the asked"]);
    let json = folder.run(&format!("{line} --strict --json")).fails(6, &["above the asked"]).json();
    assert!(json["measured"]["entries"][0]["error"]["rms"].as_f64().unwrap() > 1e-5);
    let warnings = folder.run(&format!("{line} --json")).ok().json()["warnings"].to_string();
    assert!(warnings.contains("above the asked"), "{warnings}");
}

#[test]
fn code_7_for_differences() {
    let folder = cube();
    let line = "reference cube.obj --unit mm --material marble --samples 300";
    folder.run(&format!("{line} --light constant:radiance=1 -o one.ply")).ok();
    folder.run(&format!("{line} --light constant:radiance=1.01 -o more.ply")).ok();
    folder.obj("other.obj", &shapes::icosphere(5.0, 1));
    folder.run(&format!("{} -o other.ply", line.replace("cube", "other"))).ok();
    let said = folder.run("compare more.ply one.ply").fails(7, &[]).text();
    assert!(said.starts_with("different: RMS 1.00 %"), "{said}");
    folder.run("compare more.ply one.ply --fail-above 0.9%").fails(7, &[]);
    folder.run("compare more.ply one.ply --fail-above 1.1%").ok();
    folder.run("compare more.ply one.ply --metric worst --fail-above 0.9%").fails(7, &[]);
    folder.run("compare one.ply one.ply --fail-above 0").ok();
    folder.run("compare one.ply other.ply --fail-above 100%").fails(7, &["vertices"]);
}

/// Every key of `two_pass` changes the result where it must, and refuses what it cannot mean.
#[test]
fn keys_have_their_effect() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(12.0, 3));
    let lights = "--light directional:from=1,2,3:irradiance=2 --light constant:radiance=1 \
                  --light area:at=0,30,0:normal=0,-1,0:size=20,20:radiance=5";
    let run = |set: &str, output: &str| {
        let bake = "bake head.obj --unit mm --material skin1 --samples 6000 --method two_pass -o a.tlux --max-rms 4%";
        let key = |set: &str| set.split_once('=').map(|(key, _)| key.to_owned());
        let few = ["directions=16", "area-side=2", "points=1"].into_iter().filter(|few| key(few) != key(set));
        let words: Vec<String> =
            few.chain([set]).filter(|set| !set.is_empty()).map(|set| format!("--set {set}")).collect();
        folder.run(&format!("{bake} {}", words.join(" "))).ok();
        folder.run(&format!("evaluate a.tlux {lights} -o {output}")).ok();
    };
    run("", "base.ply");
    let samples = ["points=2", "directions=32", "area-side=3"];
    for set in ["bound=kernel", "error=0.1%"].iter().chain(&samples) {
        run(set, "b.ply");
        folder.run("compare b.ply base.ply").fails(7, &[]);
        folder.run("compare b.ply base.ply --fail-above 10%").ok();
    }
    let bake = "bake head.obj --unit mm --material skin1 --samples 6000 --method two_pass -o b.tlux";
    for (set, fragments) in [
        ("bound=tight", &["bound=tight", "solid-angle", "kernel"][..]),
        ("error=0", &["error", "1% or 0.01"]),
        ("error=nan", &["error"]),
        ("points=0", &["points=0", "1 to 64"]),
        ("points=3", &["points=3", "power of two"]),
        ("points=128", &["points=128", "1 to 64"]),
        ("directions=1e3", &["directions=1e3"]),
        ("directions=0", &["directions=0"]),
        ("area-side=-1", &["area-side=-1"]),
        ("area-side=", &["area-side="]),
        ("colour=red", &["colour", "bound", "error", "points", "directions", "area-side"]),
    ] {
        folder.run(&format!("{bake} --set {set}")).fails(1, fragments);
    }
    assert!(!folder.path("b.tlux").exists());
}

#[test]
fn one_sample_is_enough() {
    let folder = cube();
    for method in ["reference", "two_pass"] {
        let line = format!("reference cube.obj --unit mm --material marble --samples 1 --method {method} -o b.ply");
        folder.run(&format!("{line} --light constant:radiance=1")).ok();
        assert!(folder.radiosity("b.ply").iter().all(|b| b.min_element() > 0.0));
    }
    let all = "reference cube.obj --unit mm --material marble -o b.ply --samples";
    folder.run(&format!("{all} 0")).fails(1, &["--samples 0", "1 to"]);
    folder.run(&format!("{all} 99999999999")).fails(1, &["--samples", "1 to"]);
}

fn commands(folder: &Folder) -> Vec<String> {
    let help = folder.run("--help").ok().text();
    let list = help.split("Commands:").nth(1).unwrap().split("\n\n").next().unwrap();
    let mut names: Vec<String> =
        list.lines().filter(|l| l.starts_with("  ") && !l.starts_with("   ")).map(first_word).collect();
    names.retain(|n| n != "help");
    names
}

fn first_word(line: &str) -> String {
    line.split_whitespace().next().unwrap().to_owned()
}

/// Help is whole at any width: the same words in the same order, and no line longer than the terminal.
#[test]
fn help_is_complete() {
    let folder = Folder::new();
    let top = folder.run("--help").ok().text();
    let codes =
        ["Exit codes:", "0  ok", "1  wrong command line", "3  invalid input", "5  unsupported", "7  difference"];
    for fragment in codes {
        assert!(top.contains(fragment), "{fragment} is not in {top}");
    }
    let commands = commands(&folder);
    for name in ["bake", "evaluate", "reference", "inspect", "compare", "materials", "methods"] {
        assert!(commands.iter().any(|c| c == name), "{name} is not in {commands:?}");
    }
    for command in commands {
        let words = |columns: &str| {
            let mut program = assert_cmd::Command::new(env!("CARGO_BIN_EXE_translux"));
            let output = program.args([&command, "--help"]).env("COLUMNS", columns).output().unwrap();
            assert!(output.status.success(), "{command}");
            let text = String::from_utf8(output.stdout).unwrap();
            let longest = text.lines().map(|l| l.trim_end().chars().count()).max().unwrap();
            assert!(longest <= 110, "{command}: a line of {longest} characters");
            text.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
        };
        let wide = words("1000");
        assert!(wide.len() > 30, "{command}");
        assert_eq!(words("60"), wide, "{command}");
        for flag in ["--quiet", "--json", "--strict", "--threads", "--max-memory"] {
            assert!(wide.iter().any(|w| w == flag || w == &format!("{flag},")), "{command}: no {flag}");
        }
    }
}

#[test]
fn a_material_that_is_given_must_exist() {
    let folder = Folder::new();
    folder.obj("a.obj", &called(shapes::icosphere(5.0, 1), "wax"));
    folder.run("bake a.obj --method editable --unit mm --material wax=cream --samples 64 -o a.tlux").ok();
    folder
        .run("bake a.obj --method editable --unit mm --material max=cream --samples 64 -o a.tlux")
        .fails(1, &["max", "'wax'"]);
    folder.run("evaluate a.tlux --material max=cream -o b.ply").fails(1, &["max", "wax"]);
    folder.run("evaluate a.tlux --material wax=marble -o b.ply").ok();
}
