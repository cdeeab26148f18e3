#![allow(clippy::unwrap_used)]

use glam::DVec3;

use super::better_dipole::BetterDipole;
use super::boundary::{Boundary, Coefficients, Grosjean};
use super::burley::{Burley, BurleyFit};
use super::gaussians::{Gaussians, SKIN};
use super::layers::{Layer, Layers};
use super::measured::{self, Interpolation, Measured};
use super::model::ProfileModel;
use super::photon_beam::photon_beam;
use super::{csv, layer_file};
use crate::error::ExitCode;
use crate::math::quadrature::integrate;
use crate::math::random::uniform;
use crate::medium::dipole::Dipole;
use crate::medium::dipole::tests::brute_triangle;
use crate::medium::fresnel::{BoundaryFit, boundary_a};
use crate::medium::material::{OpticalProperties, PRESETS};
use crate::medium::profile::{Profile, triangle_by_tail};

use std::f64::consts::TAU;

fn measured_sample(interpolation: Interpolation) -> Measured {
    let points = [(0.1, 0.4), (0.3, 0.2), (0.9, 0.05), (1.5, 0.03), (2.0, 0.0), (2.5, 0.004), (3.0, 0.001)];
    Measured::new(&points, interpolation).unwrap()
}

/// One profile of each model, with the distances (mm) of its corners.
fn one_of_each() -> Vec<(&'static str, Box<dyn Profile>, Vec<f64>)> {
    let corners = vec![0.1, 0.3, 0.9, 1.5, 2.0, 2.5, 3.0];
    let slab = |thickness_mm, s, a| Layer {
        thickness_mm,
        sigma_s_reduced_per_mm: s,
        sigma_a_per_mm: a,
        eta_inside_over_outside: 1.4,
    };
    let layers = [slab(Some(0.3), 3.0, 0.3), slab(Some(1.0), 1.0, 0.01), slab(None, 0.5, 0.1)];
    let [skin, ..] = Gaussians::channels(&SKIN).unwrap();
    vec![
        ("dipole", Box::new(Dipole::new(1.0, 0.05, boundary_a(1.3, BoundaryFit::Published))), vec![]),
        ("better dipole", Box::new(BetterDipole::new(1.0, 0.05, 1.3)), vec![]),
        ("photon beam", Box::new(photon_beam(1.0, 0.05, 1.3).unwrap()), vec![1e-3]),
        ("burley", Box::new(Burley::new(0.6, 1.0, BurleyFit::Searchlight)), vec![]),
        ("gaussians", Box::new(skin), vec![]),
        ("layers", Box::new(Layers::new(&layers, BoundaryFit::Published).unwrap()), vec![]),
        ("measured", Box::new(measured_sample(Interpolation::LogLinear)), corners.clone()),
        ("measured, linear", Box::new(measured_sample(Interpolation::Linear)), corners),
    ]
}

#[test]
fn tail_is_the_integral_of_the_profile() {
    for (name, profile, corners) in one_of_each() {
        let mut borders: Vec<f64> = vec![0.0, 1e-6, 1e-4, 1e-3, 0.01, 0.05, 0.2, 0.7, 1.1, 1.9, 4.0, 9.0, 25.0, 80.0];
        borders.extend(corners);
        borders.sort_by(f64::total_cmp);
        let whole = profile.tail(0.0);
        assert!((profile.total() - TAU * whole).abs() < 1e-12, "{name}");
        for pair in borders.windows(2) {
            let brute = integrate(|r| r * profile.reflectance(r), pair[0], pair[1], 1e-13 * whole);
            let got = profile.tail(pair[0]) - profile.tail(pair[1]);
            assert!((got - brute).abs() < 2e-9 * whole, "{name} {pair:?} {got:e} {brute:e}");
        }
        // The slope of the tail, away from corners.
        for r in [0.011, 0.17, 0.53, 1.23, 2.77, 5.0] {
            let h = 1e-5 * r;
            let slope = (profile.tail(r - h) - profile.tail(r + h)) / (2.0 * h * r);
            let error = (slope - profile.reflectance(r)).abs();
            assert!(error < 1e-6 * profile.reflectance(r) + 1e-11 * whole / h, "{name} {r} {error:e}");
        }
        assert!(profile.tail(1e9) < 1e-6 * whole, "{name}");
    }
}

