//! Point, spot and area lights at places where irradiance is not what a surface and its samples can tell: inside a body, on its
//! surface, or nearer to it than the samples lie apart; spots narrower than these; and those that shine past it.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::geometry::nearest::NearestPoint;
use crate::light::Light;
use crate::light::cone::Lit;
use crate::scene::Scene;

/// Share of the full sphere of directions that a surface must fill, seen from a place, for the place to be inside.
const INSIDE: f64 = 0.5;

/// A light nearer to the surface than this share of the mesh's diagonal is on it, as far as positions tell.
const ON_SURFACE: f64 = 1e-6;

/// What is doubtful about the place of a light, the worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Doubt {
    /// It shines past the scene.
    Misses,
    /// Within a closed part: light that starts there is not modelled.
    Inside,
    /// On the surface: the surface there sees it edge-on and gets nothing, and half of its light from a little farther out.
    OnSurface,
    /// Nearer to the surface than the samples lie apart: what falls on it is kept, where it falls is not resolved.
    Near,
    /// A spot whose light is narrower where it falls than the samples lie apart.
    Narrow,
}

/// A light at a doubtful place.
#[derive(Clone, Debug, PartialEq)]
pub struct DoubtfulLight {
    /// Its number among the lights.
    pub light: usize,
    /// What is doubtful.
    pub doubt: Doubt,
    /// The place, in world mm: the point, or the centre or a corner of an area.
    pub at_mm: DVec3,
    /// Name of the part that the light is in, on or near; of a light that misses, empty.
    pub part: String,
    /// The nearest point of a surface that light enters, in world mm; of a light that misses, the centre of the scene.
    pub nearest_mm: DVec3,
    /// Distance from there, mm; of a narrow spot, the width of its light there.
    pub distance_mm: f64,
    /// Distance of neighbouring samples, mm; 0 without samples.
    pub spacing_mm: f64,
}

/// The lights at such places, in their order. `samples` is the number of surface samples that lights fall on; 0 where
/// there are none, and nearness is not judged.
pub fn doubtful(scene: &Scene, lights: &[Light], samples: usize) -> Vec<DoubtfulLight> {
    if lights.iter().all(|light| places(light).is_empty()) {
        return Vec::new();
    }
    let triangles = (0..scene.mesh.triangles.len() as u32).filter(|&t| scene.parts.transfers(t));
    let surface = NearestPoint::new(&scene.mesh, triangles);
    let area: f64 = scene.parts.parts.iter().filter(|part| part.transfers()).map(|part| part.area_mm2).sum();
    let spacing_mm = if samples > 0 { (area / samples as f64).sqrt() } else { 0.0 };
    let of_light = |(index, light): (usize, &Light)| {
        if let Some(found) = misses(scene, (index, light), spacing_mm) {
            return Some(found);
        }
        let found = places(light).into_iter().filter_map(|at| doubt_at(scene, &surface, (index, at), spacing_mm));
        found.min_by_key(|found| found.doubt).or_else(|| narrow(scene, &surface, (index, light), spacing_mm))
    };
    lights.iter().enumerate().filter_map(of_light).collect()
}

/// The places of a light at a distance, world mm: the point, or the centre and the corners of an area.
fn places(light: &Light) -> Vec<DVec3> {
    match light {
        Light::Point { at_mm, .. } | Light::Spot { at_mm, .. } => vec![*at_mm],
        Light::Area { at_mm, normal, u, size_mm, .. } => {
            let (u, v) = (0.5 * size_mm[0] * *u, 0.5 * size_mm[1] * normal.cross(*u));
            vec![*at_mm, *at_mm + u + v, *at_mm + u - v, *at_mm - u + v, *at_mm - u - v]
        }
        Light::Constant { .. } | Light::Directional { .. } | Light::Environment { .. } => Vec::new(),
    }
}

