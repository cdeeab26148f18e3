//! Assets that hold no transport: another size of the object, and other meshes of it.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::common::{Folder, relative_difference};
use translux::geometry::shapes;

const SUN: &str = "--light directional:from=0.3,0.8,0.5:irradiance=3 -q";

/// A head baked at 20 mm.
fn head() -> Folder {
    head_of(4)
}

fn head_of(subdivisions: u32) -> Folder {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(1.0, subdivisions));
    folder.run("bake head.obj --size-mm 20 --material marble --method two_pass --samples 8192 -o head.tlux -q").ok();
    folder
}

#[test]
fn another_size_is_a_bake_of_that_size_and_a_factor_on_sigma() {
    let folder = head();
    folder.run("bake head.obj --size-mm 50 --material marble --method two_pass --samples 8192 -o big.tlux -q").ok();
    folder.run(&format!("evaluate big.tlux {SUN} -o baked.ply")).ok();
    folder.run(&format!("evaluate head.tlux --size-mm 50 {SUN} -o resized.ply")).ok();
    let [baked, resized] = ["baked.ply", "resized.ply"].map(|file| folder.radiosity(file));
    assert!(relative_difference(&resized, &baked) < 1e-5);
    for (a, b) in folder.positions("baked.ply").iter().zip(folder.positions("resized.ply")) {
        assert!((*a - b).length() < 1e-4, "{a} {b}");
    }
    // R_d is a length^-2: the object grows as the mean free path shrinks.
    folder
        .run(&format!(
            "evaluate head.tlux --sigma-s 2,3,4 --sigma-a 0.02,0.04,0.1 --g 0 --eta 1.3 --size-mm 40 {SUN} -o grown.ply"
        ))
        .ok();
    folder
        .run(&format!("evaluate head.tlux --sigma-s 4,6,8 --sigma-a 0.04,0.08,0.2 --g 0 --eta 1.3 {SUN} -o denser.ply"))
        .ok();
    let [grown, denser] = ["grown.ply", "denser.ply"].map(|file| folder.radiosity(file));
    assert!(relative_difference(&grown, &denser) < 1e-5);
    folder.run(&format!("evaluate head.tlux {SUN} -o own.ply")).ok();
    assert!(relative_difference(&folder.radiosity("own.ply"), &baked) > 0.02, "size has no effect");
}

#[test]
fn pictures_have_the_size_too() {
    let folder = head();
    let line = "--light directional:from=0.3,0.8,0.5:irradiance=3 --resolution 32x32 --samples-per-pixel 1 -q";
    for (size, file) in [("", "own"), ("--size-mm 20", "same"), ("--size-mm 80", "large")] {
        folder.run(&format!("render head.tlux {size} {line} -o {file}.exr")).ok();
    }
    assert!(folder.read("own.exr") == folder.read("same.exr") && folder.read("own.exr") != folder.read("large.exr"));
}

#[test]
fn the_same_mesh_takes_the_same_radiosity() {
    let folder = head();
    folder.run(&format!("evaluate head.tlux {SUN} -o own.ply")).ok();
    let report = folder.run(&format!("evaluate head.tlux --on head.obj {SUN} --json -o on.ply")).ok().json();
    // Groups of receivers share clusters; vertices that are equally far may be grouped otherwise.
    assert!(relative_difference(&folder.radiosity("on.ply"), &folder.radiosity("own.ply")) < 1e-3);
    assert_eq!(report["vertices_without_area"], 0);
    assert!(
        report["max_distance_mm"].as_f64().unwrap() < 1e-5 && report["at_vertices"]["rms"].as_f64().unwrap() < 1e-3
    );
    assert!(report["inputs"].as_array().unwrap().iter().any(|input| input["name"] == "head.obj"));
    folder.run(&format!("evaluate head.tlux --on head.obj --size-mm 50 {SUN} -o on.ply")).ok();
    folder.run(&format!("evaluate head.tlux --size-mm 50 {SUN} -o own.ply")).ok();
    assert!(relative_difference(&folder.radiosity("on.ply"), &folder.radiosity("own.ply")) < 1e-3);
}

#[test]
fn a_coarser_mesh_says_what_it_adds() {
    let folder = head();
    let mut errors = Vec::new();
    for level in [2, 3] {
        folder.obj("lod.obj", &shapes::bumpy_head(1.0, level));
        let outcome = folder
            .run("evaluate head.tlux --on lod.obj --light directional:from=0.3,0.8,0.5:irradiance=3 --json -o lod.ply")
            .ok();
        assert!(outcome.stderr.contains("from the surface of the asset") && outcome.stderr.contains("added between"));
        let report = outcome.json();
        let radiosity = folder.radiosity("lod.ply");
        assert_eq!(radiosity.len(), report["vertices"].as_u64().unwrap() as usize);
        // Vertices of the coarse head are some of the fine one's.
        folder.run(&format!("evaluate head.tlux {SUN} -o own.ply")).ok();
        let (own, at) = (folder.radiosity("own.ply"), folder.positions("own.ply"));
        for (value, place) in radiosity.iter().zip(folder.positions("lod.ply")) {
            let nearest =
                (0..at.len()).min_by(|&a, &b| at[a].distance(place).total_cmp(&at[b].distance(place))).unwrap();
            assert!(
                at[nearest].distance(place) > 0.01
                    || (*value - own[nearest]).length() < 0.01 * own[nearest].length() + 1e-3
            );
        }
        errors.push(report["between_vertices"]["rms"].as_f64().unwrap());
    }
    assert!(errors[0] > 1.5 * errors[1] && errors[1] > 0.0 && errors[0] < 0.5, "{errors:?}");
}

