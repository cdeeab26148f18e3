#![allow(clippy::unwrap_used)]

use super::*;
use crate::error::ExitCode;
use crate::medium::fresnel::{BoundaryFit, boundary_a};
use crate::medium::material::{PRESETS, preset};
use crate::medium::profiles::layer_file::LayerSpec;
use crate::medium::profiles::model::ProfileModel;

fn loaded(text: &str) -> Reflector {
    ProfileModel::parse(text).unwrap().load().unwrap().into()
}

fn skin() -> OpticalProperties {
    preset("skin1").unwrap().properties()
}

/// The medium below a coat with properties of its own.
fn coated() -> Reflector {
    let coat = LayerSpec { thickness_mm: Some(0.2), properties: Some(skin()) };
    LoadedProfile::Layers(vec![coat, LayerSpec { thickness_mm: None, properties: None }]).into()
}

/// Profiles that are quick enough for many colours.
fn closed() -> Vec<(&'static str, Reflector)> {
    ["dipole", "better-dipole", "burley", "burley:fit=diffuse", "burley:fit=dmfp"].map(|t| (t, loaded(t))).into()
}

fn tabulated() -> Vec<(&'static str, Reflector)> {
    let mut all: Vec<_> = ["photon-beam", "slab:thickness=1.5"].map(|t| (t, loaded(t))).into();
    all.push(("layers", coated()));
    all.push(("volume", Reflector::Volume));
    all
}

fn assert_same(found: &OpticalProperties, medium: &OpticalProperties, what: &str) {
    let scale = medium.sigma_t_reduced_per_mm();
    for (a, b) in
        [(found.sigma_s_reduced_per_mm, medium.sigma_s_reduced_per_mm), (found.sigma_a_per_mm, medium.sigma_a_per_mm)]
    {
        // A total of 1e-10 less is another 1e-6 of a small absorption, or of a small scattering below a bright coat.
        let off = (a - b).abs() / (b + 1e-4 * scale);
        assert!(off.max_element() < 1e-5, "{what}: {found:?} for {medium:?}");
    }
    assert_eq!((found.g, found.eta_inside_over_outside), (medium.g, medium.eta_inside_over_outside));
}

#[test]
fn presets_come_back_from_their_colour_and_any_length() {
    let few = |name: &str| ["marble", "ketchup", "spectralon"].contains(&name);
    for (name, profile) in closed().into_iter().chain(tabulated()) {
        let is_quick = !matches!(name, "photon-beam" | "slab:thickness=1.5" | "layers" | "volume");
        for (turn, preset) in PRESETS.iter().filter(|p| is_quick || few(p.name)).enumerate() {
            let medium = preset.properties();
            let colour = profile.colour(&medium).unwrap();
            // What is slow has every length with one of these materials at least.
            let with = |index: usize| is_quick || index % 3 == turn;
            for radius in Radius::ALL.into_iter().enumerate().filter(|(index, _)| with(*index)).map(|(_, r)| r) {
                // Without absorption there is no diffusion length.
                if radius == Radius::DiffusionLength && medium.sigma_a_per_mm.min_element() == 0.0 {
                    continue;
                }
                let what = format!("{name} {} {}", preset.name, radius.name());
                let found = invert(&profile, &Target::of_medium(&medium, radius, colour, colour)).unwrap();
                assert!(found.is_reached(), "{what}: {}", found.gap());
                assert_same(&found.properties, &medium, &what);
            }
        }
    }
}

