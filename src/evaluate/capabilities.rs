//! The edits that an evaluator allows, and the size of what it holds.

/// The edits that an evaluator allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Capabilities {
    /// Material properties that may change without a new bake.
    pub material: MaterialEdit,
    /// Radial profiles that may replace the dipole.
    pub profile: ProfileEdit,
    /// Use of source radiance fields ([`crate::light::source_field`]) for area lights.
    pub source_fields: SourceFields,
}

impl Capabilities {
    /// Those of transport that is baked in.
    pub const NONE: Self =
        Self { material: MaterialEdit::None, profile: ProfileEdit::None, source_fields: SourceFields::None };
}

/// Material properties that may change without a new bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum MaterialEdit {
    /// Nothing: the material is baked in.
    None,
    /// Every optical property.
    Any,
}

/// Use of source radiance fields for area lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SourceFields {
    /// Not possible: there are no irradiance rows at the samples.
    None,
    /// Possible in the media in force: their refractive indices are those that the rows serve.
    Any,
}

/// Radial profiles that an evaluator takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ProfileEdit {
    /// Only the profile that its transport was computed for.
    None,
    /// Only the kernels that walks have calibrated: they have no profile.
    Calibrated,
    /// Any profile, on the CPU: the shaders know the dipole alone.
    OnCpu,
    /// Any profile, on devices as well.
    Any,
}

/// Size of what an evaluator holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Cost {
    /// Surface samples.
    pub samples: usize,
    /// Points where radiosity is gathered.
    pub receivers: usize,
    /// Bytes of the method's data in memory, mesh and occluders apart.
    pub resident_bytes: usize,
}

/// The place where an evaluator returns single scattering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleScattering {
    /// There is no single scattering.
    None,
    /// Added to the radiosity, isotropic: the sum is the same as with [`Self::PerVertex`], but nothing tells the two
    /// apart.
    Included,
    /// A separate value per vertex: [`super::Evaluator::single_scattering`].
    PerVertex,
    /// Separate and dependent on the eye, looked up: [`super::Evaluator::towards_eye`].
    TowardsEye,
    /// Separate and dependent on the eye, traced by rays.
    TracedTowardsEye,
}
