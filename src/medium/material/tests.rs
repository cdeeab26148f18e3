#![allow(clippy::unwrap_used)]

use super::*;
use crate::error::ExitCode;
use crate::math::srgb::linear_from_hex;
use crate::medium::inversion::{Radius, Reflector};
use crate::medium::look::Look;
use crate::medium::material_file::{Chosen, parse};

fn from_argument(argument: &str) -> Result<Material> {
    Chosen::from_argument(argument, &Reflector::default()).map(|chosen| chosen.material)
}

fn from_flags(base: Option<Material>, overrides: &Overrides) -> Result<Material> {
    let chosen = Chosen::from_flags(base.map(Chosen::from), overrides, &Look::default(), &Reflector::default());
    chosen.map(|chosen| chosen.material)
}

#[test]
fn totals_of_the_measured_materials_are_the_published_ones() {
    for preset in &PRESETS {
        let totals = preset.properties().validated().unwrap().total_reflectance(BoundaryFit::Published);
        let PresetOrigin::Measured { published_reflectance } = preset.origin else { panic!("{}", preset.name) };
        for (channel, (found, published)) in totals.iter().zip(published_reflectance).enumerate() {
            if (preset.name, channel) == ("chicken1", 2) {
                assert!((found - 0.126).abs() < 5e-4);
                continue;
            }
            assert!((found - published).abs() <= 0.01, "{} {channel}: {found} {published}", preset.name);
        }
    }
}

#[test]
fn materials_by_eye_have_their_colours() {
    for preset in &BY_EYE {
        let PresetOrigin::ByEye { colour } = preset.origin else { panic!("{}", preset.name) };
        let code = |colour: DVec3| 255.0 * colour.map(crate::math::srgb::srgb_from_linear);
        let found = Reflector::default().colour(&preset.properties().validated().unwrap()).unwrap();
        let off = code(found) - code(linear_from_hex(colour).unwrap());
        assert!(off.abs().max_element() < 0.2, "{}: {off}", preset.name);
    }
}

#[test]
fn exact_boundary_moves_the_totals_little() {
    for preset in &PRESETS {
        let properties = preset.properties();
        let [fit, exact] = [BoundaryFit::Published, BoundaryFit::Exact].map(|fit| properties.total_reflectance(fit));
        for (a, b) in fit.iter().zip(exact) {
            assert!((a - b).abs() < 2e-3, "{}", preset.name);
        }
    }
}

#[test]
fn presets_are_found_by_name_in_any_case() {
    assert_eq!(preset("marble").unwrap().eta_inside_over_outside, 1.5);
    assert_eq!(preset("Skin1").unwrap().sigma_a_per_mm, [0.032, 0.17, 0.48]);
    assert!(preset("granite").is_none());
    let mut names: Vec<&str> = presets().map(|preset| preset.name).collect();
    assert!(PRESETS.is_sorted_by_key(|preset| preset.name) && BY_EYE.is_sorted_by_key(|preset| preset.name));
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), 18);
    for each in presets() {
        assert_eq!(from_argument(each.name).unwrap(), each.material());
    }
}

#[test]
fn unknown_names_suggest_the_near_ones() {
    let message = |name: &str| {
        let error = from_argument(name).unwrap_err();
        assert_eq!(error.code(), ExitCode::CommandLine);
        error.message().to_owned()
    };
    assert!(message("marbel").ends_with("did you mean marble?"));
    assert!(message("skin").ends_with("did you mean skin1 or skin2?"));
    assert!(message("milk").contains("skimmilk or wholemilk"));
    assert!(message("granite").contains("apple, chicken1") && message("granite").contains(".toml"));
    assert!(message("").contains("apple"));
    assert!(message("é").contains("apple"));
}

#[test]
fn edit_distance_counts_edits() {
    for (a, b, distance) in [("", "", 0), ("", "abc", 3), ("kitten", "sitting", 3), ("marble", "marble", 0)] {
        assert_eq!(edit_distance(a, b), distance);
        assert_eq!(edit_distance(b, a), distance);
    }
}

