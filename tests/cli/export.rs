//! `translux export`: what the files hold, against the rules of glTF, the shaders of docs/export.md and `evaluate`.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use glam::{DVec2, DVec3};
use serde_json::{Value, json};
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::io::exr::decode_planes;
use translux::io::png::decode_png;

use crate::common::{Folder, called, glb, obj_text, shared_data};

const LIGHT: &str = "--light directional:from=1,2,3:irradiance=3,2,1";

/// A GLB, taken apart.
struct Glb {
    json: Value,
    binary: Vec<u8>,
}

impl Glb {
    fn new(bytes: &[u8]) -> Self {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let end = 20 + word(12);
        assert!(end.is_multiple_of(4) && &bytes[16..20] == b"JSON" && &bytes[end + 4..end + 8] == b"BIN\0");
        let json: Value = serde_json::from_slice(&bytes[20..end]).unwrap();
        let binary = bytes[end + 8..].to_vec();
        assert_eq!(binary.len(), word(end));
        Self { json, binary }
    }

    fn of(folder: &Folder, name: &str) -> Self {
        let glb = Self::new(&folder.read(name));
        glb.check();
        validate(&folder.path(name));
        glb
    }

    fn bytes(&self) -> Vec<u8> {
        glb(&self.json, &self.binary)
    }

    fn list(&self, name: &str) -> &[Value] {
        self.json[name].as_array().map_or(&[], Vec::as_slice)
    }

    /// The elements of an accessor that is neither sparse nor a matrix.
    fn elements(&self, index: usize) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][index];
        let number = |value: &Value| value.as_u64().unwrap_or_default() as usize;
        let view = &self.json["bufferViews"][number(&accessor["bufferView"])];
        let width = ["SCALAR", "VEC2", "VEC3", "VEC4"].iter().position(|kind| accessor["type"] == *kind).unwrap() + 1;
        let size = match number(&accessor["componentType"]) {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            _ => 4,
        };
        let stride = view["byteStride"].as_u64().map_or(size * width, |stride| stride as usize);
        let (start, offset) = (number(&view["byteOffset"]), number(&accessor["byteOffset"]));
        let count = number(&accessor["count"]);
        // The rules of alignment and of length.
        assert!((start + offset).is_multiple_of(size) && stride.is_multiple_of(size) && count > 0);
        assert!(offset + (count - 1) * stride + size * width <= number(&view["byteLength"]));
        assert!(start + number(&view["byteLength"]) <= self.binary.len());
        let component = |at: usize| match (number(&accessor["componentType"]), &self.binary[at..at + size]) {
            (5121, &[a]) => f64::from(a),
            (5123, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
            (5125, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
            (5126, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
            other => panic!("{other:?}"),
        };
        let element = |i: usize| (0..width).map(|c| component(start + offset + i * stride + c * size)).collect();
        (0..count).map(element).collect()
    }

    fn primitives(&self) -> impl Iterator<Item = &Value> {
        self.list("meshes").iter().flat_map(|mesh| mesh["primitives"].as_array().unwrap())
    }

    fn attribute(&self, primitive: &Value, name: &str) -> Vec<DVec3> {
        let index = primitive["attributes"][name].as_u64().unwrap_or_else(|| panic!("no {name}")) as usize;
        self.elements(index).iter().map(|e| DVec3::new(e[0], e[1], e.get(2).copied().unwrap_or_default())).collect()
    }

    /// What Khronos's validator checks of what is written here, and that a second reader takes the file.
    fn check(&self) {
        gltf::Gltf::from_slice(&self.bytes()).unwrap();
        for (index, accessor) in self.list("accessors").iter().enumerate() {
            let elements = self.elements(index);
            assert!(elements.iter().flatten().all(|value| value.is_finite()));
            for (bound, pick) in [("min", f64::min as fn(f64, f64) -> f64), ("max", f64::max)] {
                for (c, bound) in accessor[bound].as_array().into_iter().flatten().enumerate() {
                    let found = elements.iter().map(|element| element[c]).reduce(pick).unwrap();
                    // JSON is read a last digit off here.
                    assert_eq!(bound.as_f64().unwrap() as f32, found as f32, "accessor {index}");
                }
            }
        }
        for primitive in self.primitives() {
            let attributes = primitive["attributes"].as_object().unwrap();
            let count =
                |index: &Value| self.json["accessors"][index.as_u64().unwrap() as usize]["count"].as_u64().unwrap();
            let vertices = count(&attributes["POSITION"]);
            assert!(self.json["accessors"][attributes["POSITION"].as_u64().unwrap() as usize]["min"].is_array());
            for (name, accessor) in attributes {
                assert_eq!(count(accessor), vertices, "{name}");
                if let Some((kind, number)) = name.split_once('_').filter(|(kind, _)| !kind.is_empty()) {
                    let number: usize = number.parse().unwrap();
                    assert!((0..number).all(|n| attributes.contains_key(&format!("{kind}_{n}"))), "{name} after a gap");
                }
            }
            if attributes.contains_key("COLOR_0") {
                let colours = self.attribute(primitive, "COLOR_0");
                assert!(colours.iter().all(|c| c.min_element() >= 0.0 && c.max_element() <= 1.0));
            }
            if attributes.contains_key("NORMAL") {
                assert!(self.attribute(primitive, "NORMAL").iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
            }
            if let Some(indices) = primitive["indices"].as_u64() {
                let indices = self.elements(indices as usize);
                assert!(indices.len().is_multiple_of(3) && indices.iter().all(|i| (i[0] as u64) < vertices));
            }
        }
    }
}

/// Khronos's validator, where scripts/test has put it.
fn validator() -> Option<PathBuf> {
    let package = Path::new(env!("CARGO_TARGET_TMPDIR")).parent()?.join("gltf-validator/node_modules/gltf-validator");
    let node = Command::new("node").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let found = Some(package).filter(|package| package.is_dir() && node.is_ok_and(|status| status.success()));
    if found.is_none() {
        println!("SKIPPED: no node with gltf-validator (scripts/test tools)");
    }
    found
}

fn validate(file: &Path) {
    const SCRIPT: &str = "
        const report = require(process.argv[1]).validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[2])));
        report.then(r => console.log(JSON.stringify(r.issues)), e => { console.error(e); process.exit(1); });";
    let Some(package) = validator() else { return };
    let output = Command::new("node").args(["-e", SCRIPT]).arg(package).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let issues: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&issues["numErrors"], &issues["numWarnings"]), (&json!(0), &json!(0)), "{issues}");
}

