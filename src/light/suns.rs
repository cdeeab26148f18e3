//! The suns of an environment: small, bright places of its map, taken out of it as parallel light.
//!
//! Stored rows see an environment through the texels of a cube map, several degrees wide: that is fine for a sky and a
//! soft window, and far too coarse for the shadows of a sun. So what is sharp and holds a share of the irradiance that
//! matters becomes a directional light from the place where it is, whose shadows are traced; the rest stays a map.
//! Nothing is lost or gained: what a sun has is what its pixels lose.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;

use super::Light;
use super::environment::{EnvironmentMap, Rotation};

/// Angle from its brightest pixel within which a sun lies, in degrees: about a texel of the cube maps that the rest goes
/// through, and small enough that one direction stands for it.
pub const RADIUS_DEGREES: f64 = 3.0;

/// Share of the map's energy, in any channel, from which on a sun is worth a light of its own. One that stays in the
/// map errs by about a tenth of itself: by a thousandth of the light.
pub const LEAST_SHARE: f64 = 0.01;

/// Around a sun, radiance is at most this share of its brightest pixel's: a wider light is no sun.
pub const MOST_AROUND: f64 = 0.25;

/// A small bright place of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector towards it in the map's frame.
    pub direction: DVec3,
    /// Irradiance on a surface that faces it, RGB, before the light's scale.
    pub irradiance: DVec3,
}

/// The suns of a map, the brightest pixel first, and the map without them. None if it has no sun.
pub fn split(map: &EnvironmentMap) -> Option<(Vec<Sun>, EnvironmentMap)> {
    let pixel = (PI / map.height() as f64).max(2.0 * PI / map.width() as f64);
    let radius = RADIUS_DEGREES.to_radians();
    if pixel > 2.0 * radius {
        return None;
    }
    let total = map.energy();
    let share = |energy: DVec3| {
        let channel = |c: usize| if total[c] > 0.0 { energy[c] / total[c] } else { 0.0 };
        channel(0).max(channel(1)).max(channel(2))
    };
    // A sun has its share within the cone, or within one pixel where that is larger.
    let widest = (2.0 * PI * (1.0 - radius.cos())).max(map.pixel_solid_angle_sr(map.height() / 2));
    let mut peaks: Vec<(f64, usize)> = (0..map.pixels().len())
        .map(|i| (share(radiance(map.pixels()[i])), i))
        .filter(|(brightness, _)| brightness * widest >= LEAST_SHARE)
        .collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let outer = (2.0 * radius).max(radius + 1.5 * pixel);
    let mut seen = vec![false; if peaks.is_empty() { 0 } else { map.pixels().len() }];
    let mut pixels = Vec::new();
    let mut suns = Vec::new();
    for (brightness, peak) in peaks {
        if seen[peak] {
            continue;
        }
        let disc = Disc::around(map, peak, radius, outer);
        disc.inside.iter().for_each(|&i| seen[i] = true);
        let around = disc.ring.iter().map(|&i| share(radiance(map.pixels()[i]))).fold(0.0, f64::max);
        if around > MOST_AROUND * brightness {
            continue;
        }
        if pixels.is_empty() {
            pixels = map.pixels().to_vec();
        }
        let background = disc.background(map);
        let mut sun = Sun { direction: DVec3::ZERO, irradiance: DVec3::ZERO };
        let mut rest = Vec::with_capacity(disc.inside.len());
        for &i in &disc.inside {
            let old = map.pixels()[i];
            let new: [f32; 3] = std::array::from_fn(|c| old[c].min(background[c]));
            let energy = (radiance(old) - radiance(new)) * map.pixel_solid_angle_sr(i / map.width());
            sun.irradiance += energy;
            sun.direction += share(energy) * map.pixel_direction(i % map.width(), i / map.width());
            rest.push((i, new));
        }
        if share(sun.irradiance) >= LEAST_SHARE {
            rest.into_iter().for_each(|(i, new)| pixels[i] = new);
            suns.push(Sun { direction: sun.direction.normalize_or_zero(), ..sun });
        }
    }
    let rest = || EnvironmentMap::from_valid(map.width(), map.height(), pixels);
    (!suns.is_empty()).then(|| (suns, rest()))
}