#[test]
fn derived_quantities_follow_their_definitions() {
    let p = Overrides {
        sigma_s_per_mm: Some(DVec3::new(2.0, 4.0, 0.0)),
        sigma_a_per_mm: Some(DVec3::new(0.5, 0.0, 0.0)),
        g: Some(0.75),
        ..Overrides::default()
    }
    .apply(None)
    .unwrap();
    assert_eq!(p.eta_inside_over_outside, DEFAULT_ETA);
    assert_eq!(p.sigma_s_reduced_per_mm, DVec3::new(0.5, 1.0, 0.0));
    assert_eq!(p.sigma_s_per_mm(), DVec3::new(2.0, 4.0, 0.0));
    assert_eq!(p.sigma_t_per_mm(), DVec3::new(2.5, 4.0, 0.0));
    assert_eq!(p.sigma_t_reduced_per_mm(), DVec3::new(1.0, 1.0, 0.0));
    assert_eq!(p.mean_free_path_mm(), DVec3::new(1.0, 1.0, f64::INFINITY));
    assert!((p.sigma_tr_per_mm() - DVec3::new(1.5_f64.sqrt(), 0.0, 0.0)).length() < 1e-15);
    assert_eq!((p.diffusion_length_mm().y, p.diffusion_length_mm().z), (f64::INFINITY, f64::INFINITY));
    assert_eq!(p.total_reflectance(BoundaryFit::Published)[1..], [1.0, 0.0]);
    for (dipole, tr) in p.dipoles(BoundaryFit::Exact).iter().zip(p.sigma_tr_per_mm().to_array()) {
        assert!((dipole.sigma_tr_per_mm - tr).abs() < 1e-15);
    }
}

#[test]
fn a_change_of_g_keeps_the_reduced_scattering() {
    let marble = preset("marble").unwrap().material();
    let changed = from_flags(Some(marble.clone()), &Overrides { g: Some(0.8), ..Overrides::default() }).unwrap();
    assert_eq!(changed.properties.sigma_s_reduced_per_mm, marble.properties.sigma_s_reduced_per_mm);
    assert!((changed.properties.sigma_s_per_mm().x - 2.19 / 0.2).abs() < 1e-12);
    assert_eq!(changed.name, "marble*");
    assert_eq!(from_flags(Some(marble.clone()), &Overrides::default()).unwrap(), marble);
    // --sigma-s on top of it is unreduced with the resulting g.
    let both = Overrides { g: Some(0.5), sigma_s_per_mm: Some(DVec3::ONE), ..Overrides::default() };
    let changed = from_flags(Some(marble), &both).unwrap();
    assert_eq!(changed.properties.sigma_s_reduced_per_mm, DVec3::splat(0.5));
}

#[test]
fn flags_alone_need_scattering_and_absorption() {
    let error = |overrides: Overrides| {
        let error = from_flags(None, &overrides).unwrap_err();
        assert_eq!(error.code(), ExitCode::CommandLine);
        error.message().to_owned()
    };
    assert!(error(Overrides::default()).contains("sigma_s is missing"));
    let scattering = Overrides { sigma_s_per_mm: Some(DVec3::ONE), ..Overrides::default() };
    assert!(error(scattering).contains("sigma_a is missing"));
    let whole = Overrides { sigma_a_per_mm: Some(DVec3::ZERO), ..scattering };
    assert_eq!(from_flags(None, &whole).unwrap().name, "custom");
    assert!(error(Overrides { sigma_s_reduced_per_mm: Some(DVec3::ONE), ..whole }).contains("both"));
}