/// Radiance of a sky that has no more than two bands, each channel another.
fn smooth(w: DVec3) -> DVec3 {
    let of = |a: f64, b: f64| 1.0 + 0.5 * w.y * a + 0.3 * w.x * b + 0.3 * (w.x * w.y + a * w.z * w.z - b * w.y * w.z);
    DVec3::new(of(1.0, 0.3), of(0.4, -0.7), of(-0.8, 0.9))
}

/// Pixels of the sky, the direction and the solid angle of each (the conventions of OpenEXR's latitude-longitude maps).
fn pixels() -> Vec<(DVec3, f64)> {
    let (width, height) = (128_usize, 64_usize);
    let at = |i: usize| {
        let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let (latitude, longitude) = (PI * (0.5 - v / height as f64), 2.0 * PI * (0.5 - u / width as f64));
        let (sin, cos) = longitude.sin_cos();
        let direction = DVec3::new(sin * latitude.cos(), latitude.sin(), cos * latitude.cos());
        (direction, 2.0 * PI / width as f64 * PI / height as f64 * latitude.cos())
    };
    (0..width * height).map(at).collect()
}

/// The sky as a Radiance picture.
fn smooth_sky() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 64 +X 128\n".to_vec();
    for (direction, _) in pixels() {
        let radiance = smooth(direction);
        let exponent = radiance.max_element().log2().floor() as i32 + 1;
        let byte = |c: f64| (c * f64::from(8 - exponent).exp2()).round().min(255.0) as u8;
        bytes.extend([byte(radiance.x), byte(radiance.y), byte(radiance.z), (exponent + 128) as u8]);
    }
    bytes
}

/// The harmonics as docs/export.md has them.
fn harmonics(DVec3 { x, y, z }: DVec3) -> [f64; 9] {
    [
        0.282095,
        0.488603 * y,
        0.488603 * z,
        0.488603 * x,
        1.092548 * x * y,
        1.092548 * y * z,
        0.315392 * (3.0 * z * z - 1.0),
        1.092548 * x * z,
        0.546274 * (x * x - y * y),
    ]
}

