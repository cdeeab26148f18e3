//! Assets and radiosities that several tests look at, so that one process makes each of them once: the first test that asks does.

use std::sync::{Arc, Mutex, OnceLock};

use glam::DVec3;
use translux::asset::Asset;
use translux::light::Light;
use translux::transport::scene::Scene;

use crate::in_memory::{lit, method, opened, try_bake};

/// One value of a shelf: what it is of, and the value once somebody has made it.
type Slot<K, T> = (K, Arc<OnceLock<Arc<T>>>);

/// Values by what they are of; different ones are made side by side.
struct Shelf<K, T>(Mutex<Vec<Slot<K, T>>>);

impl<K: PartialEq, T> Shelf<K, T> {
    const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    fn get(&self, key: K, make: impl FnOnce() -> T) -> Arc<T> {
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
