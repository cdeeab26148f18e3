use super::super::planar::{far_triangle, near_triangle};
use super::*;
use crate::math::quadrature::integrate;
use crate::math::random::uniform;
use crate::medium::fresnel::{BoundaryFit, boundary_a};
use crate::medium::material::preset_dipoles;

/// sigma_s', sigma_a (1/mm) and eta: marble, ketchup, skin, spectralon, cream, matched and inverted indices, a nearly
/// black and a nearly white medium, and two far ends of the scale.
const MEDIA: [(f64, f64, f64); 13] = [
    (2.19, 0.0021, 1.5),
    (0.18, 0.061, 1.3),
    (0.03, 1.45, 1.3),
    (0.74, 0.032, 1.3),
    (20.4, 0.0, 1.3),
    (7.38, 0.0002, 1.3),
    (1.0, 0.01, 1.0),
    (1.0, 0.01, 0.75),
    (1e-9, 1.0, 1.3),
    (1.0, 1e-14, 1.3),
    (1e6, 1e5, 1.3),
    (1e-6, 1e-7, 1.3),
    (5.0, 5.0, 2.4),
];

fn dipole((scattering, absorption, eta): (f64, f64, f64)) -> Dipole {
    Dipole::new(scattering, absorption, boundary_a(eta, BoundaryFit::Published))
}

fn all() -> impl Iterator<Item = Dipole> {
    MEDIA.into_iter().map(dipole)
}

/// A triangle as nested adaptive quadrature of the profile itself, which shares nothing with edges; `tolerance` is
/// absolute.
pub(in crate::medium) fn brute_triangle(
    profile: &dyn Profile,
    receiver: DVec3,
    [a, b, c]: [DVec3; 3],
    tolerance: f64,
) -> f64 {
    let doubled_area = (b - a).cross(c - a).length();
    let tolerance = tolerance / doubled_area;
    let row = |u: f64| {
        let (left, right) = (a.lerp(b, u), a.lerp(c, u));
        u * integrate(|v| profile.reflectance(left.lerp(right, v).distance(receiver)), 0.0, 1.0, 0.1 * tolerance)
    };
    doubled_area * integrate(row, 0.0, 1.0, tolerance)
}

/// The published form of R_d: Jensen et al. 2001, equation 4.
fn published_reflectance(d: &Dipole, r: f64) -> f64 {
    let term = |z: f64| {
        let distance = (r * r + z * z).sqrt();
        z * (d.sigma_tr_per_mm + 1.0 / distance) * (-d.sigma_tr_per_mm * distance).exp() / (distance * distance)
    };
    d.albedo / (4.0 * std::f64::consts::PI) * (term(d.z_real_mm) + term(d.z_virtual_mm))
}

#[test]
fn profile_is_the_published_formula() {
    for d in all() {
        for r in [0.0, 0.01, 0.3, 1.0, 7.0] {
            let r = r * d.z_real_mm;
            let expected = published_reflectance(&d, r);
            assert!((d.reflectance(r) - expected).abs() <= 1e-13 * expected, "{d:?} {r}");
        }
    }
}

#[test]
fn total_is_the_published_closed_form() {
    for (scattering, absorption, eta) in MEDIA {
        let a = boundary_a(eta, BoundaryFit::Published);
        let albedo = scattering / (scattering + absorption);
        let root = (3.0 * absorption / (scattering + absorption)).sqrt();
        let expected = 0.5 * albedo * (1.0 + (-4.0 / 3.0 * a * root).exp()) * (-root).exp();
        let d = Dipole::new(scattering, absorption, a);
        assert!((d.total() - expected).abs() <= 1e-14, "{d:?}");
        assert!((d.total() - TAU * d.tail(0.0)).abs() <= 1e-15, "{d:?}");
    }
}

