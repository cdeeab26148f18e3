//! Eye rays: their hits, and the radiance along them.

use std::f64::consts::FRAC_1_PI;

use glam::{DVec2, DVec3};

use super::background::Backdrop;
use super::exit::ExitRadiance;
use super::glossy_lights::{GlossyLights, Place};
use super::highlight::Highlight;
use super::lights::ShadowRays;
use super::matte::{Irradiance, MatteLights, MattePoint};
use super::normals::ShadingNormals;
use super::pixel_samples::{PixelSamples, Stream};
use super::seen::{Seen, shared_within_mm};
use super::settings::{EMPTY, Ground, Pixel, RenderSettings, Specular};
use super::single::{EyeRay, Scattered, SingleRadiance, Spot};
use super::straight::Straight;
use super::texture::Texture;
use crate::evaluate::exitance::{Exitance, MeshPoint};
use crate::geometry::bvh::{Bvh, Hit, Ray};
use crate::light::Light;
use crate::medium::fresnel::diffuse_transmittance;
use crate::medium::material::Medium;
use crate::parallel::*;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::single_scattering::ExitPoint;

/// Side of a tile in pixels.
pub(super) const TILE: usize = 16;
/// Number of eye rays that are traced as one bundle; pixels are rendered together until they have as many.
const RAYS_TOGETHER: usize = 16;
/// Least ratio of exit cosine to geometric cosine: a smooth normal may face away from the eye near the outline of a
/// coarse mesh, where Fresnel's factor would make whole triangles black.
pub(crate) const LEAST_COSINE_SHARE: f64 = 0.5;

/// Refractive index of the boundary of opaque parts: plastics and lacquers.
const OPAQUE_ETA: f64 = 1.5;

/// Most eye rays whose points are asked for their exitance together, but for pixels with more: enough for full groups of
/// neighbours, few enough for every thread to hold them.
const RAYS_ASKED_TOGETHER: usize = 1 << 12;

/// Numbers of hits, of hits from behind, and of points whose exitance is not finite. Integers give the same sums in any
/// order.
#[derive(Clone, Copy, Default)]
pub(super) struct Counts {
    hits: u64,
    from_behind: u64,
    not_finite: u64,
}

impl Counts {
    pub(super) fn add(self, other: Self) -> Self {
        Self {
            hits: self.hits + other.hits,
            from_behind: self.from_behind + other.from_behind,
            not_finite: self.not_finite + other.not_finite,
        }
    }

    pub(super) fn not_finite(self) -> u64 {
        self.not_finite
    }

    pub(super) fn share(self) -> f64 {
        if self.hits == 0 { 0.0 } else { self.from_behind as f64 / self.hits as f64 }
    }
}

/// Sums over the eye rays of a pixel.
#[derive(Default)]
struct Sum {
    diffuse: DVec3,
    single: DVec3,
    straight: DVec3,
    specular: DVec3,
    albedo: DVec3,
    matte: DVec3,
    background: DVec3,
    /// Background where eye rays meet the ground, the light there with the object and without, and the number of these rays.
    ground: DVec3,
    ground_light: Irradiance,
    ground_rays: u32,
    glare: DVec3,
    normal: DVec3,
    depth_mm: f64,
    hits: u32,
    /// Number of footprints on the desk that are the pixel's.
    footprints: usize,
    /// Parts with their hits; few parts meet in a pixel.
    parts: Vec<(u32, u32)>,
}

impl Sum {
    fn count(&mut self, part: u32) {
        match self.parts.iter_mut().find(|(known, _)| *known == part) {
            Some((_, hits)) => *hits += 1,
            None => self.parts.push((part, 1)),
        }
    }

    /// The background with the object's shadow on the ground, and the share of the pixel's rays that the shadow takes.
    fn shadowed(&self, share: f64) -> (DVec3, f32) {
        let Irradiance { lit, open } = self.ground_light;
        let left = |lit: f64, open: f64| if open > 0.0 { lit / open } else { 1.0 };
        let ratio = DVec3::new(left(lit.x, open.x), left(lit.y, open.y), left(lit.z, open.z));
        let shadow = (1.0 - left(lit.element_sum(), open.element_sum())).clamp(0.0, 1.0);
        (self.background + ratio * self.ground, (shadow * f64::from(self.ground_rays) * share) as f32)
    }

