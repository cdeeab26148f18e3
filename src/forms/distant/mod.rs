//! Shared by the forms for light from far away: `harmonics` at reference points and `rows` of every vertex.

mod settings;
mod work;

pub use settings::{Basis, Choice, Distant, Integrand, KINDS, MOST_ORDER, Single, Terms};
pub(crate) use work::{TUNING_TURNS, Work, edge_on, far_away, under_suns, with_work};