#[test]
fn tail_and_disc_are_integrals_of_the_profile() {
    for d in all() {
        for radius in [1e-4, 0.03, 0.5, 2.0, 15.0] {
            let radius = radius * d.z_real_mm;
            let brute = integrate(|r| TAU * r * d.reflectance(r), 0.0, radius, 1e-14 * d.total());
            assert!((d.disc(radius) - brute).abs() <= 1e-9 * d.total().min(brute * 1e3), "{d:?} {radius}");
            assert!((d.disc(radius) - TAU * (d.tail(0.0) - d.tail(radius))).abs() <= 1e-14, "{d:?}");
        }
        // The whole plane, in r = z_real sinh u; without absorption the tail ends as 1 / r.
        let brute = integrate(
            |u| {
                let (r, slope) = (d.z_real_mm * f64::sinh(u), d.z_real_mm * f64::cosh(u));
                TAU * r * d.reflectance(r) * slope
            },
            0.0,
            40.0,
            1e-12 * d.total(),
        );
        assert!((d.total() - brute).abs() <= 1e-9 * d.total(), "{d:?} {brute}");
    }
}

/// Receivers in units of a triangle (0,0) (1,0) (0.3,0.8): coordinates along, across and above its plane.
const RECEIVERS: [(f64, f64, f64); 16] = [
    (0.4, 0.3, 0.0),
    (0.4, 0.3, 0.2),
    (0.4, 0.3, -0.2),
    (0.4, 0.3, 5.0),
    (0.0, 0.0, 0.0),
    (1.0, 0.0, 0.0),
    (0.3, 0.8, 0.0),
    (0.3, 0.8, 1.0),
    (0.5, 0.0, 0.0),
    (0.15, 0.4, 0.0),
    (0.5, 0.0, 0.4),
    (1.7, 0.0, 0.0),
    (-0.2, 0.5, 0.0),
    (0.5, -1e-9, 0.0),
    (3.0, 2.0, -1.0),
    (40.0, -30.0, 20.0),
];

/// A triangle and a receiver in a frame without a special coordinate axis.
fn placed(scale: f64, (x, y, height): (f64, f64, f64)) -> (DVec3, [DVec3; 3]) {
    let origin = DVec3::new(3.0, -2.0, 1.5) * scale;
    let along = DVec3::new(2.0, -1.0, 2.0) / 3.0;
    let across = DVec3::new(1.0, -2.0, -2.0) / 3.0;
    let normal = along.cross(across);
    let at = |x: f64, y: f64, h: f64| origin + (along * x + across * y + normal * h) * scale;
    (at(x, y, height), [at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0), at(0.3, 0.8, 0.0)])
}

#[test]
fn triangle_agrees_with_brute_force_wherever_the_receiver_is() {
    for d in all() {
        for scale in [0.02, 0.5, 6.0] {
            for at in RECEIVERS {
                let (receiver, corners) = placed(scale * d.z_real_mm, at);
                let expected = brute_triangle(&d, receiver, corners, 1e-12 * d.total());
                let found = d.triangle(receiver, corners);
                let error = (found - expected).abs() / d.total();
                assert!(error <= 1e-10, "{d:?} {scale} {at:?}: {found} {expected}");
            }
        }
    }
}

#[test]
fn far_triangles_are_accurate_relative_to_themselves() {
    for d in [dipole(MEDIA[0]), dipole(MEDIA[4]), dipole(MEDIA[3])] {
        for distance in [8.0, 20.0, 50.0] {
            let (receiver, corners) = placed(1.0, (distance, 0.7 * distance, 0.3 * distance));
            let expected = brute_triangle(&d, receiver, corners, 0.0);
            let found = d.triangle(receiver, corners);
            assert!((found - expected).abs() <= 1e-8 * expected, "{d:?} {distance}: {found} {expected}");
        }
    }
}

#[test]
fn far_and_near_forms_meet() {
    for d in all() {
        for pole in d.poles() {
            for i in 0..400 {
                let draw = |k: u64| uniform(11, i, k) - 0.5;
                let corners = [0, 1, 2].map(|k| DVec3::new(draw(3 * k), draw(3 * k + 1), draw(3 * k + 2)));
                let receiver = DVec3::new(draw(9), draw(10), draw(11)).normalize();
                let size = 0.25 / (1.0 / pole.z_mm + pole.sigma_per_mm);
                let away = receiver * pole.z_mm * 3.0 * uniform(12, i, 0);
                let corners = corners.map(|c| c * size - away);
                let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let far = far_triangle(&pole, corners, cross.length(), 0.249);
                let near = near_triangle(&pole, corners, cross.normalize());
                assert!((far - near).abs() <= 1e-10 * TAU * pole.tail(0.0), "{pole:?} {far} {near}");
            }
        }
    }
}