/// Coefficients of the sky.
fn smooth_light() -> [DVec3; 9] {
    let mut light = [DVec3::ZERO; 9];
    for (direction, solid_angle) in pixels() {
        light.iter_mut().zip(harmonics(direction)).for_each(|(sum, y)| *sum += smooth(direction) * y * solid_angle);
    }
    light
}

/// A body without symmetry, with a dent that its neighbours shadow.
fn body(level: u32) -> SourceModel {
    let mut model = shapes::icosphere(1.0, level);
    for p in &mut model.positions {
        *p *= DVec3::new(6.0, 4.0, 3.0) * (1.0 - 0.5 * (-4.0 * p.distance_squared(DVec3::new(0.5, 0.7, 0.5))).exp());
    }
    called(model, "wax")
}

fn baked(folder: &Folder) {
    folder.obj("body.obj", &body(3)).write("sky.hdr", smooth_sky());
    folder.run("bake body.obj --unit mm --material marble --method two_pass --samples 1500 -o a.tlux -q").ok();
}

fn rms(values: &[DVec3], reference: &[DVec3]) -> f64 {
    let sum = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>();
    let difference = sum(&mut values.iter().zip(reference).map(|(a, b)| a.distance_squared(*b)));
    (difference / sum(&mut reference.iter().map(|b| b.length_squared()))).sqrt()
}

/// Colours, harmonics as shaders read them, for every engine, of one bake.
#[test]
fn vertices_have_what_evaluate_gives() {
    let folder = Folder::new();
    baked(&folder);
    folder.run(&format!("evaluate a.tlux -q -o b.ply {LIGHT}")).ok();
    let expected = folder.radiosity("b.ply");
    let report = folder.run(&format!("export a.tlux --as vertex-colors -o c.glb --json {LIGHT}")).ok().json();
    let glb = Glb::of(&folder, "c.glb");
    let primitive = &glb.json["meshes"][0]["primitives"][0];
    // No seams, no creases: the vertices are those of the model, in metres.
    let positions = folder.positions("b.ply");
    let found = glb.attribute(primitive, "POSITION");
    let origin = DVec3::from_array(serde_json::from_value(glb.json["nodes"][0]["translation"].clone()).unwrap());
    let vertex = |p: &DVec3| {
        let near = |q: &DVec3| q.distance((*p + origin) * 1000.0) < 1e-5;
        positions.iter().position(near).unwrap()
    };
    let order: Vec<usize> = found.iter().map(vertex).collect();
    assert_eq!(order.len(), positions.len());
    let expected: Vec<DVec3> = order.iter().map(|v| expected[*v]).collect();
    assert!(rms(&glb.attribute(primitive, "_TLX_E"), &expected) < 1e-6);
    let factor = report["exposure"]["factor"].as_f64().unwrap();
    assert_eq!(glb.json["meshes"][0]["extras"]["translux"]["exposure"].as_f64(), Some(factor));
    let colours: Vec<DVec3> = expected.iter().map(|b| (*b * factor).min(DVec3::ONE)).collect();
    assert!(rms(&glb.attribute(primitive, "COLOR_0"), &colours) < 1e-6);
    let cut = report["exposure"]["clamped_share"].as_f64().unwrap();
    assert!(colours.iter().any(|c| c.max_element() == 1.0) && cut > 0.0 && cut < 0.02, "{cut}");
    // Stops are of the radiance, B / pi.
    let report =
        folder.run(&format!("export a.tlux --as vertex-colors --exposure -1 -o c.glb --json {LIGHT}")).ok().json();
    assert!((report["exposure"]["factor"].as_f64().unwrap() - 0.5 / PI).abs() < 1e-12);

    folder.run("evaluate a.tlux -q --light sky.hdr -o b.ply").ok();
    let lit = folder.radiosity("b.ply");
    let lit: Vec<DVec3> = order.iter().map(|v| lit[*v]).collect();
    let light = smooth_light();
    let sum = |transfer: &[Vec<DVec3>]| -> Vec<DVec3> {
        let of = |v: usize| transfer.iter().zip(&light).map(|(t, l)| t[v] * *l).sum::<DVec3>().max(DVec3::ZERO);
        (0..lit.len()).map(of).collect()
    };
    let mut errors = Vec::new();
    for (order, count) in [("sh2", 9), ("sh1", 4)] {
        let report = folder.run(&format!("export a.tlux --as {order} --light sky.hdr -o h.glb --json")).ok().json();
        let glb = Glb::of(&folder, "h.glb");
        let primitive = &glb.json["meshes"][0]["primitives"][0];
        let transfer: Vec<Vec<DVec3>> = (0..count).map(|k| glb.attribute(primitive, &format!("_TLX_SH{k}"))).collect();
        assert!(primitive["attributes"].get(format!("_TLX_SH{count}")).is_none());
        let error = rms(&sum(&transfer), &lit);
        // Of the worst channel, and weighted by area.
        let told = report["flattening"]["error"]["rms"].as_f64().unwrap();
        assert!((0.5..2.0).contains(&(told / error)), "{order}: {error} measured, {told} told");
        errors.push(error);
    }
    // The sky has two bands: what is left is the noise of the rays, and the steps of the picture.
    assert!(errors[0] < 0.01 && errors[1] > 2.0 * errors[0] && errors[1] < 0.1, "{errors:?}");

    // Godot's CUSTOM0 to CUSTOM2 are pairs of texture coordinates, of the last of these.
    let named = Glb::new(&folder.read("h.glb"));
    let own = &named.json["meshes"][0]["primitives"][0];
    let transfer: Vec<Vec<DVec3>> = (0..4).map(|k| named.attribute(own, &format!("_TLX_SH{k}"))).collect();
    folder.run("export a.tlux --as sh1 --engine godot --light sky.hdr -o g.glb -q").ok();
    let glb = Glb::of(&folder, "g.glb");
    let primitive = &glb.json["meshes"][0]["primitives"][0];
    let pairs: Vec<Vec<DVec3>> = (2..8).map(|k| glb.attribute(primitive, &format!("TEXCOORD_{k}"))).collect();
    for v in 0..lit.len() {
        let floats: Vec<f64> = pairs.iter().flat_map(|pair| [pair[v].x, pair[v].y]).collect();
        let expected: Vec<f64> = transfer.iter().flat_map(|t| t[v].to_array()).collect();
        assert_eq!(floats, expected);
    }
}