/// Asserts that the achieved colour is the medium's own total, reached where possible, otherwise the nearest.
fn assert_nearest(profile: &Reflector, target: &Target, what: &str) {
    let found = invert(profile, target).unwrap();
    let properties = found.properties.validated().unwrap();
    assert_eq!(profile.colour(&properties).unwrap(), found.achieved, "{what}");
    let extinction = properties.sigma_t_reduced_per_mm();
    let most = DVec3::splat(LARGEST_SIGMA_PER_MM);
    // What the albedo does not change, in units of a mean free path.
    let length = match target.radius {
        Radius::MeanFreePath => Some(DVec3::ONE),
        Radius::Cycles => Some(DVec3::splat(4.0 * PI)),
        Radius::Burley => Some(1.0 / shape(target.colour, target.eta_inside_over_outside)),
        Radius::OpenPbr => Some(extinction / properties.sigma_t_per_mm()),
        Radius::DiffusionLength => None,
    };
    if let Some(length) = length {
        let expected = (length / target.radius_mm).min(most);
        assert!((extinction / expected - 1.0).abs().max_element() < 1e-12, "{what}");
    }
    // Rounded sums may be a digit above what is accepted.
    let extinction = extinction.min(most);
    let at = |s: DVec3, a: DVec3| {
        profile.colour(&OpticalProperties { sigma_s_reduced_per_mm: s, sigma_a_per_mm: a, ..properties }).unwrap()
    };
    let (dark, bright) = match target.radius {
        // The thickness of a slab in mean free paths is not what it is at the ends of the search.
        Radius::OpenPbr => {
            let long = (1.0 - target.g) / target.radius_mm;
            (at(DVec3::ZERO, (1.0 / target.radius_mm).min(most)), at(long.min(most), DVec3::ZERO))
        }
        Radius::MeanFreePath | Radius::Cycles | Radius::Burley => {
            (at(DVec3::ZERO, extinction), at(extinction, DVec3::ZERO))
        }
        Radius::DiffusionLength => {
            // sigma_tr = sqrt(3) sigma_a without scattering; with all the extinction that is accepted, 1 = 3 sigma_a sigma_t' d^2.
            let absorption = (3.0 * target.radius_mm * target.radius_mm * most).recip().min(most);
            let dark = (3f64.sqrt() * target.radius_mm).recip().min(most);
            (at(DVec3::ZERO, dark), at(most - absorption, absorption))
        }
    };
    for i in 0..3 {
        let [asked, achieved, dark, bright] = [target.colour, found.achieved, dark, bright].map(|v| v.to_array()[i]);
        let nearest = asked.clamp(dark, bright.max(dark));
        assert!((achieved - nearest).abs() < 2e-9, "{what}: {achieved} for {asked}, between {dark} and {bright}");
        assert!((found.gap().to_array()[i] - (achieved - asked)).abs() == 0.0);
    }
    assert_eq!(found.is_reached(), found.gap().abs().max_element() <= REACHED);
}

const COLOURS: [[f64; 3]; 5] =
    [[0.0, 1e-7, 1e-3], [0.01, 0.1, 0.25], [0.5, 0.75, 0.9], [0.94, 0.99, 0.9999], [1.0, 1.5, -0.5]];

#[test]
fn every_colour_at_every_length_is_reached_or_the_nearest() {
    for (name, profile) in closed() {
        for colour in COLOURS {
            for radius_mm in [1e-6, 1e-3, 0.3, 20.0, 1e6] {
                for (eta_inside_over_outside, radius) in
                    [0.8, 1.0, 1.3, 2.0].into_iter().flat_map(|eta| Radius::ALL.map(|radius| (eta, radius)))
                {
                    let radius_mm = DVec3::splat(radius_mm);
                    let colour = DVec3::from_array(colour);
                    let target = Target { colour, radius, radius_mm, g: 0.3, eta_inside_over_outside };
                    assert_nearest(&profile, &target, &format!("{name} {target:?}"));
                }
            }
        }
    }
}

#[test]
fn tables_reach_every_colour_or_the_nearest() {
    for (name, profile) in tabulated() {
        for (turn, colour) in COLOURS.into_iter().step_by(2).enumerate() {
            // Every length with every other colour.
            for radius in Radius::ALL.into_iter().skip(turn % 2).step_by(2) {
                let (colour, radius_mm) = (DVec3::from_array(colour), DVec3::new(0.1, 0.7, 3.0));
                let target = Target { colour, radius, radius_mm, g: 0.0, eta_inside_over_outside: 1.3 };
                assert_nearest(&profile, &target, &format!("{name} {target:?}"));
            }
        }
    }
}

/// Jensen and Buhler (2002): R = alpha' / 2 (1 + exp(-4/3 A r)) exp(-r), r = sqrt(3 (1 - alpha')).
#[test]
fn albedos_of_the_dipole_are_those_of_its_closed_form() {
    let a = boundary_a(1.4, BoundaryFit::Published);
    for albedo in [0.02, 0.3, 0.7, 0.95, 0.999, 0.999_999] {
        let root = (3.0_f64 * (1.0 - albedo)).sqrt();
        let total = 0.5 * albedo * (1.0 + (-4.0 / 3.0 * a * root).exp()) * (-root).exp();
        for radius in Radius::ALL {
            let colour = DVec3::splat(diffuse_transmittance(1.4) * total);
            let radius_mm = DVec3::new(0.1, 1.0, 9.0);
            let target = Target { colour, radius, radius_mm, g: 0.4, eta_inside_over_outside: 1.4 };
            let medium = invert(&Reflector::default(), &target).unwrap().properties;
            let off = medium.sigma_a_per_mm / medium.sigma_t_reduced_per_mm() / (1.0 - albedo) - 1.0;
            assert!(off.abs().max_element() < 1e-6, "{albedo} {off}");
            let off = radius.of_medium_mm(&medium, colour) / radius_mm - 1.0;
            assert!(off.abs().max_element() < 1e-12, "{albedo} {off}");
        }
    }
}