#[test]
fn properties_out_of_range_are_refused() {
    let good = preset("skin1").unwrap().properties();
    for bad in [f64::NAN, f64::INFINITY, -1e-9, 2e6] {
        let mut p = good;
        p.sigma_s_reduced_per_mm.y = bad;
        assert!(p.validated().unwrap_err().message().contains("sigma_s' of the green channel"));
        let mut p = good;
        p.sigma_a_per_mm.z = bad;
        assert!(p.validated().unwrap_err().message().contains("sigma_a of the blue channel"));
    }
    for g in [1.0, -1.0, 1.5, f64::NAN] {
        assert!(OpticalProperties { g, ..good }.validated().unwrap_err().message().contains("g is"));
    }
    for eta in [0.0, 0.39, 3.01, -1.3, f64::NAN, f64::INFINITY] {
        let p = OpticalProperties { eta_inside_over_outside: eta, ..good };
        assert!(p.validated().unwrap_err().message().contains("eta is"));
    }
    for (g, eta) in [(0.999, 0.4), (-0.999, 3.0), (0.0, 1.0)] {
        assert!(OpticalProperties { g, eta_inside_over_outside: eta, ..good }.validated().is_ok());
    }
    let nothing = OpticalProperties { sigma_s_reduced_per_mm: DVec3::ZERO, sigma_a_per_mm: DVec3::ZERO, ..good };
    assert_eq!(nothing.validated().unwrap().total_reflectance(BoundaryFit::Published)[0], 0.0);
}

