//! Transport as sparse rows of Haar coefficients, one for each vertex: radiosity is a sum over the coefficients that are there.

use glam::DVec3;
use translux_format::rows::{FACES, IrradianceRows};

use crate::error::{Error, Result};
use crate::forms::baked_in::Stored;
use crate::forms::distant::far_away;
use crate::light::Light;
use crate::light::cube_light::{CubeLight, Transform};
use crate::math::simd::{InstructionSet, multiversion};
use crate::parallel::*;
use crate::transport::balanced_tree::power_of_two_near;
use crate::transport::receivers::Receivers;

/// Receivers of one task.
const CHUNK: usize = 256;

/// Haar coefficients of every receiver, to be multiplied with a light.
pub(crate) struct Rows {
    side: usize,
    transform: Transform,
    /// Offsets of the rows, with one past the last.
    offsets: Vec<u32>,
    places: Vec<u16>,
    /// R, G, B and 0 of each coefficient.
    values: Vec<[i8; 4]>,
    steps: Vec<f32>,
    /// The first coefficient of each face: `[receiver][face]`, R, G, B and 0.
    scaling: Vec<[[f32; 4]; FACES]>,
    /// Buffer for the radiosity of the receivers.
    gathered: Vec<[f32; 4]>,
}

/// A light in the same basis: coefficients of its radiance over a scale.
pub(crate) struct Cube {
    radiance: Vec<[f32; 4]>,
    pub(crate) scale: f64,
}

impl Rows {
    /// Converts rows whose three terms are the channels.
    pub(crate) fn new(rows: &IrradianceRows, transform: Transform) -> Result<Self> {
        if rows.terms != 3 {
            return Err(Error::input(format!("rows of {} channels, not 3", rows.terms)));
        }
        let mut values = Vec::with_capacity(rows.indices.len());
        for pair in rows.offsets.windows(2) {
            let (from, end) = (pair[0] as usize, pair[1] as usize);
            let of_channel = |c: usize| &rows.values[3 * from + c * (end - from)..][..end - from];
            let [r, g, b] = [0, 1, 2].map(of_channel);
            values.extend(r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b, 0]));
        }
        let scaling = rows.scaling.chunks_exact(3 * FACES).zip(&rows.scaling_steps).map(|(own, step)| {
            let value = |face: usize, c: usize| f32::from(own[c * FACES + face]) * step;
            std::array::from_fn(|face| [value(face, 0), value(face, 1), value(face, 2), 0.0])
        });
        Ok(Self {
            side: rows.side,
            transform,
            offsets: rows.offsets.clone(),
            places: rows.indices.clone(),
            values,
            steps: rows.steps.clone(),
            scaling: scaling.collect(),
            gathered: Vec::new(),
        })
    }

    /// Number of receivers.
    pub(crate) fn len(&self) -> usize {
        self.steps.len()
    }

    /// Radiosity of every receiver over the scale of the light, not clamped.
    pub(crate) fn sums(&self, cube: &Cube, out: &mut Vec<[f32; 4]>) {
        out.resize(self.len(), [0.0; 4]);
        let level = InstructionSet::detect();
        out.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| products(level, self, chunk * CHUNK, cube, out));
    }
}

impl Stored for Rows {
    type Light = Cube;

    fn light(&self, lights: &[Light]) -> Result<Cube> {
        let mut sums = vec![[0.0f64; 3]; FACES * self.side * self.side];
        for light in lights {
            far_away(light)?;
            let cube = CubeLight::transformed(light, self.side, self.transform)?;
            for (sum, c) in sums.iter_mut().zip(cube.coefficients()) {
                (0..3).for_each(|i| sum[i] += f64::from(c[i]) * cube.scale());
            }
        }
        let largest = sums.iter().flatten().fold(0.0f64, |a, v| a.max(v.abs()));
        if !largest.is_finite() {
            return Err(Error::runtime("the light is too bright for double precision; make it weaker"));
        }
        let scale = power_of_two_near(largest);
        let radiance = sums.iter().map(|&[r, g, b]| [r, g, b, 0.0].map(|v| (v / scale) as f32)).collect();
        Ok(Cube { radiance, scale })
    }

    fn radiosity(&mut self, cube: &Cube, receivers: &Receivers) -> Vec<DVec3> {
        let mut gathered = std::mem::take(&mut self.gathered);
        self.sums(cube, &mut gathered);
        gathered.iter_mut().flatten().for_each(|v| *v = v.max(0.0));
        let result = receivers.expand_rgb(&gathered, cube.scale);
        self.gathered = gathered;
        result
    }

    fn stage(&self) -> &'static str {
        "transport rows"
    }

    fn bytes(&self) -> usize {
        size_of_val(self.offsets.as_slice())
            + size_of_val(self.places.as_slice())
            + size_of_val(self.values.as_slice())
            + size_of_val(self.steps.as_slice())
            + size_of_val(self.scaling.as_slice())
    }
}

multiversion! {
    /// Radiosity of some receivers from the first on.
    fn products(rows: &Rows, first: usize, cube: &Cube, out: &mut [[f32; 4]]) => products_body
}

#[inline(always)]
fn products_body(rows: &Rows, first: usize, cube: &Cube, out: &mut [[f32; 4]]) {
    let face = rows.side * rows.side;
    for (index, out) in (first..).zip(out) {
        let Some(&[from, end]) = rows.offsets.get(index..).and_then(|o| o.first_chunk::<2>()) else { return };
        let cells = from as usize..end as usize;
        let (Some(places), Some(values)) = (rows.places.get(cells.clone()), rows.values.get(cells)) else { return };
        // Two chains of sums in a fixed order.
        let mut sums = [[0.0f32; 4]; 2];
        for (k, (place, value)) in places.iter().zip(values).enumerate() {
            let Some(light) = cube.radiance.get(usize::from(*place)) else { continue };
            let sum = &mut sums[k % 2];
            for i in 0..4 {
                sum[i] += f32::from(value[i]) * light[i];
            }
        }
        let step = rows.steps[index];
        let mut total = [0.0f32; 4];
        for i in 0..4 {
            total[i] = (sums[0][i] + sums[1][i]) * step;
        }
        for (k, scaling) in rows.scaling[index].iter().enumerate() {
            let Some(light) = cube.radiance.get(k * face) else { continue };
            for i in 0..4 {
                total[i] += scaling[i] * light[i];
            }
        }
        *out = total;
    }
}
