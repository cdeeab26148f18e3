//! Uniform sampling of the solid angle of a rectangle (Urena, Fajardo and King 2013).

use glam::DVec3;

/// A rectangle as seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle {
    origin: DVec3,
    axes: [DVec3; 3],
    x: [f64; 2],
    y: [f64; 2],
    z: f64,
    b: [f64; 2],
    k: f64,
    solid_angle: f64,
}

impl SphericalRectangle {
    /// The rectangle `corner + a u + b v`, `a` in [0, `lengths[0]`], `b` in [0, `lengths[1]`], seen from `origin`;
    /// `u` and `v` are perpendicular unit vectors.
    pub fn new(origin: DVec3, corner: DVec3, u: DVec3, v: DVec3, lengths: [f64; 2]) -> Self {
        let offset = corner - origin;
        let mut n = u.cross(v);
        let mut z = offset.dot(n);
        if z > 0.0 {
            z = -z;
            n = -n;
        }
        let x = [offset.dot(u), offset.dot(u) + lengths[0]];
        let y = [offset.dot(v), offset.dot(v) + lengths[1]];
        // In the plane of the rectangle the angles lose all digits: a receiver keeps a billionth of the size away from it.
        let reach = x.iter().chain(&y).fold(0.0f64, |a, v| a.max(v.abs()));
        let z = z.min(-1e-9 * reach).min(-f64::MIN_POSITIVE);
        let corner_vector = |i: usize, j: usize| DVec3::new(x[i], y[j], z);
        let (v00, v01, v10, v11) = (corner_vector(0, 0), corner_vector(0, 1), corner_vector(1, 0), corner_vector(1, 1));
        let plane = |a: DVec3, b: DVec3| a.cross(b).normalize_or_zero();
        let (n0, n1, n2, n3) = (plane(v00, v10), plane(v10, v11), plane(v11, v01), plane(v01, v00));
        let angle = |a: DVec3, b: DVec3| (-a.dot(b)).clamp(-1.0, 1.0).acos();
        let (g0, g1, g2, g3) = (angle(n0, n1), angle(n1, n2), angle(n2, n3), angle(n3, n0));
        let tau = std::f64::consts::TAU;
        let solid_angle = (g0 + g1 + g2 + g3 - tau).max(0.0);
        Self { origin, axes: [u, v, n], x, y, z, b: [n0.z, n2.z], k: tau - g2 - g3, solid_angle }
    }

    /// Solid angle in steradians.
    pub fn solid_angle(&self) -> f64 {
        self.solid_angle
    }

    /// The point of the rectangle for two numbers in [0, 1), uniform in solid angle.
    pub fn sample(&self, s: f64, t: f64) -> DVec3 {
        let au = s * self.solid_angle + self.k;
        let sine = au.sin();
        let fu = (au.cos() * self.b[0] - self.b[1]) / if sine.abs() < 1e-300 { 1e-300 } else { sine };
        let cu = (1.0 / length(fu, self.b[0]).max(1e-300)).copysign(fu).clamp(-1.0, 1.0);
        let xu = (-(cu * self.z) / (1.0 - cu * cu).max(1e-300).sqrt()).clamp(self.x[0], self.x[1]);
        let d = length(xu, self.z);
        let h0 = self.y[0] / length(d, self.y[0]);
        let h1 = self.y[1] / length(d, self.y[1]);
        let hv = h0 + t * (h1 - h0);
        let yv = if hv * hv < 1.0 - 1e-12 { hv * d / (1.0 - hv * hv).sqrt() } else { self.y[1] };
        let [u, v, n] = self.axes;
        self.origin + xu * u + yv.clamp(self.y[0], self.y[1]) * v + self.z * n
    }
}

/// Length of a vector whose square is in range: [`f64::hypot`] takes ten times as long.
fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_of_a_cube_covers_a_sixth_of_the_sphere() {
        let r = SphericalRectangle::new(DVec3::ZERO, DVec3::new(-1.0, -1.0, 1.0), DVec3::X, DVec3::Y, [2.0, 2.0]);
        assert!((r.solid_angle() - 4.0 * std::f64::consts::PI / 6.0).abs() < 1e-12);
    }

    #[test]
    fn irradiance_of_a_rectangle_agrees_with_the_integral_over_its_area() {
        let at = DVec3::new(0.3, -0.2, 0.0);
        let (corner, lengths) = (DVec3::new(-1.0, 0.5, 0.7), [1.5, 2.5]);
        let r = SphericalRectangle::new(at, corner, DVec3::X, DVec3::Y, lengths);
        let n = 400;
        let (mut sampled, mut exact) = (0.0, 0.0);
        for i in 0..n {
            for j in 0..n {
                let (s, t) = ((f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n));
                sampled += (r.sample(s, t) - at).normalize().z;
                let d = corner + DVec3::new(s * lengths[0], t * lengths[1], 0.0) - at;
                exact += d.z * d.z / d.length_squared().powi(2);
            }
        }
        let count = f64::from(n * n);
        let (sampled, exact) = (sampled * r.solid_angle() / count, exact * lengths[0] * lengths[1] / count);
        assert!((sampled / exact - 1.0).abs() < 1e-5, "{sampled} {exact}");
    }

    #[test]
    fn degenerate_views_stay_finite() {
        for at in [DVec3::ZERO, DVec3::new(0.5, 0.5, 0.0), DVec3::new(5.0, 0.5, 0.0), DVec3::new(0.5, 0.5, 1e-9)] {
            let r = SphericalRectangle::new(at, DVec3::ZERO, DVec3::X, DVec3::Y, [1.0, 1.0]);
            assert!(r.solid_angle().is_finite());
            for (s, t) in [(0.0, 0.0), (0.5, 0.5), (0.999, 0.999)] {
                assert!(r.sample(s, t).is_finite());
            }
        }
    }
}