#[test]
fn a_photon_beam_says_how_far_it_stays_from_white() {
    // As white as what enters.
    let all = DVec3::splat(diffuse_transmittance(1.3));
    let white = Target::of_medium(&skin(), Radius::MeanFreePath, all, all);
    let found = invert(&loaded("photon-beam"), &white).unwrap();
    assert!(!found.is_reached());
    assert!(found.gap().max_element() < -0.03 && found.gap().min_element() > -0.08, "{}", found.gap());
    assert_eq!(found.properties.sigma_a_per_mm, DVec3::ZERO);
    assert!(invert(&loaded("dipole"), &white).unwrap().is_reached());
    // What the boundary reflects on the way in is a highlight, no colour.
    let whiter = Target { colour: DVec3::ONE, ..white };
    let gap = invert(&loaded("dipole"), &whiter).unwrap().gap();
    assert!((gap - (all - 1.0)).abs().max_element() < 1e-9 && gap.x < -0.05, "{gap}");
}

/// Walks and dipoles differ where light is absorbed: what the dipole needs for a colour is another medium.
#[test]
fn a_colour_by_walks_is_another_medium_than_by_the_dipole() {
    let target = Target {
        colour: DVec3::new(0.8, 0.5, 0.2),
        radius: Radius::MeanFreePath,
        radius_mm: DVec3::ONE,
        g: 0.0,
        eta_inside_over_outside: 1.3,
    };
    let [by_dipole, by_walks] = [Reflector::default(), Reflector::Volume].map(|r| invert(&r, &target).unwrap());
    assert!(by_dipole.is_reached() && by_walks.is_reached());
    let seen = Reflector::Volume.colour(&by_dipole.properties).unwrap() / target.colour;
    // 2 % too bright at a colour of 0.8, 5 % at 0.5.
    assert!((seen - 1.0).abs().max_element() > 0.03 && (seen - 1.0).abs().max_element() < 0.1, "{seen}");
}

#[test]
fn conventions_are_read_by_their_words() {
    for radius in Radius::ALL {
        assert_eq!(radius.word().parse::<Radius>().unwrap(), radius);
    }
    assert!("mm".parse::<Radius>().unwrap_err().message().contains("mfp, diffusion, cycles, burley, openpbr"));
}

#[test]
fn what_has_no_answer_is_refused() {
    let medium = skin();
    let good = Target::of_medium(&medium, Radius::MeanFreePath, DVec3::splat(0.5), DVec3::splat(0.5));
    let coat = LayerSpec { thickness_mm: Some(1.0), properties: Some(medium) };
    for profile in [loaded("gaussians:skin"), LoadedProfile::Layers(vec![coat]).into()] {
        assert!(!profile.follows_medium());
        let error = invert(&profile, &good).unwrap_err();
        assert!(error.code() == ExitCode::Unsupported && error.message().contains("whatever the medium"), "{error}");
        // It has a colour all the same.
        assert_eq!(Inversion::of_medium(&profile, &medium).unwrap().gap(), DVec3::ZERO);
    }
    assert!(coated().follows_medium());
    let vector = |v: f64| DVec3::new(0.5, v, 0.5);
    for (target, fragment) in [
        (Target { colour: vector(f64::NAN), ..good }, "green of the colour is NaN"),
        (Target { colour: vector(f64::INFINITY), ..good }, "green of the colour is inf"),
        (Target { radius_mm: vector(0.0), ..good }, "mean free path of the green channel is 0 mm"),
        (Target { radius_mm: vector(-1.0), ..good }, "is -1 mm"),
        (Target { radius_mm: vector(f64::NAN), ..good }, "is NaN mm"),
        (Target { radius_mm: vector(f64::INFINITY), radius: Radius::DiffusionLength, ..good }, "diffusion length"),
        (Target { eta_inside_over_outside: 9.0, ..good }, "eta is 9"),
        (Target { g: 1.0, ..good }, "g is 1"),
    ] {
        let error = invert(&loaded("dipole"), &target).unwrap_err();
        assert!(error.code() == ExitCode::InvalidInput && error.message().contains(fragment), "{fragment}: {error}");
    }
}

/// Number of totals in one search, each of which may need a table.
#[test]
fn few_totals_are_needed() {
    for wanted in [0.001, 0.2, 0.6, 0.93, 0.999] {
        let a = boundary_a(1.3, BoundaryFit::Published);
        let total = |x: f64| crate::medium::dipole::Dipole::new(1.0 - x * x, x * x, a);
        let mut search = Search::new(wanted, 0.0);
        let mut count = 0;
        while let Some(x) = search.next() {
            assert!((0.0..=1.0).contains(&x));
            search.learn(x, crate::medium::profile::Profile::total(&total(x)));
            count += 1;
        }
        assert!(count <= 14, "{wanted}: {count}");
    }
}
