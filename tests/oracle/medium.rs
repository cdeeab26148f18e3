//! Fresnel transmittance, the dipole's diffuse reflectance, and its closed-form integrals.

use super::vector::{V3, cross, distance, dot, gauss_legendre, length, normalised, sub};
use std::f64::consts::PI;
use std::sync::OnceLock;

/// Reduced scattering and absorption per mm for R, G, B; eta is inside over outside.
#[derive(Clone, Debug)]
pub struct OracleMedium {
    pub sigma_s_reduced: [f64; 3],
    pub sigma_a: [f64; 3],
    pub eta: f64,
}

/// Exact unpolarised transmittance for light that arrives at cosine `mu` from outside.
#[inline]
pub fn fresnel_transmittance(eta: f64, mu: f64) -> f64 {
    let mu = mu.clamp(0.0, 1.0);
    let sin2_inside = (1.0 - mu * mu) / (eta * eta);
    if sin2_inside >= 1.0 {
        return 0.0;
    }
    let inside = (1.0 - sin2_inside).sqrt();
    if mu + inside == 0.0 {
        return 0.0;
    }
    let s = (mu - eta * inside) / (mu + eta * inside);
    let p = (eta * mu - inside) / (eta * mu + inside);
    1.0 - 0.5 * (s * s + p * p)
}

/// The published fit of the diffuse Fresnel reflectance seen from inside (Egan and Hilgeman's two branches).
pub fn diffuse_fresnel_fit(eta: f64) -> f64 {
    if eta == 1.0 {
        0.0
    } else if eta > 1.0 {
        -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta
    } else {
        -0.4399 + 0.7099 / eta - 0.3319 / (eta * eta) + 0.0636 / (eta * eta * eta)
    }
}

/// One channel of the dipole of Jensen et al. 2001.
#[derive(Clone, Copy, Debug, Default)]
pub struct Channel {
    pub albedo: f64,
    pub sigma_tr: f64,
    pub z: [f64; 2],
}

impl Channel {
    /// R_d in 1/mm^2 at the squared distance `r2` in mm^2.
    #[inline]
    pub fn r_d(&self, r2: f64) -> f64 {
        let mut sum = 0.0;
        for z in self.z {
            let d2 = r2 + z * z;
            let d = d2.sqrt();
            sum += z * (self.sigma_tr + 1.0 / d) * (-self.sigma_tr * d).exp() / d2;
        }
        if self.albedo > 0.0 { self.albedo / (4.0 * PI) * sum } else { 0.0 }
    }

    /// Integral of R_d over a disc of radius `r` about the point.
    pub fn disc(&self, r: f64) -> f64 {
        let term = |z: f64| {
            let d = (r * r + z * z).sqrt();
            (-self.sigma_tr * z).exp() - z * (-self.sigma_tr * d).exp() / d
        };
        if self.albedo > 0.0 { self.albedo / 2.0 * self.z.iter().map(|&z| term(z)).sum::<f64>() } else { 0.0 }
    }

    /// Integral of R_d over the whole plane.
    pub fn total(&self) -> f64 {
        self.albedo / 2.0 * self.z.iter().map(|z| (-self.sigma_tr * z).exp()).sum::<f64>()
    }

    /// Integral of R_d(|y - x|) over the planar triangle, by angles about the foot of `x`, edge after edge.
    ///
    /// The radial integral has the primitive -G, so an edge contributes Int (G(0) - G(rho(theta))) d theta.
    pub fn triangle(&self, corners: [V3; 3], x: V3) -> f64 {
        let n = normalised(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])));
        let height = dot(sub(x, corners[0]), n);
        let foot = [x[0] - n[0] * height, x[1] - n[1] * height, x[2] - n[2] * height];
        let g = |rho2: f64| {
            let sum: f64 = self
                .z
                .iter()
                .map(|z| {
                    let d = (rho2 + height * height + z * z).sqrt();
                    z * (-self.sigma_tr * d).exp() / d
                })
                .sum();
            self.albedo / (4.0 * PI) * sum
        };
        static NODES: OnceLock<Vec<(f64, f64)>> = OnceLock::new();
        let nodes = NODES.get_or_init(|| gauss_legendre(64));
        let mut total = 0.0;
        for k in 0..3 {
            let (a, b) = (sub(corners[k], foot), sub(corners[(k + 1) % 3], foot));
            let edge = normalised(sub(b, a));
            let away = dot(cross(a, edge), n);
            if away.abs() < 1e-14 * (length(a) + length(b)) {
                continue;
            }
            let (t0, t1) = ((dot(a, edge) / away.abs()).atan(), (dot(b, edge) / away.abs()).atan());
            let half = 0.5 * (t1 - t0);
            let integral: f64 = nodes
                .iter()
                .map(|(x, w)| w * half * (g(0.0) - g((away / (t0 + half * (1.0 + x)).cos()).powi(2))))
                .sum();
            total += integral * away.signum();
        }
        total
    }
}

impl OracleMedium {
    /// The dipole of each channel.
    pub fn channels(&self) -> [Channel; 3] {
        let a = (1.0 + diffuse_fresnel_fit(self.eta)) / (1.0 - diffuse_fresnel_fit(self.eta));
        std::array::from_fn(|c| {
            let sigma_t = self.sigma_s_reduced[c] + self.sigma_a[c];
            if sigma_t <= 0.0 {
                return Channel { albedo: 0.0, sigma_tr: 0.0, z: [1.0, 1.0] };
            }
            let z_r = 1.0 / sigma_t;
            Channel {
                albedo: self.sigma_s_reduced[c] / sigma_t,
                sigma_tr: (3.0 * self.sigma_a[c] * sigma_t).sqrt(),
                z: [z_r, z_r * (1.0 + 4.0 * a / 3.0)],
            }
        })
    }

    /// `2 Int_0^1 F_t(eta, mu) mu dmu`: the share of a constant environment's irradiance that enters.
    pub fn diffuse_transmittance(&self) -> f64 {
        // mu = s^2 takes the square root out of the integrand at grazing angles.
        gauss_legendre(64)
            .iter()
            .map(|(x, w)| {
                let s = 0.5 * (1.0 + x);
                0.5 * w * 4.0 * s.powi(3) * fresnel_transmittance(self.eta, s * s)
            })
            .sum()
    }
}

/// Longest distance between corners; here because the closed form and the patches both want it.
pub fn longest_edge(c: [V3; 3]) -> f64 {
    distance(c[0], c[1]).max(distance(c[1], c[2])).max(distance(c[2], c[0]))
}
