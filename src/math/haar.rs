//! The two-dimensional Haar transform of square images and of the faces of a cube map.