    fn pixel(&self, samples: u32) -> Pixel {
        let share = 1.0 / f64::from(samples);
        let (background, shadow) = self.shadowed(share);
        if self.hits == 0 {
            return Pixel { beauty: narrow(background * share), glare: narrow(self.glare * share), shadow, ..EMPTY };
        }
        let most = self.parts.iter().max_by_key(|(part, hits)| (*hits, std::cmp::Reverse(*part)));
        Pixel {
            beauty: narrow(
                (self.diffuse + self.single + self.straight + self.specular + self.matte + background) * share,
            ),
            diffuse: narrow(self.diffuse * share),
            single: narrow(self.single * share),
            straight: narrow(self.straight * share),
            specular: narrow(self.specular * share),
            matte: narrow(self.matte * share),
            shadow,
            albedo: narrow(self.albedo * share),
            glare: narrow(self.glare * share),
            normal: narrow(self.normal.normalize_or_zero()),
            depth_mm: (self.depth_mm / f64::from(self.hits)) as f32,
            coverage: (f64::from(self.hits) * share) as f32,
            part: most.map_or(0, |(part, _)| part.saturating_add(1)),
        }
    }
}

/// A colour in 32 bits; values that do not fit become the largest finite one.
fn narrow(v: DVec3) -> [f32; 3] {
    let limit = f64::from(f32::MAX);
    v.to_array().map(|c| c.clamp(-limit, limit) as f32)
}

/// The boundary of a medium.
struct Boundary {
    exit: ExitRadiance,
    /// How it reflects; none where nothing is reflected.
    highlight: Option<Highlight>,
    /// Distance up to which rays of a pixel share a point whose exitance is asked for, mm.
    shared_within_mm: f64,
}

/// The source of exitance.
#[derive(Clone, Copy)]
enum Source<'a> {
    /// Values at the vertices, asked for ray by ray.
    Vertices(&'a dyn Exitance),
    /// Values at points, asked for together.
    Points(&'a dyn Exitance),
}

/// A scene prepared for rendering.
pub(super) struct Renderer<'a> {
    scene: &'a Scene,
    bvh: &'a Bvh,
    exitance: Source<'a>,
    single: SingleRadiance<'a>,
    straight: Option<Straight<'a>>,
    texture: Option<&'a Texture>,
    settings: &'a RenderSettings,
    backdrop: Backdrop<'a>,
    lights: GlossyLights,
    matte_lights: MatteLights,
    /// Radiance of opaque parts for an albedo and an irradiance of 1, and how their boundary reflects.
    opaque_response: f64,
    opaque_highlight: Option<Highlight>,
    /// Height of the ground in the mesh's local coordinates.
    ground_mm: Option<f64>,
    normals: ShadingNormals,
    samples: PixelSamples,
    /// The boundary of each medium.
    boundaries: Vec<Boundary>,
    /// The eye in the mesh's local coordinates.
    eye: DVec3,
    /// A sphere around the mesh in its local coordinates.
    centre: DVec3,
    radius_mm: f64,
}

/// What a matte point makes of the light on it.
#[derive(Clone, Copy)]
enum Matte {
    /// An opaque part: radiance for an irradiance of 1.
    Opaque(DVec3),
    /// The ground in front of this background.
    Ground(DVec3),
}

/// What an eye ray meets.
struct Met {
    from_behind: bool,
    /// The point that reflects the lights, if any.
    place: Option<Place>,
    /// The point of an opaque part.
    matte: Option<(MattePoint, DVec3)>,
}

/// Working memory for a group of pixels; one for each tile.
#[derive(Default)]
struct Desk {
    /// Directions of all eye rays.
    directions: Vec<DVec3>,
    /// Eye rays that come near the object; `indices` are their numbers.
    rays: Vec<Ray>,
    indices: Vec<u32>,
    hits: Vec<Option<Hit>>,
    /// Reflecting points; `of_place` has the eye rays that see them, `reflected` the radiance reflected to these.
    places: Vec<Place>,
    of_place: Vec<u32>,
    reflected: Vec<DVec3>,
    shadow: ShadowRays,
    /// Matte points, and the eye rays that see them with what they make of light.
    spots: Vec<MattePoint>,
    of_spot: Vec<(u32, Matte)>,
    matte: ShadowRays,
    /// Points whose exitance is not asked for yet.
    seen: Seen,
}

