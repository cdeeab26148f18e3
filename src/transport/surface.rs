//! The sampled surface of a domain, as the stages of transport see it.

use super::domain::Domain;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{Patch, Samples};

/// A domain with its occluders and the samples of its surface.
#[derive(Clone, Copy)]
pub struct Surface<'a> {
    /// The bodies and their media.
    pub domain: Domain<'a>,
    /// Occluders: all triangles, whatever their part.
    pub bvh: &'a Bvh,
    /// The partition into patches.
    pub samples: &'a Samples,
    /// Geometry of each patch.
    pub patches: &'a [Patch],
}
