#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;

use super::*;
use crate::math::quadrature::integrate;
use crate::medium::fresnel::{BoundaryFit, boundary_a};
use crate::medium::material::{PRESETS, preset, preset_dipoles};

/// Split and reach in mm, with the numbers of terms that errors of 1e-2, 3e-3 and 1e-3 need.
const RANGES: [((f64, f64), [usize; 3]); 6] = [
    ((0.5, 30.0), [9, 11, 12]),
    ((0.3, 30.0), [10, 12, 13]),
    ((0.8, 30.0), [8, 10, 11]),
    ((0.5, 10.0), [8, 9, 10]),
    ((2.0, 100.0), [9, 10, 11]),
    ((0.1, 65.0), [13, 15, 17]),
];

fn settings((split_mm, reach_mm): (f64, f64), family: Family, terms: usize) -> BasisSettings {
    BasisSettings { split_mm, reach_mm, family, terms: Some(terms), error: 0.0 }
}

fn basis(range: (f64, f64), terms: usize) -> ProfileBasis {
    ProfileBasis::new(&settings(range, Family::Transported, terms))
}

/// sigma_s', sigma_a and eta far outside the training set.
pub(super) fn strangers() -> Vec<Dipole> {
    let media = [
        (0.0, 0.0, 1.3),
        (0.0, 1.0, 1.3),
        (1e6, 0.0, 1.3),
        (1e6, 1e6, 1.3),
        (1e-6, 0.0, 1.3),
        (1e-6, 1e6, 1.3),
        (1e-3, 1e-3, 1.3),
        (1e3, 1e-5, 1.3),
        (1.0, 1e-9, 0.4),
        (1.0, 0.01, 3.0),
        (20.0, 0.0, 3.0),
    ];
    media.into_iter().map(|(s, t, eta)| Dipole::new(s, t, boundary_a(eta, BoundaryFit::Published))).collect()
}

/// Function k of the basis at a distance, from the table.
fn from_table(table: &Table, coefficients: &[f64], r_mm: f64) -> f64 {
    let mut values = vec![0.0; table.terms()];
    table.evaluate((r_mm * r_mm) as f32, &mut values);
    values.iter().zip(coefficients).map(|(&value, coefficient)| f64::from(value) * coefficient).sum()
}

/// Radii dense in `ln(r^2 + split^2)`, and their weights in `Int 2 pi r g dr` (midpoints).
fn fine(split: f64, reach: f64, count: usize) -> impl Iterator<Item = (f64, f64)> {
    let ratio = 1.0 + reach * reach / (split * split);
    let sum = move |i: f64| split * split * ratio.powf(i / count as f64);
    (0..count).map(move |i| {
        let (from, middle, to) = (sum(i as f64), sum(i as f64 + 0.5), sum(i as f64 + 1.0));
        ((middle - split * split).sqrt(), 0.5 * TAU * (to - from))
    })
}

#[test]
fn the_grid_integrates_profiles_over_the_plane() {
    for (range, _) in RANGES {
        let grid = Grid::new(range.0, range.1);
        assert!(grid.squares_mm2.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(grid.areas_mm2.iter().all(|&area| area > 0.0));
        for dipole in preset_dipoles() {
            let far = FarProfile::new(&dipole, range.0);
            let f = |r: f64| TAU * r * far.reflectance(r);
            let tolerance = 1e-10 * far.profile_total();
            let exact = integrate(f, 0.0, range.0, tolerance) + integrate(f, range.0, range.1, tolerance);
            let nodes = grid.squares_mm2.iter().zip(&grid.areas_mm2);
            let sum: f64 = nodes.map(|(&square, area)| area * far.reflectance_at_square(square)).sum();
            assert!((sum - exact).abs() < 2e-6 * far.profile_total(), "{range:?} {dipole:?} {sum} {exact}");
        }
    }
}

#[test]
fn functions_are_orthonormal_after_rounding() {
    let basis = basis((0.5, 30.0), 16);
    let count = basis.nodes_mm().len();
    let functions: Vec<&[f32]> = basis.functions().chunks_exact(count).collect();
    for (i, a) in functions.iter().enumerate() {
        for (j, b) in functions.iter().enumerate() {
            let products = a.iter().zip(*b).zip(basis.weights_mm4());
            let sum: f64 = products.map(|((&a, &b), weight)| f64::from(a) * f64::from(b) * weight).sum();
            assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-6, "{i} {j} {sum}");
        }
    }
}

