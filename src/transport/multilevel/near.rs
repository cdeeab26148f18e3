//! The compact part of a kernel: R_d less its softened form, sample by sample around each receiver.
//!
//! A sample a few radii away is taken for a disc of the mean size, over which the mean of any kernel is tabulated; the
//! remaining error is that of the shape, of fourth order. Points in place of discs err at second order: the sum over a
//! plane would still be right, but not where a nearer sample is integrated in another way. Nearer samples are: by three
//! or six points of each facet, or six of its quarters and so on, until a piece is small against its distance or
//! against the depth of the real source, on whose scale R_d is smooth.

use glam::{DVec3, Vec3};

use super::compact::{Close, Compact, Facets, Shine};
use crate::geometry::cluster::Run;
use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::math::slices::cut;
use crate::parallel::*;
use crate::transport::close_pairs::ClosePairs;
use crate::transport::kernel::radial_table::{LinearTable, Rgb, add_product};
use crate::transport::kernel::{Block, PointSource, Receiver, squares};
use crate::transport::near_rule::{MOST_SPLITS, SIX_POINTS, SLIVER};
use crate::transport::receivers::Sphere;

/// Samples around groups of receivers.
pub(crate) struct NearSamples {
    /// Samples around each group, numbered from the first of the part.
    pub(crate) close: ClosePairs,
    groups: Vec<Run>,
    receivers: Vec<DVec3>,
}

/// Distances of the close samples from one receiver.
#[derive(Default)]
struct Seen {
    /// Squared distances, mm^2.
    r2: Vec<f32>,
    /// Samples that are summed facet by facet.
    special: Vec<u32>,
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    discs: Vec<PointSource>,
    block: Block,
    close: Close,
    seen: Seen,
}

impl NearSamples {
    /// Lists of the samples within reach of receivers, which are in groups; those of groups that nobody asks for are empty, and nothing is
    /// added to them. `asked` tells whether each receiver is asked for; all are where it is empty.
    pub(super) fn new(
        samples: &[DVec3],
        receivers: &[DVec3],
        (groups, asked): (&[Run], &[bool]),
        reach_mm: f64,
    ) -> Self {
        let of_asked = |run: &Run| if is_asked(asked, run) { *run } else { Run { end: run.first, ..*run } };
        let close = ClosePairs::new(samples, |_| reach_mm, receivers, &groups.iter().map(of_asked).collect::<Vec<_>>());
        Self { close, groups: groups.to_vec(), receivers: receivers.to_vec() }
    }

    pub(super) fn bytes(&self) -> usize {
        self.close.bytes() + size_of_val(self.groups.as_slice()) + size_of_val(self.receivers.as_slice())
    }

    /// Adds the compact part to the radiosity of every receiver that is asked for, RGB: of all where `asked` is empty. `first` is the part's
    /// first sample.
    pub(super) fn add(
        &self,
        (compact, facets): (&Compact, &Facets),
        (light, first): (Shine, usize),
        asked: &[bool],
        out: &mut [Rgb],
    ) {
        let level = InstructionSet::detect().min(InstructionSet::Avx2);
        let jobs = self.groups.par_iter().zip(cut(out, self.groups.iter().map(|run| run.range().len())));
        jobs.enumerate().with_min_len(4).for_each_init(Scratch::default, |scratch, (g, (run, out))| {
            if self.close.of(g).is_empty() || !is_asked(asked, run) {
                return;
            }
            let members = &self.receivers[run.range()];
            let place = Sphere::around(members);
            scratch.close.clear();
            scratch.discs.clear();
            for &sample in self.close.of(g) {
                scratch.push(first + sample as usize, &place, compact, facets, light);
            }
            scratch.block.reset(place.centre_mm, members.iter().map(|&at_mm| Receiver { at_mm, normal: DVec3::ZERO }));
            compact.disc.add_points(level, &mut scratch.block, &scratch.discs);
            let asked = asked.get(run.range()).unwrap_or(&[]);
            for (i, (receiver, out)) in members.iter().zip(out).enumerate() {
                // What is close takes by far the most work, which is each receiver's own.
                if asked.get(i).is_some_and(|asked| !asked) {
                    continue;
                }
                let sum = scratch.block.sum(i).as_vec3().to_array();
                out.iter_mut().zip(sum).for_each(|(out, value)| *out += value);
                let at = (*receiver - place.centre_mm).as_vec3().to_array();
                receive(level, scratch, at, (compact, facets, light), out);
            }
        });
    }
}

