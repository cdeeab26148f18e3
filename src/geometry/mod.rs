//! Meshes, parts, mesh checks, generated shapes, ray casting, surface samples and their tree, texture atlases.

pub mod atlas;
pub mod ball;
mod boxes;
mod buckets;
pub mod bvh;
pub mod check;
pub mod cluster;
pub mod deformation;
pub mod edge_split;
pub mod laplacian;
pub mod mesh;
pub mod nearest;
pub mod part_table;
pub mod parts;
pub mod refinement;
pub mod samples;
pub mod scattered;
pub mod shapes;
pub mod source;
#[cfg(test)]
pub(crate) mod test_data;
