//! Draws that are kept while lights move: their texels alone are lit anew, and their weights corrected.
//!
//! The draws of one frame are by its light and a little by area, so that no texel that other light may reach is without a chance. Under lights that
//! have moved, the light of a texel over the probability of its draw is still right in the mean. Where few of them come to stand for much, and after
//! some frames, all is drawn anew.

use super::kept::Shone;
use super::light::Flux;
use super::map::TexelMap;
use super::samples::Sample;
use crate::error::Result;
use crate::light::Light;
use crate::progress::Silent;

/// Share of the draws by area.
const BY_AREA: f64 = 0.1;

/// Frames that draws last.
const MOST_FRAMES: u32 = 8;

/// What the effective number of samples falls to before that, over that of the first frame.
const LEAST_EFFECTIVE: f64 = 0.8;

/// The draws of each part.
pub(super) struct Carried {
    /// Texels, and the probability of each times the number of draws.
    draws: Vec<Vec<(u32, f64)>>,
    /// Share of effective samples in the first frame.
    effective: f64,
    frames: u32,
}

impl Carried {
    /// Draws `count` texels of each part at equal steps in the order of the mip-map, by the light of the nodes and by area. Returns the samples as well.
    pub(super) fn new(map: &TexelMap, lit: &[Flux], count: usize) -> (Self, Vec<Vec<Sample>>) {
        let draws = map.roots.iter().map(|root| root.map_or(Vec::new(), |root| draw(map, lit, root, count))).collect();
        let mut carried = Self { draws, effective: 1.0, frames: 0 };
        let samples = carried.weighted(|texel| lit[texel as usize]);
        carried.effective = effective(&samples);
        (carried, samples)
    }

    /// The samples under other lights, over a unit of irradiance; none where they have to be drawn anew.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(super) fn under(&mut self, shone: Shone, lights: &[Light], unit: f64) -> Result<Option<Vec<Vec<Sample>>>> {
        self.frames += 1;
        if self.frames > MOST_FRAMES {
            return Ok(None);
        }
        let map = shone.map;
        let mut texels: Vec<u32> = self.draws.iter().flatten().map(|(texel, _)| *texel).collect();
        texels.sort_unstable();
        texels.dedup();
        let patches = || texels.iter().flat_map(|texel| map.nodes[*texel as usize].patches.clone());
        let points: Vec<_> = patches().map(|patch| map.points[patch as usize]).collect();
        let irradiance = shone.of_points(lights, &points, &Silent)?;
        let mut rest = irradiance.iter();
        let of_texel = |texel: &u32| {
            let own = map.nodes[*texel as usize].patches.clone();
            let of = own.zip(rest.by_ref()).map(|(p, e)| Flux::of_patch(&map.patches[p as usize], *e / unit));
            Flux::sum(of.collect::<Vec<_>>().into_iter())
        };
        let fluxes: Vec<Flux> = texels.iter().map(of_texel).collect();
        let known = |texel: u32| texels.binary_search(&texel).map_or(Flux::default(), |index| fluxes[index]);
        let samples = self.weighted(known);
        Ok((effective(&samples) >= LEAST_EFFECTIVE * self.effective).then_some(samples))
    }

    fn weighted(&self, flux: impl Fn(u32) -> Flux) -> Vec<Vec<Sample>> {
        let sample = |(texel, chance): &(u32, f64)| {
            let flux = flux(*texel);
            Sample { at_mm: flux.at_mm, flux: flux.rgb / *chance }
        };
        self.draws.iter().map(|draws| draws.iter().map(sample).collect()).collect()
    }
}

/// Effective number of samples over their number: 1 where all have the same weight.
fn effective(samples: &[Vec<Sample>]) -> f64 {
    let weights = || samples.iter().flatten().map(|s| s.flux.element_sum());
    let (sum, squares): (f64, f64) = weights().fold((0.0, 0.0), |(sum, squares), w| (sum + w, squares + w * w));
    if squares > 0.0 { sum * sum / (squares * weights().count() as f64) } else { 0.0 }
}

/// Texels at equal steps of the sum of their chances, and the expected number of draws of each.
fn draw(map: &TexelMap, lit: &[Flux], root: u32, count: usize) -> Vec<(u32, f64)> {
    let (weight, area) = (lit[root as usize].weight(), map.areas_mm2[root as usize]);
    let by_area = if weight > 0.0 { BY_AREA } else { 1.0 };
    let chance = |node: u32| {
        let of_light = if weight > 0.0 { lit[node as usize].weight() / weight } else { 0.0 };
        (1.0 - by_area) * of_light + by_area * map.areas_mm2[node as usize] / area.max(f64::MIN_POSITIVE)
    };
    let descend = |i: usize| {
        let (mut wanted, mut node) = ((i as f64 + 0.5) / count as f64, root);
        while !map.nodes[node as usize].is_texel() {
            // Rounding may leave a little beyond the last child.
            let mut last = node + 1;
            for child in map.children(node) {
                last = child;
                if wanted < chance(child) {
                    break;
                }
                wanted -= chance(child);
            }
            wanted = wanted.min(0.999 * chance(last));
            node = last;
        }
        (node, (chance(node) * count as f64).max(f64::MIN_POSITIVE))
    };
    (0..count).map(descend).collect()
}
