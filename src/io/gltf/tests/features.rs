//! Every supported feature, with the geometry in the test.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DVec3, Vec2, Vec3};
use serde_json::json;

use super::super::read_bytes;
use super::{SQUARE, square};

#[test]
fn a_square_is_read_as_stored() {
    let model = square().read().unwrap();
    assert_eq!(model.positions, [DVec3::ZERO, DVec3::X, DVec3::new(1., 1., 0.), DVec3::Y]);
    assert_eq!(model.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(model.triangle_material, [0, 0]);
    assert_eq!(model.materials, ["default"]);
    assert_eq!(model.metres_per_unit, Some(1.0));
    assert_eq!(model.warnings, [""; 0]);
    let normals = model.normals.unwrap();
    assert_eq!((normals.values, normals.corners), (vec![Vec3::Z; 4], model.triangles.clone()));
    let uvs = model.uvs.unwrap();
    assert_eq!(uvs.values, [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::new(0., 0.75)]);
    assert_eq!(uvs.corners, model.triangles);
}

#[test]
fn data_uris_and_plain_json_give_the_same_model() {
    let maker = square();
    let mut json = maker.json.clone();
    let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&maker.bytes));
    json["buffers"][0] = json!({"byteLength": maker.bytes.len(), "uri": uri});
    let text = format!("\u{feff}{json}");
    assert_eq!(read_bytes(text.as_bytes(), Path::new("x.gltf")).unwrap(), maker.read().unwrap());
}

#[test]
fn strips_and_fans_keep_the_winding() {
    for (mode, order, expected) in [
        (5, vec![0u8, 1, 3, 2], vec![[0, 1, 3], [1, 2, 3]]),
        (6, vec![0, 1, 2, 3], vec![[1, 2, 0], [2, 3, 0]]),
        // Two strips joined by repeated indices, the second from an even place.
        (5, vec![0, 1, 3, 3, 3, 1, 1, 2, 3], vec![[0, 1, 3], [1, 2, 3]]),
        (4, vec![0, 1, 2, 0], vec![[0, 1, 2]]),
    ] {
        let mut maker = square();
        let indices = maker.accessor("SCALAR", 5121, order.len(), &order);
        maker.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
        maker.json["meshes"][0]["primitives"][0]["mode"] = json!(mode);
        let model = maker.read().unwrap();
        assert_eq!(model.triangles, expected, "mode {mode}");
        for t in &model.triangles {
            let [a, b, c] = t.map(|i| model.positions[i as usize]);
            assert!((b - a).cross(c - a).z > 0.0, "{t:?}");
        }
        assert_eq!(model.warnings.len(), usize::from(mode == 4));
    }
}

#[test]
fn without_indices_the_vertices_follow_each_other() {
    let mut maker = square();
    maker.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    assert_eq!(maker.read().unwrap().triangles, [[0, 1, 2]]);
    maker.json["meshes"][0]["primitives"][0]["mode"] = json!(6);
    assert_eq!(maker.read().unwrap().triangles, [[1, 2, 0], [2, 3, 0]]);
}

#[test]
fn every_index_width_reads_the_same() {
    let expected = square().read().unwrap();
    for width in [1usize, 2, 4] {
        let mut maker = square();
        let bytes: Vec<u8> = [0u32, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()[..width].to_vec()).collect();
        let indices = maker.accessor("SCALAR", [0, 5121, 5123, 0, 5125][width], 6, &bytes);
        maker.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
        assert_eq!(maker.read().unwrap(), expected);
    }
}

#[test]
fn interleaved_vertices_are_read_by_their_stride() {
    let mut maker = square();
    let vertices: Vec<u8> =
        SQUARE.chunks(3).flat_map(|p| [p[0], p[1], p[2], 0.0, 0.0, 1.0]).flat_map(f32::to_le_bytes).collect();
    let view = maker.view(&vertices);
    maker.json["bufferViews"][view]["byteStride"] = json!(24);
    for (accessor, offset) in [(0, 0), (1, 12)] {
        maker.json["accessors"][accessor]["bufferView"] = json!(view);
        maker.json["accessors"][accessor]["byteOffset"] = json!(offset);
    }
    assert_eq!(maker.read().unwrap(), square().read().unwrap());
    maker.json["accessors"][1]["byteOffset"] = json!(16);
    assert!(maker.message().contains("do not fit"));
    maker.json["bufferViews"][view]["byteStride"] = json!(8);
    assert!(maker.message().contains("byteStride 8"));
}

