//! Real files, broken and whole, through the whole program: a clear error or a clean result, never anything else.
#![allow(clippy::unwrap_used, missing_docs)]

use std::path::{Path, PathBuf};

use crate::common::{Folder, Outcome, shared_data};

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path));
        } else {
            files.push(path);
        }
    }
    files.sort();
    files
}

fn is_model(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "obj" || e == "gltf" || e == "glb")
}

fn lit(folder: &Folder, file: &Path, size: &[&str]) -> Outcome {
    let mut words = vec!["reference", file.to_str().unwrap()];
    words.extend(size);
    words
        .extend("--material marble --light constant:radiance=1 --samples 64 --set directions=64 -o out.ply".split(' '));
    let _ = std::fs::remove_file(folder.path("out.ply"));
    folder.run_words(words)
}

/// A result is complete and finite, an error names the file and leaves nothing behind.
fn judge(folder: &Folder, file: &Path, outcome: &Outcome) {
    let name = file.file_name().unwrap().to_str().unwrap();
    if outcome.code == 0 {
        // The reader refuses what is not finite; light enters everywhere, so something must come out.
        let radiosity = folder.radiosity("out.ply");
        assert!(radiosity.iter().all(|b| b.min_element() >= 0.0), "{name}: negative radiosity");
        assert!(radiosity.iter().any(|b| b.min_element() > 0.0), "{name}: everything is black");
    } else {
        let (code, text) = (outcome.code, &outcome.stderr);
        assert!([2, 3, 5].contains(&code), "{name}: exit code {code}: {text}");
        assert!(text.contains(&format!("translux: {}", file.display())), "{name} is not named: {text}");
        assert_eq!(folder.names(), Vec::<String>::new(), "{name}");
    }
}

/// Files of the folder `bad` that its notes call valid.
fn valid(data: &Path) -> Vec<String> {
    let notes = std::fs::read_to_string(data.join("SOURCES.md")).unwrap();
    let bad = notes.split("## bad").nth(1).unwrap();
    let rows = bad.lines().filter(|line| line.starts_with('|'));
    let valid = rows.filter_map(|line| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        (cells[3].starts_with("VALID") && !cells[3].starts_with("VALID JSON")).then(|| cells[1].to_owned())
    });
    valid.collect()
}

#[test]
fn bad_files_give_an_error_or_a_clean_result() {
    let Some(data) = shared_data() else { return };
    let (bad, valid) = (data.join("bad"), valid(&data));
    assert!(valid.len() >= 4, "{valid:?}");
    let folder = Folder::new();
    let mut seen = 0;
    for file in files_below(&bad).iter().filter(|f| is_model(f)) {
        let name = file.strip_prefix(&bad).unwrap().to_str().unwrap().to_owned();
        let outcome = lit(&folder, file, &["--size-mm", "30"]);
        judge(&folder, file, &outcome);
        if valid.contains(&name) {
            assert_eq!(outcome.code, 0, "{name} is valid: {}", outcome.stderr);
            seen += 1;
        }
        let _ = std::fs::remove_file(folder.path("out.ply"));
        if name.ends_with(".gltf") || name.ends_with(".glb") {
            judge(&folder, file, &lit(&folder, file, &[]));
            let _ = std::fs::remove_file(folder.path("out.ply"));
        }
    }
    assert_eq!(seen, valid.len(), "not all of {valid:?} are there");
}

/// A vertex of a triangle, and what follows it.
const CORNERS: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";