/// Weights of the functions by the words of docs/export.md.
fn weights(basis: &Value, light: &[DVec3; 9], absorption: DVec3, size: f64) -> Vec<DVec3> {
    let numbers = |name: &str| -> Vec<f64> { serde_json::from_value(basis[name].clone()).unwrap() };
    let along = |factors: &[f64], factor: f64| -> Vec<f64> {
        let x = factor.clamp(factors[0], factors[factors.len() - 1]).ln();
        let of = |a: &f64| -> f64 {
            let others = factors.iter().filter(|b| *b != a);
            others.map(|b| (x - b.ln()) / (a.ln() - b.ln())).product()
        };
        factors.iter().map(of).collect()
    };
    let of_size = along(&numbers("size"), size);
    let of_absorption = absorption.to_array().map(|factor| along(&numbers("absorption"), factor));
    let table = numbers("weights");
    let mut table = table.iter();
    let functions = basis["functions"].as_u64().unwrap();
    let weight = |_| {
        let mut sum = DVec3::ZERO;
        for i in 0..of_absorption[0].len() {
            for share in &of_size {
                for (c, of_channel) in of_absorption.iter().enumerate() {
                    let lit: f64 = light.iter().map(|l| table.next().unwrap() * l[c]).sum();
                    sum[c] += of_channel[i] * share * lit;
                }
            }
        }
        sum
    };
    let weights = (0..functions).map(weight).collect();
    assert!(table.next().is_none());
    weights
}

