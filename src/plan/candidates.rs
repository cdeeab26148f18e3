//! What could be baked: methods with their settings, what each is expected to cost, and what is left out from the start.

use super::record::{Considered, Left};
use super::request::Request;
use super::truth;
use crate::error::Result;
use crate::evaluate::{BakeSettings, Forecast, Method, Model, Recipe, Registry};
use crate::light::LightKind;
use crate::math::statistics::VertexError;
use crate::report::text::{megabytes, percent};
use crate::scene::Scene;

/// Numbers of samples that are tried: powers of two.
const SAMPLES: std::ops::RangeInclusive<u32> = 10..=18;

/// Those of calibrated kernels at most where nobody named an error: beside that of the model more would hardly be seen, and sharp corners, which
/// take a sample for every fraction of a free path, would have a bake take minutes.
const MOST_UNASKED: usize = 1 << 16;

/// Shares of the asked error that a bake is asked for: the rest is left to the samples and to what no stage sees.
const SHARES: [f64; 4] = [1.0, 0.6, 0.3, 0.1];

/// A way to bake, with what it is expected to cost.
pub(super) struct Candidate {
    pub(super) recipe: Recipe,
    /// Its family: candidates that differ in samples and asked error alone.
    pub(super) family: usize,
    pub(super) forecast: Forecast,
    /// Most memory that its bake takes and what it is held against, bytes.
    pub(super) memory: u64,
    /// Expected size of the file.
    pub(super) file_bytes: f64,
    /// Vertices of the scene.
    pub(super) vertices: usize,
    /// Place in the record.
    pub(super) entry: usize,
}

/// The candidates, and a family for each method and choice of keys, dropped ones among them.
pub(super) struct Candidates {
    pub(super) all: Vec<Candidate>,
    pub(super) considered: Vec<Considered>,
    pub(super) families: Vec<String>,
}

/// A method with a choice of its keys, and whether light from far away is precomputed where it asks for it.
struct Family {
    method: &'static dyn Method,
    keys: Vec<(String, String)>,
    with_environment: bool,
}

impl Candidates {
    /// Every way to bake that serves the request, as far as it can be told without work; `mesh_bytes` is what the mesh takes in the
    /// file, and `memory` what a bake may take. Where `between` is an error between vertices, only what serves points has none.
    pub(super) fn new(
        registry: &Registry,
        request: &Request,
        (scene, between): (&Scene, Option<VertexError>),
        (mesh_bytes, memory): (u64, u64),
    ) -> Self {
        let mut result = Self { all: Vec::new(), considered: Vec::new(), families: Vec::new() };
        for method in registry.methods() {
            for keys in method.planned() {
                let keys: Vec<(String, String)> =
                    keys.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
                for with_environment in [false, true] {
                    let family = Family { method: *method, keys: keys.clone(), with_environment };
                    if !with_environment && !family.has_choice(request, scene) {
                        continue;
                    }
                    result.add(&family, request, (scene, between), (mesh_bytes, memory));
                }
            }
        }
        result
    }

