//! Real files: counts against an independent walk of their JSON, and known broken files.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::super::read_gltf;
use super::check_promises;
use crate::error::{Error, ExitCode};
use crate::geometry::source::SourceModel;
use crate::io::reader_tests::shared_data;

/// The JSON of either container, found without the code under test.
fn json_of(bytes: &[u8]) -> Value {
    if bytes.starts_with(b"glTF") {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        return serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    }
    serde_json::from_slice(bytes).unwrap()
}

/// Vertices and triangles below a node, instances counted; triangle lists only.
fn count_below(json: &Value, node: u64) -> (u64, u64) {
    let count_of = |accessor: &Value| json["accessors"][accessor.as_u64().unwrap() as usize]["count"].as_u64().unwrap();
    let node = &json["nodes"][node as usize];
    let mut total = (0, 0);
    if let Some(mesh) = node["mesh"].as_u64() {
        let instances = match &node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] {
            Value::Object(attributes) => count_of(attributes.values().next().unwrap()),
            _ => 1,
        };
        for primitive in json["meshes"][mesh as usize]["primitives"].as_array().unwrap() {
            assert!(primitive.get("mode").is_none_or(|mode| mode == 4));
            let vertices = count_of(&primitive["attributes"]["POSITION"]);
            let corners = primitive.get("indices").map_or(vertices, count_of);
            total = (total.0 + instances * vertices, total.1 + instances * corners / 3);
        }
    }
    for child in node["children"].as_array().into_iter().flatten() {
        let below = count_below(json, child.as_u64().unwrap());
        total = (total.0 + below.0, total.1 + below.1);
    }
    total
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path));
        } else if path.extension().is_some_and(|suffix| suffix == "gltf" || suffix == "glb") {
            files.push(path);
        }
    }
    files.sort();
    files
}

#[test]
fn real_files_have_the_counts_of_their_json() {
    let Some(data) = shared_data("") else { return };
    let files = files_below(&data.join("gltf"));
    assert!(files.len() >= 22, "{}", files.len());
    for path in files {
        let name = path.strip_prefix(data.join("gltf")).unwrap().display().to_string();
        let result = read_gltf(&path);
        if ["DuckDraco/Duck.gltf", "pirate_meshopt.glb"].contains(&name.as_str()) {
            let error = result.unwrap_err();
            assert_eq!(error.code(), ExitCode::Unsupported, "{name}");
            assert!(error.message().contains("_compression") && error.message().contains("gltf-transform"), "{error}");
            continue;
        }
        if name.starts_with("json_only/") {
            let error = result.unwrap_err();
            assert_eq!(error.code(), ExitCode::Io, "{name}");
            assert!(error.message().contains(".bin") && error.message().contains("buffer 0"), "{error}");
            continue;
        }
        let model = result.unwrap_or_else(|e| panic!("{name}: {e}"));
        check_promises(&model);
        let json = json_of(&std::fs::read(&path).unwrap());
        let scene = json["scene"].as_u64().unwrap_or(0) as usize;
        let roots = json["scenes"][scene]["nodes"].as_array().unwrap();
        let (vertices, triangles) = roots
            .iter()
            .map(|root| count_below(&json, root.as_u64().unwrap()))
            .fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        assert_eq!((model.positions.len() as u64, model.triangles.len() as u64), (vertices, triangles), "{name}");
        println!("{name}: {vertices} v, {triangles} t, {:?}, {:?}", model.materials, model.warnings);
    }
}

#[test]
fn names_and_instances_are_where_they_belong() {
    let Some(data) = shared_data("") else { return };
    let read = |name: &str| read_gltf(&data.join("gltf").join(name)).unwrap();
    let suzanne = read("IridescenceSuzanne.glb");
    assert!(suzanne.warnings.iter().any(|w| w.contains("KHR_materials_iridescence")), "{:?}", suzanne.warnings);
    assert_eq!(suzanne.materials, ["Material"]);
    assert_eq!(read("gltf_primitives.glb").materials, ["Top", "Left", "Right", "Others"]);
    assert_eq!(read("BoxInterleaved.glb").materials, ["material_0"]);
    // Five in each of three directions, one apart at least: instances are placed, not stacked.
    let cubes = read("SimpleInstancing.glb");
    let mut corners: Vec<[i64; 3]> =
        cubes.positions.iter().step_by(24).map(|p| p.to_array().map(|c| (c * 1e4).round() as i64)).collect();
    corners.sort_unstable();
    corners.dedup();
    assert_eq!(corners.len(), 125);
}

