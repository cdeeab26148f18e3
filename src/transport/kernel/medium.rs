//! The kernel of a medium: its profiles in double precision, and their fast evaluation in single precision.

use std::sync::Arc;

use glam::DVec3;

use super::closed_form::PolesRgb;
use super::double_layer::DoubleLayer;
use super::near::{Flats, flats_body};
#[cfg(feature = "gpu")]
use super::radial_table::LinearTable;
use super::radial_table::{ProfileTable, WIDEST};
use super::{Block, FlatSource, PointSource, points_body, triangles_body};
use crate::error::Result;
use crate::math::simd::{InstructionSet, multiversion};
use crate::medium::dipole::{Dipole, Pole};
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::Medium;
use crate::medium::profile::{Orders, Profile};
use crate::medium::profiles::model::LoadedProfile;
use crate::medium::softened::Softened;

/// Kernels, and which of them each part has.
pub type KernelsOfParts = (Vec<MediumKernel>, Vec<Option<u32>>);

/// Profiles R_d of the three channels of one medium, 1/mm^2.
#[derive(Clone)]
pub struct MediumKernel {
    profiles: [Arc<dyn Profile>; 3],
    fast: Fast,
    /// The decay of each channel far away, 1/mm.
    sigma_per_mm: [f64; 3],
    /// Length on whose scale the profiles are smooth, mm: for dipoles, the depth of the shallowest source.
    smooth_mm: f64,
}

/// Evaluation of profiles in single precision. Tables of the dipole would be as fast for points, but 5e-4 off where the
/// closed form is 2e-7 off, and slower for triangles: `cargo bench --bench transfer`.
#[derive(Clone)]
#[expect(clippy::large_enum_variant, reason = "there is one for each medium, and inner loops read it in place")]
enum Fast {
    /// Dipoles, in closed form.
    Poles { poles: [[Pole; 2]; 3], rgb: PolesRgb },
    /// Any profile, by a table.
    Table(Arc<ProfileTable>),
    /// A single and a double layer, by tables.
    Layers(Arc<DoubleLayer>),
}

/// A kernel by tables, for shaders.
#[cfg(feature = "gpu")]
pub(crate) struct Tabulated {
    /// The single layer, 1/mm^2.
    pub(crate) single: LinearTable,
    /// Its tail, `Int_r^inf value(s) s ds`.
    pub(crate) tail: LinearTable,
    /// Where there is a double layer: that over the single one, 1/mm, the double one itself, 1/mm^3, and its tail.
    pub(crate) double: Option<[LinearTable; 3]>,
    /// The scale on which the single layer is smooth, mm.
    pub(crate) smooth_mm: f64,
}

impl MediumKernel {
    /// The kernel by tables; dipoles over an object whose points are at most `reach_mm` apart.
    #[cfg(feature = "gpu")]
    pub(crate) fn by_tables(&self, reach_mm: f64) -> Tabulated {
        let of = |table: &ProfileTable, double: Option<[&LinearTable; 3]>| Tabulated {
            single: table.reflectance.clone(),
            tail: table.tail.clone(),
            double: double.map(|tables| tables.map(LinearTable::clone)),
            smooth_mm: table.smooth_mm,
        };
        match &self.fast {
            Fast::Poles { .. } => of(&ProfileTable::new(&self.profiles, reach_mm), None),
            Fast::Table(table) => of(table, None),
            Fast::Layers(layers) => of(layers.single(), Some(layers.tables())),
        }
    }

    /// The kernel of a medium's dipoles.
    pub fn new(medium: &Medium) -> Self {
        Self::of_dipoles(medium.properties.dipoles(BoundaryFit::Published))
    }

    /// The kernels of some media's dipoles, of some orders of scattering, over an object whose points are at most `reach_mm` apart.
    pub fn of_orders(media: &[Medium], orders: Orders, reach_mm: f64) -> Vec<Self> {
        let later = |medium: &Medium| {
            let dipoles = medium.properties.dipoles(BoundaryFit::Published);
            Self::of_profiles(dipoles.map(|dipole| Arc::new(dipole.after_first()) as Arc<dyn Profile>), reach_mm)
        };
        match orders {
            Orders::FromOne => Self::of_media(media),
            Orders::FromTwo => media.iter().map(later).collect(),
        }
    }

    /// The kernels of some media's dipoles.
    pub fn of_media(media: &[Medium]) -> Vec<Self> {
        media.iter().map(Self::new).collect()
    }

    /// The kernel of three dipoles, one for each channel.
    pub fn of_dipoles(dipoles: [Dipole; 3]) -> Self {
        let poles = dipoles.map(|p| p.poles());
        let smooth_mm = poles.iter().flatten().map(|p| p.z_mm).fold(f64::MAX, f64::min);
        Self {
            fast: Fast::Poles { poles, rgb: PolesRgb::new(&poles, smooth_mm) },
            sigma_per_mm: poles.map(|p| p[0].sigma_per_mm),
            profiles: dipoles.map(|p| Arc::new(p) as Arc<dyn Profile>),
            smooth_mm,
        }
    }

    /// The kernel of a medium with other profiles, over an object whose points are at most `reach_mm` apart.
    ///
    /// # Errors
    /// As [`LoadedProfile::channels`].
    pub fn with_profile(medium: &Medium, profile: &LoadedProfile, reach_mm: f64) -> Result<Self> {
        Ok(Self::of_profiles(profile.channels(&medium.properties)?.map(Arc::from), reach_mm))
    }

