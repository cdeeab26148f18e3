//! Irradiance at single points, for who takes vertices as samples.

use glam::DVec3;
use rayon::prelude::*;

use super::{Bundle, Illumination, MOST, Sharp, SurfacePoint};
use crate::progress::Progress;

/// Points that are lit together.
const CHUNK: usize = 256;

impl Illumination<'_> {
    /// Irradiance of single points, RGB, each with the index of its medium: one shadow ray for each directional and point light,
    /// as many as a patch has for the others. A point is lit from the side of its normal only. A medium that the scene does not have
    /// gives 0.
    pub fn at_points(&self, points: &[(SurfacePoint, u32)], progress: &dyn Progress) -> Vec<DVec3> {
        progress.start("irradiance", points.len() as u64);
        let mut result = vec![DVec3::ZERO; points.len()];
        result.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).enumerate().for_each(|(chunk, (out, points))| {
            self.some_points(chunk * CHUNK, points, out);
            progress.advance(out.len() as u64);
        });
        progress.finish();
        result
    }

    /// The same of the points from the index `first` on, which turns their sets of directions.
    fn some_points(&self, first: usize, points: &[(SurfacePoint, u32)], out: &mut [DVec3]) {
        let mut bundle = Bundle::default();
        let mut sharp: Vec<Sharp> = self.lights.iter().filter_map(Sharp::new).collect();
        for (i, ((point, medium), e)) in points.iter().zip(out.iter_mut()).enumerate() {
            let Some((eta, _)) = self.entrance.get(*medium as usize) else { continue };
            let point = std::slice::from_ref(point);
            sharp.iter_mut().for_each(|light| light.collect(i, *eta, point, |_| 1.0));
            let soft = self.lights.iter().filter(|light| !light.is_sharp());
            *e = soft.map(|light| self.irradiance(light, *medium as usize, first + i, point, &mut bundle)).sum();
        }
        for light in &mut sharp {
            light.trace(self.surface.bvh);
            light.add(out, |_| true);
        }
        for e in out {
            *e = e.min(DVec3::splat(MOST));
        }
    }
}
