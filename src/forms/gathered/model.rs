//! Calibrated kernels of a scene: made by walks or kept in an asset, for the media in force.

use std::sync::Arc;
use std::thread::JoinHandle;

use glam::DVec3;
use translux_format::calibration::{self as kept, Calibration, Numbers, Part, tags};
use translux_format::filtered_normals::Earlier;
use translux_format::{Budget, RawSection};

use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Refined;
use crate::evaluate::form::{read_error, write_error};
use crate::geometry::bvh::Bvh;
use crate::medium::material::{Medium, OpticalProperties};
use crate::medium::profile::Orders;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::calibration::lattice::Lattice;
use crate::transport::calibration::layers::{Layers, Splines};
use crate::transport::calibration::{Calibrated, CalibratedSamples, PartLayers, Walks};
use crate::transport::surface::Surface;

/// Quantiser step of the logarithms of factors: an error of 0.1 % RMS.
const STEP: f64 = 1.0 / 256.0;

/// Sets of media whose calibrations are remembered, some 340 bytes a sample each.
const REMEMBERED: usize = 4;

/// The calibrated kernels of an evaluator.
pub(super) struct Model {
    walks: Walks,
    /// Those of the media in force; none until they are needed.
    in_force: Option<Arc<CalibratedSamples>>,
    /// Those of media that were in force before.
    remembered: Vec<(Vec<OpticalProperties>, Arc<CalibratedSamples>)>,
    /// Those that are being made.
    pending: Option<Pending>,
}

/// A calibration on a thread of its own.
struct Pending {
    of: Vec<OpticalProperties>,
    thread: JoinHandle<Result<Calibrated>>,
}

impl Pending {
    fn start(scene: &Scene, walks: Walks) -> Result<Self> {
        let (of, scene) = (properties(&scene.media), scene.clone());
        let work = move || Calibrated::by_walks(scene.domain(), &Bvh::new(&scene.mesh), walks, &Silent);
        let spawned = std::thread::Builder::new().name("calibrate".to_owned()).spawn(work);
        let thread =
            spawned.map_err(|e| Error::runtime(format!("the thread `calibrate` could not be started: {e}")))?;
        Ok(Self { of, thread })
    }
}

impl Model {
    /// The calibration of an asset; none of one whose kernels are dipoles. That of a mesh that has been resized since is made again
    /// when it is needed, and one without its factors.
    ///
    /// # Errors
    /// Sections that cannot be read or do not fit.
    pub(super) fn of(asset: &Asset, surface: &Surface) -> Result<Option<Self>> {
        let Some(numbers) = Calibration::numbers(&asset.sections).map_err(read_error)? else { return Ok(None) };
        let mut result = Self { walks: walks_of(&numbers), in_force: None, remembered: Vec::new(), pending: None };
        if numbers.diagonal_mm == asset.scene.mesh.diagonal_mm() && Calibration::is_kept(&asset.sections) {
            let calibrated = read(&asset.scene, &asset.sections)?;
            result.put(&asset.scene.media, calibrated, surface);
        }
        Ok(Some(result))
    }

    /// The kernels and factors in force, if they have been made.
    pub(super) fn in_force(&self) -> Option<&CalibratedSamples> {
        self.in_force.as_deref()
    }

    /// Bytes in memory of all calibrations that are remembered, but for their kernels.
    pub(super) fn bytes(&self) -> usize {
        let of = |of: &CalibratedSamples| size_of_val(of.factors.as_slice()) + of.entry.bytes();
        self.remembered.iter().map(|(_, calibration)| of(calibration)).sum()
    }

    /// Other media are in force.
    pub(super) fn set_media(&mut self, media: &[Medium]) {
        let wanted = properties(media);
        let known = self.remembered.iter().find(|(of, _)| *of == wanted);
        self.in_force = known.map(|(_, calibration)| Arc::clone(calibration));
    }

