//! Directional, point and spot lights: one ray for each point of a sample, and the samples that a shadow boundary or the edge of a cone crosses.

use glam::DVec3;

use super::surface_point::SurfacePoint;
use crate::geometry::bvh::{Bvh, Ray, offset_along};
use crate::geometry::samples::{Facet, Patch, bisect};
use crate::light::cone::{ConeFalloff, Lit};
use crate::math::simd::InstructionSet;
use crate::medium::fresnel;
use crate::transport::prepared_light::{LEAST_DISTANCE2_MM2, Prepared};

/// A patch that is nearer to a point light than so many of its radii is looked at from points that lie the closer together
/// the nearer the light is: four points of a patch at this distance miss 0.1 % of its irradiance.
const NEAR_RADII: f64 = 4.0;

/// Radius of the triangles that such points stand for, over their distance from the light: their sum misses 0.5 % of the flux of
/// a light just above the surface.
const FINE_RADIUS: f64 = 0.25;

/// Angular radius of the triangles that the edge of a cone crosses, over the half angle of the cone: their sum misses 0.5 % of the
/// flux of a sharp one.
const FINE_CONE: f64 = 1.0 / 16.0;

/// A patch whose points differ by more of a cone's full light is looked at from more points.
const EVEN_SHARE: f64 = 0.1;

/// Bisections of a piece at most: to a thousandth of its edges.
const MOST_BISECTIONS: u32 = 20;

/// A light whose rays run side by side, from all patches of a range.
pub(super) struct Sharp {
    source: Source,
    falloff: ConeFalloff,
    colour: DVec3,
    rays: Vec<Ray>,
    skip: Vec<u32>,
    arrivals: Vec<Arrival>,
    /// F_t cos of some patches.
    entering: Vec<f64>,
    /// Patches that the edge of the cone crosses.
    on_edge: Vec<usize>,
}

/// The irradiance that one ray brings if it meets nothing.
struct Arrival {
    /// Patch, counted from the first of the range, and point or piece of it.
    patch: u32,
    point: u32,
    /// F_t cos times the share of the point, over the squared distance.
    gain: f64,
    occluded: bool,
}

/// A patch that a shadow boundary crosses.
#[derive(Clone, Debug)]
pub struct Uneven {
    pub(super) patch: u32,
    /// Irradiance of each of its pieces less its own, RGB.
    pub(super) deviations: Vec<DVec3>,
    /// Corners of each piece relative to the centroid of the patch, mm.
    pub(super) corners: Vec<[[f32; 3]; 3]>,
}

/// The direction or the point that sharp light comes from.
enum Source {
    Direction(DVec3),
    Point(DVec3),
}

/// Why a patch is looked at from many points: it is near to a point light, or large beside the cone of a spot.
#[derive(Clone, Copy)]
pub(super) struct Focus {
    at: DVec3,
    falloff: ConeFalloff,
}

impl Focus {
    /// Returns whether a triangle of this centre and radius is lit evenly enough for one point.
    fn is_even(&self, centre: DVec3, radius: f64, reach: f64) -> bool {
        let distance = centre.distance(self.at);
        if radius > reach * distance {
            return false;
        }
        let angular = radius / distance;
        angular <= FINE_CONE * self.falloff.cos_edge.clamp(-1.0, 1.0).acos()
            || self.falloff.lights_ball(self.at, centre, radius) != Lit::InPart
    }
}

impl Sharp {
    /// A directional, a point or a spot light, with room for so many rays; none for the other lights.
    pub(super) fn new<E>(light: &Prepared<E>, rays: usize) -> Option<Self> {
        let (source, falloff, colour) = match light {
            Prepared::Directional { from, irradiance } => (Source::Direction(*from), ConeFalloff::NONE, *irradiance),
            Prepared::Point { at, intensity, falloff } => (Source::Point(*at), *falloff, *intensity),
            _ => return None,
        };
        let (skip, arrivals) = (Vec::with_capacity(rays), Vec::with_capacity(rays));
        let (rays, entering, on_edge) = (Vec::with_capacity(rays), Vec::new(), Vec::new());
        Some(Self { source, falloff, colour, rays, skip, arrivals, entering, on_edge })
    }