#[test]
fn triangles_agree_with_brute_force() {
    let frame = |x: f64, y: f64, h: f64| {
        DVec3::new(2.0, -1.0, 2.0) / 3.0 * x
            + DVec3::new(1.0, -2.0, -2.0) / 3.0 * y
            + DVec3::new(2.0, 2.0, -1.0) / 3.0 * h
    };
    let receivers = [(0.0, 0.0, 0.0), (0.4, 0.3, 0.2), (1.7, -0.3, 0.0), (9.0, 5.0, 2.0)];
    let corners = [frame(0.0, 0.0, 0.0), frame(1.0, 0.0, 0.0), frame(0.3, 0.8, 0.0)].map(|p| p * 1.5);
    for (name, profile, _) in one_of_each() {
        for (x, y, h) in receivers {
            let receiver = frame(x, y, h) * 1.5;
            let want = brute_triangle(profile.as_ref(), receiver, corners, 1e-5 * profile.total());
            let got = profile.triangle(receiver, corners);
            assert!((got - want).abs() / profile.total() < 2e-5, "{name} {x} {y} {h}: {got:e} {want:e}");
        }
        // A receiver inside: discs and triangles around it tend to the total.
        let far = [frame(0.0, 4e3, 0.0), frame(-4e3, -3e3, 0.0), frame(4e3, -3e3, 0.0)];
        let all = profile.triangle(DVec3::ZERO, far);
        assert!((all - profile.total()).abs() < 1e-3 * profile.total() && all < profile.total() + 1e-9, "{name} {all}");
        assert_eq!(profile.triangle(DVec3::ZERO, [DVec3::X; 3]), 0.0);
        assert_eq!(profile.triangle(DVec3::NAN, far), 0.0);
    }
}

#[test]
fn edges_by_the_tail_alone_agree_with_the_closed_edges_of_the_dipole() {
    let mut worst = 0.0_f64;
    for dipole in PRESETS[2].properties().dipoles(BoundaryFit::Published) {
        for i in 0..200_u64 {
            let random = |k: u64| uniform(7, i, k) - 0.5;
            let point = |k: u64| DVec3::new(random(k), random(k + 1), random(k + 2));
            let size = 10.0_f64.powf(6.0 * random(20)) * dipole.z_real_mm;
            let corners = [point(0), point(3), point(6)].map(|p| p * size);
            let receiver = point(9) * size;
            let error = triangle_by_tail(&dipole, receiver, corners) - dipole.triangle(receiver, corners);
            worst = worst.max(error.abs() / dipole.total());
        }
    }
    assert!(worst < 2e-10, "{worst:e}");
}

#[test]
fn the_better_dipole_has_its_closed_total() {
    for eta in [0.8, 1.0, 1.3, 1.5] {
        for (s, a) in [(1.0, 0.0), (2.0, 0.01), (0.5, 0.5), (0.05, 1.0), (1e6, 1e-3)] {
            let (medium, boundary) = (Coefficients::new(s, a), Boundary::new(eta));
            let grosjean = Grosjean::new(&medium);
            assert!((grosjean.diffusion_mm - (2.0 * a + s) / (3.0 * (s + a) * (s + a))).abs() < 1e-12 / (s + a));
            let (sigma, z) = (grosjean.sigma_tr_per_mm, 1.0 / (s + a));
            let image = z + 4.0 * boundary.a * grosjean.diffusion_mm;
            let (near, far) = ((-sigma * z).exp(), (-sigma * image).exp());
            let fluence = if sigma > 0.0 { (near - far) / sigma } else { image - z };
            let closed = medium.albedo.powi(2)
                * (0.5 * boundary.flux * (near + far) + 0.5 * boundary.fluence / grosjean.diffusion_mm * fluence);
            let total = BetterDipole::new(s, a, eta).total();
            assert!((total - closed).abs() < 1e-10, "{eta} {s} {a} {total} {closed}");
            if a == 0.0 {
                assert!((total - 1.0).abs() < 1e-10);
            }
        }
    }
}

