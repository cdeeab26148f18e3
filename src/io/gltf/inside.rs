//! What materials say of their inside: extensions to a volume, clear glass or a surface alone.

use glam::DVec3;
use gltf::json::Material;
use gltf::json::extensions::material;
use serde_json::Value;

use crate::medium::material::ETA_RANGE;
use crate::medium::volume::{Inside, LEAST_TRANSMITTANCE, Scattering, Volume, attenuation, single_scattering_albedo};

/// Scattering within a volume; the draft of 2025.
const SCATTER: &str = "KHR_materials_scatter";
/// Scattering within a volume; the draft before it.
const VOLUME_SCATTER: &str = "KHR_materials_volume_scatter";
/// Diffuse transmission at the surface.
const DIFFUSE_TRANSMISSION: &str = "KHR_materials_diffuse_transmission";
/// Refractive index of a material without KHR_materials_ior.
const DEFAULT_IOR: f32 = 1.5;

/// Extensions that are read here and that the document's types leave as they are.
pub(super) const READ: [&str; 3] = [SCATTER, VOLUME_SCATTER, DIFFUSE_TRANSMISSION];

/// What is wrong, in words.
type Read<T> = Result<T, String>;

/// What a material says of its inside.
pub(super) fn inside(material: &Material) -> Inside {
    let Some(extensions) = &material.extensions else { return Inside::Surface };
    read(material, extensions).unwrap_or_else(Inside::Invalid)
}

/// Scattering within a volume, of either extension.
struct Scatter {
    source: &'static str,
    multiple: DVec3,
    g: f64,
    warnings: Vec<String>,
}

/// Diffuse transmission at the surface.
struct Diffuse {
    factor: f64,
    colour: DVec3,
    warnings: Vec<String>,
}

fn read(material: &Material, extensions: &material::Material) -> Read<Inside> {
    let scatter = scatter(extensions)?;
    let diffuse = diffuse(extensions)?;
    let transmission = match &extensions.transmission {
        Some(transmission) => Some(in_unit(
            f64::from(transmission.transmission_factor.0),
            "KHR_materials_transmission, transmissionFactor",
        )?),
        None => None,
    };
    match scatter {
        Some(scatter) => scattering(extensions, scatter, transmission, diffuse.map(|diffuse| diffuse.factor)),
        // Specular transmission stands before the diffuse one, of which nothing is left at 1.
        None => match diffuse.filter(|d| d.factor > 0.0 && transmission.is_none_or(|share| share < 1.0)) {
            Some(diffuse) => diffusing(material, extensions, diffuse),
            None if transmission.is_some_and(|share| share > 0.0) => Ok(Inside::Clear),
            None => Ok(Inside::Surface),
        },
    }
}

/// A volume that scatters.
fn scattering(
    extensions: &material::Material,
    scatter: Scatter,
    transmission: Option<f64>,
    diffuse: Option<f64>,
) -> Read<Inside> {
    let Scatter { source, multiple, g, mut warnings } = scatter;
    match transmission.into_iter().chain(diffuse).reduce(f64::max) {
        Some(0.0) => return Ok(Inside::Surface),
        Some(share) if share < 1.0 => warnings.push(format!(
            "by its transmission factor {:.0} % of the light enters it: all of it is taken to",
            100.0 * share
        )),
        Some(_) => {}
        None => warnings.push(format!(
            "it has {source} without KHR_materials_transmission or {DIFFUSE_TRANSMISSION}, and lets no light in by the letter: light is taken \
             to enter"
        )),
    }
    if multiple == DVec3::ZERO {
        return Ok(Inside::Clear);
    }
    let Some(attenuation_per_unit) = volume_attenuation(extensions, &mut warnings)? else {
        return Ok(Inside::WithoutLength { source, colour: multiple });
    };
    let clear: Vec<&str> = ["red", "green", "blue"]
        .into_iter()
        .zip(attenuation_per_unit.to_array())
        .filter_map(|(channel, sigma)| (sigma == 0.0).then_some(channel))
        .collect();
    if !clear.is_empty() {
        let clear = clear.join(" and ");
        warnings
            .push(format!("its attenuationColor is 1 in {clear}: nothing is scattered there, and nothing comes back"));
    }
    // The draft of 2025 keeps the colour whatever the anisotropy is, the earlier one does not.
    let of_g = if source == SCATTER { g } else { 0.0 };
    let single = multiple.map(|colour| single_scattering_albedo(colour, of_g));
    Ok(Inside::Volume(Volume {
        source,
        attenuation_per_unit,
        scattering: Scattering::Albedo { multiple, single },
        g,
        eta_inside_over_outside: eta(extensions)?,
        warnings,
    }))
}

