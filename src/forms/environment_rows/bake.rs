//! Irradiance rows of an asset, and their errors under environments that no choice saw.

use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use translux_format::rows::IrradianceRows;
use translux_format::{Codec, Kind, RawSection, Tag};

use super::settings::{EnvironmentRows, TERMS};
use super::stored::{IN_ROWS, StoredRows};
use crate::compress::ledger::Ledger;
use crate::compress::rows::Rows;
use crate::error::{Error, Result};
use crate::evaluate::blocks::Blocks;
use crate::evaluate::form::write_error;
use crate::evaluate::stage_cache::Key;
use crate::evaluate::stages::{of_kinds, probe_points, worst};
use crate::evaluate::{BakeSettings, StageCache};
use crate::light::sky::sky_with_sun;
use crate::light::suns::apart;
use crate::light::{Light, LightKind};
use crate::math::cube_map::{self, FACES};
use crate::math::statistics::VertexError;
use crate::medium::entrance_basis::EntranceBasis;
use crate::progress::{Progress, Silent};
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::irradiance_rows::RowBaker;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;
use crate::transport::visibility::{self, Observer, Occluders};

/// Rays of all samples together that stand for the native resolution of an environment, and of each at least and at most: directions
/// differ from sample to sample, and scattering averages over them.
const NATIVE_RAYS: usize = 1 << 22;
const NATIVE_DIRECTIONS: RangeInclusive<u32> = 32..=1024;

/// Samples whose visibility is checked with one ray for each sub-texel.
const CHECKED: usize = 32;

/// Sections of the rows of every sample, which lie in the order of their tree; their errors under unseen lights are entered into the ledger.
///
/// # Errors
/// Media whose refractive index the rows do not serve; lights that do not fit a cube map.
pub fn bake(
    (surface, receivers): (&Surface, &Receivers),
    how: (EnvironmentRows, LightSampling, NearField),
    bake: &BakeSettings,
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<Vec<RawSection>> {
    let (settings, samples, cache) = (how.0, surface.samples, &bake.cache);
    let work = Work { surface, settings, sampling: how.1, cache };
    // Of the media they know nothing.
    let sections = cache.sections(
        "irradiance rows",
        |key| {
            key.surface(surface.domain.mesh).samples(samples).text(&format!("{settings:?} {TERMS}"));
        },
        |sections| matches!(IrradianceRows::from_sections(sections, samples.len()), Ok(Some(_))),
        || work.rows(progress)?.into_data().to_sections().map_err(write_error),
    )?;
    measure(&work, (&sections, receivers), how.2, &bake.probes.unseen, ledger, progress)?;
    Ok(sections)
}

/// What [`bake`] computes in blocks, where several processes share them: those of this one.
///
/// # Errors
/// As [`bake`].
pub fn ahead(
    surface: &Surface,
    (settings, sampling): (EnvironmentRows, LightSampling),
    bake: &BakeSettings,
    progress: &dyn Progress,
) -> Result<()> {
    let work = Work { surface, settings, sampling, cache: &bake.cache };
    let baker = work.baker()?;
    let (blocks, ranges) = work.blocks(&baker);
    let threshold = work.threshold(&baker)?;
    blocks.records_ahead(progress, |block| Ok(baker.chunks(ranges[block].clone(), threshold, &Silent)))?;
    match Judged::new(surface, &bake.probes.unseen) {
        Some(judged) => judged.blocks(&work).records_ahead(progress, |_| judged.lit(&work, &Silent)),
        None => Ok(()),
    }
}

/// Rows of a surface.
struct Work<'a> {
    surface: &'a Surface<'a>,
    settings: EnvironmentRows,
    sampling: LightSampling,
    cache: &'a StageCache,
}

/// Blocks at most that rows are shared in.
const BLOCKS: usize = 256;

