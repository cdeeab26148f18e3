//! What materials have that nothing reads.

use std::collections::BTreeSet;

use gltf::json::Material;
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;

use super::inside;

/// One line on the extensions and properties of materials that nothing reads, if any.
pub(super) fn of_materials<'a>(materials: impl Iterator<Item = &'a Material>) -> Option<String> {
    let mut found: BTreeSet<&str> = BTreeSet::new();
    let mut more: BTreeSet<String> = BTreeSet::new();
    for material in materials {
        let surface = &material.pbr_metallic_roughness;
        let emits = material.emissive_texture.is_some() || material.emissive_factor.0 != [0.0; 3];
        let blends = !matches!(material.alpha_mode, Checked::Valid(AlphaMode::Opaque));
        let extensions = material.extensions.as_ref();
        let properties = [
            (material.normal_texture.is_some(), "normalTexture"),
            (material.occlusion_texture.is_some(), "occlusionTexture"),
            (surface.metallic_roughness_texture.is_some(), "metallicRoughnessTexture"),
            (emits, "emission"),
            (blends, "alphaMode"),
            (extensions.is_some_and(|e| e.specular.is_some()), "KHR_materials_specular"),
            (extensions.is_some_and(|e| e.unlit.is_some()), "KHR_materials_unlit"),
        ];
        found.extend(properties.into_iter().filter_map(|(is_there, name)| is_there.then_some(name)));
        let others = extensions.into_iter().flat_map(|e| e.others.keys());
        more.extend(others.filter(|name| !inside::READ.contains(&name.as_str())).cloned());
    }
    let names: Vec<&str> = found.into_iter().chain(more.iter().map(String::as_str)).collect();
    (!names.is_empty()).then(|| format!("of the materials these are not used: {}", names.join(", ")))
}
