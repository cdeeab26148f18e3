//! Whether a model is of a size at which its media are what they are named for.

use crate::geometry::check::MeshCheck;
use crate::geometry::mesh::Scale;
use crate::medium::material::Medium;
use crate::scene::Scene;

/// Mean free paths across a model, those of its densest channel, below which nearly all light goes straight through.
const FEWEST: f64 = 3.0;

/// Mean free paths across a model, those of its clearest channel, above which nothing shows that light goes in: a statue as
/// tall as a person has 2,500 of skin.
const MOST: f64 = 2e4;

/// Mean free paths across an object that looks translucent, and the range of nearly all such objects.
const USUAL: f64 = 100.0;
const USUAL_RANGE: [f64; 2] = [10.0, 3000.0];

/// One line for each medium that the model is far too small or too large for, with what to type. Lengths of media in `of_file`
/// are in the unit of the file and scale with the model.
pub(super) fn doubts(
    scene: &Scene,
    check: &MeshCheck,
    (scale, mm_per_unit): (Option<Scale>, f64),
    of_file: &[&str],
) -> Vec<String> {
    let used = |index: usize| scene.parts.parts.iter().any(|part| part.medium == Some(index as u32));
    let used = scene.media.iter().enumerate().filter(|(index, _)| used(*index));
    used.filter_map(|(_, medium)| {
        let (path_mm, what) = doubt(medium, check.diagonal_mm)?;
        let (name, across) = (&medium.name, digits(check.diagonal_mm, 3));
        let said = format!(
            "the model is {across} mm across, {} mean free paths of {name} ({} mm): {what}",
            digits(check.diagonal_mm / path_mm, 2),
            digits(path_mm, 2)
        );
        let advice = if of_file.contains(&name.as_str()) {
            format!(
                "its attenuationDistance, in the unit of the file's coordinates, fits a model of {} units, and this one has {}: correct it there, or \
                 say --material '{name}=wax' for example",
                digits(USUAL * path_mm / mm_per_unit, 1),
                digits(check.diagonal_mm / mm_per_unit, 3)
            )
        } else {
            advice(scale, mm_per_unit, check.diagonal_mm, path_mm)
        };
        Some(format!("{said}; {advice}"))
    })
    .collect()
}

/// The mean free path that is out of proportion, and what comes of it.
fn doubt(medium: &Medium, diagonal_mm: f64) -> Option<(f64, &'static str)> {
    let paths = medium.properties.mean_free_path_mm();
    let (shortest, longest) = (paths.min_element(), paths.max_element());
    if shortest.is_finite() && diagonal_mm < FEWEST * shortest {
        return Some((shortest, "nearly all light goes straight through"));
    }
    (diagonal_mm > MOST * longest).then_some((longest, "nothing shows that light goes inside"))
}

/// What to type: another unit where one makes the model of a usual size, else a size.
fn advice(scale: Option<Scale>, mm_per_unit: f64, diagonal_mm: f64, path_mm: f64) -> String {
    let fits = |mm: f64| {
        let paths = diagonal_mm / mm_per_unit * mm / path_mm;
        let [fewest, most] = USUAL_RANGE;
        // How far from the middle of the range.
        (fewest..=most).contains(&paths).then(|| (paths / (fewest * most).sqrt()).ln().abs())
    };
    let units = [("mm", 1.0), ("cm", 10.0), ("m", 1000.0)];
    let best = units
        .into_iter()
        .filter(|_| matches!(scale, None | Some(Scale::MillimetresPerUnit(_))))
        .filter_map(|(word, mm)| Some((word, mm, fits(mm)?)))
        .min_by(|a, b| a.2.total_cmp(&b.2));
    match best {
        Some((word, mm, _)) => {
            let across = digits(diagonal_mm / mm_per_unit * mm, 3);
            format!("if its coordinates are {word}, say --unit {word} ({across} mm across)")
        }
        None => format!("if it has another size, say which: --size-mm {} for example", digits(USUAL * path_mm, 1)),
    }
}

/// A number of so many significant digits.
pub(super) fn digits(value: f64, digits: usize) -> f64 {
    // Products with powers of ten leave trails of digits.
    format!("{value:.*e}", digits.saturating_sub(1)).parse().unwrap_or(value)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::medium::material::preset;

    #[test]
    fn a_size_a_thousand_times_off_is_told_with_the_unit_that_fits() {
        let marble: Medium = preset("marble").unwrap().material().into();
        let longest = marble.properties.mean_free_path_mm().max_element();
        assert!(doubt(&marble, 30.0).is_none() && doubt(&marble, 2000.0).is_none());
        // 30 units taken for metres, and 0.03 taken for millimetres.
        for (diagonal_mm, mm_per_unit, said) in
            [(30_000.0, 1000.0, "say --unit mm (30 mm across)"), (0.03, 1.0, "say --unit m (30 mm across)")]
        {
            let (path_mm, _) = doubt(&marble, diagonal_mm).unwrap();
            for scale in [Some(Scale::MillimetresPerUnit(mm_per_unit)), None] {
                let advice = advice(scale, mm_per_unit, diagonal_mm, path_mm);
                assert!(advice.contains(said), "{advice}");
            }
            let sized = advice(Some(Scale::DiagonalMm(diagonal_mm)), mm_per_unit, diagonal_mm, path_mm);
            assert!(sized.contains("--size-mm 30 ") || sized.contains("--size-mm 50 "), "{sized} {longest}");
        }
        assert_eq!([digits(0.1234, 2), digits(85_678.0, 1), digits(0.0, 3)], [0.12, 90_000.0, 0.0]);
    }
}
