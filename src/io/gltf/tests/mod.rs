//! Tests of the importer: self-made documents, real and broken files, mutations.

#![allow(clippy::unwrap_used)]

mod features;
mod files;
mod insides;
mod mutations;
mod pictures;
mod poses;
mod refusals;

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::read_bytes;
use crate::error::{ExitCode, Result};
use crate::geometry::source::SourceModel;
use crate::io::reader_tests;

/// A document under construction: one buffer, one bufferView for each accessor.
struct Maker {
    json: Value,
    bytes: Vec<u8>,
}

impl Maker {
    fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"},
            "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}],
            "meshes": [{"primitives": []}],
            "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
        });
        Self { json, bytes: Vec::new() }
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend_from_slice(bytes);
        push(&mut self.json["bufferViews"], view)
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "type": kind, "componentType": component, "count": count});
        push(&mut self.json["accessors"], accessor)
    }

    fn floats(&mut self, kind: &str, width: usize, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(kind, 5126, values.len() / width, &bytes)
    }

    fn primitive(&mut self, primitive: Value) {
        push(&mut self.json["meshes"][0]["primitives"], primitive);
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0]["byteLength"] = json!(self.bytes.len());
        glb(json.to_string().as_bytes(), &self.bytes)
    }

    fn read(&self) -> Result<SourceModel> {
        read_bytes(&self.glb(), Path::new("made.glb"))
    }

    fn message(&self) -> String {
        let error = self.read().unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput, "{error}");
        error.to_string()
    }
}

fn glb(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let mut out = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, data, pad) in [(b"JSON", json, b' '), (b"BIN\0", binary, 0)] {
        let length = data.len().next_multiple_of(4);
        out.extend_from_slice(&(length as u32).to_le_bytes());
        out.extend_from_slice(kind);
        out.extend_from_slice(data);
        out.resize(out.len() + length - data.len(), pad);
    }
    let length = out.len() as u32;
    out[8..12].copy_from_slice(&length.to_le_bytes());
    out
}

fn push(list: &mut Value, value: Value) -> usize {
    let list = list.as_array_mut().unwrap();
    list.push(value);
    list.len() - 1
}

const SQUARE: [f32; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];

/// A unit square in z = 0 as two triangles, with normals and texture coordinates.
fn square() -> Maker {
    let mut maker = Maker::new();
    let position = maker.floats("VEC3", 3, &SQUARE);
    let normal = maker.floats("VEC3", 3, &[0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.]);
    let uv = maker.floats("VEC2", 2, &[0., 1., 1., 1., 1., 0., 0., 0.25]);
    let indices = maker.accessor("SCALAR", 5121, 6, &[0, 1, 2, 0, 2, 3]);
    maker.primitive(json!({
        "attributes": {"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv}, "indices": indices
    }));
    maker
}

/// Small valid files that together use every feature, for the mutation test.
fn feature_files() -> Vec<(Vec<u8>, PathBuf)> {
    let mut files = vec![square()];
    let mut strip = square();
    strip.json["meshes"][0]["primitives"][0]["mode"] = json!(5);
    strip.json["nodes"] =
        json!([{"children": [1, 2], "scale": [1, -2, 1]}, {"mesh": 0}, {"mesh": 0, "rotation": [0, 1, 0, 0]}]);
    files.push(strip);
    let mut sparse = square();
    let indices = sparse.view(&[1, 0, 3, 0]);
    let values = sparse.view(&[0x3f; 24]);
    sparse.json["accessors"][0]["sparse"] = json!({
        "count": 2, "indices": {"bufferView": indices, "componentType": 5123}, "values": {"bufferView": values}
    });
    files.push(sparse);
    let mut instanced = square();
    let rotation = instanced.accessor("VEC4", 5122, 2, &[0, 0, 0xff, 0x7f, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0x7f]);
    instanced.json["accessors"][rotation]["normalized"] = json!(true);
    instanced.json["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": rotation}}});
    instanced.json["materials"] = json!([{"name": "a"}]);
    instanced.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    files.push(instanced);
    files.iter().map(|maker| (maker.glb(), "made.glb".into())).collect()
}

/// Checks the promises of a model.
fn check_promises(model: &SourceModel) {
    reader_tests::check_promises(model, 1e-5);
}