#[test]
fn an_asked_error_gives_the_expected_number_of_terms() {
    for (range, terms) in RANGES {
        let mut previous = 0;
        for (error, terms) in [1e-2, 3e-3, 1e-3].into_iter().zip(terms) {
            let (split_mm, reach_mm) = range;
            let family = Family::Transported;
            let asked = BasisSettings { split_mm, reach_mm, family, terms: None, error };
            let basis = ProfileBasis::new(&asked);
            assert!(basis.worst_error() <= error, "{range:?} {error} {}", basis.worst_error());
            assert!(basis.terms() >= previous && basis.terms() <= terms, "{range:?} {error} {}", basis.terms());
            let shorter = ProfileBasis::new(&BasisSettings { terms: Some(basis.terms() - 1), ..asked });
            assert!(shorter.worst_error() > error, "{range:?} {error}");
            previous = basis.terms();
        }
    }
}

#[test]
fn errors_that_cannot_be_reached_stop_at_the_most_terms() {
    for error in [0.0, -1.0, f64::NAN] {
        let asked = BasisSettings { split_mm: 0.5, reach_mm: 30.0, family: Family::Transported, terms: None, error };
        assert_eq!(ProfileBasis::new(&asked).terms(), MOST_CHOSEN_TERMS);
    }
    assert_eq!(basis((0.5, 30.0), 0).terms(), 1);
    assert!(basis((0.5, 30.0), usize::MAX).terms() <= MOST_TERMS);
}

#[test]
fn stated_errors_hold_between_the_nodes_and_through_the_table() {
    for (range, [_, _, terms]) in RANGES {
        let basis = basis(range, terms);
        let table = basis.table();
        for dipole in preset_dipoles() {
            let far = FarProfile::new(&dipole, range.0);
            let projection = basis.project(&dipole);
            let difference = |r: f64| (from_table(&table, &projection.coefficients, r) - far.reflectance(r)).abs();
            let sum: f64 = fine(range.0, range.1, 3000).map(|(r, area)| area * difference(r)).sum();
            let error = sum / far.profile_total();
            // Kinks of the absolute value cost the grid's quadrature a few percent.
            assert!(
                (error - projection.error).abs() < 0.08 * projection.error + 1e-6,
                "{range:?} {dipole:?} {error:e}"
            );
            assert!(projection.error < 1e-3, "{range:?} {dipole:?} {:e}", projection.error);
        }
    }
}

#[test]
fn totals_of_the_projection_are_those_of_the_profile() {
    let range = (0.5, 30.0);
    let basis = basis(range, 12);
    let table = basis.table();
    for dipole in preset_dipoles() {
        let far = FarProfile::new(&dipole, range.0);
        let coefficients = basis.project(&dipole).coefficients;
        let sum: f64 = fine(range.0, range.1, 2000).map(|(r, area)| area * from_table(&table, &coefficients, r)).sum();
        let beyond: f64 = dipole.poles().iter().map(|pole| TAU * pole.tail(range.1)).sum();
        let error = (sum + beyond - far.total()) / far.profile_total();
        assert!(error.abs() < 2e-4, "{dipole:?} {error:e}");
    }
}

#[test]
fn the_whitest_materials_are_served_on_small_objects() {
    for name in ["spectralon", "cream"] {
        for reach in [0.6, 1.0, 2.0, 5.0] {
            let basis = basis((0.5, reach), 12);
            for dipole in preset(name).unwrap().properties().dipoles(BoundaryFit::Published) {
                let error = basis.project(&dipole).error;
                assert!(error < 1e-4, "{name} {reach} {error:e}");
            }
        }
    }
}

#[test]
fn the_published_weighting_is_worse_and_fails_beyond_its_range_of_coefficients() {
    let within = |s: f64| s <= 5.0;
    for (range, factors) in [((0.5, 30.0), (2.0, 5.0)), ((0.1, 65.0), (2.0, 100.0))] {
        let ours = basis(range, 12);
        let plain = ProfileBasis::new(&settings(range, Family::Plain, 12));
        assert_eq!(plain.nodes_mm().len(), 650);
        assert!((plain.reach_mm() - 65.0).abs() < 1e-9);
        let worst = |basis: &ProfileBasis, side: bool| {
            let channels = PRESETS.iter().flat_map(|preset| {
                preset.sigma_s_reduced_per_mm.into_iter().zip(preset.properties().dipoles(BoundaryFit::Published))
            });
            let chosen = channels.filter(|&(scattering, _)| within(scattering) == side);
            chosen.map(|(_, dipole)| basis.project(&dipole).error).fold(0.0, f64::max)
        };
        let [inside, outside] = [true, false].map(|side| (worst(&ours, side), worst(&plain, side)));
        assert!(inside.1 > factors.0 * inside.0 && outside.1 > factors.1 * outside.0, "{inside:?} {outside:?}");
        assert!(plain.worst_error() > 5.0 * ours.worst_error());
    }
    // More terms do not help where the samples of r are too few.
    assert!(ProfileBasis::new(&settings((0.1, 65.0), Family::Plain, 24)).worst_error() > 0.3);
}