impl<'a> Renderer<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        bvh: &'a Bvh,
        scattered: Scattered<'a>,
        lights: &'a [Light],
        settings: &'a RenderSettings,
    ) -> Self {
        let [min, max] = scene.mesh.bounds_local_mm();
        let boundary = |medium: &Medium| {
            let eta = medium.properties.eta_inside_over_outside;
            Boundary {
                exit: ExitRadiance::new(eta, settings.exit_fresnel),
                highlight: settings.specular.highlight(eta),
                shared_within_mm: shared_within_mm(&medium.properties),
            }
        };
        let reflecting = if settings.specular == Specular::Off { &[] } else { lights };
        let opaque_highlight = settings.specular.highlight(OPAQUE_ETA);
        let entering = if opaque_highlight.is_some() { diffuse_transmittance(OPAQUE_ETA) } else { 1.0 };
        Self {
            scene,
            bvh,
            exitance: match scattered.exitance.at_vertices() {
                Some(_) => Source::Vertices(scattered.exitance),
                None => Source::Points(scattered.exitance),
            },
            single: SingleRadiance::new(scene, scattered.single),
            straight: settings.straight.then(|| Straight::new(scene, bvh, lights)),
            texture: scattered.texture,
            settings,
            backdrop: Backdrop::new(settings.background, lights),
            lights: GlossyLights::new(reflecting, scene.mesh.origin_mm, settings.samples_per_pixel),
            matte_lights: MatteLights::new(lights, scene.mesh.origin_mm, settings.samples_per_pixel),
            opaque_response: entering * FRAC_1_PI,
            opaque_highlight,
            ground_mm: (settings.ground == Ground::Shadow).then_some(min.y),
            normals: ShadingNormals::new(scene),
            samples: PixelSamples::new(settings.samples_per_pixel),
            boundaries: scene.media.iter().map(boundary).collect(),
            eye: settings.camera.at_mm() - scene.mesh.origin_mm,
            centre: 0.5 * (min + max),
            // A little larger, so that rounding cuts nothing off.
            radius_mm: 0.5 * (max - min).length() * (1.0 + 1e-6),
        }
    }

    /// Renders the rows from `top` on into `pixels`.
    pub(super) fn tile_row(&self, top: usize, pixels: &mut [Pixel], progress: &dyn Progress) -> Counts {
        let width = self.settings.resolution.width;
        let rows = pixels.len() / width;
        let tiles: Vec<(Vec<Pixel>, Counts)> = (0..width.div_ceil(TILE))
            .into_par_iter()
            .map(|tile| {
                let columns = tile * TILE..width.min((tile + 1) * TILE);
                let places: Vec<(usize, usize)> =
                    (top..top + rows).flat_map(|y| columns.clone().map(move |x| (x, y))).collect();
                let rendered = self.tile(&places);
                progress.advance(places.len() as u64);
                rendered
            })
            .collect();
        for (tile, (rendered, _)) in tiles.iter().enumerate() {
            let columns = tile * TILE..width.min((tile + 1) * TILE);
            for (row, line) in rendered.chunks(columns.len()).enumerate() {
                pixels[row * width..][columns.clone()].copy_from_slice(line);
            }
        }
        tiles.iter().fold(Counts::default(), |sum, (_, counts)| sum.add(*counts))
    }

    /// Renders the pixels of a tile.
    fn tile(&self, pixels: &[(usize, usize)]) -> (Vec<Pixel>, Counts) {
        let samples = self.settings.samples_per_pixel;
        let together = RAYS_TOGETHER.div_ceil(samples as usize);
        let asked_together = match self.exitance {
            Source::Vertices(_) => together,
            Source::Points(_) => (RAYS_ASKED_TOGETHER / samples as usize).max(1),
        };
        let mut counts = Counts::default();
        let mut rendered = Vec::with_capacity(pixels.len());
        let (mut desk, mut sums) = (Desk::default(), Vec::new());
        for batch in pixels.chunks(asked_together) {
            sums.clear();
            sums.resize_with(batch.len(), Sum::default);
            for (group, sums) in batch.chunks(together).zip(sums.chunks_mut(together)) {
                counts = counts.add(self.group(group, sums, &mut desk));
            }
            if let Source::Points(exitance) = self.exitance {
                counts.not_finite += add_seen(exitance, &mut desk.seen, &mut sums);
            }
            rendered.extend(sums.iter().map(|sum| sum.pixel(samples)));
        }
        (rendered, counts)
    }

    /// Computes the sums of some pixels, but for exitance at the points that it leaves on the desk.
    fn group(&self, pixels: &[(usize, usize)], sums: &mut [Sum], desk: &mut Desk) -> Counts {
        let samples = self.settings.samples_per_pixel as usize;
        self.cast(pixels, desk);
        let mut counts = Counts::default();
        let mut next = 0;
        for (index, direction) in desk.directions.iter().enumerate() {
            let sum = &mut sums[index / samples];
            let hit = if desk.indices.get(next) == Some(&(index as u32)) {
                next += 1;
                desk.hits[next - 1]
            } else {
                None
            };
            let ray = |hit: Hit| {
                let (pixel, sample) = self.ray(pixels, index);
                let ray = EyeRay { pixel, sample, of: samples as u32 };
                self.shade(&hit, *direction, ray, sum, &mut desk.seen)
            };
            let Some(Met { from_behind, place, matte }) = hit.and_then(ray) else {
                let radiance = self.backdrop.radiance(*direction);
                if let Some(at_mm) = self.ground_at(*direction) {
                    let (triangle, normal, geometric) = (u32::MAX, DVec3::Y, DVec3::Y);
                    let (pixel, sample) = self.ray(pixels, index);
                    desk.spots.push(MattePoint { at_mm, triangle, geometric, normal, pixel, sample });
                    desk.of_spot.push((index as u32, Matte::Ground(radiance)));
                    continue;
                }
                sum.background += radiance;
                sum.glare += (radiance - self.settings.white).max(DVec3::ZERO);
                continue;
            };
            counts.hits += 1;
            counts.from_behind += u64::from(from_behind);
            if let Some(place) = place {
                desk.places.push(place);
                desk.of_place.push(index as u32);
            }
            if let Some((spot, response)) = matte {
                desk.spots.push(spot);
                desk.of_spot.push((index as u32, Matte::Opaque(response)));
            }
        }
        self.reflect(pixels, sums, desk);
        self.light_matte(sums, desk);
        counts
    }

    /// Pixel of an eye ray of a group, and its number there.
    fn ray(&self, pixels: &[(usize, usize)], index: usize) -> (u64, u32) {
        let samples = self.settings.samples_per_pixel as usize;
        let (x, y) = pixels[index / samples];
        ((y * self.settings.resolution.width + x) as u64, (index % samples) as u32)
    }

    /// Where an eye ray that meets nothing else meets the ground from above.
    fn ground_at(&self, direction: DVec3) -> Option<DVec3> {
        let distance = (self.ground_mm? - self.eye.y) / direction.y;
        let at_mm = self.eye + direction * distance;
        (direction.y < 0.0 && distance > 0.0 && at_mm.is_finite()).then_some(at_mm)
    }

    /// Adds what the matte points on the desk make of the light, and clears them.
    fn light_matte(&self, sums: &mut [Sum], desk: &mut Desk) {
        if desk.spots.is_empty() {
            return;
        }
        let samples = self.settings.samples_per_pixel as usize;
        let light = self.matte_lights.irradiance(self.bvh, &desk.spots, &mut desk.matte);
        for (Irradiance { lit, open }, (ray, matte)) in light.into_iter().zip(desk.of_spot.drain(..)) {
            let sum = &mut sums[ray as usize / samples];
            match matte {
                Matte::Opaque(response) => sum.matte += lit * response,
                Matte::Ground(background) => {
                    sum.ground += background;
                    sum.ground_light.lit += lit;
                    sum.ground_light.open += open;
                    sum.ground_rays += 1;
                }
            }
        }
        desk.spots.clear();
    }

    /// Casts the eye rays of some pixels and finds their hits.
    fn cast(&self, pixels: &[(usize, usize)], desk: &mut Desk) {
        let RenderSettings { camera, resolution, .. } = self.settings;
        desk.directions.clear();
        desk.rays.clear();
        desk.indices.clear();
        desk.hits.clear();
        let to_centre = self.centre - self.eye;
        let radius2 = self.radius_mm * self.radius_mm;
        for &(x, y) in pixels {
            let corner = DVec2::new(x as f64, y as f64);
            for offset in self.samples.of_pixel(Stream::Eye, (y * resolution.width + x) as u64) {
                let direction = camera.direction(corner + offset, *resolution);
                let along = to_centre.dot(direction);
                let beside = to_centre - direction * along;
                if beside.length_squared() <= radius2 && along >= -self.radius_mm {
                    // Far eyes start beside the scene: in 32 bits, the position of a far origin would move the picture.
                    let origin = self.eye + direction * (along - self.radius_mm).max(0.0);
                    desk.rays.push(Ray::new(origin.as_vec3(), direction.as_vec3()));
                    desk.indices.push(desk.directions.len() as u32);
                }
                desk.directions.push(direction);
            }
        }
        desk.hits.resize(desk.rays.len(), None);
        self.bvh.closest_many(&desk.rays, &mut desk.hits);
    }

    /// Adds the light that the places on the desk reflect, and clears them.
    fn reflect(&self, pixels: &[(usize, usize)], sums: &mut [Sum], desk: &mut Desk) {
        let samples = self.settings.samples_per_pixel as usize;
        if desk.places.is_empty() {
            return;
        }
        if self.lights.are_sampled() {
            let width = self.settings.resolution.width;
            let mut entries = desk.of_place.iter().zip(&mut desk.places).peekable();
            for (index, &(x, y)) in pixels.iter().enumerate() {
                let pixel = (y * width + x) as u64;
                let pairs = self.samples.of_pixel(Stream::Lobe, pixel);
                let pairs = pairs.zip(self.samples.of_pixel(Stream::Light, pixel));
                for (sample, (lobe, light)) in pairs.enumerate() {
                    let ray = (index * samples + sample) as u32;
                    if let Some((_, place)) = entries.next_if(|(of, _)| **of == ray) {
                        (place.lobe, place.light) = (lobe, light);
                    }
                }
            }
        }
        desk.reflected.clear();
        desk.reflected.resize(desk.places.len(), DVec3::ZERO);
        self.lights.add(self.bvh, &desk.places, &mut desk.shadow, &mut desk.reflected);
        for (ray, radiance) in desk.of_place.iter().zip(&desk.reflected) {
            let sum = &mut sums[*ray as usize / samples];
            sum.specular += *radiance;
            sum.glare += (*radiance - self.settings.white).max(DVec3::ZERO);
        }
        desk.places.clear();
        desk.of_place.clear();
    }

    /// Adds what an eye ray sees to a sum, or to what was seen where its exitance is asked for later; returns what else it
    /// meets.
    fn shade(&self, hit: &Hit, direction: DVec3, ray: EyeRay, sum: &mut Sum, seen: &mut Seen) -> Option<Met> {
        let Scene { mesh, parts, .. } = self.scene;
        let vertices = *mesh.triangles.get(hit.triangle as usize)?;
        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
        let weights = [1.0 - u - v, u, v];
        let blend = |values: [DVec3; 3]| values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2];
        let point = blend(mesh.corners_local_mm(hit.triangle));
        let geometric = self.normals.geometric(hit.triangle);
        let cos_geometric = -geometric.dot(direction);
        let smooth = self.normals.at(hit.triangle, weights);
        let normal = if smooth == DVec3::ZERO { geometric } else { smooth };
        let part = parts.triangle_part.get(hit.triangle as usize).copied().unwrap_or(u32::MAX);
        let medium = parts.parts.get(part as usize).and_then(|p| p.medium);
        let boundary = medium.and_then(|m| self.boundaries.get(m as usize));
        sum.normal += normal;
        sum.depth_mm += (point - self.eye).dot(self.settings.camera.forward());
        sum.hits += 1;
        sum.count(part);
        let least = LEAST_COSINE_SHARE * cos_geometric;
        let (triangle, lobe, light) = (hit.triangle, DVec2::ZERO, DVec2::ZERO);
        let Some(boundary) = boundary.filter(|_| cos_geometric > 0.0) else {
            let from_behind = cos_geometric <= 0.0;
            let Some(opaque) = self.settings.opaque.filter(|_| !from_behind) else {
                return Some(Met { from_behind, place: None, matte: None });
            };
            let to_eye = -direction;
            let normal = facing(normal, to_eye, least).unwrap_or(geometric);
            let own = self.texture.filter(|texture| texture.path().is_some());
            let base = own.map_or(opaque, |t| t.albedo(mesh, hit.triangle, weights, point));
            let spot = MattePoint { at_mm: point, triangle, geometric, normal, pixel: ray.pixel, sample: ray.sample };
            let reflecting = |highlight| Place { point, triangle, geometric, normal, to_eye, highlight, lobe, light };
            let place = self.opaque_highlight.map(reflecting);
            return Some(Met { from_behind: false, place, matte: Some((spot, base * self.opaque_response)) });
        };
        let cosine = (-normal.dot(direction)).max(least);
        let place = MeshPoint { triangle: hit.triangle, vertices, barycentric: weights, at_mm: point };
        let exit_radiance = boundary.exit.per_radiosity(cosine);
        let to_eye = -direction;
        let normal = facing(normal, to_eye, least).unwrap_or(geometric);
        let exit = ExitPoint { at_mm: point, normal, geometric, part };
        let medium = medium.map_or(0, |m| m as usize);
        if let Some(straight) = &self.straight {
            sum.straight += straight.radiance(&self.normals, &exit, (medium, to_eye));
        }
        let mut single = self.single.at(&Spot { point: &place, exit, to_eye, cosine, medium }, ray);
        let mut albedo = DVec3::ONE;
        if let Some(texture) = self.texture {
            albedo = texture.albedo(mesh, hit.triangle, weights, point);
            single *= albedo;
            sum.albedo += albedo;
        }
        match self.exitance {
            Source::Vertices(exitance) => sum.diffuse += exitance.at(&place) * exit_radiance * albedo,
            Source::Points(_) => {
                seen.add(&mut sum.footprints, place, albedo * exit_radiance, boundary.shared_within_mm);
            }
        }
        sum.single += single;
        let reflecting = |highlight| Place { point, triangle, geometric, normal, to_eye, highlight, lobe, light };
        Some(Met { from_behind: false, place: boundary.highlight.map(reflecting), matte: None })
    }
}

