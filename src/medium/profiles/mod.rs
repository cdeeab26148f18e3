//! Diffuse reflectance profiles beside the classical dipole, and the choice among them.
//!
//! Every profile is R_d(r) of one channel in 1/mm^2, exitance over the flux that has entered. The models from sigma's
//! hold light scattered more than once, for which single scattering is a separate term; the classical dipole's total is that of all
//! orders, and [`LaterDipole`](super::dipole::LaterDipole) that of those from the second on.
//!
//! | profile | from | tail | triangle |
//! | --- | --- | --- | --- |
//! | [`better_dipole`] | sigma's | closed | edges by adaptive quadrature |
//! | [`photon_beam`] | sigma's | table | likewise |
//! | [`burley`] | albedo and a free path | closed | likewise |
//! | [`gaussians`] | weights and variances | closed | likewise |
//! | [`layers`] | slabs over a half space | table | likewise |
//! | [`measured`] | samples of R | closed | likewise |

pub mod better_dipole;
pub(super) mod boundary;
pub mod burley;
mod complex;
mod csv;
pub mod gaussians;
pub mod layer_file;
pub mod layers;
pub mod measured;
pub mod model;
pub mod photon_beam;
pub mod tabulated;

#[cfg(test)]
mod tests;
