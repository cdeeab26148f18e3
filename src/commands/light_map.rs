//! Radiosity in a texture, for the commands that write one.

use super::console::{Console, in_range};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::exitance::Exitance;
use crate::export::lightmap::{Lightmap, Placed, SIDES};
use crate::render::frame::ExitanceAt;
use crate::report::export::LightmapReport;

/// Texels of a side where nothing else is asked for.
pub(super) const SIDE: u32 = 1024;

/// Bytes of memory for each texel of a light map and its files.
const BYTES_PER_TEXEL: u64 = 400;

/// Refuses a number of texels of a side, which `option` gives, before any work.
pub(super) fn check_side(option: &str, side: u32, console: &Console) -> Result<()> {
    let side = u64::from(in_range(option, side, SIDES[0]..=SIDES[1])?);
    let fits = ((console.max_memory / BYTES_PER_TEXEL) as f64).sqrt() as u64;
    console.check_memory(side * side * BYTES_PER_TEXEL, &format!("{option} {fits} would fit, or raise --max-memory"))
}

/// A light map of an evaluator that has been lit.
pub(super) struct LightMap {
    pub(super) placed: Placed,
    pub(super) map: Lightmap,
    at: ExitanceAt,
}

impl LightMap {
    /// Unwraps the surface and evaluates each texel, at its point of the surface where the transport does not end at the vertices.
    pub(super) fn new(evaluator: &mut dyn Evaluator, side: u32, console: &Console) -> Result<Self> {
        let placed = console.stage("unwrap", || Placed::new(&evaluator.scene().mesh, side))?;
        let at = match evaluator.prepare_points(console) {
            Ok(()) => ExitanceAt::Pixels,
            Err(error) if error.code() == ExitCode::Unsupported => ExitanceAt::Vertices,
            Err(error) => return Err(error),
        };
        let exitance: Box<dyn Exitance> = match at {
            ExitanceAt::Vertices => Box::new(evaluator.radiosity(console)?),
            ExitanceAt::Pixels => {
                let missing = || Error::runtime("exitance at points is missing");
                evaluator.exitance_at_points().ok_or_else(missing)?
            }
        };
        let map = Lightmap::new(evaluator.scene(), &placed, side, exitance.as_ref(), console)?;
        Ok(Self { placed, map, at })
    }

    pub(super) fn report(&self) -> LightmapReport {
        LightmapReport {
            resolution: self.map.side,
            own_coordinates: self.placed.is_own(),
            charts: self.placed.report.charts,
            coverage: self.map.coverage(),
            overlap: self.placed.report.overlap,
            exitance: self.at,
        }
    }
}
