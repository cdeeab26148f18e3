//! Whether samples are near enough to each other for the media that they stand for.

use crate::scene::Scene;

/// Mean free paths between samples, those of the clearest channel, above which radiosity follows the irradiance of the place itself, and the
/// edge of a shadow that passes between two samples decides what a vertex there gets.
const MOST_PATHS: f64 = 3.0;

/// One line about the first medium whose samples, `count` on the parts that light enters, lie too far apart; none of an asset without samples.
pub fn too_far_apart(scene: &Scene, count: usize) -> Option<String> {
    if count == 0 {
        return None;
    }
    let entered = scene.parts.parts.iter().filter(|part| part.transfers());
    let area: f64 = entered.clone().map(|part| part.area_mm2).sum();
    let apart_mm = (area / count as f64).sqrt();
    let medium = entered.filter_map(|part| scene.media.get(part.medium? as usize)).find(|medium| {
        let longest = medium.properties.mean_free_path_mm().max_element();
        apart_mm > MOST_PATHS * longest
    })?;
    let paths = apart_mm / medium.properties.mean_free_path_mm().max_element();
    Some(format!(
        "samples lie {apart_mm:.2} mm apart, {paths:.1} mean free paths of {}: light leaves where it enters, and single vertices at the edges of shadows are off by up to \
         a third; use more --samples, or a smaller --size-mm",
        medium.name
    ))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::mesh::{Mesh, Placement};
    use crate::geometry::part_table::PartTable;
    use crate::geometry::shapes::icosphere;
    use crate::medium::material::{Medium, preset};

    #[test]
    fn samples_are_too_few_for_a_body_of_many_mean_free_paths() {
        let (mesh, _) = Mesh::from_source(icosphere(100.0, 3), &Placement { mm_per_unit: 1.0 }).unwrap();
        let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("ball".to_owned(), Some(0))]);
        let media = vec![Medium { name: "marble".to_owned(), properties: preset("marble").unwrap().properties() }];
        let ball = Scene { mesh, parts, media };
        let longest: f64 = ball.media[0].properties.mean_free_path_mm().max_element();
        let few = (ball.parts.parts[0].area_mm2 / (4.0 * longest).powi(2)) as usize;
        let told = too_far_apart(&ball, few).unwrap();
        assert!(told.contains("4.0 mean free paths of marble"), "{told}");
        assert_eq!(too_far_apart(&ball, 2 * few), None);
        assert_eq!(too_far_apart(&ball, 0), None);
    }
}