/// Adds the exitance of what was seen to the sums of its pixels; returns at how many points it is not finite.
fn add_seen(exitance: &dyn Exitance, seen: &mut Seen, sums: &mut [Sum]) -> u64 {
    let mut seen = seen.take(exitance).into_iter();
    let mut not_finite = 0;
    for sum in sums {
        for radiance in seen.by_ref().take(sum.footprints) {
            not_finite += u64::from(!radiance.is_finite());
            sum.diffuse += radiance;
        }
    }
    not_finite
}

/// The unit normal turned towards the eye until its cosine is at least `least`; none where it points straight away.
#[inline]
fn facing(normal: DVec3, to_eye: DVec3, least: f64) -> Option<DVec3> {
    let cosine = normal.dot(to_eye);
    if cosine >= least {
        return Some(normal);
    }
    let across = (normal - to_eye * cosine).try_normalize()?;
    Some(to_eye * least + across * (1.0 - least * least).max(0.0).sqrt())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn colours_beyond_32_bits_stay_finite() {
        assert_eq!(narrow(DVec3::new(1e300, -1e300, 0.5)), [f32::MAX, f32::MIN, 0.5]);
    }

    #[test]
    fn an_empty_pixel_has_no_normal_and_is_infinitely_deep() {
        let sum = Sum { background: DVec3::ONE, ..Sum::default() };
        assert_eq!(sum.pixel(16), Pixel { beauty: [1.0 / 16.0; 3], ..EMPTY });
    }

    #[test]
    fn the_part_with_most_hits_is_named_and_the_first_of_equals() {
        let mut sum = Sum { hits: 5, ..Sum::default() };
        [7, 2, 7, 2, 9].into_iter().for_each(|part| sum.count(part));
        assert_eq!(sum.pixel(8).part, 3);
        sum.count(7);
        assert_eq!(sum.pixel(8).part, 8);
    }

    #[test]
    fn normals_that_turn_away_are_turned_back() {
        let eye = DVec3::Z;
        assert_eq!(facing(DVec3::new(0.6, 0.0, 0.8), eye, 0.3), Some(DVec3::new(0.6, 0.0, 0.8)));
        let turned = facing(DVec3::new(0.8, 0.0, -0.6), eye, 0.3).unwrap();
        assert!((turned.dot(eye) - 0.3).abs() < 1e-12 && (turned.length() - 1.0).abs() < 1e-12 && turned.x > 0.9);
        assert_eq!(facing(-eye, eye, 0.3), None);
    }
}
