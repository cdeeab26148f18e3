//! Radiosity of vertices as a PLY file: `b_*`, any single scattering as `s_*`, colours for viewers, and comments on its
//! origin.

use glam::DVec3;

use crate::asset::Provenance;
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::io::ply::{RadiosityPly, write_ply};
use crate::math::srgb::srgb_from_linear;
use crate::scene::Scene;

/// Comment of files whose radiosity includes single scattering.
pub(crate) const SINGLE_INCLUDED: &str = "b includes single scattering along the inverse normal";

/// Comment of files whose kernels are calibrated; those of dipoles have none.
pub(crate) const CALIBRATED: &str = "model calibrated";

/// Name of the model of assets that name none.
pub(crate) const DIPOLE: &str = "dipole";

/// The model of the light inside that a bake was made with.
pub(crate) fn model_of(provenance: &Provenance) -> &str {
    provenance.settings.get("model").map_or(DIPOLE, String::as_str)
}

/// Origin of files that random walks wrote.
pub(crate) const RANDOM_WALK: &str = "random walk";

/// Comments of a file: its origin (a method, say), the materials and the lights.
pub(crate) fn comments(origin: &str, scene: &Scene, lights: &[String]) -> Vec<String> {
    let media: Vec<&str> = scene.media.iter().map(|m| m.name.as_str()).collect();
    let mut comments = vec![format!("translux {origin}"), format!("material {}", media.join(", "))];
    comments.extend(lights.iter().map(|light| format!("light {light}")));
    comments
}

/// The scattering in `s_*`, and its relation to `b_*`.
pub(crate) enum Single<'a> {
    /// No `s_*`.
    None,
    /// Light that `b_*` do not include; colours show both.
    Beside(&'a [DVec3]),
    /// Light that `b_*` include.
    Within(&'a [DVec3]),
}

/// The bytes of a file; `radiosity` is one RGB for each vertex of the mesh.
pub(crate) fn radiosity_ply(
    mesh: &Mesh,
    radiosity: &[DVec3],
    single: Single,
    comments: Vec<String>,
) -> Result<Vec<u8>> {
    radiosity_ply_with(mesh, (radiosity, single), Vec::new(), comments)
}

/// The same with further columns, one value for each vertex.
pub(crate) fn radiosity_ply_with(
    mesh: &Mesh,
    (radiosity, single): (&[DVec3], Single),
    columns: Vec<(&'static str, Vec<f32>)>,
    comments: Vec<String>,
) -> Result<Vec<u8>> {
    check_range("radiosity", radiosity)?;
    let narrow = |values: &[DVec3]| -> Vec<[f32; 3]> { values.iter().map(|v| v.as_vec3().to_array()).collect() };
    let (colors, s) = match single {
        Single::None => (colours(radiosity), None),
        Single::Within(single) => (colours(radiosity), Some(narrow(single))),
        Single::Beside(single) => {
            check_range("single scattering", single)?;
            (colours(&radiosity.iter().zip(single).map(|(b, s)| *b + *s).collect::<Vec<_>>()), Some(narrow(single)))
        }
    };
    write_ply(&RadiosityPly {
        positions: (0..radiosity.len() as u32).map(|v| mesh.position_mm(v).as_vec3().to_array()).collect(),
        colors,
        b: narrow(radiosity),
        s,
        columns,
        triangles: mesh.triangles.clone(),
        comments,
    })
}

/// Refuses values that a 32-bit file cannot hold; sums beyond its range may have become NaN before.
pub(crate) fn check_range(quantity: &str, values: &[DVec3]) -> Result<()> {
    match values.iter().position(|b| !b.as_vec3().is_finite()) {
        Some(v) => Err(Error::runtime(format!(
            "the {quantity} of vertex {v} is beyond 32-bit floats: a light is too bright, or too near a surface; \
             scale the lights down or move them"
        ))),
        None => Ok(()),
    }
}

/// Colours for viewers, sRGB: the 99.5th percentile of the brightest channel over lit vertices is white.
fn colours(radiosity: &[DVec3]) -> Vec<[u8; 3]> {
    let mut brightest: Vec<f64> = radiosity.iter().map(|b| b.max_element()).filter(|&b| b > 0.0).collect();
    brightest.sort_unstable_by(f64::total_cmp);
    let rank = (brightest.len() as f64 * 0.995) as usize;
    let white = brightest.get(rank.min(brightest.len().saturating_sub(1))).copied().unwrap_or(1.0);
    let code = |v: f64| (255.0 * srgb_from_linear((v / white).clamp(0.0, 1.0))).round() as u8;
    radiosity.iter().map(|b| b.to_array().map(code)).collect()
}
