use super::*;
use crate::geometry::mesh::Mesh;
use crate::geometry::shapes;
use crate::math::random::uniform;
use crate::transport::test_scene::{Fixture, named};

fn fixture(samples: usize) -> (Fixture, Samples, Vec<Patch>) {
    let fixture = Fixture::new(shapes::icosphere(10.0, 3), named("marble"), samples);
    let samples = fixture.samples.in_tree_order(&fixture.scene.mesh, &fixture.scene.parts);
    let patches = crate::geometry::samples::patches(&fixture.scene.mesh, &samples);
    (fixture, samples, patches)
}

fn walk(tree: &BalancedTree, visit: &mut impl FnMut(Node)) {
    let mut stack: Vec<Node> = tree.root(0).into_iter().collect();
    while let Some(node) = stack.pop() {
        visit(node);
        if !node.is_leaf() {
            stack.extend(node.children());
        }
    }
}

#[test]
fn tree_order_keeps_every_patch_and_every_name_is_used_once() {
    for count in [1, 2, 3, 1000, 1280, 5000] {
        let (fixture, samples, patches) = fixture(count);
        let key = |s: &Samples| {
            let mut all: Vec<Vec<crate::geometry::samples::Facet>> =
                (0..s.len()).map(|i| s.patch(i).to_vec()).collect();
            all.sort();
            all
        };
        assert_eq!(key(&samples), key(&fixture.samples));
        let tree = BalancedTree::new(&samples, &patches);
        let mut names = vec![0; samples.len()];
        let mut leaves = 0;
        walk(&tree, &mut |node| {
            if node.is_leaf() {
                leaves += 1;
            } else {
                names[node.name()] += 1;
            }
        });
        assert_eq!(leaves, count);
        assert!(names[1..].iter().all(|&n| n == 1) && names[0] == 0);
    }
}

#[test]
fn cells_hold_the_corners_and_add_up_and_halves_are_compact() {
    let (fixture, samples, patches) = fixture(3000);
    let tree = BalancedTree::new(&samples, &patches);
    let mesh: &Mesh = &fixture.scene.mesh;
    let mut radii = 0.0;
    walk(&tree, &mut |node| {
        let cell = tree.cell(node, &patches);
        let range = node.first as usize..node.end as usize;
        let area: f64 = patches[range.clone()].iter().map(|p| p.area_mm2).sum();
        assert!((cell.area_mm2 - area).abs() < 1e-9 * area);
        if node.end - node.first == 375 {
            radii += cell.radius_mm;
        }
        if node.end - node.first < 64 {
            for corner in range.flat_map(|p| samples.patch(p)).flat_map(|f| f.corners_local_mm(mesh)) {
                assert!(corner.distance(cell.centre_mm) <= cell.radius_mm * (1.0 + 1e-9));
            }
        }
    });
    // An eighth of the sphere: a disc of that area has a radius of 7.07 mm.
    assert!(radii / 8.0 < 12.0, "{}", radii / 8.0);
}

#[test]
fn details_rebuild_the_irradiance_and_vanish_under_a_constant() {
    let (_, samples, patches) = fixture(777);
    let irradiance: Vec<DVec3> =
        (0..777).map(|i| 1e6 * DVec3::new(uniform(1, i, 0), uniform(1, i, 1), uniform(1, i, 2))).collect();
    let tree = BalancedTree::new(&samples, &patches);
    let light = LightDetails::new(&samples, &patches, &irradiance);
    let mean_of = |node: Node| {
        let range = node.first as usize..node.end as usize;
        let flux: DVec3 = range.clone().map(|i| irradiance[i] * patches[i].area_mm2).sum();
        flux / patches[range].iter().map(|p| p.area_mm2).sum::<f64>()
    };
    walk(&tree, &mut |node| {
        if !node.is_leaf() {
            let [a, b] = node.children().map(mean_of);
            let detail = light.details[node.name()].map(|d| f64::from(d) * light.scale);
            assert!((DVec3::from_array(detail) - (a - b)).length() < 1e-6 * 1e6);
        }
    });
    let constant = LightDetails::new(&samples, &patches, &vec![DVec3::splat(3.0); 777]);
    assert!(constant.details.iter().flatten().all(|d| d.abs() < 1e-6));
    assert!((f64::from(constant.means[0][1]) * constant.scale - 3.0).abs() < 1e-6);
    let dark = LightDetails::new(&samples, &patches, &vec![DVec3::ZERO; 777]);
    assert!(dark.details.iter().flatten().chain(&dark.means[0]).all(|&d| d == 0.0));
}
