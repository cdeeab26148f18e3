//! Light that crosses a body without being scattered or absorbed (order 0): what an eye sees of the lights through thin parts.
//!
//! The eye's direction is refracted into the body and followed, attenuated by `exp(-sigma_t' d)`, to where it meets the surface again; there
//! part of it leaves, refracted once more, and the rest is reflected inside and goes on. What leaves sees the radiance of skies
//! and of area lights. Directions take the coefficients of similarity theory, as the kernels do, whose orders begin with the first
//! collision: with single scattering and the exitance every photon counts once.
//!
//! Neglected: light that meets another surface behind the body, which the inter-reflection of exitance holds, and directional, point
//! and spot lights, which no eye ray meets.

use glam::DVec3;

use super::background::{Backdrop, Background};
use super::lights::Rectangle;
use super::normals::ShadingNormals;
use crate::geometry::bvh::{Bvh, Ray, offset_origin};
use crate::light::Light;
use crate::medium::fresnel::{reflectance_inside, refracted_cosine, transmittance};
use crate::scene::Scene;
use crate::transport::single_scattering::ExitPoint;
use crate::transport::single_scattering::interface::refracted;

/// Surfaces that a way meets at most.
const MOST_SURFACES: usize = 32;

/// Share of the light below which a way ends.
const LEAST_SHARE: f64 = 1e-4;

/// Light straight through the translucent parts of a scene.
pub(super) struct Straight<'a> {
    scene: &'a Scene,
    bvh: &'a Bvh,
    skies: Backdrop<'a>,
    rectangles: Vec<Rectangle>,
}

impl<'a> Straight<'a> {
    pub(super) fn new(scene: &'a Scene, bvh: &'a Bvh, lights: &'a [Light]) -> Self {
        let origin = scene.mesh.origin_mm;
        let rectangles = lights.iter().filter_map(|light| Rectangle::new(light, origin)).collect();
        Self { scene, bvh, skies: Backdrop::new(Background::Environment, lights), rectangles }
    }

    /// Radiance towards the eye, RGB, of light that leaves a medium at a point of its boundary; local coordinates.
    pub(super) fn radiance(
        &self,
        normals: &ShadingNormals,
        exit: &ExitPoint,
        (medium, to_eye): (usize, DVec3),
    ) -> DVec3 {
        let Scene { mesh, parts, media, .. } = self.scene;
        let Some(properties) = media.get(medium).map(|m| &m.properties) else { return DVec3::ZERO };
        let (eta, sigma_t) = (properties.eta_inside_over_outside, properties.sigma_t_reduced_per_mm());
        let Some(inside) = refracted(eta, to_eye, exit.normal).map(|inside| -inside) else { return DVec3::ZERO };
        let (mut at, mut geometric) = (exit.at_mm, exit.geometric);
        let mut direction = kept_inside(inside, geometric);
        let mut share = DVec3::splat(transmittance(eta, to_eye.dot(exit.normal)));
        let mut sum = DVec3::ZERO;
        for _ in 0..MOST_SURFACES {
            let ray = Ray::new(offset_origin(at.as_vec3(), -geometric.as_vec3()), direction.as_vec3());
            let Some(hit) = self.bvh.closest(&ray) else { break };
            let (u, v) = (f64::from(hit.u), f64::from(hit.v));
            let weights = [1.0 - u - v, u, v];
            let [a, b, c] = mesh.corners_local_mm(hit.triangle);
            let next = a * weights[0] + b * weights[1] + c * weights[2];
            geometric = normals.geometric(hit.triangle);
            // What lies in the body, and surfaces without an inside, end the way.
            let leaves = parts.triangle_part.get(hit.triangle as usize) == Some(&exit.part);
            if !leaves || geometric.dot(direction) <= 0.0 {
                break;
            }
            share *= (-sigma_t * next.distance(at)).exp();
            at = next;
            if share.max_element().is_nan() || share.max_element() < LEAST_SHARE {
                break;
            }
            let smooth = normals.at(hit.triangle, weights);
            let normal = if smooth.dot(direction) > 0.0 { smooth } else { geometric };
            let cosine = direction.dot(normal).min(1.0);
            let reflected = reflectance_inside(eta, cosine);
            if let Some(outside) = leaving(eta, direction, normal, cosine).filter(|out| out.dot(geometric) > 0.0) {
                sum += share * (1.0 - reflected) * self.lights(at, geometric, outside);
            }
            share *= reflected;
            direction = kept_inside((direction - normal * (2.0 * cosine)).normalize_or_zero(), geometric);
        }
        sum
    }

    /// Radiance of skies and area lights that a point outside sees in a direction, in front of all surfaces.
    fn lights(&self, at: DVec3, geometric: DVec3, direction: DVec3) -> DVec3 {
        let ray = Ray::new(offset_origin(at.as_vec3(), geometric.as_vec3()), direction.as_vec3());
        let free = self.bvh.closest(&ray).map_or(f64::INFINITY, |hit| f64::from(hit.t));
        let sky = if free.is_infinite() { self.skies.radiance(direction) } else { DVec3::ZERO };
        let seen = |light: &Rectangle| light.distance_mm(at, direction).filter(|distance| *distance < free);
        sky + self.rectangles.iter().filter(|light| seen(light).is_some()).map(|light| light.radiance).sum::<DVec3>()
    }
}

/// The direction outside of light that leaves; none under total reflection.
fn leaving(eta_inside_over_outside: f64, direction: DVec3, normal: DVec3, cosine: f64) -> Option<DVec3> {
    let eta = eta_inside_over_outside;
    let outside = refracted_cosine(1.0 / eta, cosine)?;
    Some((direction * eta + normal * (outside - eta * cosine)).normalize_or_zero())
}

/// A direction that shading normals turned out of the body, turned back into it.
fn kept_inside(direction: DVec3, geometric: DVec3) -> DVec3 {
    let out = direction.dot(geometric);
    if out < 0.0 { direction } else { (direction - geometric * (out + 1e-3)).normalize_or(-geometric) }
}
