//! Straight rays inside and around a body: their exit points, and the surfaces between these and the light.

use glam::{DVec3, Vec3};

use super::interface::{Form, Refraction, inside_direction, refracted};
use crate::geometry::bvh::{Bvh, Hit, Ray, offset_origin};
use crate::medium::fresnel::transmittance;
use crate::medium::material::OpticalProperties;
use crate::transport::domain::Domain;
use crate::transport::receivers::parts_of_welds;

/// Treatment of light whose straight way crosses more surfaces than the one it enters by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Crossings {
    /// The light is lost, as in the paper.
    #[default]
    Occluded,
    /// The light passes translucent bodies, and other folds of the same body, attenuated along the refracted length
    /// inside them and by both of their surfaces. Neglected: the bend and shift of the ray behind them, reflections
    /// between their surfaces, and light that they scatter. Opaque parts occlude. A surface met inside the body before
    /// the light enters it (an opaque core, another medium) occludes in both modes.
    Attenuated,
}

/// Coefficients that an evaluation takes from a medium.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Coefficients {
    /// Reduced `sigma_s'`, `sigma_t'` with an isotropic phase function: similarity theory; exact for g = 0.
    #[default]
    Reduced,
    /// Coefficients `sigma_s`, `sigma_t` with the phase function of the medium's g.
    Unreduced,
}

/// Coefficients of a medium for single scattering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Scattering, 1/mm.
    pub sigma_s_per_mm: DVec3,
    /// Extinction, 1/mm.
    pub sigma_t_per_mm: DVec3,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
}

impl Optics {
    /// The optics of a material.
    pub fn new(properties: &OpticalProperties, coefficients: Coefficients) -> Self {
        let (sigma_s_per_mm, sigma_t_per_mm) = match coefficients {
            Coefficients::Reduced => (properties.sigma_s_reduced_per_mm, properties.sigma_t_reduced_per_mm()),
            Coefficients::Unreduced => (properties.sigma_s_per_mm(), properties.sigma_t_per_mm()),
        };
        Self { sigma_s_per_mm, sigma_t_per_mm, eta_inside_over_outside: properties.eta_inside_over_outside }
    }
}

/// A place on the surface where light leaves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExitPoint {
    /// Position relative to the mesh's origin, mm.
    pub at_mm: DVec3,
    /// Unit normal that the eye and the inverse-normal path refer to; zero where there is none, and nothing leaves.
    pub normal: DVec3,
    /// Geometric unit normal, along which rays are kept off the surface; may be the same.
    pub geometric: DVec3,
    /// Part of the scene; a number beyond the parts, or an opaque part, gives 0.
    pub part: u32,
}

/// The place where a ray from inside leaves the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leaving {
    pub(super) distance_mm: f64,
    pub(super) triangle: u32,
    /// Outward unit normal there.
    pub(super) normal: DVec3,
    pub(super) ray: Ray,
}

/// Light on its straight way to a point inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Incident {
    /// F_t and the refraction factor.
    pub(super) gain: f64,
    /// Length `s_i'` of the refracted path inside, mm.
    pub(super) path_mm: f64,
    /// Distance from the point to the place where the light enters, along the straight way, mm.
    pub(super) straight_mm: f64,
    /// Direction `w_i'` inside, outward.
    pub(super) inside: DVec3,
}

/// Surfaces that one ray crosses at most before it counts as lost: more are a loop of rounding errors.
const MOST_CROSSINGS: u32 = 64;

/// Slack over the largest coordinate: the step of [`offset_origin`].
const SLACK: f64 = 1.0 / 524_288.0;

/// Mean free paths shorter than this many slacks are not resolved by rays in single precision: the surface counts as flat.
const RESOLVED: f64 = 16.0;

/// A scene as seen from inside its bodies.
pub(super) struct Interior<'a> {
    pub(super) domain: Domain<'a>,
    pub(super) bvh: &'a Bvh,
    pub(super) form: Form,
    pub(super) crossings: Crossings,
    normals: Vec<DVec3>,
    optics: Vec<Optics>,
    slack_mm: f32,
}

