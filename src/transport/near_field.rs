//! The near field that is never stored: R_d less its smooth far part, integrated over the samples around each receiver
//! with the actual profile.
//!
//! Inside the split radius a far profile is a polynomial, so the difference is compact. A sample close enough is
//! integrated exactly (as in [`super::gather`]) less its far field, the far part of R_d at its centroid; the others are
//! points.

use glam::DVec3;

use super::close_pairs::ClosePairs;
use super::irradiance::Pieces;
use super::kernel::medium::MediumKernel;
use super::kernel::near::{self, Flats, Points};
use super::kernel::radial_table::{QuadraticTable, Rgb};
use super::near_rule::{NearField, THREE_POINTS, near_square};
use super::receivers::{Group, Receivers, Sphere};
use super::sample_light::SampleLight;
use super::surface::Surface;
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::math::simd::InstructionSet;
use crate::medium::dipole::Dipole;
use crate::medium::softened::Softened;
use crate::parallel::*;
use crate::progress::Progress;

/// Kernels of one medium.
struct NearKernel {
    /// Kernel of triangles.
    medium: MediumKernel,
    /// R_d, for the points that stand for a sample too near to be one point.
    whole: QuadraticTable,
    /// R_d less its far part, for the samples that are points.
    near: QuadraticTable,
    /// The far part inside the split radius: `c0 + c1 u + c2 u^2`, `u = r^2 - split^2`, of each channel.
    polynomials: [[f32; 3]; 3],
}

impl NearKernel {
    /// Points of samples are at most `reach_mm` from a receiver.
    fn new(medium: &MediumKernel, split_mm: f64, reach_mm: f64) -> Self {
        let (profiles, far, smooth_mm) = (medium.profiles(), medium.softened(split_mm), medium.smooth_mm());
        let near = |c: usize, r2: f64| far[c].less(profiles[c].as_ref(), r2);
        let whole = |c: usize, r2: f64| profiles[c].reflectance(r2.sqrt());
        Self {
            whole: QuadraticTable::new(smooth_mm, reach_mm * reach_mm, whole),
            near: QuadraticTable::new(smooth_mm, split_mm * split_mm, near),
            polynomials: far.map(|f| f.polynomial().map(|c| c as f32)),
            medium: medium.clone(),
        }
    }
}

/// Corners of every facet relative to the centroid of its patch, mm.
#[derive(Clone, Debug, Default)]
pub struct Corners(Vec<[[f32; 3]; 3]>);

impl Corners {
    /// The corners of all facets of a sample set.
    pub fn new(mesh: &Mesh, samples: &Samples, patches: &[Patch]) -> Self {
        let of_patch = |(index, patch): (usize, &Patch)| {
            let centre = patch.centre_mm;
            let relative =
                move |f: &samples::Facet| f.corners_local_mm(mesh).map(|c| (c - centre).as_vec3().to_array());
            samples.patch(index).iter().map(relative).collect::<Vec<_>>()
        };
        Self(patches.par_iter().enumerate().flat_map_iter(of_patch).collect())
    }

    /// Corners relative to the centroid of their patch, facet after facet.
    pub fn from_values(values: Vec<[[f32; 3]; 3]>) -> Self {
        Self(values)
    }

    /// Corners of the facets of one sample.
    pub fn of(&self, samples: &Samples, sample: u32) -> &[[[f32; 3]; 3]] {
        let offsets = &samples.patch_offsets[sample as usize..sample as usize + 2];
        &self.0[offsets[0] as usize..offsets[1] as usize]
    }

    /// Corners of all facets, facet after facet.
    pub fn values(&self) -> &[[[f32; 3]; 3]] {
        &self.0
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.0.as_slice())
    }
}

/// The samples, lit or not, that some receiver of each group is near to in any medium; `rule` and `split_mm` are those
/// of the near field.
pub fn around(surface: &Surface, receivers: &Receivers, rule: NearField, split_mm: f64) -> ClosePairs {
    ClosePairs::of_samples(surface, receivers, |patch| split_mm.max(rule.three_points_below * patch.radius_mm))
}

