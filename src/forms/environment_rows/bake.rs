//! Irradiance rows of an asset, and their errors under environments that no choice saw.

use std::ops::Range;
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
use crate::geometry::samples::{self, Patch, Samples};
use crate::light::cube_light::CubeLight;
use crate::light::sky::sky_with_sun;
use crate::light::suns::apart;
use crate::light::{Light, LightKind};
use crate::math::cube_map::{self, FACES};
use crate::math::statistics::VertexError;
use crate::medium::entrance_basis::EntranceBasis;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::irradiance_rows::RowBaker;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;
use crate::transport::visibility::{self, Observer, Occluders};

/// Samples of an asset for each sample of the coarser set that errors are measured on.
const COARSER: usize = 8;

/// Rays of a sample that stand for the native resolution of an environment.
const NATIVE_DIRECTIONS: u32 = 1024;

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
    measure(&work, receivers, how.2, &bake.probes.unseen, ledger, progress)?;
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

/// Lights, and samples fewer than those of the asset, that errors under environments are measured with.
struct Judged {
    lights: Vec<Light>,
    etas: Vec<f64>,
    samples: Samples,
    patches: Vec<Patch>,
}

impl Judged {
    /// None where there is nothing to measure: no lights, or media that the rows do not serve.
    fn new(full: &Surface, unseen: &[Light]) -> Option<Self> {
        let domain = full.domain;
        let mut lights = of_kinds(unseen, &IN_ROWS);
        if let Some(Light::Environment { rotate_degrees, .. }) =
            lights.iter().rfind(|l| l.kind() == LightKind::Environment)
        {
            let (map, rotate_degrees) = (Arc::new(sky_with_sun()), *rotate_degrees);
            lights.push(Light::Environment { map, rotate_degrees, scale: DVec3::ONE });
        }
        let entrance = EntranceBasis::new(TERMS);
        let etas: Vec<f64> = domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        if lights.is_empty() || etas.iter().any(|&eta| entrance.project(eta).is_err()) {
            return None;
        }
        let count = full.samples.len().div_ceil(COARSER);
        let samples = Samples::new(domain.mesh, domain.parts, count).in_tree_order(domain.mesh, domain.parts);
        let patches = samples::patches(domain.mesh, &samples);
        Some(Self { lights, etas, samples, patches })
    }

    fn surface<'a>(&'a self, full: &Surface<'a>) -> Surface<'a> {
        Surface { domain: full.domain, bvh: full.bvh, samples: &self.samples, patches: &self.patches }
    }

    fn lit(&self, work: &Work, progress: &dyn Progress) -> Result<Lit> {
        Lit::new(&self.surface(work.surface), (work.settings, work.sampling), &self.lights, &self.etas, progress)
    }

    /// All of it is one block.
    fn blocks<'a>(&self, work: &Work<'a>) -> Blocks<'a> {
        work.cache.blocks("environment errors", 1, |key| {
            work.tell(key);
            key.samples(&self.samples).rows(&self.etas);
        })
    }
}

