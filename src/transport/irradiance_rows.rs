//! Irradiance of every sample as a function of an environment cube map: the rows E(x_i, w).
