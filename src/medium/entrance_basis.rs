//! F_t(eta, mu) mu expanded in a few functions of the cosine over the allowed eta.