/// Returns whether a receiver of a run is asked for.
fn is_asked(asked: &[bool], run: &Run) -> bool {
    asked.get(run.range()).is_none_or(|members| members.contains(&true))
}

impl Scratch {
    #[inline]
    fn push(&mut self, sample: usize, place: &Sphere, compact: &Compact, facets: &Facets, light: Shine) {
        let Some(flux) = light.flux.get(sample) else { return };
        let uneven = light.light.is_uneven(sample);
        if flux[0] == 0.0 && flux[1] == 0.0 && flux[2] == 0.0 && !uneven {
            return;
        }
        let Some(&([x, y, z], radius)) = facets.places.get(sample) else { return };
        let centre = place.centre_mm.as_vec3();
        let at = [x - centre.x, y - centre.y, z - centre.z];
        self.discs.push(PointSource { at, flux: [flux[0], flux[1], flux[2]] });
        let receivers = place.radius_mm as f32;
        self.close.push(sample, (at, radius, receivers), compact, facets, light);
    }
}

#[inline(always)]
fn receive_body(
    scratch: &mut Scratch,
    at: [f32; 3],
    (compact, facets, light): (&Compact, &Facets, Shine),
    out: &mut Rgb,
) {
    let Scratch { close, seen, .. } = scratch;
    look(close, at, seen);
    let smooth2 = (compact.smooth_mm * compact.smooth_mm) as f32;
    let split2 = compact.split_below * compact.split_below;
    let mut sum = [0.0f32; 4];
    for (n, &(i, pieces2)) in close.uneven.iter().enumerate() {
        let i = i as usize;
        if seen.r2[i] >= pieces2 {
            continue;
        }
        let offset = Vec3::new(close.at[0][i] - at[0], close.at[1][i] - at[1], close.at[2][i] - at[2]);
        let first = close.pieces_of(n);
        for (k, four) in close.pieces[first..first + close.fours].iter().enumerate() {
            let r2 = squares(&four.centroids, at);
            let places = compact.point.places(&r2);
            for (j, &square) in r2.iter().enumerate() {
                if square >= four.more2[j] {
                    add_product(&mut sum, &four.flux[j], &compact.point.value(&places, j));
                    continue;
                }
                let piece = light.light.pieces(close.sample[i] as usize).and_then(|mut pieces| pieces.nth(4 * k + j));
                let Some((deviation, corners)) = piece else { continue };
                let e = deviation.as_vec3();
                let corners =
                    [offset + Vec3::from(corners[0]), offset + Vec3::from(corners[1]), offset + Vec3::from(corners[2])];
                let mut integral = [0.0f32; 4];
                split(&mut integral, corners, (smooth2, split2), MOST_SPLITS, &compact.point);
                add_product(&mut sum, &[e.x, e.y, e.z, 0.0], &integral);
            }
        }
    }
    for &i in &seen.special {
        let i = i as usize;
        let begin = if i > 0 { close.ends[i - 1] as usize } else { 0 };
        for near in &close.facets[begin..close.ends[i] as usize] {
            let r2 = squares(&near.points, at);
            if r2[3] >= near.more2 {
                let places = compact.point.places(&r2);
                let mut values = [0.0f32; 4];
                for j in 0..3 {
                    add_scaled(&mut values, 1.0, &compact.point.value(&places, j));
                }
                add_product(&mut sum, &near.flux, &values);
                continue;
            }
            let sample = close.sample[i] as usize;
            let Some(facet) = facets.facets.get(near.facet as usize) else { continue };
            let mut middle = [0.0f32; 3];
            for axis in 0..3 {
                middle[axis] = near.points[axis][3] - at[axis];
            }
            let mut corners = [[0.0f32; 4]; 3];
            for ((corners, own), middle) in corners.iter_mut().zip(&facet.corners).zip(middle) {
                for (corner, own) in corners.iter_mut().zip(own) {
                    *corner = middle + own;
                }
            }
            let mut integral = [0.0f32; 4];
            if r2[3] + smooth2 < split2 * facet.radius2() {
                let [x, y, z] = &corners;
                let corners = [Vec3::new(x[0], y[0], z[0]), Vec3::new(x[1], y[1], z[1]), Vec3::new(x[2], y[2], z[2])];
                split(&mut integral, corners, (smooth2, split2), MOST_SPLITS, &compact.point);
            } else {
                points(&mut integral, (middle, facet.area), &corners, &compact.point);
            }
            let e = light.light.irradiance(sample).as_vec3();
            add_product(&mut sum, &[e.x, e.y, e.z, 0.0], &integral);
        }
        // It is among the discs as well.
        let flux = &close.flux[i];
        add_product(&mut sum, &[-flux[0], -flux[1], -flux[2], 0.0], &compact.disc.at_square(seen.r2[i]));
    }
    add_scaled(out, 1.0, &sum);
}

