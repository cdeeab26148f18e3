//! Layered media: Donner and Jensen, "Light Diffusion in Multi-Layered Translucent Materials" (2005).
//!
//! A slab's multipole is the Green's function of diffusion between two extrapolated boundaries. Its Hankel transform is
//! a quotient of hyperbolic functions, all mirror images included; layers are added there as the paper adds them
//! (Kubelka's formulas at every spatial frequency s, both sides of each layer), and one inverse transform gives R(r).
//!
//! Each interface has its own A from the ratio of the indices on both sides. Differences from the paper: the source of
//! a slab holds the light that interacts within its thickness, `alpha' (1 - exp(-tau))`, at the mean depth of that
//! interaction (one mean free path for thick slabs, the paper's source), and `exp(-tau)` crosses unscattered and stays
//! a point. So thin layers neither gain nor lose light. Left out: rough interfaces, light refracted or reflected at
//! interior interfaces before it scatters, and transmission to the far side as a profile.

use super::boundary::Coefficients;
use super::complex::{Complex, bessel_k};
use super::tabulated::{Grid, Tabulated};
use crate::error::{Error, Result};
use crate::medium::fresnel::{BoundaryFit, boundary_a};
use crate::medium::profile::Profile;

use std::f64::consts::{PI, SQRT_2, TAU};

/// Largest number of layers of a stack.
pub const MOST_LAYERS: usize = 16;

/// Accepted thicknesses (mm).
pub const THICKNESSES_MM: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// Step of the trapezoidal rule in the logarithm of the frequency: its error is exp(-pi^2 / (2 step)) of the whole.
const FREQUENCY_STEP: f64 = 0.2;

/// Part of the inverse transform that is dropped at either end, relative to the whole.
const CUT: f64 = 1e-12;

/// Exponent at which the transform has vanished.
const FADED: f64 = 34.0;

/// Step of the table in `ln(1 + r^2 / scale^2)`.
const TABLE_STEP: f64 = 0.1;

/// Reach of the table in longest lengths of the stack, and in decay lengths.
const REACH: (f64, f64) = (1e7, 40.0);

/// One layer of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Thickness in mm; none for a half space, which only the last layer may be.
    pub thickness_mm: Option<f64>,
    /// Reduced scattering coefficient in 1/mm.
    pub sigma_s_reduced_per_mm: f64,
    /// Absorption coefficient in 1/mm.
    pub sigma_a_per_mm: f64,
    /// Refractive index over that of the outside.
    pub eta_inside_over_outside: f64,
}

/// Multipole of one or more layers, from the top, one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    table: Tabulated,
    total: f64,
}

impl Layers {
    /// The profile of a stack whose first layer faces the light.
    ///
    /// A layer without extinction counts as absent. The table is accurate to about 1e-8 of R_d wherever it reaches (1e7
    /// times the longest length of the stack, 40 decay lengths, or a tail of 1e-18 of the whole).
    ///
    /// # Errors
    /// Invalid input without layers or with more than [`MOST_LAYERS`], for a thickness outside [`THICKNESSES_MM`], and
    /// for a half space that is not the last. Run time, should the table fail.
    pub fn new(layers: &[Layer], fit: BoundaryFit) -> Result<Self> {
        let stack = Stack::new(layers, fit)?;
        let [reflected, _] = stack.totals();
        // What the frequencies' products would lose to underflow returns nothing.
        if reflected < 1e-150 {
            let table = Tabulated::new(Grid { scale: 1.0, step: 1.0 }, 1.0, &[])?;
            return Ok(Self { table, total: 0.0 });
        }
        let grid = Grid { scale: stack.shortest_mm, step: TABLE_STEP };
        let farthest_mm = (REACH.0 * stack.longest_mm).min(stack.longest_mm + REACH.1 / stack.decay_rate_per_mm());
        let transform = Transform::new(&stack, farthest_mm);
        let count = grid.count(farthest_mm);
        let mut samples = vec![(transform.centre(), reflected / TAU)];
        for k in 1..count {
            let sample = transform.at(grid.knot(k));
            samples.push(sample);
            if sample.1.is_nan() || sample.1 <= 1e-18 * reflected {
                break;
            }
        }
        Ok(Self { table: Tabulated::new(grid, 1.0, &samples)?, total: reflected })
    }
}

impl Profile for Layers {
    fn reflectance(&self, r_mm: f64) -> f64 {
        self.table.reflectance(r_mm)
    }

    fn tail(&self, r_mm: f64) -> f64 {
        self.table.tail(r_mm)
    }

    fn total(&self) -> f64 {
        self.total
    }
}

/// A layer with the quantities of its transform, lengths in mm.
#[derive(Clone, Copy, Debug)]
struct Slab {
    /// Infinite for a half space.
    thickness: f64,
    /// Fraction of light that interacts and scatters, and fraction that crosses unscattered.
    source: f64,
    unscattered: f64,
    /// Depth of the source below the top.
    depth: f64,
    /// Extrapolation lengths beyond the top and the bottom.
    beyond: [f64; 2],
    sigma_tr: f64,
}