#[test]
fn models_meet_at_high_albedo() {
    for eta in [1.0, 1.3, 1.5] {
        let a = boundary_a(eta, BoundaryFit::Exact);
        for (absorption, tolerance) in [(1e-3, 0.04), (1e-5, 0.005)] {
            let classical = Dipole::new(1.0, absorption, a);
            let better = BetterDipole::new(1.0, absorption, eta);
            let beam = photon_beam(1.0, absorption, eta).unwrap();
            assert!((better.total() / classical.total() - 1.0).abs() < tolerance);
            assert!((beam.total() / better.total() - 1.0).abs() < 0.12);
            // Far away all are the same diffusion; how much of it is up to the boundary.
            let far = better.reflectance(20.0) / classical.reflectance(20.0);
            assert!((far - 1.0).abs() < 0.25, "{far}");
        }
    }
}

/// Reflectance of a half space for light straight down without single scattering, isotropic, matched indices:
/// Chandrasekhar's H function less `albedo / 2 (1 - ln 2)`.
fn multiple_scattering(albedo: f64) -> f64 {
    // H(1) by the iteration of his integral equation; 1 - H(1) sqrt(1 - albedo) is the plane albedo.
    let nodes = crate::math::quadrature::gauss_legendre(48);
    let mu: Vec<f64> = nodes.iter().map(|n| 0.5 * (1.0 + n.position)).collect();
    let mut h = vec![1.0; mu.len()];
    let root = (1.0 - albedo).sqrt();
    let next = |at: f64, h: &[f64]| {
        let sum: f64 = nodes.iter().zip(&mu).zip(h).map(|((n, m), h)| 0.5 * n.weight * m * h / (at + m)).sum();
        1.0 / (root + 0.5 * albedo * sum)
    };
    for _ in 0..400 {
        h = mu.iter().map(|m| next(*m, &h)).collect();
    }
    1.0 - next(1.0, &h) * root - 0.5 * albedo * (1.0 - 2.0_f64.ln())
}

#[test]
fn the_better_dipole_and_the_beam_beat_the_dipole_at_low_albedo() {
    assert!((multiple_scattering(0.5) - (0.1152 - 0.25 * (1.0 - 2.0_f64.ln()))).abs() < 2e-4);
    for albedo in [0.3, 0.5, 0.6, 0.8, 0.9] {
        let (s, a) = (albedo, 1.0 - albedo);
        let exact = multiple_scattering(albedo);
        let classical = Dipole::new(s, a, 1.0).total();
        let better = BetterDipole::new(s, a, 1.0).total();
        let beam = photon_beam(s, a, 1.0).unwrap().total();
        assert!((better - exact).abs() < 0.65 * (classical - exact).abs(), "{albedo}");
        assert!((beam - exact).abs() < (classical - exact).abs(), "{albedo}");
    }
}

#[test]
fn burley_returns_its_albedo_and_gaussians_their_weights() {
    for fit in [BurleyFit::Searchlight, BurleyFit::Diffuse, BurleyFit::DiffuseMeanFreePath] {
        for albedo in [0.0, 0.1, 0.5, 0.99, 1.0] {
            let burley = Burley::new(albedo, 2.0, fit);
            assert!((burley.total() - albedo).abs() < 1e-15);
            assert!((burley.d_mm * fit.shape(albedo) - 2.0).abs() < 1e-14);
        }
    }
    let better = BetterDipole::new(1.0, 0.2, 1.3).total();
    assert!((Burley::of_medium(1.0, 0.2, 1.3, BurleyFit::Diffuse).total() - better).abs() < 1e-14);
    for channel in Gaussians::channels(&SKIN).unwrap() {
        assert!((channel.total() - 1.0).abs() < 1e-12);
    }
    assert!(Gaussians::new(&[(0.6, 1.0), (0.5, 2.0)]).unwrap_err().message().contains("more light"));
    assert!(Gaussians::new(&[(-0.6, 1.0)]).unwrap_err().message().contains("weight is -0.6"));
    assert!(Gaussians::new(&[(0.6, 0.0)]).unwrap_err().message().contains("variance is 0"));
}

const MODELS: [&str; 9] = [
    "dipole",
    "better-dipole",
    "photon-beam",
    "burley",
    "burley:diffuse",
    "burley:fit=dmfp",
    "slab:thickness=0.5",
    "slab:thickness=300",
    "gaussians:skin",
];