impl<'a> Interior<'a> {
    pub(super) fn new(
        domain: Domain<'a>,
        bvh: &'a Bvh,
        form: Form,
        crossings: Crossings,
        coefficients: Coefficients,
    ) -> Self {
        let mesh = domain.mesh;
        let largest = mesh.bounds_local_mm().iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        Self {
            domain,
            bvh,
            form,
            crossings,
            normals: (0..mesh.triangles.len() as u32).map(|t| mesh.normal(t)).collect(),
            optics: domain.media.iter().map(|m| Optics::new(&m.properties, coefficients)).collect(),
            slack_mm: (SLACK * largest) as f32,
        }
    }

    /// The medium of a part.
    pub(super) fn optics(&self, part: u32) -> Option<&Optics> {
        let medium = self.domain.parts.parts.get(part as usize)?.medium?;
        self.optics.get(medium as usize)
    }

    /// True if rays are too coarse for this medium.
    pub(super) fn is_dense(&self, optics: &Optics) -> bool {
        optics.sigma_t_per_mm.max_element() * f64::from(self.slack_mm) * RESOLVED > 1.0
    }

    fn normal(&self, hit: &Hit) -> DVec3 {
        self.normals.get(hit.triangle as usize).copied().unwrap_or(DVec3::ZERO)
    }

    fn part(&self, triangle: u32) -> u32 {
        self.domain.parts.triangle_part.get(triangle as usize).copied().unwrap_or(u32::MAX)
    }

    /// Start of rays into the body from a point of its surface.
    pub(super) fn start(&self, point: &ExitPoint) -> DVec3 {
        offset_origin(point.at_mm.as_vec3(), -point.geometric.as_vec3()).as_dvec3()
    }

    /// A ray from a point inside.
    pub(super) fn ray(&self, from: DVec3, direction: DVec3) -> Ray {
        Ray::new(from.as_vec3(), direction.as_vec3())
    }

    /// The place where a ray from inside a part leaves it, given its first hit. Surfaces of the same part inside each
    /// other are one body. None if another part is met before, or nothing (an open surface, a ray that rounding lost).
    pub(super) fn leaving(&self, ray: &Ray, first: Option<Hit>, part: u32) -> Option<Leaving> {
        let (mut hit, mut depth, mut ray) = (first?, 1u32, *ray);
        for _ in 0..MOST_CROSSINGS {
            if self.part(hit.triangle) != part {
                return self.leaving_at_contact(ray, hit, depth, part);
            }
            if let Some(leaving) = self.crossed(&hit, &ray, &mut depth) {
                return Some(leaving);
            }
            ray.t_min = hit.t.next_up();
            hit = self.bvh.closest(&ray)?;
        }
        None
    }

    /// Counts a surface of the body itself; returns the place where the ray leaves if it is the last one.
    fn crossed(&self, hit: &Hit, ray: &Ray, depth: &mut u32) -> Option<Leaving> {
        let normal = self.normal(hit);
        if normal.dot(ray.direction.as_dvec3()) > 0.0 {
            *depth -= 1;
            if *depth == 0 {
                let distance_mm = f64::from(hit.t);
                return Some(Leaving { distance_mm, triangle: hit.triangle, normal, ray: *ray });
            }
        } else if hit.t > self.slack_mm {
            // What is this near in front is the surface that the ray starts from.
            *depth += 1;
        }
        None
    }

    /// The place where the ray leaves if another part is met first: where both touch, it leaves within rounding of there.
    fn leaving_at_contact(&self, ray: Ray, met: Hit, mut depth: u32, part: u32) -> Option<Leaving> {
        let near = Ray { t_max: (met.t + self.slack_mm).next_up(), ..ray };
        let mut hits = self.sorted(&near);
        hits.retain(|hit| self.part(hit.triangle) == part);
        let found = hits.iter().find_map(|hit| self.crossed(hit, &ray, &mut depth))?;
        Some(Leaving { ray: Ray { t_max: ray.t_max, ..found.ray }, ..found })
    }

