//! Refused and ignored content, and the messages about it.

use std::path::Path;

use glam::{Vec2, Vec3};
use serde_json::{Value, json};

use super::super::{read_bytes, read_gltf};
use super::{SQUARE, push, square};
use crate::error::ExitCode;

#[test]
fn a_small_file_cannot_ask_for_endless_geometry() {
    let mut maker = square();
    // A million vertices from two sparse bytes, then a million instances of them.
    let index = maker.view(&[0]);
    let value = maker.view(&[0; 12]);
    let sparse = json!({
        "count": 1, "indices": {"bufferView": index, "componentType": 5121}, "values": {"bufferView": value}
    });
    let many = json!({"componentType": 5126, "type": "VEC3", "count": 1 << 20, "sparse": sparse});
    let many = push(&mut maker.json["accessors"], many);
    maker.json["meshes"][0]["primitives"][0] = json!({"attributes": {"POSITION": many}});
    maker.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": many}}});
    assert!(maker.message().contains("vertices with all instances"));
    // One mesh with many primitives of it.
    maker.json["nodes"][0].as_object_mut().unwrap().remove("extensions");
    maker.json["meshes"][0]["primitives"] = json!(vec![json!({"attributes": {"POSITION": many}}); 100]);
    assert!(maker.message().contains("vertices with all instances"));
    for count in [(1u64 << 20) + 1, u64::MAX] {
        maker.json["accessors"][many]["count"] = json!(count);
        assert!(maker.message().contains("without a bufferView"));
    }
    maker.json["accessors"][0]["count"] = json!(u64::MAX);
    maker.json["meshes"][0]["primitives"] = json!([{"attributes": {"POSITION": 0}}]);
    assert!(maker.message().contains("do not fit"));
}

#[test]
fn invalid_normals_become_none_and_missing_attributes_zero() {
    let mut maker = square();
    let normal = maker.floats("VEC3", 3, &[0., 0., 1., 0., 0., 0., 0., 0., 0.1, f32::NAN, 0., 1.]);
    maker.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normal);
    let uv = maker.floats("VEC2", 2, &[0., 1., f32::INFINITY, 0., 0., 0., 0., 0.]);
    maker.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uv);
    maker.primitive(json!({"attributes": {"POSITION": 0}}));
    let model = maker.read().unwrap();
    let mut expected = vec![Vec3::ZERO; 8];
    expected[0] = Vec3::Z;
    assert_eq!(model.normals.unwrap().values, expected);
    let uvs = model.uvs.unwrap().values;
    assert_eq!((uvs[1], uvs[2], uvs[7]), (Vec2::ZERO, Vec2::Y, Vec2::ZERO));
    let all = model.warnings.join("\n");
    for fragment in
        ["3 stored normals", "1 texture coordinates are not finite", "computed ones", "those of the latter are 0"]
    {
        assert!(all.contains(fragment), "{fragment} in {all}");
    }
}

#[test]
fn non_finite_vertices_matter_only_where_used() {
    let mut maker = square();
    let mut positions = SQUARE;
    positions[10] = f32::NAN;
    let position = maker.floats("VEC3", 3, &positions);
    maker.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(position);
    let message = maker.message();
    assert!(message.contains("vertex 3 (0, NaN, 0) of triangle 1 is not finite"), "{message}");
    let indices = maker.accessor("SCALAR", 5121, 3, &[0, 1, 2]);
    maker.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    assert!(maker.read().unwrap().positions[3].is_nan());
    // Finite where stored, infinite where placed: eleven times 1e30 overflows f64.
    maker.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(0);
    let mut nodes: Vec<Value> = (1..12).map(|child| json!({"scale": [1e30, 1, 1], "children": [child]})).collect();
    nodes.push(json!({"mesh": 0}));
    maker.json["nodes"] = json!(nodes);
    assert!(maker.message().contains("its transform is not finite"));
}