#[test]
fn every_medium_and_distance_gives_a_finite_positive_number() {
    let mut media: Vec<OpticalProperties> = PRESETS.iter().step_by(3).map(|preset| preset.properties()).collect();
    let sigma = [DVec3::new(0.0, 1e-9, 1e-3), DVec3::new(1.0, 1e3, 1e6), DVec3::new(1e-300, 1e-30, 1e-12)];
    for s in sigma {
        for a in sigma {
            for eta in [0.4, 1.0, 3.0] {
                media.push(OpticalProperties {
                    sigma_s_reduced_per_mm: s,
                    sigma_a_per_mm: DVec3::new(a.y, a.z, a.x),
                    g: 0.0,
                    eta_inside_over_outside: eta,
                });
            }
        }
    }
    for text in MODELS {
        let model = ProfileModel::parse(text).unwrap();
        for properties in &media {
            for (channel, profile) in model.channels(properties).unwrap().iter().enumerate() {
                let place = format!("{text} {channel} {properties:?}");
                let total = profile.total();
                assert!((0.0..=1.0 + 1e-9).contains(&total), "{place} {total}");
                let mut previous = f64::INFINITY;
                for r in [0.0, 1e-300, 1e-9, 1e-3, 0.1, 1.0, 30.0, 1e4, 1e12, 1e200, f64::MAX, f64::INFINITY] {
                    let (value, tail) = (profile.reflectance(r), profile.tail(r));
                    assert!(value >= 0.0 && value.is_finite(), "{place} {r} {value}");
                    assert!(tail >= 0.0 && tail <= previous * (1.0 + 1e-9), "{place} {r} {tail} {previous}");
                    previous = tail;
                }
                let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
                let triangle = profile.triangle(DVec3::new(0.1, 0.2, 0.0), corners);
                assert!((0.0..=1.0 + 1e-9).contains(&triangle), "{place} {triangle}");
            }
        }
    }
}

#[test]
fn profiles_scale_with_the_medium() {
    for text in ["better-dipole", "photon-beam", "burley"] {
        let model = ProfileModel::parse(text).unwrap();
        let of = |scale: f64| OpticalProperties {
            sigma_s_reduced_per_mm: DVec3::splat(2.0 * scale),
            sigma_a_per_mm: DVec3::splat(0.1 * scale),
            g: 0.0,
            eta_inside_over_outside: 1.3,
        };
        let ([one, ..], [other, ..]) = (model.channels(&of(1.0)).unwrap(), model.channels(&of(1000.0)).unwrap());
        for r in [0.01, 0.3, 2.0, 11.0] {
            assert!((other.tail(r / 1000.0) / one.tail(r) - 1.0).abs() < 1e-10, "{text} {r}");
            assert!((other.reflectance(r / 1000.0) / one.reflectance(r) / 1e6 - 1.0).abs() < 1e-10, "{text} {r}");
        }
    }
}

#[test]
fn forms_are_read_and_written() {
    let files = ["dipole:from=2", "layers:path=a:b.toml", "gaussians:path=g.csv", "measured:path=m.csv"];
    for text in MODELS.into_iter().chain(files).chain(["measured:interpolation=linear:path=m=1.csv"]) {
        let model = ProfileModel::parse(text).unwrap();
        assert_eq!(ProfileModel::parse(&model.to_string()).unwrap(), model, "{text}");
    }
    assert_eq!(ProfileModel::parse(" x/Skin.TOML ").unwrap(), ProfileModel::Layers("x/Skin.TOML".into()));
    assert_eq!(ProfileModel::parse("a.csv").unwrap(), ProfileModel::parse("measured:path=a.csv").unwrap());
    for all_orders in ["dipole", "dipole:from=1"] {
        assert_eq!(ProfileModel::default(), ProfileModel::parse(all_orders).unwrap());
    }
    for (text, says) in [
        ("", "it is empty"),
        ("tripole", "`tripole` is no profile"),
        ("dipole:x=1", "from=1 or from=2"),
        ("burley:fit=none", "`none` is no fit"),
        ("slab", "a number of mm"),
        ("slab:thickness=-1", "a number of mm"),
        ("slab:thickness=inf", "a number of mm"),
        ("layers", "takes a path"),
        ("gaussians:path=", "takes a path"),
        ("measured:interpolation=cubic:path=a", "takes a path"),
    ] {
        let error = ProfileModel::parse(text).unwrap_err();
        assert_eq!(error.code(), ExitCode::CommandLine);
        assert!(error.message().contains(says) && error.message().contains("burley:fit="), "{text}: {error}");
    }
    let missing = ProfileModel::parse("no-such-file.csv").unwrap().load().unwrap_err();
    assert_eq!(missing.code(), ExitCode::Io);
}

