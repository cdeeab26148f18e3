//! Truths that errors of a bake are measured by.

use glam::DVec3;

use crate::error::{Error, Result};
use crate::evaluate::StageCache;
use crate::evaluate::blocks::Blocks;
use crate::evaluate::stage_cache::Key;
use crate::light::Light;
use crate::progress::Progress;

/// What computes the radiosity of every receiver under a light.
type Radiosity<'a> = &'a dyn Fn(&Light) -> Result<Vec<DVec3>>;

/// Radiosity of every receiver under each of some lights that no choice saw: a block of a shared bake for each light.
pub(crate) struct Truths<'a> {
    lights: Vec<&'a Light>,
    receivers: usize,
    blocks: Blocks<'a>,
    make: Radiosity<'a>,
}

impl<'a> Truths<'a> {
    /// `make` computes one, the radiosity of so many receivers; `chosen` tells what all of them depend on.
    pub(crate) fn new(
        lights: impl IntoIterator<Item = &'a Light>,
        (make, receivers): (Radiosity<'a>, usize),
        cache: &'a StageCache,
        chosen: impl FnOnce(&mut Key),
    ) -> Self {
        let lights: Vec<&Light> = lights.into_iter().collect();
        let blocks = cache.blocks("unseen lights", lights.len(), chosen);
        Self { lights, receivers, blocks, make }
    }

    /// The lights.
    pub(crate) fn lights(&self) -> &[&'a Light] {
        &self.lights
    }

    /// Computes those of this process where several share the bake.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn ahead(&self, progress: &dyn Progress) -> Result<()> {
        self.blocks.ahead(progress, |light| self.computed(light))
    }

    /// The truth under one of the lights.
    ///
    /// # Errors
    /// Those of `make`; a block that cannot be read.
    pub(crate) fn under(&self, light: usize) -> Result<Vec<DVec3>> {
        let found = self.blocks.rows((light, self.receivers), || self.computed(light))?;
        Ok(found.into_iter().map(DVec3::from_array).collect())
    }

    fn computed(&self, light: usize) -> Result<Vec<[f64; 3]>> {
        let light = self.lights.get(light).ok_or_else(|| Error::runtime("there is no such light"))?;
        Ok((self.make)(light)?.iter().map(DVec3::to_array).collect())
    }
}
