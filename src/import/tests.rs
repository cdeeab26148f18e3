#![allow(clippy::unwrap_used)]

use glam::DVec3;

use super::materials::MaterialChoice;
use super::{ImportOptions, Imported, Source};
use crate::error::{ExitCode, Result};
use crate::geometry::mesh::Scale;
use crate::geometry::parts::Role;
use crate::geometry::shapes::{compose, icosphere};
use crate::geometry::source::SourceModel;
use crate::medium::volume::{Inside, Scattering, Volume, attenuation};
use crate::progress::Silent;

fn wax() -> Volume {
    Volume {
        source: "KHR_materials_scatter",
        // A mean free path of 10 mm in a file in metres.
        attenuation_per_unit: attenuation(DVec3::splat((-1.0f64).exp()), 0.01),
        scattering: Scattering::Albedo { multiple: DVec3::splat(0.8), single: DVec3::splat(0.9) },
        g: 0.0,
        eta_inside_over_outside: 1.44,
        warnings: vec!["its multiscatterColorTexture is not read".to_owned()],
    }
}

/// Spheres of these materials in a row, a quarter of a metre each.
fn model(materials: &[(&str, Inside)]) -> SourceModel {
    let sphere = |(i, (name, _)): (usize, &(&str, Inside))| {
        (icosphere(0.125, 2).of_material(name), DVec3::new(0.3 * i as f64, 0.0, 0.0))
    };
    let spheres: Vec<(SourceModel, DVec3)> = materials.iter().enumerate().map(sphere).collect();
    let insides = materials.iter().map(|(_, inside)| inside.clone()).collect();
    SourceModel { insides, metres_per_unit: Some(1.0), ..compose(&spheres) }
}

fn import(model: SourceModel, texts: &[&str], change: impl FnOnce(&mut ImportOptions)) -> Result<Imported> {
    let texts = texts.iter().map(|&text| text.to_owned()).collect();
    let mut options =
        ImportOptions { materials: MaterialChoice { texts, ..MaterialChoice::default() }, ..ImportOptions::default() };
    change(&mut options);
    Source { model, inputs: Vec::new() }.import(&options, &Silent)
}

fn nothing(_: &mut ImportOptions) {}

#[test]
fn a_file_that_describes_its_media_needs_no_choice() {
    let materials = [("wax", Inside::Volume(wax())), ("wood", Inside::Surface)];
    for (scale, path_mm) in [(None, 10.0), (Some(Scale::MillimetresPerUnit(100.0)), 1.0)] {
        let Imported { scene, origin, warnings, from_file, looks, .. } =
            import(model(&materials), &[], |options| options.scale = scale).unwrap();
        assert_eq!((scene.media.len(), scene.media[0].name.as_str()), (1, "wax"));
        let properties = scene.media[0].properties;
        assert!((properties.sigma_t_per_mm() * path_mm - 1.0).abs().max_element() < 1e-12);
        assert!((properties.sigma_a_per_mm * path_mm - 0.1).abs().max_element() < 1e-12);
        let media: Vec<Option<u32>> = scene.parts.parts.iter().map(|part| part.medium).collect();
        assert_eq!(media, [Some(0), None]);
        assert_eq!(warnings, ["material 'wax': its multiscatterColorTexture is not read"]);
        assert!(from_file[0].chosen.is_some() && from_file[1].chosen.is_none() && looks.is_empty());
        assert_eq!(
            origin.notes[..2],
            [
                "material 'wax': the medium of the file (KHR_materials_scatter)",
                "material 'wood': opaque, of no medium in the file"
            ]
        );
    }
}

#[test]
fn who_names_a_material_wins() {
    let materials = [("wax", Inside::Volume(wax())), ("wood", Inside::Surface), ("glass", Inside::Clear)];
    let named = |texts: &[&str]| import(model(&materials), texts, |options| options.skip = vec!["glass".into()]);
    // One for all is one for all.
    let all = import(model(&materials), &["marble"], nothing).unwrap();
    assert!(all.scene.media.len() == 1 && all.scene.media[0].name == "marble" && all.from_file.is_empty());
    assert!(!all.origin.notes.iter().any(|note| note.contains("of the file")) && all.warnings.is_empty());
    let of_wax = named(&["wax=marble"]).unwrap_err();
    assert!(of_wax.message().contains("no material for wood"), "{of_wax}");
    let of_wood = named(&["wood=marble"]).unwrap();
    let names: Vec<&str> = of_wood.scene.media.iter().map(|medium| medium.name.as_str()).collect();
    assert_eq!(names, ["marble", "wax"]);
    assert!(of_wood.scene.parts.parts.iter().all(|part| part.medium.is_some()));
    let shadow = import(model(&materials), &[], |options| options.opaque = vec!["glass".into(), "wax".into()]);
    assert!(shadow.unwrap_err().message().contains("what is it made of?"));
    // Without insides nothing has changed.
    let plain = import(model(&[("wax", Inside::Surface)]), &[], nothing).unwrap_err();
    assert!(plain.message().starts_with("what is it made of?") && plain.code() == ExitCode::CommandLine);
}

