//! Linear algebra, quadrature, counter-based random numbers, directions and statistics.

pub(crate) mod cholesky;
pub mod cube_map;
pub mod eigen;
pub mod haar;
pub mod leading;
pub mod machine;
pub mod nnls;
pub mod quadrature;
pub mod random;
pub mod sh;
pub mod simd;
pub(crate) mod slices;
pub mod sparse;
pub mod sphere;
pub mod spherical_rectangle;
pub mod srgb;
pub mod statistics;
pub mod svd;
