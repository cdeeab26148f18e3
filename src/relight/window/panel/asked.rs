//! Requests of the panel to the window.

use egui::Color32;

use crate::medium::profiles::model::ProfileModel;

pub(super) const BAD: Color32 = Color32::from_rgb(240, 120, 100);

/// The user's requests in this frame.
#[derive(Clone, Debug, Default)]
pub(in crate::relight::window) struct Asked {
    pub(in crate::relight::window) save_png: bool,
    pub(in crate::relight::window) save_render: bool,
    pub(in crate::relight::window) measure_error: bool,
    /// The profile to put in force.
    pub(in crate::relight::window) profile: Option<ProfileModel>,
}
