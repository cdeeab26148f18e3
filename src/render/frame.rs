//! Rendering: primary rays through the occluders' tree, radiosity between vertices, exit Fresnel, auxiliary planes.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::background::{Backdrop, Background};
use super::camera::{Camera, Resolution};
use super::exit::{ExitFresnel, ExitRadiance};
use super::normals::ShadingNormals;
use super::pixel_samples::PixelSamples;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::geometry::bvh::{Bvh, Hit, Ray};
use crate::light::Light;
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// Eye rays through a pixel where none are asked for.
pub const DEFAULT_SAMPLES_PER_PIXEL: u32 = 16;
/// Most eye rays through a pixel.
pub const MAX_SAMPLES_PER_PIXEL: u32 = 1 << 14;
/// Side of a tile in pixels.
const TILE: usize = 16;
/// The exit cosine is at least this share of the geometric one: a smooth normal may face away from the eye near the
/// outline of a coarse mesh, where Fresnel's factor would paint whole triangles black.
const LEAST_COSINE_SHARE: f64 = 0.5;

/// What to render beside the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// The eye.
    pub camera: Camera,
    /// Size of the picture.
    pub resolution: Resolution,
    /// Eye rays through a pixel: stratified over the pixel's square, all with the same weight (a box filter).
    pub samples_per_pixel: u32,
    /// How the exit Fresnel factor is normalised.
    pub exit_fresnel: ExitFresnel,
    /// What is seen beside the object.
    pub background: Background,
}

impl RenderSettings {
    /// The defaults for a camera and a size.
    pub fn new(camera: Camera, resolution: Resolution) -> Self {
        Self {
            camera,
            resolution,
            samples_per_pixel: DEFAULT_SAMPLES_PER_PIXEL,
            exit_fresnel: ExitFresnel::default(),
            background: Background::default(),
        }
    }
}

/// One pixel: means over its eye rays. Colours are linear sRGB radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Diffuse radiance where the object is, the background elsewhere.
    pub beauty: [f32; 3],
    /// Diffuse radiance, 0 beside the object: multiplied by the coverage, as OpenEXR has it.
    pub diffuse: [f32; 3],
    /// Unit mean of the shading normals in world axes; 0 where nothing is hit.
    pub normal: [f32; 3],
    /// Mean distance of what is hit along the viewing axis, in mm; infinite where nothing is hit.
    pub depth_mm: f32,
    /// Share of the eye rays that hit the object.
    pub coverage: f32,
}

/// A rendered picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Size.
    pub resolution: Resolution,
    /// Row by row from the top.
    pub pixels: Vec<Pixel>,
    /// Share of the hits that met a triangle from behind, where nothing shines: the eye is inside, or the mesh is open
    /// or wound inwards.
    pub back_facing_share: f64,
}

/// Bytes that rendering and writing a picture of this size takes at most, beside the scene.
pub fn memory_bytes(resolution: Resolution) -> u64 {
    // The pixels, a plane for each channel while a file is encoded, and its bytes.
    resolution.pixels() as u64 * (size_of::<Pixel>() as u64 + 4 * 12 + 2 * 4 * 12)
}

/// Renders a scene with the radiosity of its source vertices.
///
/// Exit radiance is that of [`ExitRadiance`] with the shading normal, for the medium of the part that is hit; opaque parts
/// and back sides are black. The result does not depend on the number of threads.
///
/// # Errors
/// A radiosity that is not finite or does not fit the mesh, no samples per pixel or too many (exit 4: a caller's
/// mistake).
pub fn render(
    evaluator: &dyn Evaluator,
    radiosity: &[DVec3],
    lights: &[Light],
    settings: &RenderSettings,
    progress: &dyn Progress,
) -> Result<Frame> {
    let (scene, bvh) = (evaluator.scene(), evaluator.bvh());
    check(scene, radiosity, settings)?;
    let resolution = settings.resolution;
    progress.start("render", resolution.height.div_ceil(TILE) as u64);
    let renderer = Renderer::new(scene, bvh, radiosity, lights, settings);
    let mut pixels = vec![Sum::default().pixel(1); resolution.pixels()];
    let back_facing = pixels
        .par_chunks_mut(TILE * resolution.width)
        .enumerate()
        .map(|(row, pixels)| {
            let counts = renderer.tile_row(row * TILE, pixels);
            progress.advance(1);
            counts
        })
        .reduce(Counts::default, Counts::add);
    progress.finish();
    Ok(Frame { resolution, pixels, back_facing_share: back_facing.share() })
}

