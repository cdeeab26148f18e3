//! What the parts share: lights, truths, errors.

use std::sync::Arc;

use glam::{DVec3, Vec3Swizzles};
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::evaluate::Evaluator;
use translux::io::environment::load_environment;
use translux::light::environment::EnvironmentMap;
use translux::light::quantised::directions::lattice;
use translux::light::{Light, LightKind};
use translux::math::cube_map::FACES;
use translux::methods;
use translux::progress::{Progress, Silent};
use translux::scene::Scene;

use crate::common::bench::{Context, Recipe, bake_for, parallel};

/// The error that the method is asked for unless another is said: its default.
pub(crate) const DEFAULT_RMS: f64 = 0.01;

/// Energy of constant light of radiance 1, which a sun beside it has as well: its irradiance.
pub(crate) const SPHERE: f64 = 4.0 * std::f64::consts::PI;

/// Samples and rays of each towards an environment, of two truths that share neither.
const TRUTHS: [(usize, &str); 2] = [(98_304, "48"), (81_920, "40")];
const QUICK_TRUTHS: [(usize, &str); 2] = [(16_384, "32"), (12_288, "28")];

/// Samples of bakes that are compared with each other.
const SAMPLES: usize = 98_304;

/// Samples of a bake where little is to be done.
const QUICK_SAMPLES: usize = 16_384;

/// Error that the truths ask of their hierarchy and near field.
const TRUTH_RMS: f64 = 0.002;

/// Share of the brightest channel's RMS below which a channel's own RMS is not used as the unit, as everywhere.
const CHANNEL_FLOOR: f64 = 1e-3;

/// An environment of the data.
pub(crate) struct Map {
    pub(crate) name: String,
    map: Arc<EnvironmentMap>,
}

impl Map {
    /// One by its file's name.
    pub(crate) fn load(context: &Context, file: &str) -> Result<Self> {
        let loaded = load_environment(&context.data.join("env").join(file))?;
        let name = file.split('.').next().unwrap_or(file).to_owned();
        Ok(Self { name, map: Arc::new(loaded.value) })
    }

    /// All of them, in the order of their names.
    pub(crate) fn all(context: &Context) -> Result<Vec<Self>> {
        let folder = context.data.join("env");
        let entries = std::fs::read_dir(&folder).map_err(|e| Error::io(&folder, &e))?;
        let mut files: Vec<String> = entries.filter_map(|e| e.ok()?.file_name().into_string().ok()).collect();
        files.sort_unstable();
        files.truncate(if context.quick { 2 } else { files.len() });
        files.iter().map(|file| Self::load(context, file)).collect()
    }

    /// Turned.
    pub(crate) fn light(&self, rotate_degrees: f64) -> Light {
        Light::Environment { map: Arc::clone(&self.map), rotate_degrees, scale: DVec3::ONE }
    }
}

/// A sun of irradiance 1 from the `index`-th of `count` directions that are spread over the sphere, about another axis than the
/// probes that a bake sees.
pub(crate) fn sun(index: usize, count: usize) -> Light {
    parallel(lattice(count, 0.5)[index].yzx())
}

/// Constant light of radiance 1 with a sun that has as much energy.
pub(crate) fn half_in(sun: &Light) -> Vec<Light> {
    let from = if let Light::Directional { from, .. } = sun { *from } else { DVec3::Y };
    vec![Light::Constant { radiance: DVec3::ONE }, Light::Directional { from, irradiance: DVec3::splat(SPHERE) }]
}

/// Bakes for environments.
pub(crate) fn bake(scene: &Scene, recipe: &Recipe, progress: &dyn Progress) -> Result<Asset> {
    bake_for(LightKind::Environment, methods::built_in().method("all_frequency")?, scene, recipe, progress)
}

/// A recipe with the samples that the error asks for, or few where little is to be done.
pub(crate) fn recipe<'a>(context: &Context, set: &'a [(&'a str, &'a str)]) -> Recipe<'a> {
    Recipe { samples: context.quick.then_some(QUICK_SAMPLES), max_rms: DEFAULT_RMS, set }
}

/// The same with samples that do not depend on the error, so that only what is compared differs.
pub(crate) fn compared<'a>(context: &Context, set: &'a [(&'a str, &'a str)]) -> Recipe<'a> {
    Recipe { samples: Some(if context.quick { QUICK_SAMPLES } else { SAMPLES }), ..recipe(context, set) }
}

/// Bakes with some keys and opens.
pub(crate) fn baked(context: &Context, scene: &Scene, set: &[(&str, &str)]) -> Result<Box<dyn Evaluator>> {
    open(bake(scene, &compared(context, set), &Silent)?)
}

/// At run time.
pub(crate) fn open(asset: Asset) -> Result<Box<dyn Evaluator>> {
    methods::built_in().open(Arc::new(asset))
}

/// Radiosity of every vertex.
pub(crate) fn under(evaluator: &mut dyn Evaluator, lights: &[Light]) -> Result<Vec<DVec3>> {
    evaluator.set_lights(lights.to_vec(), &Silent)?;
    evaluator.radiosity(&Silent)
}