#[test]
fn what_cannot_be_done_is_refused() {
    let folder = head();
    folder.obj("far.obj", &shapes::icosphere(30.0, 2));
    let sun = format!("{SUN} -o x.ply");
    folder
        .run(&format!("evaluate head.tlux --on far.obj {sun}"))
        .fails(3, &["far.obj", "mm from the surface", "same object"]);
    folder.run(&format!("evaluate head.tlux --on nothing.obj {sun}")).fails(2, &["nothing.obj"]);
    folder.run(&format!("evaluate head.tlux --on head.obj --measure {sun}")).fails(1, &["--measure"]);
    for (size, code) in [("0", 1), ("-3", 1), ("nan", 1), ("1e12", 1), ("x", 2)] {
        let outcome = folder.run(&format!("evaluate head.tlux --size-mm {size} {sun}"));
        assert!(outcome.code == code || outcome.code == 1, "{size}: {}", outcome.stderr);
        assert!(outcome.stderr.contains("size-mm"), "{}", outcome.stderr);
    }
    folder
        .run(
            "bake head.obj --method editable --size-mm 20 --material marble --set transport=stored --samples 1500 \
             --for-lights directional -o stored.tlux -q",
        )
        .ok();
    folder
        .run(&format!("evaluate stored.tlux --size-mm 30 {sun}"))
        .fails(5, &["stored.tlux", "20.0 mm", "--method editable"]);
    folder.run(&format!("evaluate stored.tlux --on head.obj {sun}")).fails(5, &["head.obj", "--method editable"]);
    assert!(!folder.names().contains(&"x.ply".to_owned()));
}

/// Nets follow the size, the medium, the profile and the light; other meshes are gathered through the tree.
#[test]
fn multilevel_summation_edits_what_the_tree_edits() {
    let folder = head_of(3);
    let bake = "bake head.obj --size-mm 20 --material marble --max-rms 0.5% --samples 8192 --for-lights directional -q";
    folder.run(&format!("{bake} --method two_pass -o tree.tlux")).ok();
    folder.run(&format!("{bake} --method editable --set transport=none -o nets.tlux")).ok();
    let edits = ["", "--size-mm 45", "--material skin1", "--profile better-dipole", "--on head.obj"];
    for edit in edits {
        for asset in ["tree", "nets"] {
            folder.run(&format!("evaluate {asset}.tlux {edit} {SUN} -o {asset}.ply")).ok();
        }
        folder.run("compare nets.ply tree.ply --fail-above 0.8%").ok();
    }
    // The whole error is within what was asked, and the stage has its own entry.
    let measured = folder.run(&format!("evaluate nets.tlux {SUN} --measure --json -o m.ply")).ok().json();
    let entries = measured["measured"]["entries"].as_array().cloned().unwrap_or_default();
    let stage = entries.iter().find(|entry| entry["stage"] == "multilevel");
    let rms = stage.and_then(|entry| entry["error"]["rms"].as_f64());
    assert!(rms.is_some_and(|rms| rms > 0.0 && rms <= 0.005), "{rms:?} {entries:?}");
}

#[test]
fn windings_are_mended_or_told_in_output_asset_and_exit_code() {
    let folder = Folder::new();
    let right = shapes::bumpy_head(12.0, 4);
    let mut wrong = right.clone();
    wrong.triangles.iter_mut().step_by(3).for_each(|t| t.swap(1, 2));
    folder.obj("right.obj", &right);
    folder.obj("wrong.obj", &wrong);
    let bake = |model: &str, rest: &str| {
        folder.run(&format!("bake {model}.obj --method editable --unit mm --material skin1 --samples 5120 --for-lights directional --max-rms 20% {rest} -o {model}.tlux"))
    };
    let lit = |model: &str| {
        folder.run(&format!("evaluate {model}.tlux --light directional:from=1,2,3:irradiance=1 -o {model}.ply")).ok();
        folder.radiosity(&format!("{model}.ply"))
    };
    let told = bake("right", "--strict").ok().stderr;
    assert!(!told.contains("wound against"), "{told}");
    let told = bake("wrong", "--strict").ok().stderr;
    assert!(
        told.contains("part 'default': 1707 of 5120 triangles were wound against the others: turned over"),
        "{told}"
    );
    assert!(folder.run("inspect wrong.tlux").ok().text().contains("turned over"));
    folder.run("validate wrong.tlux --strict").ok();
    assert!(relative_difference(&lit("wrong"), &lit("right")) < 1e-3);

    // Half of an open sheet turned over: nothing tells which half is right.
    let mut sheet = shapes::plane(20.0, 20.0, 8);
    sheet.triangles.iter_mut().take(64).for_each(|t| t.swap(1, 2));
    folder.obj("sheet.obj", &sheet);
    bake("sheet", "").ok().fails(0, &["part 'default'", "opposite winding", "neither winding has a clear majority"]);
    bake("sheet", "--strict").fails(6, &["opposite winding"]);
    let found = folder.run("validate sheet.tlux").ok();
    assert!(found.text().contains("warning 116 Windings: 8 edges of the part `default`"), "{}", found.text());
    folder.run("validate sheet.tlux --strict").fails(6, &[]);
}