/// A spot or an area light whose light falls beside the ball around the scene.
fn misses(scene: &Scene, (light, of): (usize, &Light), spacing_mm: f64) -> Option<DoubtfulLight> {
    let [low, high] = scene.mesh.bounds_local_mm();
    let (centre_mm, radius_mm) = (scene.mesh.origin_mm + 0.5 * (low + high), 0.5 * (high - low).length());
    let (at_mm, is_past) = match of {
        Light::Spot { at_mm, cone, .. } => {
            (*at_mm, cone.falloff(*at_mm).lights_ball(*at_mm, centre_mm, radius_mm) == Lit::Not)
        }
        Light::Area { at_mm, normal, .. } => (*at_mm, (centre_mm - *at_mm).dot(*normal) <= -radius_mm),
        Light::Constant { .. } | Light::Directional { .. } | Light::Point { .. } | Light::Environment { .. } => {
            return None;
        }
    };
    let distance_mm = at_mm.distance(centre_mm);
    let (part, nearest_mm, doubt) = (String::new(), centre_mm, Doubt::Misses);
    is_past.then_some(DoubtfulLight { light, doubt, at_mm, part, nearest_mm, distance_mm, spacing_mm })
}

/// A spot whose cone is narrower at the distance of the surface than the samples lie apart.
fn narrow(
    scene: &Scene,
    surface: &NearestPoint,
    (light, of): (usize, &Light),
    spacing_mm: f64,
) -> Option<DoubtfulLight> {
    let Light::Spot { at_mm, cone, .. } = of else { return None };
    let nearest = surface.find(*at_mm - scene.mesh.origin_mm, DVec3::ZERO, 0.0)?;
    let width_mm = 2.0 * nearest.distance_mm * (0.5 * cone.angle_degrees.to_radians()).tan();
    let part =
        scene.parts.triangle_part.get(nearest.triangle as usize).and_then(|&p| scene.parts.parts.get(p as usize));
    (width_mm < spacing_mm).then(|| DoubtfulLight {
        light,
        doubt: Doubt::Narrow,
        at_mm: *at_mm,
        part: part.map_or_else(String::new, |part| part.name.clone()),
        nearest_mm: scene.mesh.origin_mm + nearest.at_mm,
        distance_mm: width_mm,
        spacing_mm,
    })
}

fn doubt_at(
    scene: &Scene,
    surface: &NearestPoint,
    (light, at_mm): (usize, DVec3),
    spacing_mm: f64,
) -> Option<DoubtfulLight> {
    let mesh = &scene.mesh;
    let local = at_mm - mesh.origin_mm;
    let nearest = surface.find(local, DVec3::ZERO, 0.0)?;
    let of_part = |part: u32| scene.parts.parts.get(part as usize).map_or("", |part| part.name.as_str()).to_owned();
    let part_of = |t: u32| scene.parts.triangle_part.get(t as usize).copied().unwrap_or(u32::MAX);
    let found = |doubt, part| DoubtfulLight {
        light,
        doubt,
        at_mm,
        part: of_part(part),
        nearest_mm: mesh.origin_mm + nearest.at_mm,
        distance_mm: nearest.distance_mm,
        spacing_mm,
    };
    if nearest.distance_mm <= ON_SURFACE * mesh.diagonal_mm() {
        return Some(found(Doubt::OnSurface, part_of(nearest.triangle)));
    }
    let filled = filled_by_parts(scene, local);
    if let Some(part) = filled.iter().position(|share| share.abs() > INSIDE) {
        return Some(found(Doubt::Inside, part as u32));
    }
    (nearest.distance_mm < spacing_mm).then(|| found(Doubt::Near, part_of(nearest.triangle)))
}

