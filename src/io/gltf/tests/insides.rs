//! What materials say of their inside: closed forms, defaults, exclusions, and what is wrong.

use glam::DVec3;
use serde_json::{Value, json};

use super::super::read_gltf;
use super::{Maker, square};
use crate::geometry::source::SourceModel;
use crate::io::reader_tests::shared_data;
use crate::medium::inversion::Reflector;
use crate::medium::volume::{Inside, Scattering, Volume, single_scattering_albedo};

/// A square of each of these materials.
fn squares(materials: Value) -> Maker {
    let mut maker = square();
    let primitive = maker.json["meshes"][0]["primitives"][0].clone();
    let each = (0..materials.as_array().unwrap().len()).map(|material| {
        let mut primitive = primitive.clone();
        primitive["material"] = json!(material);
        primitive
    });
    maker.json["meshes"][0]["primitives"] = each.collect();
    maker.json["materials"] = materials;
    maker
}

fn read(extensions: Value) -> Inside {
    let mut material = json!({"name": "wax", "extensions": extensions});
    if let Some(surface) = material["extensions"].as_object_mut().unwrap().remove("surface") {
        material["pbrMetallicRoughness"] = surface;
    }
    let model = squares(json!([material])).read().unwrap();
    assert_eq!((model.materials.len(), model.insides.len()), (1, 1));
    model.insides.into_iter().next().unwrap()
}

fn volume(extensions: Value) -> Volume {
    match read(extensions) {
        Inside::Volume(volume) => volume,
        other => panic!("{other:?}"),
    }
}

/// Light falls to exp(-1), exp(-2), exp(-4) over 1 cm.
fn attenuation() -> Value {
    let colour = [1.0f64, 2.0, 4.0].map(|e| (-e).exp());
    json!({"attenuationColor": colour, "attenuationDistance": 0.01, "thicknessFactor": 1})
}

#[test]
fn a_volume_that_scatters_has_the_coefficients_of_the_extension() {
    let multiple = DVec3::new(0.2, 0.5, 0.8);
    let g = 0.5;
    for (extension, key, of_g) in [
        ("KHR_materials_volume_scatter", "multiscatterColor", 0.0),
        ("KHR_materials_volume_scatter", "multiscatterColorFactor", 0.0),
        ("KHR_materials_scatter", "multiscatterColorFactor", g),
    ] {
        let read = volume(json!({
            "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_volume": attenuation(),
            "KHR_materials_ior": {"ior": 1.375},
            extension: {key: multiple.to_array(), "scatterAnisotropy": g},
        }));
        assert_eq!((read.source, read.g, read.eta_inside_over_outside), (extension, g, 1.375));
        assert_eq!(read.warnings, [""; 0]);
        // Colours and distances of this extension are single precision.
        let sigma = DVec3::new(100.0, 200.0, 400.0);
        assert!((read.attenuation_per_unit / sigma - 1.0).abs().max_element() < 1e-6);
        let single = multiple.map(|c| single_scattering_albedo(c, of_g));
        assert_eq!(read.scattering, Scattering::Albedo { multiple, single });
        // Of a model in metres, and of one that is scaled to a twentieth.
        for mm_per_unit in [1000.0, 50.0] {
            let found = read.chosen("wax", mm_per_unit, &Reflector::default()).unwrap().material.properties;
            let sigma_t = read.attenuation_per_unit / mm_per_unit;
            assert!((found.sigma_t_per_mm() / sigma_t - 1.0).abs().max_element() < 1e-12);
            assert!((found.sigma_s_reduced_per_mm / (sigma_t * single * (1.0 - g)) - 1.0).abs().max_element() < 1e-12);
        }
    }
}

