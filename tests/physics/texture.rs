//! Textures as their users see them: multiplied into what is scattered, never into what is reflected, in `render` and
//! `relight`.
#![allow(clippy::unwrap_used, missing_docs)]

use std::fmt::Write;

use crate::common::Folder;
use crate::rendering::{Fake, camera, settings, size};
use glam::{DVec2, DVec3};
use translux::geometry::shapes;
use translux::io::exr::read_exr_channels;
use translux::io::png::{encode_png, read_png};
use translux::light::Light;
use translux::progress::Silent;
use translux::render::frame::{Frame, RenderSettings, render};
use translux::render::single::{Scattered, Single};
use translux::render::texture::Texture;
use translux::render::texture::spec::TextureSpec;

const LAYERS: [&str; 4] = ["diffuse", "single", "specular", "albedo"];

/// Red, green and blue of every pixel of a layer.
fn layer(folder: &Folder, file: &str, name: &str) -> Vec<[f32; 3]> {
    let planes = read_exr_channels(&folder.path(file)).unwrap();
    let plane = |c: &str| planes.iter().find(|p| p.name == format!("{name}.{c}")).map(|p| p.samples.clone());
    let [r, g, b] = ["R", "G", "B"].map(|c| plane(c).unwrap_or_default());
    (0..r.len()).map(|i| [r[i], g[i], b[i]]).collect()
}

/// A ball with single scattering.
fn ball() -> Folder {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(10.0, 3));
    folder
        .run("bake ball.obj --unit mm --material skin1 --method reference --samples 500 -o ball.tlux -q --set single-scattering=isotropic --set single-samples=4")
        .ok();
    folder
}

#[test]
fn scattered_layers_are_multiplied_and_reflected_ones_are_not() {
    let folder = ball();
    let line = "render ball.tlux --light sky --light directional:from=0.3,0.5,1:irradiance=3 --samples-per-pixel 1 \
                --resolution 48x48 --exr-type float -q --json";
    let plain = folder.run(&format!("{line} -o plain.exr")).ok().json();
    let report = folder.run(&format!("{line} --texture marble:veins=0.1,0.3,0.6 -o marble.exr")).ok().json();
    assert!(plain["texture"].is_null());
    let texture = report["texture"].as_str().unwrap();
    assert!(texture.starts_with("marble:scale=6.9") && texture.contains("veins=0.1,0.3,0.6"), "{texture}");
    let [plain, marble] = ["plain.exr", "marble.exr"].map(|file| LAYERS.map(|name| layer(&folder, file, name)));
    assert!(plain[3].is_empty() && !marble[3].is_empty());
    assert_eq!(plain[2], marble[2], "reflection");
    let mut veined = 0;
    for (i, albedo) in marble[3].iter().enumerate() {
        for c in 0..3 {
            for scattered in 0..2 {
                let expected = plain[scattered][i][c] * albedo[c];
                let found = marble[scattered][i][c];
                assert!((found - expected).abs() <= 1e-6 * expected, "{} {i}: {found} {expected}", LAYERS[scattered]);
            }
        }
        veined += usize::from(albedo[0] > 0.0 && albedo[0] < 0.5);
    }
    assert!(veined > 100, "{veined}");
    assert!(plain[1].iter().any(|p| p[0] > 0.0), "no single scattering");
    // The same settings written out are the same picture; the header says what they were.
    folder.run(&format!("{line} --texture {texture} -o again.exr")).ok();
    let bytes = folder.read("marble.exr");
    assert_eq!(bytes, folder.read("again.exr"));
    assert!(bytes.windows(texture.len()).any(|w| w == texture.as_bytes()));
    folder.run(&format!("{line} --texture marble --threads 1 -o one.exr")).ok();
    folder.run(&format!("{line} --texture marble --threads 3 -o three.exr")).ok();
    assert_eq!(folder.read("one.exr"), folder.read("three.exr"));
    folder.run(&format!("{line} --texture none -o none.exr")).ok();
    assert_eq!(folder.read("none.exr"), folder.read("plain.exr"));
}