/// The near field of a scene's media.
pub struct Near<'a> {
    surface: Surface<'a>,
    around: &'a ClosePairs,
    corners: &'a Corners,
    media: Vec<NearKernel>,
    rule: NearField,
    split_mm: f64,
    level: InstructionSet,
}

/// Samples that some receiver of a group is near to, side by side; positions relative to the group's centre, mm.
#[derive(Default)]
struct Candidates {
    at: [Vec<f32>; 3],
    flux: Vec<Rgb>,
    /// Squared distances below which a sample is integrated at three points of each facet, and exactly, mm^2.
    three2: Vec<f32>,
    exact2: Vec<f32>,
    patch: Vec<u32>,
}

impl Candidates {
    fn clear(&mut self) {
        self.at.iter_mut().for_each(Vec::clear);
        self.flux.clear();
        self.three2.clear();
        self.exact2.clear();
        self.patch.clear();
    }
}

/// Working memory for one group of receivers.
#[derive(Default)]
struct Lists {
    candidates: Candidates,
    /// Squared distances of the candidates to one receiver, mm^2.
    r2: Vec<f32>,
    near_indices: Vec<u32>,
    special_indices: Vec<u32>,
    whole: Points,
    /// Triangles near to any receiver of the group.
    flats: Flats,
    sums: Vec<[f64; 3]>,
}

impl<'a> Near<'a> {
    /// The near field of media split at a radius; `around` is made with the same radius and rule.
    pub fn new(
        surface: Surface<'a>,
        (around, corners): (&'a ClosePairs, &'a Corners),
        media: &[MediumKernel],
        rule: NearField,
        split_mm: f64,
    ) -> Self {
        // What is no point is nearer than this many radii, and its points are within it.
        let largest = surface.patches.iter().map(|p| p.radius_mm).fold(0.0, f64::max);
        let reach = split_mm.max((rule.three_points_below + 1.0) * largest);
        let media = media.iter().map(|m| NearKernel::new(m, split_mm, reach)).collect();
        Self { surface, around, corners, media, rule, split_mm, level: InstructionSet::detect() }
    }

    /// Adds the near field of one irradiance for each sample, RGB, to the radiosity of every receiver. `pieces` are those of
    /// the same light, or the default.
    pub fn add(
        &self,
        receivers: &Receivers,
        (irradiance, pieces): (&[DVec3], &Pieces),
        radiosity: &mut [DVec3],
        progress: &dyn Progress,
    ) {
        progress.start("near field", receivers.len() as u64);
        let light = SampleLight::new(irradiance, pieces);
        let jobs = receivers.groups.par_iter().zip(receivers.cut(radiosity, 1)).enumerate();
        jobs.for_each_init(Lists::default, |lists, (index, (group, out))| {
            self.group((receivers, index), *group, &light, lists, out);
            progress.advance(out.len() as u64);
        });
        progress.finish();
    }

    fn group(
        &self,
        (receivers, index): (&Receivers, usize),
        group: Group,
        light: &SampleLight,
        lists: &mut Lists,
        out: &mut [DVec3],
    ) {
        let part = group.part as usize;
        let Some(medium) = self.medium(part) else { return };
        let members = &receivers.positions[group.run.range()];
        let place = receivers.sphere(group);
        lists.candidates.clear();
        for &sample in self.around.of(index) {
            self.candidate(sample, medium, &place, light, &mut lists.candidates);
        }
        lists.flats.clear();
        lists.sums.clear();
        lists.sums.resize(members.len(), [0.0; 3]);
        for (member, receiver) in members.iter().enumerate() {
            let at = (*receiver - place.centre_mm).as_vec3().to_array();
            self.receiver((member, at), medium, light, lists);
        }
        medium.medium.add_flats(self.level, &lists.flats, &mut lists.sums);
        for (sum, out) in lists.sums.iter().zip(out) {
            *out += light.radiosity(DVec3::from_array(*sum));
        }
    }

    fn medium(&self, part: usize) -> Option<&NearKernel> {
        self.media.get(self.surface.domain.parts.parts[part].medium? as usize)
    }