impl Slab {
    fn new(layer: &Layer, a: [f64; 2]) -> Self {
        let medium = Coefficients::new(layer.sigma_s_reduced_per_mm, layer.sigma_a_per_mm);
        let free_path = 1.0 / medium.extinction_per_mm;
        let thickness = layer.thickness_mm.unwrap_or(f64::INFINITY);
        let tau = thickness / free_path;
        let depth = if tau > 1e-3 {
            // 1 / tau - 1 / (exp(tau) - 1) of the thickness.
            free_path * (1.0 - if tau < 700.0 { tau / tau.exp_m1() } else { 0.0 })
        } else {
            thickness * (0.5 - tau / 12.0)
        };
        Self {
            thickness,
            source: medium.albedo * -(-tau).exp_m1(),
            unscattered: (-tau).exp(),
            depth,
            beyond: a.map(|a| 2.0 / 3.0 * a * free_path),
            sigma_tr: medium.extinction_per_mm * (3.0 * medium.absorbed).sqrt(),
        }
    }

    /// Thickness with both extrapolation lengths.
    fn whole(&self) -> f64 {
        self.thickness + self.beyond[0] + self.beyond[1]
    }

    /// Transforms of reflectance and transmittance for light from above at a squared frequency.
    fn lit_from_above(&self, s2: Complex) -> [Complex; 2] {
        self.of(s2, self.beyond)
    }

    /// Transforms of reflectance and transmittance for light from below.
    fn lit_from_below(&self, s2: Complex) -> [Complex; 2] {
        self.of(s2, [self.beyond[1], self.beyond[0]])
    }

    /// With `q^2 = s^2 + sigma_tr^2`: fluxes through both faces of a unit source between the zeros of the fluence,
    /// `cosh(q b_0) sinh(q (P - a)) / sinh(q P)` and `cosh(q b_1) sinh(q a) / sinh(q P)`, by decaying exponentials.
    fn of(&self, s2: Complex, [near, far]: [f64; 2]) -> [Complex; 2] {
        let q = (s2 + Complex::new(self.sigma_tr * self.sigma_tr, 0.0)).sqrt();
        let rise = |length: f64| Complex::ONE + (-q.scale(2.0 * length)).exp();
        let front = (-q.scale(self.depth)).exp().scale(0.5 * self.source);
        if self.thickness.is_infinite() {
            return [front * rise(near), Complex::ZERO];
        }
        let (whole, a) = (self.whole(), self.depth + near);
        let ratio = |length: f64| {
            if q.abs() * whole < 1e-12 {
                Complex::new(length / whole, 0.0)
            } else {
                q.scale(2.0 * length).one_minus_decay() / q.scale(2.0 * whole).one_minus_decay()
            }
        };
        let back = (-q.scale(self.thickness - self.depth)).exp().scale(0.5 * self.source);
        let through = back * rise(far) * ratio(a) + Complex::new(self.unscattered, 0.0);
        [front * rise(near) * ratio(whole - a), through]
    }
}

/// All layers with extinction, from the top.
struct Stack {
    slabs: Vec<Slab>,
    /// Smallest depth of a source, and largest relevant length.
    shortest_mm: f64,
    longest_mm: f64,
}

impl Stack {
    fn new(layers: &[Layer], fit: BoundaryFit) -> Result<Self> {
        if layers.is_empty() || layers.len() > MOST_LAYERS {
            let count = layers.len();
            return Err(Error::input(format!("{count} layers; there must be 1 to {MOST_LAYERS}")));
        }
        for (i, layer) in layers.iter().enumerate() {
            match layer.thickness_mm {
                None if i + 1 < layers.len() => {
                    return Err(Error::input(format!(
                        "layer {} has no thickness; only the last may go without",
                        i + 1
                    )));
                }
                Some(thickness) if !THICKNESSES_MM.contains(&thickness) => {
                    return Err(Error::input(format!(
                        "layer {} is {thickness} mm thick; it must be between {:e} and {:e}",
                        i + 1,
                        THICKNESSES_MM.start(),
                        THICKNESSES_MM.end()
                    )));
                }
                _ => {}
            }
        }
        // No light stops in a layer without extinction: what is around it meets.
        let present: Vec<&Layer> =
            layers.iter().filter(|l| l.sigma_s_reduced_per_mm + l.sigma_a_per_mm > 0.0).collect();
        let eta = |i: Option<usize>| i.and_then(|i| present.get(i)).map_or(1.0, |l| l.eta_inside_over_outside);
        let slabs: Vec<Slab> = present
            .iter()
            .enumerate()
            .map(|(i, layer)| {
                let own = layer.eta_inside_over_outside;
                let a = [i.checked_sub(1), Some(i + 1)].map(|next| boundary_a(own / eta(next), fit));
                Slab::new(layer, a)
            })
            .collect();
        let shortest_mm = slabs.iter().map(|slab| slab.depth).fold(f64::INFINITY, f64::min);
        let longest_mm = slabs
            .iter()
            .map(|slab| slab.depth + slab.beyond[0] + if slab.thickness.is_finite() { slab.thickness } else { 0.0 })
            .fold(0.0, f64::max);
        Ok(Self { slabs, shortest_mm, longest_mm })
    }