#[test]
fn wrong_textures_are_refused_with_advice() {
    let folder = ball();
    let line = "render ball.tlux --resolution 8x8 -o x.exr -q --texture";
    for (texture, code, says) in [
        ("granite", 1, "no kind of texture"),
        ("marble:base=2", 1, "from 0 to 1"),
        ("marble:scale=1e-9", 1, "too fine"),
        ("marble:colour=1", 1, "not one of its keys"),
        ("image:path=wood.png", 5, "no texture coordinates"),
    ] {
        folder.run(&format!("{line} {texture}")).fails(code, &[says]);
        folder
            .run(&format!("relight ball.tlux --headless --frames 1 --out o --texture {texture} -q"))
            .fails(code, &[says]);
    }
    assert!(!folder.path("x.exr").exists());
}

fn rendered(fake: &Fake, texture: Option<&Texture>, view: &RenderSettings) -> Frame {
    let radiosity = fake.uniform();
    let scattered = Scattered { exitance: &radiosity, single: Single::None, texture };
    render(fake, scattered, &[Light::constant(DVec3::ONE).unwrap()], view, &Silent).unwrap()
}

/// Marble stands still in the object, wherever that is and whoever looks at it.
#[test]
fn the_albedo_of_a_pixel_is_that_of_the_place_it_shows() {
    let offset = DVec3::new(500.0, -20.0, 3.0);
    let fake = Fake::new(shapes::compose(&[(shapes::icosphere(10.0, 5), offset)]));
    let spec: TextureSpec = "marble:scale=5:octaves=3:seed=9".parse().unwrap();
    let texture = Texture::new(&spec, &fake.scene.mesh).unwrap().unwrap();
    let Texture::Marble(marble) = &texture else { panic!("kind") };
    for at in [DVec3::new(0.0, 0.0, 80.0), DVec3::new(-60.0, 30.0, -20.0)] {
        let eye = translux::render::camera::Camera::new(offset + at, offset, DVec3::Y, 0.15).unwrap();
        let view = RenderSettings { samples_per_pixel: 16, ..settings(eye, size(32, 24)) };
        let frame = rendered(&fake, Some(&texture), &view);
        assert!(frame.textured);
        for (i, pixel) in frame.pixels.iter().enumerate() {
            let middle = DVec2::new((i % 32) as f64 + 0.5, (i / 32) as f64 + 0.5);
            let direction = eye.direction(middle, view.resolution);
            let place = eye.at_mm() + direction * (f64::from(pixel.depth_mm) / direction.dot(eye.forward()));
            let expected = marble.albedo(place - fake.scene.mesh.origin_mm);
            let found = DVec3::from(pixel.albedo.map(f64::from));
            assert!((found - expected).abs().max_element() < 0.02, "{i}: {found} {expected}");
        }
    }
    let plain = rendered(&fake, None, &settings(camera([0.0, 0.0, 80.0], 2.0), size(4, 4)));
    assert!(!plain.textured);
    assert!(plain.pixels.iter().all(|p| p.albedo == [0.0; 3]));
}

/// A square in the plane z = 0 whose texture coordinates show the picture twice across and once upwards.
fn square(folder: &Folder) {
    let mut text = String::new();
    for (x, y) in [(-10, -10), (10, -10), (10, 10), (-10, 10)] {
        writeln!(text, "v {x} {y} 0").unwrap();
    }
    text.push_str("vt 0 0\nvt 2 0\nvt 2 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n");
    folder.write("square.obj", text);
    folder.run("bake square.obj --unit mm --material marble --method two_pass --samples 200 -o square.tlux -q").ok();
}

/// Sixteen by eight pixels: the upper half red on the left and green on the right, the lower one grey.
fn picture() -> Vec<[f32; 3]> {
    let colour = |i: usize| match (i / 16 < 4, i % 16 < 8) {
        (true, true) => [1.0, 0.0, 0.0],
        (true, false) => [0.0, 1.0, 0.0],
        (false, _) => [0.25; 3],
    };
    (0..128).map(colour).collect()
}

