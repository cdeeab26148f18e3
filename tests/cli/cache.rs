//! `bake --cache`: what stages left is taken by later bakes of the same model, and the asset is the same with and without it.

use std::path::PathBuf;

use serde_json::{Value, json};
use translux::geometry::shapes;

use crate::common::Folder;

/// Entries of a cache.
fn entries(folder: &Folder, name: &str) -> Vec<PathBuf> {
    let all = std::fs::read_dir(folder.path(name)).unwrap().map(|entry| entry.unwrap().path());
    all.filter(|path| path.extension().is_some_and(|suffix| suffix == "stage")).collect()
}

#[test]
fn a_bake_takes_from_the_cache_what_does_not_depend_on_the_material() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(1.0, 2));
    let bake = |material: &str, more: &str| -> (Vec<u8>, Value) {
        let line = format!(
            "bake head.obj --size-mm 20 --material {material} --method editable --samples 150 --set coefficients=16 \
             --for-lights environment {more} -q --json -o a.tlux"
        );
        let report = folder.run(&line).ok().json();
        (folder.read("a.tlux"), report["timings"]["reused"].clone())
    };
    let (both, rows) = (json!(["irradiance rows", "environment errors"]), json!(["irradiance rows"]));
    let (plain, reused) = bake("skin1", "");
    assert_eq!(reused, Value::Null);
    assert_eq!(bake("skin1", "--cache c"), (plain.clone(), Value::Null));
    assert_eq!(bake("skin1", "--cache c"), (plain.clone(), both.clone()));
    // Another material of this refractive index; one of another has rays of its own.
    assert_eq!(bake("wholemilk", "--cache c"), (bake("wholemilk", "").0, both.clone()));
    assert_eq!(bake("marble", "--cache c"), (bake("marble", "").0, rows));
    // Damaged entries are made again, and not trusted.
    for path in entries(&folder, "c") {
        let mut bytes = std::fs::read(&path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(&path, bytes).unwrap();
    }
    assert_eq!(bake("skin1", "--cache c"), (plain.clone(), Value::Null));
    assert_eq!(bake("skin1", "--cache c"), (plain.clone(), both));
    // Two at once, of a cache that is empty.
    let at_once = |name: &str| {
        let line = format!(
            "bake head.obj --size-mm 20 --material skin1 --method editable --samples 150 --set coefficients=16 --for-lights environment \
             --cache empty -q -o {name}"
        );
        folder.run(&line).ok();
        folder.read(name)
    };
    let two = std::thread::scope(|scope| {
        ["b.tlux", "c.tlux"].map(|name| scope.spawn(move || at_once(name))).map(|t| t.join().unwrap())
    });
    assert!(two.iter().all(|bytes| *bytes == plain));
    assert_eq!(entries(&folder, "empty").len(), 2);
    // A cache without room keeps nothing, and that is no fault.
    assert_eq!(bake("skin1", "--cache small --cache-size 100B"), (plain, Value::Null));
    assert!(entries(&folder, "small").is_empty());
    let line = "bake head.obj --size-mm 20 --material skin1 -o a.tlux";
    folder.run(&format!("{line} --cache head.obj")).fails(2, &["head.obj"]);
    folder.run(&format!("{line} --cache c --cache-size 4")).fails(1, &["--cache-size 4: a unit is needed"]);
    folder.run(&format!("{line} --cache-size 4GiB")).fails(1, &["--cache"]);
}