impl Work<'_> {
    fn baker(&self) -> Result<RowBaker<'_>> {
        RowBaker::new(self.surface, self.settings.of_rows(self.settings.coefficients as usize))
    }

    fn tell(&self, key: &mut Key) {
        key.samples(self.surface.samples).text(&format!("{:?} {TERMS}", self.settings));
    }

    fn threshold(&self, baker: &RowBaker) -> Result<f32> {
        self.cache.common("threshold of rows", |key| self.tell(key), || Ok(baker.threshold()))
    }

    /// Blocks of chunks.
    fn blocks(&self, baker: &RowBaker) -> (Blocks<'_>, Vec<Range<usize>>) {
        let chunks = baker.chunk_count();
        let each = chunks.div_ceil(BLOCKS).max(1);
        let ranges: Vec<Range<usize>> = (0..chunks).step_by(each).map(|a| a..chunks.min(a + each)).collect();
        (self.cache.blocks("irradiance rows", ranges.len(), |key| self.tell(key)), ranges)
    }

    /// Rows of every sample, in blocks.
    fn rows(&self, progress: &dyn Progress) -> Result<Rows> {
        let baker = self.baker()?;
        let (blocks, ranges) = self.blocks(&baker);
        if blocks.are_computed() {
            return baker.in_blocks(progress);
        }
        let mut chunks = Vec::with_capacity(baker.chunk_count());
        for block in 0..ranges.len() {
            let gone = || Err(Error::runtime("a block is gone that was there"));
            chunks.extend(blocks.record::<Vec<IrradianceRows>>(block, gone)?);
        }
        baker.joined(chunks)
    }
}

/// Lights that errors under environments are measured under.
struct Judged {
    lights: Vec<Light>,
    etas: Vec<f64>,
}

impl Judged {
    /// None where there is nothing to measure: no lights, or media that the rows do not serve.
    fn new(full: &Surface, unseen: &[Light]) -> Option<Self> {
        let mut lights = of_kinds(unseen, &IN_ROWS);
        if let Some(Light::Environment { rotate_degrees, .. }) =
            lights.iter().rfind(|l| l.kind() == LightKind::Environment)
        {
            let (map, rotate_degrees) = (Arc::new(sky_with_sun()), *rotate_degrees);
            lights.push(Light::Environment { map, rotate_degrees, scale: DVec3::ONE });
        }
        let entrance = EntranceBasis::new(TERMS);
        let etas: Vec<f64> = full.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let serves = !lights.is_empty() && etas.iter().all(|&eta| entrance.project(eta).is_ok());
        serves.then_some(Self { lights, etas })
    }

    fn lit(&self, work: &Work, progress: &dyn Progress) -> Result<Lit> {
        Lit::new(work, &self.lights, &self.etas, progress)
    }

    /// All of it is one block.
    fn blocks<'a>(&self, work: &Work<'a>) -> Blocks<'a> {
        work.cache.blocks("environment errors", 1, |key| {
            work.tell(key);
            key.rows(&self.etas);
        })
    }
}

/// Enters the errors of visibility and of the rows under environments.
fn measure(
    work: &Work,
    (rows, receivers): (&[RawSection], &Receivers),
    near: NearField,
    unseen: &[Light],
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let Work { surface, settings, sampling, cache } = *work;
    let (domain, samples) = (surface.domain, surface.samples);
    let Some(judged) = Judged::new(surface, unseen) else { return Ok(()) };
    let Judged { lights, etas } = &judged;
    progress.start("environment errors", 1 + lights.len() as u64);
    let sections = cache.sections(
        "environment errors",
        |key| {
            key.surface(domain.mesh).samples(samples).rows(&domain.parts.triangle_part).rows(etas);
            let media: Vec<u32> = domain.parts.parts.iter().map(|part| part.medium.unwrap_or(u32::MAX)).collect();
            key.rows(&media)
                .text(&format!("{settings:?} {TERMS} {sampling:?} {NATIVE_RAYS} {NATIVE_DIRECTIONS:?} {CHECKED}"));
            for light in lights {
                key.light(light);
            }
        },
        |sections| Lit::of_sections(sections, lights.len() * samples.len()).is_some(),
        || Ok(judged.blocks(work).record(0, || judged.lit(work, progress))?.to_sections()),
    )?;
    let missing = || Error::runtime("what was just made is gone");
    let Lit { visibility, differing, native } =
        Lit::of_sections(&sections, lights.len() * samples.len()).ok_or_else(missing)?;
    let stored = StoredRows::new(Rows::from_sections(rows, &samples.part_offsets)?.ok_or_else(missing)?);

    let (subset, points) = probe_points(receivers, &receivers.areas_mm2(domain.mesh));
    let tree = SampleTree::default();
    let gather = Gather::new(surface, &tree, domain.media, near);
    let radiosity = |e: &[DVec3]| gather.radiosity(&subset, &gather.light(e), Scheme::AllPairs, &Silent);
    let [error] = worst(lights.iter().zip(native.chunks(samples.len().max(1))), |(light, native)| {
        let (map, suns) = parts(light);
        let mut kept = vec![DVec3::ZERO; samples.len()];
        stored.add(&map, domain, samples, &mut kept)?;
        // Suns go by rays, as they do at run time.
        let suns = Illumination::new(surface, &suns, etas, sampling)?.all(&Silent);
        let with_suns = |e: &[DVec3]| radiosity(&e.iter().zip(&suns).map(|(e, sun)| *e + *sun).collect::<Vec<_>>());
        Ok([points.error(&with_suns(&kept), &with_suns(native))])
    })?;
    progress.finish();
    let [wrong, all] = differing;
    ledger.add("visibility", visibility, format!("{wrong} of {all} sub-texels decided otherwise"));
    let (rays, count) = (native_sampling(work).directions, lights.len());
    let note = format!("cube map, truncation and quantiser against {rays} rays a sample, the worst of {count} lights");
    ledger.add("environment rows", error, note);
    Ok(())
}

