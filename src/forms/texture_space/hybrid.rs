//! The division of R_d for the hybrid method (section 4 of the paper): into a global part, which the shared samples sum, and a local part, which is
//! gathered in an image of the irradiance as the light sees it.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;

use super::settings::Local;
use crate::math::quadrature::integrate;
use crate::medium::profile::Profile;
use crate::transport::kernel::medium::MediumKernel;

/// The weight of the local part, W_l: 1 at the receiver, 1/2 at R_p. (The paper prints another sign in the exponent inside R_p.)
fn local_weight(r_mm: f64, middle_mm: f64, sharpness: f64) -> f64 {
    let beyond = (r_mm - middle_mm) * sharpness;
    if beyond <= 0.0 { 1.0 - 0.5 * beyond.exp() } else { 0.5 * (-beyond).exp() }
}

/// R_p, mm: the largest distance at which 2 pi r R_d(r) of some channel is the lower bound; 0 where none is as important.
fn middle_mm(profiles: &[Arc<dyn Profile>; 3], importance: f64) -> f64 {
    let of = |profile: &Arc<dyn Profile>| {
        let at = |r: f64| TAU * r * profile.reflectance(r) - importance;
        // From far away inwards, in steps of 2 %.
        let mut outer = profile.range_mm(1e-9).min(1e12);
        let least = 1e-6 * outer;
        while outer > least {
            let inner = outer / 1.02;
            if at(inner) >= 0.0 {
                let (mut low, mut high) = (inner, outer);
                for _ in 0..40 {
                    let middle = 0.5 * (low + high);
                    if at(middle) >= 0.0 { low = middle } else { high = middle }
                }
                return low;
            }
            outer = inner;
        }
        0.0
    };
    profiles.iter().map(of).fold(0.0, f64::max)
}

/// The global part R_d W_g of a profile.
struct Global {
    whole: Arc<dyn Profile>,
    middle_mm: f64,
    sharpness: f64,
    range_mm: f64,
}

impl Profile for Global {
    fn reflectance(&self, r_mm: f64) -> f64 {
        self.whole.reflectance(r_mm) * (1.0 - local_weight(r_mm, self.middle_mm, self.sharpness))
    }

    /// The tail of the whole less that of the local part.
    fn tail(&self, r_mm: f64) -> f64 {
        let local = |r: f64| r * self.whole.reflectance(r) * local_weight(r, self.middle_mm, self.sharpness);
        let tolerance = 1e-9 * self.whole.tail(0.0).max(f64::MIN_POSITIVE);
        let cut = self.middle_mm.clamp(r_mm, self.range_mm.max(r_mm));
        let inside = integrate(local, r_mm, cut, tolerance) + integrate(local, cut, self.range_mm.max(cut), tolerance);
        (self.whole.tail(r_mm) - inside).max(0.0)
    }
}

/// Steps of a [`LocalPart`]'s tables.
pub(super) const STEPS: usize = 4096;

/// The local part of a medium: its profiles in a table, and the circles of the samples.
pub(super) struct LocalPart {
    /// R_d W_l, RGB, at equal steps of the distance.
    pub(super) table: Vec<DVec3>,
    pub(super) step_mm: f64,
    /// Radius of each circle, mm, and the density of samples there, 1/mm^2; the first is the sample in the middle.
    pub(super) circles: Vec<(f64, f64)>,
}

impl LocalPart {
    fn new(profiles: &[Arc<dyn Profile>; 3], middle_mm: f64, local: &Local) -> Self {
        let range = range_mm(profiles, middle_mm, local);
        let step_mm = range / STEPS as f64;
        let at = |step: usize| {
            let r = step as f64 * step_mm;
            let weight = local_weight(r, middle_mm, local.sharpness);
            DVec3::from_array(profiles.each_ref().map(|p| weight * p.reflectance(r)))
        };
        let table: Vec<DVec3> = (0..=STEPS).map(at).collect();
        // Share of the local part inside each step, all channels.
        let mut inside = vec![0.0];
        for step in 0..STEPS {
            let ring = (step as f64 + 0.5) * step_mm * TAU * step_mm;
            inside.push(inside[step] + ring * 0.5 * (table[step] + table[step + 1]).element_sum());
        }
        let total = inside[STEPS];
        let samples = f64::from(local.rings * local.of_ring + 1);
        let density = |r: f64, table: &[DVec3]| look_up(table, step_mm, r).element_sum() / total.max(f64::MIN_POSITIVE);
        let mut circles = vec![(0.0, density(0.0, &table))];
        for ring in 0..local.rings {
            let wanted = total * (1.0 + f64::from(local.of_ring) * (f64::from(ring) + 0.5)) / samples;
            let step = inside.partition_point(|share| *share < wanted).clamp(1, STEPS);
            let (before, after) = (inside[step - 1], inside[step]);
            let share = if after > before { (wanted - before) / (after - before) } else { 0.5 };
            let r = (step as f64 - 1.0 + share) * step_mm;
            circles.push((r, density(r, &table)));
        }
        Self { table, step_mm, circles }
    }
}

