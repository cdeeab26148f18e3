//! Radiosity by multilevel summation: nets once for the samples, tables for each set of media.

use crate::progress::Progress;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::multilevel::{Quality, SurfaceNets, SurfaceTables};
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;

/// Nets and tables, made when they are first needed.
pub(super) struct Nets {
    quality: Quality,
    nets: Option<SurfaceNets>,
    /// Tables of the media and profiles in force.
    tables: Option<SurfaceTables>,
}

impl Nets {
    pub(super) fn new(quality: Quality) -> Self {
        Self { quality, nets: None, tables: None }
    }

    /// Drops the tables, since other media or profiles are in force.
    pub(super) fn forget_media(&mut self) {
        self.tables = None;
    }

    /// True if [`Self::prepare`] has nothing left to do.
    pub(super) fn is_prepared(&self) -> bool {
        self.prepared().is_some()
    }

    /// Makes what is missing.
    pub(super) fn prepare(
        &mut self,
        surface: &Surface,
        receivers: &Receivers,
        kernels: &[MediumKernel],
        progress: &dyn Progress,
    ) {
        let quality = self.quality;
        let nets = self.nets.get_or_insert_with(|| {
            progress.start("nets", 0);
            let nets = SurfaceNets::new(surface, receivers, quality);
            progress.finish();
            nets
        });
        self.tables.get_or_insert_with(|| nets.tables(kernels));
    }

    /// Nets and tables, present after [`Self::prepare`].
    pub(super) fn prepared(&self) -> Option<(&SurfaceNets, &SurfaceTables)> {
        self.nets.as_ref().zip(self.tables.as_ref())
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.nets.as_ref().map_or(0, SurfaceNets::bytes)
    }
}