multiversion! {
    /// Adds the difference of close samples from their discs at one receiver.
    fn receive(
        scratch: &mut Scratch,
        at: [f32; 3],
        what: (&Compact, &Facets, Shine<'_>),
        out: &mut Rgb,
    ) => receive_body
}

/// Adds the integral, by [`SIX_POINTS`], over a triangle with a centroid and an area as the receiver sees it; corners by axis.
#[inline(always)]
fn points(sum: &mut Rgb, (middle, area): ([f32; 3], f32), corners: &[Rgb; 3], table: &LinearTable) {
    for (towards, weight) in SIX_POINTS {
        let mut r2 = [0.0f32; 4];
        for (middle, corners) in middle.iter().zip(corners) {
            let rest = (1.0 - towards) * middle;
            for (r2, corner) in r2.iter_mut().zip(corners) {
                let at = rest + towards * corner;
                *r2 += at * at;
            }
        }
        let places = table.places(&r2);
        let mut values = [0.0f32; 4];
        for j in 0..3 {
            add_scaled(&mut values, 1.0, &table.value(&places, j));
        }
        add_scaled(sum, area * weight, &values);
    }
}

/// Adds the integral over a triangle in pieces that are small enough, each by [`SIX_POINTS`].
fn split(sum: &mut Rgb, [a, b, c]: [Vec3; 3], (smooth2, split2): (f32, f32), splits: u32, table: &LinearTable) {
    let middle = (a + b + c) / 3.0;
    let radius2 = middle.distance_squared(a).max(middle.distance_squared(b)).max(middle.distance_squared(c));
    if splits > 0 && middle.length_squared() + smooth2 < split2 * radius2 {
        if let Some(halves) = halves_of_sliver([a, b, c]) {
            for half in halves {
                split(sum, half, (smooth2, split2), splits - 1, table);
            }
            return;
        }
        let (ab, bc, ca) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a));
        for quarter in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            split(sum, quarter, (smooth2, split2), splits - 1, table);
        }
        return;
    }
    let area = 0.5 * (b - a).cross(c - a).length();
    let corners = [[a.x, b.x, c.x, 0.0], [a.y, b.y, c.y, 0.0], [a.z, b.z, c.z, 0.0]];
    points(sum, (middle.to_array(), area), &corners, table);
}

/// The halves of a sliver, cut in the middle of its longest edge; none for other triangles.
#[inline(always)]
fn halves_of_sliver([a, b, c]: [Vec3; 3]) -> Option<[[Vec3; 3]; 2]> {
    let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
    let longest = ab.max(bc).max(ca);
    let doubled = (b - a).cross(c - a);
    if doubled.length_squared() >= (2.0 * SLIVER * longest) * (2.0 * SLIVER * longest) {
        return None;
    }
    let [p, q, r] = if ab == longest {
        [a, b, c]
    } else if bc == longest {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let middle = 0.5 * (p + q);
    Some([[p, middle, r], [middle, q, r]])
}

/// Finds the squared distances of all close samples from a receiver, and the samples whose facets count.
#[inline(always)]
fn look(close: &Close, [x, y, z]: [f32; 3], Seen { r2, special }: &mut Seen) {
    let count = close.sample.len();
    let (xs, ys, zs) = (&close.at[0][..count], &close.at[1][..count], &close.at[2][..count]);
    r2.resize(count, 0.0);
    for (i, r2) in r2.iter_mut().enumerate() {
        let (dx, dy, dz) = (xs[i] - x, ys[i] - y, zs[i] - z);
        *r2 = dx * dx + dy * dy + dz * dz;
    }
    // Without a decision for each.
    special.resize(count, 0);
    let mut found = 0;
    for (i, (r2, facets2)) in r2.iter().zip(&close.facets2).enumerate() {
        special[found] = i as u32;
        found += usize::from(r2 < facets2);
    }
    special.truncate(found);
}
