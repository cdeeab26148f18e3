//! Poses whose errors are known.
#![allow(clippy::unwrap_used)]

use glam::{DMat3, DVec3};

use super::{Advice, Asked, Lighting, PoseCheck, PoseError, pose_check};
use crate::asset::{Asset, Provenance};
use crate::error::{ExitCode, Result};
use crate::evaluate::BakeSettings;
use crate::geometry::mesh::{Mesh, Placement, Positions};
use crate::geometry::part_table::PartTable;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::light::{Light, LightKind};
use crate::measure::probes::constant;
use crate::measure::trust::Subject;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::{Medium, preset};
use crate::medium::profile::Profile;
use crate::methods::built_in;
use crate::progress::Silent;
use crate::scene::Scene;

const ALL: Asked = Asked { good_below: 0.02, vertices: None, samples: Some(4000), keeps_vertices: true };

fn asset(model: SourceModel, parts: &[usize]) -> Asset {
    let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
    let of_triangle = parts.iter().zip(0..).flat_map(|(&count, part)| vec![part; count]).collect();
    let names = (0..parts.len()).map(|part| (format!("part {part}"), Some(0))).collect();
    let parts = PartTable::new(&mesh, of_triangle, names);
    let media = vec![Medium { name: "marble".to_owned(), properties: preset("marble").unwrap().properties() }];
    let scene = Scene { mesh, parts, media };
    let settings = BakeSettings {
        samples: Some(600),
        for_lights: [LightKind::Directional].into_iter().collect(),
        ..BakeSettings::new(0.02)
    };
    let registry = built_in();
    let method = *registry.methods().iter().find(|m| m.name() == "editable").unwrap();
    method.recipe(&[], settings).unwrap().bake(scene, Provenance::default(), &Silent).unwrap()
}

fn moved(asset: &Asset, to: impl Fn(usize, DVec3) -> DVec3) -> Positions {
    let mesh = &asset.scene.mesh;
    let positions: Vec<DVec3> = (0..mesh.local_mm.len()).map(|v| to(v, mesh.position_mm(v as u32))).collect();
    mesh.posed(&positions, 1.0).unwrap()
}

fn check(asset: &Asset, poses: &[Positions], lights: &[Light], asked: Asked) -> Result<PoseCheck> {
    let mut evaluator = built_in().open(std::sync::Arc::new(asset.clone())).unwrap();
    let subject = Subject { evaluator: evaluator.as_mut(), asset, profile: None, admit: &|_| Ok(()) };
    let lights: Vec<Lighting> =
        lights.iter().map(|light| Lighting { name: light.to_string(), lights: vec![light.clone()] }).collect();
    let named: Vec<_> = poses.iter().enumerate().map(|(index, pose)| (format!("pose {index}"), pose.clone())).collect();
    pose_check(subject, &named, &lights, asked, &Silent)
}

fn sun() -> Light {
    Light::Directional { from: DVec3::new(1.0, 2.0, 3.0).normalize(), irradiance: DVec3::ONE }
}

#[test]
fn the_rest_pose_has_the_error_of_the_asset_alone_and_a_rigid_motion_that_of_light() {
    let asset = asset(shapes::bumpy_head(8.0, 2), &[320]);
    let turn = DMat3::from_axis_angle(DVec3::new(0.2, 1.0, 0.1).normalize(), 1.0);
    let poses = [
        moved(&asset, |_, p| p),
        moved(&asset, |_, p| p + DVec3::new(30.0, -4.0, 1.0)),
        moved(&asset, |_, p| turn * p),
        moved(&asset, |_, p| DVec3::new(p.x, p.y * if p.y > 0.0 { 3.0 } else { 1.0 }, p.z)),
    ];
    let found = check(&asset, &poses, &[sun()], ALL).unwrap();
    let figures = |pose: &PoseError| [pose.shown.rms, pose.light.rms, pose.transport.rms, pose.relit.rms];
    let [still, shifted, turned, stretched] = found.poses.as_slice() else { panic!("four poses") };
    assert_eq!((still.light.rms, still.transport.rms, still.light.worst, still.transport.worst), (0.0, 0.0, 0.0, 0.0));
    assert_eq!((still.shown, still.relit), (found.own, found.own));
    assert!(found.own.rms > 1e-4 && found.own.rms < 0.05, "{:?}", found.own);
    // Light from far away is the same everywhere.
    assert!(shifted.transport.rms < 1e-5 && shifted.light.rms < 2e-3, "{:?}", figures(shifted));
    assert!(turned.transport.rms < 1e-4 && turned.light.rms > 0.2 && turned.shown.rms > 0.2, "{:?}", figures(turned));
    assert!((turned.relit.rms - found.own.rms).abs() < found.own.rms, "{:?}", figures(turned));
    assert_eq!(turned.advice, if turned.relit.rms <= found.good_below { Advice::Light } else { Advice::Finer });
    assert!(stretched.transport.rms > 0.02 && stretched.advice == Advice::Bake, "{:?}", figures(stretched));
    assert_eq!(found.worst(), Some(2));
    // Errors of vertices are those whose largest is told.
    let most = |column: &[f32]| column.iter().fold(0.0_f32, |most, e| most.max(*e));
    assert!((f64::from(most(&turned.vertices.columns[0])) - turned.shown.worst).abs() < 1e-4);
    assert_eq!(turned.vertices.exact.len(), asset.scene.mesh.local_mm.len());
}