#[test]
fn pictures_lie_over_the_texture_coordinates_in_render_and_relight() {
    let folder = Folder::new();
    square(&folder);
    folder.write("two.png", encode_png(16, 8, &picture(), None).unwrap());
    let view = "--camera at=0,0,60:look=0,0,0:fov=18 --resolution 80x80 --no-specular --light constant:radiance=1 -q";
    let line = format!("render square.tlux {view} --texture image:path=two.png --exr-type float --json");
    let report = folder.run(&format!("{line} -o a.exr")).ok().json();
    assert_eq!(report["texture"], "image:path=two.png");
    assert!(report["inputs"].as_array().unwrap().iter().any(|i| i["name"] == "two.png"));
    let albedo = layer(&folder, "a.exr", "albedo");
    let at = |x: f64, y: f64| albedo[(y * 80.0) as usize * 80 + (x * 80.0) as usize];
    for x in [0.125, 0.625] {
        assert_eq!([at(x, 0.2), at(x + 0.25, 0.2)], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert!((at(x, 0.8)[1] - 0.25).abs() < 2e-3);
    }
    // The shaders show the same.
    for device in ["cpu", "auto"] {
        let line = format!("relight square.tlux {view} --exposure 0 --headless --frames 1 --device {device}");
        folder.run(&format!("{line} --texture two.png --out {device}")).ok();
    }
    let [cpu, auto] = ["cpu", "auto"].map(|d| read_png(&folder.path(&format!("{d}/frame_0000.png"))).unwrap().rgb);
    let differences = cpu.iter().zip(&auto).map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max));
    let mut differences: Vec<f32> = differences.collect();
    differences.sort_unstable_by(f32::total_cmp);
    let mean = differences.iter().sum::<f32>() / differences.len() as f32;
    println!("mean {mean}, 90 % below {}", differences[differences.len() * 9 / 10]);
    assert!(cpu.iter().any(|p| p[0] > 0.1 && p[1] < 0.01), "nothing red");
    assert!(mean < 0.004 && differences[differences.len() * 9 / 10] < 0.01, "{mean}");
}

