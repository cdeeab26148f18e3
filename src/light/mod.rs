//! Light sources: constant, directional, point, spot, area and environment, and the text form that the command line takes.

pub mod cone;
pub mod cube_light;
pub mod environment;
pub mod harmonics;
pub mod parse;
pub mod quantised;
pub mod rectangle_map;
pub mod sky;
pub mod source_field;
pub mod strata;
pub mod suns;
mod validate;

use glam::DVec3;

use crate::error::{Error, Result};
use cone::{Cone, ConeFalloff};
use environment::EnvironmentMap;
use std::sync::Arc;

/// A light source. Colours are linear sRGB; positions world mm; directions point towards the light.
///
/// The constructors check their arguments and normalise directions; a literal is trusted.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// The same radiance from every direction.
    Constant {
        /// Radiance, RGB, W/(m^2 sr) in arbitrary but common units.
        radiance: DVec3,
    },
    /// Parallel light.
    Directional {
        /// Unit vector from the surface towards the light.
        from: DVec3,
        /// Irradiance on a surface that faces the light, RGB.
        irradiance: DVec3,
    },
    /// A point: E = intensity / d^2, d in mm.
    Point {
        /// World position in mm.
        at_mm: DVec3,
        /// Intensity in irradiance times mm^2, RGB.
        intensity: DVec3,
    },
    /// A point that shines into a cone: E = intensity * share / d^2 ([`ConeFalloff::at`]), d in mm.
    Spot {
        /// World position in mm.
        at_mm: DVec3,
        /// Where it shines.
        cone: Cone,
        /// Intensity along the axis in irradiance times mm^2, RGB.
        intensity: DVec3,
    },
    /// A one-sided rectangle.
    Area {
        /// World position of its centre in mm.
        at_mm: DVec3,
        /// Unit normal of the emitting side.
        normal: DVec3,
        /// Unit vector along the first edge, perpendicular to `normal`.
        u: DVec3,
        /// Lengths of the first and the second edge in mm.
        size_mm: [f64; 2],
        /// Radiance of the emitting side, RGB.
        radiance: DVec3,
        /// Points along an edge of its source radiance field, through which stored irradiance rows bring its light to the
        /// samples ([`source_field`]); none: shadow rays.
        field: Option<u16>,
    },
    /// A distant environment.
    Environment {
        /// The picture.
        map: Arc<EnvironmentMap>,
        /// Counter-clockwise turn about +Y seen from above, in degrees.
        rotate_degrees: f64,
        /// Factor on the picture's radiance, RGB.
        scale: DVec3,
    },
}

/// The kinds of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum LightKind {
    /// [`Light::Constant`].
    Constant,
    /// [`Light::Directional`].
    Directional,
    /// [`Light::Point`].
    Point,
    /// [`Light::Area`].
    Area,
    /// [`Light::Environment`].
    Environment,
    /// [`Light::Spot`].
    Spot,
}

impl LightKind {
    /// Every kind.
    pub const ALL: [Self; 6] =
        [Self::Constant, Self::Directional, Self::Point, Self::Area, Self::Environment, Self::Spot];

    /// The kinds that stored transport can hold, which `all` asks a bake for. A cone that lights a part of the body alone takes
    /// transport by places of the surface, which no row over directions and distances has; what is gathered serves it anyway.
    pub const STORABLE: [Self; 5] = [Self::Constant, Self::Directional, Self::Point, Self::Area, Self::Environment];

    /// See [`Light::is_sharp`].
    pub fn is_sharp(self) -> bool {
        matches!(self, Self::Directional | Self::Point | Self::Spot)
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Directional => "directional",
            Self::Point => "point",
            Self::Area => "area",
            Self::Environment => "environment",
            Self::Spot => "spot",
        }
    }
}

impl Light {
    /// Its kind.
    pub fn kind(&self) -> LightKind {
        match self {
            Self::Constant { .. } => LightKind::Constant,
            Self::Directional { .. } => LightKind::Directional,
            Self::Point { .. } => LightKind::Point,
            Self::Spot { .. } => LightKind::Spot,
            Self::Area { .. } => LightKind::Area,
            Self::Environment { .. } => LightKind::Environment,
        }
    }

    /// The same radiance from every direction.
    ///
    /// # Errors
    /// A negative or non-finite radiance (exit 3).
    pub fn constant(radiance: DVec3) -> Result<Self> {
        Ok(Self::Constant { radiance: validate::amount("radiance", radiance)? })
    }

    /// Parallel light that comes from `from`, which need not be normalised.
    ///
    /// # Errors
    /// A zero or non-finite direction, a negative or non-finite irradiance (exit 3).
    pub fn directional(from: DVec3, irradiance: DVec3) -> Result<Self> {
        Ok(Self::Directional {
            from: validate::direction("from", from)?,
            irradiance: validate::amount("irradiance", irradiance)?,
        })
    }