    /// True if the light is in front of the plane of a triangle, given by a point and a normal of any length.
    pub(super) fn faces(&self, on_plane: DVec3, normal: DVec3) -> bool {
        match self.source {
            Source::Direction(from) => normal.dot(from) > 0.0,
            // Points of the triangle are rounded: a light near its plane may still be in front of some.
            Source::Point(at) => normal.dot(at - on_plane) > -1e-9 * normal.length() * at.distance(on_plane),
        }
    }

    /// Direction to the light from a point, its distance, and the factor on `colour` there, before the share of a cone: 1, or
    /// 1 / distance^2.
    fn towards(&self, at: DVec3) -> (DVec3, f64, f64) {
        match self.source {
            Source::Direction(from) => (from, f64::INFINITY, 1.0),
            Source::Point(light) => {
                let distance = light.distance(at);
                let direction = (light - at).normalize_or_zero();
                (direction, distance, (distance * distance).max(LEAST_DISTANCE2_MM2).recip())
            }
        }
    }

    /// What a patch is to be looked at for more closely, if its irradiance varies within.
    pub(super) fn focus(&self, patch: &Patch) -> Option<Focus> {
        let Source::Point(at) = self.source else { return None };
        let focus = Focus { at, falloff: self.falloff };
        (!focus.is_even(patch.centre_mm, patch.radius_mm, NEAR_RADII.recip())).then_some(focus)
    }

    /// Adds the rays of one patch; each point belongs to a piece of it and stands for a share of it all.
    pub(super) fn collect(
        &mut self,
        patch: usize,
        eta: f64,
        points: &[SurfacePoint],
        of: impl Fn(usize) -> (usize, f64),
    ) {
        // Points of a triangle have one normal, and under a directional light one transmittance.
        let (mut known, mut unit) = ((f64::NAN, 0.0), (DVec3::NAN, DVec3::ZERO));
        let mut shares = [f64::INFINITY, f64::NEG_INFINITY];
        for (point, p) in points.iter().enumerate() {
            let (to_light, distance, falloff) = self.towards(p.at);
            let cosine = p.normal.dot(to_light);
            if cosine <= 0.0 {
                continue;
            }
            if cosine != known.0 {
                known = (cosine, fresnel::transmittance(eta, cosine) * cosine);
            }
            let arriving = known.1;
            if arriving > 0.0 {
                let of_cone = self.falloff.at(to_light);
                shares = [shares[0].min(of_cone), shares[1].max(of_cone)];
                if of_cone == 0.0 {
                    continue;
                }
                if p.normal != unit.0 {
                    unit = (p.normal, p.normal.as_vec3().as_dvec3().normalize_or_zero());
                }
                let (piece, share) = of(point);
                let gain = arriving * falloff * share * of_cone;
                self.push((patch, piece), (p.at, unit.1, p.triangle), (to_light, distance), gain);
            }
        }
        if shares[1] - shares[0] > EVEN_SHARE {
            self.on_edge.push(patch);
        }
    }

    /// Adds a ray from the centre of each of some patches, each of one facet; the first is number `first` of the range.
    pub(super) fn collect_centres(&mut self, first: usize, eta: f64, patches: &[Patch], facets: &[Facet]) {
        let mut entering = std::mem::take(&mut self.entering);
        entering.clear();
        entering.extend(patches.iter().map(|patch| patch.normal.dot(self.towards(patch.centre_mm).0)));
        fresnel::entering(InstructionSet::detect(), eta, &mut entering);
        for (i, (patch, facet)) in patches.iter().zip(facets).enumerate().filter(|(i, _)| entering[*i] > 0.0) {
            let (to_light, distance, falloff) = self.towards(patch.centre_mm);
            let of_cone = self.falloff.at(to_light);
            if of_cone > 0.0 {
                let from = (patch.centre_mm, patch.normal, facet.triangle);
                self.push((first + i, 0), from, (to_light, distance), entering[i] * falloff * of_cone);
            }
        }
        self.entering = entering;
    }