/// The lights with the suns of those environments that `of` selects as directional lights behind the rest of the map.
/// Together they send what the environments do.
pub fn apart(lights: &[Light], of: impl Fn(&Light) -> bool) -> Vec<Light> {
    let mut all = Vec::with_capacity(lights.len());
    for light in lights {
        let Light::Environment { map, rotate_degrees, scale } = light else {
            all.push(light.clone());
            continue;
        };
        match split(map).filter(|_| of(light)) {
            None => all.push(light.clone()),
            Some((suns, rest)) => {
                all.push(Light::Environment { map: Arc::new(rest), rotate_degrees: *rotate_degrees, scale: *scale });
                let turn = Rotation::from_degrees(*rotate_degrees);
                all.extend(suns.into_iter().map(|sun| Light::Directional {
                    from: turn.to_world(sun.direction),
                    irradiance: sun.irradiance * *scale,
                }));
            }
        }
    }
    all
}

fn radiance([r, g, b]: [f32; 3]) -> DVec3 {
    DVec3::new(f64::from(r), f64::from(g), f64::from(b))
}

/// Pixels around one.
struct Disc {
    inside: Vec<usize>,
    ring: Vec<usize>,
}

impl Disc {
    /// Pixels whose centres are within `radius` of that of `peak`, and those farther away within `outer`.
    fn around(map: &EnvironmentMap, peak: usize, radius: f64, outer: f64) -> Self {
        let (width, height) = (map.width(), map.height());
        let (column, row) = (peak % width, peak / width);
        let middle = map.pixel_direction(column, row);
        let rows = (outer / PI * height as f64).ceil() as usize;
        let (near, far) = (radius.cos(), outer.cos());
        let mut disc = Self { inside: Vec::new(), ring: Vec::new() };
        for y in row.saturating_sub(rows)..=(row + rows).min(height - 1) {
            for x in 0..width {
                let cosine = map.pixel_direction(x, y).dot(middle);
                if cosine >= near || (x, y) == (column, row) {
                    disc.inside.push(y * width + x);
                } else if cosine >= far {
                    disc.ring.push(y * width + x);
                }
            }
        }
        disc
    }

    /// Mean radiance of the ring.
    fn background(&self, map: &EnvironmentMap) -> [f32; 3] {
        let (mut sum, mut angle) = (DVec3::ZERO, 0.0);
        for &i in &self.ring {
            let solid_angle = map.pixel_solid_angle_sr(i / map.width());
            sum += radiance(map.pixels()[i]) * solid_angle;
            angle += solid_angle;
        }
        if angle > 0.0 { (sum / angle).to_array().map(|c| c as f32) } else { [0.0; 3] }
    }
}

#[cfg(test)]
mod tests {
    use super::super::environment::{direction_of, position_of};
    use super::super::sky::sky;
    use super::*;

    /// The built-in sky, twice as fine as asked for at most, with single pixels of some radiance.
    fn with_suns(suns: &[(DVec3, f32)]) -> EnvironmentMap {
        let sky = sky();
        let mut pixels = sky.pixels().to_vec();
        for (direction, radiance) in suns {
            let (u, v) = position_of(*direction);
            let (x, y) = ((u * sky.width() as f64) as usize, (v * sky.height() as f64) as usize);
            pixels[y * sky.width() + x] = [*radiance, 0.9 * *radiance, 0.5 * *radiance];
        }
        EnvironmentMap::new(sky.width(), sky.height(), pixels).expect("valid")
    }

