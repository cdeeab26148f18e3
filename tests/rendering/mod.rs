//! What tests of pictures share: a scene whose radiosity the test says, cameras, settings.
#![allow(clippy::unwrap_used, missing_docs, dead_code, unreachable_pub)]

use glam::DVec3;

use translux::compress::ledger::Ledger;
use translux::error::Result;
use translux::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit, SourceFields};
use translux::geometry::bvh::Bvh;
use translux::geometry::mesh::{Mesh, Placement};
use translux::geometry::part_table::PartTable;
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::medium::material::{Medium, preset};
use translux::progress::{Progress, Silent};
use translux::render::background::Background;
use translux::render::camera::{Camera, Resolution};
use translux::render::frame::{Frame, RenderSettings, render};
use translux::scene::Scene;

/// An evaluator that carries a scene and computes nothing: the tests say what the radiosity is.
pub struct Fake {
    pub scene: Scene,
    pub bvh: Bvh,
}

impl Fake {
    /// Every triangle in one marble part.
    pub fn new(source: SourceModel) -> Self {
        Self::with_parts(source, |_| Some(0))
    }

    /// One part for each material of the source; `medium` of its index.
    pub fn with_parts(source: SourceModel, medium: impl Fn(usize) -> Option<u32>) -> Self {
        let (mesh, _) = Mesh::from_source(source, &Placement { mm_per_unit: 1.0 }).unwrap();
        let names = mesh.materials.iter().enumerate().map(|(i, name)| (name.clone(), medium(i))).collect();
        let parts = PartTable::new(&mesh, mesh.triangle_material.clone(), names);
        let marble = Medium { name: "marble".to_owned(), properties: preset("marble").unwrap().properties() };
        let bvh = Bvh::new(&mesh);
        Self { scene: Scene { mesh, parts, media: vec![marble] }, bvh }
    }

    pub fn radiosity_by(&self, b: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
        (0..self.scene.mesh.local_mm.len() as u32).map(|v| b(self.scene.mesh.position_mm(v))).collect()
    }

    pub fn uniform(&self) -> Vec<DVec3> {
        self.radiosity_by(|_| DVec3::ONE)
    }

    pub fn render(&self, radiosity: &[DVec3], settings: &RenderSettings) -> Frame {
        render(self, &radiosity.to_vec(), &[], settings, &Silent).unwrap()
    }

    pub fn default_camera(&self, resolution: Resolution) -> Camera {
        Camera::framing(&self.scene.mesh, resolution).unwrap()
    }
}

impl Evaluator for Fake {
    fn capabilities(&self) -> Capabilities {
        Capabilities { material: MaterialEdit::None, profile: ProfileEdit::None, source_fields: SourceFields::None }
    }
    fn cost(&self) -> Cost {
        Cost::default()
    }
    fn scene(&self) -> &Scene {
        &self.scene
    }
    fn bvh(&self) -> &Bvh {
        &self.bvh
    }
    fn set_lights(&mut self, _lights: Vec<Light>, _progress: &dyn Progress) -> Result<()> {
        Ok(())
    }
    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.scene.media = media;
        Ok(())
    }
    fn radiosity(&mut self, _progress: &dyn Progress) -> Result<Vec<DVec3>> {
        Ok(self.uniform())
    }
    fn measured_error(&mut self, _unseen: &[Light], _progress: &dyn Progress) -> Result<Ledger> {
        Ok(Ledger::default())
    }
    fn all_pairs(&mut self, _progress: &dyn Progress) -> Result<Vec<DVec3>> {
        Ok(self.uniform())
    }
}

pub fn size(width: usize, height: usize) -> Resolution {
    Resolution::new(width, height).unwrap()
}

pub fn camera(at: [f64; 3], fov: f64) -> Camera {
    let up = if at[1].abs() > 1e3 * at[0].abs().max(at[2].abs()) { DVec3::Z } else { DVec3::Y };
    Camera::new(DVec3::from(at), DVec3::ZERO, up, fov).unwrap()
}

pub fn settings(camera: Camera, resolution: Resolution) -> RenderSettings {
    RenderSettings { background: Background::None, ..RenderSettings::new(camera, resolution) }
}