    /// Squared distance below which a sample is not a point, mm^2; may be negative.
    fn below2(&self, patch: &Patch, medium: &NearKernel, radii: f64) -> f64 {
        near_square(radii * patch.radius_mm, medium.medium.smooth_mm())
    }

    fn candidate(
        &self,
        index: u32,
        medium: &NearKernel,
        place: &Sphere,
        light: &SampleLight,
        candidates: &mut Candidates,
    ) {
        let patch = &self.surface.patches[index as usize];
        let three2 = self.below2(patch, medium, self.rule.three_points_below);
        let reach = self.split_mm.max(three2.max(0.0).sqrt()) + place.radius_mm;
        if light.irradiance(index as usize) == DVec3::ZERO
            || patch.centre_mm.distance_squared(place.centre_mm) >= reach * reach
        {
            return;
        }
        let at = (patch.centre_mm - place.centre_mm).as_vec3().to_array();
        candidates.at.iter_mut().zip(at).for_each(|(list, x)| list.push(x));
        candidates.flux.push(light.flux(index as usize, patch).as_vec3().extend(0.0).to_array());
        candidates.three2.push(three2 as f32);
        candidates.exact2.push(self.below2(patch, medium, self.rule.exact_below) as f32);
        candidates.patch.push(index);
    }

    fn receiver(&self, (member, at): (usize, [f32; 3]), medium: &NearKernel, light: &SampleLight, lists: &mut Lists) {
        let Lists { candidates, r2, near_indices, special_indices, whole, flats, sums } = lists;
        let Some(sums) = sums.get_mut(member) else { return };
        let split2 = (self.split_mm * self.split_mm) as f32;
        let (nears, specials) = sort_by_distance(candidates, at, split2, r2, (near_indices, special_indices));
        let (near_indices, special_indices) = (&near_indices[..nears], &special_indices[..specials]);
        whole.clear();
        let mut far = [0.0f32; 3];
        for &candidate in special_indices {
            let i = candidate as usize;
            // What the far field takes for it.
            let [red, green, blue, _] = candidates.flux[i];
            let flux = [red, green, blue];
            let u = r2[i] - split2;
            if u < 0.0 {
                for ((far, flux), [c0, c1, c2]) in far.iter_mut().zip(flux).zip(medium.polynomials) {
                    *far += flux * (c0 + u * (c1 + u * c2));
                }
            } else {
                whole.push(r2[i], flux.map(|f| -f));
            }
            let offset: [f32; 3] = std::array::from_fn(|axis| candidates.at[axis][i] - at[axis]);
            let patch = candidates.patch[i] as usize;
            if let Some(pieces) = light.pieces(patch) {
                let exact = r2[i] < candidates.exact2[i];
                for (deviation, corners) in pieces {
                    let seen = corners.map(|corner| std::array::from_fn(|axis| corner[axis] + offset[axis]));
                    piece(seen, deviation.as_vec3().to_array(), exact, (whole, flats, member as u32));
                }
            }
            let e = light.irradiance(patch).as_vec3().to_array();
            for corners in self.corners.of(self.surface.samples, candidates.patch[i]) {
                let seen = corners.map(|corner| std::array::from_fn(|axis| corner[axis] + offset[axis]));
                if r2[i] < candidates.exact2[i] {
                    flats.push(member as u32, seen, e);
                } else {
                    three_points(seen, e, whole);
                }
            }
        }
        near::add_chosen(self.level, &medium.near, near_indices, (r2, &candidates.flux), sums);
        near::add_points(self.level, &medium.whole, whole, sums);
        sums.iter_mut().zip(far).for_each(|(sum, far)| *sum -= f64::from(far));
    }
}