/// A surface that lets light through diffusely, and a dense volume behind it.
fn diffusing(material: &Material, extensions: &material::Material, diffuse: Diffuse) -> Read<Inside> {
    let Diffuse { factor, colour, mut warnings } = diffuse;
    let surface = &material.pbr_metallic_roughness;
    let [r, g, b, _] = surface.base_color_factor.0.map(f64::from);
    let base = DVec3::new(r, g, b);
    in_unit(base.min_element(), "baseColorFactor")?;
    in_unit(base.max_element(), "baseColorFactor")?;
    if factor < 1.0 && surface.base_color_texture.is_some() {
        warnings.push("its baseColorTexture is not read for its medium: baseColorFactor stands for it".to_owned());
    }
    let colour = (1.0 - factor) * base + factor * colour;
    let Some(attenuation) = volume_attenuation(extensions, &mut warnings)? else {
        return Ok(Inside::WithoutLength { source: DIFFUSE_TRANSMISSION, colour });
    };
    // A channel in which light is not attenuated at all has no diffusion length, and at least that of the clearest other one.
    let least = attenuation.to_array().into_iter().filter(|sigma| *sigma > 0.0).fold(f64::INFINITY, f64::min);
    Ok(Inside::Volume(Volume {
        source: DIFFUSE_TRANSMISSION,
        attenuation_per_unit: attenuation.max(DVec3::splat(least)),
        scattering: Scattering::Colour(colour),
        g: 0.0,
        eta_inside_over_outside: eta(extensions)?,
        warnings,
    }))
}

/// Attenuation of KHR_materials_volume in 1/m; none where nothing is attenuated.
fn volume_attenuation(extensions: &material::Material, warnings: &mut Vec<String>) -> Read<Option<DVec3>> {
    let Some(volume) = &extensions.volume else { return Ok(None) };
    let colour = DVec3::from_array(volume.attenuation_color.0.map(f64::from));
    let distance = f64::from(volume.attenuation_distance.0);
    for channel in colour.to_array() {
        in_unit(channel, "KHR_materials_volume, attenuationColor")?;
    }
    // JSON has no NaN.
    if distance <= 0.0 {
        return Err(format!("KHR_materials_volume, attenuationDistance: {distance} is no distance above 0"));
    }
    let sigma = attenuation(colour, distance);
    if sigma == DVec3::ZERO {
        return Ok(None);
    }
    if !sigma.is_finite() {
        return Err(format!("KHR_materials_volume, attenuationDistance: {distance} m is too short"));
    }
    if colour.min_element() < LEAST_TRANSMITTANCE {
        warnings
            .push(format!("its attenuationColor of 0 has no finite coefficient: {LEAST_TRANSMITTANCE} stands for it"));
    }
    if volume.thickness_factor.0 == 0.0 {
        warnings.push(
            "its thicknessFactor is 0, that of a thin sheet, and it has an attenuationDistance: its mesh is taken to bound a volume"
                .to_owned(),
        );
    }
    Ok(Some(sigma))
}

fn eta(extensions: &material::Material) -> Read<f64> {
    let ior = f64::from(extensions.ior.as_ref().map_or(DEFAULT_IOR, |ior| ior.ior.0));
    if ETA_RANGE.contains(&ior) {
        return Ok(ior);
    }
    Err(format!("KHR_materials_ior, ior: {ior} is not from {} to {}", ETA_RANGE.start(), ETA_RANGE.end()))
}