/// Distance beyond which the local part is less than a millionth of the largest value.
fn range_mm(profiles: &[Arc<dyn Profile>; 3], middle_mm: f64, local: &Local) -> f64 {
    let far = profiles.iter().map(|p| p.range_mm(1e-6)).fold(0.0, f64::max);
    far.min(middle_mm + 14.0 / local.sharpness).max(f64::MIN_POSITIVE.sqrt())
}

pub(super) fn look_up(table: &[DVec3], step_mm: f64, r_mm: f64) -> DVec3 {
    let place = r_mm / step_mm;
    let index = place as usize;
    match table.get(index..index + 2) {
        Some([a, b]) => a.lerp(*b, place - index as f64),
        _ => DVec3::ZERO,
    }
}

/// The division of R_d of every medium.
pub(super) struct Division {
    pub(super) settings: Local,
    pub(super) parts: Vec<LocalPart>,
}

impl Division {
    /// Divides the kernels of the media; the second are those of the global parts, over an object of a diagonal.
    pub(super) fn new(settings: &Local, kernels: &[MediumKernel], diagonal_mm: f64) -> (Self, Vec<MediumKernel>) {
        let (mut parts, mut global) = (Vec::new(), Vec::new());
        for kernel in kernels {
            let middle_mm = middle_mm(kernel.profiles(), settings.importance);
            let range_mm = range_mm(kernel.profiles(), middle_mm, settings);
            parts.push(LocalPart::new(kernel.profiles(), middle_mm, settings));
            let sharpness = settings.sharpness;
            let profiles = kernel.profiles().each_ref().map(|whole| {
                Arc::new(Global { whole: Arc::clone(whole), middle_mm, sharpness, range_mm }) as Arc<dyn Profile>
            });
            global.push(MediumKernel::of_profiles(profiles, diagonal_mm));
        }
        (Self { settings: *settings, parts }, global)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::forms::texture_space::settings::Far;
    use crate::medium::dipole::Dipole;
    use crate::medium::fresnel;
    use crate::medium::material::preset;

    fn dipole() -> Arc<dyn Profile> {
        // The red channel of skim milk, Figure 3 of the paper.
        let milk = preset("skimmilk").map(|milk| milk.properties().dipoles(fresnel::BoundaryFit::Published));
        let [red, ..]: [Dipole; 3] = milk.unwrap();
        Arc::new(red)
    }

    #[test]
    fn the_parts_add_up_and_are_equal_in_the_middle() {
        let whole = dipole();
        let profiles = [0; 3].map(|_| Arc::clone(&whole));
        let middle = middle_mm(&profiles, 1e-3);
        assert!((TAU * middle * whole.reflectance(middle) - 1e-3).abs() < 1e-9);
        assert!(TAU * 1.01 * middle * whole.reflectance(1.01 * middle) < 1e-3);
        assert_eq!(middle_mm(&profiles, 1e9), 0.0);
        assert!((local_weight(middle, middle, 1.5) - 0.5).abs() < 1e-12);
        let global =
            Global { whole: Arc::clone(&whole), middle_mm: middle, sharpness: 1.5, range_mm: whole.range_mm(1e-9) };
        for r in [0.0, 0.3 * middle, middle, 2.0 * middle] {
            let share = global.reflectance(r) / whole.reflectance(r);
            assert!((share + local_weight(r, middle, 1.5) - 1.0).abs() < 1e-12, "{r}: {share}");
            let by_hand = integrate(|s| s * global.reflectance(s), r, whole.range_mm(1e-12), 1e-10);
            assert!((global.tail(r) - by_hand).abs() < 1e-6 * whole.tail(0.0), "{r}: {} {by_hand}", global.tail(r));
        }
    }

    /// The only table of R_d that radiosity is computed from: elsewhere R_d is evaluated.
    #[test]
    fn the_table_of_the_local_part_gives_its_flux() {
        let local = Local { importance: 0.1, sharpness: 1.5, rings: 20, of_ring: 20, image: 64, far: Far::Drawn };
        // The denser the material, the coarser the steps are to it.
        for (name, most) in [("skin1", 5e-5), ("skin2", 5e-5), ("marble", 5e-5), ("cream", 5e-5), ("spectralon", 1e-3)]
        {
            let dipoles = preset(name).unwrap().properties().dipoles(fresnel::BoundaryFit::Published);
            let profiles = dipoles.map(|dipole| Arc::new(dipole) as Arc<dyn Profile>);
            let middle = middle_mm(&profiles, 0.1);
            let part = LocalPart::new(&profiles, middle, &local);
            for (c, profile) in profiles.iter().enumerate() {
                let exact = |r: f64| profile.reflectance(r) * local_weight(r, middle, local.sharpness);
                let (mut off, mut whole) = (0.0, 0.0);
                // Between the nodes, where linear interpolation errs most.
                for step in 0..STEPS {
                    let r = (step as f64 + 0.5) * part.step_mm;
                    off += r * (look_up(&part.table, part.step_mm, r)[c] - exact(r)).abs();
                    whole += r * exact(r);
                }
                println!("{name}, channel {c}: {:.1e} of the flux", off / whole);
                assert!(off < most * whole, "{name}, channel {c}: {}", off / whole);
            }
        }
    }
}
