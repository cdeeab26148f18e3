#![allow(clippy::unwrap_used)]

use super::*;
use crate::math::quadrature::integrate;
use crate::medium::dipole::{Dipole, Pole};

const FIT: BoundaryFit = BoundaryFit::Published;

fn layer(thickness_mm: Option<f64>, scattering: f64, absorption: f64, eta: f64) -> Layer {
    Layer { thickness_mm, sigma_s_reduced_per_mm: scattering, sigma_a_per_mm: absorption, eta_inside_over_outside: eta }
}

const MEDIA: [(f64, f64, f64); 6] =
    [(2.19, 0.0021, 1.5), (1.0, 0.0, 1.3), (0.74, 0.5, 1.3), (0.03, 1.45, 1.3), (20.0, 1e-5, 1.0), (1.0, 0.01, 0.75)];

fn dipole((s, a, eta): (f64, f64, f64)) -> Dipole {
    Dipole::new(s, a, boundary_a(eta, FIT))
}

#[test]
fn a_half_space_is_the_dipole() {
    for medium in MEDIA {
        let (exact, got) = (dipole(medium), Layers::new(&[layer(None, medium.0, medium.1, medium.2)], FIT).unwrap());
        assert!((got.total() - exact.total()).abs() < 1e-14 + 1e-12 * exact.total());
        for factor in [0.0, 1e-4, 0.03, 0.5, 1.0, 3.0, 10.0, 40.0, 300.0, 3000.0] {
            let r = factor * exact.z_real_mm;
            let (want, tail) = (exact.reflectance(r), exact.tail(r));
            if tail < 1e-16 * exact.tail(0.0) {
                continue;
            }
            let error = (got.reflectance(r) / want - 1.0).abs().max((got.tail(r) / tail - 1.0).abs());
            // With hardly any absorption nothing keeps the digits of the far distances.
            let limit = if exact.sigma_tr_per_mm * exact.z_real_mm < 0.01 && factor > 100.0 { 1e-5 } else { 3e-7 };
            assert!(error < limit, "{medium:?} {factor} {error:e}");
        }
    }
}

/// The images of a slab one by one, with this module's source.
fn images(slab: &Slab, r: f64, count: i32) -> (f64, f64) {
    let period = 2.0 * slab.whole();
    let mut sums = (0.0, 0.0);
    for i in -count..=count {
        for (sign, z) in [(1.0, slab.depth), (-1.0, -slab.depth - 2.0 * slab.beyond[0])] {
            let z = period * f64::from(i) + z;
            let weight = sign * z.signum() * slab.source * z.abs() / (2.0 * TAU);
            let pole = Pole { weight, z_mm: z.abs(), sigma_per_mm: slab.sigma_tr };
            sums = (sums.0 + pole.reflectance(r), sums.1 + pole.tail(r));
        }
    }
    sums
}

#[test]
fn a_slab_is_the_sum_of_its_images() {
    for (s, a, eta) in MEDIA {
        let free_path = 1.0 / (s + a);
        for thickness in [0.2, 1.0, 4.0, 20.0] {
            let one = layer(Some(thickness * free_path), s, a, eta);
            let got = Layers::new(&[one], FIT).unwrap();
            let stack = Stack::new(&[one], FIT).unwrap();
            for factor in [0.01, 0.3, 1.0, 2.0, 5.0] {
                let r = factor * free_path;
                let (want, tail) = images(&stack.slabs[0], r, 400);
                let scale = (dipole((s, a, eta)).reflectance(r), got.tail(0.0));
                // With little absorption the images of the tail do not add up to a limit.
                let summable = 400.0 * stack.slabs[0].whole() * stack.slabs[0].sigma_tr > 20.0;
                let of_tail = if summable { ((got.tail(r) - tail) / scale.1).abs() } else { 0.0 };
                let error = ((got.reflectance(r) - want) / scale.0).abs().max(of_tail);
                assert!(error < 2e-5, "{s} {a} {thickness} {factor} {error:e}");
            }
        }
    }
}

#[test]
fn the_profile_transforms_back_into_what_it_came_from() {
    let layers = [layer(Some(0.4), 2.0, 0.05, 1.4), layer(Some(1.0), 0.5, 0.002, 1.4), layer(None, 3.0, 0.1, 1.3)];
    let (got, stack) = (Layers::new(&layers, FIT).unwrap(), Stack::new(&layers, FIT).unwrap());
    for s in [0.0, 0.1, 1.0, 4.0] {
        // Bessel's integral for J_0.
        let bessel = |x: f64| integrate(|t| (x * t.sin()).cos() / PI, 0.0, PI, 1e-13);
        let piece = |from: f64, to: f64| integrate(|r| TAU * r * got.reflectance(r) * bessel(s * r), from, to, 1e-10);
        let back: f64 = [0.0, 0.2, 1.0, 3.0, 8.0, 20.0, 60.0, 150.0].windows(2).map(|w| piece(w[0], w[1])).sum();
        let want = stack.transform(Complex::new(s * s, 0.0))[0].re;
        assert!((back - want).abs() < 3e-8, "{s} {back} {want}");
    }
}

