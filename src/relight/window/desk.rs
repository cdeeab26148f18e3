//! The state of the window that the user changes, and the messages about it: plain data, no device.

mod media;

use std::path::PathBuf;

use glam::DVec3;

use super::editing::{Editing, ProfileInForce};
use crate::error::Result;
use crate::evaluate::MaterialEdit;
use crate::light::Light;
use crate::light::environment::EnvironmentMap;
use crate::medium::material::Medium;
use crate::medium::profiles::model::ProfileModel;
use crate::relight::lights::{AdjustedLight, pivot_mm};
use crate::relight::orbit::Orbit;
use crate::relight::raster::view::{Look, View};
use crate::render::background::Background;
use crate::render::blinn_phong::{DEFAULT_EXPONENT, Exponent};
use crate::render::camera::{Camera, Resolution};
use crate::render::film::{Exposure, MAX_STOPS};
use crate::render::frame::Specular;
use crate::render::highlight::HighlightShape;
use crate::render::specular::{DEFAULT_ROUGHNESS, Roughness};
use crate::scene::Scene;

/// Speed of turning lights, in degrees per second.
const TURN_DEGREES_PER_SECOND: f64 = 30.0;
/// Time constant of automatic exposure, s.
const ADAPTATION_S: f64 = 0.3;

/// The known error of the transport.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct KnownError {
    /// Serial number of the state.
    pub(super) serial: u64,
    /// Relative RMS and worst vertex.
    pub(super) rms: f64,
    pub(super) worst: f64,
    /// End of the colour scale: 99 % of the vertices are below.
    pub(super) scale: f64,
}

/// A message for the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message {
    pub(super) text: String,
    pub(super) bad: bool,
}

/// The user's requests in this frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Asked {
    pub(super) save_png: bool,
    pub(super) save_render: bool,
    pub(super) measure_error: bool,
    /// The profile to put in force.
    pub(super) profile: Option<ProfileModel>,
}

/// The state of the window.
pub(super) struct Desk {
    pub(super) model: PathBuf,
    pub(super) entries: Vec<AdjustedLight>,
    pub(super) selected: usize,
    pub(super) pivot_mm: DVec3,
    pub(super) turn_degrees: f64,
    pub(super) turning: bool,
    /// The media as set by the sliders.
    pub(super) media: Vec<Medium>,
    /// The media in force.
    pub(super) accepted: Vec<Medium>,
    pub(super) material: MaterialEdit,
    pub(super) refused: Option<String>,
    pub(super) editing: Editing,
    pub(super) profile: ProfileInForce,
    pub(super) auto_exposure: bool,
    pub(super) stops: f64,
    white: Option<f64>,
    white_wanted: Option<f64>,
    pub(super) reflects: bool,
    /// Shape of the highlights, and the width of each.
    pub(super) highlights: HighlightShape,
    pub(super) roughness: f64,
    pub(super) exponent: f64,
    /// Whether there is a texture, and whether it is shown.
    pub(super) has_texture: bool,
    pub(super) textured: bool,
    pub(super) background: Background,
    pub(super) look: Look,
    pub(super) wires: bool,
    pub(super) orbit: Orbit,
    pub(super) panel_open: bool,
    pub(super) message: Option<Message>,
    pub(super) error: Option<KnownError>,
    /// Serial number of the state of lights and media.
    pub(super) serial: u64,
}

impl Desk {
    pub(super) fn new(
        model: PathBuf,
        scene: &Scene,
        material: MaterialEdit,
        profile: ProfileInForce,
        lights: Vec<Light>,
        camera: &Camera,
    ) -> Self {
        let pivot_mm = pivot_mm(&scene.mesh);
        let media = profile.plain(&scene.media);
        Self {
            model,
            entries: lights.into_iter().map(|l| AdjustedLight::new(l, pivot_mm)).collect(),
            selected: 0,
            pivot_mm,
            turn_degrees: 0.0,
            turning: false,
            accepted: media.clone(),
            media,
            material,
            refused: None,
            editing: Editing::default(),
            profile,
            auto_exposure: true,
            stops: 0.0,
            white: None,
            white_wanted: None,
            reflects: true,
            highlights: HighlightShape::default(),
            roughness: DEFAULT_ROUGHNESS,
            exponent: DEFAULT_EXPONENT,
            has_texture: false,
            textured: true,
            background: Background::Environment,
            look: Look::Picture,
            wires: false,
            orbit: Orbit::of(camera),
            panel_open: true,
            message: None,
            error: None,
            serial: 1,
        }
    }