#[test]
fn defaults_and_strengths_are_those_of_the_drafts() {
    let with = |scatter: Value| {
        json!({"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": attenuation(),
            "KHR_materials_scatter": scatter})
    };
    let white = volume(with(json!({})));
    assert_eq!((white.g, white.eta_inside_over_outside), (0.0, 1.5));
    assert!(matches!(white.scattering, Scattering::Albedo { multiple: DVec3::ONE, .. }));
    let half = volume(with(json!({"scatterStrengthFactor": 0.5, "multiscatterColorFactor": [1, 0.5, 0]})));
    let expected = DVec3::new(0.5, 0.25, 0.0);
    assert!(matches!(half.scattering, Scattering::Albedo { multiple, .. } if multiple == expected));
    // What does not scatter is clear: no strength, and a multi-scatter albedo of 0, the default of the earlier draft.
    assert_eq!(read(with(json!({"scatterStrengthFactor": 0}))), Inside::Clear);
    let earlier = json!({"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1},
        "KHR_materials_volume": attenuation(), "KHR_materials_volume_scatter": {}});
    assert_eq!(read(earlier), Inside::Clear);
}

#[test]
fn diffuse_transmission_with_a_volume_is_a_colour_and_a_diffusion_length() {
    let read = volume(json!({
        "surface": {"baseColorFactor": [0.8, 0.4, 0.0, 1.0]},
        "KHR_materials_volume": attenuation(),
        "KHR_materials_diffuse_transmission": {
            "diffuseTransmissionFactor": 0.25, "diffuseTransmissionColorFactor": [0.4, 0.8, 1.0]},
    }));
    let Scattering::Colour(colour) = read.scattering else { panic!("{read:?}") };
    // A quarter goes through, three quarters come back.
    assert!((colour - DVec3::new(0.7, 0.5, 0.25)).abs().max_element() < 1e-7, "{colour}");
    assert_eq!((read.g, read.eta_inside_over_outside), (0.0, 1.5));
    let chosen = read.chosen("cup", 1000.0, &Reflector::default()).unwrap();
    let length_mm = chosen.material.properties.diffusion_length_mm();
    assert!((length_mm * DVec3::new(1.0, 2.0, 4.0) / 10.0 - 1.0).abs().max_element() < 1e-5, "{length_mm}");
    // A channel that nothing attenuates goes as far as the clearest other one.
    let read = volume(json!({
        "KHR_materials_volume": {"attenuationColor": [1, 0.5, 0.25], "attenuationDistance": 1, "thicknessFactor": 1},
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1},
    }));
    assert!((read.attenuation_per_unit / DVec3::new(1.0, 1.0, 2.0) - 2f64.ln()).abs().max_element() < 1e-6);
}