#[test]
fn sparse_values_replace_the_base_or_zeros() {
    let mut maker = square();
    let indices = maker.view(&[1, 0, 3, 0]);
    let values: Vec<u8> = [7f32, 8., 9., -1., 2., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = maker.view(&values);
    maker.json["accessors"][0]["sparse"] = json!({
        "count": 2, "indices": {"bufferView": indices, "componentType": 5123}, "values": {"bufferView": values}
    });
    let positions = maker.read().unwrap().positions;
    let replaced = [DVec3::new(7., 8., 9.), DVec3::new(-1., 2., 0.)];
    assert_eq!(positions, [DVec3::ZERO, replaced[0], DVec3::new(1., 1., 0.), replaced[1]]);

    maker.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    let positions = maker.read().unwrap().positions;
    assert_eq!(positions, [DVec3::ZERO, replaced[0], DVec3::ZERO, replaced[1]]);

    for (count, fragment) in [(5, "5 values for 4 elements"), (3, "do not fit")] {
        maker.json["accessors"][0]["sparse"]["count"] = json!(count);
        assert!(maker.message().contains(fragment), "{count}");
    }
    maker.json["accessors"][0]["sparse"]["count"] = json!(2);
    for bad in [[3u8, 0, 1, 0], [1, 0, 1, 0], [1, 0, 4, 0]] {
        let indices = maker.view(&bad);
        maker.json["accessors"][0]["sparse"]["indices"]["bufferView"] = json!(indices);
        assert!(maker.message().contains("do not rise strictly"), "{bad:?}");
    }
    maker.json["accessors"][0].as_object_mut().unwrap().remove("sparse");
    assert!(maker.message().contains("neither a bufferView nor sparse"));
}

#[test]
fn quantised_attributes_follow_the_extension() {
    let mut maker = square();
    let position = maker.accessor("VEC3", 5122, 4, &{
        let values: [i16; 12] = [0, 0, 0, 32767, 0, 0, 32767, -32768, 0, 0, 16384, 0];
        values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()
    });
    let normal = maker.accessor("VEC3", 5120, 4, &[0, 0, 127, 0, 0, 127, 0, 0, 0x81, 73, 73, 73]);
    let uv = maker.accessor("VEC2", 5121, 4, &[0, 255, 255, 255, 255, 0, 0, 51]);
    for (accessor, attribute) in [(position, "POSITION"), (normal, "NORMAL"), (uv, "TEXCOORD_0")] {
        maker.json["accessors"][accessor]["normalized"] = json!(true);
        maker.json["meshes"][0]["primitives"][0]["attributes"][attribute] = json!(accessor);
    }
    assert!(maker.message().contains("POSITION must be VEC3 of f32"));
    maker.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    maker.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let model = maker.read().unwrap();
    let expected = [DVec3::ZERO, DVec3::X, DVec3::new(1., -1., 0.), DVec3::new(0., f64::from(16384f32 / 32767.), 0.)];
    assert_eq!(model.positions, expected);
    let normals = model.normals.unwrap().values;
    assert_eq!(normals[..3], [Vec3::Z, Vec3::Z, Vec3::NEG_Z]);
    assert!((normals[3] - Vec3::splat(1f32 / 3f32.sqrt())).length() < 1e-6);
    assert_eq!(model.uvs.unwrap().values[3], Vec2::new(0., 0.8));
    assert_eq!(model.warnings, [""; 0]);

    maker.json["accessors"][position]["normalized"] = json!(false);
    maker.json["accessors"][uv]["normalized"] = json!(false);
    let model = maker.read().unwrap();
    assert_eq!(model.positions[2], DVec3::new(32767., -32768., 0.));
    assert!(model.warnings[0].contains("KHR_texture_transform"), "{:?}", model.warnings);
}

#[test]
fn nested_transforms_apply_outermost_last() {
    let mut maker = square();
    let half = f64::sqrt(0.5);
    maker.json["nodes"] = json!([
        {"children": [2, 1], "translation": [10, 0, 0]},
        {"mesh": 0},
        {"rotation": [0, 0, half, half], "children": [3]},
        {"mesh": 0, "scale": [2, 3, 4]},
    ]);
    let model = maker.read().unwrap();
    assert_eq!((model.positions.len(), model.triangles.len()), (8, 4));
    // Node 3 comes first: scaled, turned by 90 degrees about z, moved.
    assert!((model.positions[2] - DVec3::new(7., 2., 0.)).length() < 1e-6, "{}", model.positions[2]);
    assert_eq!(model.positions[5], DVec3::new(11., 0., 0.));
    assert_eq!(model.triangles[2], [4, 5, 6]);
    // The same as one matrix, column-major.
    maker.json["nodes"] = json!([{"mesh": 0, "matrix": [0,2,0,0, -3,0,0,0, 0,0,4,0, 10,0,0,1]}]);
    let single = maker.read().unwrap();
    for (a, b) in single.positions.iter().zip(&model.positions) {
        assert!((*a - *b).length() < 1e-6);
    }
}

#[test]
fn normals_follow_the_inverse_transpose_and_mirrors_turn_the_winding() {
    let mut maker = square();
    let n = (Vec3::new(1., 0., 1.) / 2f32.sqrt()).to_array();
    let normal = maker.floats("VEC3", 3, &[n, n, n, n].concat());
    // The square tilted so that its geometric normal is (1, 0, 1).
    let position = maker.floats("VEC3", 3, &[0., 0., 0., 1., 0., -1., 1., 1., -1., 0., 1., 0.]);
    maker.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normal);
    maker.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(position);
    for scale in [
        [1., 1., 1.],
        [4., 1., 1.],
        [-4., 1., 1.],
        [1., 1., -2.],
        [-1., -3., -1.],
        [-1., 2., -1.],
        [1e-20, 1e-20, 1e-20],
    ] {
        maker.json["nodes"][0]["scale"] = json!(scale);
        let model = maker.read().unwrap();
        let normals = model.normals.unwrap().values;
        for &[a, b, c] in &model.triangles {
            let [pa, pb, pc] = [a, b, c].map(|i| model.positions[i as usize]);
            let geometric = (pb - pa).cross(pc - pa).normalize();
            assert!(geometric.dot(normals[a as usize].as_dvec3()) > 1.0 - 1e-6, "{scale:?}");
        }
    }
    maker.json["nodes"][0]["scale"] = json!([1, 1, 0]);
    let model = maker.read().unwrap();
    assert_eq!(model.normals.unwrap().values[0], Vec3::Z);
    assert!(model.warnings[0].contains("singular"), "{:?}", model.warnings);
    maker.json["nodes"][0]["scale"] = json!([0, 0, 0]);
    assert_eq!(maker.read().unwrap().normals.unwrap().values, [Vec3::ZERO; 4]);
}