#[test]
fn a_half_plane_from_its_edge_returns_half_the_total() {
    for d in all().filter(|d| d.total() > 0.0) {
        // The tail without absorption falls as 1 / r, so the triangle that stands for the half-plane must be huge.
        let r = 1e13 * d.z_real_mm;
        let corners = [DVec3::new(-r, 0.0, 0.0), DVec3::new(r, 0.0, 0.0), DVec3::new(0.0, r, 0.0)];
        let at_edge = d.triangle(DVec3::ZERO, corners);
        assert!((at_edge - 0.5 * d.total()).abs() <= 1e-10 * d.total(), "{d:?} {at_edge}");
        for distance in [0.1, 1.0, 4.0] {
            // Response at a distance from the step: the line spread integrated over the half-plane.
            let h = distance * d.z_real_mm;
            let outside = 2.0 * integrate(|angle: f64| d.tail(h / angle.cos()), 0.0, 0.25 * TAU, 1e-13);
            let lit = d.triangle(DVec3::new(0.0, h, 0.0), corners);
            let dark = d.triangle(DVec3::new(0.0, -h, 0.0), corners);
            assert!((dark - outside).abs() <= 1e-10, "{d:?} {dark} {outside}");
            assert!((lit + dark - d.total()).abs() <= 1e-10, "{d:?} {lit} {dark}");
        }
    }
}

#[test]
fn triangle_does_not_depend_on_orientation_rotation_or_where_it_is() {
    for d in all() {
        let scale = 1.5 * d.z_real_mm;
        for at in RECEIVERS {
            let (receiver, [a, b, c]) = placed(scale, at);
            let value = d.triangle(receiver, [a, b, c]);
            let same = |other: f64| (other - value).abs() <= 1e-12 * d.total();
            for order in [[b, c, a], [c, a, b], [a, c, b], [c, b, a], [b, a, c]] {
                assert!(same(d.triangle(receiver, order)), "{d:?} {at:?}");
            }
            let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0);
            let shift = DVec3::new(5.0, 7.0, -3.0) * scale;
            let moved = |p: DVec3| turn * p + shift;
            assert!(same(d.triangle(moved(receiver), [moved(a), moved(b), moved(c)])), "{d:?} {at:?}");
        }
    }
}

#[test]
fn parts_of_a_triangle_add_up() {
    for d in all() {
        for scale in [0.3, 3.0, 30.0] {
            for at in RECEIVERS {
                let (receiver, [a, b, c]) = placed(scale * d.z_real_mm, at);
                let whole = d.triangle(receiver, [a, b, c]);
                for (u, v) in [(0.2, 0.3), (0.01, 0.98), (0.5, 0.5), (1.0 / 3.0, 1.0 / 3.0)] {
                    let p = a * (1.0 - u - v) + b * u + c * v;
                    let parts: f64 = [[a, b, p], [b, c, p], [c, a, p]].map(|t| d.triangle(receiver, t)).iter().sum();
                    assert!((whole - parts).abs() <= 1e-10 * d.total(), "{d:?} {scale} {at:?} {whole} {parts}");
                }
            }
        }
    }
}

#[test]
fn degenerate_triangles_return_nothing() {
    let d = dipole(MEDIA[0]);
    let (a, b) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.0, 0.5, 3.0));
    for corners in [[a, a, a], [a, b, a], [a, b, b], [a, b, a.midpoint(b)], [a, b, DVec3::splat(f64::NAN)]] {
        for receiver in [a, b, DVec3::ZERO] {
            let value = d.triangle(receiver, corners);
            assert!(value.abs() < 1e-14, "{corners:?} {value}");
        }
    }
    assert_eq!(d.triangle(DVec3::splat(f64::INFINITY), [a, b, DVec3::ZERO]), 0.0);
    assert_eq!(d.triangle(DVec3::splat(1e200), [a, b, DVec3::ZERO]), 0.0);
    // Slivers: finite, not negative, no more than their area allows.
    for thin in [1e-3, 1e-6, 1e-9, 1e-12, 1e-15] {
        let corners = [DVec3::ZERO, DVec3::X * 10.0, DVec3::new(5.0, thin, 0.0)];
        for receiver in [DVec3::ZERO, DVec3::X * 5.0, DVec3::new(5.0, 0.5 * thin, 0.0), DVec3::new(5.0, -1.0, 1.0)] {
            let value = d.triangle(receiver, corners);
            assert!((0.0..=1.001 * 5.0 * thin * d.reflectance(0.0)).contains(&value), "{thin} {value}");
        }
    }
}