#[test]
fn what_is_left_out_is_said() {
    let mut maker = square();
    let triangles = maker.json["meshes"][0]["primitives"][0].clone();
    let mut skinned = triangles.clone();
    skinned["targets"] = json!([{"POSITION": 0}]);
    maker.json["meshes"][0]["primitives"] = json!([
        {"attributes": {"POSITION": 0}, "mode": 0}, {"attributes": {"POSITION": 0}, "mode": 3}, {"attributes": {"NORMAL": 1}}, skinned
    ]);
    maker.json["nodes"][0]["skin"] = json!(0);
    maker.json["nodes"][0]["rotation"] = json!([0, 0, 0, 2]);
    maker.json["extensionsUsed"] = json!(["VENDOR_odd", "KHR_materials_ior"]);
    maker.json["extensionsRequired"] = json!(["KHR_materials_volume"]);
    let model = maker.read().unwrap();
    assert_eq!((model.positions.len(), model.triangles.len()), (4, 2));
    let all = model.warnings.join("\n");
    for fragment in [
        "required extensions without effect on the geometry are ignored: [\"KHR_materials_volume\"]",
        "optional extensions are not read: [\"VENDOR_odd\"]",
        "mesh 0, primitive 0 and 1 more: points and lines",
        "no POSITION",
        "skin is not applied",
        "morph targets",
        "not of unit length: it is normalised",
    ] {
        assert!(all.contains(fragment), "{fragment} in\n{all}");
    }
    maker.json["meshes"][0]["primitives"].as_array_mut().unwrap().truncate(2);
    assert!(maker.message().contains("no triangles") && maker.message().contains("points and lines"));
}

#[test]
fn extensions_that_hold_geometry_are_unsupported() {
    for name in
        ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "VENDOR_mesh_thing"]
    {
        let mut maker = square();
        maker.json["extensionsRequired"] = json!([name]);
        let error = maker.read().unwrap_err();
        assert_eq!(error.code(), ExitCode::Unsupported);
        assert!(error.message().contains(name), "{error}");
        assert_eq!(error.message().contains("gltf-transform"), name.contains("compression"));
    }
    for (version, minimum) in [("1.0", None), ("3.0", None), ("2.1", Some("2.1"))] {
        let mut maker = square();
        maker.json["asset"] = json!({"version": version, "minVersion": minimum});
        assert_eq!(maker.read().unwrap_err().code(), ExitCode::Unsupported);
    }
    let old = br#"{"asset": {"version": "1.0"}, "meshes": {"a": {}}}"#;
    assert_eq!(read_bytes(old, Path::new("a.gltf")).unwrap_err().code(), ExitCode::Unsupported);
}

#[test]
fn optional_compression_needs_its_fallback() {
    let mut maker = square();
    maker.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    let draco = json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}});
    maker.json["meshes"][0]["primitives"][0]["extensions"] = draco;
    assert_eq!(maker.read().unwrap().triangles.len(), 2);
    maker.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(maker.read().unwrap_err().code(), ExitCode::Unsupported);
}