#[test]
fn instances_are_expanded_after_their_node() {
    let mut maker = square();
    let translation = maker.floats("VEC3", 3, &[0., 0., 5., 0., 0., 6.]);
    let scale = maker.floats("VEC3", 3, &[1., 1., 1., -1., 1., 1.]);
    let rotation = maker.accessor("VEC4", 5120, 2, &[0, 0, 127, 0, 0, 0, 0, 127]);
    maker.json["accessors"][rotation]["normalized"] = json!(true);
    maker.json["nodes"][0]["translation"] = json!([100, 0, 0]);
    maker.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {
        "attributes": {"TRANSLATION": translation, "SCALE": scale, "ROTATION": rotation, "_ID": translation}
    }});
    let model = maker.read().unwrap();
    assert!((model.positions[1] - DVec3::new(99., 0., 5.)).length() < 1e-12);
    assert_eq!(model.positions[5], DVec3::new(99., 0., 6.));
    assert_eq!(model.triangles[2], [4, 6, 5]);
    let attributes = &mut maker.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
    attributes["SCALE"] = json!(0);
    assert!(maker.message().contains("another number"));
    maker.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = json!({"SCALE": 99});
    assert!(maker.message().contains("does not exist"));
}

#[test]
fn materials_have_names() {
    let mut maker = square();
    let primitive = maker.json["meshes"][0]["primitives"][0].clone();
    maker.json["materials"] = json!([{"name": "unused"}, {"name": "skin"}, {}, {"name": ""}, {"name": "skin"}]);
    for material in [3, 4, 2, 1] {
        let mut primitive = primitive.clone();
        primitive["material"] = json!(material);
        maker.primitive(primitive);
    }
    let model = maker.read().unwrap();
    assert_eq!(model.materials, ["default", "material_3", "skin", "material_2"]);
    assert_eq!(model.triangle_material, [0, 0, 1, 1, 2, 2, 3, 3, 2, 2]);
    assert_eq!(model.triangles[9], [16, 18, 19]);
}

#[test]
fn scenes_nodes_and_their_absence() {
    let mut maker = square();
    maker.json["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 1]}]);
    maker.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [1]}]);
    maker.json["scene"] = json!(1);
    let model = maker.read().unwrap();
    assert_eq!((model.positions.len(), model.positions[0].z), (4, 1.0));
    assert!(model.warnings[0].contains("only scene 1"));
    maker.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(maker.read().unwrap().positions[0].z, 0.0);
    maker.json["scenes"] = json!([]);
    maker.json["nodes"][1]["children"] = json!([0]);
    let model = maker.read().unwrap();
    assert_eq!((model.positions.len(), model.positions[4].z), (8, 1.0));
    assert!(model.warnings[0].contains("no scene"));
    maker.json["nodes"] = json!([]);
    let model = maker.read().unwrap();
    assert!(model.positions.len() == 4 && model.warnings[0].contains("no nodes"));
}