#[test]
fn what_is_missing_or_wrong_says_what_to_type() {
    let thin = Inside::WithoutLength { source: "KHR_materials_diffuse_transmission", colour: DVec3::ONE };
    let wrong = Inside::Invalid("KHR_materials_ior, ior: 9 is not from 0.4 to 3".to_owned());
    for (inside, code, fragments) in [
        (Inside::Clear, ExitCode::CommandLine, ["--skip 'cup'", "--opaque 'cup'"]),
        (thin, ExitCode::CommandLine, ["color = \"#ffffff\" and radius_mm = 10 ", "--material 'cup=wax'"]),
        (wrong, ExitCode::InvalidInput, ["material 'cup'", "ior: 9"]),
    ] {
        let error =
            import(model(&[("wax", Inside::Volume(wax())), ("cup", inside.clone())]), &[], nothing).unwrap_err();
        assert_eq!(error.code(), code, "{error}");
        assert!(fragments.iter().all(|fragment| error.message().contains(fragment)), "{error}");
        // Whoever names it does not care.
        let named =
            import(model(&[("wax", Inside::Volume(wax())), ("cup", inside)]), &["cup=marble"], nothing).unwrap();
        assert_eq!(named.scene.media.len(), 2);
    }
    let thin = Inside::WithoutLength { source: "KHR_materials_diffuse_transmission", colour: DVec3::ONE };
    let both = import(
        model(&[("cup", thin.clone()), ("plate", thin), ("jar", Inside::Clear), ("jug", Inside::Clear)]),
        &[],
        nothing,
    );
    let both = both.unwrap_err();
    for fragment in ["'cup', 'plate'", "--color '#ffffff' --radius-mm 20", "--skip 'jar,jug'"] {
        assert!(both.message().contains(fragment), "{both}");
    }
    let dense = Volume { attenuation_per_unit: DVec3::splat(1e30), ..wax() };
    let error = import(model(&[("wax", Inside::Volume(dense))]), &[], nothing).unwrap_err();
    assert!(error.message().contains("material 'wax'") && error.message().contains("per mm"), "{error}");
}

#[test]
fn sizes_out_of_proportion_are_told() {
    let doubts = |texts: &[&str], scale: Option<Scale>, volume: Volume| {
        let imported = import(model(&[("wax", Inside::Volume(volume))]), texts, |options| options.scale = scale);
        imported.unwrap().warnings.into_iter().filter(|w| w.contains("mm across")).collect::<Vec<_>>()
    };
    assert_eq!(doubts(&["marble"], None, wax()), [""; 0]);
    assert_eq!(doubts(&[], None, wax()), [""; 0]);
    let small = doubts(&["marble"], Some(Scale::MillimetresPerUnit(1.0)), wax());
    assert!(small.len() == 1 && small[0].contains("straight through") && small[0].contains("--unit m"), "{small:?}");
    let large = doubts(&["marble"], Some(Scale::DiagonalMm(1e6)), wax());
    assert!(large.len() == 1 && large[0].contains("--size-mm"), "{large:?}");
    // A medium of the file scales with the model: no unit helps.
    for scale in [None, Some(Scale::DiagonalMm(30.0))] {
        let attenuation_per_unit = DVec3::splat(1e-3);
        let file = doubts(&[], scale, Volume { attenuation_per_unit, ..wax() });
        assert!(file.len() == 1 && file[0].contains("attenuationDistance"), "{file:?}");
    }
}

#[test]
fn roles_follow_the_media() {
    let materials = [("stone", Inside::Surface), ("wax", Inside::Volume(wax()))];
    let imported = import(model(&materials), &[], nothing).unwrap();
    let roles: Vec<Role> = imported.check.parts.iter().map(|part| part.part.role).collect();
    assert_eq!(roles, [Role::Opaque, Role::Medium(0)]);
}