/// Writes the squared distances of all candidates to a receiver, the indices of those that are points inside the split
/// radius, and of those that need more than a point; returns the numbers of both.
fn sort_by_distance(
    candidates: &Candidates,
    [x, y, z]: [f32; 3],
    split2: f32,
    r2: &mut Vec<f32>,
    (near, special): (&mut Vec<u32>, &mut Vec<u32>),
) -> (usize, usize) {
    let count = candidates.patch.len();
    let [xs, ys, zs] = candidates.at.each_ref().map(|list| &list[..count]);
    r2.clear();
    r2.extend((0..count).map(|i| {
        let (dx, dy, dz) = (xs[i] - x, ys[i] - y, zs[i] - z);
        dx * dx + dy * dy + dz * dz
    }));
    if near.len() < count {
        near.resize(count, 0);
        special.resize(count, 0);
    }
    let (mut nears, mut specials) = (0, 0);
    // Without branches: which way they go is anybody's guess.
    let (near_slots, special_slots) = (&mut near[..count], &mut special[..count]);
    for (i, (&r2, &three2)) in r2.iter().zip(&candidates.three2[..count]).enumerate() {
        near_slots[nears] = i as u32;
        special_slots[specials] = i as u32;
        nears += usize::from((r2 >= three2) & (r2 < split2));
        specials += usize::from(r2 < three2);
    }
    (nears, specials)
}

/// Adds a piece of a sample: exact, or as a point, because it is small where its sample is three points.
fn piece(seen: [[f32; 3]; 3], e: [f32; 3], exact: bool, (whole, flats, receiver): (&mut Points, &mut Flats, u32)) {
    if exact {
        flats.push(receiver, seen, e);
        return;
    }
    let [a, b, c] = seen.map(glam::Vec3::from_array);
    let area = 0.5 * (b - a).cross(c - a).length();
    whole.push(((a + b + c) / 3.0).length_squared(), e.map(|e| e * area));
}

/// Adds the [`THREE_POINTS`] of a triangle.
fn three_points(corners: [[f32; 3]; 3], irradiance: [f32; 3], points: &mut Points) {
    let (towards, weight) = THREE_POINTS;
    let [a, b, c] = corners.map(glam::Vec3::from_array);
    let third = weight * (0.5 * (b - a).cross(c - a).length());
    let centre = (a + b + c) / 3.0;
    for corner in [a, b, c] {
        points.push(centre.lerp(corner, towards).length_squared(), irradiance.map(|e| e * third));
    }
}

/// The far part of R_d of three channels summed over every patch of a receiver's part, RGB: slow, for checks. Parts begin at offsets into
/// the patches; nothing is farther apart than `diagonal_mm`.
pub fn far_all_pairs(
    (patches, part_offsets): (&[Patch], &[u32]),
    dipoles: &[Dipole; 3],
    (split_mm, diagonal_mm): (f64, f64),
    receivers: &Receivers,
    irradiance: &[DVec3],
) -> Vec<DVec3> {
    let far = dipoles.each_ref().map(|dipole| Softened::new(dipole, split_mm));
    let reach = 1.001 * diagonal_mm;
    let smooth = split_mm.max(dipoles.iter().map(|d| d.z_real_mm).fold(f64::MAX, f64::min));
    let far = |c: usize, r2: f64| far[c].reflectance_at_square(&dipoles[c], r2);
    let table = QuadraticTable::new(smooth, reach * reach, far);
    let light = SampleLight::even(irradiance);
    let of_group = |group: &Group| {
        let part = group.part as usize;
        let of_part = part_offsets[part] as usize..part_offsets[part + 1] as usize;
        let mut points = Points::default();
        let mut of_receiver = |receiver: DVec3| {
            points.clear();
            for (sample, patch) in of_part.clone().zip(&patches[of_part.clone()]) {
                let r2 = patch.centre_mm.distance_squared(receiver) as f32;
                points.push(r2, light.flux(sample, patch).as_vec3().to_array());
            }
            let mut sums = [0.0; 3];
            near::add_points(InstructionSet::detect(), &table, &points, &mut sums);
            light.radiosity(DVec3::from_array(sums))
        };
        receivers.positions[group.run.range()].iter().map(|&p| of_receiver(p)).collect::<Vec<_>>()
    };
    receivers.groups.par_iter().flat_map_iter(of_group).collect()
}

#[cfg(test)]
#[path = "near_field_tests.rs"]
mod tests;