/// What the script of docs/export.md makes of the same, where there is a program that runs it.
fn weights_by_script(folder: &Folder, light: &[DVec3; 9], absorption: DVec3, size: f64) -> Option<Vec<DVec3>> {
    let page = std::fs::read_to_string("docs/export.md").unwrap();
    let mut blocks = page.split("```js\n").skip(1).map(|block| block.split("```").next().unwrap());
    let script = blocks.find(|block| block.contains("function weights(")).unwrap();
    let light: Vec<[f64; 3]> = light.iter().map(|l| l.to_array()).collect();
    let arguments = json!([light, absorption.to_array(), size]);
    let script = format!(
        "{script}\nconst basis = JSON.parse(require('fs').readFileSync(process.argv[1]));\n\
         console.log(JSON.stringify(weights(basis, ...{arguments})));"
    );
    let Ok(output) = Command::new("node").args(["-e", &script]).arg(folder.path("u.json")).output() else {
        println!("SKIPPED: no node for the script of docs/export.md");
        return None;
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let weights: Vec<[f64; 3]> = serde_json::from_slice(&output.stdout).unwrap();
    Some(weights.into_iter().map(DVec3::from_array).collect())
}

/// Absorption and size change without the program, for two media at once, and are those of the asset in other materials.
#[test]
fn functions_serve_edits() {
    let folder = Folder::new();
    folder.obj("body.obj", &body(2)).write("sky.hdr", smooth_sky());
    folder.run("bake body.obj --unit mm --material marble --method two_pass --samples 300 -o a.tlux -q").ok();
    let report = folder.run("export a.tlux --as basis --light sky.hdr -o u.glb -o u.json --json").ok().json();
    let glb = Glb::of(&folder, "u.glb");
    let basis: Value = serde_json::from_slice(&folder.read("u.json")).unwrap();
    assert_eq!(glb.json["asset"]["extras"]["translux"]["basis"], basis);
    assert!(glb.json["meshes"][0]["extras"]["translux"].get("basis").is_none());
    let primitive = &glb.json["meshes"][0]["primitives"][0];
    let functions = report["basis"]["functions"].as_u64().unwrap() as usize;
    assert!((8..=32).contains(&functions), "{functions}");
    let fours: Vec<Vec<Vec<f64>>> = (0..functions.div_ceil(4))
        .map(|k| glb.elements(primitive["attributes"][format!("_TLX_U{k}")].as_u64().unwrap() as usize))
        .collect();
    let told = report["basis"]["errors"].as_array().unwrap();
    assert!(told.len() == 6 && told.iter().all(|of| of["rms"].as_f64().unwrap() < 0.02), "{told:?}");
    let light = smooth_light();

    let marble = [DVec3::new(2.19, 2.62, 3.00), DVec3::new(0.0021, 0.0041, 0.0071)];
    let triple = |v: DVec3| v.to_array().map(|c| c.to_string()).join(",");
    let positions = |name: &str| folder.positions(name);
    folder.run("evaluate a.tlux --light sky.hdr -q -o b.ply").ok();
    let bounds = |of: fn(DVec3, DVec3) -> DVec3| positions("b.ply").into_iter().reduce(of).unwrap();
    let diagonal = bounds(DVec3::max).distance(bounds(DVec3::min));
    for (absorption, size) in [
        (DVec3::ONE, 1.0),
        (DVec3::new(3.1, 1.0, 0.3), 1.0),
        (DVec3::splat(2.0), 0.6),
        (DVec3::new(0.4, 2.5, 1.3), 1.7),
    ] {
        let media = format!("--sigma-s {} --sigma-a {}", triple(marble[0]), triple(marble[1] * absorption));
        // The same in a larger object.
        let mm = diagonal * size;
        folder.run(&format!("evaluate a.tlux {media} --light sky.hdr -q -o b.ply --size-mm {mm}")).ok();
        let (expected, at) = (folder.radiosity("b.ply"), positions("b.ply"));
        let w = weights(&basis, &light, absorption, size);
        if let Some(of_script) = weights_by_script(&folder, &light, absorption, size) {
            assert!(rms(&of_script, &w) < 1e-9);
        }
        let found = glb.attribute(primitive, "POSITION");
        let origin = DVec3::from_array(serde_json::from_value(glb.json["nodes"][0]["translation"].clone()).unwrap());
        let largest = |of: &mut dyn Iterator<Item = f64>| of.fold(0.0, f64::max);
        let scale =
            largest(&mut at.iter().map(|p| p.length())) / largest(&mut found.iter().map(|p| (*p + origin).length()));
        let order: Vec<usize> =
            found.iter().map(|p| at.iter().position(|q| (*p + origin).distance(*q / scale) < 1e-6).unwrap()).collect();
        let expected: Vec<DVec3> = order.iter().map(|v| expected[*v]).collect();
        let radiosity = |v: usize| -> DVec3 {
            let u = fours.iter().flat_map(|four| &four[v]);
            u.zip(&w).map(|(u, w)| *u * *w).sum::<DVec3>().max(DVec3::ZERO)
        };
        let error = rms(&(0..expected.len()).map(radiosity).collect::<Vec<DVec3>>(), &expected);
        println!("{absorption} {size}: {error:.4}");
        assert!(error < 0.02, "{absorption} {size}: {error}");
    }

    folder.run("export a.tlux --as basis --size-range 1 --absorption-range 2 --light sky.hdr -o v.json -q").ok();
    let narrow: Value = serde_json::from_slice(&folder.read("v.json")).unwrap();
    assert_eq!(narrow["size"], json!([1.0]));
    let ends: Vec<f64> = serde_json::from_value(narrow["absorption"].clone()).unwrap();
    assert!((ends[0] - 0.5).abs() < 1e-12 && (ends[ends.len() - 1] - 2.0).abs() < 1e-12);

    let ask = |line: &str| folder.run(&format!("export {line}"));
    ask("a.tlux --as sh2 --size-range 2 -o x.glb").fails(1, &["--size-range", "basis"]);
    ask("a.tlux --as basis --absorption-range 0.5 -o x.glb").fails(1, &["--absorption-range", "1 to 16"]);
    ask("a.tlux --as basis --engine godot -o x.glb").fails(5, &["sh1"]);
    ask("a.tlux --as basis --light point:at=0,9,9:intensity=5 -o x.glb").fails(5, &["far away"]);
    folder.run("bake body.obj --unit mm --material marble --method quantized_lights --set lights=32 -o q.tlux -q").ok();
    ask("q.tlux --as basis -o x.glb").fails(5, &["baked into", "--edit any"]);
    assert!(!folder.names().contains(&"x.glb".to_owned()));
}

/// A cube of twelve triangles: charts are cut, texels have what the surface has, and the vertices of corners are shared by none.
#[test]
fn light_maps_show_the_surface() {
    let folder = Folder::new();
    folder.obj("cube.obj", &shapes::cuboid(DVec3::splat(5.0), 1));
    folder.run("bake cube.obj --unit mm --material marble --method two_pass --samples 2000 -o a.tlux -q").ok();
    let line = format!("export a.tlux --as lightmap --resolution 64 -o m.glb -o m.exr -o m.png --json {LIGHT}");
    let report = folder.run(&line).ok().json();
    let glb = Glb::of(&folder, "m.glb");
    let primitive = &glb.json["meshes"][0]["primitives"][0];
    let (map, own) = (&report["lightmap"], &glb.json["materials"][0]);
    assert_eq!(
        (&map["own_coordinates"], &map["exitance"], &map["resolution"]),
        (&json!(false), &json!("pixels"), &json!(64))
    );
    assert_eq!(own["pbrMetallicRoughness"]["baseColorTexture"], json!({ "index": 0, "texCoord": 0 }));
    let planes = decode_planes(&folder.read("m.exr")).unwrap();
    let planes = ["R", "G", "B"].map(|name| &planes.iter().find(|plane| plane.name == name).unwrap().samples);
    let picture = decode_png(&folder.read("m.png")).unwrap();
    let texel = |c: usize, i: usize| f64::from(planes[c][i]);
    let factor = report["exposure"]["factor"].as_f64().unwrap();
    for (i, rgb) in picture.rgb.iter().enumerate() {
        for (c, value) in rgb.iter().enumerate() {
            assert!((f64::from(*value) - (texel(c, i) * factor).min(1.0)).abs() < 0.006);
        }
        // No texel is left for filters to find dark.
        assert!(texel(0, i) > 0.0);
    }
    // `evaluate` writes the same texels, alone or beside the vertices.
    let line = format!("evaluate a.tlux {LIGHT} --texture 64 -o t.exr -o t.ply --json");
    let told = folder.run(&line).ok().json();
    assert_eq!(told["texture"], *map);
    let again = decode_planes(&folder.read("t.exr")).unwrap();
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        assert_eq!(again.iter().find(|plane| plane.name == name).unwrap().samples, *planes[c]);
    }
    folder.run(&format!("evaluate a.tlux {LIGHT} -o v.ply -q")).ok();
    assert_eq!(folder.read("t.ply"), folder.read("v.ply"));
    folder.run("evaluate a.tlux --texture 64 -o t.ply").fails(1, &["--texture", ".exr"]);
    folder.run("evaluate a.tlux --texture 9 -o t.exr").fails(1, &["16 to 8192"]);
    folder.run("evaluate a.tlux --on cube.obj -o t.exr").fails(1, &[".ply"]);
    // Centres of the faces by bilinear look-up against the asset, asked there by another mesh that has a vertex in each.
    let mut middles = shapes::cuboid(DVec3::splat(5.0), 2);
    middles.materials = vec!["default".to_owned()];
    folder.write("finer.obj", obj_text(&middles));
    folder.run(&format!("evaluate a.tlux --on finer.obj -q -o b.ply {LIGHT}")).ok();
    let (points, radiosity) = (folder.positions("b.ply"), folder.radiosity("b.ply"));
    let (positions, coordinates) = (glb.attribute(primitive, "POSITION"), glb.attribute(primitive, "TEXCOORD_0"));
    let corners = glb.elements(primitive["indices"].as_u64().unwrap() as usize);
    let look_up = |uv: DVec2| -> DVec3 {
        let at = uv * 64.0 - 0.5;
        let (low, share) = (at.floor(), at - at.floor());
        let of = |dx: f64, dy: f64| {
            let [x, y] = [low.x + dx, low.y + dy].map(|v| v.clamp(0.0, 63.0) as usize);
            DVec3::from_array([0, 1, 2].map(|c| texel(c, y * 64 + x)))
        };
        let row = |dy: f64| of(0.0, dy).lerp(of(1.0, dy), share.x);
        row(0.0).lerp(row(1.0), share.y)
    };
    let mut compared = 0;
    for triangle in corners.as_chunks::<3>().0 {
        let [a, b, c] = [0, 1, 2].map(|i| triangle[i][0] as usize);
        // Halfway along each edge is a vertex of the finer mesh: along the edges of the cube and the diagonals of its faces.
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let middle = (positions[from] + positions[to]) * 500.0;
            let Some(point) = points.iter().position(|p| p.distance(middle) < 1e-4) else { continue };
            let on_diagonal = positions[from].distance(positions[to]) > 0.006;
            if on_diagonal {
                let found = look_up((coordinates[from] + coordinates[to]).truncate() / 2.0);
                let expected = radiosity[point];
                assert!(found.distance(expected) < 0.03 * expected.length(), "{middle}: {found} {expected}");
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 12);
}

/// A file of two nodes that share a mesh, one of them mirrored, with names, a colour and a material that stay.
#[test]
fn files_keep_what_they_have() {
    let folder = Folder::new();
    let mut ball = called(shapes::icosphere(1.0, 1), "wax");
    ball.positions.iter_mut().for_each(|p| *p = *p * 2.0 + DVec3::new(4.0, 0.0, 0.0));
    folder.obj("ball.obj", &ball);
    folder.run("bake ball.obj --unit mm --material marble --method two_pass --samples 300 -o ball.tlux -q").ok();
    folder.run(&format!("export ball.tlux --as vertex-colors -o ball.glb -q {LIGHT}")).ok();
    let mut source = Glb::new(&folder.read("ball.glb"));
    source.json["nodes"] = json!([
        { "name": "left", "mesh": 0, "translation": [0.004, 0.0, 0.0], "extras": { "kept": 7 } },
        { "name": "right", "mesh": 0, "scale": [-1.0, 1.0, 1.0], "translation": [-0.004, 0.0, 0.0] },
        { "name": "eye", "camera": 0 },
    ]);
    source.json["scenes"] = json!([{ "nodes": [0, 1, 2] }]);
    source.json["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } }]);
    source.json["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = 0.123.into();
    folder.write("pair.glb", source.bytes());
    folder.run("bake pair.glb --material marble --method two_pass --samples 600 -o a.tlux -q").ok();
    folder.run(&format!("evaluate a.tlux -q -o b.ply {LIGHT}")).ok();
    let radiosity = folder.radiosity("b.ply");
    let run = folder.run(&format!("export a.tlux --as vertex-colors --scene pair.glb -o out.glb {LIGHT}")).ok();
    assert!(run.stderr.contains("EXPOSURE"), "{}", run.stderr);
    let glb = Glb::of(&folder, "out.glb");
    for (list, count) in [("materials", 1), ("cameras", 1), ("nodes", 3), ("meshes", 2), ("scenes", 1)] {
        assert_eq!(glb.list(list).len(), count, "{list}");
    }
    assert_eq!(glb.json["materials"], source.json["materials"]);
    assert_eq!((&glb.json["nodes"][0], &glb.json["nodes"][2]), (&source.json["nodes"][0], &source.json["nodes"][2]));
    assert_eq!((&glb.json["nodes"][1]["mesh"], &glb.json["nodes"][1]["name"]), (&json!(1), &json!("right")));
    let written: Vec<DVec3> = glb.primitives().flat_map(|p| glb.attribute(p, "_TLX_E")).collect();
    assert!(rms(&written, &radiosity) < 1e-6);
    // The colour that was there is still there, under the next number.
    let before = source.attribute(&source.json["meshes"][0]["primitives"][0], "COLOR_0");
    for primitive in glb.primitives() {
        assert_eq!(glb.attribute(primitive, "COLOR_1"), before);
        let of = |glb: &Glb, p: &Value| (glb.attribute(p, "POSITION"), glb.attribute(p, "NORMAL"));
        assert_eq!(of(&glb, primitive), of(&source, &source.json["meshes"][0]["primitives"][0]));
    }

    // Cut along the seams of a map, both halves keep their triangles and their winding.
    folder.run(&format!("export a.tlux --as lightmap --resolution 64 --scene pair.glb -o map.glb -q {LIGHT}")).ok();
    let map = Glb::of(&folder, "map.glb");
    let corners = |glb: &Glb, primitive: &Value| -> BTreeMap<String, usize> {
        let positions = glb.attribute(primitive, "POSITION");
        let indices = glb.elements(primitive["indices"].as_u64().unwrap() as usize);
        let mut count = BTreeMap::new();
        for triangle in indices.as_chunks::<3>().0 {
            let mut text: Vec<String> = triangle.iter().map(|i| format!("{:.7}", positions[i[0] as usize])).collect();
            let first = (0..3).min_by_key(|i| text[*i].clone()).unwrap();
            text.rotate_left(first);
            *count.entry(text.concat()).or_default() += 1;
        }
        count
    };
    let expected = corners(&source, &source.json["meshes"][0]["primitives"][0]);
    assert_eq!(map.primitives().count(), 2);
    for primitive in map.primitives() {
        assert_eq!(corners(&map, primitive), expected);
        assert_eq!(primitive["extras"]["translux"]["lightmap"], json!({ "index": 0, "texCoord": 0 }));
        let before = source.attribute(&source.json["meshes"][0]["primitives"][0], "COLOR_0").len();
        assert!(map.attribute(primitive, "COLOR_0").len() > before);
    }

    let ask = |line: &str| folder.run(&format!("export {line}"));
    ask("a.tlux --as sh2 --scene ball.glb -o x.glb").fails(3, &["ball.glb", "vertices"]);
    // The order of its vertices is another than that of the OBJ file.
    ask("ball.tlux --as sh1 --scene ball.glb -o x.glb").fails(3, &["ball.glb", "elsewhere"]);
    ask("a.tlux --as sh2 --light point:at=0,9,9:intensity=5 -o x.glb").fails(5, &["--light point", "far away"]);
    ask("a.tlux --as sh2 --engine godot -o x.glb").fails(5, &["sh1"]);
    ask("a.tlux --as sh2 --exposure 1 -o x.glb").fails(1, &["--exposure", "vertex-colors"]);
    ask("a.tlux --as sh2 --resolution 64 -o x.glb").fails(1, &["--resolution", "lightmap"]);
    ask("a.tlux --as lightmap --resolution 9 -o y.glb").fails(1, &["16 to 8192"]);
    ask("a.tlux --as lightmap --scene pair.glb -o y.png").fails(1, &["--scene", "GLB"]);
    ask("a.tlux --as vertex-colors -o x.exr").fails(1, &[".glb"]);
    assert!(!folder.names().iter().any(|name| name.starts_with("y.")));
}

/// Files of others, where this machine has them: external buffers and pictures, many nodes, strips, quantised attributes.
#[test]
fn files_of_others_stay_valid() {
    let Some(data) = shared_data() else { return };
    let folder = Folder::new();
    for name in ["BoxInterleaved.glb", "Duck/Duck.gltf", "SimpleMeshes.gltf", "DuckQuantized/Duck.gltf"] {
        let file = data.join("gltf").join(name);
        if !file.is_file() {
            continue;
        }
        let model = file.display();
        folder
            .run(&format!("bake {model} --size-mm 30 --material marble --method two_pass --samples 500 -o a.tlux -q"))
            .ok();
        for kind in ["vertex-colors", "lightmap --resolution 64"] {
            let line = format!("export a.tlux --as {kind} --scene {model} -o out.glb {LIGHT}");
            folder.run(&line).ok();
            let glb = Glb::new(&folder.read("out.glb"));
            validate(&folder.path("out.glb"));
            assert!(glb.list("images").iter().all(|image| image.get("uri").is_none()));
        }
    }
}
