//! `pose-check`: what the rest pose's result is worth in other poses.
#![allow(clippy::unwrap_used, missing_docs)]

use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::io::ply::parse_ply;

use crate::common::{Folder, glb};

const SUN: &str = "--light directional:from=1,2,3:irradiance=2";

/// Sums that are coarse and fast.
const FEW: &str = "--samples 4000";

/// A bar of 4 x 12 x 4 mm.
fn bar() -> SourceModel {
    shapes::cuboid(DVec3::new(4.0, 12.0, 4.0), 6)
}

/// A point of the bar where its upper half is bent about z.
fn bent(p: DVec3, angle: f64) -> DVec3 {
    let share = (p.y / 6.0).clamp(0.0, 1.0);
    DQuat::from_rotation_z(angle * share) * p
}

fn posed(mut model: SourceModel, to: impl Fn(DVec3) -> DVec3) -> SourceModel {
    model.positions.iter_mut().for_each(|p| *p = to(*p));
    model
}

fn baked(options: &str) -> Folder {
    baked_in("marble", options)
}

fn baked_in(material: &str, options: &str) -> Folder {
    let folder = Folder::new();
    folder.obj("rest.obj", &bar());
    folder.obj("bent.obj", &posed(bar(), |p| bent(p, 1.2)));
    folder.run(&format!("bake rest.obj --unit mm --material {material} --max-rms 2% -o a.tlux {options}")).ok();
    folder
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// RMS over the vertices by area, relative to that of the truth, of the worst channel.
fn rms(shown: &[DVec3], truth: &[DVec3], model: &SourceModel) -> f64 {
    let mut areas = vec![0.0; truth.len()];
    for t in &model.triangles {
        let [a, b, c] = t.map(|v| model.positions[v as usize]);
        t.iter().for_each(|v| areas[*v as usize] += (b - a).cross(c - a).length());
    }
    let sum = |of: &dyn Fn(usize) -> DVec3| (0..truth.len()).map(|v| areas[v] * of(v).powf(2.0)).sum::<DVec3>();
    (sum(&|v| (shown[v] - truth[v]).abs()) / sum(&|v| truth[v])).max_element().sqrt()
}

#[test]
fn a_bent_bar_is_as_wrong_as_the_brute_force_truth_of_the_bent_mesh_says() {
    let folder = baked("--method editable --samples 900 --for-lights directional");
    let report = folder.run(&format!("pose-check bent.obj rest.obj a.tlux {SUN} --json --threads 1")).ok().json();
    let [bent_pose, rest] = [0, 1].map(|i| &report["poses"][i]);
    // The same by other commands: the asset's radiosity against the truth of the bent mesh.
    folder.run(&format!("evaluate a.tlux {SUN} -o shown.ply")).ok();
    folder.run(&format!("reference bent.obj --unit mm --material marble --samples 8000 {SUN} -o truth.ply")).ok();
    let (shown, truth) = (folder.radiosity("shown.ply"), folder.radiosity("truth.ply"));
    let expected = rms(&shown, &truth, &posed(bar(), |p| bent(p, 1.2)));
    let told = number(&bent_pose["shown"]["rms"]);
    assert!(expected > 0.1 && (told / expected - 1.0).abs() < 0.02, "{told} and {expected}");
    assert!(number(&bent_pose["light"]["rms"]) > 0.05 && number(&bent_pose["transport"]["rms"]) > 0.01, "{report}");
    assert_eq!((&rest["light"]["rms"], &rest["transport"]["rms"]), (&json!(0.0), &json!(0.0)));
    assert_eq!((&rest["shown"], &rest["relit"]), (&report["own"], &report["own"]));
    assert_eq!((&report["worst"], &report["takes_light"]), (&json!("bent.obj"), &json!(true)));
    assert_eq!(rest["advice"], "keep");
    assert_eq!(report["measured_vertices"], report["vertices"]);
    // People read the same, on any number of threads.
    let text = folder.run(&format!("pose-check bent.obj rest.obj a.tlux {SUN} --threads 3")).ok().text();
    let percent = text.lines().find(|line| line.starts_with("bent.obj  ")).unwrap().split_whitespace().nth(1).unwrap();
    assert!((percent.parse::<f64>().unwrap() / 100.0 / told - 1.0).abs() < 0.01, "{text}");
    for fragment in ["worst pose: bent.obj", "rest.obj: good", "all pairs with", "transport alone"] {
        assert!(text.contains(fragment), "{fragment}: {text}");
    }
    let again = folder.run(&format!("pose-check bent.obj rest.obj a.tlux {SUN} --json --threads 3")).ok().json();
    assert_eq!(again["poses"], report["poses"]);
}

#[test]
fn limits_end_with_6_and_files_have_the_error_of_every_vertex() {
    let folder = baked("--method two_pass --samples 900 --for-lights directional");
    folder.run(&format!("pose-check bent.obj a.tlux {FEW}")).ok();
    folder
        .run(&format!("pose-check bent.obj a.tlux {SUN} {FEW} --max-rms 1%"))
        .fails(6, &["bent.obj", "as shown", "more than 1.00 %"]);
    folder.run(&format!("pose-check bent.obj a.tlux {SUN} {FEW} --max-rms 99% --strict")).ok();
    folder.run(&format!("pose-check bent.obj a.tlux {SUN} {FEW} --strict")).fails(6, &["as shown"]);
    folder
        .run(&format!("pose-check bent.obj a.tlux {SUN} {FEW} --max-rms 1% --relit"))
        .fails(6, &["with its own light"]);
    let line = format!("pose-check rest.obj bent.obj a.tlux {SUN} {FEW} -o out --json");
    let report = folder.run(&line).ok().json();
    let paths: Vec<&str> = report["poses"].as_array().unwrap().iter().map(|p| p["output"].as_str().unwrap()).collect();
    assert_eq!(paths, ["out/000_rest.ply", "out/001_bent.ply"]);
    let table = parse_ply(&folder.read(paths[1]), paths[1]).unwrap();
    let most = |name: &str| table.column(name).unwrap().iter().fold(0.0_f64, |most, e| most.max(*e));
    let worst = number(&report["poses"][1]["shown"]["worst"]);
    assert!((most("pose_shown") / worst - 1.0).abs() < 1e-5, "{} {worst}", most("pose_shown"));
    assert!(most("pose_light") > 0.0 && most("pose_transport") > 0.0 && most("pose_relit") > 0.0);
    let there = folder.positions(paths[1]);
    let expected = posed(bar(), |p| bent(p, 1.2)).positions;
    assert!(there.iter().zip(&expected).all(|(a, b)| a.distance(*b) < 1e-4));
    let still = parse_ply(&folder.read(paths[0]), paths[0]).unwrap();
    assert!(still.column("pose_transport").unwrap().iter().all(|e| *e == 0.0));
}

#[test]
fn what_is_no_pose_of_the_mesh_is_refused() {
    let folder = baked("--method editable --samples 300 --for-lights directional");
    folder.obj("other.obj", &shapes::cuboid(DVec3::ONE, 2));
    folder.run("pose-check other.obj a.tlux").fails(3, &["other.obj", "26 vertices", "same mesh"]);
    let mut swapped = bar();
    swapped.triangles.swap(10, 50);
    folder.obj("swapped.obj", &swapped);
    folder.run("pose-check rest.obj swapped.obj a.tlux").fails(3, &["swapped.obj", "its triangle 10 has the vertices"]);
    folder.run("pose-check none.obj a.tlux").fails(2, &["none.obj"]);
    folder.run("pose-check a.tlux").fails(1, &["POSES"]);
    folder.run("pose-check rest.obj a.tlux --animation walk").fails(1, &["--animation walk"]);
    folder.run("pose-check rest.obj a.tlux --frames 0").fails(1, &["--frames 0"]);
    folder.run("pose-check rest.obj a.tlux --samples 0").fails(1, &["--samples 0"]);
    folder.run("pose-check rest.obj a.tlux --vertices 5 -o out").fails(1, &["--vertices"]);
    folder.run("pose-check rest.obj a.tlux --max-memory 3MB").fails(4, &["--max-memory"]);
    let black = "--light directional:from=0,1,0:irradiance=0";
    folder.run(&format!("pose-check rest.obj a.tlux {black}")).fails(1, &["no light arrives"]);
    let outside = baked("--method two_pass --samples 300 --for-lights directional --set inter-reflection=once");
    outside.run("pose-check bent.obj a.tlux").fails(5, &["inter-reflection"]);
}

/// The bar in metres as a GLB: a joint for each half, of which the upper one turns by a radian about z within a second.
fn animated(change: impl Fn(&mut Value)) -> Vec<u8> {
    let model = bar();
    let count = model.positions.len();
    let mut binary = Vec::new();
    let mut views = Vec::new();
    let mut put = |bytes: Vec<u8>| {
        views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len()}));
        binary.extend(bytes);
    };
    let floats = |values: &mut dyn Iterator<Item = f32>| values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    put(floats(&mut model.positions.iter().flat_map(|p| (*p * 1e-3).as_vec3().to_array())));
    put(model.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect());
    put(model.positions.iter().flat_map(|_| [0u8, 1, 0, 0]).collect());
    put(floats(
        &mut model.positions.iter().flat_map(|p| if p.y > 0.0 { [0.0, 1.0, 0.0, 0.0] } else { [1.0, 0.0, 0.0, 0.0] }),
    ));
    put(floats(&mut [0.0, 1.0].into_iter()));
    let (sin, cos) = 0.5f32.sin_cos();
    put(floats(&mut [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, sin, cos].into_iter()));
    let mut document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0, "skin": 0}, {}, {}], "skins": [{"joints": [1, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}],
        "animations": [{
            "name": "bend", "samplers": [{"input": 4, "output": 5}],
            "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}]
        }],
        "bufferViews": views, "buffers": [{"byteLength": binary.len()}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": 3 * model.triangles.len()},
            {"bufferView": 2, "componentType": 5121, "type": "VEC4", "count": count},
            {"bufferView": 3, "componentType": 5126, "type": "VEC4", "count": count},
            {"bufferView": 4, "componentType": 5126, "type": "SCALAR", "count": 2},
            {"bufferView": 5, "componentType": 5126, "type": "VEC4", "count": 2},
        ],
    });
    change(&mut document);
    glb(&document, &binary)
}