/// The same formulas as a f32 kernel would evaluate them.
fn reflectance_f32(d: &Dipole, r: f32) -> f32 {
    d.poles()
        .iter()
        .map(|pole| {
            let (weight, z, sigma) = (pole.weight as f32, pole.z_mm as f32, pole.sigma_per_mm as f32);
            let distance = (r * r + z * z).sqrt();
            weight * (1.0 + sigma * distance) * (-sigma * distance).exp() / (distance * distance * distance)
        })
        .sum()
}

#[test]
fn nothing_is_ever_nan_or_infinite() {
    let sigmas = [0.0, 5e-324, 1e-300, 1e-40, 1e-12, 1e-3, 1.0, 1e3, 1e12, 1e40, 1e300, f64::MAX];
    let lengths = [0.0, 1e-300, 1e-20, 1e-6, 1.0, 1e6, 1e20, 1e160, f64::MAX, f64::INFINITY];
    for scattering in sigmas {
        for absorption in sigmas {
            for eta in [0.4, 0.75, 1.0, 1.3, 3.0] {
                let d = dipole((scattering, absorption, eta));
                assert!((0.0..=1.0).contains(&d.total()), "{d:?}");
                for r in lengths {
                    let values = [d.reflectance(r), d.tail(r), d.disc(r)];
                    assert!(values.iter().all(|v| v.is_finite() && *v >= 0.0), "{d:?} {r} {values:?}");
                    assert!(values.iter().all(|v| (*v as f32).is_finite()), "{d:?} {r} {values:?}");
                    assert!(d.disc(r) <= d.total() * (1.0 + 1e-12) + f64::MIN_POSITIVE, "{d:?} {r}");
                }
                for r in [0.0, 1e-6, 1e-3, 1.0, 1e3, 1e6] {
                    assert!(reflectance_f32(&d, r).is_finite(), "{d:?} {r}");
                }
                for scale in [1e-6, 1.0, 1e6] {
                    for at in [RECEIVERS[0], RECEIVERS[4], RECEIVERS[8], RECEIVERS[15]] {
                        let (receiver, corners) = placed(scale, at);
                        let value = d.triangle(receiver, corners);
                        assert!(
                            (0.0..=d.total() * (1.0 + 1e-10) + 1e-290).contains(&value),
                            "{d:?} {scale} {at:?} {value}"
                        );
                    }
                }
            }
        }
    }
    for bad in [f64::NAN, f64::INFINITY, -1.0] {
        assert_eq!(Dipole::new(bad, bad, bad).total(), 0.0);
        assert!(Dipole::new(1.0, bad, bad).total() > 0.99);
    }
}

#[test]
fn limits_of_the_albedo() {
    // Spectralon: no absorption, everything comes back, the tail falls as 1 / r.
    let white = dipole((20.4, 0.0, 1.3));
    assert_eq!((white.sigma_tr_per_mm, white.total()), (0.0, 1.0));
    let reach: f64 = white.poles().iter().map(|pole| pole.weight).sum();
    assert!((white.tail(1e4) * 1e4 / reach - 1.0).abs() < 1e-6);
    assert!((white.reflectance(1e4) * 1e12 / reach - 1.0).abs() < 1e-6);
    // Towards it continuously, and monotonically in the absorption.
    let mut previous = 1.0;
    for exponent in -14..=4 {
        let total = dipole((20.4, 10.0_f64.powi(exponent), 1.3)).total();
        assert!(total < previous, "{exponent}");
        previous = total;
    }
    assert!(dipole((20.4, 1e-14, 1.3)).total() > 1.0 - 1e-6);
    assert!(previous < 1e-3);
    // Black: proportional to the albedo.
    let black = dipole((1e-12, 1.0, 1.3));
    assert!((black.total() / black.albedo - dipole((1e-9, 1.0, 1.3)).total() / 1e-9).abs() < 1e-8);
    assert_eq!(dipole((0.0, 1.0, 1.3)).total(), 0.0);
    assert_eq!(dipole((0.0, 0.0, 1.3)).total(), 0.0);
    assert_eq!(dipole((0.0, 0.0, 1.3)).reflectance(0.0), 0.0);
}