    /// All surfaces along a ray, the nearest first; of those around an edge or a vertex one for each part and side.
    fn sorted(&self, ray: &Ray) -> Vec<Hit> {
        let mut hits = Vec::new();
        self.bvh.crossings(ray, |hit| hits.push(hit));
        let side = |hit: &Hit| self.normal(hit).dot(ray.direction.as_dvec3()) > 0.0;
        let place = |hit: &Hit| (self.part(hit.triangle), side(hit));
        hits.sort_by(|a, b| a.t.total_cmp(&b.t).then(place(a).cmp(&place(b))).then(a.triangle.cmp(&b.triangle)));
        hits.dedup_by(|a, b| a.t == b.t && place(a) == place(b));
        hits
    }

    /// Traces a ray from inside a part to the place where it leaves the part.
    pub(super) fn leave(&self, from: DVec3, direction: DVec3, part: u32) -> Option<Leaving> {
        let ray = self.ray(from, direction);
        self.leaving(&ray, self.bvh.closest(&ray), part)
    }

    /// Length of the medium along a ray from a point of the surface, mm; infinite through an opening.
    pub(super) fn reach(&self, from: DVec3, direction: DVec3, part: u32) -> f64 {
        let ray = self.ray(from, direction);
        match self.bvh.closest(&ray) {
            None => f64::INFINITY,
            // Another part inside ends the path; a lost ray has none.
            first @ Some(hit) => match self.leaving(&ray, first, part) {
                Some(leaving) => leaving.distance_mm,
                None if self.part(hit.triangle) != part => f64::from(hit.t),
                None => 0.0,
            },
        }
    }

    /// Light from a direction that enters the body where a ray leaves it; none where the surface reflects all of it.
    pub(super) fn incident(&self, leaving: &Leaving, direction: DVec3, eta: f64) -> Option<Incident> {
        self.incident_at(leaving.distance_mm, leaving.normal, direction, eta)
    }

    /// Light from a direction that enters through a surface with this normal, at this straight distance from the point.
    pub(super) fn incident_at(&self, straight_mm: f64, normal: DVec3, direction: DVec3, eta: f64) -> Option<Incident> {
        let cosine = normal.dot(direction);
        let refraction = Refraction::new(self.form, eta, cosine)?;
        let inside = inside_direction(eta, direction, normal, cosine, refraction.cos_inside);
        Some(Incident { gain: refraction.gain, path_mm: straight_mm * refraction.stretch, straight_mm, inside })
    }

    /// The way on from where a ray left the body, up to `t_max`, and the triangle to leave out.
    pub(super) fn beyond(&self, leaving: &Leaving, t_max: f64) -> (Ray, u32) {
        let t = leaving.distance_mm as f32;
        (Ray { t_min: t + self.slack_mm, t_max: t_max as f32, ..leaving.ray }, leaving.triangle)
    }

    /// The way on from the surface itself, for media that rays do not resolve.
    pub(super) fn beyond_flat(&self, point: &ExitPoint, direction: DVec3, t_max: f64) -> (Ray, u32) {
        let origin = offset_origin(point.at_mm.as_vec3(), point.geometric.as_vec3());
        let ray = Ray { origin, direction: direction.as_vec3(), t_min: self.slack_mm, t_max: t_max as f32 };
        (ray, crate::geometry::bvh::NO_TRIANGLE)
    }

    /// The share of light that comes through along the way on, RGB.
    pub(super) fn transmitted(&self, ray: &Ray, skip: u32) -> DVec3 {
        match self.crossings {
            Crossings::Occluded => DVec3::splat(f64::from(u8::from(!self.bvh.occluded(ray, skip)))),
            Crossings::Attenuated => self.attenuated(ray, skip),
        }
    }

