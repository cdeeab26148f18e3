//! Environments, constant light, and area lights with source radiance fields, through stored irradiance rows.

use glam::DVec3;
use translux_format::rows::IrradianceRows;

use super::source_fields::{Fields, Lookup};
use crate::asset::Asset;
use crate::compress::rows::Rows;
use crate::error::Result;
use crate::evaluate::SourceFields;
use crate::geometry::part_table::PartTable;
use crate::geometry::samples::Samples;
use crate::light::cube_light::CubeLight;
use crate::light::suns::apart;
use crate::light::{Light, LightKind, refuse_fields};
use crate::medium::entrance_basis::MOST_TERMS;
use crate::medium::material::Medium;
use crate::progress::Progress;
use crate::transport::domain::Domain;
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::surface::Surface;

/// Stored irradiance rows, and the source radiance fields made so far.
pub struct StoredRows {
    rows: Rows,
    fields: Fields,
}

/// Kinds of light that rows hold.
pub const IN_ROWS: [LightKind; 2] = [LightKind::Environment, LightKind::Constant];

/// Kinds of light lit by rays, except area lights with a source radiance field.
pub const BY_RAYS: [LightKind; 4] = [LightKind::Directional, LightKind::Point, LightKind::Area, LightKind::Spot];

impl StoredRows {
    /// Holds `rows`, with no source radiance fields yet.
    pub fn new(rows: Rows) -> Self {
        Self { rows, fields: Fields::default() }
    }

    /// Rows of an asset, if it has any.
    ///
    /// # Errors
    /// Sections that do not fit.
    pub fn of(asset: &Asset) -> Result<Option<Self>> {
        Ok(Rows::from_sections(&asset.sections, &asset.samples.part_offsets)?.map(Self::new))
    }

    /// Bytes in memory, with those of the source radiance fields that were made.
    pub fn bytes(&self) -> usize {
        self.rows.data().bytes() + self.fields.bytes()
    }

    /// Irradiance of every sample, and of the pieces of those that are not lit evenly: through the rows, where there are any, for the
    /// lights that they have; for the others, and for the suns of environments, by rays.
    ///
    /// # Errors
    /// Lights that do not fit a cube map; those of the rays; a light with a source radiance field where no rows serve it.
    pub fn illuminate(
        rows: Option<&Self>,
        surface: &Surface,
        (lights, sampling): (&[Light], LightSampling),
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        let Surface { domain, samples, .. } = *surface;
        if rows.is_none_or(|rows| !rows.serve(domain.media)) {
            refuse_fields(lights)?;
        }
        let of_rows = |light: &Light| rows.is_some_and(|rows| rows.have(light, domain.media));
        let (Some(rows), true) = (rows, lights.iter().any(of_rows)) else {
            return sampled(surface, &apart(lights, |_| true), sampling, progress);
        };
        let (far, near): (Vec<Light>, Vec<Light>) = apart(lights, of_rows).into_iter().partition(of_rows);
        let (mut irradiance, pieces) = match near.as_slice() {
            [] => (vec![DVec3::ZERO; samples.len()], Pieces::default()),
            near => sampled(surface, near, sampling, progress)?,
        };
        progress.start("rows", 0);
        rows.add(&far, domain, samples, &mut irradiance)?;
        progress.finish();
        Ok((irradiance, pieces))
    }

    /// True if the rows, which hold a range of refractive indices, serve every medium.
    pub fn serve(&self, media: &[Medium]) -> bool {
        media.iter().all(|m| self.rows.entrance().project(m.properties.eta_inside_over_outside).is_ok())
    }

    /// True if the rows replace the rays of a light in some media.
    pub fn have(&self, light: &Light, media: &[Medium]) -> bool {
        (IN_ROWS.contains(&light.kind()) || light.has_field()) && self.serve(media)
    }

    /// Plain arrays of the rows.
    pub fn data(&self) -> &IrradianceRows {
        self.rows.data()
    }