#[test]
fn thick_slabs_approach_the_dipole() {
    for medium in MEDIA {
        let exact = dipole(medium);
        let mut previous = f64::INFINITY;
        for thickness in [1.0, 3.0, 10.0, 30.0, 300.0] {
            let one = layer(Some(thickness * exact.z_real_mm), medium.0, medium.1, medium.2);
            let got = Layers::new(&[one], FIT).unwrap();
            let error = (got.total() - exact.total()).abs() / exact.total();
            assert!(error <= previous * (1.0 + 1e-9) + 1e-12, "{medium:?} {thickness} {error:e} {previous:e}");
            previous = error;
            let near = got.reflectance(exact.z_real_mm) / exact.reflectance(exact.z_real_mm) - 1.0;
            assert!(thickness < 300.0 || near.abs() < 1e-4, "{medium:?} {near:e}");
        }
        // Where little is absorbed what a slab transmits falls as 1 / thickness.
        let absorbed = 300.0 * exact.z_real_mm * exact.sigma_tr_per_mm > 8.0;
        assert!(previous < if absorbed { 1e-5 } else { 0.02 }, "{medium:?} {previous:e}");
    }
}

#[test]
fn layers_without_absorption_lose_no_light() {
    for thickness in [1e-6, 1e-3, 0.1, 1.0, 10.0, 1e6] {
        for (top, bottom) in [(1.3, 1.5), (1.5, 1.0), (1.4, 1.4)] {
            let layers = [layer(Some(thickness), 3.0, 0.0, top), layer(Some(2.0), 0.7, 0.0, bottom)];
            let [reflected, transmitted] = Stack::new(&layers, FIT).unwrap().totals();
            assert!((reflected + transmitted - 1.0).abs() < 1e-9, "{thickness} {top} {reflected} {transmitted}");
            assert_eq!(Layers::new(&layers, FIT).unwrap().total(), reflected);
        }
    }
}

#[test]
fn a_layer_cut_in_two_stays_nearly_the_same() {
    // Each half restarts its light at a point and extrapolates its own boundary: the error of the paper's method itself.
    for (s, a, eta, whole) in
        [(2.0, 0.01, 1.0, 8.0), (2.0, 0.01, 1.4, 8.0), (5.0, 0.02, 1.3, 4.0), (1.0, 0.1, 1.3, 20.0)]
    {
        let half = layer(Some(0.5 * whole), s, a, eta);
        let one = Layers::new(&[layer(Some(whole), s, a, eta)], FIT).unwrap();
        let two = Layers::new(&[half, half], FIT).unwrap();
        let error = (two.total() / one.total() - 1.0).abs();
        assert!(error < 0.02, "{s} {a} {eta} {whole}: {error}");
    }
}

#[test]
fn absent_and_black_layers_are_what_they_should() {
    let base = layer(None, 1.0, 0.05, 1.3);
    let alone = Layers::new(&[base], FIT).unwrap();
    let clear = Layers::new(&[layer(Some(1.0), 0.0, 0.0, 1.4), base], FIT).unwrap();
    assert_eq!(alone.total(), clear.total());
    let tinted = Layers::new(&[layer(Some(0.5), 0.0, 1.0, 1.3), base], FIT).unwrap();
    // Through a filter twice, and the boundary that was with air is now with the same index.
    let matched = 0.5 * alone.total() / alone.total()
        * Stack::new(&[layer(Some(1.0), 0.0, 1.0, 1.3), base], FIT).unwrap().slabs[1].lit_from_above(Complex::ZERO)[0]
            .re
        * 2.0;
    assert!((tinted.total() / (matched * (-1.0_f64).exp()) - 1.0).abs() < 1e-9);
    let absorbing = [layer(Some(1.0), 0.0, 3.0, 1.4)];
    let black = Layers::new(&absorbing, FIT).unwrap();
    assert_eq!((black.total(), black.reflectance(0.3), black.tail(0.0)), (0.0, 0.0, 0.0));
    assert!((Stack::new(&absorbing, FIT).unwrap().totals()[1] - (-3.0_f64).exp()).abs() < 1e-15);
    let nothing = Layers::new(&[layer(None, 0.0, 0.0, 1.0)], FIT).unwrap();
    assert_eq!(nothing.total(), 0.0);
}

#[test]
fn impossible_stacks_are_refused() {
    let ok = layer(Some(1.0), 1.0, 0.1, 1.3);
    for (layers, says) in [
        (vec![], "0 layers"),
        (vec![ok; MOST_LAYERS + 1], "17 layers"),
        (vec![layer(None, 1.0, 0.1, 1.3), ok], "layer 1 has no thickness"),
        (vec![ok, layer(Some(0.0), 1.0, 0.1, 1.3)], "layer 2 is 0 mm"),
        (vec![layer(Some(f64::NAN), 1.0, 0.1, 1.3)], "layer 1 is NaN mm"),
    ] {
        let error = Layers::new(&layers, FIT).unwrap_err();
        assert!(error.message().contains(says), "{error}");
    }
}