/// Each change of the square, and the expected part of the message.
#[test]
fn refusals_name_the_place() {
    let table: &[(&str, Value, &str)] = &[
        ("/accessors/0/type", json!("VEC2"), "accessor 0: it is Vec2 of F32"),
        ("/accessors/0/componentType", json!(5123), "POSITION must be VEC3"),
        ("/accessors/0/componentType", json!(7), "its type or componentType"),
        ("/accessors/0/count", json!(5), "NORMAL has 4 elements, POSITION has 5"),
        ("/accessors/3/componentType", json!(5126), "indices must be SCALAR"),
        ("/accessors/3/count", json!(7), "accessor 3: bufferView 3: 7 elements of 1 bytes"),
        ("/accessors/0/byteOffset", json!(4), "do not fit"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "do not fit"),
        ("/accessors/0/byteOffset", json!(-1), "not a valid glTF document"),
        ("/accessors/0/bufferView", json!(9), "accessor 0 names bufferView 9"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "is past the buffer's end"),
        ("/bufferViews/0/byteLength", json!(1e300), "not a valid glTF document"),
        ("/bufferViews/0/byteLength", json!(999), "is past the buffer's end"),
        ("/bufferViews/0/byteStride", json!(0), "byteStride 0"),
        ("/bufferViews/0/buffer", json!(1), "bufferView 0 names buffer 1"),
        ("/meshes/0/primitives/0/indices", json!(4), "mesh 0, primitive 0 names accessor 4"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(4), "names accessor 4"),
        ("/meshes/0/primitives/0/attributes/NORMAL", json!(2), "NORMAL must be VEC3"),
        ("/meshes/0/primitives/0/attributes/TEXCOORD_0", json!(1), "TEXCOORD_0 must be VEC2"),
        ("/meshes/0/primitives/0/material", json!(0), "names material 0"),
        ("/meshes/0/primitives/0/mode", json!(7), "its mode"),
        ("/nodes/0/mesh", json!(1), "node 0 names mesh 1"),
        ("/nodes/0/children", json!([0]), "node 0 is reached twice"),
        ("/nodes/0/children", json!([1]), "node 0 names node 1"),
        ("/nodes/0/rotation", json!([0, 0, 0, 0]), "its rotation is zero"),
        ("/nodes/0/translation", json!([1e300, 0, 0]), "its transform is not finite"),
        ("/nodes/0/matrix", json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1e300]), "its matrix is not finite"),
        ("/nodes/0/matrix", json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), "not affine"),
        ("/scenes/0/nodes", json!([1]), "scene 0 names node 1"),
        ("/scenes/0/nodes", json!([0, 0]), "node 0 is reached twice"),
        ("/scene", json!(1), "the document names scene 1"),
        ("/buffers", json!([]), "bufferView 0 names buffer 0"),
        ("/meshes/0/primitives", json!([]), "no triangles"),
        ("/asset", json!({}), "missing field `version`"),
    ];
    for (pointer, value, fragment) in table {
        let mut maker = square();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match maker.json.pointer_mut(parent).unwrap() {
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value.clone(),
            object => object[key] = value.clone(),
        }
        if *pointer == "/buffers" {
            let error = read_bytes(maker.json.to_string().as_bytes(), Path::new("a.gltf")).unwrap_err();
            assert!(error.message().contains(fragment), "{error}");
            continue;
        }
        let message = maker.message();
        assert!(message.contains(fragment), "{pointer} = {value}: {message}");
    }
    let mut maker = square();
    maker.json["nodes"] = json!([{"mesh": 0, "children": [1, 2]}, {"children": [2]}, {}]);
    assert!(maker.message().contains("node 2 is a child of node 0 and again of node 1"));
    maker.json["nodes"] = json!([{"mesh": 0, "children": [1]}, {"children": [2]}, {"children": [0]}]);
    assert!(maker.message().contains("reached twice"));
    for (bytes, fragment) in [([0u8, 1, 4], "index 2 is 4, and there are only 4"), ([0, 255, 1], "restart value")] {
        let mut maker = square();
        let indices = maker.accessor("SCALAR", 5121, 3, &bytes);
        maker.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
        assert!(maker.message().contains(fragment));
    }
    let json = square().json.to_string();
    let error = read_bytes(json.as_bytes(), Path::new("a.gltf")).unwrap_err();
    assert!(error.message().contains("neither a uri nor a binary chunk"), "{error}");
}

#[test]
fn deep_trees_do_not_exhaust_the_stack() {
    let mut maker = square();
    let count = 200_000;
    let mut nodes: Vec<Value> = (1..count).map(|child| json!({"children": [child]})).collect();
    nodes.push(json!({"mesh": 0}));
    maker.json["nodes"] = json!(nodes);
    assert_eq!(maker.read().unwrap(), square().read().unwrap());
}

#[test]
fn external_buffers_come_from_the_folder_of_the_model() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    let maker = square();
    std::fs::write(folder.path().join("sub/a b.bin"), &maker.bytes).unwrap();
    let path = folder.path().join("model.gltf");
    let mut json = maker.json.clone();
    let mut read = |uri: &str, extra: usize| {
        json["buffers"][0] = json!({"byteLength": maker.bytes.len() + extra, "uri": uri});
        std::fs::write(&path, json.to_string()).unwrap();
        read_gltf(&path)
    };
    assert_eq!(read("sub/a%20b.bin", 0).unwrap(), maker.read().unwrap());
    for (uri, extra, code, fragment) in [
        ("sub/a%20b.bin", 1, ExitCode::InvalidInput, "bytes are there"),
        ("absent.bin", 0, ExitCode::Io, "absent.bin"),
        ("sub", 0, ExitCode::InvalidInput, "not a regular file"),
        ("../model.gltf", 0, ExitCode::InvalidInput, "leaves the model's folder"),
        ("https://example.org/x.bin", 0, ExitCode::InvalidInput, "scheme `https:`"),
    ] {
        let error = read(uri, extra).unwrap_err();
        assert_eq!(error.code(), code, "{error}");
        assert!(error.message().contains(fragment) && error.message().contains("model.gltf"), "{error}");
    }
    assert_eq!(read_gltf(&folder.path().join("none.glb")).unwrap_err().code(), ExitCode::Io);
}
