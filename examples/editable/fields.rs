//! Area lights through source radiance fields against shadow rays: what each step costs in error, and what it saves in time.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::forms::environment_rows::StoredRows;
use translux::geometry::bvh::{Bvh, Ray};
use translux::geometry::mesh::Scale;
use translux::geometry::parts::PartsRule;
use translux::geometry::samples::{Patch, patches};
use translux::geometry::shapes::{compose, cuboid};
use translux::io::obj::read_obj;
use translux::light::{Light, LightKind};
use translux::math::random::uniform;
use translux::math::spherical_rectangle::SphericalRectangle;
use translux::math::statistics::vertex_error;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::medium::fresnel::transmittance;
use translux::medium::material::Medium;
use translux::methods;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::gather::{Gather, Scheme};
use translux::transport::irradiance::{Illumination, LightSampling};
use translux::transport::near_rule::NearField;
use translux::transport::receivers::Receivers;
use translux::transport::surface::Surface;
use translux::transport::tree::SampleTree;
use translux::transport::visibility::Observer;

use crate::bench::{open, percent};
use crate::common::bench::{Context, Recipe, SIZE_MM, bake_for, properties, scene_of, table};
use crate::common::runner::summary;

/// Edges of the lights, and their distances from the surface, mm.
const SIZES_MM: [f64; 3] = [2.0, 6.0, 18.0];
const GAPS_MM: [f64; 5] = [1.0, 3.0, 10.0, 30.0, 100.0];

/// The light of the tables of steps, times and walls.
const SIZE: f64 = 6.0;
const GAP: f64 = 10.0;

/// A light so near that most samples it reaches have maps of their own.
const NEAR: (f64, f64) = (18.0, 1.0);

/// Points of the field, and those of the errors.
const POINTS: [u16; 4] = [8, 16, 32, 64];
const DEFAULT: u16 = 32;

/// How far a wall is behind the light, mm.
const WALLS_MM: [f64; 2] = [20.0, 2.0];

const SAMPLES: usize = 32_768;
const TIMED_SAMPLES: usize = 131_072;
const QUICK_SAMPLES: usize = 8192;
const MATERIAL: &str = "marble";

/// Receivers that the radiosity is summed at.
const RECEIVERS: usize = 512;

/// Strata of the truth along an edge of a light.
const TRUTH_SIDE: u32 = 16;

/// Times of which the median is taken.
const REPEATS: usize = 9;

/// Rows as they are by default, and the finest.
const ROWS: [&[(&str, &str)]; 2] = [&[("points", "1")], &[("points", "1"), ("cube", "64"), ("coefficients", "1024")]];

const STAGE: u64 = 71;

/// Where the lights are, from the middle of the model.
const TOWARDS: DVec3 = DVec3::new(0.4, 0.7, 0.6);

/// A square light of radiance 1 that faces the model, some way off its surface.
fn light(scene: &Scene, bvh: &Bvh, size_mm: f64, gap_mm: f64) -> Result<Light> {
    let [low, high] = scene.mesh.bounds_local_mm();
    let (middle, way) = (0.5 * (low + high), TOWARDS.normalize());
    let far = middle + 2.0 * SIZE_MM * way;
    let hit = bvh.closest(&Ray::new(far.as_vec3(), (-way).as_vec3()));
    let hit = hit.ok_or_else(|| Error::runtime("no surface towards the light"))?;
    let surface = far - way * f64::from(hit.t);
    let at_mm = surface + gap_mm * way + scene.mesh.origin_mm;
    Light::area(at_mm, -way, [size_mm; 2], DVec3::ONE, None)
}

/// How far shadow rays go.
#[derive(Clone, Copy)]
enum Reach {
    Light,
    Infinity,
}

/// A scene with samples, rows, and receivers.
struct Bench {
    asset: Arc<Asset>,
    bvh: Bvh,
    patches: Vec<Patch>,
    rows: StoredRows,
    receivers: Receivers,
    areas: Vec<f64>,
}

/// RMS of the irradiance and of the radiosity.
#[derive(Clone, Copy)]
struct Rms {
    irradiance: f64,
    radiosity: f64,
}

impl Rms {
    fn text(self) -> String {
        let text = |share: f64| if share < 5e-6 { "0".to_owned() } else { percent(share) };
        format!("{}, {}", text(self.irradiance), text(self.radiosity))
    }
}

