//! Broken variants of valid files.

use std::time::{Duration, Instant};

use super::super::read_bytes;
use super::{check_promises, feature_files, glb};
use crate::io::reader_tests::shared_data;
use crate::math::random;

/// One broken variant of a file: cut, flipped bytes, or changed numbers in the JSON, chosen by `index`.
fn mutate(bytes: &[u8], index: u64) -> Vec<u8> {
    let pick = |dimension: u64, below: usize| (random::bits(0x6174_6c67, index, dimension) % below as u64) as usize;
    let mut out = bytes.to_vec();
    let is_glb = bytes.starts_with(b"glTF");
    let json_length = if is_glb { u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize } else { bytes.len() };
    let json_start = if is_glb { 20 } else { 0 };
    match pick(0, 8) {
        0 => out.truncate(pick(1, bytes.len())),
        1 | 2 => {
            for flip in 0..=pick(1, 4) as u64 {
                out[pick(2 + 2 * flip, bytes.len())] ^= 1 << pick(3 + 2 * flip, 8);
            }
        }
        3 => {
            for flip in 0..=pick(1, 3) as u64 {
                out[json_start + pick(2 + 2 * flip, json_length)] = pick(3 + 2 * flip, 256) as u8;
            }
        }
        _ => {
            // Another number in place of one of the JSON's: the syntax stays valid, the meaning does not.
            const NUMBERS: &str =
                "0 1 2 3 7 255 5121 5123 5126 65535 1048576 4294967295 -1 1e300 18446744073709551615 0.5";
            let numbers: Vec<&str> = NUMBERS.split(' ').collect();
            let json = &bytes[json_start..json_start + json_length];
            let digit = |i: usize| json[i].is_ascii_digit() || b".-+eE".contains(&json[i]);
            let starts: Vec<usize> = (1..json_length)
                .filter(|&i| json[i].is_ascii_digit() && !digit(i - 1) && b":[, ".contains(&json[i - 1]))
                .collect();
            let mut new_json = json.to_vec();
            if !starts.is_empty() {
                let start = starts[pick(1, starts.len())];
                let end = (start..json_length).find(|&i| !digit(i)).unwrap_or(json_length);
                new_json.splice(start..end, numbers[pick(2, numbers.len())].bytes());
            }
            out = match is_glb {
                true => glb(&new_json, bytes.get(json_start + json_length + 8..).unwrap_or_default()),
                false => new_json,
            };
        }
    }
    out
}

#[test]
fn ten_thousand_mutations_never_panic_and_keep_every_promise() {
    let mut originals = feature_files();
    if let Some(data) = shared_data("") {
        for name in [
            "SimpleInstancing.glb",
            "box_sparse.glb",
            "BoxInterleaved.glb",
            "gltf_primitives.glb",
            "SimpleMeshes.gltf",
            "SimpleSparseAccessor.gltf",
            "TriangleWithoutIndices.gltf",
            "Duck/Duck.gltf",
            "DuckQuantized/Duck.gltf",
        ] {
            let path = data.join("gltf").join(name);
            originals.push((std::fs::read(&path).unwrap(), path));
        }
    }
    let (mut accepted, mut slowest) = (0, Duration::ZERO);
    for index in 0..10_000u64 {
        let (bytes, path) = &originals[index as usize % originals.len()];
        let mutated = mutate(bytes, index);
        let start = Instant::now();
        let result = read_bytes(&mutated, path);
        slowest = slowest.max(start.elapsed());
        match result {
            Ok(model) => {
                accepted += 1;
                check_promises(&model);
                // No original has more than a few thousand vertices, and nothing stands for many by one number.
                assert!(model.positions.len() <= 1 << 17, "mutation {index}: {}", model.positions.len());
            }
            Err(error) => assert!(!error.message().is_empty()),
        }
    }
    println!("{accepted} of 10000 accepted, slowest {slowest:?}");
    assert!((500..9500).contains(&accepted), "{accepted}");
    assert!(slowest < Duration::from_secs(2), "{slowest:?}");
}