    /// Replaces the model; lights and settings stay.
    pub(super) fn replace_model(
        &mut self,
        model: PathBuf,
        scene: &Scene,
        material: MaterialEdit,
        profile: ProfileInForce,
        camera: &Camera,
    ) {
        let pivot = pivot_mm(&scene.mesh);
        for entry in &mut self.entries {
            *entry = AdjustedLight { on: entry.on, ..AdjustedLight::new(entry.light(0.0, self.pivot_mm), pivot) };
        }
        self.model = model;
        self.pivot_mm = pivot;
        self.media = scene.media.clone();
        self.accepted = scene.media.clone();
        self.material = material;
        self.refused = None;
        self.editing = Editing::default();
        self.profile = profile;
        self.error = None;
        self.orbit = Orbit::of(camera);
        self.white = None;
        self.serial += 1;
    }

    /// Replaces the first environment, or all lights at infinity where there is none.
    pub(super) fn replace_environment(&mut self, map: std::sync::Arc<EnvironmentMap>) {
        let light = Light::Environment { map, rotate_degrees: 0.0, scale: DVec3::ONE };
        let entry = AdjustedLight::new(light, self.pivot_mm);
        match self.entries.iter_mut().find(|e| matches!(e.base, Light::Environment { .. })) {
            Some(place) => *place = entry,
            None => self.entries.push(entry),
        }
        self.serial += 1;
    }

    pub(super) fn lights(&self) -> Vec<Light> {
        let shining = self.entries.iter().filter(|entry| entry.on);
        shining.map(|entry| entry.light(self.turn_degrees, self.pivot_mm)).collect()
    }

    /// Advances time; returns whether the lights turned.
    pub(super) fn pass(&mut self, seconds: f64) -> bool {
        if let Some(wanted) = self.white_wanted {
            let share = 1.0 - (-seconds / ADAPTATION_S).exp();
            let next = self.white.map_or(wanted, |white| white * (wanted / white).powf(share));
            self.white = Some(if next.is_finite() && next > 0.0 { next } else { wanted });
        }
        if self.turning {
            self.turn_degrees = (self.turn_degrees + TURN_DEGREES_PER_SECOND * seconds).rem_euclid(360.0);
            self.serial += 1;
        }
        self.turning
    }

    /// Sets the radiance that automatic exposure makes white: at once the first time, then gradually.
    pub(super) fn adapt(&mut self, white: f64) {
        self.white_wanted = Some(white);
        self.white.get_or_insert(white);
    }

    /// Returns whether the exposure still changes.
    pub(super) fn is_adapting(&self) -> bool {
        match (self.auto_exposure, self.white, self.white_wanted) {
            (true, Some(white), Some(wanted)) => (white / wanted).log2().abs() > 0.01,
            _ => false,
        }
    }

    /// Exposure factor on radiance.
    pub(super) fn exposure_factor(&self) -> f64 {
        let stops = self.stops.clamp(-MAX_STOPS, MAX_STOPS).exp2();
        if self.auto_exposure { self.white.map_or(1.0, f64::recip) } else { stops }
    }

    pub(super) fn set_exposure(&mut self, exposure: Exposure) {
        match exposure {
            Exposure::Auto => self.auto_exposure = true,
            Exposure::Stops(stops) => (self.auto_exposure, self.stops) = (false, stops),
        }
    }

    pub(super) fn specular(&self) -> Specular {
        match self.highlights {
            _ if !self.reflects => Specular::Off,
            HighlightShape::Ggx => Specular::Rough(Roughness::new(self.roughness).unwrap_or_default()),
            HighlightShape::BlinnPhong => Specular::BlinnPhong(Exponent::new(self.exponent).unwrap_or_default()),
        }
    }

    /// Whether there is a texture and it is shown.
    pub(super) fn shows_texture(&self) -> bool {
        self.has_texture && self.textured
    }

    pub(super) fn set_specular(&mut self, specular: Specular) {
        self.reflects = specular != Specular::Off;
        match specular {
            Specular::Off => {}
            Specular::Rough(roughness) => (self.highlights, self.roughness) = (HighlightShape::Ggx, roughness.value()),
            Specular::BlinnPhong(exponent) => {
                (self.highlights, self.exponent) = (HighlightShape::BlinnPhong, exponent.value());
            }
        }
    }