/// The same of files that are made here: one of each kind of fault, each with its line or place in the message.
#[test]
fn made_faults_are_named_with_their_place() {
    let folder = Folder::new();
    let utf16: Vec<u8> =
        [0xfe, 0xff].into_iter().chain("v 0 0 0\n".encode_utf16().flat_map(u16::to_be_bytes)).collect();
    let table: [(&str, Vec<u8>, i32, &[&str]); 9] = [
        ("range.obj", format!("{CORNERS}f 1 2 7\n").into(), 3, &[".obj:5:", "vertex 7", "4"]),
        ("zero.obj", format!("{CORNERS}f 0 1 2\n").into(), 3, &[".obj:5:", "vertex 0"]),
        ("number.obj", format!("{CORNERS}v 1 3.1+e2 0\nf 1 2 3\n").into(), 3, &[".obj:5:", "3.1+e2"]),
        ("nan.obj", format!("v nan 0 0\n{CORNERS}f 1 2 3\n").into(), 3, &[".obj:6:", "not finite", "line 1"]),
        ("short.obj", format!("{CORNERS}f 1 2\n").into(), 3, &[".obj:5:", "2 corners"]),
        ("points.obj", CORNERS.into(), 3, &["4 vertices and no faces"]),
        ("empty.obj", Vec::new(), 3, &["empty"]),
        ("utf16.obj", utf16, 3, &["UTF-16", "UTF-8"]),
        ("empty.glb", Vec::new(), 3, &["empty"]),
    ];
    for (name, bytes, code, fragments) in table {
        folder.write(name, bytes);
        let file = folder.path(name);
        lit(&folder, &file, &["--size-mm", "30"]).fails(code, fragments).fails(code, &[file.to_str().unwrap()]);
        assert!(!folder.names().contains(&"out.ply".to_owned()), "{name}");
    }
    let odd = [
        ("negative.obj", format!("{CORNERS}f -4 -2 -3\nf -4 -3 -1\nf 1 4 3\nf 2 3 4")),
        ("degenerate.obj", format!("{CORNERS}f 1 1 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")),
        ("edge.obj", format!("{CORNERS}v 1 1 1\nf 1 3 2\nf 1 2 4\nf 1 2 5\n")),
        ("sheet.obj", format!("{CORNERS}f 1 2 3\nf 1 3 2\n")),
    ];
    for (name, text) in odd {
        folder.write(name, text);
        let outcome = lit(&folder, &folder.path(name), &["--size-mm", "30"]).ok();
        judge(&folder, &folder.path(name), &outcome);
    }
}

/// Faults that no program could repair, each with its line or place in the message.
#[test]
fn faults_are_named_with_their_place() {
    let Some(data) = shared_data() else { return };
    let folder = Folder::new();
    for (name, code, fragments) in [
        ("index_out_of_range.obj", 3, &[".obj:12:", "vertex 7", "6"][..]),
        ("zero_index.obj", 3, &[".obj:16:", "vertex 0"]),
        ("number_formats.obj", 3, &[".obj:11:", "3.1+e2"]),
        ("nan_vertices.obj", 3, &[".obj:27:", "not finite", "line 12"]),
        ("utf16be.obj", 3, &["UTF-16", "UTF-8"]),
        ("empty.glb", 3, &["empty"]),
        ("recursive_nodes.gltf", 3, &["node 0"]),
        ("missing_bin.gltf", 2, &["BoxTextured0.bin"]),
    ] {
        lit(&folder, &data.join("bad").join(name), &["--size-mm", "30"]).fails(code, fragments);
    }
}

#[test]
fn gltf_files_bake_in_their_own_size() {
    let Some(data) = shared_data() else { return };
    let folder = Folder::new();
    for file in files_below(&data.join("gltf")).iter().filter(|f| is_model(f)) {
        let name = file.strip_prefix(&data).unwrap().to_str().unwrap();
        let rest = "--material marble --samples 1024 --set directions=64 -o a.tlux";
        let outcome = folder
            .run_words(["bake", "--method", "two_pass", file.to_str().unwrap()].into_iter().chain(rest.split(' ')));
        if name.contains("Draco") || name.contains("meshopt") {
            outcome.fails(5, &["requires the extension", "decompress"]);
        } else if name.contains("json_only") {
            outcome.fails(2, &[".bin"]);
        } else {
            outcome.ok();
            if std::fs::metadata(file).unwrap().len() > 40_000 {
                continue;
            }
            folder.run("evaluate a.tlux --light constant:radiance=1 -o b.ply").ok();
            assert!(folder.radiosity("b.ply").iter().any(|b| b.min_element() > 0.0), "{name} is black");
        }
    }
}