/// For each part, the share of all directions that its triangles fill as seen from a point: 1 within a closed surface that
/// is wound outwards, 0 outside of it (the generalised winding number; each triangle by van Oosterom and Strackee 1983).
fn filled_by_parts(scene: &Scene, at: DVec3) -> Vec<f64> {
    let mut filled = vec![0.0; scene.parts.parts.len()];
    for (t, &part) in scene.parts.triangle_part.iter().enumerate() {
        let [a, b, c] = scene.mesh.corners_local_mm(t as u32).map(|p| p - at);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let half = a.dot(b.cross(c)).atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
        if let Some(sum) = filled.get_mut(part as usize) {
            *sum += half / TAU;
        }
    }
    filled
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::geometry::mesh::{Mesh, Placement};
    use crate::geometry::part_table::PartTable;
    use crate::geometry::shapes::{compose, icosphere, inside_out};
    use crate::geometry::source::SourceModel;
    use crate::medium::material::{Medium, preset};

    fn scene(model: SourceModel) -> Scene {
        let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
        let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("ball".to_owned(), Some(0))]);
        let media = vec![Medium { name: "marble".to_owned(), properties: preset("marble").unwrap().properties() }];
        Scene { mesh, parts, media }
    }

    fn told(scene: &Scene, at: DVec3, samples: usize) -> Option<(Doubt, f64)> {
        let lights = [Light::constant(DVec3::ONE).unwrap(), Light::point(at, DVec3::ONE).unwrap()];
        let found = doubtful(scene, &lights, samples).pop()?;
        assert_eq!((found.light, found.part.as_str()), (1, "ball"));
        Some((found.doubt, found.distance_mm))
    }

    #[test]
    fn places_inside_on_and_near_a_hollow_ball_are_told_apart() {
        let scene = scene(compose(&[(icosphere(10.0, 4), DVec3::ZERO), (inside_out(icosphere(5.0, 4)), DVec3::ZERO)]));
        let corner = scene.mesh.position_mm(0);
        let outwards = corner.normalize();
        let samples = 10_000;
        // 1,571 mm^2 over 10,000 samples.
        let spacing = (5.0 * PI * 100.0 / f64::from(samples)).sqrt();
        let samples = samples as usize;
        let (doubt, depth) = told(&scene, 7.5 * DVec3::X, samples).unwrap();
        assert!(doubt == Doubt::Inside && (depth - 2.5).abs() < 0.02, "{depth}");
        assert_eq!(told(&scene, corner, samples).unwrap().0, Doubt::OnSurface);
        let (doubt, distance) = told(&scene, corner + 0.01 * outwards, samples).unwrap();
        assert!(doubt == Doubt::Near && (distance - 0.01).abs() < 1e-6, "{distance}");
        assert_eq!(told(&scene, corner + 0.9 * spacing * outwards, samples).unwrap().0, Doubt::Near);
        for clear in [corner + 1.2 * spacing * outwards, DVec3::ZERO, 30.0 * DVec3::Y] {
            assert_eq!(told(&scene, clear, samples), None, "{clear}");
        }
        assert_eq!(told(&scene, corner + 0.01 * outwards, 0), None, "no samples, no spacing");
    }

    #[test]
    fn light_that_falls_beside_the_scene_is_named_with_its_centre() {
        let scene = scene(compose(&[(icosphere(10.0, 3), 50.0 * DVec3::X)]));
        let told = |light: Light| doubtful(&scene, &[light], 1000).pop().map(|found| (found.doubt, found.nearest_mm));
        let spot = |to: DVec3| Light::spot(50.0 * DVec3::Y, to, 10.0, 0.0, DVec3::ONE).unwrap();
        let (doubt, centre) = told(spot(DVec3::ZERO)).unwrap();
        assert!(doubt == Doubt::Misses && (centre - 50.0 * DVec3::X).length() < 0.2, "{centre}");
        assert_eq!(told(spot(45.0 * DVec3::X)), None);
        // 1,257 mm^2 over 1,000 samples: 1.1 mm apart, and the ball is 57 mm away, where a degree is a millimetre.
        let thin = |degrees: f64| Light::spot(50.0 * DVec3::Y, 50.0 * DVec3::X, degrees, 0.0, DVec3::ONE).unwrap();
        assert_eq!(told(thin(0.5)).map(|told| told.0), Some(Doubt::Narrow));
        assert_eq!(told(thin(2.0)), None);
        let area = |normal: DVec3| Light::area(50.0 * DVec3::Y, normal, [2.0, 2.0], DVec3::ONE, None).unwrap();
        assert_eq!(told(area(DVec3::Y)).map(|told| told.0), Some(Doubt::Misses));
        assert_eq!(told(area(DVec3::NEG_Y)), None);
    }

    #[test]
    fn far_lights_have_no_place_and_a_corner_of_an_area_counts() {
        let scene = scene(icosphere(10.0, 3));
        let far = [Light::constant(DVec3::ONE).unwrap(), Light::directional(DVec3::X, DVec3::ONE).unwrap()];
        assert_eq!(doubtful(&scene, &far, 1000), []);
        let area = |x: f64| Light::area(DVec3::X * x, DVec3::NEG_X, [30.0, 30.0], DVec3::ONE, None).unwrap();
        assert_eq!(doubtful(&scene, &[area(9.0)], 1000)[0].doubt, Doubt::Inside);
        assert_eq!(doubtful(&scene, &[area(20.0)], 1000), []);
    }
}