    /// Adds one ray, from a point with a unit normal.
    fn push(
        &mut self,
        (patch, point): (usize, usize),
        (at, unit, triangle): (DVec3, DVec3, u32),
        (to_light, distance): (DVec3, f64),
        gain: f64,
    ) {
        let (origin, direction) = (offset_along(at.as_vec3(), unit), to_light.as_vec3());
        self.rays.push(Ray { origin, direction, t_min: 0.0, t_max: distance as f32 });
        self.skip.push(triangle);
        self.arrivals.push(Arrival { patch: patch as u32, point: point as u32, gain, occluded: false });
    }

    pub(super) fn trace(&mut self, bvh: &Bvh) {
        let mut occluded = vec![false; self.rays.len()];
        bvh.occluded_many(&self.rays, &self.skip, &mut occluded);
        self.arrivals.iter_mut().zip(occluded).for_each(|(arrival, occluded)| arrival.occluded = occluded);
    }

    /// For each patch, true if some of its points are lit and others in shadow or outside of the cone.
    pub(super) fn crossed(&self, patches: usize) -> Vec<bool> {
        let mut crossed = vec![false; patches];
        for of_patch in self.arrivals.chunk_by(|a, b| a.patch == b.patch) {
            crossed[of_patch[0].patch as usize] = of_patch.iter().any(|a| a.occluded != of_patch[0].occluded);
        }
        self.on_edge.iter().for_each(|&patch| crossed[patch] = true);
        crossed
    }

    /// Adds the irradiance of each patch that `of` selects.
    pub(super) fn add(&self, out: &mut [DVec3], of: impl Fn(usize) -> bool) {
        for arrival in self.arrivals.iter().filter(|a| !a.occluded && of(a.patch as usize)) {
            out[arrival.patch as usize] += self.colour * arrival.gain;
        }
    }

    /// Adds the irradiance of each piece of one patch.
    pub(super) fn add_to_pieces(&self, patch: usize, points: &mut [DVec3]) {
        let first = self.arrivals.partition_point(|a| (a.patch as usize) < patch);
        let count = points.len() as f64;
        for arrival in self.arrivals[first..].iter().take_while(|a| a.patch as usize == patch) {
            if !arrival.occluded {
                points[arrival.point as usize] += self.colour * (arrival.gain * count);
            }
        }
    }
}

/// Samples that a shadow boundary of a sharp light or the edge of its cone crosses, with the irradiance of each piece less the sample's.
#[derive(Clone, Debug, Default)]
pub struct Pieces {
    /// Position of each sample's pieces in `deviations`; `u32::MAX` for samples that are lit evenly.
    first: Vec<u32>,
    deviations: Vec<DVec3>,
    /// Corners of each piece relative to the centroid of its sample, mm.
    corners: Vec<[[f32; 3]; 3]>,
    count: usize,
}

impl Pieces {
    /// No pieces: every sample is lit evenly.
    pub const NONE: Self = Self { first: Vec::new(), deviations: Vec::new(), corners: Vec::new(), count: 0 };

    /// The pieces of the uneven ones among `patches` patches, `count` of each.
    pub(super) fn new(patches: usize, count: usize, uneven: impl Iterator<Item = Uneven>) -> Self {
        let mut result = Self { first: vec![u32::MAX; patches], count, ..Self::NONE };
        for Uneven { patch, deviations, corners } in uneven {
            result.first[patch as usize] = result.deviations.len() as u32;
            result.deviations.extend(deviations);
            result.corners.extend(corners);
        }
        result
    }

    /// True if a sample is not lit evenly.
    pub fn is_uneven(&self, sample: usize) -> bool {
        self.first.get(sample).is_some_and(|&first| first != u32::MAX)
    }

