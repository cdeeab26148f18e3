//! The layers of the crate: every path in `src/` points downwards, and no files import each other in a circle.
//!
//! The checker reads source text, so that the planted violations below go through the same code as the real tree.
//! What it sees: `use` in all its forms, paths in expressions, types, patterns and attributes, paths in the tokens of
//! macros and in the strings of attributes (`#[serde(with = "...")]`). Doc comments may name anything.

#![allow(clippy::unwrap_used)]

#[path = "layers/checker.rs"]
mod checker;
#[path = "layers/circles.rs"]
mod circles;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use checker::{Rule, check};
use circles::{Crate, Source, circles};

/// What the asset's crate must do without, beside everything of ours: an engine links it alone.
const HEAVY: [&str; 3] = ["glam", "wgpu", "rayon"];

/// A crate's source files, with what is wrong about its layers.
struct Tree {
    problems: Vec<String>,
    sources: Vec<(Vec<String>, Source)>,
}

impl Tree {
    /// The circles of imports between the files.
    fn circles(&self) -> Vec<(Vec<String>, String)> {
        circles(&Crate::new(&self.sources).dependencies())
    }
}

/// Checks the tree below `root` from its `lib.rs` and `main.rs`; every source file must be reached.
fn check_tree(root: &Path) -> Tree {
    let mut problems = Vec::new();
    let mut reached = BTreeSet::new();
    let mut read = Vec::new();
    let mut open = vec![(PathBuf::from("lib.rs"), Vec::new())];
    if root.join("main.rs").is_file() {
        open.push((PathBuf::from("main.rs"), Vec::new()));
    }
    while let Some((file, module)) = open.pop() {
        let source = std::fs::read_to_string(root.join(&file)).unwrap();
        let name = file.to_str().unwrap().replace('\\', "/");
        // The program's entry point names the library by its crate: nothing depends on it.
        if name != "main.rs" {
            read.push((module.clone(), Source::read(&name, &module, &source)));
        }
        let module: Vec<&str> = module.iter().map(String::as_str).collect();
        let report = check(&name, &module, &source);
        problems.extend(report.violations.iter().map(ToString::to_string));
        for declared in report.declared {
            match declared.candidates.iter().find(|c| root.join(c).is_file()) {
                Some(next) => open.push((next.clone(), declared.module)),
                None => problems.push(format!("src/{name}:{}: no file for `{:?}`", declared.line, declared.module)),
            }
        }
        reached.insert(file);
    }
    for file in sources(root) {
        let below = file.strip_prefix(root).unwrap();
        if !reached.contains(below) {
            problems.push(format!("src/{}:1: no module declares this file", below.display()));
        }
    }
    Tree { problems, sources: read }
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// What the asset's crate must not depend on, in its manifest (names of `[workspace.dependencies]` looked up in `root`).
fn check_format_manifest(manifest: &str, root: &str) -> Vec<String> {
    let (manifest, root): (toml::Table, toml::Table) =
        (toml::from_str(manifest).unwrap(), toml::from_str(root).unwrap());
    let shared = root.get("workspace").and_then(|w| w.get("dependencies")).and_then(toml::Value::as_table);
    let mut tables = vec![&manifest];
    if let Some(targets) = manifest.get("target").and_then(toml::Value::as_table) {
        tables.extend(targets.values().filter_map(toml::Value::as_table));
    }
    let kinds = ["dependencies", "dev-dependencies", "build-dependencies"];
    let dependencies = tables.iter().flat_map(|t| kinds.iter().filter_map(|k| t.get(*k)?.as_table())).flatten();
    let mut problems = Vec::new();
    for (name, value) in dependencies {
        let inherited = value.get("workspace").and_then(toml::Value::as_bool) == Some(true);
        let value = if inherited { shared.and_then(|s| s.get(name)).unwrap_or(value) } else { value };
        let package = value.get("package").and_then(toml::Value::as_str).unwrap_or(name);
        if value.get("path").is_some() || value.get("git").is_some() || package.starts_with("translux") {
            problems.push(format!("formats/Cargo.toml: `{name}` is not from the registry"));
        }
        if HEAVY.contains(&package) {
            problems.push(format!("formats/Cargo.toml: `{package}` is what an engine should not have to link"));
        }
    }
    problems
}

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Both at once: reading the tree is what takes the time.
#[test]
fn imports_of_the_tree_point_downwards_and_never_in_a_circle() {
    let tree = check_tree(&repository().join("src"));
    let problems = &tree.problems;
    assert!(problems.is_empty(), "{} problems:\n{}", problems.len(), problems.join("\n"));
    let found = tree.circles();
    let texts: Vec<&str> = found.iter().map(|(_, text)| text.as_str()).collect();
    assert!(texts.is_empty(), "{} circles of imports in src/:{}", texts.len(), texts.join("\n"));
}

#[test]
fn no_files_of_the_format_import_each_other_in_a_circle() {
    // The layers are the baker's; its rules about them do not apply here.
    let found = check_tree(&repository().join("formats/src")).circles();
    let texts: Vec<&str> = found.iter().map(|(_, text)| text.as_str()).collect();
    assert!(texts.is_empty(), "{} circles of imports in formats/src/:{}", texts.len(), texts.join("\n"));
}

#[test]
fn the_format_depends_on_nothing_of_ours() {
    let read = |p: &str| std::fs::read_to_string(repository().join(p)).unwrap();
    let problems = check_format_manifest(&read("formats/Cargo.toml"), &read("Cargo.toml"));
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    for file in sources(&repository().join("formats/src")) {
        let source = std::fs::read_to_string(&file).unwrap();
        assert!(!source.contains("translux::"), "{}: names the baker", file.display());
    }
}

/// Lines and rules found in a planted source.
fn planted(file: &str, source: &str) -> Vec<(usize, Rule)> {
    let stem = file.strip_suffix(".rs").unwrap();
    let module: Vec<&str> = match stem {
        "lib" | "main" => Vec::new(),
        _ => stem.strip_suffix("/mod").unwrap_or(stem).split('/').collect(),
    };
    check(file, &module, source).violations.iter().map(|v| (v.line, v.rule)).collect()
}

#[test]
fn clean_sources_pass() {
    let light = "//! See [`crate::commands`].\n\
        use std::fmt;\n\
        use crate::error::{Error, Result};\n\
        use crate::{math, medium::fresnel as f};\n\
        use super::sky::{self, *};\n\
        pub use self::inner::Public;\n\
        pub(crate) use super::sky::Sky;\n\
        /// [`crate::render`] shows it.\n\
        #[derive(Debug)]\n\
        pub(in crate::light) struct A(crate::geometry::mesh::Mesh, super::super::math::Random);\n\
        mod inner { use super::super::Light; pub(super) fn f() { super::super::super::error::g(); } }\n\
        fn f() { assert_eq!(crate::math::one(), vec![super::sky::two::<u8>()], \"crate::commands::x\"); }\n";
    assert_eq!(planted("light/parse.rs", light), []);
    assert_eq!(planted("commands/mod.rs", "use crate::{asset, render, measure, methods::two_pass::bake};\n"), []);
    assert_eq!(planted("methods/two_pass/evaluate.rs", "use crate::evaluate::Evaluator;\nuse super::Basis;\n"), []);
    assert_eq!(planted("methods/two_pass/bake.rs", "use crate::io::x;\n"), []);
    assert_eq!(planted("main.rs", "fn main() { translux::commands::run(translux::error::x()); }\n"), []);
    assert_eq!(
        planted("lib.rs", "//! Docs.\n#![warn(missing_docs)]\npub mod error;\npub mod math;\npub mod commands;\n"),
        []
    );
}

#[test]
fn planted_upward_imports_are_found() {
    use Rule::Upward;
    let up = |file: &str, source: &str| planted(file, source);
    assert_eq!(up("math/mod.rs", "\nuse crate::light::Light;\n"), [(2, Upward)]);
    assert_eq!(up("io/ply.rs", "use crate::error::Error;\n\nuse super::super::asset::Asset;\n"), [(3, Upward)]);
    assert_eq!(up("math/mod.rs", "use super::medium;\n"), [(1, Upward)]);
    assert_eq!(up("math/mod.rs", "use self::super::medium;\n"), [(1, Upward)]);
    assert_eq!(up("math/random.rs", "fn f() {\n    let x = crate::io::read();\n}\n"), [(2, Upward)]);
    assert_eq!(up("math/random.rs", "struct S {\n    a: Vec<Option<crate::io::A>>,\n}\n"), [(2, Upward)]);
    assert_eq!(up("math/random.rs", "fn f(\n x: &dyn crate::evaluate::E<u8>) {}\n"), [(2, Upward)]);
    assert_eq!(up("math/random.rs", "fn f<T>() where\n T: crate::evaluate::E {}\n"), [(2, Upward)]);
    assert_eq!(up("math/random.rs", "impl\n crate::evaluate::E for u8 {}\n"), [(2, Upward)]);
    assert_eq!(up("math/random.rs", "fn f(x: u8) { match x {\n crate::asset::A => 1, _ => 2 }; }\n"), [(2, Upward)]);
    let group = "use crate::{\n    error::Error,\n    math::{self, random},\n    geometry::{mesh::{\n        Mesh as M,\n    }},\n};\n";
    assert_eq!(up("medium/mod.rs", group), [(5, Upward)]);
    assert_eq!(up("medium/mod.rs", "use crate::geometry::*;\n"), [(1, Upward)]);
    assert_eq!(up("medium/mod.rs", "use crate::geometry as g;\n"), [(1, Upward)]);
    assert_eq!(up("medium/mod.rs", "use crate::{geometry as g};\n"), [(1, Upward)]);
    assert_eq!(up("medium/mod.rs", "use crate::{geometry::{self}};\n"), [(1, Upward)]);
    assert_eq!(up("render/mod.rs", "use crate::measure::flip;\n"), [(1, Upward)]);
    assert_eq!(up("progress.rs", "use crate::math;\n"), [(1, Upward)]);
    assert_eq!(up("main.rs", "fn main() {}\nuse translux::geometry::mesh::Mesh;\n"), [(2, Upward)]);
    assert_eq!(up("main.rs", "fn main() {\n ::translux::io::read(); }\n"), [(2, Upward)]);
}

#[test]
fn planted_upward_imports_inside_modules_and_functions_are_found() {
    use Rule::Upward;
    let tests = "fn f() {}\n#[cfg(test)]\nmod tests {\n    use super::*;\n    use crate::transport::gather;\n}\n";
    assert_eq!(planted("light/sky.rs", tests), [(5, Upward)]);
    // `super` counts from the inline module.
    let inner = "mod a {\n    use super::super::super::transport::x;\n    use super::super::transport::y;\n}\n";
    assert_eq!(planted("light/sky.rs", inner), [(2, Upward)]);
    assert_eq!(planted("light/sky.rs", "fn f() {\n    use crate::asset::Asset;\n}\n"), [(2, Upward)]);
    // A test file beside its module: `super` counts from the module's path, not from the file's.
    let module = ["light", "parse", "tests"];
    let found = check("light/parse_tests.rs", &module, "use super::super::super::render::Camera;\n").violations;
    assert_eq!(found.len(), 1);
    assert_eq!(
        found[0].to_string(),
        "src/light/parse_tests.rs:1: from `light` to `render::Camera`: imports point downwards only"
    );
}

#[test]
fn planted_upward_paths_in_macros_and_attributes_are_found() {
    use Rule::{Hidden, Upward};
    let up = |source: &str| planted("math/mod.rs", source);
    assert_eq!(up("fn f() {\n    println!(\"{}\",\n        crate::io::x());\n}\n"), [(3, Upward)]);
    assert_eq!(up("fn f() {\n    assert!(g(&[super::io::x]));\n}\n"), [(2, Upward)]);
    assert_eq!(up("macro_rules! m { () => {\n    $crate::io::x()\n}; }\n"), [(2, Upward)]);
    assert_eq!(up("m! {\n    use crate::{math::a,\n        io::{b}};\n}\n"), [(3, Upward)]);
    assert_eq!(up("m! { use crate::{\n io as i}; }\n"), [(2, Upward)]);
    assert_eq!(up("macro_rules! m { ($l:ident) => {\n    crate::$l::x()\n}; }\n"), [(2, Hidden)]);
    assert_eq!(up("crate::io::m!();\n"), [(1, Upward)]);
    assert_eq!(up("#[derive(A,\n crate::io::B)]\nstruct S;\n"), [(2, Upward)]);
    assert_eq!(up("#[crate::io::b]\nstruct S;\n"), [(1, Upward)]);
    assert_eq!(up("#[command(name = \"translux\")]\nstruct S;\n"), []);
    assert_eq!(up("struct S {\n    #[serde(with = \"crate::io::x\")]\n    a: u8,\n}\n"), [(2, Upward)]);
    assert_eq!(up("include!(\"../io/ply.rs\");\n"), [(1, Hidden)]);
    assert_eq!(up("#[path = \"../io/ply.rs\"]\nmod ply;\n"), [(2, Hidden)]);
    assert_eq!(up("extern crate self as me;\n"), [(1, Hidden)]);
    assert_eq!(up("fn f() {\n    let = ;\n}\n"), [(2, Hidden)]);
}

#[test]
fn planted_re_exports_roots_and_unplaced_modules_are_found() {
    use Rule::{Order, ReExport, Root, Unplaced, Upward};
    assert_eq!(planted("light/mod.rs", "pub use crate::math::random;\n"), [(1, ReExport)]);
    assert_eq!(planted("light/mod.rs", "pub(crate) use super::math::*;\n"), [(1, ReExport)]);
    assert_eq!(planted("light/mod.rs", "pub use crate::io::x;\n"), [(1, Upward), (1, ReExport)]);
    assert_eq!(planted("light/mod.rs", "use crate as root;\n"), [(1, Root)]);
    assert_eq!(planted("light/mod.rs", "use crate::*;\n"), [(1, Root)]);
    assert_eq!(planted("light/mod.rs", "use super::*;\n"), [(1, Root)]);
    assert_eq!(planted("light/sky.rs", "use super::super::{self as root};\n"), [(1, Root)]);
    assert_eq!(planted("light/mod.rs", "m! { use crate::*; }\n"), [(1, Root)]);
    assert_eq!(planted("main.rs", "use translux as t;\n"), [(1, Root)]);
    assert_eq!(planted("light/mod.rs", "use crate::helpers::x;\n"), [(1, Unplaced)]);
    assert_eq!(planted("helpers.rs", "use crate::error::Error;\n"), [(1, Unplaced)]);
    assert_eq!(planted("lib.rs", "pub mod error;\npub mod helpers;\n"), [(2, Unplaced)]);
    assert_eq!(planted("lib.rs", "pub mod math;\npub mod error;\n"), [(2, Order)]);
    assert_eq!(planted("lib.rs", "pub mod math;\npub mod math;\n"), [(2, Order)]);
    assert_eq!(planted("lib.rs", "pub mod error;\nmod math;\n"), [(2, Order)]);
    assert_eq!(planted("lib.rs", "pub mod error;\nfn f() {}\n"), [(2, Order)]);
    assert_eq!(planted("lib.rs", "pub mod error;\npub struct S;\n"), [(2, Order)]);
    assert_eq!(planted("lib.rs", "pub fn f() {}\npub mod error;\n"), [(1, Order)]);
    assert_eq!(planted("lib.rs", "pub mod error;\nuse error::Error;\npub fn f() -> Result<(), Error> {}\n"), []);
    assert_eq!(planted("lib.rs", "pub mod error;\npub use error::Error;\n"), []);
    assert_eq!(planted("light/mod.rs", "use crate::Light;\n"), [(1, Unplaced)]);
}

#[test]
fn planted_reading_at_run_time_is_found() {
    use Rule::{RunTime, Upward};
    assert_eq!(planted("evaluate/sampled.rs", "use crate::io::ply;\n"), [(1, RunTime)]);
    assert_eq!(planted("evaluate/mod.rs", "fn f() {\n    crate::io::ply::read();\n}\n"), [(2, RunTime)]);
    let both = [(1, Upward), (1, RunTime)];
    assert_eq!(planted("evaluate/mod.rs", "use crate::forms::factored::bake::Baked;\n"), both);
    assert_eq!(planted("forms/factored/evaluate.rs", "use super::bake::Baked;\n"), [(1, RunTime)]);
    assert_eq!(planted("forms/factored/gpu.rs", "use super::{\n    Basis,\n    bake};\n"), [(3, RunTime)]);
    assert_eq!(planted("forms/factored/gpu/kernel.rs", "use crate::io;\n"), [(1, RunTime)]);
    assert_eq!(planted("forms/factored/evaluate.rs", "use super::*;\n"), [(1, RunTime)]);
    assert_eq!(
        planted("forms/factored/evaluate.rs", "fn f() { m!(crate::forms::gathered::bake::x) }\n"),
        [(1, RunTime)]
    );
    assert_eq!(planted("forms/gathered/nets_gpu.rs", "use super::bake::Baked;\n"), [(1, RunTime)]);
    assert_eq!(planted("forms/projected/lights/evaluate.rs", "use super::bake::Baked;\n"), [(1, RunTime)]);
    assert_eq!(planted("forms/factored/settings.rs", "use super::bake::Baked;\n"), []);
}

#[test]
fn planted_methods_in_a_viewer_are_found() {
    let source = "use crate::evaluate::Evaluator;\nuse crate::methods::two_pass;\n";
    assert_eq!(planted("render/mod.rs", source), [(2, Rule::Concrete)]);
    assert_eq!(planted("measure/mod.rs", source), []);
}

#[test]
fn planted_dependencies_of_the_format_are_found() {
    let root = "[workspace.dependencies]\nzstd = \"0.14\"\nours = { path = \"x\" }\nmaths = { version = \"1\", package = \"glam\" }\n";
    let count = |manifest: &str| check_format_manifest(manifest, root).len();
    assert_eq!(count("[dependencies]\nzstd = { workspace = true }\nserde = \"1\"\n"), 0);
    assert_eq!(count("[dependencies]\nglam = \"0.34\"\n"), 1);
    assert_eq!(count("[dependencies]\nmaths = { workspace = true }\n"), 1);
    assert_eq!(count("[dependencies]\nours = { workspace = true }\n"), 1);
    assert_eq!(count("[dev-dependencies]\ntranslux = { path = \"..\" }\n"), 1);
    assert_eq!(count("[build-dependencies]\nr = { version = \"1\", package = \"rayon\" }\n"), 1);
    assert_eq!(count("[target.'cfg(unix)'.dependencies]\nwgpu = \"30\"\n"), 1);
}

#[test]
fn a_file_without_a_module_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    write("lib.rs", "pub mod math;\n");
    write("main.rs", "fn main() {}\n");
    write("math/mod.rs", "mod a;\n#[path = \"beside.rs\"]\nmod b;\n");
    write("math/a.rs", "mod inner { mod deep; }\n");
    write("math/a/inner/deep.rs", "use super::super::super::super::math;\n");
    write("math/beside.rs", "use super::super::math;\n");
    assert_eq!(check_tree(folder.path()).problems, Vec::<String>::new());
    write("math/lost.rs", "");
    write("math/beside.rs", "use super::super::io;\nmod none;\n");
    let problems = check_tree(folder.path()).problems;
    assert_eq!(problems.len(), 3, "{problems:?}");
    assert!(problems[0].starts_with("src/math/beside.rs:1: from `math` to `io`"), "{problems:?}");
    assert!(problems[1].starts_with("src/math/beside.rs:2: no file for"), "{problems:?}");
    assert!(problems[2].starts_with("src/math/lost.rs:1: no module"), "{problems:?}");
}

