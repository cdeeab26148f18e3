//! Single scattering vectors: the singly scattered light that each texel of a cube map adds at a point, for each term
//! of the phase function and each channel.
//!
//! `T_k(x_o, w) = sigma_s Int_0^dm exp(-s sigma_t) tau_k(x_p(s), w) ds` along the inverse normal (equations 10 and 11 of Wang, Tran
//! and Luebke 2005), as the mean over a texel times its solid angle: `L1 = F_t(w_o) Sum_k h_k(w_o') T_k . L`. For an isotropic
//! phase function `s = pi C T_0 . L` is in the unit of radiosity and may be added to the vectors of multiple scattering.
//!
//! # Samples that are shared
//!
//! The paper renders 16 cube maps of twice the resolution for each vertex: 393,216 rays and as many shadows. Here a point
//! casts some thousands ([`Sharing::Adaptive`]):
//!
//! - along the normal, Gauss points in place of the midpoint rule: four of them are nearer to the integral than 16
//!   deterministic samples (see [`super::depths::gauss`]);
//! - over directions, rays at the corners of cells of an eighth of a face (11 degrees), later of parts of them; the
//!   plane that the rays meet and the visibility of the light are interpolated over the cell, and refraction, attenuation
//!   and channels are worked out for each texel, so that a flat surface is exact however large cells are; cells with a
//!   shadow boundary, and those over which the plane turns or shifts, are cut in four, down to single texels whose
//!   corners are shared with their neighbours.
//!
//! No vertex depends on another, so that ranges and threads change nothing.
//!
//! # Measured
//!
//! Closed bunny of 69,666 triangles, 30 mm, faces of 32 texels, 64 vertices spread over it, against rays that are not shared with 64
//! deterministic samples. Relative RMS over vertices (worst channel, worst of three turns) of [`Sharing::DEFAULT`] after the
//! projection on harmonics of order 24, marble and skin1: constant light 0.3 and 0.3 %; Pisa and Potsdamer Platz 0.4 and 0.5 %; Uffizi 0.9 and
//! 1.0 %; St. Peter's square at night 1.3 and 1.0 %; Grace cathedral 2.9 and 2.6 %; a sky with a bare sun 5.6 and 3.4 %; a sun 2.3 % in the mean of
//! 32, 4.7 % at most. The paper's 16 deterministic samples, unshared: 0.3 to 0.5 % under maps, 0.5 and 0.8 % under suns.
//! Four depths are 0.3 % worse under most maps and take 0.7 of the time.
//!
//! The remaining error is roughness along the path under a small light: each of six Gauss points meets another facet,
//! fold or shadow. Ways to lessen it that were tried, marble, Grace cathedral, the sky with a sun, mean of the suns: 12
//! depths and a tolerance of 0.1, 2.5 times as long: 2.5, 5, 1.6 %; 8 depths, 1.3 times as long: 3.0, 5.4, 2.1 %; a
//! tolerance of 0.1, 1.5 times as long: 2.4, 4.8, 1.6 %. Before the projection, 16 suns as large as a texel, against 64
//! unshared samples: 3.1 %; 12 and 24 depths with a tolerance of 0.02, 7 and 12 times as long: 1.7 and 1.3 %; the
//! paper's 16: 1.2 %. Texels cut in four where their corners disagree, 1.7 times as long: 2.8 % (a sky with a bare sun
//! 3.0 to 1.7 %, which harmonics do not resolve). Shadow boundaries found between two depths by halving: no change, as
//! one depth in 25 has one next to it. Single scattering is a fifteenth (marble) to a fifth (skin1) of all light, so
//! that 5 % of it are 0.3 to 1 % of all.
//!
//! Sixteen harmonics (g 0.3, a body 6 mm wide of mean free paths of 1 mm, constant light, from aslant): 2.8 % against traced
//! light, 1.5 % with six depths and a tolerance of 0.05; light from behind matters more to a forward phase function than the
//! tolerance knows.
//!
//! # What was tried
//!
//! Interpolating gain and path length over cells in place of planes: 1 to 5 % too dark, as both are concave. The cosine
//! of the mean normal in place of the mean cosine: 1.2 % too bright on facets. Interpolated vertex normals in place of those of
//! the facets: constant light 1.9 % in place of 0.4 % off under marble, whose light enters beside the vertex, suns hardly
//! better. Eight depths: suns 4 % to 2.2 % under skin1 for twice the time.

mod adaptive;
mod probes;
mod settings;
mod shade;

use std::ops::Range;

use self::adaptive::{Adaptive, Grid};
use self::probes::{ProbeMemory, Prober, every_direction};
use super::interior::ExitPoint;
use crate::error::Result;
use crate::geometry::bvh::Bvh;
use crate::transport::domain::Domain;

pub use self::settings::{Sharing, VectorSettings};

/// Settings and tables shared by the vectors of all points.
pub struct VectorBaker<'a> {
    prober: Prober<'a>,
    grid: Grid,
}

/// Memory of one thread; a baker uses one of the two.
#[derive(Default)]
struct Work {
    unshared: ProbeMemory,
    shared: adaptive::Memory,
}

impl<'a> VectorBaker<'a> {
    /// Prepares tables.
    ///
    /// # Errors
    /// Another side than 8 to 128, no sample along the normal, a tolerance that is not positive (exit 3).
    pub fn new(domain: Domain<'a>, bvh: &'a Bvh, settings: VectorSettings) -> Result<Self> {
        settings.validate()?;
        let grid = Grid::new(settings.side);
        Ok(Self { prober: Prober::new(domain, bvh, settings), grid })
    }

    /// Length of one vector, `[term][channel][face][row][column]`.
    fn len(&self) -> usize {
        self.prober.settings.phase.count() * 3 * self.texels()
    }

    /// Texels of a cube map.
    pub fn texels(&self) -> usize {
        self.prober.texels()
    }

    /// The settings of the vectors.
    pub fn settings(&self) -> &VectorSettings {
        &self.prober.settings
    }

    /// Passes the vectors of some of the points to `each`, in ascending order and on one thread. They do not depend on
    /// how ranges are cut. A point without a normal or a medium has a vector of zeros; so has one past the end.
    pub fn range(&self, points: &[ExitPoint], range: Range<usize>, mut each: impl FnMut(usize, &[f32])) {
        let mut out = vec![0.0f32; self.len()];
        let mut work = Work::default();
        for index in range {
            out.fill(0.0);
            if let Some(point) = points.get(index) {
                self.vector(point, &mut work, &mut out);
            }
            each(index, &out);
        }
    }

    fn vector(&self, point: &ExitPoint, work: &mut Work, out: &mut [f32]) {
        let Some(line) = self.prober.line(point) else { return };
        match self.prober.settings.sharing {
            Sharing::None { .. } => every_direction(&self.prober, &line, &mut work.unshared, out),
            Sharing::Adaptive { tolerance, .. } => {
                Adaptive { prober: &self.prober, grid: &self.grid, line: &line, tolerance }.run(&mut work.shared, out);
            }
        }
    }
}
