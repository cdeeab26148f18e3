//! Random walks through the volume, which the reference and every row are compared with.

use glam::DVec3;

use super::subject::Subject;
use crate::error::{Error, Result};
use crate::io::atomic;
use crate::light::Light;
use crate::measure::chart::ModelLine;
use crate::scene::Scene;
use crate::transport::random_walk::exitance::{self, Effort, Exitance, exitance};
use crate::transport::random_walk::model_error::compare;
use crate::transport::random_walk::tally::{Budget, Hats};

/// Standard error that noise may cause in the mean square of the difference, relative to the mean square exitance: an
/// error of the model of 10 % is then known to a quarter of a percent.
const UNCERTAINTY: f64 = 5e-4;

/// Least and largest noise that a walk is asked for.
const NOISE: [f64; 2] = [0.02, 0.5];

/// Noise of single vertices that gives [`UNCERTAINTY`]: its square has the standard error `noise^2 sqrt(2 / vertices)`.
fn noise(vertices: usize) -> f64 {
    (UNCERTAINTY * (0.5 * vertices as f64).sqrt()).sqrt().clamp(NOISE[0], NOISE[1])
}

/// A walk as it is kept, without what follows from the scene: exitance, its standard error, photons.
type Kept = (Vec<DVec3>, Vec<DVec3>, [u64; 3]);

/// The difference between the reference and the volume under each light, and the walks themselves; existing ones are
/// taken.
pub(super) fn errors(
    subject: &Subject,
    scene: &Scene,
    lights: &[(String, Light)],
    radiosity: &[Vec<DVec3>],
) -> Result<(Vec<ModelLine>, Vec<Exitance>)> {
    let console = subject.console;
    console.check_memory(exitance::memory(scene.domain()), "raise --max-memory")?;
    let noise = noise(scene.mesh.local_mm.len());
    let hats = Hats::new(&scene.mesh, &scene.parts);
    let (mut lines, mut walks) = (Vec::with_capacity(lights.len()), Vec::with_capacity(lights.len()));
    for ((text, light), values) in lights.iter().zip(radiosity) {
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
        let path = subject.folder.join(format!("{}.walk", &hasher.finalize().to_hex()[..16]));
        let kept: Option<Kept> = std::fs::read(&path).ok().and_then(|bytes| bincode::deserialize(&bytes).ok());
        let walk = match kept.filter(|(total, error, _)| [total.len(), error.len()] == [hats.vertex.len(); 2]) {
            Some((total, standard_error, photons)) => {
                let budget = [Budget::default(); 3];
                Exitance { hats: hats.clone(), total, single: Vec::new(), standard_error, budget, photons }
            }
            None => {
                let walk = exitance(scene.domain(), std::slice::from_ref(light), Effort::Noise(noise), 0, console)?;
                let bytes = bincode::serialize(&(&walk.total, &walk.standard_error, walk.photons))
                    .map_err(|e| Error::runtime(format!("{}: {e}", path.display())))?;
                atomic::write(&path, &bytes)?;
                walk
            }
        };
        lines.push(ModelLine {
            light: text.clone(),
            error: compare(&walk, values)?,
            photons: walk.photons,
            command: format!("{command} --max-rms {noise}"),
        });
        walks.push(walk);
    }
    Ok((lines, walks))
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
