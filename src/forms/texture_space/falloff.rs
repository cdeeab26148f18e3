//! How fast the error of a point in a node's place falls with its distance, for the kernel of each medium.

use crate::scene::Scene;
use crate::transport::kernel::medium::MediumKernel;

/// Share of what even light brings to a place that one point may; weights have three channels of about 1.
const MOST_OF_A_POINT: f64 = 0.1 * 3.0;

/// Bits of a mantissa within a segment of a [`Falloff`].
pub(super) const SHIFT: u32 = 23 - 6;

/// Length on which a [`Falloff`] begins to change, over its reach, at least.
const LEAST_SCALE: f64 = 1e-6;

/// R_d of the channel where it is largest, in a table: the error of a point in a node's place is about in proportion to it and to the second moment
/// of the node's flux. (Bounds on the derivatives of R_d, and points in pairs, were tried: they choose worse samples where the material is dense, and hardly
/// better ones elsewhere.)
///
/// Segments are even in the logarithm of the distance plus the length on which R_d is smooth; each has its largest value. In single precision, and
/// indexed by bits of a number, so that shaders find the same.
pub(super) struct Falloff {
    /// Values, 1/mm^2.
    pub(super) values: Vec<f32>,
    /// Length that is added to the distance, mm.
    pub(super) smooth_mm: f32,
    /// Upper bits of that length, which are those of the first segment.
    pub(super) first: u32,
    /// Largest weight times R_d of a point, however few samples are asked for: one that brings more than this to a place is a bright spot there.
    pub(super) most: f32,
}

impl Falloff {
    /// The table of a kernel, over an object whose points are at most `reach_mm` apart.
    fn new(kernel: &MediumKernel, reach_mm: f64) -> Self {
        let reach = reach_mm.clamp(1e-30, 1e30);
        let first = (kernel.smooth_mm().clamp(LEAST_SCALE * reach, reach) as f32).to_bits() >> SHIFT;
        let smooth_mm = f32::from_bits(first << SHIFT);
        let last = (reach as f32 + smooth_mm).to_bits() >> SHIFT;
        let at = |segment: u32| {
            let r = f64::from(f32::from_bits(segment << SHIFT)) - f64::from(smooth_mm);
            let largest = kernel.profiles().iter().map(|profile| profile.reflectance(r)).fold(0.0, f64::max);
            largest.min(1e30) as f32
        };
        let most = (MOST_OF_A_POINT * kernel.total().max_element()) as f32;
        Self { values: (first..=last).map(at).collect(), smooth_mm, first, most }
    }

    /// The value at a distance, mm, at least 0.
    #[inline(always)]
    pub(super) fn at(&self, distance_mm: f32) -> f32 {
        let segment = ((distance_mm + self.smooth_mm).to_bits() >> SHIFT) - self.first;
        // What is farther has the last value.
        self.values.get(segment as usize).or(self.values.last()).copied().unwrap_or(0.0)
    }
}

/// Kernels of the media, with what walks need of them.
pub(super) struct Kernels {
    media: Vec<(MediumKernel, Falloff)>,
}

impl Kernels {
    /// Kernels over an object whose points are at most `reach_mm` apart.
    pub(super) fn new(kernels: Vec<MediumKernel>, reach_mm: f64) -> Self {
        let with = |kernel: MediumKernel| {
            let falloff = Falloff::new(&kernel, reach_mm);
            (kernel, falloff)
        };
        Self { media: kernels.into_iter().map(with).collect() }
    }

    /// The kernel of a part; none of opaque ones.
    pub(super) fn of_part(&self, scene: &Scene, part: u32) -> Option<&MediumKernel> {
        self.at(scene, part).map(|(kernel, _)| kernel)
    }

    /// The kernel of a part and its falloff.
    pub(super) fn at(&self, scene: &Scene, part: u32) -> Option<&(MediumKernel, Falloff)> {
        let medium = scene.parts.parts.get(part as usize)?.medium?;
        self.media.get(medium as usize)
    }

    /// The kernels, medium by medium.
    #[cfg(feature = "gpu")]
    pub(super) fn media(&self) -> &[(MediumKernel, Falloff)] {
        &self.media
    }

    /// The least length on which a kernel changes, mm.
    pub(super) fn smooth_mm(&self) -> f64 {
        self.media.iter().map(|(kernel, _)| kernel.smooth_mm()).fold(f64::INFINITY, f64::min)
    }
}
