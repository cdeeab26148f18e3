//! A volumetric random walk: the exitance that the dipole only approximates.
//!
//! Photons enter a homogeneous medium through its boundary, scatter (Henyey and Greenstein) after free paths of mean
//! 1/sigma_t (unreduced), lose weight by absorption, are reflected at the smooth boundary by exact Fresnel, and leave.
//! Their weights are tallied where they leave, split by the number of scattering events.
//!
//! As in the other methods, irradiance behind the surface includes F_t at the entrance, light that has left does not enter
//! again, neither its own part nor another, and shadows are those of the whole scene. Other than the dipole, which is a half
//! space's answer to multiple scattering, the walk knows the shape, the direction of entrance and every order. Parts joined
//! across air are walked one by one: no light crosses the air.
//!
//! # Speed
//!
//! Million collisions for a second of one core (AMD EPYC, marble at g = 0 and 0.8, entrances and rays included): half space
//! 71 and 43, ball of 15 mm 51 and 39, closed bunny of 30 mm (70k triangles) 5 to 7 and 13. A photon in the bunny scatters 40
//! times (200) before it leaves: most of the cost there is flights near the surface, whose rays and look-ups in the
//! grid of free space take three quarters of the time. 20 was aimed at for meshes and is not reached. Attempts and
//! their speed-ups:
//!
//! - free space around both ends of a flight in place of its start alone: 1.3, kept;
//! - photons that follow each other start beside each other, along a space-filling curve: 1.05 to 1.18, kept;
//! - for each cell a plane below all of the surface in reach and a cone around its normals, which decide all but 18 (5) rays for
//!   100 collisions in place of 29 (18): 1.0 (1.09), for twice the time to prepare, and right only where a surface does not
//!   cross itself;
//! - eight photons in turn with their look-ups fetched ahead: 1.0 to 1.1;
//! - a grid of 8 and 40 times fewer cells, its cells in bricks of a cache line: nothing.

pub mod boundary;
mod clearance;
pub mod entry;
pub mod exitance;
pub mod model_error;
pub mod tally;
pub mod walk;

#[cfg(test)]
mod tests;