/// The circles of a planted crate: `(file, source)`, the file's module from its name.
fn planted_circles(files: &[(&str, &str)]) -> Vec<Vec<String>> {
    let sources: Vec<(Vec<String>, Source)> = files
        .iter()
        .map(|(file, text)| {
            let stem = file.strip_suffix(".rs").unwrap();
            let module: Vec<String> = match stem.strip_suffix("/mod").unwrap_or(stem) {
                "lib" => Vec::new(),
                folder => folder.split('/').map(String::from).collect(),
            };
            let source = Source::read(file, &module, text);
            (module, source)
        })
        .collect();
    circles(&Crate::new(&sources).dependencies()).into_iter().map(|(files, _)| files).collect()
}

#[test]
fn planted_circles_are_found() {
    let both = vec![vec!["light/a.rs".to_string(), "light/b.rs".to_string()]];
    let two = |a: &str, b: &str| {
        planted_circles(&[("light/mod.rs", "pub mod a; mod b;"), ("light/a.rs", a), ("light/b.rs", b)])
    };
    let (def_a, def_b) = ("pub struct A;\n", "pub struct B; pub fn b() {}\n");
    let a_to_b = [
        "use super::b::B;",
        "use crate::light::b::{self, B};",
        "use super::{b::*};",
        "use super::b; fn f() { b::b(); }",
        "use super::b as other; fn f(x: other::B) {}",
        "fn f() { super::b::b(); }",
        "fn f() { use crate::light::b::b; }",
        "fn f() -> crate::light::b::B { todo!() }",
        "fn f() { println!(\"{}\", super::b::b()); }",
        "mod inner { use super::super::b::B; }",
        "macro_rules! m { () => { $crate::light::b::b() }; }",
        "struct S { #[serde(with = \"crate::light::b\")] x: u8 } use super::b::b as _;",
        "struct S { #[serde(default = \"super::b::b\")] x: u8 }",
    ];
    for text in a_to_b {
        let a = format!("{def_a}{text}");
        assert_eq!(two(&a, &format!("use super::a::A;\n{def_b}")), both, "{text}");
        assert!(two(&a, def_b).is_empty(), "{text}");
    }
    // Three files, and files of sub-folders.
    let three = planted_circles(&[
        ("lib.rs", "pub mod light;"),
        ("light/mod.rs", "mod a; mod b; mod deep;"),
        ("light/a.rs", "use super::b::B; pub struct A;"),
        ("light/b.rs", "use super::deep::c::C; pub struct B;"),
        ("light/deep/mod.rs", "pub mod c;"),
        ("light/deep/c.rs", "use super::super::a::A; pub struct C;"),
    ]);
    assert_eq!(three, [["light/a.rs", "light/b.rs", "light/deep/c.rs"]]);
}

