//! Where an asset is wrong: a map of its error over the vertices, and the error at one place by stage.
//!
//! Errors are those of the radiosity against exact sums of more samples ([`exact`](self)), under lights of the half that choices may look at; the
//! other half stays unseen, so that it can tell whether the map is right.

mod between;
mod blame;
mod exact;
mod map;
#[cfg(test)]
mod tests;
mod thickness;

pub use self::blame::{Blame, Place, StageError, blame};
pub use self::exact::Subject;
pub(super) use self::exact::bounces;
pub use self::map::{Stages, Sums, Trust, VertexTrust, trust};