    /// Makes the kernels of the media in force where they are missing; true if it did.
    ///
    /// # Errors
    /// As [`Calibrated::by_walks`].
    pub(super) fn prepare(&mut self, surface: &Surface, progress: &dyn Progress) -> Result<bool> {
        if self.in_force.is_some() {
            return Ok(false);
        }
        let calibrated = Calibrated::by_walks(surface.domain, surface.bvh, self.walks, progress)?;
        self.put(surface.domain.media, calibrated, surface);
        Ok(true)
    }

    /// Takes a calibration that was made in the background, and starts one where the media in force have none. Of media that have
    /// been replaced since it is remembered.
    ///
    /// # Errors
    /// As [`Self::prepare`]; a system that starts no thread.
    pub(super) fn refine(&mut self, scene: &Scene, surface: &Surface) -> Result<Refined> {
        if let Some(Pending { of, thread }) = self.pending.take_if(|pending| pending.thread.is_finished()) {
            let ended = || Error::runtime("the calibration in the background ended without a result");
            let calibrated = thread.join().map_err(|_| ended())??;
            let is_wanted = self.in_force.is_none() && of == properties(&scene.media);
            let made = self.remember(of, calibrated, surface);
            if is_wanted {
                self.in_force = Some(made);
                return Ok(Refined::Changed);
            }
        }
        if self.in_force.is_some() {
            return Ok(Refined::Done);
        }
        if self.pending.is_none() {
            self.pending = Some(Pending::start(scene, self.walks)?);
        }
        Ok(Refined::Working)
    }

    fn put(&mut self, media: &[Medium], calibrated: Calibrated, surface: &Surface) {
        self.in_force = Some(self.remember(properties(media), calibrated, surface));
    }

    fn remember(
        &mut self,
        of: Vec<OpticalProperties>,
        calibrated: Calibrated,
        surface: &Surface,
    ) -> Arc<CalibratedSamples> {
        let made = Arc::new(CalibratedSamples::new(Arc::new(calibrated), surface));
        if self.remembered.len() == REMEMBERED {
            self.remembered.remove(0);
        }
        self.remembered.push((of, Arc::clone(&made)));
        made
    }
}

/// The calibrated kernels of a scene in the place of an asset's: a pose of it, with the media in force. They are those that the asset keeps
/// where the scene is its own, otherwise made by the same walks through the scene; none where its kernels are dipoles.
///
/// # Errors
/// Sections that cannot be read; as [`Calibrated::by_walks`].
pub(crate) fn of_scene(asset: &Asset, scene: &Scene, progress: &dyn Progress) -> Result<Option<Calibrated>> {
    let Some(numbers) = Calibration::numbers(&asset.sections).map_err(read_error)? else { return Ok(None) };
    let own = &asset.scene;
    let is_own = numbers.diagonal_mm == own.mesh.diagonal_mm()
        && own.mesh.local_mm == scene.mesh.local_mm
        && properties(&own.media) == properties(&scene.media);
    if is_own && Calibration::is_kept(&asset.sections) {
        return read(scene, &asset.sections).map(Some);
    }
    Calibrated::by_walks(scene.domain(), &Bvh::new(&scene.mesh), walks_of(&numbers), progress).map(Some)
}

/// The walks that a calibration was made by.
fn walks_of(numbers: &Numbers) -> Walks {
    let orders = if numbers.from_order == 1 { Orders::FromOne } else { Orders::FromTwo };
    Walks { photons: numbers.photons, collisions: numbers.collisions, seed: numbers.seed, orders }
}

fn properties(media: &[Medium]) -> Vec<OpticalProperties> {
    media.iter().map(|medium| medium.properties).collect()
}

