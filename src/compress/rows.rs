//! Sparse quantised rows of Haar coefficients.