fn scatter(extensions: &material::Material) -> Read<Option<Scatter>> {
    let both = [SCATTER, VOLUME_SCATTER].map(|name| extensions.others.get(name).map(|value| (name, value)));
    let mut warnings = Vec::new();
    if let [Some(_), Some(_)] = both {
        warnings.push(format!("it has {SCATTER} and {VOLUME_SCATTER}, which exclude each other: the former counts"));
    }
    let Some((source, value)) = both.into_iter().flatten().next() else { return Ok(None) };
    let object = Object { extension: source, value };
    // A draft that had no strength yet is one of strength 1.
    let strength = object.number("scatterStrengthFactor", 1.0)?;
    in_unit(strength, &object.place("scatterStrengthFactor"))?;
    if strength == 0.0 {
        return Ok(None);
    }
    // White is the default of the later draft, black that of the earlier one.
    let default = if source == SCATTER { 1.0 } else { 0.0 };
    let multiple = match object.colour("multiscatterColorFactor")? {
        Some(colour) => Some(colour),
        None => object.colour("multiscatterColor")?,
    };
    let multiple = strength * multiple.unwrap_or(DVec3::splat(default));
    let g = object.number("scatterAnisotropy", 0.0)?;
    if g.abs() >= 1.0 {
        return Err(format!("{}: {g} is not above -1 and below 1", object.place("scatterAnisotropy")));
    }
    object.warn_of_textures(&["multiscatterColorTexture", "scatterStrengthTexture"], &mut warnings);
    Ok(Some(Scatter { source, multiple, g, warnings }))
}

fn diffuse(extensions: &material::Material) -> Read<Option<Diffuse>> {
    let Some(value) = extensions.others.get(DIFFUSE_TRANSMISSION) else { return Ok(None) };
    let object = Object { extension: DIFFUSE_TRANSMISSION, value };
    let factor = object.number("diffuseTransmissionFactor", 0.0)?;
    in_unit(factor, &object.place("diffuseTransmissionFactor"))?;
    let colour = object.colour("diffuseTransmissionColorFactor")?.unwrap_or(DVec3::ONE);
    let mut warnings = Vec::new();
    object.warn_of_textures(&["diffuseTransmissionTexture", "diffuseTransmissionColorTexture"], &mut warnings);
    Ok(Some(Diffuse { factor, colour, warnings }))
}

fn in_unit(value: f64, place: &str) -> Read<f64> {
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(format!("{place}: {value} is not in [0, 1]")) }
}

/// An extension of a material as JSON.
struct Object<'a> {
    extension: &'static str,
    value: &'a Value,
}

impl Object<'_> {
    fn place(&self, key: &str) -> String {
        format!("{}, {key}", self.extension)
    }

    fn number(&self, key: &str, default: f64) -> Read<f64> {
        match self.value.get(key) {
            None => Ok(default),
            Some(value) => value.as_f64().ok_or_else(|| format!("{}: {value} is no number", self.place(key))),
        }
    }

    /// A colour in [0, 1].
    fn colour(&self, key: &str) -> Read<Option<DVec3>> {
        let Some(value) = self.value.get(key) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = value.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
        let Some([r, g, b]) = numbers.as_deref() else {
            return Err(format!("{}: {value} is not three numbers", self.place(key)));
        };
        for channel in [r, g, b] {
            in_unit(*channel, &self.place(key))?;
        }
        Ok(Some(DVec3::new(*r, *g, *b)))
    }

    /// Media are the same everywhere.
    fn warn_of_textures(&self, keys: &[&str], warnings: &mut Vec<String>) {
        let there: Vec<&str> = keys.iter().copied().filter(|key| self.value.get(key).is_some()).collect();
        if !there.is_empty() {
            warnings.push(format!(
                "its {} is not read, as media are the same everywhere: the factor alone counts",
                there.join(" and ")
            ));
        }
    }
}
