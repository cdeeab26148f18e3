//! What an evaluator allows and what it holds.

/// What an evaluator allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Capabilities {
    /// What may change about the material without a new bake.
    pub material: MaterialEdit,
    /// Whether another radial profile may take the dipole's place.
    pub profile: ProfileEdit,
    /// Whether area lights may go through source radiance fields ([`crate::light::source_field`]).
    pub source_fields: SourceFields,
}

/// What may change about the material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MaterialEdit {
    /// Nothing: the material is baked in.
    None,
    /// Every optical property.
    Any,
}

/// Whether area lights may go through source radiance fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SourceFields {
    /// No: there are no irradiance rows at the samples.
    None,
    /// Yes, in the media in force: their refractive indices are those that the rows serve.
    Any,
}

/// Which radial profiles an evaluator takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProfileEdit {
    /// The one that its transport was computed for.
    None,
    /// Any, on the CPU: the shaders know the dipole alone.
    OnCpu,
    /// Any, on devices as well.
    Any,
}

/// Size of what an evaluator holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Cost {
    /// Surface samples.
    pub samples: usize,
    /// Points where radiosity is gathered.
    pub receivers: usize,
    /// Bytes of the method's data in memory, mesh and occluders apart.
    pub resident_bytes: usize,
}

/// Where single scattering is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleScattering {
    /// Nowhere.
    None,
    /// In the radiosity, isotropic: what leaves is the same as with [`Self::PerVertex`], but nothing tells the two apart.
    Included,
    /// Beside it: [`super::Evaluator::single_scattering`].
    PerVertex,
    /// Beside it, for eyes alone, looked up: [`super::Evaluator::towards_eye`].
    TowardsEye,
    /// The same by rays.
    TracedTowardsEye,
}
