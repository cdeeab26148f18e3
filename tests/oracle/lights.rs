//! The lights: those without extent, whose shadows are resolved by subdivision, and the extended ones, sampled.

use super::medium::fresnel_transmittance;
use super::vector::{V3, add, cross, dot, frame, length, luminance, mul, normalised, sequence_2d, sub};
use std::f64::consts::{PI, TAU};

/// A light as the command line defines it; lengths in mm.
#[derive(Clone, Debug)]
pub enum OracleLight {
    /// The same radiance from everywhere.
    Constant { radiance: V3 },
    /// From the direction `from`, with `irradiance` on a surface that faces it.
    Directional { from: V3, irradiance: V3 },
    /// `intensity / d^2` on a surface that faces it.
    Point { at: V3, intensity: V3 },
    /// A point that shines into a cone around the line to `to`: in full up to `full` radians off it, not beyond `edge`, and between
    /// them by Hermite's cubic of the cosine.
    Spot { at: V3, to: V3, full: f64, edge: f64, intensity: V3 },
    /// Rectangle centred at `at` that shines towards `normal` only; the first entry of `size` goes along the first
    /// edge, which is normalize(Z x n), or +X where |n.z| > 0.99, if none is given.
    Area { at: V3, normal: V3, first_edge: Option<V3>, size: [f64; 2], radiance: V3 },
    /// Equirectangular map, top row first: +Y up, the centre is +Z, the left quarter +X; turned counter-clockwise
    /// seen from above.
    Environment { width: usize, height: usize, pixels: Vec<[f32; 3]>, rotate_degrees: f64, scale: V3 },
}

/// A light without extent.
#[derive(Clone, Debug)]
pub enum Sharp {
    Directional { towards: V3, irradiance: V3 },
    Point { at: V3, intensity: V3 },
    Spot { at: V3, axis: V3, cosines: [f64; 2], intensity: V3 },
}

impl Sharp {
    /// Irradiance behind the surface at `p` with the normal `n` if nothing stands between.
    #[inline]
    pub fn unshadowed(&self, eta: f64, p: V3, n: V3) -> V3 {
        let (mu, colour) = match *self {
            Self::Directional { towards, irradiance } => (dot(n, towards), irradiance),
            Self::Point { at, intensity } => {
                let to = sub(at, p);
                let d2 = dot(to, to);
                if d2 == 0.0 {
                    return [0.0; 3];
                }
                (dot(n, to) / d2.sqrt(), mul(intensity, 1.0 / d2))
            }
            Self::Spot { at, axis, cosines: [full, edge], intensity } => {
                let away = normalised(sub(p, at));
                let x = (dot(away, axis) - edge) / (full - edge);
                let share = if x >= 1.0 {
                    1.0
                } else if x > 0.0 {
                    3.0 * x * x - 2.0 * x * x * x
                } else {
                    0.0
                };
                return mul(Self::Point { at, intensity }.unshadowed(eta, p, n), share);
            }
        };
        if mu > 0.0 { mul(colour, mu * fresnel_transmittance(eta, mu)) } else { [0.0; 3] }
    }

    /// Direction to the light and how far along it a blocker counts.
    #[inline]
    pub fn shadow_ray(&self, p: V3) -> (V3, f64) {
        match *self {
            Self::Directional { towards, .. } => (towards, f64::INFINITY),
            Self::Point { at, .. } | Self::Spot { at, .. } => (sub(at, p), 1.0),
        }
    }

    /// Distance over which the irradiance of an open plane changes noticeably, mm.
    #[inline]
    pub fn scale_length(&self, p: V3) -> f64 {
        match *self {
            Self::Directional { .. } => f64::INFINITY,
            Self::Point { at, .. } => length(sub(at, p)),
            // The light falls to nothing over this.
            Self::Spot { at, cosines: [full, edge], .. } => length(sub(at, p)) * (edge.acos() - full.acos()),
        }
    }
}

/// One draw: the direction, how far along it a blocker counts, and what it adds to the irradiance if unblocked.
pub struct Draw {
    pub direction: V3,
    pub reach: f64,
    pub value: V3,
}

/// A light with extent.
#[derive(Clone, Debug)]
pub enum Extended {
    Constant { radiance: V3 },
    Area { corner: V3, edges: [V3; 2], normal: V3, radiance: V3 },
    Environment(Sky),
}