#[test]
fn twelve_terms_serve_every_measured_channel_of_50_mm_sampled_at_half_a_millimetre() {
    // Split at one spacing, where bakes split at six: what is nearer is integrated with the profile itself.
    let worst = |basis: &ProfileBasis| preset_dipoles().map(|dipole| basis.project(&dipole).error).fold(0.0, f64::max);
    let ours = worst(&basis((0.5, 50.0), 12));
    let plain = worst(&ProfileBasis::new(&settings((0.5, 50.0), Family::Plain, 12)));
    assert!(ours <= 2e-3 && plain > 5.0 * ours, "{ours:e} {plain:e}");
}

#[test]
fn no_material_gives_anything_but_finite_numbers() {
    let basis = basis((0.5, 30.0), 12);
    for dipole in strangers() {
        let projection = basis.project(&dipole);
        assert!(projection.coefficients.iter().all(|s| s.is_finite()), "{dipole:?}");
        assert!(projection.error < 2e-3, "{dipole:?} {}", projection.error);
    }
    let nothing = basis.project(&Dipole::new(0.0, 1.0, 2.0));
    assert!(nothing.error == 0.0 && nothing.coefficients.iter().all(|&s| s == 0.0));
}

#[test]
fn any_settings_give_a_basis() {
    let radii = [f64::NAN, -1.0, 0.0, 1e-300, 1e-3, 1.0, 1e5, 1e300, f64::INFINITY];
    for split_mm in radii {
        for reach_mm in radii {
            let basis = basis((split_mm, reach_mm), 4);
            assert!(basis.terms() >= 1 && basis.reach_mm() >= 2.0 * basis.split_mm(), "{split_mm} {reach_mm}");
            assert!(basis.functions().iter().all(|value| value.is_finite()), "{split_mm} {reach_mm}");
            let marble = preset("marble").unwrap().properties().dipoles(BoundaryFit::Published)[0];
            assert!(basis.project(&marble).error.is_finite());
            let table = basis.table();
            let mut values = vec![0.0; basis.terms()];
            for r2 in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, 1.0] {
                table.evaluate(r2, &mut values);
                assert!(values.iter().all(|value| value.is_finite()), "{split_mm} {reach_mm} {r2}");
            }
        }
    }
}

#[test]
fn the_spread_falls_and_is_what_the_presets_make_of_the_functions() {
    let basis = basis((0.5, 30.0), 12);
    let spread = basis.spread();
    assert_eq!(spread.len(), 12);
    assert!(spread.windows(2).all(|pair| pair[1] < pair[0] && pair[1] > 0.0), "{spread:?}");
    for dipole in preset_dipoles() {
        let total = FarProfile::new(&dipole, 0.5).profile_total();
        let coefficients = basis.project(&dipole).coefficients;
        for (k, (s, spread)) in coefficients.iter().zip(&spread).enumerate() {
            assert!(s.abs() / total < 8.0 * spread, "{k} {} {spread}", s / total);
        }
    }
}

#[test]
fn the_same_settings_give_the_same_bits_on_any_thread() {
    let make = || basis((0.5, 30.0), 12);
    let (here, there) = (make(), std::thread::spawn(make).join().unwrap());
    let bits = |basis: &ProfileBasis| basis.functions().iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&here), bits(&there));
    assert_eq!(here.nodes_mm(), there.nodes_mm());
    assert_eq!(here.weights_mm4(), there.weights_mm4());
    assert_eq!(here.table(), there.table());
}