#[test]
fn csv_mistakes_are_told_with_their_line() {
    let read = |text: &str| {
        csv::parse(text, "m.csv", "r_mm").and_then(|rows| measured::from_rows(&rows, "m.csv", Interpolation::LogLinear))
    };
    let good = "# a comment\n\nr_mm,r,g,b\n0, 0.3,0.2,0.1 # first\r\n1,0.03,0.02,0.01\n2.5,0.001,0.0,0.005\n";
    let [red, green, _] = read(good).unwrap();
    assert!((red.reflectance(0.5) - (0.3_f64 * 0.03).sqrt()).abs() < 1e-15);
    assert!((green.reflectance(1.75) - 0.01).abs() < 1e-15, "straight towards 0");
    assert!(green.reflectance(3.0) == 0.0 && red.reflectance(4.0) < 0.001 && red.reflectance(4.0) > 0.0);
    for (text, says) in [
        ("", "m.csv: empty"),
        ("# nothing\n", "m.csv: empty"),
        ("0,1,2,3\n", "m.csv:1: the first line must be the header `r_mm,r,g,b`"),
        ("r_mm,r,g,b\n0,1,2\n", "m.csv:2: 3 columns"),
        ("r_mm,r,g,b\n\n0,1,x,3\n", "m.csv:3: `x` in column g"),
        ("r_mm,r,g,b\n0,1,1,inf\n", "m.csv:2: `inf` in column b"),
        ("r_mm,r,g,b\n0,.1,.1,.1\n0,.1,.1,.1\n", "m.csv:3: red: the distance 0 mm follows 0 mm"),
        ("r_mm,r,g,b\n0,.1,.1,.1\n1,.1,-.1,.1\n", "m.csv:3: green: R is -0.1"),
        ("r_mm,r,g,b\n-1,.1,.1,.1\n", "m.csv:2: red: the distance is -1"),
        ("r_mm,r,g,b\n0,.1,.1,.1\n", "m.csv: red: 1 points"),
        ("r_mm,r,g,b\n0,.1,.1,9\n1,.01,.01,9\n", "m.csv: blue: the profile returns"),
    ] {
        let error = read(text).unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput, "{text}");
        assert!(error.message().starts_with(says), "{text}: {error}");
    }
}

#[test]
fn layer_files_are_read_and_their_mistakes_told() {
    let text = "[[layer]]\nthickness_mm = 0.2\npreset = \"skin1\"\neta = 1.4\n\n[[layer]]\nthickness_mm = 1\nsigma_s_per_mm = 10\n\
                sigma_a_per_mm = [0.1, 0.2, 0]\ng = 0.9\n\n[[layer]]\n";
    let layers = layer_file::parse(text, "l.toml").unwrap();
    assert_eq!(layers.len(), 3);
    let second = layers[1].properties.unwrap();
    assert!((second.sigma_s_reduced_per_mm - DVec3::splat(1.0)).length() < 1e-12);
    assert!(layers[0].properties.unwrap().eta_inside_over_outside == 1.4 && layers[2].properties.is_none());
    assert_eq!(layers[2].thickness_mm, None);
    for (text, says) in [
        ("", "l.toml: 0 tables"),
        ("layers = 3", "l.toml:1:1: unknown field"),
        ("[[layer]]\nthickness = 3", "l.toml:2:1: unknown field"),
        ("[[layer]]\n[[layer]]", "l.toml:1:1: thickness_mm is missing"),
        ("[[layer]]\nthickness_mm = 0", "l.toml:2:16: thickness_mm is 0"),
        ("[[layer]]\npreset = \"mud\"", "l.toml:1:1: no material is called 'mud'"),
        ("[[layer]]\nsigma_a_per_mm = 1", "l.toml:1:1: the scattering coefficient"),
        (
            "[[layer]]\nsigma_a_per_mm = \"a\"",
            "l.toml:2:18: invalid type: string \"a\", expected one number or [red, green, blue]",
        ),
    ] {
        let error = layer_file::parse(text, "l.toml").unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput);
        assert!(error.message().starts_with(says), "{text}: {error}");
    }
}