impl Extended {
    /// Draw `j` of the sequence named by the hash `shift`; the mean over `j` tends to the irradiance behind the
    /// surface. None where the draw adds nothing.
    pub fn draw(&self, eta: f64, p: V3, n: V3, shift: u64, j: u64) -> Option<Draw> {
        match self {
            Self::Constant { radiance } => {
                let (direction, mu) = cosine_direction(n, sequence_2d(shift, j));
                let value = mul(*radiance, PI * fresnel_transmittance(eta, mu));
                Some(Draw { direction, reach: f64::INFINITY, value })
            }
            Self::Area { corner, edges, normal, radiance } => {
                let [s, t] = sequence_2d(shift, j);
                let direction = sub(add(*corner, add(mul(edges[0], s), mul(edges[1], t))), p);
                let d2 = dot(direction, direction);
                let d = d2.sqrt();
                let (mu, mu_light) = (dot(n, direction) / d, -dot(*normal, direction) / d);
                // Also false for NaN, on the rectangle itself.
                if !(mu > 0.0 && mu_light > 0.0) {
                    return None;
                }
                let area = length(edges[0]) * length(edges[1]);
                let value = mul(*radiance, fresnel_transmittance(eta, mu) * mu * mu_light * area / d2);
                Some(Draw { direction, reach: 1.0, value })
            }
            Self::Environment(sky) => sky.draw(eta, n, shift, j),
        }
    }
}

fn cosine_direction(n: V3, [s, t]: [f64; 2]) -> (V3, f64) {
    let (a, b) = frame(n);
    let (radius, phi) = (s.sqrt(), TAU * t);
    let mu = (1.0 - s).max(0.0).sqrt();
    (add(add(mul(a, radius * phi.cos()), mul(b, radius * phi.sin())), mul(n, mu)), mu)
}

/// An environment without its brightest pixels, ready to be drawn from.
#[derive(Clone, Debug)]
pub struct Sky {
    width: usize,
    height: usize,
    pixels: Vec<V3>,
    rotation: f64,
    /// Cumulative power over rows, then within each row; power is luminance times solid angle.
    rows: Vec<f64>,
    columns: Vec<f64>,
}

impl Sky {
    /// Splits the map: pixels that hold more than `sharp_share` of its power become directional lights.
    pub fn new(
        width: usize,
        height: usize,
        map: &[[f32; 3]],
        rotate_degrees: f64,
        scale: V3,
        sharp_share: f64,
    ) -> (Self, Vec<Sharp>) {
        assert_eq!(map.len(), width * height, "pixels of the environment");
        let pixels = map.iter().map(|p| [0, 1, 2].map(|k| (f64::from(p[k]) * scale[k]).max(0.0))).collect();
        let mut sky = Self {
            width,
            height,
            pixels,
            rotation: rotate_degrees.to_radians(),
            rows: Vec::new(),
            columns: Vec::new(),
        };
        let power = |sky: &Self, i: usize| luminance(sky.pixels[i]) * sky.solid_angle(i / width);
        let total: f64 = (0..width * height).map(|i| power(&sky, i)).sum();
        let mut sharp = Vec::new();
        for i in 0..width * height {
            if power(&sky, i) > sharp_share * total {
                let centre = sky.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                let irradiance = mul(sky.pixels[i], sky.solid_angle(i / width));
                sharp.push(Sharp::Directional { towards: centre, irradiance });
                sky.pixels[i] = [0.0; 3];
            }
        }
        let mut rows_sum = 0.0;
        for row in 0..height {
            let mut sum = 0.0;
            for i in row * width..(row + 1) * width {
                sum += power(&sky, i);
                sky.columns.push(sum);
            }
            rows_sum += sum;
            sky.rows.push(rows_sum);
        }
        (sky, sharp)
    }

    fn solid_angle(&self, row: usize) -> f64 {
        let polar = |r: usize| PI * r as f64 / self.height as f64;
        TAU / self.width as f64 * (polar(row).cos() - polar(row + 1).cos())
    }

    /// Direction of a place on the map, in pixels from the left and from the top.
    pub fn direction(&self, x: f64, y: f64) -> V3 {
        let longitude = PI - TAU * x / self.width as f64 + self.rotation;
        let polar = PI * y / self.height as f64;
        [longitude.sin() * polar.sin(), polar.cos(), longitude.cos() * polar.sin()]
    }