/// Enters the errors of visibility, cube map and row truncation under environments, on a coarser set of samples.
fn measure(
    work: &Work,
    receivers: &Receivers,
    near: NearField,
    unseen: &[Light],
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let Work { surface: full, settings, sampling, cache } = *work;
    let domain = full.domain;
    let Some(judged) = Judged::new(full, unseen) else { return Ok(()) };
    let Judged { lights, etas, samples, .. } = &judged;
    progress.start("environment errors", 2 + lights.len() as u64);
    let surface = judged.surface(full);
    let sections = cache.sections(
        "environment errors",
        |key| {
            key.surface(domain.mesh).samples(samples).rows(&domain.parts.triangle_part).rows(etas);
            let media: Vec<u32> = domain.parts.parts.iter().map(|part| part.medium.unwrap_or(u32::MAX)).collect();
            key.rows(&media).text(&format!("{settings:?} {TERMS} {sampling:?} {NATIVE_DIRECTIONS} {CHECKED}"));
            for light in lights {
                key.light(light);
            }
        },
        |sections| Lit::of_sections(sections, lights.len() * samples.len()).is_some(),
        || Ok(judged.blocks(work).record(0, || judged.lit(work, progress))?.to_sections()),
    )?;
    let missing = || Error::runtime("irradiance that was just made is gone");
    let Lit { visibility, differing, irradiance } =
        Lit::of_sections(&sections, lights.len() * samples.len()).ok_or_else(missing)?;

    let (subset, points) = probe_points(receivers, &receivers.areas_mm2(domain.mesh));
    let tree = SampleTree::default();
    let gather = Gather::new(&surface, &tree, domain.media, near);
    let radiosity = |e: &[DVec3]| gather.radiosity(&subset, &gather.light(e), Scheme::AllPairs, &Silent);
    let [native, full, kept] = irradiance.each_ref().map(|e| e.chunks(samples.len().max(1)));
    let [cube_map, truncation] = worst(native.zip(full).zip(kept), |((native, full), kept)| {
        let [native, full, kept] = [native, full, kept].map(&radiosity);
        Ok([points.error(&full, &native), points.error(&kept, &full)])
    })?;
    progress.finish();
    let note = format!("the worst of {} environments, on {} samples of their own", lights.len(), samples.len());
    let [wrong, all] = differing;
    ledger.add("visibility", visibility, format!("{wrong} of {all} sub-texels decided otherwise"));
    ledger.add("cube map", cube_map, format!("against {NATIVE_DIRECTIONS} rays into the native map; {note}"));
    ledger.add("row truncation", truncation, format!("quantiser included; {note}"));
    Ok(())
}

/// Tags of what [`Lit`] is kept as: five numbers of the error, two counts, irradiance.
const LIT: [Tag; 5] = [
    Tag::from_static("lit.err"),
    Tag::from_static("lit.cnt"),
    Tag::from_static("lit.nat"),
    Tag::from_static("lit.ful"),
    Tag::from_static("lit.kep"),
];

/// What errors under environments are measured from, before any light scatters: of the media it depends on their refractive indices alone.
#[derive(Serialize, Deserialize)]
struct Lit {
    /// Error of the irradiance by visibility.
    visibility: VertexError,
    /// Sub-texels that are decided otherwise, and all.
    differing: [u64; 2],
    /// Irradiance under each light at each sample: by rays into the native map, by rows without any loss, by rows.
    irradiance: [Vec<DVec3>; 3],
}

impl Lit {
    fn new(
        surface: &Surface,
        (settings, sampling): (EnvironmentRows, LightSampling),
        lights: &[Light],
        etas: &[f64],
        progress: &dyn Progress,
    ) -> Result<Self> {
        let (samples, domain) = (surface.samples, surface.domain);
        let (visibility, wrong, all) = visibility_error(surface, settings);
        progress.advance(1);
        let alone = Work { surface, settings, sampling, cache: &StageCache::default() };
        let stored = StoredRows::new(alone.rows(&Silent)?);
        let side = settings.side as usize;
        let everything = RowBaker::new(surface, settings.of_rows(6 * side * side))?;
        progress.advance(1);
        // Suns go by rays, as they do at run time.
        let parts: Vec<Vec<Light>> = lights.iter().map(|light| apart(std::slice::from_ref(light), |_| true)).collect();
        let maps: Vec<Light> = parts.iter().map(|part| part[0].clone()).collect();
        let unabridged = full_resolution(&everything, surface, &maps, side)?;
        let native_sampling = LightSampling { directions: NATIVE_DIRECTIONS, ..sampling };
        let mut irradiance = [const { Vec::new() }; 3];
        for ((light, part), mut full) in lights.chunks(1).zip(&parts).zip(unabridged) {
            let native = Illumination::new(surface, light, etas, native_sampling)?.all(&Silent);
            let mut kept = vec![DVec3::ZERO; samples.len()];
            stored.add(&part[..1], domain, samples, &mut kept)?;
            let suns = Illumination::new(surface, &part[1..], etas, sampling)?.all(&Silent);
            for (sum, sun) in full.iter_mut().chain(&mut kept).zip(suns.iter().cycle()) {
                *sum += *sun;
            }
            irradiance.iter_mut().zip([native, full, kept]).for_each(|(all, of_light)| all.extend(of_light));
            progress.advance(1);
        }
        Ok(Self { visibility, differing: [wrong, all], irradiance })
    }