    fn add(
        &mut self,
        family: &Family,
        request: &Request,
        (scene, between): (&Scene, Option<VertexError>),
        (mesh_bytes, memory): (u64, u64),
    ) {
        let index = self.families.len();
        self.families.push(family.name(request));
        let unasked = request.max_rms_may_grow && request.model != Model::Dipole;
        let most = if unasked { MOST_UNASKED } else { usize::MAX };
        for (samples, share) in rungs().into_iter().filter(|(samples, _)| samples.is_none_or(|n| n <= most)) {
            let recipe = match family.recipe(request, samples, share) {
                Ok(recipe) => recipe,
                Err(refused) => {
                    // The same for every rung.
                    return self.drop_family(family, request, refused.message().to_owned());
                }
            };
            let served = recipe.form.kinds();
            if let Some(kind) = request.for_lights.iter().find(|kind| !served.contains(kind)) {
                let why = format!("does not serve {} light", kind.name());
                return self.drop_family(family, request, why);
            }
            if let Some(error) = between.filter(|_| !recipe.form.serves_points()) {
                let why =
                    format!("its radiosity ends at the vertices, and between them that is {} off", percent(error.rms));
                return self.drop_family(family, request, why);
            }
            let Some(forecast) = recipe.form.forecast(scene, &recipe.settings) else {
                return self.drop_family(family, request, "nothing is known of its costs".to_owned());
            };
            if !request.edit.allowed_by(forecast.material) {
                let why = format!("its material is baked in, and --edit {} is asked for", request.edit.name());
                return self.drop_family(family, request, why);
            }
            // What is tuned by the asked error needs no ladder of samples, and what samples decide none of shares beyond the first.
            if forecast.samples.is_none() != samples.is_none() {
                continue;
            }
            let mut entry = Considered::new(&recipe, &self.families[index], &forecast, mesh_bytes, request, scene);
            // The bake, and what it is held against.
            let judged = (request.max_rms, forecast.erring_samples().unwrap_or(0));
            let needed = recipe.bake_memory(scene) + truth::memory(scene, judged, request.model);
            let kept = needed <= memory;
            if !kept {
                entry.left = Some(Left::Memory);
                entry.why = format!("its bake and what it is held against take about {} of memory", megabytes(needed));
            }
            let file_bytes = mesh_bytes as f64 + forecast.bytes;
            if kept {
                let entry = self.considered.len();
                let vertices = scene.mesh.local_mm.len();
                self.all.push(Candidate {
                    recipe,
                    family: index,
                    forecast,
                    memory: needed,
                    file_bytes,
                    vertices,
                    entry,
                });
            }
            self.considered.push(entry);
        }
    }

    fn drop_family(&mut self, family: &Family, request: &Request, why: String) {
        self.considered.push(Considered::dropped(family.method.name(), &family.name(request), why));
    }
}

/// Numbers of samples and shares of the error, from few bytes to many.
fn rungs() -> Vec<(Option<usize>, f64)> {
    let tuned = SHARES.into_iter().map(|share| (None, share));
    let sampled = SAMPLES.flat_map(|power| SHARES[1..].iter().map(move |share| (Some(1usize << power), *share)));
    tuned.chain(sampled).collect()
}

impl Family {
    fn recipe(&self, request: &Request, samples: Option<usize>, share: f64) -> Result<Recipe> {
        let mut settings = BakeSettings::new(share * request.max_rms);
        settings.samples = samples;
        settings.samples_stored = request.samples_stored;
        settings.for_lights.clone_from(&request.for_lights);
        settings.model = request.model;
        if !self.with_environment {
            settings.for_lights.remove(&LightKind::Environment);
        }
        self.method.recipe(&self.keys, settings)
    }

    /// Returns whether it makes a difference that environments are precomputed: without them the form still serves them, by rays.
    fn has_choice(&self, request: &Request, scene: &Scene) -> bool {
        if !request.for_lights.contains(&LightKind::Environment) {
            return false;
        }
        let bytes = |with_environment: bool| {
            let family = Self { method: self.method, keys: self.keys.clone(), with_environment };
            let recipe = family.recipe(request, Some(1 << 14), 1.0).ok()?;
            let forecast = recipe.form.forecast(scene, &recipe.settings)?;
            recipe.form.kinds().contains(&LightKind::Environment).then_some(forecast.bytes)
        };
        matches!((bytes(false), bytes(true)), (Some(without), Some(with)) if without < with)
    }

    /// Method, keys that differ from the defaults, and what is left to rays.
    fn name(&self, request: &Request) -> String {
        let mut words = vec![self.method.name().to_owned()];
        words.extend(self.keys.iter().map(|(key, value)| format!("{key}={value}")));
        if !self.with_environment && request.for_lights.contains(&LightKind::Environment) {
            words.push("(environments by rays)".to_owned());
        }
        words.join(" ")
    }
}