#[test]
fn a_quantised_model_is_where_the_original_is() {
    let Some(data) = shared_data("") else { return };
    let read = |name: &str| read_gltf(&data.join("gltf").join(name)).unwrap();
    let bounds = |model: &SourceModel| {
        let fold = |f: fn(glam::DVec3, glam::DVec3) -> glam::DVec3| model.positions.iter().copied().reduce(f).unwrap();
        (fold(glam::DVec3::min), fold(glam::DVec3::max))
    };
    let (low, high) = bounds(&read("Duck/Duck.gltf"));
    let (low_q, high_q) = bounds(&read("DuckQuantized/Duck.gltf"));
    let size = (high - low).length();
    assert!((low - low_q).length().max((high - high_q).length()) < 1e-3 * size, "{low} {low_q} {high} {high_q}");
}

#[test]
fn mirrored_nodes_keep_outside_outside() {
    let Some(data) = shared_data("") else { return };
    for name in ["NegativeScaleTest.glb", "OrientationTest.glb", "CesiumMilkTruck.glb", "DuckQuantized/Duck.gltf"] {
        let model = read_gltf(&data.join("gltf").join(name)).unwrap();
        let normals = model.normals.as_ref().unwrap();
        let (mut agree, mut faces) = (0usize, 0usize);
        for (triangle, corners) in model.triangles.iter().zip(&normals.corners) {
            let [a, b, c] = triangle.map(|i| model.positions[i as usize]);
            let geometric = (b - a).cross(c - a);
            let stored: glam::DVec3 = corners.iter().map(|&i| normals.values[i as usize].as_dvec3()).sum();
            if geometric.length() > 0.0 && stored.length() > 0.0 {
                faces += 1;
                agree += usize::from(geometric.dot(stored) > 0.0);
            }
        }
        println!("{name}: {agree} of {faces} faces agree with their normals");
        assert!(faces * 100 > model.triangles.len() * 95 && agree * 100 > faces * 99, "{name}: {agree} of {faces}");
    }
}

#[test]
fn broken_files_are_refused_with_their_reason() {
    let Some(data) = shared_data("") else { return };
    // Boxes with usable geometry load; everything else must say what is wrong.
    let table = [
        ("accessor_index_out_of_range.gltf", Err("bufferView 0 names buffer 0, which does not exist")),
        ("bad_magic.glb", Err("does not start with `glTF`")),
        ("bad_version.glb", Err("version 0")),
        ("box_bad_normals.glb", Ok((24, 12, "not of unit length"))),
        ("box_infinities.glb", Err("is not finite")),
        ("box_not_manifold.glb", Ok((9, 12, ""))),
        ("buffer_index_out_of_range.gltf", Err("bufferView 1 names buffer 1")),
        ("chunk_too_big.glb", Err("truncated GLB chunk header")),
        ("empty.glb", Err("the file is empty")),
        ("index_out_of_range/IndexOutOfRange.gltf", Err("index ")),
        ("integer_overflow.gltf", Err("`1e+300`, expected u64 at line 34")),
        ("length_mismatch.glb", Err("declares 49 bytes")),
        ("missing_bin.gltf", Err("cannot read ")),
        ("no_position.gltf", Err("no POSITION")),
        ("recursive_nodes.gltf", Err("reached twice")),
        ("truncated_data.glb", Err("declares 48 bytes")),
        ("truncated_header.glb", Err("truncated GLB chunk header")),
        ("unequal_counts.gltf", Err("COLOR_0 has 4 elements, POSITION has 3")),
    ];
    let folder = data.join("bad");
    assert_eq!(files_below(&folder).len(), table.len());
    for (name, expected) in table {
        let result = read_gltf(&folder.join(name));
        println!("{name}: {:?}", result.as_ref().map_or_else(Error::to_string, |model| model.warnings.join("; ")));
        match (result, expected) {
            (Ok(model), Ok((vertices, triangles, warning))) => {
                check_promises(&model);
                assert_eq!((model.positions.len(), model.triangles.len()), (vertices, triangles), "{name}");
                assert_eq!(model.warnings.iter().any(|w| w.contains(warning)), !warning.is_empty(), "{name}");
            }
            (Err(error), Err(fragment)) => {
                let code = if name == "missing_bin.gltf" { ExitCode::Io } else { ExitCode::InvalidInput };
                assert_eq!(error.code(), code, "{name}: {error}");
                assert!(error.message().contains(fragment) && error.message().contains(name), "{name}: {error}");
            }
            (result, _) => panic!("{name}: {:?}", result.map(|model| model.triangles.len())),
        }
    }
}

#[test]
fn a_large_scan_loads_in_a_quarter_second() {
    let Some(data) = shared_data("") else { return };
    let path = data.join("meshes/igea_full.glb");
    let time = |_| {
        let start = Instant::now();
        let model = read_gltf(&path).unwrap();
        let elapsed = start.elapsed();
        assert_eq!((model.positions.len(), model.triangles.len()), (134_345, 268_686));
        assert!(model.normals.is_none() && model.uvs.is_none());
        elapsed
    };
    // The best of three: other tests share the processors.
    let best = (0..3).map(time).min().unwrap();
    println!("igea_full.glb: {best:?}");
    assert!(best < Duration::from_millis(250), "{best:?}");
}