/// Irradiance of the samples, and the radiosity that it gives.
struct Lit {
    irradiance: Vec<DVec3>,
    radiosity: Vec<DVec3>,
}

impl Bench {
    fn new(scene: &Scene, samples: usize, set: &[(&str, &str)]) -> Result<Self> {
        let method = methods::built_in().method("editable")?;
        let recipe = Recipe { samples: Some(samples), max_rms: method.default_max_rms(), set };
        let asset = Arc::new(bake_for(LightKind::Environment, method, scene, &recipe, &Silent)?);
        let rows = StoredRows::of(&asset)?.ok_or_else(|| Error::runtime("the asset has no rows"))?;
        let all = Receivers::new(&scene.mesh, &scene.parts, 16);
        let (receivers, points) = all.probe_points(&all.areas_mm2(&scene.mesh), (RECEIVERS, 1));
        let (bvh, patches) = (Bvh::new(&scene.mesh), patches(&scene.mesh, &asset.samples));
        Ok(Self { asset, bvh, patches, rows, receivers, areas: points.areas_mm2 })
    }

    fn surface(&self) -> Surface<'_> {
        Surface {
            domain: self.asset.scene.domain(),
            bvh: &self.bvh,
            samples: &self.asset.samples,
            patches: &self.patches,
        }
    }

    fn lit(&self, irradiance: Vec<DVec3>) -> Lit {
        let (surface, tree) = (self.surface(), SampleTree::default());
        let gather = Gather::new(&surface, &tree, surface.domain.media, NearField::for_error(0.005));
        let radiosity = gather.radiosity(&self.receivers, &gather.light(&irradiance), Scheme::AllPairs, &Silent);
        Lit { irradiance, radiosity }
    }

    /// Of the difference between two, in the unit of the truth.
    fn step(&self, found: &Lit, expected: &Lit, truth: &Lit) -> Rms {
        let moved = |f: &[DVec3], e: &[DVec3], t: &[DVec3]| -> Vec<DVec3> {
            f.iter().zip(e).zip(t).map(|((f, e), t)| *t + (*f - *e)).collect()
        };
        let areas: Vec<f64> = self.patches.iter().map(|p| p.area_mm2).collect();
        let irradiance = moved(&found.irradiance, &expected.irradiance, &truth.irradiance);
        let radiosity = moved(&found.radiosity, &expected.radiosity, &truth.radiosity);
        Rms {
            irradiance: vertex_error(&irradiance, &truth.irradiance, &areas).rms,
            radiosity: vertex_error(&radiosity, &truth.radiosity, &self.areas).rms,
        }
    }

    /// By as many shadow rays as there are strata, from several points of each sample.
    fn truth(&self, light: &Light) -> Result<Lit> {
        let (surface, lights) = (self.surface(), [light.clone()]);
        let etas: Vec<f64> = surface.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let sampling = LightSampling { area_side: TRUTH_SIDE, ..LightSampling::REFERENCE };
        Ok(self.lit(Illumination::new(&surface, &lights, &etas, sampling)?.all(&Silent)))
    }

    /// By rays from the points that the rows belong to, which end at the light or nowhere.
    fn by_rays_of_rows(&self, light: &Light, reach: Reach) -> Lit {
        let surface = self.surface();
        let (mesh, eta) = (surface.domain.mesh, surface.domain.media[0].properties.eta_inside_over_outside);
        let of = |patch: usize| {
            let Light::Area { at_mm, normal, u, size_mm, radiance, .. } = light else { return DVec3::ZERO };
            let observer = Observer::of(mesh, surface.samples.patch(patch));
            let (eye, centre, v) = (observer.eye.as_dvec3(), *at_mm - mesh.origin_mm, normal.cross(*u));
            if (eye - centre).dot(*normal) <= 0.0 {
                return DVec3::ZERO;
            }
            let corner = centre - 0.5 * size_mm[0] * *u - 0.5 * size_mm[1] * v;
            let rectangle = SphericalRectangle::new(eye, corner, *u, v, *size_mm);
            let mut sum = 0.0;
            for cell in 0..TRUTH_SIDE * TRUTH_SIDE {
                let key = patch as u64 * u64::from(TRUTH_SIDE * TRUTH_SIDE) + u64::from(cell);
                let at = |i: u32, d: u64| (f64::from(i) + uniform(STAGE, key, d)) / f64::from(TRUTH_SIDE);
                let way = rectangle.sample(at(cell % TRUTH_SIDE, 0), at(cell / TRUTH_SIDE, 1)) - eye;
                let (distance, towards) = (way.length(), way.normalize_or_zero());
                let cosine = towards.dot(observer.normal);
                if cosine <= 0.0 {
                    continue;
                }
                let mut ray = observer.ray(towards);
                if let Reach::Light = reach {
                    ray.t_max = distance as f32;
                }
                if !self.bvh.occluded(&ray, observer.triangle) {
                    sum += cosine * transmittance(eta, cosine);
                }
            }
            *radiance * (sum * rectangle.solid_angle() / f64::from(TRUTH_SIDE * TRUTH_SIDE))
        };
        self.lit((0..surface.samples.len()).into_par_iter().map(of).collect())
    }

    fn field(&self, light: &Light, points: u16) -> Result<Lit> {
        let (surface, mut irradiance) = (self.surface(), vec![DVec3::ZERO; self.patches.len()]);
        let light = light.clone().through_field(points)?;
        self.rows.add(&[light], surface.domain, surface.samples, &mut irradiance)?;
        Ok(self.lit(irradiance))
    }

    fn own_maps(&self, light: &Light) -> Result<Lit> {
        let (surface, light) = (self.surface(), light.clone().through_field(DEFAULT)?);
        Ok(self.lit(self.rows.without_interpolation(&light, surface.domain, surface.samples)?))
    }
}