#[test]
fn the_profile_is_similar_under_a_change_of_unit() {
    let (d, inches) = (dipole((2.19, 0.0021, 1.5)), dipole((2.19 * 25.4, 0.0021 * 25.4, 1.5)));
    assert!((d.total() - inches.total()).abs() < 1e-14);
    for r in [0.0, 0.4, 3.0] {
        assert!((d.reflectance(r) * 25.4 * 25.4 / inches.reflectance(r / 25.4) - 1.0).abs() < 1e-12);
        assert!((d.disc(r) - inches.disc(r / 25.4)).abs() < 1e-14);
    }
}

#[test]
fn the_radius_that_contains_a_fraction_is_the_range_of_the_rest() {
    let d = dipole((11.6, 0.0, 1.3));
    assert_eq!(d.radius_containing_mm(0.25), d.range_mm(0.75));
    // Independent figure: 99 % of spectralon's red lie within 24 mm.
    assert!((d.radius_containing_mm(0.99) - 24.0).abs() < 0.5);
}

#[test]
fn nothing_but_the_share_lies_beyond_the_range() {
    let mut checked = 0;
    for d in all().chain(preset_dipoles()).filter(|d| d.total() > 0.0) {
        let mut before = f64::INFINITY;
        for share in [1e-12, 1e-6, 1e-3, 0.01, 0.1, 0.5, 0.9, 0.999] {
            let range = d.range_mm(share);
            assert!(range.is_finite() && range > 0.0 && range < before, "{d:?} {share} {range}");
            before = range;
            let found = d.tail(range) / d.tail(0.0);
            assert!((found / share - 1.0).abs() < 1e-9, "{d:?} {share} {found}");
            // The same from the disc, which loses the digits of small shares.
            assert!((1.0 - d.disc(range) / d.total() - share).abs() < 1e-10, "{d:?} {share}");
            // Hardly nearer there is more beyond.
            assert!(d.tail(range * (1.0 - 1e-9)) > share * d.tail(0.0), "{d:?} {share}");
            checked += 1;
        }
        assert_eq!((d.range_mm(1.0), d.range_mm(f64::NAN)), (0.0, 0.0));
        assert_eq!((d.range_mm(0.0), d.range_mm(-1.0)), (f64::INFINITY, f64::INFINITY));
        assert!(d.range_mm(f64::MIN_POSITIVE) > d.range_mm(1e-12));
    }
    assert!(checked > 8 * 40);
    assert_eq!(dipole((0.0, 1.0, 1.3)).range_mm(0.01), 0.0);
}

#[test]
fn decay_is_the_exponential() {
    for i in 0..20_000 {
        let x = f64::from(i) * 0.035;
        let (ours, exact) = (decay(x), (-x).exp());
        assert!((ours - exact).abs() <= 4e-16 * exact, "{x} {ours:e} {exact:e}");
    }
    assert_eq!(decay(0.0), 1.0);
    assert!(decay(f64::MIN_POSITIVE) == 1.0 && decay(701.0) == 0.0);
    assert!(decay(f64::INFINITY) == 0.0 && decay(f64::NAN) == 0.0);
}