#[test]
fn planted_circles_through_a_mod_rs_are_found() {
    let folder = |parent: &str, a: &str, b: &str| {
        planted_circles(&[("lib.rs", "pub mod light;"), ("light/mod.rs", parent), ("light/a.rs", a), ("light/b.rs", b)])
    };
    let a = "use super::Shared; pub struct A; pub fn a() {}";
    let through = [["light/a.rs", "light/mod.rs"]];
    assert_eq!(folder("mod a; mod b; use a::A; pub struct Shared(A);", a, ""), through);
    assert_eq!(folder("mod a; mod b; pub use self::a::A; pub struct Shared(A);", a, ""), through);
    assert_eq!(folder("mod a; mod b; pub use a::*; pub struct Shared(A);", a, ""), through);
    assert_eq!(folder("mod a; mod b; pub struct Shared; fn f() { a::a(); }", a, ""), through);
    assert_eq!(folder("mod a; mod b; pub struct Shared; fn f() { vec![self::a::a()]; }", a, ""), through);
    // A re-export stands for the file that defines the name.
    let parent = "mod a; mod b; pub use a::A; pub use b::{B, C as Other}; pub struct Shared;";
    assert!(folder(parent, a, "pub struct B; pub struct C;").is_empty());
    assert!(folder(parent, "pub struct A;", "use super::A; pub struct B; pub struct C;").is_empty());
    let children = [["light/a.rs", "light/b.rs"]];
    assert_eq!(folder(parent, "use super::B; pub struct A;", "use super::A; pub struct B;"), children);
    assert_eq!(
        folder(parent, "use super::Other; pub struct A;", "use super::A; pub struct B; pub struct C;"),
        children
    );
    assert_eq!(
        folder("mod a; mod b; pub use b::*;", "pub struct A; use super::B;", "use super::a::A; pub struct B;"),
        children
    );
}

