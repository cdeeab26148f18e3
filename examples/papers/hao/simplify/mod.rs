//! Simplification of a mesh to a subset of its vertices, and the place of every vertex on what is left.
//!
//! Vertices are removed one by one, each collapsed onto a neighbour that stays (half-edge collapse), in the order of
//! the quadric error of Garland and Heckbert 1997 ("Surface simplification using quadric error metrics"), to which
//! terms for even spacing and for the prediction error of a signal on the vertices can be added. What remains are the
//! reference points of Hao and Varshney 2004, section 4.2; every vertex between them is a weighted sum of three.
//!
//! All arithmetic is addition, multiplication, division and square roots in one fixed order: the same mesh gives the
//! same hierarchy to the bit on every machine, so that it can be recomputed instead of stored.

mod anchor;
mod collapse;
mod complex;
mod groups;
mod input;
mod quadric;

pub(crate) use anchor::{Anchor, Level};
pub(crate) use collapse::Hierarchy;
pub(crate) use input::{Costs, Input, Signal};

#[cfg(test)]
mod tests;
