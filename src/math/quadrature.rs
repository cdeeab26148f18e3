//! Gauss-Legendre quadrature and an adaptive integrator for tests and tables.