/// What a field differs by from the truth, step by step, and in all.
struct Steps([Rms; 5]);

const STEPS: [&str; 5] = [
    "interpolation of the field",
    "cube map and rows",
    "occluders beyond the light",
    "one point for a sample",
    "everything",
];

fn steps(bench: &Bench, light: &Light) -> Result<Steps> {
    let (field, own, truth) = (bench.field(light, DEFAULT)?, bench.own_maps(light)?, bench.truth(light)?);
    let [beyond, local] = [Reach::Infinity, Reach::Light].map(|reach| bench.by_rays_of_rows(light, reach));
    let chain = [&field, &own, &beyond, &local, &truth];
    let step = |k: usize| match k {
        0..4 => bench.step(chain[k], chain[k + 1], &truth),
        _ => bench.step(&field, &truth, &truth),
    };
    Ok(Steps(std::array::from_fn(step)))
}

/// Median milliseconds.
fn median_ms(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(0.0)
}

/// Errors by size and distance, and the chart of one size.
fn by_distance(context: &Context, scene: &Scene, samples: usize) -> Result<(String, f64)> {
    let [plain, fine] = ROWS.map(|set| Bench::new(scene, samples, set));
    let (plain, fine) = (plain?, fine?);
    let (mut rows, mut points, mut shown) = (Vec::new(), Vec::new(), 0.0);
    for size in context.some(&SIZES_MM, 2) {
        for gap in context.some(&GAPS_MM, 3) {
            let light = light(scene, &plain.bvh, size, gap)?;
            let Steps(steps) = steps(&plain, &light)?;
            let truth = fine.truth(&light)?;
            let better = fine.step(&fine.field(&light, DEFAULT)?, &truth, &truth);
            let mut row = vec![format!("{size} mm"), format!("{gap} mm")];
            row.extend(steps.iter().map(|step| step.text()));
            row.push(better.text());
            context.say(&format!("fields: {}", row.join(" | ")));
            rows.push(row);
            if size == SIZE {
                // A logarithmic axis has no 0.
                let there = |(_, step): &(&&str, &Rms)| step.radiosity >= 1e-5;
                let point =
                    |(name, step): (&&str, &Rms)| Point { series: (*name).to_owned(), x: gap, y: step.radiosity };
                points.extend(STEPS.iter().zip(&steps).filter(there).map(point));
                if gap == GAP {
                    shown = steps[4].radiosity;
                }
            }
        }
    }
    points.sort_by_key(|point| STEPS.iter().position(|name| *name == point.series));
    let chart = Scatter {
        title: format!("A field instead of shadow rays, a light of {SIZE} mm, {}", context.model()),
        axes: ["distance of the light from the surface, mm", "RMS of the radiosity"].map(str::to_owned),
        units: [Unit::Number, Unit::Percent],
        points,
        lines: Vec::new(),
        front: Front::Left,
    };
    let file = "editable_fields.svg";
    translux::io::atomic::write(&context.pictures.join(file), as_svg(&chart)?.as_bytes())?;
    let mut head = vec!["edge", "distance"];
    head.extend(STEPS);
    head.push("everything, 64 texels, 1024 coefficients");
    Ok((format!("![Errors of a field](pictures/{file})\n\n{}", table(&head, &rows)), shown))
}

