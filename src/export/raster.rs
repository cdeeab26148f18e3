//! Which point of the surface each texel of a map shows.

use glam::{DVec2, Vec2};

/// How far beyond the edge of a triangle texels still take its nearest point, in texels: a bilinear look-up on the edge reads texels whose
/// centres are up to 1.5 away.
const REACH: f64 = 1.5;

/// The nearest point of a triangle in the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Nearest {
    pub(super) triangle: u32,
    pub(super) weights: [f64; 3],
    /// Squared distance of the texel's centre in texels; 0 within the triangle.
    pub(super) distance2: f64,
}

/// The point that each of `resolution^2` texels shows, row by row from the top (v = 1); none beyond the reach of all triangles. Of equally
/// near ones the first triangle.
pub(super) fn nearest(triangles: impl Iterator<Item = (u32, [Vec2; 3])>, resolution: u32) -> Vec<Option<Nearest>> {
    let side = resolution as usize;
    let mut texels: Vec<Option<Nearest>> = vec![None; side * side];
    for (triangle, corners) in triangles {
        // Rows count downwards.
        let corners = corners.map(|c| DVec2::new(f64::from(c.x), 1.0 - f64::from(c.y)) * f64::from(resolution));
        let [a, b, c] = corners;
        let doubled = (b - a).perp_dot(c - a);
        if doubled == 0.0 || !doubled.is_finite() {
            continue;
        }
        let [low, high] = [a.min(b).min(c) - REACH, a.max(b).max(c) + REACH];
        let range = |low: f64, high: f64| {
            let end = (high.floor().max(-1.0) as i64 + 1).clamp(0, side as i64) as usize;
            (low.floor().max(0.0) as usize).min(end)..end
        };
        for y in range(low.y, high.y) {
            for x in range(low.x, high.x) {
                let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let found = nearest_of(&corners, doubled, at);
                let texel = &mut texels[y * side + x];
                if found.1 <= REACH * REACH && texel.is_none_or(|known| found.1 < known.distance2) {
                    *texel = Some(Nearest { triangle, weights: found.0, distance2: found.1 });
                }
            }
        }
    }
    texels
}

/// Weights of the corners at the nearest point of a triangle, and its squared distance.
fn nearest_of(corners: &[DVec2; 3], doubled: f64, at: DVec2) -> ([f64; 3], f64) {
    let [a, b, c] = corners.map(|corner| corner - at);
    let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)].map(|area| area / doubled);
    if weights.iter().all(|weight| *weight >= 0.0) {
        return (weights, 0.0);
    }
    let mut best = ([0.0; 3], f64::INFINITY);
    for (i, (from, to)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
        let along = to - from;
        let share = (-from.dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let distance2 = (from + share * along).length_squared();
        if distance2 < best.1 {
            let mut weights = [0.0; 3];
            weights[i] = 1.0 - share;
            weights[(i + 1) % 3] = share;
            best = (weights, distance2);
        }
    }
    best
}

/// Fills texels without a value from their neighbours, ring by ring, so that nothing foreign is met in filters and mip-maps.
pub(super) fn dilate<T>(values: &mut [Option<T>], side: usize)
where
    T: Copy + Default + std::ops::AddAssign + std::ops::Div<f64, Output = T>,
{
    let neighbours = |i: usize| {
        let (x, y) = ((i % side) as i64, (i / side) as i64);
        let inside = move |(dx, dy): (i64, i64)| {
            let (x, y) = (x + dx, y + dy);
            let within = |v: i64| (0..side as i64).contains(&v);
            (within(x) && within(y)).then_some(y as usize * side + x as usize)
        };
        (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|d| *d != (0, 0)).filter_map(inside)
    };
    let mut ring: Vec<usize> = (0..values.len()).filter(|i| values[*i].is_some()).collect();
    while !ring.is_empty() {
        let mut next: Vec<usize> = ring.iter().flat_map(|i| neighbours(*i)).filter(|i| values[*i].is_none()).collect();
        next.sort_unstable();
        next.dedup();
        let mean = |i: &usize| {
            let (mut sum, mut count) = (T::default(), 0.0);
            for value in neighbours(*i).filter_map(|i| values[i]) {
                sum += value;
                count += 1.0;
            }
            sum / count
        };
        let found: Vec<T> = next.iter().map(mean).collect();
        next.iter().zip(found).for_each(|(i, value)| values[*i] = Some(value));
        ring = next;
    }
}
