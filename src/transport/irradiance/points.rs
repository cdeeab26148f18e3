//! The points of a patch that look at the lights, and irradiance at single points, for methods that take vertices as samples.

use glam::DVec3;

use super::sharp::{Focus, Sharp, graded, pieces};
use super::{Bundle, Illumination, MOST, PROBE_REACH, PROBE_WEIGHTS, SurfacePoint};
use crate::geometry::samples::{Facet, Patch, area};
use crate::parallel::*;
use crate::progress::Progress;

/// Points that are lit together.
const CHUNK: usize = 256;

impl Illumination<'_> {
    /// Irradiance of single points, RGB, each with the index of its medium: one shadow ray for each directional, point and spot light,
    /// as many as a patch has for the others. A point is lit from the side of its normal only. A medium that the scene does not have
    /// gives 0.
    pub fn at_points(&self, points: &[(SurfacePoint, u32)], progress: &dyn Progress) -> Vec<DVec3> {
        progress.start("irradiance", points.len() as u64);
        let mut result = vec![DVec3::ZERO; points.len()];
        result.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).enumerate().for_each(|(chunk, (out, points))| {
            self.some_points(chunk * CHUNK, points, out);
            progress.advance(out.len() as u64);
        });
        progress.finish();
        result
    }

    /// Irradiance of the points from the index `first` on, which turns their sets of directions.
    fn some_points(&self, first: usize, points: &[(SurfacePoint, u32)], out: &mut [DVec3]) {
        let mut bundle = Bundle::default();
        let mut sharp: Vec<Sharp> = self.lights.iter().filter_map(|light| Sharp::new(light, points.len())).collect();
        for (i, ((point, medium), e)) in points.iter().zip(out.iter_mut()).enumerate() {
            let Some((eta, _)) = self.entrance.get(*medium as usize) else { continue };
            let point = std::slice::from_ref(point);
            sharp.iter_mut().for_each(|light| light.collect(i, *eta, point, |point| (point, 1.0)));
            let soft = self.lights.iter().filter(|light| !light.is_sharp());
            *e = soft.map(|light| self.irradiance(light, *medium as usize, first + i, point, &mut bundle)).sum();
        }
        for light in &mut sharp {
            light.trace(self.surface.bvh);
            light.add(out, |_| true);
        }
        for e in out {
            *e = e.min(DVec3::splat(MOST));
        }
    }

    /// Points near the corners and at the centroid of a patch that is one facet, where four points are asked for: no
    /// straight shadow boundary leaves much of a patch unnoticed between them.
    pub(super) fn corners_and_centroid(&self, patch: usize) -> Option<[SurfacePoint; 4]> {
        let [facet] = self.surface.samples.patch(patch) else { return None };
        if self.sampling.points_per_patch.next_power_of_two() as usize != PROBE_WEIGHTS.len() {
            return None;
        }
        let mesh = self.surface.domain.mesh;
        let [a, b, c] = facet.corners_local_mm(mesh);
        let normal = self.surface.patches[patch].normal;
        let centre = (a + b + c) / 3.0;
        let at = |p: DVec3| SurfacePoint { at: centre.lerp(p, PROBE_REACH), normal, triangle: facet.triangle };
        Some([at(a), at(b), at(c), at(centre)])
    }

    /// True if one of the lights is in front of a patch, or if that is not obvious.
    pub(super) fn is_faced(&self, patch: usize, lights: &[Sharp]) -> bool {
        let Patch { centre_mm, normal, .. } = self.surface.patches[patch];
        normal == DVec3::ZERO || lights.iter().any(|light| light.faces(centre_mm, normal))
    }

    /// Centroids of the pieces of a patch that is one facet.
    pub(super) fn pieces_as_points(&self, patch: usize, count: u32, out: &mut Vec<SurfacePoint>) {
        let mesh = self.surface.domain.mesh;
        let [facet] = self.surface.samples.patch(patch) else { return };
        let Patch { centre_mm, normal, .. } = self.surface.patches[patch];
        if count == 1 {
            // Not through the mesh, whose triangles lie in another order than patches.
            out.push(SurfacePoint { at: centre_mm, normal, triangle: facet.triangle });
            return;
        }
        pieces(facet.corners_local_mm(mesh), count, &mut |corners| {
            let at = corners.iter().sum::<DVec3>() / 3.0;
            out.push(SurfacePoint { at, normal, triangle: facet.triangle });
        });
    }

    /// Points of the pieces of a patch that is one facet, so close together that a light lights what each stands for evenly, with its
    /// piece and its share of the patch.
    pub(super) fn graded_points(
        &self,
        patch: usize,
        count: u32,
        focus: Focus,
    ) -> (Vec<SurfacePoint>, Vec<(usize, f64)>) {
        let (mut points, mut of) = (Vec::new(), Vec::new());
        let [facet] = self.surface.samples.patch(patch) else { return (points, of) };
        let normal = self.surface.patches[patch].normal;
        let mut piece = 0;
        pieces(facet.corners_local_mm(self.surface.domain.mesh), count, &mut |corners| {
            graded(corners, focus, &mut |part, share| {
                let at = part.iter().sum::<DVec3>() / 3.0;
                points.push(SurfacePoint { at, normal, triangle: facet.triangle });
                of.push((piece, share / f64::from(count)));
            });
            piece += 1;
        });
        (points, of)
    }

    /// Points that stand for equal areas of a patch.
    pub(super) fn points_of(&self, patch: usize, out: &mut Vec<SurfacePoint>) {
        let mesh = self.surface.domain.mesh;
        let facets = self.surface.samples.patch(patch);
        let count = self.sampling.points_per_patch.next_power_of_two();
        if facets.len() == 1 {
            self.pieces_as_points(patch, count, out);
            return;
        }
        let areas: Vec<f64> = facets.iter().map(|f| area(f.corners_local_mm(mesh))).collect();
        let total: f64 = areas.iter().sum();
        let (mut index, mut passed) = (0, 0.0);
        for k in 0..count.max(facets.len().min(16) as u32) {
            let wanted = total * (f64::from(k) + 0.5) / f64::from(count.max(facets.len().min(16) as u32));
            while index + 1 < facets.len() && passed + areas[index] < wanted {
                passed += areas[index];
                index += 1;
            }
            let Facet { triangle, .. } = facets[index];
            let corners = facets[index].corners_local_mm(mesh);
            let normal = mesh.cross_mm2(triangle).normalize_or_zero();
            out.push(SurfacePoint { at: corners.iter().sum::<DVec3>() / 3.0, normal, triangle });
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::geometry::bvh::NO_TRIANGLE;
    use crate::geometry::shapes;
    use crate::light::Light;
    use crate::medium::fresnel;
    use crate::progress::Silent;
    use crate::transport::irradiance::LightSampling;
    use crate::transport::test_scene::{Fixture, named};

    /// Vertices with the normals of the sphere that they are on.
    fn points(fixture: &Fixture) -> Vec<(SurfacePoint, u32)> {
        let mesh = &fixture.scene.mesh;
        let point = |p: &glam::Vec3| {
            let normal = (p.as_dvec3() + mesh.origin_mm).normalize();
            (SurfacePoint { at: p.as_dvec3(), normal, triangle: NO_TRIANGLE }, 0)
        };
        mesh.local_mm.iter().map(point).collect()
    }

    fn lit(fixture: &Fixture, points: &[(SurfacePoint, u32)], light: Light) -> Vec<DVec3> {
        let (surface, lights) = (fixture.surface(), [light]);
        let eta = fixture.eta();
        Illumination::new(&surface, &lights, &[eta], LightSampling::FAST).unwrap().at_points(points, &Silent)
    }

    /// No vertex of a ball shadows itself, however large the ball, and none on the far side is lit.
    #[test]
    fn vertices_of_a_sphere_have_the_closed_form() {
        for radius in [1e-3, 1.0, 10.0, 1e5] {
            let fixture = Fixture::new(shapes::icosphere(radius, 4), named("marble"), 100);
            let points = points(&fixture);
            let eta = fixture.eta();
            let from = DVec3::new(0.3, 0.5, 0.81).normalize();
            let colour = DVec3::new(1.0, 2.0, 3.0);
            let values = lit(&fixture, &points, Light::directional(from, colour).unwrap());
            let arriving = |cosine: f64| fresnel::transmittance(eta, cosine) * cosine;
            for (value, (p, _)) in values.iter().zip(&points) {
                let cosine = p.normal.dot(from);
                if cosine > 0.02 {
                    assert!((*value - colour * arriving(cosine)).length() < 1e-12, "{radius} {cosine} {value}");
                } else if cosine <= 0.0 {
                    assert_eq!(*value, DVec3::ZERO, "{radius} {cosine}");
                }
            }
            let at = fixture.scene.mesh.origin_mm + 3.0 * radius * from;
            let values = lit(&fixture, &points, Light::point(at, DVec3::splat(radius * radius)).unwrap());
            for (value, (p, _)) in values.iter().zip(&points) {
                let to_light = 3.0 * radius * from - p.at;
                let cosine = p.normal.dot(to_light.normalize());
                if cosine > 0.02 {
                    let expected = arriving(cosine) * (radius / to_light.length()).powi(2);
                    assert!((value.x / expected - 1.0).abs() < 1e-9, "{radius} {cosine} {value}");
                }
            }
            let values = lit(&fixture, &points, Light::constant(DVec3::ONE).unwrap());
            let expected = PI * fresnel::diffuse_transmittance(eta);
            // The facets around a vertex leave a little more than the half space free, what is below the horizon does not count.
            for value in values {
                assert!((value.x / expected - 1.0).abs() < 0.01, "{radius}: {value} {expected}");
            }
        }
    }

    #[test]
    fn points_without_a_normal_or_a_medium_are_dark_and_shadows_fall() {
        let near = shapes::icosphere(1.0, 2);
        let two = shapes::compose(&[(near.clone(), DVec3::ZERO), (near, DVec3::X * 3.0)]);
        let fixture = Fixture::new(two, named("marble"), 100);
        let at = -fixture.scene.mesh.origin_mm - 1.0 * DVec3::X;
        let point =
            |normal: DVec3, at: DVec3, medium: u32| (SurfacePoint { at, normal, triangle: NO_TRIANGLE }, medium);
        let points = [
            point(DVec3::NEG_X, at, 0),
            point(DVec3::ZERO, at, 0),
            point(DVec3::NEG_X, at, 7),
            point(DVec3::NEG_X, at + 3.0 * DVec3::X, 0),
        ];
        let values = lit(&fixture, &points, Light::directional(DVec3::NEG_X, DVec3::ONE).unwrap());
        assert!(values[0].x > 0.9 && values[1..].iter().all(|v| *v == DVec3::ZERO), "{values:?}");
    }
}