    /// The view of a frame from a camera.
    pub(super) fn view(&self, camera: Camera, resolution: Resolution) -> View {
        View {
            specular: self.specular(),
            look: self.look,
            background: self.background,
            textured: self.shows_texture(),
            wires: self.wires,
            worst_error: self.error.map(|e| e.scale),
            ..View::new(camera, resolution, self.exposure_factor())
        }
    }

    /// Turns the selected light by hand.
    pub(super) fn turn_selected(&mut self, azimuth_degrees: f64, elevation_degrees: f64) {
        if let Some(entry) = self.entries.get_mut(self.selected) {
            entry.turn(azimuth_degrees, elevation_degrees);
            self.serial += 1;
        }
    }

    /// Makes the selected light brighter.
    pub(super) fn brighten_selected(&mut self, stops: f64) {
        let most = crate::relight::lights::MAX_STOPS;
        if let Some(entry) = self.entries.get_mut(self.selected) {
            entry.stops = (entry.stops + stops).clamp(-most, most);
            self.serial += 1;
        }
    }

    pub(super) fn say(&mut self, text: impl Into<String>) {
        self.message = Some(Message { text: text.into(), bad: false });
    }

    /// Complains of what failed.
    pub(super) fn expect(&mut self, result: Result<()>) {
        if let Err(error) = result {
            self.complain(error.message());
        }
    }

    pub(super) fn complain(&mut self, text: impl Into<String>) {
        self.message = Some(Message { text: text.into(), bad: true });
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::mesh::{Mesh, Placement};
    use crate::geometry::part_table::PartTable;
    use crate::geometry::shapes;
    use crate::light::sky::sky;
    use crate::medium::material::preset;

    pub(in crate::relight::window) fn desk() -> Desk {
        let (mesh, _) = Mesh::from_source(shapes::icosphere(10.0, 2), &Placement { mm_per_unit: 1.0 }).unwrap();
        let camera = Camera::framing(&mesh, Resolution::new(4, 4).unwrap()).unwrap();
        let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("ball".into(), Some(0))]);
        let media = vec![Medium { name: "marble".into(), properties: preset("marble").unwrap().properties() }];
        let scene = Scene { mesh, parts, media };
        let lights = vec![Light::directional(DVec3::Z, DVec3::ONE).unwrap(), Light::constant(DVec3::ONE).unwrap()];
        let profile = ProfileInForce::dipole(None);
        Desk::new("ball.tlux".into(), &scene, MaterialEdit::Any, profile, lights, &camera)
    }

    #[test]
    fn time_turns_the_lights_and_adapts_the_eye() {
        let mut desk = desk();
        assert!(!desk.pass(1.0));
        desk.turning = true;
        let serial = desk.serial;
        assert!(desk.pass(3.0) && desk.serial > serial);
        let lights = desk.lights();
        let Light::Directional { from, .. } = lights[0] else { panic!("kind") };
        assert!((from - DVec3::X).length() < 1e-12);
        desk.entries[0].on = false;
        assert_eq!(desk.lights(), lights[1..]);
        desk.adapt(4.0);
        assert_eq!(desk.exposure_factor(), 0.25);
        desk.adapt(1.0);
        desk.pass(0.1);
        assert!((0.25..1.0).contains(&desk.exposure_factor()) && desk.is_adapting());
        (0..200).for_each(|_| {
            desk.pass(0.1);
        });
        assert!((desk.exposure_factor() - 1.0).abs() < 1e-3 && !desk.is_adapting());
        desk.set_exposure(Exposure::Stops(2.0));
        assert_eq!(desk.exposure_factor(), 4.0);
    }

    #[test]
    fn a_dropped_environment_replaces_the_one_before() {
        let mut desk = desk();
        desk.replace_environment(Arc::new(sky()));
        assert_eq!(desk.entries.len(), 3);
        desk.replace_environment(Arc::new(sky()));
        assert_eq!(desk.entries.len(), 3);
        assert!(matches!(desk.lights()[2], Light::Environment { .. }));
        desk.brighten_selected(50.0);
        assert_eq!(desk.entries[0].stops, crate::relight::lights::MAX_STOPS);
    }
}
