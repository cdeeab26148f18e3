//! Assets and radiosities that several tests look at, so that one process makes each of them once: the first test that asks does.

use std::sync::{Arc, Mutex, OnceLock};

use glam::DVec3;
use translux::asset::Asset;
use translux::evaluate::Method;
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::scene::Scene;

use crate::in_memory::{lit, method, opened, scene_of, short, try_bake};

/// One value of a shelf: what it is of, and the value once somebody has made it.
type Slot<K, T> = (K, Arc<OnceLock<Arc<T>>>);

/// Values by what they are of; different ones are made side by side.
pub(crate) struct Shelf<K, T>(Mutex<Vec<Slot<K, T>>>);

impl<K: PartialEq, T> Shelf<K, T> {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    pub(crate) fn get(&self, key: K, make: impl FnOnce() -> T) -> Arc<T> {
        let slot = {
            let mut slots = self.0.lock().unwrap();
            match slots.iter().find(|(k, _)| *k == key) {
                Some((_, slot)) => Arc::clone(slot),
                None => {
                    slots.push((key, Arc::default()));
                    Arc::clone(&slots.last().unwrap().1)
                }
            }
        };
        Arc::clone(slot.get_or_init(|| Arc::new(make())))
    }
}

/// Method, scene, samples, keys that are set.
type Bake = (String, Scene, usize, Vec<(String, String)>);

fn key(name: &str, scene: &Scene, samples: usize, set: &[&str]) -> Bake {
    let pairs = set.iter().map(|pair| pair.split_once('=').unwrap()).map(|(k, v)| (k.to_owned(), v.to_owned()));
    (name.to_owned(), scene.clone(), samples, pairs.collect())
}

/// The asset of a method with some keys set as `key=value`.
pub(crate) fn asset(name: &str, scene: &Scene, samples: usize, set: &[&str]) -> Arc<Asset> {
    static ASSETS: Shelf<Bake, Asset> = Shelf::new();
    let bake = key(name, scene, samples, set);
    let set = bake.3.clone();
    ASSETS.get(bake, || try_bake(method(name), scene.clone(), Some(samples), &set).unwrap())
}

/// The radiosity that such an asset gives under some lights.
pub(crate) fn radiosity(name: &str, scene: &Scene, samples: usize, set: &[&str], lights: &[Light]) -> Arc<Vec<DVec3>> {
    static VALUES: Shelf<(Bake, Vec<Light>), Vec<DVec3>> = Shelf::new();
    VALUES.get((key(name, scene, samples, set), lights.to_vec()), || {
        lit(opened(asset(name, scene, samples, set)).as_mut(), lights.to_vec())
    })
}

/// Two bodies of unlike media, and a slab that only casts shadows.
pub(crate) fn group() -> Scene {
    let called = |mut model: SourceModel, name: &str| {
        model.materials = vec![name.to_owned()];
        model
    };
    let wax = called(shapes::bumpy_head(8.0, 2), "wax");
    let soap = called(shapes::icosphere(5.0, 1), "soap");
    let slab = called(shapes::cuboid(DVec3::new(30.0, 1.0, 20.0), 3), "slab");
    let place = [DVec3::ZERO, DVec3::new(14.0, 1.0, 3.0), DVec3::new(6.0, -11.0, 0.0)];
    let model = shapes::compose(&[(wax, place[0]), (soap, place[1]), (slab, place[2])]);
    scene_of(model, Scale::MillimetresPerUnit(1.0), &[("wax", "marble"), ("soap", "skin1")])
}

/// A method, and its keys with their defaults.
type WithDefaults = (&'static str, Vec<(&'static str, &'static str)>);

/// That group under a method, of 1000 samples, or 500 where each receiver has its own; sets of lights and rows
/// of coefficients are small, since it is not their error that is measured with it.
pub(crate) fn of_group(method: &dyn Method) -> Arc<Asset> {
    static ASSETS: Shelf<WithDefaults, Asset> = Shelf::new();
    // Methods of one name differ in their defaults.
    let defaults = method.keys().iter().map(|key| (key.name(), key.default())).collect();
    ASSETS.get((method.name(), defaults), || {
        let has = |name: &str| method.keys().iter().any(|key| key.name() == name);
        let few = [("lights", "60"), ("coefficients", "100")].into_iter().filter(|(key, _)| has(key));
        let few = few.map(|(key, value)| (key.to_owned(), value.to_owned()));
        let samples = if has("sampling") { 500 } else { 1000 };
        let set: Vec<_> = short(method).into_iter().chain(few).collect();
        try_bake(method, group(), Some(samples), &set).unwrap()
    })
}
