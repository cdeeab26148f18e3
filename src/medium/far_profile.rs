//! The smooth far part of R_d: R_d itself beyond a split radius, an even polynomial inside.