    /// Samples that share rows, first and one past the last; empty where they do not.
    pub fn blocks(&self) -> &[[u32; 2]] {
        self.rows.blocks()
    }

    /// Coefficients of the functions of the angle for the medium of each part; zeros where it has none.
    ///
    /// # Errors
    /// A medium that the rows do not serve.
    pub fn entrance_of_parts(&self, parts: &PartTable, media: &[Medium]) -> Result<Vec<[f64; MOST_TERMS]>> {
        let project = |m: &Medium| Ok(self.rows.entrance().project(m.properties.eta_inside_over_outside)?.coefficients);
        let of_medium: Vec<[f64; MOST_TERMS]> = media.iter().map(project).collect::<Result<_>>()?;
        let of_part = |part: usize| parts.parts[part].medium.and_then(|m| of_medium.get(m as usize)).copied();
        Ok((0..parts.parts.len()).map(|part| of_part(part).unwrap_or_default()).collect())
    }

    /// Source radiance fields that area lights may have in these media; `rows` are those of the asset.
    pub fn source_fields(rows: Option<&Self>, media: &[Medium]) -> SourceFields {
        if rows.is_some_and(|rows| rows.serve(media)) { SourceFields::Any } else { SourceFields::None }
    }

    /// Adds the irradiance of every sample under lights that come from far away or have a source radiance field, RGB.
    ///
    /// # Errors
    /// Another kind of light, or a medium that the rows do not serve.
    pub fn add(&self, lights: &[Light], domain: Domain, samples: &Samples, irradiance: &mut [DVec3]) -> Result<()> {
        let of_part = self.entrance_of_parts(domain.parts, domain.media)?;
        let of_patch =
            |patch: usize| of_part[samples.part_offsets.partition_point(|&first| first as usize <= patch) - 1];
        for light in lights {
            if light.has_field() {
                self.fields.add(light, (&self.rows, of_patch), (domain, samples), Lookup::Field, irradiance)?;
                continue;
            }
            let light = CubeLight::new(light, self.rows.data().side)?;
            let added = self.rows.irradiance(&light, of_patch)?;
            irradiance.iter_mut().zip(added).for_each(|(sum, e)| *sum += e);
        }
        Ok(())
    }

    /// Irradiance of every sample under a light with a source radiance field, RGB, by a cube map of each sample's own:
    /// the reference for the interpolation of the field.
    ///
    /// # Errors
    /// As [`StoredRows::add`].
    pub fn without_interpolation(&self, light: &Light, domain: Domain, samples: &Samples) -> Result<Vec<DVec3>> {
        let of_part = self.entrance_of_parts(domain.parts, domain.media)?;
        let of_patch =
            |patch: usize| of_part[samples.part_offsets.partition_point(|&first| first as usize <= patch) - 1];
        let mut irradiance = vec![DVec3::ZERO; samples.len()];
        self.fields.add(light, (&self.rows, of_patch), (domain, samples), Lookup::OwnMap, &mut irradiance)?;
        Ok(irradiance)
    }

    /// Bytes of the source radiance field of a light, which is made where there is none yet.
    ///
    /// # Errors
    /// A light without one.
    pub fn field_bytes(&self, light: &Light) -> Result<usize> {
        Ok(self.fields.of(light, self.rows.data().side)?.0.bytes())
    }
}

/// Irradiance of every sample by rays, and of the pieces of those that are not lit evenly.
///
/// # Errors
/// As [`Illumination::new`].
pub fn sampled(
    surface: &Surface,
    lights: &[Light],
    sampling: LightSampling,
    progress: &dyn Progress,
) -> Result<(Vec<DVec3>, Pieces)> {
    let etas: Vec<f64> = surface.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    Ok(Illumination::new(surface, lights, &etas, sampling)?.all_with_pieces(progress))
}

/// The lights as rays sample them, the suns of environments on their own: the reference for rows.
pub fn by_rays(lights: &[Light]) -> Vec<Light> {
    let lights: Vec<Light> = lights.iter().map(Light::by_rays).collect();
    apart(&lights, |_| true)
}