#[test]
fn derivatives_agree_with_finite_differences() {
    let extremes =
        [(0.0, 1.0), (0.0, 0.0), (1e6, 0.0), (1e6, 1e6), (1e-6, 0.0), (1e-9, 1e-9), (1e-6, 1e6), (1e300, 1e300)];
    let extremes = extremes.map(|(scattering, absorption)| dipole((scattering, absorption, 1.3)));
    for dipole in preset_dipoles().chain(all()).chain(extremes) {
        for pole in dipole.poles() {
            // Far below z^2 the differences drown in rounding.
            for s in [0.01, 1.0, 30.0, 1e4].map(|factor| factor * pole.z_mm * pole.z_mm) {
                let [value, first, second] = pole.derivatives(s);
                let exact = pole.reflectance(s.sqrt());
                assert!((value - exact).abs() <= 1e-12 * exact.abs() + 1e-300, "{pole:?} {s}");
                // A step over which x changes by about 1e-4 keeps truncation and rounding balanced.
                let h = 1e-4 * (s + pole.z_mm * pole.z_mm) / (1.0 + pole.sigma_per_mm * s.sqrt().hypot(pole.z_mm));
                let h = h.min(0.5 * s);
                let (below, above) = (pole.derivatives(s - h), pole.derivatives(s + h));
                let slope = (above[0] - below[0]) / (2.0 * h);
                let curvature = (above[1] - below[1]) / (2.0 * h);
                assert!((first - slope).abs() <= 1e-6 * slope.abs() + 1e-290, "{pole:?} {s} {first:e} {slope:e}");
                assert!((second - curvature).abs() <= 1e-6 * curvature.abs() + 1e-290, "{pole:?} {s}");
            }
        }
    }
}

/// What is left out is the first term of the series in the albedo: the rest falls with its square.
#[test]
fn the_later_orders_are_the_dipole_without_its_first_term() {
    let extinction = 1.7;
    let of = |albedo: f64| {
        let whole =
            Dipole::new(albedo * extinction, (1.0 - albedo) * extinction, boundary_a(1.3, BoundaryFit::Published));
        (whole, whole.after_first())
    };
    let first_over_albedo = |albedo: f64, r: f64| {
        let (whole, later) = of(albedo);
        (whole.reflectance(r) - later.reflectance(r)) / albedo
    };
    for r in [0.0, 0.1, 0.7, 3.0] {
        let [dim, bright] = [1e-3, 0.999].map(|albedo| first_over_albedo(albedo, r));
        assert!((dim / bright - 1.0).abs() < 1e-10, "{r}: {dim} {bright}");
        let limit = of(1e-6).0.reflectance(r) / 1e-6;
        assert!((bright / limit - 1.0).abs() < 1e-4 * (1.0 + r), "{r}: {bright} {limit}");
        let [tenth, twentieth] = [1e-3, 5e-4].map(|albedo| of(albedo).1.reflectance(r));
        assert!((tenth / twentieth / 4.0 - 1.0).abs() < 2e-3 * (1.0 + r), "{r}: {}", tenth / twentieth);
    }
    let (whole, later) = of(0.99);
    // Mostly the shallow source's: exp(-sqrt 3) / 2.
    assert!((whole.total() - later.total() - 0.99 * 0.5 * (-(3.0_f64.sqrt())).exp()).abs() < 1e-3);
}

#[test]
fn the_later_orders_are_a_profile() {
    for (dipole, later) in all().map(|dipole| (dipole, dipole.after_first())) {
        let total = later.total();
        assert!((0.0..=dipole.total()).contains(&total), "{dipole:?}: {total}");
        // In nearly black media the two are equal but for rounding.
        let off = 1e-10 * total + 1e-15 * dipole.total();
        let length = dipole.z_real_mm;
        let radii: Vec<f64> = (0..60).map(|i| length * 0.05 * 1.2_f64.powi(i)).collect();
        let values: Vec<f64> = radii.iter().map(|r| later.reflectance(*r)).collect();
        assert!(
            values.windows(2).all(|w| 0.0 <= w[1] && w[1] <= w[0] * (1.0 + 1e-9) + 1e-15 * dipole.reflectance(0.0)),
            "{dipole:?}: {values:?}"
        );
        for pair in radii.windows(2).step_by(9) {
            let ring = integrate(|r| r * later.reflectance(r), pair[0], pair[1], 0.1 * off);
            assert!((later.tail(pair[0]) - later.tail(pair[1]) - ring).abs() <= off, "{dipole:?}");
            let disc = TAU * (later.tail(0.0) - later.tail(pair[0]));
            assert!((later.disc(pair[0]) - disc).abs() <= off, "{dipole:?}");
        }
        let (receiver, corners) = placed(length, (0.3, 0.2, 0.4));
        let brute = brute_triangle(&later, receiver, corners, 1e-9 * total + 1e-13 * dipole.total());
        assert!(
            (later.triangle(receiver, corners) - brute).abs() <= 1e-7 * total + 1e-12 * dipole.total(),
            "{dipole:?}"
        );
    }
}