    /// Transforms of the reflectance and the transmittance of the whole stack, light from above.
    fn transform(&self, s2: Complex) -> [Complex; 2] {
        let mut below = [Complex::ZERO, Complex::ONE];
        for slab in self.slabs.iter().rev() {
            let [down_back, down_through] = slab.lit_from_above(s2);
            if below[0] == Complex::ZERO {
                below = [down_back, down_through * below[1]];
                continue;
            }
            let [up_back, up_through] = slab.lit_from_below(s2);
            let bounced = Complex::ONE / (Complex::ONE - up_back * below[0]);
            below = [down_back + down_through * below[0] * up_through * bounced, down_through * below[1] * bounced];
        }
        below
    }

    /// Total reflectance and transmittance.
    fn totals(&self) -> [f64; 2] {
        self.transform(Complex::ZERO).map(|total| total.re.clamp(0.0, 1.0))
    }

    /// A decay rate (1/mm) that is less than the profile's: 0.9 of the first singularity of the transform on the
    /// imaginary axis.
    fn decay_rate_per_mm(&self) -> f64 {
        // Below the smallest sigma_tr every q is real, and no reflectance exceeds its total.
        let least = self.slabs.iter().map(|slab| slab.sigma_tr).fold(f64::INFINITY, f64::min);
        let finite: f64 = self.slabs.iter().map(Slab::whole).filter(|whole| whole.is_finite()).sum();
        // The branch point of a half space; a slab on its own has poles only.
        let most =
            self.slabs.iter().filter(|s| s.thickness.is_infinite()).map(|s| s.sigma_tr).fold(f64::INFINITY, f64::min);
        let mut safe = least;
        if finite > 0.0 {
            // From there on a mode of the stack is a pole: the sign changes.
            for k in 1..1000 {
                let rate = least.hypot(0.02 * PI / finite * f64::from(k));
                let value = self.transform(Complex::new(-rate * rate, 0.0))[0].re;
                if !(rate < most && value > 0.0) {
                    break;
                }
                safe = rate;
            }
        }
        0.9 * safe
    }
}

/// The inverse Hankel transform along a path without oscillations.
///
/// With `J_0 = Re H_0`, `s = i kappa` and `kappa = c + w exp(-i pi / 4)`: `R = Re i/pi^2 Int R^(s) K_0(kappa r) kappa d
/// kappa`, and for the tail K_1 and r in place of K_0 and kappa. Both fade as `exp(-c r)`, which keeps the digits of
/// far distances; the integrand is smooth in ln w.
struct Transform {
    /// w, kappa, and `i / pi^2 R^ d kappa`.
    nodes: Vec<(f64, Complex, Complex)>,
    source_mm: f64,
    /// Contribution of half the origin to the tail when the path starts there.
    origin: f64,
    centre: f64,
}

impl Transform {
    fn new(stack: &Stack, farthest_mm: f64) -> Self {
        let rate = stack.decay_rate_per_mm();
        let direction = Complex::new(0.5 * SQRT_2, -0.5 * SQRT_2);
        let smallest = if rate > 0.0 { (0.1 * rate).min(1.0 / stack.longest_mm) } else { 1.0 / farthest_mm };
        let first = (CUT * smallest).ln();
        let last = (FADED * SQRT_2 / stack.shortest_mm).ln();
        let count = ((last - first) / FREQUENCY_STEP).ceil() as usize;
        let node = |i: usize, start: f64| {
            let w = (first + FREQUENCY_STEP * i as f64).exp();
            let kappa = Complex::new(start, 0.0) + direction.scale(w);
            let step = direction.scale(w * FREQUENCY_STEP);
            (w, kappa, stack.transform(-(kappa * kappa))[0] * step)
        };
        let turn = Complex::new(0.0, 1.0 / (PI * PI));
        let nodes = (0..=count).map(|i| node(i, rate)).map(|(w, kappa, value)| (w, kappa, value * turn)).collect();
        // R(0) has no K_0: Int R^ s ds / (2 pi) with s ds = -kappa d kappa.
        let centre = (0..=count).map(|i| node(i, 0.0)).map(|(_, kappa, value)| -(kappa * value).re / TAU).sum();
        let whole = stack.totals()[0] / TAU;
        Self { nodes, source_mm: stack.shortest_mm, origin: if rate > 0.0 { 0.0 } else { 0.5 * whole }, centre }
    }

    /// R_d(0) in 1/mm^2.
    fn centre(&self) -> f64 {
        self.centre
    }

    /// R_d in 1/mm^2 and the tail at a positive distance.
    fn at(&self, r_mm: f64) -> (f64, f64) {
        let largest = FADED * SQRT_2 / (r_mm + self.source_mm);
        let (mut reflectance, mut tail) = (0.0, self.origin);
        for (_, kappa, value) in self.nodes.iter().take_while(|node| node.0 <= largest) {
            let [k_0, k_1] = bessel_k(kappa.scale(r_mm));
            reflectance += (*value * *kappa * k_0).re;
            tail += r_mm * (*value * k_1).re;
        }
        (reflectance, tail)
    }
}

#[cfg(test)]
mod tests;