#[test]
fn parts_make_the_same_basis_again_and_wrong_parts_are_refused() {
    let basis = basis((0.5, 30.0), 8);
    let parts = || (0.5, basis.nodes_mm().to_vec(), basis.weights_mm4().to_vec(), basis.functions().to_vec());
    let (split, nodes, weights, functions) = parts();
    let again = ProfileBasis::from_parts(split, nodes, weights, functions, None).unwrap();
    assert_eq!(again.table(), basis.table());
    for dipole in preset_dipoles() {
        assert_eq!(again.project(&dipole), basis.project(&dipole));
    }
    type Parts = (f64, Vec<f64>, Vec<f64>, Vec<f32>);
    let damages: [fn(&mut Parts); 16] = [
        |p| p.0 = f64::NAN,
        |p| p.0 = 0.0,
        |p| p.0 = 1e3,
        |p| p.0 = 1e-6,
        |p| p.1.clear(),
        |p| p.1[0] = -1.0,
        |p| p.1[3] = p.1[2],
        |p| p.1[3] = f64::NAN,
        |p| *p.1.last_mut().unwrap() = f64::INFINITY,
        |p| p.2[5] = 0.0,
        |p| p.2[5] = f64::INFINITY,
        |p| p.2.push(1.0),
        |p| p.3.clear(),
        |p| p.3.push(1.0),
        |p| p.3[7] = f32::NAN,
        |p| p.3 = p.3.repeat(MOST_TERMS),
    ];
    for (i, damage) in damages.into_iter().enumerate() {
        let mut wrong = parts();
        damage(&mut wrong);
        let (split, nodes, weights, functions) = wrong;
        assert!(ProfileBasis::from_parts(split, nodes, weights, functions, None).is_err(), "damage {i}");
    }
}

#[test]
fn few_stored_nodes_are_interpolated_as_well_as_they_can_be() {
    for count in [2_usize, 3, 4, 7] {
        let nodes: Vec<f64> = (0..count).map(|i| 4.0 * i as f64 / (count - 1) as f64).collect();
        let functions: Vec<f32> = nodes.iter().map(|node| 3.0 - (node * node) as f32).collect();
        let basis = ProfileBasis::from_parts(1.0, nodes, vec![1.0; count], functions, None).unwrap();
        let mut value = [0.0];
        basis.table().evaluate(6.25, &mut value);
        assert!((value[0] + 3.25).abs() < 1e-5, "{count} {value:?}");
    }
}

#[test]
fn the_table_is_accurate_and_continuous() {
    for (range, [_, _, terms]) in RANGES {
        let basis = basis(range, terms);
        let table = basis.table();
        let stride = table.stride();
        assert!(table.terms() == terms && stride >= terms && stride.is_multiple_of(ROW_LANES));
        let split2 = range.0 * range.0;
        let nodes: Vec<f64> = basis.nodes_mm().iter().map(|node| node * node + split2).collect();
        let weighted = |function: &[f32]| {
            let products = function.iter().zip(&nodes).map(|(&value, sum)| f64::from(value).abs() * sum);
            products.fold(0.0, f64::max)
        };
        let largest: Vec<f64> = basis.functions().chunks_exact(nodes.len()).map(weighted).collect();
        let mut worst = 0.0_f64;
        let mut values = vec![0.0; terms];
        for (r, _) in fine(range.0, range.1, 20_000) {
            let r2 = (r * r) as f32;
            table.evaluate(r2, &mut values);
            let exact = basis.interpolation.at(&basis.functions, f64::from(r2));
            for k in 0..terms {
                let error = (f64::from(values[k]) - exact[k]).abs() * (f64::from(r2) + split2);
                worst = worst.max(error / largest[k]);
            }
        }
        println!("{range:?}: {terms} terms, table error {worst:.1e}");
        assert!(worst < 1e-5, "{range:?} {worst:e}");
        let cells = table.index_of(f32::INFINITY).0;
        for cell in 0..cells {
            let (row, next) = (table.row(cell), table.row(cell + 1));
            assert_eq!(row.len(), 4 * stride);
            for k in 0..terms {
                let end = row[k] + (row[stride + k] + (row[2 * stride + k] + row[3 * stride + k]));
                let x = 2.0_f64.powi(cell as i32 / 32) * split2;
                assert!(f64::from(end - next[k]).abs() * x < 2e-6 * largest[k], "{range:?} {cell} {k}");
            }
        }
        assert!(table.row(cells + 1).is_empty());
    }
}

#[test]
fn the_reach_of_the_table_is_that_of_the_basis() {
    let basis = basis((0.5, 30.0), 9);
    let table = basis.table();
    let mut values = [[0.0; 9]; 3];
    for (values, r2) in values.iter_mut().zip([900.0, 901.0, f32::INFINITY]) {
        table.evaluate(r2, values);
    }
    assert!(values[0] == values[1] && values[0] == values[2]);
    let last = basis.nodes_mm().len() - 1;
    for (k, value) in values[0].iter().enumerate() {
        let exact = basis.functions()[k * (last + 1) + last];
        assert!((value - exact).abs() <= 1e-4 * exact.abs() + 1e-9, "{k} {value} {exact}");
    }
    let (first, none) = (table.index_of(-1.0), table.index_of(f32::NAN));
    assert!(first == (0, 0.0) && none == (0, 0.0));
}
