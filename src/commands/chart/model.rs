//! The model's own error: the reference against a random walk through the volume.

use glam::DVec3;

use super::child::{store, stored};
use super::subject::Subject;
use crate::error::Result;
use crate::light::Light;
use crate::measure::chart::ModelLine;
use crate::scene::Scene;
use crate::transport::random_walk::exitance::{self, Effort, exitance};
use crate::transport::random_walk::model_error::compare;

/// Standard error that noise may cause in the mean square of the difference, relative to the mean square exitance: an
/// error of the model of 10 % is then known to a quarter of a percent.
const UNCERTAINTY: f64 = 5e-4;

/// Least and largest noise that a walk is asked for.
const NOISE: [f64; 2] = [0.02, 0.5];

/// Noise of single vertices that gives [`UNCERTAINTY`]: its square has the standard error `noise^2 sqrt(2 / vertices)`.
fn noise(vertices: usize) -> f64 {
    (UNCERTAINTY * (0.5 * vertices as f64).sqrt()).sqrt().clamp(NOISE[0], NOISE[1])
}

/// Walks photons under each light; existing results are taken.
pub(super) fn errors(
    subject: &Subject,
    scene: &Scene,
    lights: &[(String, Light)],
    radiosity: &[Vec<DVec3>],
) -> Result<Vec<ModelLine>> {
    let console = subject.console;
    console.check_memory(exitance::memory(scene.domain()), "raise --max-memory")?;
    let noise = noise(scene.mesh.local_mm.len());
    let line = |((text, light), values): (&(String, Light), &Vec<DVec3>)| {
        let model = subject.model.display().to_string();
        let mut words = vec!["translux", "reference", &model, "--material", subject.material];
        words.extend(subject.placement.iter().map(String::as_str));
        words.extend(["--model", "monte-carlo", "--light", text]);
        let command = words.join(" ");
        let mut hasher = blake3::Hasher::new();
        hasher.update(env!("CARGO_PKG_VERSION").as_bytes()).update(command.as_bytes()).update(&noise.to_le_bytes());
        // The values depend on model, material and light, whatever their files hold now.
        values.iter().flat_map(|v| v.to_array()).for_each(|v| {
            hasher.update(&v.to_le_bytes());
        });
        let path = subject.folder.join(format!("{}.walk.json", &hasher.finalize().to_hex()[..16]));
        if let Some(line) = stored(&path) {
            return Ok(line);
        }
        let walked = exitance(scene.domain(), std::slice::from_ref(light), Effort::Noise(noise), 0, console)?;
        let line = ModelLine {
            light: text.clone(),
            error: compare(&walked, values)?,
            photons: walked.photons,
            command: format!("{command} --max-rms {noise}"),
        };
        store(&path, &line)?;
        Ok(line)
    };
    lights.iter().zip(radiosity).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_vertices_may_be_noisier() {
        assert!((noise(1900) - 0.124).abs() < 1e-3 && noise(35_000) > 0.2);
        assert_eq!((noise(0), noise(usize::MAX)), (NOISE[0], NOISE[1]));
    }
}
