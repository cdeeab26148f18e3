//! Irradiance rows over a cube map: sparse, quantised Haar coefficients of every sample.