fn data_uri(kind: &str, bytes: &[u8]) -> String {
    use base64::Engine;
    format!("data:{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// Two squares side by side, 20 mm wide each; the left one has a picture of two by two pixels, the right one a colour.
fn two_squares(base_colour: &serde_json::Value, image: &str) -> String {
    let mut bytes = Vec::new();
    for left in [-0.02f32, 0.0] {
        for (x, y) in [(0.0, 0.01), (0.0, -0.01), (0.02, -0.01), (0.02, 0.01)] {
            [left + x, y, 0.0f32].iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        }
    }
    for uv in [[0.0f32, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]] {
        uv.iter().for_each(|c| bytes.extend(c.to_le_bytes()));
    }
    [0u16, 1, 2, 0, 2, 3].iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    let view =
        |offset: usize, length: usize| serde_json::json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    let accessor = |view: usize, kind: &str, component: u32, count: usize| {
        serde_json::json!({"bufferView": view, "type": kind, "componentType": component, "count": count,
            "min": [-0.02, -0.01, 0.0], "max": [0.02, 0.01, 0.0]})
    };
    let mut accessors = [
        accessor(0, "VEC3", 5126, 4),
        accessor(1, "VEC3", 5126, 4),
        accessor(2, "VEC2", 5126, 4),
        accessor(3, "SCALAR", 5123, 6),
    ];
    for other in &mut accessors[2..] {
        other.as_object_mut().unwrap().retain(|key, _| key != "min" && key != "max");
    }
    let primitive = |position: usize, material: usize| serde_json::json!({"attributes": {"POSITION": position, "TEXCOORD_0": 2}, "indices": 3, "material": material});
    serde_json::json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_texture_transform"],
        "buffers": [{"byteLength": bytes.len(), "uri": data_uri("application/octet-stream", &bytes)}],
        "bufferViews": [view(0, 48), view(48, 48), view(96, 32), view(128, 12)],
        "accessors": accessors,
        "meshes": [{"primitives": [primitive(0, 0), primitive(1, 1)]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "images": [{"uri": image}],
        "textures": [{"source": 0}],
        "materials": [
            {"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1], "baseColorTexture": base_colour}},
            {"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.6, 1]}},
        ],
    })
    .to_string()
}

#[test]
fn base_colours_of_a_model_lie_on_its_materials_in_render_and_relight() {
    let folder = Folder::new();
    let [red, green, blue, white] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0f32; 3]];
    let png = encode_png(2, 2, &[red, green, blue, white], None).unwrap();
    folder.write("four.png", &png);
    let plain = serde_json::json!({"index": 0});
    let shifted = serde_json::json!({"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.0, 0.5], "scale": [1, 1]}}});
    folder.write("plain.gltf", two_squares(&plain, "four.png"));
    folder.write("shifted.gltf", two_squares(&shifted, &data_uri("image/png", &png)));
    folder.run("bake plain.gltf --material marble --method two_pass --samples 200 -o two.tlux -q").ok();
    let view =
        "--camera at=0,0,60:look=0,0,0:fov=18.92 --resolution 160x80 --no-specular --light constant:radiance=1 -q";
    let near = |found: [f32; 3], expected: [f32; 3]| (0..3).all(|c| (found[c] - expected[c]).abs() < 0.03);
    for (file, corners) in [("plain", [red, green, blue, white]), ("shifted", [blue, white, red, green])] {
        folder.run(&format!("render two.tlux {view} --texture {file}.gltf --exr-type float -o {file}.exr")).ok();
        let albedo = layer(&folder, &format!("{file}.exr"), "albedo");
        let at = |x: usize, y: usize| albedo[y * 160 + x];
        for (corner, (x, y)) in corners.iter().zip([(20, 20), (60, 20), (20, 60), (60, 60)]) {
            let [r, g, b] = *corner;
            assert!(near(at(x, y), [0.5 * r, g, b]), "{file} {x} {y}: {:?}", at(x, y));
        }
        assert!((90..150).all(|x| near(at(x, 40), [0.2, 0.4, 0.6])));
        // What is shifted is a picture on a material as well.
        if file == "plain" {
            continue;
        }
        for device in ["cpu", "auto"] {
            let line = format!("relight two.tlux {view} --exposure 0 --headless --frames 1 --device {device}");
            folder.run(&format!("{line} --texture base-colour:path={file}.gltf --out {file}-{device}")).ok();
        }
        let frame = |device: &str| read_png(&folder.path(&format!("{file}-{device}/frame_0000.png"))).unwrap().rgb;
        let (cpu, auto) = (frame("cpu"), frame("auto"));
        let differences = cpu.iter().zip(&auto).flat_map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()));
        let mean = differences.sum::<f32>() / (3 * cpu.len()) as f32;
        assert!(mean < 0.004 && cpu.iter().any(|p| p[1] > 0.05), "{file}: {mean}");
    }
    let turned = serde_json::json!({"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 1.0}}});
    let second = serde_json::json!({"index": 0, "texCoord": 1});
    let jpeg = data_uri("image/jpeg", b"\xff\xd8\xff\xe0");
    for (model, code, says) in [
        (two_squares(&turned, "four.png"), 5, "turned by KHR_texture_transform"),
        (two_squares(&second, "four.png"), 5, "TEXCOORD_0"),
        (two_squares(&serde_json::json!({"index": 7}), "four.png"), 3, "texture 7 does not exist"),
        (two_squares(&plain, &jpeg), 3, "JPEG"),
        (two_squares(&plain, &data_uri("image/gif", b"GIF89a")), 5, "neither PNG, JPEG nor WebP"),
        (two_squares(&plain, "gone.png"), 2, "gone.png"),
        (two_squares(&plain, "../four.png"), 3, "leaves the model's folder"),
        (two_squares(&plain, "four.png").replace("paint", "ink"), 3, "no material \"paint\""),
    ] {
        folder.write("bad.gltf", model);
        folder.run(&format!("render two.tlux {view} --texture bad.gltf -o x.exr")).fails(code, &[says]);
    }
}