    /// The kernel of any profiles, taken as zero beyond a reach, mm.
    pub fn of_profiles(profiles: [Arc<dyn Profile>; 3], reach_mm: f64) -> Self {
        let table = ProfileTable::new(&profiles, reach_mm);
        Self {
            sigma_per_mm: profiles.each_ref().map(|p| decay_per_mm(p.as_ref(), reach_mm)),
            smooth_mm: table.smooth_mm,
            fast: Fast::Table(Arc::new(table)),
            profiles,
        }
    }

    /// The kernel of single layers, 1/mm^2, with double ones beside them, 1/mm^3, which heights multiply and which vary on
    /// the scale of a length, mm; over an object whose points are at most `reach_mm` apart.
    pub fn of_layers(single: [Arc<dyn Profile>; 3], double: ([Arc<dyn Profile>; 3], f64), reach_mm: f64) -> Self {
        let layers = DoubleLayer::new(&single, ProfileTable::new(&single, reach_mm), double);
        Self {
            sigma_per_mm: single.each_ref().map(|p| decay_per_mm(p.as_ref(), reach_mm)),
            smooth_mm: layers.smooth_mm(),
            fast: Fast::Layers(Arc::new(layers)),
            profiles: single,
        }
    }

    /// The layers, where there is a double one: it needs the moments of sources.
    pub fn layers(&self) -> Option<&DoubleLayer> {
        match &self.fast {
            Fast::Layers(layers) => Some(layers),
            _ => None,
        }
    }

    /// The same without a double layer.
    #[must_use]
    pub fn single_layer(&self) -> Self {
        match &self.fast {
            Fast::Layers(layers) => Self { fast: Fast::Table(Arc::new(layers.single().clone())), ..self.clone() },
            Fast::Poles { .. } | Fast::Table(_) => self.clone(),
        }
    }

    /// The profiles of the three channels.
    pub fn profiles(&self) -> &[Arc<dyn Profile>; 3] {
        &self.profiles
    }

    /// The profiles without their peaks inside a radius, mm.
    pub fn softened(&self, radius_mm: f64) -> [Softened; 3] {
        self.profiles.each_ref().map(|p| Softened::new(p.as_ref(), radius_mm))
    }

    /// The poles of the dipoles; none where the profiles are others.
    pub fn poles(&self) -> Option<&[[Pole; 2]; 3]> {
        match &self.fast {
            Fast::Poles { poles, .. } => Some(poles),
            Fast::Table(_) | Fast::Layers(_) => None,
        }
    }

    /// The decay of each channel far away, 1/mm.
    pub fn sigma_per_mm(&self) -> [f64; 3] {
        self.sigma_per_mm
    }

    /// Length on whose scale the profiles are smooth, mm.
    pub fn smooth_mm(&self) -> f64 {
        self.smooth_mm
    }

    /// Total diffuse reflectance, RGB.
    pub fn total(&self) -> DVec3 {
        DVec3::from_array(self.profiles.each_ref().map(|p| p.total()))
    }

    /// Adds `flux R_d(|x - at|)` of every source to every receiver of the block; of layers, the single one.
    pub fn add_points(&self, level: InstructionSet, block: &mut Block, sources: &[PointSource]) {
        match &self.fast {
            Fast::Poles { rgb, .. } => points_of_poles(level, block, rgb, sources),
            Fast::Table(table) => table.reflectance.add_points(level, block, sources),
            Fast::Layers(layers) => layers.single().reflectance.add_points(level, block, sources),
        }
    }

    /// Adds `irradiance Int R_d(|x - y|) dA(y)` over every flat triangle to every receiver of the block.
    pub fn add_triangles(&self, level: InstructionSet, block: &mut Block, sources: &[FlatSource]) {
        match &self.fast {
            Fast::Poles { rgb, .. } => triangles_of_poles(level, block, rgb, sources),
            Fast::Table(table) => triangles_of_table(level, block, table, sources),
            Fast::Layers(layers) => triangles_of_table(level, block, layers.single(), sources),
        }
    }

    /// Adds `irradiance Int R_d dA` of every flat triangle to the sum of its receiver.
    pub fn add_flats(&self, level: InstructionSet, flats: &Flats, sums: &mut [[f64; 3]]) {
        match &self.fast {
            Fast::Poles { rgb, .. } => flats_of_poles(level, rgb, flats, sums),
            Fast::Table(table) => flats_of_table(level, table, flats, sums),
            Fast::Layers(layers) => flats_of_table(level, layers.single(), flats, sums),
        }
    }
}

multiversion! {
    fn points_of_poles(block: &mut Block, kernel: &PolesRgb, sources: &[PointSource]) => points_body::<PolesRgb>;
    fn triangles_of_poles(block: &mut Block, kernel: &PolesRgb, sources: &[FlatSource]) => triangles_body::<PolesRgb>;
    fn triangles_of_table(block: &mut Block, kernel: &ProfileTable, sources: &[FlatSource])
        => triangles_body::<ProfileTable>, up to WIDEST;
    fn flats_of_poles(kernel: &PolesRgb, flats: &Flats, sums: &mut [[f64; 3]]) => flats_body::<PolesRgb>;
    fn flats_of_table(kernel: &ProfileTable, flats: &Flats, sums: &mut [[f64; 3]]) => flats_body::<ProfileTable>, up to WIDEST;
}

/// The decay sigma, 1/mm, of exp(-sigma r) / r^2 fitted to a profile where a hundredth of it is left, or at the reach.
fn decay_per_mm(profile: &dyn Profile, reach_mm: f64) -> f64 {
    let far = profile.range_mm(0.01).min(reach_mm);
    let near = 0.5 * far;
    let ratio = 0.25 * profile.reflectance(near) / profile.reflectance(far);
    let decay = ratio.ln() / (far - near);
    if decay.is_finite() { decay.max(0.0) } else { 0.0 }
}