    fn to_sections(&self) -> Vec<RawSection> {
        let Self { visibility: VertexError { rms, bias, p999, worst, dark }, differing, irradiance } = self;
        let [error, count, tags @ ..] = LIT;
        let (kind, raw) = (Kind::Method, Codec::Raw);
        let mut sections = vec![
            RawSection::from_rows(error, kind, raw, &[*rms, *bias, *p999, *worst, *dark]),
            RawSection::from_rows(count, kind, raw, differing),
        ];
        sections.extend(tags.into_iter().zip(irradiance).map(|(tag, e)| {
            let rows: Vec<[f64; 3]> = e.iter().map(DVec3::to_array).collect();
            RawSection::from_rows(tag, kind, raw, &rows)
        }));
        sections
    }

    /// What sections hold; none where they are others, or of another number of values of each irradiance.
    fn of_sections(sections: &[RawSection], count: usize) -> Option<Self> {
        let [error, differing, irradiance @ ..] = sections else { return None };
        if !sections.iter().map(|section| section.tag).eq(LIT) {
            return None;
        }
        let [rms, bias, p999, worst, dark] = error.rows::<f64>().ok()?.try_into().ok()?;
        let values = |section: &RawSection| -> Option<Vec<DVec3>> {
            let rows = section.rows::<[f64; 3]>().ok().filter(|rows| rows.len() == count)?;
            Some(rows.into_iter().map(DVec3::from_array).collect())
        };
        let irradiance: Vec<Vec<DVec3>> = irradiance.iter().map(values).collect::<Option<_>>()?;
        Some(Self {
            visibility: VertexError { rms, bias, p999, worst, dark },
            differing: differing.rows::<u64>().ok()?.try_into().ok()?,
            irradiance: irradiance.try_into().ok()?,
        })
    }
}

/// Irradiance under each light from rows of which nothing is dropped, chunk by chunk.
fn full_resolution(baker: &RowBaker, surface: &Surface, lights: &[Light], side: usize) -> Result<Vec<Vec<DVec3>>> {
    let lights: Vec<CubeLight> = lights.iter().map(|light| CubeLight::new(light, side)).collect::<Result<_>>()?;
    let entrance = EntranceBasis::new(TERMS);
    let (samples, domain) = (surface.samples, surface.domain);
    let project = |patch: usize| {
        let part = samples.part_offsets.partition_point(|&first| first as usize <= patch) - 1;
        let medium = domain.parts.parts[part].medium.and_then(|m| domain.media.get(m as usize));
        let projection = medium.and_then(|m| entrance.project(m.properties.eta_inside_over_outside).ok());
        projection.map_or_else(Default::default, |p| p.coefficients)
    };
    let chunk = |range: Range<usize>| -> Result<Vec<Vec<DVec3>>> {
        let rows = Rows::new(baker.range(range.clone()), &[0, range.len() as u32])?;
        let of_light = |light| rows.irradiance_range(0..range.len(), light, |i| project(range.start + i));
        lights.iter().map(of_light).collect()
    };
    let count = samples.len();
    let ranges: Vec<Range<usize>> =
        (0..count).step_by(visibility::GROUP).map(|a| a..count.min(a + visibility::GROUP)).collect();
    let parts: Vec<Vec<Vec<DVec3>>> = ranges.into_par_iter().map(chunk).collect::<Result<_>>()?;
    Ok((0..lights.len()).map(|light| parts.iter().flat_map(|part| part[light].iter().copied()).collect()).collect())
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