/// The model with a wall behind the light.
fn with_wall(context: &Context, wall_mm: Option<f64>) -> Result<(Scene, Light)> {
    let mut model = read_obj(&context.data.join(format!("meshes/{}.obj", context.model())))?;
    let fold = |start: DVec3, f: fn(DVec3, DVec3) -> DVec3| model.positions.iter().fold(start, |a, b| f(a, *b));
    let (low, high) = (fold(DVec3::INFINITY, DVec3::min), fold(DVec3::NEG_INFINITY, DVec3::max));
    let (middle, scale) = (0.5 * (low + high), SIZE_MM / (high - low).length());
    model.positions.iter_mut().for_each(|p| *p = scale * (*p - middle));
    (model.normals, model.uvs) = (None, None);
    let medium = || Ok::<Medium, Error>(Medium { name: MATERIAL.to_owned(), properties: properties(MATERIAL)? });
    let place = |source| scene_of(source, Scale::MillimetresPerUnit(1.0), PartsRule::Auto, medium()?);
    let alone = place(model.clone())?;
    let light = light(&alone, &Bvh::new(&alone.mesh), SIZE, GAP)?;
    let (Some(wall_mm), Light::Area { at_mm, normal, .. }) = (wall_mm, &light) else { return Ok((alone, light)) };
    // A thin slab across the way of the light: its own z turned to where the light looks.
    let mut slab = cuboid(DVec3::new(40.0, 40.0, 1.0), 8);
    let turn = glam::DQuat::from_rotation_arc(DVec3::Z, *normal);
    slab.positions.iter_mut().for_each(|p| *p = turn * *p);
    (slab.normals, slab.uvs) = (None, None);
    let behind = *at_mm - (wall_mm + 0.5) * *normal;
    Ok((place(compose(&[(model, DVec3::ZERO), (slab, behind)]))?, light))
}

fn walls(context: &Context, samples: usize) -> Result<String> {
    let mut rows = Vec::new();
    for wall in [None].into_iter().chain(context.some(&WALLS_MM, 1).into_iter().map(Some)) {
        let (scene, light) = with_wall(context, wall)?;
        let Steps(steps) = steps(&Bench::new(&scene, samples, ROWS[0])?, &light)?;
        let mut row = vec![wall.map_or_else(|| "none".to_owned(), |mm| format!("{mm} mm behind the light"))];
        row.extend(steps.iter().map(|step| step.text()));
        context.say(&format!("fields: wall {}", row.join(" | ")));
        rows.push(row);
    }
    let mut head = vec!["wall"];
    head.extend(STEPS);
    Ok(table(&head, &rows))
}

