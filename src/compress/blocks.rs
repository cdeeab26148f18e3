//! Blocks of wavelet coefficients of neighbouring receivers: selection and quantisation.