#[test]
fn tests_are_no_part_of_a_circle() {
    let light = |a: &str, rest: &[(&str, &str)]| {
        let mut files = vec![
            ("light/mod.rs", "mod a; mod b;"),
            ("light/a.rs", a),
            ("light/b.rs", "use super::a::A; pub struct B;"),
        ];
        files.extend(rest);
        planted_circles(&files)
    };
    assert!(light("pub struct A; #[cfg(test)] mod tests { use super::super::b::B; }", &[]).is_empty());
    assert!(light("pub struct A; #[cfg(test)] use super::b::B;", &[]).is_empty());
    assert!(
        light("pub struct A; #[cfg(all(test, feature = \"gpu\"))] pub(crate) fn f(_: super::b::B) {}", &[]).is_empty()
    );
    let beside = [("light/a/tests.rs", "use super::super::b::B; use super::A;")];
    assert!(light("pub struct A; #[cfg(test)]\n#[path = \"a_tests.rs\"]\nmod tests;", &beside).is_empty());
    assert_eq!(light("pub struct A; #[cfg(test)] use x::y; use super::b::B;", &[]).len(), 1);
    assert_eq!(light("pub struct A; #[cfg(not(test))] use super::b::B;", &[]).len(), 1);
    assert_eq!(light("pub struct A; #[cfg(test)] mod tests { } fn f() { super::b::f(); }", &[]).len(), 1);
}

#[test]
fn a_planted_circle_in_a_folder_of_files_is_found() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("math")).unwrap();
    let files = [
        ("lib.rs", "pub mod math;\n"),
        ("math/mod.rs", "pub mod a;\n#[path = \"beside.rs\"]\npub mod b;\n"),
        ("math/a.rs", "pub fn a() {\n    super::b::b();\n}\n"),
        ("math/beside.rs", "pub fn b() {\n    crate::math::a::a();\n}\n"),
    ];
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let tree = check_tree(folder.path());
    assert!(tree.problems.is_empty());
    let found = tree.circles();
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].0, ["math/a.rs", "math/beside.rs"]);
    let causes =
        "\n  math/a.rs:2: `super::b::b` is in math/beside.rs\n  math/beside.rs:2: `crate::math::a::a` is in math/a.rs";
    assert_eq!(found[0].1, causes);
}