#[test]
fn material_files_are_read_in_all_their_forms() {
    let read = |text: &str| parse(text, ("m.toml", "custom"), &Reflector::default()).unwrap().material;
    let reduced = read("name = \"wax\"\nsigma_s_reduced_per_mm = [1.0, 2, 3.0]\nsigma_a_per_mm = 0.01\neta = 1.44\n");
    assert_eq!(reduced.name, "wax");
    assert_eq!(reduced.properties.sigma_s_reduced_per_mm, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(reduced.properties.sigma_a_per_mm, DVec3::splat(0.01));
    assert_eq!((reduced.properties.g, reduced.properties.eta_inside_over_outside), (0.0, 1.44));
    let unreduced = read("sigma_s_per_mm = 10\ng = 0.9\nsigma_a_per_mm = [0, 0, 0]");
    assert!((unreduced.properties.sigma_s_reduced_per_mm.x - 1.0).abs() < 1e-12);
    assert_eq!((unreduced.name.as_str(), unreduced.properties.eta_inside_over_outside), ("custom", DEFAULT_ETA));
    let marble = read("preset = \"marble\"");
    assert_eq!(marble.properties, preset("marble").unwrap().properties());
    let tinted = read("preset = \"marble\"\nsigma_a_per_mm = [0.1, 0.2, 0.3]\ng = 0.5");
    assert_eq!(tinted.properties.sigma_s_reduced_per_mm, marble.properties.sigma_s_reduced_per_mm);
    assert_eq!(tinted.properties.sigma_a_per_mm, DVec3::new(0.1, 0.2, 0.3));
    assert_eq!(tinted.properties.eta_inside_over_outside, 1.5);
}

#[test]
fn material_files_may_give_a_look() {
    let read = |text: &str| parse(text, ("m.toml", "custom"), &Reflector::default()).unwrap();
    let rose = read("color = \"#e8c4b0\"\nradius_mm = 1.2\nradius_convention = \"diffusion\"\neta = 1.4");
    let look = rose.look.unwrap();
    assert_eq!((look.target.radius, look.target.radius_mm), (Radius::DiffusionLength, DVec3::splat(1.2)));
    assert_eq!(look.target.eta_inside_over_outside, 1.4);
    assert!(look.inversion.is_reached() && look.inversion.properties == rose.material.properties);
    assert!((rose.material.properties.diffusion_length_mm() / 1.2 - 1.0).abs().max_element() < 1e-9);
    let linear = read("color = [0.5, 0.25, 1]\nradius_mm = [1, 0.5, 2.0]").look.unwrap();
    assert_eq!((linear.target.colour, linear.target.radius), (DVec3::new(0.5, 0.25, 1.0), Radius::MeanFreePath));
    assert!(!linear.inversion.is_reached() && linear.inversion.gap().z < -0.05);
    let tinted = read("preset = \"marble\"\ncolor = 0.5").material.properties;
    let marble = preset("marble").unwrap().properties();
    assert!((tinted.mean_free_path_mm() / marble.mean_free_path_mm() - 1.0).abs().max_element() < 1e-12);
    // A flag on top of a file's look is another look.
    let flags = |look: Look, overrides: Overrides| {
        Chosen::from_flags(Some(rose.clone()), &overrides, &look, &Reflector::default()).unwrap()
    };
    assert_eq!(flags(Look::default(), Overrides::default()), rose);
    let longer = flags(Look { radius_mm: Some(DVec3::splat(2.0)), ..Look::default() }, Overrides::default());
    assert_eq!((longer.material.name.as_str(), longer.look.unwrap().target.radius), ("custom*", Radius::MeanFreePath));
    assert!((longer.look.unwrap().inversion.achieved - look.inversion.achieved).abs().max_element() < 1e-6);
    let plain = flags(Look::default(), Overrides { eta_inside_over_outside: Some(1.2), ..Overrides::default() });
    assert_eq!((plain.material.name.as_str(), plain.look), ("custom*", None));
}

/// The page of materials has examples that are read, and every key in one of them.
#[test]
fn examples_of_the_page_are_read_and_have_every_key() {
    let page = include_str!("../../../docs/materials.md");
    let blocks: Vec<&str> = page.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert_eq!(blocks.len(), 3);
    for block in &blocks {
        let chosen = parse(block, ("materials.md", "custom"), &Reflector::default()).unwrap();
        assert!(chosen.look.is_none_or(|look| look.inversion.is_reached()), "{block}");
    }
    // The keys of the page are those that an error lists.
    let unknown = parse("key = 1", ("m.toml", "custom"), &Reflector::default()).unwrap_err();
    let keys: Vec<&str> = unknown.message().split('`').skip(3).step_by(2).collect();
    assert_eq!(keys.len(), 10, "{unknown}");
    for key in keys {
        assert!(page.contains(&format!("\n| `{key}` |")), "{key} is not in the table");
        assert!(
            blocks
                .iter()
                .any(|block| block.contains(&format!("\n{key} = ")) || block.starts_with(&format!("{key} = "))),
            "{key}"
        );
    }
    for radius in Radius::ALL {
        assert!(page.contains(&format!("\n| `{}`", radius.word())), "{radius:?}");
    }
}

#[test]
fn material_files_that_are_wrong_say_where_and_what() {
    for (text, expected) in [
        ("preset = \"marble\"\nsigma_a = 3\n", &["m.toml:2:1: ", "sigma_a", "sigma_a_per_mm"][..]),
        ("preset = \"marbel\"", &["m.toml:1:10: ", "did you mean marble"]),
        ("preset = \"marble\"\n\n  eta = 0.1", &["m.toml:3:9: ", "eta is 0.1"]),
        ("preset = \"marble\"\ng = 1", &["m.toml:2:5: ", "g is 1"]),
        ("preset = \"marble\"\nsigma_a_per_mm = [0, -1, 0]", &["m.toml:2:18: ", "sigma_a of the green channel is -1"]),
        ("preset = \"marble\"\nsigma_a_per_mm = nan", &["m.toml:2:18: ", "sigma_a of the red channel is NaN"]),
        ("preset = \"marble\"\nsigma_a_per_mm = [0, 1]", &["m.toml:2:18: ", "one number or [red, green, blue]"]),
        ("preset = \"marble\"\nsigma_a_per_mm = [0, 1, 2, 3]", &["m.toml:2:18: ", "one number or [red, green, blue]"]),
        ("preset = \"marble\"\nsigma_a_per_mm = \"much\"", &["m.toml:2:18: ", "one number or [red, green, blue]"]),
        ("preset = \"marble\"\nsigma_a_per_mm = [0, [1], 2]", &["m.toml:2:"]),
        ("sigma_a_per_mm = 1", &["m.toml: ", "sigma_s is missing"]),
        ("sigma_s_per_mm = 1", &["m.toml: ", "sigma_a is missing"]),
        ("", &["m.toml: ", "missing"]),
        ("sigma_s_per_mm = 1\nsigma_s_reduced_per_mm = 1\nsigma_a_per_mm = 1", &["m.toml:1:18: ", "give one of them"]),
        ("g = 0\ng = 0", &["m.toml:2:", "duplicate key"]),
        ("eta == 2", &["m.toml:1:"]),
        ("[material]\ng = 0", &["m.toml:1:", "material"]),
        ("name = 3", &["m.toml:1:8: ", "string"]),
        ("radius_mm = 1\ncolor = \"rose\"", &["m.toml:2:9: ", "rose", "#e8c4b0"]),
        ("radius_mm = 1\ncolor = [0, 2, 0]", &["m.toml:2:9: ", "between 0 and 1"]),
        ("color = 0.5\nradius_mm = [1, 0, 1]", &["m.toml:2:13: ", "green channel is 0 mm"]),
        ("color = 0.5\nradius_mm = 1\nradius_convention = \"mm\"", &["m.toml:3:21: ", "mfp, diffusion"]),
        ("\ncolor = 0.5", &["m.toml:2:9: ", "a colour without a radius"]),
        ("radius_convention = \"mfp\"", &["m.toml:1:21: ", "neither a radius nor a colour"]),
        ("color = 0.5\nradius_mm = 1\nsigma_a_per_mm = 1", &["m.toml:1:9: ", "give one of them"]),
    ] {
        let error = parse(text, ("m.toml", "custom"), &Reflector::default()).unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput, "{text}");
        for part in expected {
            assert!(error.message().contains(part), "{text:?}: {}", error.message());
        }
        assert!(!error.message().contains('\n'), "{}", error.message());
    }
}

