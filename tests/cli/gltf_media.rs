//! glTF files that say what they are made of: one command without options, and what the user types before it.
#![allow(clippy::unwrap_used, missing_docs)]

use serde_json::{Value, json};

use crate::common::{Folder, glb};
use translux::geometry::shapes;

/// A GLB with spheres of 4 cm in a row, one for each material.
fn spheres(materials: &Value) -> Vec<u8> {
    let sphere = shapes::icosphere(0.02, 3);
    let positions: Vec<[f32; 3]> = sphere.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let mut binary: Vec<u8> = positions.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let indices = binary.len();
    binary.extend(sphere.triangles.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    let count = materials.as_array().unwrap().len();
    let nodes: Vec<Value> =
        (0..count).map(|i| json!({"mesh": i, "translation": [0.06 * i as f64, 0.0, 0.0]})).collect();
    let meshes: Vec<Value> = (0..count)
        .map(|i| json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": i}]}))
        .collect();
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": (0..count).collect::<Vec<_>>()}],
        "nodes": nodes, "meshes": meshes, "materials": materials,
        "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": indices},
            {"buffer": 0, "byteOffset": indices, "byteLength": binary.len() - indices},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": positions.len()},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": 3 * sphere.triangles.len()},
        ],
    });
    glb(&document, &binary)
}

/// What is left of light after 2 mm is a third, and most of the rest comes back.
fn wax() -> Value {
    json!({"name": "wax", "normalTexture": {"index": 0}, "extensions": {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 0.002,
            "attenuationColor": [0.367_879_44, 0.367_879_44, 0.367_879_44]},
        "KHR_materials_volume_scatter": {"multiscatterColor": [0.9, 0.7, 0.5]},
        "KHR_materials_ior": {"ior": 1.44},
    }})
}

const BAKE: &str = "--method two_pass --samples 500";

#[test]
fn a_file_that_says_it_already_needs_no_option() {
    let folder = Folder::new();
    folder.write("two.glb", spheres(&json!([wax(), {"name": "wood"}])));
    let baked = folder.run(&format!("bake two.glb {BAKE} -o two.tlux")).ok();
    for line in [
        "MATERIAL wax: KHR_materials_volume_scatter of the file, g 0, eta 1.44 | asked multi-scatter albedo 0.900 0.700 0.500",
        "MATERIAL wood: opaque",
        "wax: mean free path 2.00 2.00 2.00 mm",
        "of the materials these are not used: normalTexture",
    ] {
        assert_eq!(baked.stderr.matches(line).count(), 1, "{line}: {}", baked.stderr);
    }
    folder.run("render two.tlux --light constant:radiance=1 --resolution 64x64 -o two.png -q").ok();
    // The asset keeps the medium of the file.
    let report = folder.run("inspect two.tlux --json").ok().json();
    let media = report["media"].as_array().unwrap();
    assert_eq!((media.len(), media[0]["name"].as_str()), (1, Some("wax")));
    assert!((media[0]["mean_free_path_mm"][2].as_f64().unwrap() - 2.0).abs() < 1e-6);
    // Whoever names them wins.
    let named = folder.run(&format!("bake two.glb {BAKE} --material marble -o marble.tlux")).ok();
    assert!(!named.stderr.contains("MATERIAL") && named.stderr.contains("marble: mean free path"), "{}", named.stderr);
    let scaled = folder.run(&format!("bake two.glb {BAKE} --unit cm --skip wood -o small.tlux")).ok();
    assert!(scaled.stderr.contains("wax: mean free path 0.0200 0.0200 0.0200 mm"), "{}", scaled.stderr);
}

#[test]
fn what_a_file_cannot_say_is_asked_for() {
    let folder = Folder::new();
    let glass = json!({"name": "glass", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}});
    let mut thin = wax();
    thin["extensions"].as_object_mut().unwrap().remove("KHR_materials_volume");
    let mut bad = wax();
    bad["extensions"]["KHR_materials_volume"]["attenuationDistance"] = json!(-1);
    for (materials, code, fragments) in [
        (json!([wax(), glass]), 1, ["a.glb: material 'glass' lets light through", "--skip 'glass'"]),
        (json!([thin]), 1, ["material 'wax' scatters light inside", "--color '#f3dabc' --radius-mm 1"]),
        (json!([bad]), 3, ["material 'wax'", "attenuationDistance: -1 is no distance above 0"]),
        (json!([{"name": "wood"}]), 1, ["what is it made of?", "--material marble"]),
    ] {
        folder.write("a.glb", spheres(&materials));
        folder.run(&format!("bake a.glb {BAKE} -o a.tlux")).fails(code, &fragments);
        folder.run(&format!("bake a.glb {BAKE} --material wax -o a.tlux -q")).ok();
    }
}