/// Milliseconds of a light that moves from place to place, and of one that turns as well: the samples' irradiance alone, and with the
/// radiosity of a moved one.
fn times_ms(bench: &Bench, light: &Light) -> Result<[f64; 3]> {
    let mut evaluator = open((*bench.asset).clone())?;
    let mut times = [Vec::new(), Vec::new(), Vec::new()];
    let step = |turn: usize, turned: bool| -> Result<Light> {
        let mut light = light.clone();
        if let Light::Area { at_mm, normal, u, .. } = &mut light {
            let shift = turn as f64 * 0.37;
            *at_mm += DVec3::new(shift, -0.4 * shift, 0.2 * shift);
            if turned {
                let rotation = glam::DQuat::from_rotation_y(0.01 * (turn + 1) as f64);
                (*normal, *u) = (rotation * *normal, rotation * *u);
            }
        }
        Ok(light)
    };
    evaluator.set_lights(vec![step(0, false)?], &Silent)?;
    evaluator.radiosity(&Silent)?;
    for turn in 0..REPEATS {
        let start = Instant::now();
        evaluator.set_lights(vec![step(turn, false)?], &Silent)?;
        times[0].push(start.elapsed().as_secs_f64() * 1e3);
        evaluator.radiosity(&Silent)?;
        times[1].push(start.elapsed().as_secs_f64() * 1e3);
    }
    for turn in 0..REPEATS {
        let start = Instant::now();
        evaluator.set_lights(vec![step(turn, true)?], &Silent)?;
        times[2].push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(times.map(median_ms))
}

fn times(context: &Context, scene: &Scene, error: f64) -> Result<String> {
    let samples = if context.quick { QUICK_SAMPLES } else { TIMED_SAMPLES };
    let bench = Bench::new(scene, samples, ROWS[0])?;
    let light = light(scene, &bench.bvh, SIZE, GAP)?;
    let own = bench.own_maps(&light)?;
    let own_ms = {
        let (surface, light) = (bench.surface(), light.clone().through_field(DEFAULT)?);
        let time = |_| -> Result<f64> {
            let start = Instant::now();
            bench.rows.without_interpolation(&light, surface.domain, surface.samples)?;
            Ok(start.elapsed().as_secs_f64() * 1e3)
        };
        median_ms((0..3).map(time).collect::<Result<_>>()?)
    };
    let ms = |time: f64| format!("{time:.0} ms");
    let rays = times_ms(&bench, &light)?;
    context.say(&format!("fields: rays {rays:.0?} ms, own maps {own_ms:.0} ms"));
    let mut rows = vec![vec![
        "shadow rays, 8 x 8".to_owned(),
        "-".to_owned(),
        ms(rays[0]),
        ms(rays[1]),
        ms(rays[2]),
        "-".to_owned(),
    ]];
    rows.push(vec!["a map for each sample".into(), "-".into(), ms(own_ms), "-".into(), ms(own_ms), "0".into()]);
    let mut text = String::new();
    for points in context.some(&POINTS, 3) {
        let with_field = light.clone().through_field(points)?;
        let lost = bench.step(&bench.field(&light, points)?, &own, &own);
        let bytes = bench.rows.field_bytes(&with_field)?;
        let times = times_ms(&bench, &with_field)?;
        rows.push(vec![
            format!("field={points}"),
            format!("{:.1} MB", bytes as f64 / 1e6),
            ms(times[0]),
            ms(times[1]),
            ms(times[2]),
            lost.text(),
        ]);
        context.say(&format!("fields: {}", rows.last().map_or_else(String::new, |row| row.join(" | "))));
        if points == DEFAULT {
            text += &summary(
                &format!(
                    "irradiance of {samples} samples as an area light moves: source radiance field against shadow rays; RMS of the \
                     radiosity of {SAMPLES}"
                ),
                "no figure",
                "what it costs",
                &format!("{} against {}; {}", ms(times[0]), ms(rays[0]), percent(error)),
            );
        }
    }
    let near = self::light(scene, &bench.bvh, NEAR.0, NEAR.1)?;
    let lost = bench.step(&bench.field(&near, DEFAULT)?, &bench.own_maps(&near)?, &bench.own_maps(&near)?);
    for (name, light, lost) in
        [("shadow rays", near.clone(), "-".to_owned()), ("field=32", near.clone().through_field(DEFAULT)?, lost.text())]
    {
        let times = times_ms(&bench, &light)?.map(ms);
        let name = format!("{name}, {} mm wide, {} mm away", NEAR.0, NEAR.1);
        rows.push([name, "-".to_owned()].into_iter().chain(times).chain([lost]).collect());
    }
    let head = [
        "the light's way to the samples",
        "field",
        "moved: irradiance",
        "moved: radiosity",
        "moved and turned: irradiance",
        "interpolation",
    ];
    Ok(text + &table(&head, &rows))
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let scene = context.scene(context.model(), MATERIAL)?;
    let samples = if context.quick { QUICK_SAMPLES } else { SAMPLES };
    let (errors, shown) = by_distance(context, &scene, samples)?;
    let walls = walls(context, samples)?;
    let times = times(context, &scene, shown)?;
    Ok(format!("{errors}\n@fields-walls@\n\n{walls}\n@fields-times@\n\n{times}"))
}