#[test]
fn material_files_cut_anywhere_never_panic() {
    let text = "name = \"wäx\"\npreset = \"marble\"\nsigma_s_per_mm = [1.0, 2e3, 0x1]\ng = 0.5\neta = 1.3\n";
    for end in (0..=text.len()).filter(|end| text.is_char_boundary(*end)) {
        if let Err(error) = parse(&text[..end], ("m.toml", "custom"), &Reflector::default()) {
            assert_eq!(error.code(), ExitCode::InvalidInput);
        }
    }
}

#[test]
fn arguments_that_end_in_toml_are_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("candle wax.TOML");
    std::fs::write(&path, "preset = \"cream\"\ng = 0.1").unwrap();
    let material = from_argument(path.to_str().unwrap()).unwrap();
    assert_eq!((material.name.as_str(), material.properties.g), ("candle wax", 0.1));
    let missing = from_argument("no/such/file.toml").unwrap_err();
    assert_eq!(missing.code(), ExitCode::Io);
    assert!(missing.message().starts_with("no/such/file.toml: "));
    for bytes in [vec![0xff, 0xfe], vec![b'#'; (1 << 20) + 1]] {
        std::fs::write(&path, bytes).unwrap();
        let error = from_argument(path.to_str().unwrap()).unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput);
        assert!(error.message().contains("candle wax.TOML: "));
    }
    assert_eq!(Chosen::from_file(folder.path(), &Reflector::default()).unwrap_err().code(), ExitCode::Io);
}

#[test]
fn g_is_blamed_for_the_scattering_that_it_spoils() {
    let overrides = Overrides {
        sigma_s_per_mm: Some(DVec3::ONE),
        sigma_a_per_mm: Some(DVec3::ONE),
        g: Some(1.5),
        ..Overrides::default()
    };
    assert!(from_flags(None, &overrides).unwrap_err().message().starts_with("g is 1.5"));
}