fn check(scene: &Scene, radiosity: &[DVec3], settings: &RenderSettings) -> Result<()> {
    let vertices = scene.mesh.local_mm.len();
    if radiosity.len() != vertices {
        let given = radiosity.len();
        return Err(Error::runtime(format!("{given} values of radiosity for the {vertices} vertices of the mesh")));
    }
    if let Some(vertex) = radiosity.iter().position(|b| !b.is_finite()) {
        return Err(Error::runtime(format!("the radiosity of vertex {vertex} is {}", radiosity[vertex])));
    }
    if !(1..=MAX_SAMPLES_PER_PIXEL).contains(&settings.samples_per_pixel) {
        let asked = settings.samples_per_pixel;
        return Err(Error::command_line(format!(
            "{asked} samples per pixel: a number from 1 to {MAX_SAMPLES_PER_PIXEL} is needed"
        )));
    }
    Resolution::new(settings.resolution.width, settings.resolution.height).map(|_| ())
}

/// Hits, and those from behind. Integers add up to the same in any order.
#[derive(Clone, Copy, Default)]
struct Counts {
    hits: u64,
    from_behind: u64,
}

impl Counts {
    fn add(self, other: Self) -> Self {
        Self { hits: self.hits + other.hits, from_behind: self.from_behind + other.from_behind }
    }

    fn share(self) -> f64 {
        if self.hits == 0 { 0.0 } else { self.from_behind as f64 / self.hits as f64 }
    }
}

/// Sums over the eye rays of a pixel.
#[derive(Clone, Copy, Default)]
struct Sum {
    diffuse: DVec3,
    background: DVec3,
    normal: DVec3,
    depth_mm: f64,
    hits: u32,
}

impl Sum {
    fn pixel(&self, samples: u32) -> Pixel {
        let share = 1.0 / f64::from(samples);
        Pixel {
            beauty: narrow((self.diffuse + self.background) * share),
            diffuse: narrow(self.diffuse * share),
            normal: narrow(self.normal.normalize_or_zero()),
            depth_mm: if self.hits == 0 { f32::INFINITY } else { (self.depth_mm / f64::from(self.hits)) as f32 },
            coverage: (f64::from(self.hits) * share) as f32,
        }
    }
}

/// To 32 bits; what does not fit becomes the largest finite value.
fn narrow(v: DVec3) -> [f32; 3] {
    let limit = f64::from(f32::MAX);
    v.to_array().map(|c| c.clamp(-limit, limit) as f32)
}

/// What an eye ray sees of the object.
struct Seen {
    radiance: DVec3,
    normal: DVec3,
    depth_mm: f64,
    from_behind: bool,
}

struct Renderer<'a> {
    scene: &'a Scene,
    bvh: &'a Bvh,
    radiosity: &'a [DVec3],
    settings: &'a RenderSettings,
    backdrop: Backdrop<'a>,
    normals: ShadingNormals,
    samples: PixelSamples,
    /// For each medium.
    exits: Vec<ExitRadiance>,
    /// The eye in the mesh's local coordinates.
    eye: DVec3,
    /// A sphere around the mesh in its local coordinates.
    centre: DVec3,
    radius_mm: f64,
}

impl<'a> Renderer<'a> {
    fn new(
        scene: &'a Scene,
        bvh: &'a Bvh,
        radiosity: &'a [DVec3],
        lights: &'a [Light],
        settings: &'a RenderSettings,
    ) -> Self {
        let [min, max] = scene.mesh.bounds_local_mm();
        let exit = |eta| ExitRadiance::new(eta, settings.exit_fresnel);
        Self {
            scene,
            bvh,
            radiosity,
            settings,
            backdrop: Backdrop::new(settings.background, lights),
            normals: ShadingNormals::new(scene),
            samples: PixelSamples::new(settings.samples_per_pixel),
            exits: scene.media.iter().map(|m| exit(m.properties.eta_inside_over_outside)).collect(),
            eye: settings.camera.at_mm() - scene.mesh.origin_mm,
            centre: 0.5 * (min + max),
            // A little larger, so that rounding cuts nothing off.
            radius_mm: 0.5 * (max - min).length() * (1.0 + 1e-6),
        }
    }