#[test]
fn surfaces_glass_and_unknown_lengths_are_told_apart() {
    let clear = json!({"transmissionFactor": 1});
    let scatter = json!({"multiscatterColor": [0.5, 0.5, 0.5]});
    let grey = DVec3::splat(0.5);
    for (extensions, expected) in [
        (json!({}), Inside::Surface),
        (json!({"KHR_materials_clearcoat": {}, "KHR_materials_ior": {"ior": 1.4}}), Inside::Surface),
        (json!({"KHR_materials_volume": attenuation()}), Inside::Surface),
        (json!({"KHR_materials_transmission": {}, "KHR_materials_volume": attenuation()}), Inside::Surface),
        (json!({"KHR_materials_diffuse_transmission": {}}), Inside::Surface),
        (
            json!({"KHR_materials_transmission": {"transmissionFactor": 0}, "KHR_materials_volume": attenuation(),
            "KHR_materials_volume_scatter": scatter}),
            Inside::Surface,
        ),
        (json!({"KHR_materials_transmission": clear}), Inside::Clear),
        (json!({"KHR_materials_transmission": clear, "KHR_materials_volume": attenuation()}), Inside::Clear),
        (
            json!({"KHR_materials_transmission": clear, "KHR_materials_volume": attenuation(),
            "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1}}),
            Inside::Clear,
        ),
        (
            json!({"KHR_materials_transmission": clear, "KHR_materials_volume_scatter": scatter}),
            Inside::WithoutLength { source: "KHR_materials_volume_scatter", colour: grey },
        ),
        (
            json!({"KHR_materials_transmission": clear, "KHR_materials_volume": {}, "KHR_materials_scatter": {}}),
            Inside::WithoutLength { source: "KHR_materials_scatter", colour: DVec3::ONE },
        ),
        (
            json!({"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1}}),
            Inside::WithoutLength { source: "KHR_materials_diffuse_transmission", colour: DVec3::ONE },
        ),
    ] {
        assert_eq!(read(extensions.clone()), expected, "{extensions}");
    }
}

#[test]
fn what_a_medium_cannot_have_is_a_warning() {
    let scatter = json!({"multiscatterColor": [0.5, 0.5, 0.5], "multiscatterColorTexture": {"index": 0}});
    for (transmission, volume_extension, fragments) in [
        (json!({"transmissionFactor": 1}), attenuation(), vec!["multiscatterColorTexture"]),
        (json!({"transmissionFactor": 0.25}), attenuation(), vec!["multiscatterColorTexture", "25 % of the light"]),
        (Value::Null, attenuation(), vec!["multiscatterColorTexture", "by the letter"]),
        (
            json!({"transmissionFactor": 1}),
            json!({"attenuationColor": [0, 0.5, 1], "attenuationDistance": 1}),
            vec!["multiscatterColorTexture", "no finite coefficient", "thicknessFactor is 0", "1 in blue"],
        ),
    ] {
        let mut extensions = json!({"KHR_materials_volume": volume_extension, "KHR_materials_volume_scatter": scatter});
        if !transmission.is_null() {
            extensions["KHR_materials_transmission"] = transmission;
        }
        let warnings = volume(extensions).warnings;
        assert_eq!(warnings.len(), fragments.len(), "{warnings:?}");
        assert!(warnings.iter().zip(&fragments).all(|(w, f)| w.contains(f)), "{warnings:?}");
    }
    let both =
        volume(json!({"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": attenuation(),
        "KHR_materials_volume_scatter": {}, "KHR_materials_scatter": {}}));
    assert!(both.source == "KHR_materials_scatter" && both.warnings[0].contains("exclude"), "{both:?}");
}

#[test]
fn impossible_values_are_named() {
    let usual = |extension: &str, value: Value| {
        let mut extensions = json!({
            "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_volume": attenuation(),
            "KHR_materials_volume_scatter": {"multiscatterColor": [0.5, 0.5, 0.5]},
        });
        extensions[extension] = value;
        extensions
    };
    let (volume, scatter) = ("KHR_materials_volume", "KHR_materials_volume_scatter");
    for (extension, value, fragment) in [
        (volume, json!({"attenuationColor": [0.5, -0.1, 0.5], "attenuationDistance": 1}), "attenuationColor: -0.1"),
        (volume, json!({"attenuationColor": [0.5, 2, 0.5], "attenuationDistance": 1}), "attenuationColor: 2"),
        (volume, json!({"attenuationColor": [0.5, 0.5, 0.5], "attenuationDistance": 0}), "attenuationDistance: 0"),
        (volume, json!({"attenuationColor": [0.5, 0.5, 0.5], "attenuationDistance": -3}), "attenuationDistance: -3"),
        (scatter, json!({"multiscatterColor": [0.5, 0.5]}), "not three numbers"),
        (scatter, json!({"multiscatterColor": "white"}), "not three numbers"),
        (scatter, json!({"multiscatterColor": [0.5, 0.5, 1.01]}), "multiscatterColor: 1.01"),
        (scatter, json!({"multiscatterColor": [0.5, 0.5, null]}), "not three numbers"),
        (scatter, json!({"scatterAnisotropy": 1}), "scatterAnisotropy: 1 is not above -1 and below 1"),
        (scatter, json!({"scatterAnisotropy": "much"}), "is no number"),
        (scatter, json!({"scatterStrengthFactor": 2}), "scatterStrengthFactor: 2"),
        ("KHR_materials_ior", json!({"ior": 0}), "ior: 0"),
        ("KHR_materials_ior", json!({"ior": 9}), "ior: 9"),
        ("KHR_materials_transmission", json!({"transmissionFactor": -1}), "transmissionFactor: -1"),
        ("KHR_materials_diffuse_transmission", json!({"diffuseTransmissionFactor": 1.5}), "1.5 is not in [0, 1]"),
    ] {
        let Inside::Invalid(why) = read(usual(extension, value.clone())) else { panic!("{extension} {value}") };
        assert!(why.contains(fragment) && why.contains(extension), "{why}");
    }
}

#[test]
fn materials_of_one_name_are_told_and_what_differs_inside_is_no_medium() {
    let scatter = |colour: f64| {
        json!({"name": "wax", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_volume": attenuation(), "KHR_materials_volume_scatter": {"multiscatterColor": [colour, 0.5, 0.5]}}})
    };
    let same: SourceModel = squares(json!([scatter(0.5), scatter(0.5)])).read().unwrap();
    assert_eq!((same.materials.len(), same.warnings.len()), (1, 0));
    assert!(matches!(same.insides[0], Inside::Volume(_)));
    let mut rough = scatter(0.5);
    rough["pbrMetallicRoughness"] = json!({"roughnessFactor": 0.5});
    let surface = squares(json!([scatter(0.5), rough])).read().unwrap();
    assert!(surface.warnings[0].contains(r#"["wax"]"#), "{:?}", surface.warnings);
    assert!(matches!(surface.insides[0], Inside::Volume(_)));
    let other = squares(json!([scatter(0.5), scatter(0.6), {"name": "stone"}])).read().unwrap();
    assert_eq!((other.materials.as_slice(), other.warnings.len()), (["wax", "stone"].map(String::from).as_slice(), 1));
    let Inside::Invalid(why) = &other.insides[0] else { panic!("{:?}", other.insides) };
    assert!(why.contains("differ inside") && other.insides[1] == Inside::Surface, "{why}");
}

#[test]
fn what_is_not_used_is_named_once() {
    let texture = json!({"index": 0});
    let mut maker = squares(json!([
        {"normalTexture": texture, "extensions": {"KHR_materials_sheen": {}, "KHR_materials_volume_scatter": {}}},
        {"normalTexture": texture, "emissiveFactor": [1, 0, 0], "alphaMode": "MASK", "extensions": {"KHR_materials_sheen": {}}},
        {"name": "plain", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0}},
    ]));
    maker.json["textures"] = json!([{"source": 0}]);
    maker.json["images"] = json!([{"uri": "a.png"}]);
    let warnings = maker.read().unwrap().warnings;
    assert_eq!(
        warnings,
        ["of the materials these are not used: alphaMode, emission, normalTexture, KHR_materials_sheen"],
    );
}

#[test]
fn real_files_have_the_insides_that_they_are_made_for() {
    let Some(data) = shared_data("gltf") else { return };
    // Two files have their JSON alone: its materials are put on a square.
    let of_json = |name: &str| {
        let bytes = std::fs::read(data.join("json_only").join(name)).unwrap();
        let json: Value = serde_json::from_slice(&bytes).unwrap();
        let mut maker = squares(json["materials"].clone());
        maker.json["textures"] = json["textures"].clone();
        maker.json["images"] = json["images"].clone();
        maker.json["samplers"] = json!(vec![json!({}); 6]);
        maker.read().unwrap()
    };
    let skull = of_json("ScatteringSkull.gltf");
    let Inside::Volume(skull) = &skull.insides[0] else { panic!("{:?}", skull.insides) };
    // Its attenuation distance is the mean free path of red.
    assert!((1e3 / skull.attenuation_per_unit.x - 16.891_85).abs() < 1e-4, "{skull:?}");
    assert!((skull.eta_inside_over_outside - 1.38).abs() < 1e-6 && skull.warnings.is_empty());
    let cup = of_json("DiffuseTransmissionTeacup.gltf");
    let is_thin = |inside: &Inside| matches!(inside, Inside::WithoutLength { .. });
    assert!(cup.insides.len() == 2 && cup.insides.iter().all(is_thin), "{:?}", cup.insides);
    let glass = read_gltf(&data.join("AttenuationTest.glb")).unwrap();
    assert!(glass.insides.contains(&Inside::Clear) && !glass.insides.iter().any(|i| matches!(i, Inside::Volume(_))));
}