/// The map of an environment without its suns, and these; another light as it is.
fn parts(light: &Light) -> ([Light; 1], Vec<Light>) {
    let mut all = apart(std::slice::from_ref(light), |_| true).into_iter();
    let first = all.next().unwrap_or_else(|| light.clone());
    ([first], all.collect())
}

/// Rays that stand for the native resolution.
fn native_sampling(work: &Work) -> LightSampling {
    work.sampling.with_directions_of_all(NATIVE_RAYS, work.surface.samples.len(), NATIVE_DIRECTIONS)
}

/// Tags of what [`Lit`] is kept as: five numbers of the error, two counts, irradiance.
const LIT: [Tag; 3] = [Tag::from_static("lit.err"), Tag::from_static("lit.cnt"), Tag::from_static("lit.nat")];

/// What errors under environments are measured from, before any light scatters: of the media it depends on their refractive indices alone.
#[derive(Serialize, Deserialize)]
struct Lit {
    /// Error of the irradiance by visibility.
    visibility: VertexError,
    /// Sub-texels that are decided otherwise, and all.
    differing: [u64; 2],
    /// Irradiance under each light at each sample by rays into the native map, its suns apart.
    native: Vec<DVec3>,
}

impl Lit {
    fn new(work: &Work, lights: &[Light], etas: &[f64], progress: &dyn Progress) -> Result<Self> {
        let (visibility, wrong, all) = visibility_error(work.surface, work.settings);
        progress.advance(1);
        let mut native = Vec::with_capacity(lights.len() * work.surface.samples.len());
        for light in lights {
            let (map, _) = parts(light);
            native.extend(Illumination::new(work.surface, &map, etas, native_sampling(work))?.all(&Silent));
            progress.advance(1);
        }
        Ok(Self { visibility, differing: [wrong, all], native })
    }

    fn to_sections(&self) -> Vec<RawSection> {
        let Self { visibility: VertexError { rms, bias, p999, worst, dark }, differing, native } = self;
        let [error, count, irradiance] = LIT;
        let (kind, raw) = (Kind::Method, Codec::Raw);
        let rows: Vec<[f64; 3]> = native.iter().map(DVec3::to_array).collect();
        vec![
            RawSection::from_rows(error, kind, raw, &[*rms, *bias, *p999, *worst, *dark]),
            RawSection::from_rows(count, kind, raw, differing),
            RawSection::from_rows(irradiance, kind, raw, &rows),
        ]
    }

    /// What sections hold; none where they are others, or of another number of values of each irradiance.
    fn of_sections(sections: &[RawSection], count: usize) -> Option<Self> {
        let [error, differing, native] = sections else { return None };
        if !sections.iter().map(|section| section.tag).eq(LIT) {
            return None;
        }
        let [rms, bias, p999, worst, dark] = error.rows::<f64>().ok()?.try_into().ok()?;
        let native = native.rows::<[f64; 3]>().ok().filter(|rows| rows.len() == count)?;
        Some(Self {
            visibility: VertexError { rms, bias, p999, worst, dark },
            differing: differing.rows::<u64>().ok()?.try_into().ok()?,
            native: native.into_iter().map(DVec3::from_array).collect(),
        })
    }
}

