//! `bake --refine`: models of few triangles for methods whose light ends at the vertices.
#![allow(clippy::unwrap_used, missing_docs)]

use glam::DVec3;
use translux::geometry::shapes;

use crate::common::{Folder, relative_difference};

const LIGHT: &str = "--light directional:from=1,2,3:irradiance=2";

/// A folder with a cube of twelve triangles.
fn cube_of(mm: f64) -> Folder {
    let folder = Folder::new();
    folder.obj("cube.obj", &shapes::cuboid(DVec3::splat(mm), 1));
    folder
}

fn cube() -> Folder {
    cube_of(20.0)
}

const BAKE: &str = "bake cube.obj --unit mm --material marble --for-lights directional";

#[test]
fn twelve_triangles_are_right_with_methods_that_end_at_the_vertices() {
    let folder = cube_of(10.0);
    // One sample at least for each of the 3,072 triangles that the cube becomes.
    let method = "--method all_frequency --samples 4000";
    folder.run(&format!("{BAKE} {method} -o coarse.tlux")).ok();
    let told = folder.run(&format!("{BAKE} {method} --refine auto -o fine.tlux --json")).ok();
    assert!(told.stderr.contains("refined: 12 triangles became") && !told.stderr.contains("warning: what is drawn"));
    let report = told.json();
    assert_eq!((&report["mesh"]["triangles"], &report["mesh"]["vertices"]), (&12.into(), &8.into()));
    assert!(report["triangles"].as_u64().unwrap() < 6_000, "{}", report["triangles"]);
    folder.run(&format!("{BAKE} --method reference --samples 20000 -q -o truth.tlux")).ok();
    let view = format!("{LIGHT} --no-specular --view three-quarter --resolution 64x64 --samples-per-pixel 4");
    folder.run(&format!("render truth.tlux {view} --exitance pixels -o truth.exr")).ok();
    let told = folder.run(&format!("render fine.tlux {view} -o fine.exr --json")).ok();
    assert_eq!(told.json()["exitance"], "vertices");
    assert!(!told.stderr.contains("warning"), "{}", told.stderr);
    folder.run("compare fine.exr truth.exr --fail-above 3%").ok();
    let told = folder.run(&format!("render coarse.tlux {view} -o coarse.exr")).ok();
    assert!(told.stderr.contains("--refine auto"), "{}", told.stderr);
    folder.run("compare coarse.exr truth.exr --fail-above 20%").fails(7, &[]);
    // What else is done with an asset: the refined mesh is what engines get.
    folder.run(&format!("export fine.tlux {LIGHT} --as vertex-colors -o fine.glb")).ok();
    folder.run(&format!("evaluate fine.tlux {LIGHT} -o fine.ply")).ok();
    let (places, light) = (folder.positions("fine.ply"), folder.radiosity("fine.ply"));
    assert_eq!(places.len(), light.len());
    assert!(places[..8].iter().all(|p| p.abs().distance(DVec3::splat(5.0)) < 1e-5), "{:?}", &places[..8]);
    folder.run(&format!("evaluate coarse.tlux {LIGHT} -o coarse.ply")).ok();
    folder.run("compare fine.ply coarse.ply").fails(7, &["vertices"]);
    folder.run("pose-check cube.obj fine.tlux").fails(5, &["refined", "without --refine"]);
    folder.run("validate fine.tlux").ok();
    assert!(folder.run("inspect fine.tlux").ok().text().contains("refined: 12 triangles became"));
}

#[test]
fn the_file_of_a_refined_model_is_refused_where_its_vertices_are_too_few() {
    let folder = cube();
    folder.run(&format!("{BAKE} --method editable --samples 1500 --refine 4 -q -o a.tlux")).ok();
    folder.run(&format!("export a.tlux {LIGHT} --as vertex-colors -o whole.glb")).ok();
    folder
        .run(
            "bake whole.glb --size-mm 34 --material marble --method editable --samples 1500 --for-lights directional \
             --refine 3 -q -o b.tlux",
        )
        .ok();
    folder
        .run(&format!("export b.tlux {LIGHT} --as vertex-colors --scene whole.glb -o with.glb"))
        .fails(5, &["whole.glb", "refined", "leave --scene out"]);
}

#[test]
fn reference_has_the_same_vertices() {
    let folder = cube();
    folder.run(&format!("{BAKE} --method two_pass --samples 20000 --refine 2 -q -o a.tlux")).ok();
    folder.run(&format!("evaluate a.tlux {LIGHT} -q -o a.ply")).ok();
    let reference = "reference cube.obj --unit mm --material marble --samples 20000 --no-measure --refine 2";
    folder.run(&format!("{reference} {LIGHT} -q -o b.ply")).ok();
    let [a, b] = ["a.ply", "b.ply"].map(|file| folder.radiosity(file));
    assert!(a.len() > 600 && a.len() == b.len());
    assert!(relative_difference(&a, &b) < 0.02);
    assert_eq!(folder.positions("a.ply"), folder.positions("b.ply"));
}

#[test]
fn builds_know_a_refined_asset_and_fine_meshes_are_left() {
    let folder = cube();
    let line = format!("{BAKE} --method two_pass --samples 4000 --if-changed --json -o a.tlux");
    let written = |more: &str| folder.run(&format!("{line} {more}")).ok().json()["written"].clone();
    assert_eq!(written("--refine 5"), true);
    assert_eq!(written("--refine 5"), false);
    assert_eq!(written("--refine 4"), true);
    assert_eq!(written("--refine off"), true);
    assert_eq!(written(""), false);
    folder
        .write("job.toml", "input = 'cube.obj'\nrefine = '4'\nunit = 'mm'\nmaterial = 'marble'\nmethod = 'two_pass'\n");
    folder.run("bake --config job.toml --samples 4000 -o job.tlux -q").ok();
    assert!(folder.run("inspect job.tlux").ok().text().contains("--refine 4"));
    // A mesh that is fine is the same asset but for the record of what was asked for.
    folder.obj("ball.obj", &shapes::icosphere(5.0, 5));
    let bake = "bake ball.obj --unit mm --material marble --method two_pass --samples 4000 -q";
    folder.run(&format!("{bake} -o off.tlux")).ok();
    folder.run(&format!("{bake} --refine auto -o auto.tlux")).ok();
    let [off, auto] = ["off.tlux", "auto.tlux"].map(|file| folder.read(file).len());
    assert!(off.abs_diff(auto) < 100, "{off} {auto}");
    assert!(!folder.run("inspect auto.tlux").ok().text().contains("refined"));
}

#[test]
fn lengths_out_of_range_are_refused() {
    let folder = cube();
    for bad in ["0", "-1", "nan", "fine"] {
        let outcome = folder.run(&format!("{BAKE} --refine {bad} -o a.tlux"));
        assert!(outcome.code == 1 && outcome.stderr.contains("--refine"), "{bad}: {}", outcome.stderr);
    }
    folder
        .run(&format!("{BAKE} --method two_pass --refine 0.001 -o a.tlux"))
        .fails(1, &["--refine 0.001", "triangles"]);
    assert!(!folder.names().contains(&"a.tlux".to_owned()));
}