/// Calibrates a scene; the calibration and its sections. Those that are `ready` from the same walks through the same scene are taken.
///
/// # Errors
/// As [`Calibrated::by_walks`]; a calibration that no section holds.
pub(crate) fn bake(
    scene: &Scene,
    bvh: &Bvh,
    (walks, ready): (Walks, &[RawSection]),
    progress: &dyn Progress,
) -> Result<(Calibrated, Vec<RawSection>)> {
    if Calibration::is_kept(ready)
        && Calibration::numbers(ready).map_err(read_error)?.is_some_and(|numbers| walks_of(&numbers) == walks)
    {
        return Ok((read(scene, ready)?, ready.to_vec()));
    }
    let calibrated = Calibrated::by_walks(scene.domain(), bvh, walks, progress)?;
    let layers = |of: &Layers| kept::Layers {
        first_mm: of.splines.first_mm,
        ratio: of.splines.ratio,
        intervals: of.splines.intervals as u32,
        single: of.single.clone(),
        double: of.double.clone(),
    };
    let part = |of: &PartLayers| Part { layers: of.layers.each_ref().map(layers), photons: of.photons };
    let numbers = Numbers {
        photons: walks.photons,
        collisions: walks.collisions,
        seed: walks.seed,
        from_order: if walks.orders == Orders::FromOne { 1 } else { 2 },
        diagonal_mm: scene.mesh.diagonal_mm(),
        step: STEP,
        parts: calibrated.parts.iter().map(|of| of.as_ref().map(part)).collect(),
    };
    let code = |factor: f64| (factor.ln() / STEP).round().clamp(-8192.0, 8192.0) as i16;
    let codes = calibrated.scale.iter().flat_map(|s| s.to_array().map(code)).collect();
    let sections = Calibration { numbers, codes }.to_sections(&neighbours(&calibrated.lattice)).map_err(write_error)?;
    Ok((calibrated, sections))
}

/// The sections of a calibration that an asset needs which holds transport: without factors, which are in that.
pub(crate) fn without_factors(mut sections: Vec<RawSection>) -> Vec<RawSection> {
    sections.retain(|section| section.tag != tags::FACTORS);
    sections
}

/// The sections of the calibration of an asset; none where its kernels are dipoles.
pub(crate) fn sections_of(asset: &Asset) -> Vec<RawSection> {
    asset.sections.iter().filter(|section| tags::ALL.contains(&section.tag)).cloned().collect()
}

/// The calibration of a scene in some sections.
fn read(scene: &Scene, sections: &[RawSection]) -> Result<Calibrated> {
    let domain = scene.domain();
    let neighbours = neighbours(&Lattice::new(domain));
    let stored = Calibration::from_sections(sections, &neighbours, Budget::default()).map_err(read_error)?;
    let Some(Calibration { numbers, codes }) = stored else {
        return Err(Error::input("an asset without its calibration; bake it again"));
    };
    let layers = |of: kept::Layers| Layers {
        splines: Splines { first_mm: of.first_mm, ratio: of.ratio, intervals: of.intervals as usize },
        single: of.single,
        double: of.double,
    };
    let part = |of: Part| PartLayers { layers: of.layers.map(layers), photons: of.photons };
    let parts = numbers.parts.into_iter().map(|of| of.map(part)).collect();
    let factor = |code: i16| (f64::from(code) * numbers.step).exp();
    let (points, _) = codes.as_chunks::<3>();
    let scale = points.iter().map(|codes| DVec3::from_array(codes.map(factor))).collect();
    Calibrated::kept(domain, parts, scale)
}

/// Earlier neighbours of the points of a lattice.
fn neighbours(lattice: &Lattice) -> Earlier {
    Earlier::new(lattice.len(), lattice.triangles().map(|(slots, _)| slots))
}

/// Names of the parts of an asset that keep their dipole although it is calibrated: those that let light out.
pub fn uncalibrated(asset: &Asset) -> Vec<&str> {
    let Ok(Some(numbers)) = Calibration::numbers(&asset.sections) else { return Vec::new() };
    let parts = asset.scene.parts.parts.iter().zip(&numbers.parts);
    parts.filter(|(part, of)| part.transfers() && of.is_none()).map(|(part, _)| part.name.as_str()).collect()
}
