//! The examples that add methods and forms, as programs: they bake, validate, evaluate, render and chart as the crate's own do.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use translux::geometry::shapes;

/// The program of an example, beside the tests' own; built, since `cargo test` builds not all of them, and leaves old ones where they are.
fn program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().unwrap();
    let profile = tests.parent().and_then(Path::parent).unwrap();
    let program = profile.join("examples").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    let release = profile.ends_with("release").then_some("--release");
    let mut build = Command::new(env!("CARGO"));
    build.current_dir(env!("CARGO_MANIFEST_DIR")).args(["build", "--locked", "--example", name]).args(release);
    // As the tests were built: with another set of packages, or with what scripts/run-tests sets, cargo would build everything again.
    build.arg("--workspace").env_remove("RUSTC_BOOTSTRAP");
    assert!(build.env("CARGO_TARGET_DIR", profile.parent().unwrap()).status().unwrap().success(), "{name}");
    program
}

/// Runs a line in a folder.
fn run(program: &Path, folder: &Path, line: &str) -> Output {
    let output = Command::new(program).current_dir(folder).args(line.split_whitespace()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{} {line}: {said}", program.display());
    output
}

#[test]
fn a_method_and_a_form_from_outside_are_whole_programs() {
    // On a coarser mesh, which is enough for a chart, a bake warns of what is drawn between vertices.
    let [head, coarse] = [3, 2].map(|subdivisions| {
        let model = shapes::bumpy_head(1.0, subdivisions);
        let mut obj = String::new();
        model.positions.iter().for_each(|p| obj += &format!("v {} {} {}\n", p.x, p.y, p.z));
        model.triangles.iter().for_each(|t| obj += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1));
        obj
    });
    // The paper's 200 lights and 3000 samples miss what is asked for, and say so.
    const NO_FINDINGS: &str = "valid; 0 errors, 0 warnings";
    let programs = [
        ("toy_method", "toy_method", "directional:from=1,2,3:irradiance=1", NO_FINDINGS, "2%"),
        ("toy_form", "toy_form", "constant:radiance=1", NO_FINDINGS, "2%"),
        ("papers", "hao_varshney", "directional:from=1,2,3:irradiance=1", "valid; 0 errors", "5%"),
    ];
    for (example, name, light, verdict, most) in programs {
        let (program, folder) = (program(example), tempfile::tempdir().unwrap());
        let folder = folder.path();
        std::fs::write(folder.join("head.obj"), &head).unwrap();
        std::fs::write(folder.join("coarse.obj"), &coarse).unwrap();
        let run = |line: &str| run(&program, folder, line);
        let text = |output: Output| String::from_utf8(output.stdout).unwrap();
        run(&format!(
            "bake head.obj -o a.tlux --method {name} --samples 3000 --max-rms 2% --size-mm 20 --material marble -q"
        ));
        assert!(text(run("validate a.tlux")).contains(verdict), "{name}");
        assert!(text(run("inspect a.tlux")).contains(name));
        assert!(text(run(&format!("methods {name}"))).contains("You "));
        run(&format!("evaluate a.tlux --light {light} -o a.ply -q"));
        run(&format!(
            "reference head.obj --no-measure --samples 6000 --size-mm 20 --material marble --light {light} -o b.ply -q"
        ));
        run(&format!("compare a.ply b.ply --fail-above {most}"));
        run(&format!("render a.tlux --light {light} -o a.png --resolution 64x64 -q"));
        // That of the papers' method would take as long as all else here, and no other way.
        if example == "papers" {
            continue;
        }
        let chart = "chart coarse.obj -o chart --quick --reference-samples 4000 --size-mm 20 --device cpu -q";
        run(&format!("{chart} --methods {name} --light {light}"));
        assert!(std::fs::read_to_string(folder.join("chart/chart.json")).unwrap().contains(name));
    }
}