    /// A point light of the intensity `intensity` (irradiance times mm^2).
    ///
    /// # Errors
    /// A non-finite position, a negative or non-finite intensity (exit 3).
    pub fn point(at_mm: DVec3, intensity: DVec3) -> Result<Self> {
        Ok(Self::Point {
            at_mm: validate::position("at", at_mm)?,
            intensity: validate::amount("intensity", intensity)?,
        })
    }

    /// A spot light at `at_mm`, whose axis goes through `to_mm`. `angle_degrees` is the full angle of its cone, `blend` the share of
    /// the half angle, from the edge inwards, over which the light falls to 0; `intensity` (irradiance times mm^2) is that of the axis.
    ///
    /// # Errors
    /// A non-finite position, a target at the light's own place, an angle or a blend out of range, a negative or non-finite
    /// intensity (exit 3).
    pub fn spot(at_mm: DVec3, to_mm: DVec3, angle_degrees: f64, blend: f64, intensity: DVec3) -> Result<Self> {
        let at_mm = validate::position("at", at_mm)?;
        let cone = Cone::new(at_mm, to_mm, angle_degrees, blend)?;
        Ok(Self::Spot { at_mm, cone, intensity: validate::amount("intensity", intensity)? })
    }

    /// A one-sided rectangle centred at `at_mm`. `u` gives the direction of the first edge and is made perpendicular to
    /// `normal`; without it the first edge is normalize(Z x normal), or +X where |normal.z| > 0.99.
    ///
    /// # Errors
    /// Non-finite values, a zero normal, an edge length that is not positive, `u` parallel to `normal`, a negative
    /// radiance (exit 3).
    pub fn area(
        at_mm: DVec3,
        normal: DVec3,
        size_mm: [f64; 2],
        radiance: DVec3,
        first_edge: Option<DVec3>,
    ) -> Result<Self> {
        let normal = validate::direction("normal", normal)?;
        Ok(Self::Area {
            at_mm: validate::position("at", at_mm)?,
            normal,
            u: validate::first_edge(normal, first_edge)?,
            size_mm: validate::size(size_mm)?,
            radiance: validate::amount("radiance", radiance)?,
            field: None,
        })
    }

    /// An area light through a source radiance field of `points` points along an edge (see [`source_field::POINTS`]).
    ///
    /// # Errors
    /// Another kind of light, or a number of points that is out of range (exit 3).
    pub fn through_field(mut self, points: u16) -> Result<Self> {
        match &mut self {
            Self::Area { field, .. } => *field = Some(validate::field_points(points)?),
            other => return Err(Error::input(format!("{} lights have no source radiance field", other.kind().name()))),
        }
        Ok(self)
    }

    /// Returns whether it comes from one direction or one place at each point, so that its shadows have sharp edges.
    pub fn is_sharp(&self) -> bool {
        self.kind().is_sharp()
    }

    /// Place in world mm, intensity and falloff of a light that shines from one place.
    pub fn from_place(&self) -> Option<(DVec3, DVec3, ConeFalloff)> {
        match self {
            Self::Point { at_mm, intensity } => Some((*at_mm, *intensity, ConeFalloff::NONE)),
            Self::Spot { at_mm, cone, intensity } => Some((*at_mm, *intensity, cone.falloff(*at_mm))),
            _ => None,
        }
    }

    /// True for an area light that is to go through a source radiance field.
    pub fn has_field(&self) -> bool {
        matches!(self, Self::Area { field: Some(_), .. })
    }

    /// The same light by shadow rays.
    #[must_use]
    pub fn by_rays(&self) -> Self {
        let mut light = self.clone();
        if let Self::Area { field, .. } = &mut light {
            *field = None;
        }
        light
    }

    /// An environment, turned by `rotate_degrees` and multiplied by `scale`.
    ///
    /// # Errors
    /// A non-finite angle, a negative or non-finite scale (exit 3).
    pub fn environment(map: Arc<EnvironmentMap>, rotate_degrees: f64, scale: DVec3) -> Result<Self> {
        Ok(Self::Environment {
            map,
            rotate_degrees: validate::angle("rotate", rotate_degrees)?,
            scale: validate::amount("scale", scale)?,
        })
    }
}

/// Refuses lights with a source radiance field, so that casting rays does not silently replace the field.
///
/// # Errors
/// A light with a source radiance field (exit 5).
pub fn refuse_fields(lights: &[Light]) -> Result<()> {
    match lights.iter().find(|light| light.has_field()) {
        Some(light) => Err(Error::unsupported(format!(
            "light `{light}`: a source radiance field (field=) needs stored irradiance rows, which assets of --method editable have \
             where --for-lights includes environment; without field= the light is sampled by shadow rays"
        ))),
        None => Ok(()),
    }
}
