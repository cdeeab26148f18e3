use super::*;
use crate::geometry::samples::Samples;
use crate::geometry::shapes;
use crate::math::random::uniform;
use crate::medium::profile_basis::{BasisSettings, Family, ProfileBasis};
use crate::transport::balanced_tree::LightDetails;
use crate::transport::test_scene::{Fixture, named};

const SPLIT_MM: f64 = 2.0;

/// A sphere of 20 mm, its samples in tree order, and a basis.
struct Sphere {
    samples: Samples,
    patches: Vec<Patch>,
    tree: BalancedTree,
    basis: ProfileBasis,
    spread: Vec<f64>,
    expected: Vec<f32>,
}

impl Sphere {
    fn new(count: usize) -> Self {
        let fixture = Fixture::new(shapes::icosphere(10.0, 3), named("marble"), count).in_tree_order();
        let Fixture { samples, patches, .. } = fixture;
        let settings = BasisSettings {
            split_mm: SPLIT_MM,
            reach_mm: 22.0,
            family: Family::Transported,
            terms: Some(6),
            error: 0.0,
        };
        let basis = ProfileBasis::new(&settings);
        Self {
            tree: BalancedTree::new(&samples, &patches),
            spread: basis.spread(),
            expected: vec![0.3; samples.len()],
            samples,
            patches,
            basis,
        }
    }

    fn rows(&self, receivers: &[DVec3], precision: Precision) -> Rows {
        let table = self.basis.table();
        let transport = FarTransport {
            tree: &self.tree,
            patches: &self.patches,
            table: &table,
            spread: &self.spread,
            expected: &self.expected,
            smooth_mm: &[0.5 * SPLIT_MM; 6],
            precision,
        };
        transport.rows(receivers, 0, u16::MAX)
    }

    /// Typical far radiosity of one receiver and function from its rows.
    fn rebuilt(&self, rows: &Rows, light: &LightDetails, lane: usize, k: usize) -> f64 {
        let mut sum = f64::from(rows.sums[lane * 6 + k]) * f64::from(light.means[0][0]);
        let mut values = rows.values.iter();
        for (&node, &mask) in rows.nodes.iter().zip(&rows.masks) {
            for kept in (0..6).filter(|kept| mask >> kept & 1 == 1) {
                let row = values.next().unwrap();
                if kept == k {
                    sum += f64::from(row[lane]) * f64::from(light.details[node as usize][0]);
                }
            }
        }
        assert!(values.next().is_none());
        self.spread[k] * sum * light.scale
    }

    /// Typical far radiosity of one receiver and function, summed over every sample.
    fn all_pairs(&self, receiver: DVec3, irradiance: &[DVec3], k: usize) -> f64 {
        let table = self.basis.table();
        let mut values = [0.0; 8];
        let pairs = self.patches.iter().zip(irradiance).map(|(patch, e)| {
            table.evaluate(patch.centre_mm.distance_squared(receiver) as f32, &mut values);
            e.x * patch.area_mm2 * f64::from(values[k])
        });
        self.spread[k] * pairs.sum::<f64>()
    }

    fn light(&self, irradiance: &[DVec3]) -> LightDetails {
        LightDetails::new(&self.samples, &self.patches, irradiance)
    }
}

fn receivers() -> Vec<DVec3> {
    (0..11).map(|i| 10.0 * DVec3::new(0.1 * f64::from(i), 3.0, 1.0).normalize()).collect()
}

/// Sunlight with a shadow boundary.
fn sun(patches: &[Patch]) -> Vec<DVec3> {
    let lit = |p: &Patch| if p.centre_mm.x + p.centre_mm.z > 1.0 { p.centre_mm.y.max(0.0) / 10.0 } else { 0.0 };
    patches.iter().map(|p| DVec3::splat(lit(p))).collect()
}

fn precision(opening: f64, threshold: f64) -> Precision {
    Precision { opening, threshold, keep: threshold }
}

#[test]
fn rows_without_loss_are_the_sum_over_all_samples() {
    let sphere = Sphere::new(2500);
    let noise: Vec<DVec3> = (0..2500).map(|i| DVec3::splat(uniform(5, i, 0))).collect();
    let rows = sphere.rows(&receivers(), precision(0.0, 0.0));
    assert_eq!(rows.nodes.len(), sphere.patches.len() - 1, "every node");
    for irradiance in [noise, sun(&sphere.patches)] {
        let light = sphere.light(&irradiance);
        for (lane, &receiver) in receivers().iter().enumerate() {
            for k in 0..6 {
                let (a, b) = (sphere.rebuilt(&rows, &light, lane, k), sphere.all_pairs(receiver, &irradiance, k));
                assert!((a - b).abs() < 2e-6, "{a} {b}");
            }
        }
    }
}

#[test]
fn the_hierarchy_converges_with_its_opening() {
    let sphere = Sphere::new(20_000);
    let irradiance = sun(&sphere.patches);
    let light = sphere.light(&irradiance);
    let exact: Vec<f64> = receivers().iter().map(|&r| sphere.all_pairs(r, &irradiance, 0)).collect();
    let error = |opening: f64| {
        let precision = Precision { opening, threshold: 1.0, keep: 0.0 };
        let rows = sphere.rows(&receivers(), precision);
        let differences = exact.iter().enumerate().map(|(lane, e)| (sphere.rebuilt(&rows, &light, lane, 0) - e).abs());
        (differences.fold(0.0, f64::max) / exact[0], rows.nodes.len())
    };
    let (coarse, fine) = (error(0.4), error(0.1));
    assert!(fine.0 < 2e-3 && fine.0 < 0.3 * coarse.0, "{coarse:?} {fine:?}");
    assert!(coarse.1 < fine.1 && fine.1 < 19_999);
}

#[test]
fn what_is_dropped_costs_what_was_predicted_and_nothing_under_a_constant() {
    let sphere = Sphere::new(4000);
    let members = receivers();
    let threshold = 1e-3;
    let all = sphere.rows(&members, Precision { opening: 0.05, threshold, keep: 0.0 });
    let kept = sphere.rows(&members, precision(0.05, threshold));
    assert!(3 * kept.values.len() < all.values.len(), "{} of {}", kept.values.len(), all.values.len());
    let constant = sphere.light(&vec![DVec3::splat(2.0); 4000]);
    // Noise has a detail of sqrt(12 / n) of its deviation at a node of n samples: all below what is expected here.
    let irradiance: Vec<DVec3> = (0..4000).map(|i| DVec3::splat(uniform(6, i, 0))).collect();
    let light = sphere.light(&irradiance);
    let mut squares = 0.0;
    for lane in 0..members.len() {
        for k in 0..6 {
            let difference = sphere.rebuilt(&all, &light, lane, k) - sphere.rebuilt(&kept, &light, lane, k);
            squares += difference * difference;
            let (a, b) = (sphere.rebuilt(&all, &constant, lane, k), sphere.rebuilt(&kept, &constant, lane, k));
            assert!((a - b).abs() < 1e-6 * a.abs().max(1.0), "{a} {b}");
        }
    }
    let rms = (squares / members.len() as f64).sqrt();
    assert!(rms > 1e-5 && rms < 8e-3, "{rms}");
}

#[test]
fn odd_input_gives_empty_rows() {
    let sphere = Sphere::new(1);
    let rows = sphere.rows(&receivers()[..1], precision(0.1, 0.0));
    assert!(rows.nodes.is_empty() && rows.sums[0] > 0.0);
    let rows = sphere.rows(&[], precision(0.1, 0.0));
    assert!(rows.sums.is_empty());
}