/// Error of the irradiance under a constant light by visibility decisions that differ from one ray each, over some samples; how
/// many differ, and of how many.
fn visibility_error(surface: &Surface, settings: EnvironmentRows) -> (VertexError, u64, u64) {
    let resolution = settings.of_rows(6).resolution;
    let step = surface.samples.len().div_ceil(CHECKED).max(1);
    let mesh = surface.domain.mesh;
    let observers: Vec<Observer> =
        (0..surface.samples.len()).step_by(step).map(|i| Observer::of(mesh, surface.samples.patch(i))).collect();
    let occluders = Occluders::new(mesh);
    let (mut wrong, mut all, mut error2, mut mean2) = (0, 0, 0.0, 0.0);
    visibility::visit(&occluders, surface.bvh, &observers, resolution, |i, visible| {
        let (mut signed, mut seen) = (0i64, 0i64);
        let side = resolution.side();
        for index in 0..FACES * side * side {
            let (face, y, x) = (index / (side * side), index / side % side, index % side);
            if !visible.bit(&visible.above, face, x, y) {
                continue;
            }
            let ray = observers[i].ray(cube_map::direction(side, face, x, y));
            let by_ray = !surface.bvh.occluded(&ray, observers[i].triangle);
            let decided = visible.bit(&visible.seen, face, x, y);
            wrong += u64::from(by_ray != decided);
            signed += i64::from(decided) - i64::from(by_ray);
            seen += i64::from(by_ray);
            all += 1;
        }
        error2 += (signed * signed) as f64;
        mean2 += (seen * seen) as f64;
    });
    let rms = if mean2 > 0.0 { (error2 / mean2).sqrt() } else { 0.0 };
    (VertexError { rms, bias: 0.0, p999: rms, worst: rms, dark: 0.0 }, wrong, all)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::forms::test_scene::scene;
    use crate::geometry::bvh::Bvh;
    use crate::geometry::samples::{self, Samples};
    use crate::geometry::shapes;

    /// A sun in a map is lit like a directional light: with its shadows, and at its place.
    #[test]
    fn suns_of_an_environment_go_past_the_rows() {
        let pair =
            [(shapes::bumpy_head(10.0, 3), DVec3::ZERO), (shapes::icosphere(4.0, 3), DVec3::new(6.0, 9.0, 12.0))];
        let scene = scene(shapes::compose(&pair), "skin1");
        let bvh = Bvh::new(&scene.mesh);
        let samples = Samples::new(&scene.mesh, &scene.parts, 3000).in_tree_order(&scene.mesh, &scene.parts);
        let patches = samples::patches(&scene.mesh, &samples);
        let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
        let settings = EnvironmentRows { side: 32, coefficients: 64 };
        let sampling = LightSampling::REFERENCE;
        let work = Work { surface: &surface, settings, sampling, cache: &StageCache::default() };
        let stored = StoredRows::new(work.rows(&Silent).unwrap());
        let light = [Light::environment(Arc::new(sky_with_sun()), 40.0, DVec3::ONE).unwrap()];
        let native = LightSampling { directions: 2048, ..LightSampling::REFERENCE };
        let etas = [scene.media[0].properties.eta_inside_over_outside];
        let truth = Illumination::new(&surface, &light, &etas, native).unwrap().all(&Silent);
        let error = |values: &[DVec3]| {
            let areas: Vec<f64> = patches.iter().map(|p| p.area_mm2).collect();
            crate::math::statistics::vertex_error(values, &truth, &areas)
        };
        let mut whole = vec![DVec3::ZERO; samples.len()];
        stored.add(&light, scene.domain(), &samples, &mut whole).unwrap();
        let sampling = LightSampling::FAST;
        let (split, _) = StoredRows::illuminate(Some(&stored), &surface, (&light, sampling), &Silent).unwrap();
        let (split, whole) = (error(&split), error(&whole));
        println!("irradiance under a sun and a sky: {split:?}; through the rows alone: {whole:?}");
        // What is left is the rows' error of the sky and the noise of the rays, sample by sample; scattering averages over both.
        assert!(split.rms < 0.03 && split.dark < 0.35, "{split:?}");
        assert!(whole.rms > 2.5 * split.rms && whole.dark > 2.5 * split.dark, "{whole:?}");
    }
}