    /// Attenuation by all bodies on a ray that leaves one of them through a triangle.
    fn attenuated(&self, ray: &Ray, skip: u32) -> DVec3 {
        let mut through = DVec3::ONE;
        // Part, entry distance and depth of the bodies that the ray is in.
        let mut open: Vec<(u32, f64, u32)> = Vec::new();
        let direction = ray.direction.as_dvec3();
        for hit in self.sorted(ray).into_iter().filter(|hit| hit.triangle != skip) {
            let part = self.part(hit.triangle);
            let Some(optics) = self.optics(part) else { return DVec3::ZERO };
            let eta = optics.eta_inside_over_outside;
            let cosine = self.normal(&hit).dot(direction);
            let place = open.iter().position(|body| body.0 == part);
            let refraction = Refraction::new(Form::Printed, eta, cosine.abs());
            let Some(refraction) = refraction.filter(|_| cosine != 0.0) else { return DVec3::ZERO };
            let surface = transmittance(eta, cosine.abs());
            let inside = |entered: f64| {
                let length = (f64::from(hit.t) - entered) * refraction.stretch;
                (-length * optics.sigma_t_per_mm).map(f64::exp)
            };
            match (cosine < 0.0, place) {
                (true, Some(at)) => open[at].2 += 1,
                (true, None) => {
                    open.push((part, f64::from(hit.t), 1));
                    through *= surface;
                }
                (false, Some(at)) if open[at].2 > 1 => open[at].2 -= 1,
                (false, Some(at)) => {
                    let (_, entered, _) = open.swap_remove(at);
                    through *= surface * inside(entered);
                }
                // Out of what was never entered: another body that touches the one the ray came from, where it came from, or
                // that one itself within rounding.
                (false, None) if part != self.part(skip) => {
                    let at_contact = self.normals.get(skip as usize).map_or(cosine, |n| n.dot(direction));
                    through *= transmittance(eta, at_contact.abs()) * surface * inside(f64::from(ray.t_min));
                }
                (false, None) => {}
            }
        }
        // Out through an opening: there is no surface that would tell where the body ends.
        if open.is_empty() { through } else { DVec3::ZERO }
    }
}

/// Direction `w_o'` inside, outward, of light that leaves at a point towards an eye; none if no light does.
pub fn inside_towards(eta_inside_over_outside: f64, to_eye: DVec3, point: &ExitPoint) -> Option<DVec3> {
    let inside = refracted(eta_inside_over_outside, to_eye, point.normal)?;
    if inside.dot(point.geometric) > 0.0 {
        return Some(inside);
    }
    // A shading normal so far from the triangle's that the path would not go inside.
    refracted(eta_inside_over_outside, to_eye, point.geometric)
}

/// One point for each source vertex, with the angle-weighted normal of the triangles of its part around its welded
/// vertex (the first transferring part that uses it); the normal is zero for a vertex without such triangles.
pub fn vertex_points(domain: Domain) -> Vec<ExitPoint> {
    let mesh = domain.mesh;
    let count = mesh.local_mm.len();
    let transfers = |part: u32| domain.parts.parts.get(part as usize).is_some_and(|p| p.transfers());
    let part_of = parts_of_welds(mesh, domain.parts);
    let mut normals = vec![DVec3::ZERO; count];
    let triangles = (0u32..).zip(domain.parts.triangle_part.iter().copied()).take(mesh.triangles.len());
    for (triangle, part) in triangles.filter(|&(_, part)| transfers(part)) {
        let (corners, normal) = (mesh.corners_local_mm(triangle), mesh.normal(triangle));
        for (k, v) in mesh.welded(triangle).into_iter().enumerate() {
            let (a, b) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
            if part_of.get(v as usize) == Some(&part) {
                normals[v as usize] += normal * a.cross(b).length().atan2(a.dot(b));
            }
        }
    }
    let mut used = vec![false; count];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let point = |v: usize| {
        let weld = mesh.weld.get(v).map_or(v, |&w| w as usize);
        let normal = if used[v] { normals[weld].normalize_or_zero() } else { DVec3::ZERO };
        let at: Vec3 = mesh.local_mm[v];
        ExitPoint { at_mm: at.as_dvec3(), normal, geometric: normal, part: part_of[weld] }
    };
    (0..count).map(point).collect()
}