#[test]
fn an_animation_of_a_skin_gives_poses_and_lies_in_it_are_told() {
    let folder = Folder::new();
    folder.write("bar.glb", animated(|_| ()));
    folder.run("bake bar.glb --material marble --max-rms 2% --method editable --samples 600 --for-lights directional -o a.tlux").ok();
    let report = folder.run(&format!("pose-check bar.glb a.tlux {SUN} {FEW} --frames 3 -o out --json")).ok().json();
    let poses = report["poses"].as_array().unwrap();
    let names: Vec<&str> = poses.iter().map(|pose| pose["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["bar.glb at 0.000 s", "bar.glb at 0.500 s", "bar.glb at 1.000 s"]);
    assert_eq!(report["worst"], names[2]);
    // The first key is the rest pose.
    assert_eq!((&poses[0]["light"]["rms"], &poses[0]["transport"]["rms"]), (&json!(0.0), &json!(0.0)));
    assert_eq!(report["warnings"], json!([]));
    for (frame, pose) in poses.iter().enumerate() {
        let turn = DQuat::from_rotation_z(0.5 * frame as f64);
        let there = folder.positions(pose["output"].as_str().unwrap());
        for (p, at) in bar().positions.iter().zip(there) {
            let expected = if p.y > 0.0 { turn * *p } else { *p };
            assert!(at.distance(expected) < 1e-4, "{expected} {at}");
        }
    }
    let of_time = number(&poses[1]["shown"]["rms"]);
    assert!(of_time > 0.0 && of_time < number(&poses[2]["shown"]["rms"]));
    let bend = |file: &str| format!("pose-check {file} a.tlux {SUN} {FEW} --animation bend --frames 2");
    folder.run(&bend("bar.glb")).ok();
    folder.run(&bend("bar.glb").replace("bend", "walk")).fails(1, &["bar.glb", "'bend'"]);
    type Lie = (&'static str, fn(&mut Value), &'static str);
    let lies: [Lie; 3] = [
        ("joint.glb", |d| d["skins"][0]["joints"] = json!([1]), "joint 1"),
        ("weights.glb", |d| d["accessors"][3]["componentType"] = json!(5125), "WEIGHTS"),
        ("keys.glb", |d| d["accessors"][4]["count"] = json!(9), "do not fit"),
    ];
    for (name, lie, fragment) in lies {
        folder.write(name, animated(lie));
        folder.run(&bend(name)).fails(3, &[name, fragment]);
    }
    folder.write(
        "short.glb",
        animated(|d| {
            d["accessors"][4]["count"] = json!(1);
            d["accessors"][5]["count"] = json!(1);
        }),
    );
    let short = folder.run(&format!("{} --json", bend("short.glb"))).ok().json();
    assert_eq!(short["poses"].as_array().unwrap().len(), 1);
}

/// What is kept differs by method, and the identity is one in all of them.
#[test]
fn every_method_is_checked_against_sums_of_its_own_model() {
    for (material, options, takes_light, own_below) in [
        ("marble", "--method quantized_lights --samples 900 --for-lights directional", false, 0.1),
        // A sun is much for few harmonics.
        ("marble", "--method all_frequency --samples 900 --for-lights directional", false, 0.7),
        ("marble", "--method editable --set transport=stored --samples 900 --for-lights directional", true, 0.05),
        // Walks are short where much is absorbed, and so are free paths: more samples.
        (
            "skin1",
            "--method two_pass --samples 2000 --for-lights directional --model calibrated --photons 2048",
            true,
            0.05,
        ),
    ] {
        let folder = baked_in(material, options);
        let report = folder.run(&format!("pose-check rest.obj bent.obj a.tlux {SUN} {FEW} --json")).ok().json();
        let [rest, bent_pose] = [0, 1].map(|i| &report["poses"][i]);
        assert_eq!((&rest["light"]["rms"], &rest["transport"]["rms"]), (&json!(0.0), &json!(0.0)), "{options}");
        assert_eq!(rest["shown"], report["own"], "{options}");
        assert!(number(&report["own"]["rms"]) < own_below, "{options}: {report}");
        assert_eq!(report["takes_light"], takes_light, "{options}");
        assert!(number(&bent_pose["shown"]["rms"]) > 0.1, "{options}");
    }
}