/// Points of a ball are at distances r with the density r / (2 R^2), so that radiosity under even light is `E Int_0^2R R_d 2 pi r dr`.
#[test]
fn a_ball_that_grows_has_the_transport_error_of_the_closed_form_and_none_of_light() {
    let (radius, growth) = (2.0, 1.5);
    let asset = asset(shapes::icosphere(radius, 3), &[1280]);
    let poses = [moved(&asset, |_, p| growth * p)];
    let found = check(&asset, &poses, &[constant()], ALL).unwrap();
    let dipoles = preset("marble").unwrap().properties().dipoles(BoundaryFit::Published);
    let expected = dipoles.each_ref().map(|dipole| {
        let within = |far: f64| {
            let steps = 20_000;
            let ring = |i: usize| {
                // Squares of the steps: R_d changes most near 0.
                let [from, to] = [i, i + 1].map(|i| far * (i as f64 / steps as f64).powi(2));
                let r = 0.5 * (from + to);
                dipole.reflectance(r) * r * (to - from)
            };
            (0..steps).map(ring).sum::<f64>()
        };
        1.0 - within(2.0 * radius) / within(2.0 * growth * radius)
    });
    let expected = expected.into_iter().fold(0.0, f64::max);
    let pose = &found.poses[0];
    assert!(expected > 0.02 && (pose.transport.rms / expected - 1.0).abs() < 0.02, "{:?} {expected}", pose.transport);
    assert!(pose.light.rms < 1e-6, "{:?}", pose.light);
    assert!((pose.deformation.volume_change.unwrap() - (growth.powi(3) - 1.0)).abs() < 1e-4);
}

#[test]
fn parts_that_move_as_wholes_change_light_alone() {
    let model = shapes::compose(&[
        (shapes::icosphere(3.0, 2), DVec3::ZERO),
        (shapes::icosphere(3.0, 2), DVec3::new(12.0, 0.0, 0.0)),
    ]);
    let asset = asset(model, &[320, 320]);
    // The second ball comes into the light of the first.
    let sun = Light::Directional { from: DVec3::Y, irradiance: DVec3::ONE };
    let above = |v: usize, p: DVec3| if v < 162 { p } else { p + DVec3::new(-12.0, 8.0, 0.0) };
    let found = check(&asset, &[moved(&asset, above)], &[sun], ALL).unwrap();
    let pose = &found.poses[0];
    assert!(
        pose.transport.rms < 1e-4 && pose.light.rms > 0.3 && pose.deformation.longest_edge < 1.001,
        "{:?}",
        pose.transport
    );
}

#[test]
fn figures_do_not_depend_on_threads_and_fewer_vertices_are_told() {
    let asset = asset(shapes::bumpy_head(8.0, 2), &[320]);
    let poses = [moved(&asset, |_, p| DVec3::new(p.x + 0.05 * p.y * p.y, p.y, p.z))];
    let lights = [sun(), constant()];
    let on = |threads: usize, asked: Asked| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| check(&asset, &poses, &lights, asked).unwrap())
    };
    let all = on(1, ALL);
    assert_eq!(all, on(3, ALL));
    let few = on(2, Asked { good_below: 0.5, vertices: Some(40), keeps_vertices: false, ..ALL });
    assert_eq!((few.vertices, all.vertices, few.good_below), ([40, 162], [162, 162], 0.5));
    let [one, other] = [&few, &all].map(|found| found.poses[0].shown.rms);
    assert!((one / other - 1.0).abs() < 0.3, "{one} {other}");
    assert!(few.poses[0].vertices.exact.is_empty() && few.poses[0].advice == Advice::Keep);
    // Nothing is relative to black.
    let black = Light::Constant { radiance: DVec3::ZERO };
    assert_eq!(check(&asset, &poses, &[black], ALL).unwrap_err().code(), ExitCode::CommandLine);
    // A pose that is a point in one place is measured all the same.
    let collapsed = moved(&asset, |_, p| if p.y > 6.0 { DVec3::new(0.0, 6.0, 0.0) } else { p });
    let found = check(&asset, &[collapsed], &[sun()], ALL).unwrap();
    assert!(found.poses[0].shown.rms.is_finite() && found.poses[0].deformation.shortest_edge == 0.0);
}
