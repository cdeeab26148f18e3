#![allow(clippy::unwrap_used)]

use super::tests::strangers;
use super::*;
use crate::medium::material::preset_dipoles;

/// Split and reach in mm, number of terms, and stated T1 of all judges.
const STATED: [((f64, f64), usize, f64); 4] =
    [((0.5, 20.0), 11, 5e-3), ((0.5, 50.0), 13, 5e-3), ((0.64, 30.0), 13, 2e-3), ((2.0, 100.0), 14, 2e-3)];

fn settings((split_mm, reach_mm): (f64, f64), terms: Option<usize>, error: f64) -> BasisSettings {
    BasisSettings { split_mm, reach_mm, family: Family::Ladder, terms, error }
}

fn ladder(range: (f64, f64), terms: usize) -> ProfileBasis {
    ProfileBasis::new(&settings(range, Some(terms), 0.0))
}

/// Known errors in transported light of ladders of Gaussians: 11 steps for 0.5 mm in 20 mm, 13 in 50 mm, 5e-3.
#[test]
fn ladders_reach_the_stated_errors() {
    for (range, terms, stated) in STATED {
        let basis = ladder(range, terms);
        let worst = basis.worst_error();
        let published = preset_dipoles().map(|dipole| basis.project(&dipole).error).fold(0.0, f64::max);
        println!("{range:?} {terms} terms: judges {worst:.1e}, published {published:.1e}");
        assert!(worst <= stated && published <= worst, "{range:?} {worst:e}");
    }
}

#[test]
fn an_asked_error_gives_the_shortest_ladder() {
    for range in [(0.5, 30.0), (0.1, 65.0)] {
        for error in [1e-2, 1.5e-3] {
            let basis = ProfileBasis::new(&settings(range, None, error));
            println!("{range:?} {error:e}: {} terms, worst {:.1e}", basis.terms(), basis.worst_error());
            assert!(basis.worst_error() <= error);
            assert!(ladder(range, basis.terms() - 1).worst_error() > error, "{range:?} {error}");
        }
    }
    for error in [0.0, f64::NAN] {
        assert_eq!(ProfileBasis::new(&settings((0.5, 30.0), None, error)).terms(), MOST_CHOSEN_TERMS);
    }
}

#[test]
fn nothing_is_negative_and_totals_are_kept() {
    let range = (0.5, 30.0);
    for terms in [1, 2, 5, 12, 16, 32] {
        let basis = ladder(range, terms);
        assert_eq!((basis.terms(), basis.totals().unwrap().len()), (terms, terms));
        assert!(basis.functions().iter().all(|&value| value >= 0.0));
        let table = basis.table();
        let mut largest = vec![0.0f32; terms];
        let mut values = vec![0.0; terms];
        table.evaluate(0.0, &mut largest);
        for i in 0..20_000 {
            let r = 30.0 * i as f32 / 19_999.0;
            table.evaluate(r * r, &mut values);
            for (k, (value, largest)) in values.iter().zip(&largest).enumerate() {
                assert!(*value >= -1e-7 * largest, "{terms} {k} {r} {value:e} {largest:e}");
            }
        }
        for dipole in &preset_dipoles().chain(strangers().into_iter().take(8)).collect::<Vec<_>>() {
            let far = FarProfile::new(dipole, range.0);
            let projection = basis.project(dipole);
            assert!(projection.coefficients.iter().all(|&s| s >= 0.0 && s.is_finite()), "{dipole:?}");
            let totals = projection.coefficients.iter().zip(basis.totals().unwrap());
            let energy: f64 = totals.map(|(s, total)| s * total).sum();
            let expected = far.total_within(range.1);
            assert!((energy - expected).abs() <= 1e-12 * far.profile_total(), "{dipole:?} {energy} {expected}");
        }
        // The totals are those of the functions between the nodes as well.
        for (k, total) in basis.totals().unwrap().iter().enumerate() {
            let count = 60_000;
            let step = 30.0 / count as f64;
            let sum = |sum: f64, i| {
                let r = (i as f64 + 0.5) * step;
                sum + std::f64::consts::TAU * r * step * basis.interpolation.at(&basis.functions, r * r)[k]
            };
            let sum = (0..count).fold(0.0, sum);
            assert!((sum - total).abs() < 2e-5, "{terms} {k} {sum} {total}");
        }
    }
}

#[test]
fn functions_are_far_parts_of_gaussians() {
    let (split, reach, terms) = (0.5, 30.0, 13);
    let basis = ladder((split, reach), terms);
    let deviations = ladder::deviations_mm(split, reach, terms);
    let ratio = deviations[1] / deviations[0];
    assert!(deviations.len() == terms - 1 && (deviations[0] - 0.25 * split * ratio).abs() < 1e-12);
    assert!((deviations[terms - 2] - 0.8 * reach).abs() < 1e-9 * reach);
    let at = |k: usize, r: f64| basis.interpolation.at(&basis.functions, r * r)[k];
    for (k, deviation) in deviations.iter().enumerate() {
        let gaussian = |r: f64| (-0.5 * (r / deviation).powi(2)).exp() / at(k, split) * at(k, split);
        for r in [0.6, 1.0, 2.0, 3.0] {
            let (found, expected) = (at(k, r) / at(k, split), gaussian(r) / gaussian(split));
            assert!((found - expected).abs() < 1e-5, "{k} {r} {found} {expected}");
        }
        // Inside, the parabola in r^2 with the same slope and curvature.
        let x = 0.5 * (split / deviation).powi(2);
        assert!((at(k, 0.0) / at(k, split) / (1.0 + x + 0.5 * x * x) - 1.0).abs() < 1e-5, "{k}");
    }
    assert!((at(terms - 1, 0.0) / at(terms - 1, 29.0) - 1.0).abs() < 1e-6);
}

#[test]
fn a_sum_of_its_own_functions_is_found_again_and_parts_make_the_same_ladder() {
    let basis = ladder((0.5, 30.0), 13);
    let parts = |totals| {
        let (nodes, weights) = (basis.nodes_mm().to_vec(), basis.weights_mm4().to_vec());
        ProfileBasis::from_parts(0.5, nodes, weights, basis.functions().to_vec(), Some(totals))
    };
    let again = parts(basis.totals().unwrap().to_vec()).unwrap();
    for dipole in preset_dipoles() {
        assert_eq!(again.project(&dipole), basis.project(&dipole));
    }
    for wrong in [vec![1.0; 12], vec![0.0; 13], vec![f64::NAN; 13], vec![f64::INFINITY; 13]] {
        assert!(parts(wrong).is_err());
    }
    let here = std::thread::spawn(|| ladder((0.5, 30.0), 13)).join().unwrap();
    assert!(here.functions().iter().zip(basis.functions()).all(|(a, b)| a.to_bits() == b.to_bits()));
}