    #[test]
    fn one_pixel_is_found_where_it_is_and_no_light_is_lost() {
        for direction in
            [DVec3::new(0.3, 0.7, 0.2), DVec3::new(1.0, -0.2, 0.0), DVec3::new(0.01, 1.0, 0.01), DVec3::NEG_Z]
        {
            let map = with_suns(&[(direction, 2e4)]);
            let (suns, rest) = split(&map).expect("a sun");
            let [sun] = suns[..] else { panic!("{suns:?}") };
            let (u, v) = position_of(direction);
            let centre = map.pixel_direction((u * map.width() as f64) as usize, (v * map.height() as f64) as usize);
            assert!(sun.direction.distance(centre) < 1e-3, "{} {centre}", sun.direction);
            let sum = rest.energy() + sun.irradiance;
            assert!((sum / map.energy() - 1.0).abs().max_element() < 1e-14, "{sum} {}", map.energy());
            assert!(split(&rest).is_none(), "nothing is left to find");
            assert!(rest.pixels().iter().zip(map.pixels()).all(|(a, b)| (0..3).all(|c| a[c] <= b[c])));
        }
    }

    #[test]
    fn smooth_maps_windows_and_black_have_no_sun() {
        assert_eq!(split(&sky()), None);
        let of = |width: usize, height: usize, radiance: &dyn Fn(usize, usize) -> f32| {
            let pixels = (0..width * height).map(|i| [radiance(i % width, i / width); 3]).collect();
            EnvironmentMap::new(width, height, pixels).expect("valid")
        };
        assert_eq!(split(&of(64, 64, &|_, _| 0.0)), None);
        assert_eq!(split(&of(64, 64, &|_, _| 3.0)), None);
        for (width, height) in [(1, 1), (4, 2), (2, 64), (300, 1)] {
            assert_eq!(split(&of(width, height, &|x, y| if x + y == 0 { 1e6 } else { 1.0 })), None, "{width}x{height}");
        }
        // A window of 14 degrees with all of the light.
        let window = |x: usize, y: usize| if (100..110).contains(&x) && (50..60).contains(&y) { 50.0 } else { 0.0 };
        assert_eq!(split(&of(256, 128, &window)), None);
        // A sun that holds less than matters.
        assert_eq!(split(&with_suns(&[(DVec3::X, 60.0)])), None);
    }

    #[test]
    fn suns_turn_and_scale_with_their_map_and_only_the_selected_maps_lose_them() {
        let map = with_suns(&[(DVec3::new(0.3, 0.7, 0.2), 2e4), (DVec3::new(-0.8, 0.1, 0.6), 1e4)]);
        let scale = DVec3::new(2.0, 1.0, 0.5);
        let light = Light::environment(Arc::new(map.clone()), 90.0, scale).expect("valid");
        let lamp = Light::constant(DVec3::ONE).expect("valid");
        let all = apart(&[lamp.clone(), light.clone()], |_| true);
        let [
            first,
            Light::Environment { map: rest, .. },
            Light::Directional { from, irradiance },
            Light::Directional { .. },
        ] = &all[..]
        else {
            panic!("{all:?}")
        };
        assert_eq!(*first, lamp);
        let (suns, _) = split(&map).expect("suns");
        assert!(from.distance(Rotation::from_degrees(90.0).to_world(suns[0].direction)) < 1e-15);
        assert_eq!(*irradiance, suns[0].irradiance * scale);
        let sent = rest.energy() + suns.iter().map(|sun| sun.irradiance).sum::<DVec3>();
        assert!((sent / map.energy() - 1.0).abs().max_element() < 1e-14);
        assert_eq!(apart(std::slice::from_ref(&light), |_| false), [light]);
    }

    #[test]
    fn a_blurred_sun_is_one_sun() {
        let at = direction_of(0.31, 0.27);
        let (width, height) = (512, 256);
        let pixels = (0..width * height)
            .map(|i| {
                let direction = direction_of((i % width) as f64 / width as f64, (i / width) as f64 / height as f64);
                let degrees = direction.dot(at).min(1.0).acos().to_degrees();
                [0.1 + 5e3 * (-(degrees / 0.7).powi(2)).exp() as f32; 3]
            })
            .collect();
        let map = EnvironmentMap::new(width, height, pixels).expect("valid");
        let (suns, rest) = split(&map).expect("a sun");
        assert_eq!(suns.len(), 1);
        assert!(suns[0].direction.dot(at) > 0.5f64.to_radians().cos());
        assert!(rest.energy().x < 0.2 * 4.0 * PI, "{}", rest.energy());
    }
}