    fn pixel(&self, direction: V3) -> usize {
        let longitude = direction[0].atan2(direction[2]) - self.rotation;
        let x = ((PI - longitude) / TAU).rem_euclid(1.0) * self.width as f64;
        let y = direction[1].clamp(-1.0, 1.0).acos() / PI * self.height as f64;
        (y as usize).min(self.height - 1) * self.width + (x as usize).min(self.width - 1)
    }

    /// Even draws follow the map's power, odd ones the cosine; the balance heuristic joins them.
    fn draw(&self, eta: f64, n: V3, shift: u64, j: u64) -> Option<Draw> {
        let total = *self.rows.last()?;
        if total <= 0.0 {
            return None;
        }
        let point = sequence_2d(shift ^ (j & 1), j / 2);
        let direction = if j & 1 == 0 { self.by_power(point, total) } else { cosine_direction(n, point).0 };
        let mu = dot(n, direction);
        if mu <= 0.0 {
            return None;
        }
        let pixel = self.pixel(direction);
        let density = 0.5 * (mu / PI + luminance(self.pixels[pixel]) / total);
        let value = mul(self.pixels[pixel], mu * fresnel_transmittance(eta, mu) / density);
        (value != [0.0; 3]).then_some(Draw { direction, reach: f64::INFINITY, value })
    }

    fn by_power(&self, [s, t]: [f64; 2], total: f64) -> V3 {
        let sought = s * total;
        let row = self.rows.partition_point(|&c| c <= sought).min(self.height - 1);
        let below = if row == 0 { 0.0 } else { self.rows[row - 1] };
        let within_row = ((sought - below) / (self.rows[row] - below)).clamp(0.0, 1.0 - 1e-12);
        let columns = &self.columns[row * self.width..(row + 1) * self.width];
        let sought = t * columns[self.width - 1];
        let column = columns.partition_point(|&c| c <= sought).min(self.width - 1);
        let left = if column == 0 { 0.0 } else { columns[column - 1] };
        let within = ((sought - left) / (columns[column] - left)).clamp(0.0, 1.0 - 1e-12);
        // Uniform in solid angle within the pixel: uniform in the cosine of the polar angle.
        let cosine = |r: usize| (PI * r as f64 / self.height as f64).cos();
        let y = (cosine(row) + within_row * (cosine(row + 1) - cosine(row))).acos() / PI * self.height as f64;
        self.direction(column as f64 + within, y)
    }
}

/// Sorts the lights into the two kinds.
pub fn prepare(lights: &[OracleLight], sharp_share: f64) -> (Vec<Sharp>, Vec<Extended>) {
    let (mut sharp, mut extended) = (Vec::new(), Vec::new());
    for light in lights {
        match light {
            OracleLight::Constant { radiance } => extended.push(Extended::Constant { radiance: *radiance }),
            OracleLight::Directional { from, irradiance } => {
                sharp.push(Sharp::Directional { towards: normalised(*from), irradiance: *irradiance });
            }
            OracleLight::Point { at, intensity } => sharp.push(Sharp::Point { at: *at, intensity: *intensity }),
            OracleLight::Spot { at, to, full, edge, intensity } => {
                let (axis, cosines) = (normalised(sub(*to, *at)), [full.cos(), edge.cos()]);
                sharp.push(Sharp::Spot { at: *at, axis, cosines, intensity: *intensity });
            }
            OracleLight::Area { at, normal, first_edge, size, radiance } => {
                let n = normalised(*normal);
                let fallback = if n[2].abs() > 0.99 { [1.0, 0.0, 0.0] } else { cross([0.0, 0.0, 1.0], n) };
                // Only the part of the edge within the rectangle's plane means anything.
                let u = first_edge.unwrap_or(fallback);
                let u = normalised(sub(u, mul(n, dot(u, n))));
                let edges = [mul(u, size[0]), mul(cross(n, u), size[1])];
                let corner = sub(*at, mul(add(edges[0], edges[1]), 0.5));
                extended.push(Extended::Area { corner, edges, normal: n, radiance: *radiance });
            }
            OracleLight::Environment { width, height, pixels, rotate_degrees, scale } => {
                let (sky, bright) = Sky::new(*width, *height, pixels, *rotate_degrees, *scale, sharp_share);
                sharp.extend(bright);
                extended.push(Extended::Environment(sky));
            }
        }
    }
    (sharp, extended)
}