/// `two_pass`, twice, with samples and rays of their own: what one of them has by chance the other has not.
pub(crate) struct Truth {
    both: [Box<dyn Evaluator>; 2],
    areas: Vec<f64>,
}

/// Radiosities of a truth under some light.
#[derive(Clone)]
pub(crate) struct Expected([Vec<DVec3>; 2]);

/// How far some radiosities are from a truth.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Found {
    /// Relative RMS, worst channel, without the truth's noise: the mean of `(x - a)(x - b)` over two truths, in which what is
    /// random in either cancels.
    pub(crate) rms: f64,
    /// RMS of half the difference of the two truths, likewise: the noise of their mean.
    pub(crate) noise: f64,
}

impl Truth {
    pub(crate) fn new(context: &Context, scene: &Scene) -> Result<Self> {
        let truths = if context.quick { QUICK_TRUTHS } else { TRUTHS };
        let [a, b] = truths.map(|(samples, directions)| -> Result<Box<dyn Evaluator>> {
            let method = methods::built_in().method("two_pass")?;
            let set = [("directions", directions)];
            let recipe = Recipe { samples: Some(samples), max_rms: TRUTH_RMS, set: &set };
            methods::built_in().open(Arc::new(bake_for(LightKind::Environment, method, scene, &recipe, &Silent)?))
        });
        Ok(Self { both: [a?, b?], areas: scene.vertex_areas_mm2() })
    }

    /// Under some lights together.
    pub(crate) fn under(&mut self, lights: &[Light]) -> Result<Expected> {
        let [a, b] = &mut self.both;
        Ok(Expected([under(a.as_mut(), lights)?, under(b.as_mut(), lights)?]))
    }

    /// The error of some radiosities.
    pub(crate) fn error(&self, values: &[DVec3], expected: &Expected) -> Found {
        self.error_where(values, expected, |_| true)
    }

    /// The same at some vertices alone.
    pub(crate) fn error_where(&self, values: &[DVec3], expected: &Expected, at: impl Fn(usize) -> bool) -> Found {
        let Expected([a, b]) = expected;
        let (mut error, mut noise, mut unit) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        let triples = values.iter().zip(a).zip(b).zip(&self.areas).enumerate();
        for (_, (((x, a), b), area)) in triples.filter(|(i, _)| at(*i)) {
            error += *area * (*x - *a) * (*x - *b);
            noise += *area * (*a - *b) * (*a - *b) * 0.25;
            unit += *area * *a * *b;
        }
        let brightest = unit.max_element();
        let relative = |square: DVec3| {
            let unit = unit.max(DVec3::splat(CHANNEL_FLOOR * CHANNEL_FLOOR * brightest));
            let worst = (square / unit).max_element();
            if worst.is_finite() { worst.max(0.0).sqrt() } else { 0.0 }
        };
        Found { rms: relative(error), noise: relative(noise) }
    }
}

impl Expected {
    /// Both together with those under other lights.
    pub(crate) fn plus(&self, other: &Self, factor: f64) -> Self {
        let sum = |k: usize| self.0[k].iter().zip(&other.0[k]).map(|(a, b)| *a + factor * *b).collect();
        Self([sum(0), sum(1)])
    }
}

/// Mean (of the squares) and largest of some errors.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spread {
    pub(crate) mean: f64,
    pub(crate) worst: f64,
    pub(crate) noise: f64,
}

impl Spread {
    pub(crate) fn of(all: &[Found]) -> Self {
        let mean = |figure: fn(&Found) -> f64| {
            (all.iter().map(|f| figure(f).powi(2)).sum::<f64>() / all.len().max(1) as f64).sqrt()
        };
        let worst = all.iter().map(|f| f.rms).fold(0.0, f64::max);
        Self { mean: mean(|f| f.rms), worst, noise: mean(|f| f.noise) }
    }
}

/// A share in percent, with the digits that it is worth.
pub(crate) fn percent(share: f64) -> String {
    let value = 100.0 * share;
    match value.abs() {
        v if v >= 9.95 => format!("{value:.0} %"),
        v if v >= 0.995 => format!("{value:.1} %"),
        _ => format!("{value:.2} %"),
    }
}

/// Centres of texels of a cube map that are spread over all of them, or the corners that four of them share.
pub(crate) fn texels(side: usize, count: usize, offset: f64) -> Vec<DVec3> {
    use translux::math::cube_map::FRAMES;
    let all = FACES * side * side;
    let at = |i: usize| {
        // Far from the edges of faces, where texels of two faces meet.
        let texel = (i * all) / count + all / (2 * count);
        let (face, place) = (texel / (side * side), texel % (side * side));
        let turned = (place * 37) % (side * side);
        let inside = |k: usize| (k.clamp(1, side - 3) as f64 + 0.5 + offset) * 2.0 / side as f64 - 1.0;
        FRAMES[face % FACES].direction(inside(turned % side), inside(turned / side)).normalize()
    };
    (0..count).map(at).collect()
}