    /// Irradiance of each piece less its sample's, RGB, of all samples that are not lit evenly.
    pub fn deviations(&self) -> &[DVec3] {
        &self.deviations
    }

    /// Number of pieces of each sample that is not lit evenly.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Pieces of a sample: their irradiance less the sample's, RGB, which sums to 0; and corners relative to the
    /// sample's centroid, mm. `None` if it is lit evenly.
    pub fn of(&self, patch: usize) -> Option<impl Iterator<Item = (DVec3, &[[f32; 3]; 3])>> {
        let first = *self.first.get(patch).filter(|&&first| first != u32::MAX)? as usize;
        let range = first..first + self.count;
        Some(self.deviations.get(range.clone())?.iter().copied().zip(self.corners.get(range)?))
    }

    /// The same with the irradiance that each sample has beyond its mean times a factor.
    #[must_use]
    pub(crate) fn scaled(mut self, factor: impl Fn(usize) -> DVec3) -> Self {
        for (patch, &first) in self.first.iter().enumerate().filter(|(_, first)| **first != u32::MAX) {
            let factor = factor(patch);
            self.deviations.iter_mut().skip(first as usize).take(self.count).for_each(|e| *e *= factor);
        }
        self
    }

    /// The pieces of the light of both, which are those of the same samples.
    #[must_use]
    pub(crate) fn beside(mut self, other: Self) -> Self {
        if self.deviations.is_empty() {
            return other;
        }
        let count = other.count;
        let samples = self.first.iter_mut().zip(&other.first).filter(|(_, theirs)| **theirs != u32::MAX);
        for (mine, &theirs) in samples {
            let theirs = theirs as usize..theirs as usize + count;
            if *mine == u32::MAX {
                *mine = self.deviations.len() as u32;
                self.deviations.extend_from_slice(&other.deviations[theirs.clone()]);
                self.corners.extend_from_slice(&other.corners[theirs]);
            } else {
                let sums = self.deviations.iter_mut().skip(*mine as usize);
                sums.zip(&other.deviations[theirs]).for_each(|(sum, e)| *sum += *e);
            }
        }
        self
    }

    /// The same light on the same samples of the surface in another shape: `corner` carries a corner of a piece of a sample there, relative
    /// to the centroid of the sample, mm.
    #[must_use]
    pub fn carried(&self, corner: impl Fn(usize, DVec3) -> DVec3) -> Self {
        let mut result = self.clone();
        for (patch, &first) in self.first.iter().enumerate().filter(|(_, first)| **first != u32::MAX) {
            let pieces = result.corners.iter_mut().skip(first as usize).take(self.count);
            for c in pieces.flatten() {
                *c = corner(patch, glam::Vec3::from_array(*c).as_dvec3()).as_vec3().to_array();
            }
        }
        result
    }
}

/// Visits `count` (a power of two) congruent-area pieces of a triangle.
pub(super) fn pieces(corners: [DVec3; 3], count: u32, visit: &mut impl FnMut([DVec3; 3])) {
    if count <= 1 {
        visit(corners);
        return;
    }
    for half in bisect(corners) {
        pieces(half, count / 2, visit);
    }
}

/// Visits parts of a triangle that a light lights evenly, with the share of its area that each has.
pub(super) fn graded(corners: [DVec3; 3], focus: Focus, visit: &mut impl FnMut([DVec3; 3], f64)) {
    fn cut(corners: [DVec3; 3], focus: Focus, depth: u32, visit: &mut impl FnMut([DVec3; 3], f64)) {
        let centre = corners.iter().sum::<DVec3>() / 3.0;
        let radius = corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max);
        if depth == MOST_BISECTIONS || focus.is_even(centre, radius, FINE_RADIUS) {
            visit(corners, f64::from(depth).exp2().recip());
        } else {
            bisect(corners).into_iter().for_each(|half| cut(half, focus, depth + 1, visit));
        }
    }
    cut(corners, focus, 0, visit);
}