    /// Renders the rows from `top` on that `pixels` holds.
    fn tile_row(&self, top: usize, pixels: &mut [Pixel]) -> Counts {
        let width = self.settings.resolution.width;
        let rows = pixels.len() / width;
        let tiles: Vec<(Vec<Pixel>, Counts)> = (0..width.div_ceil(TILE))
            .into_par_iter()
            .map(|tile| {
                let columns = tile * TILE..width.min((tile + 1) * TILE);
                let mut counts = Counts::default();
                let places = (top..top + rows).flat_map(|y| columns.clone().map(move |x| (x, y)));
                let tile = places.map(|(x, y)| self.pixel(x, y, &mut counts)).collect();
                (tile, counts)
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

    fn pixel(&self, x: usize, y: usize, counts: &mut Counts) -> Pixel {
        let RenderSettings { camera, resolution, samples_per_pixel, .. } = self.settings;
        let corner = DVec2::new(x as f64, y as f64);
        let mut sum = Sum::default();
        for offset in self.samples.of_pixel((y * resolution.width + x) as u64) {
            let direction = camera.direction(corner + offset, *resolution);
            match self.look(direction) {
                Some(seen) => {
                    sum.diffuse += seen.radiance;
                    sum.normal += seen.normal;
                    sum.depth_mm += seen.depth_mm;
                    sum.hits += 1;
                    counts.from_behind += u64::from(seen.from_behind);
                }
                None => sum.background += self.backdrop.radiance(direction),
            }
        }
        counts.hits += u64::from(sum.hits);
        sum.pixel(*samples_per_pixel)
    }

    /// What is seen along a unit direction.
    #[inline]
    fn look(&self, direction: DVec3) -> Option<Seen> {
        let to_centre = self.centre - self.eye;
        let along = to_centre.dot(direction);
        let beside = (to_centre - direction * along).length();
        if beside > self.radius_mm || along < -self.radius_mm {
            return None;
        }
        // Far eyes start beside the scene: in 32 bits, the position of a far origin would move the picture.
        let origin = self.eye + direction * (along - self.radius_mm).max(0.0);
        let hit = self.bvh.closest(&Ray::new(origin.as_vec3(), direction.as_vec3()))?;
        self.shade(&hit, direction)
    }

    fn shade(&self, hit: &Hit, direction: DVec3) -> Option<Seen> {
        let Scene { mesh, parts, .. } = self.scene;
        let vertices = *mesh.triangles.get(hit.triangle as usize)?;
        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
        let weights = [1.0 - u - v, u, v];
        let blend = |values: [DVec3; 3]| values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2];
        let point = blend(mesh.corners_local_mm(hit.triangle));
        let geometric = mesh.normal(hit.triangle);
        let cos_geometric = -geometric.dot(direction);
        let smooth = self.normals.at(hit.triangle, weights);
        let normal = if smooth == DVec3::ZERO { geometric } else { smooth };
        let part = parts.triangle_part.get(hit.triangle as usize).and_then(|p| parts.parts.get(*p as usize));
        let exit = part.and_then(|p| p.medium).and_then(|m| self.exits.get(m as usize));
        let radiance = match exit {
            Some(exit) if cos_geometric > 0.0 => {
                let cosine = (-normal.dot(direction)).max(LEAST_COSINE_SHARE * cos_geometric);
                blend(vertices.map(|v| self.radiosity[v as usize])) * exit.per_radiosity(cosine)
            }
            _ => DVec3::ZERO,
        };
        let depth_mm = (point - self.eye).dot(self.settings.camera.forward());
        Some(Seen { radiance, normal, depth_mm, from_behind: cos_geometric <= 0.0 })
    }
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
        let pixel = Sum::default().pixel(16);
        assert_eq!((pixel.normal, pixel.coverage, pixel.depth_mm), ([0.0; 3], 0.0, f32::INFINITY));
    }
}
