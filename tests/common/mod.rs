//! What the tests of the command line share: a folder of its own for each test, small models, the program's outcome.
#![allow(clippy::unwrap_used, missing_docs, dead_code, unreachable_pub)]

pub mod schema;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use glam::DVec3;
use serde_json::Value;
use translux::geometry::source::SourceModel;
use translux::io::ply::{PlyVertexTable, read_ply};
use translux::io::png::{PngImage, decode_png};

/// No run of these tests takes nearly this long; one that does hangs.
const LIMIT: Duration = Duration::from_secs(120);

/// A folder that is removed at the end of its test; every run happens in it.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> &Self {
        std::fs::write(self.path(name), bytes).unwrap();
        self
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub fn obj(&self, name: &str, model: &SourceModel) -> &Self {
        self.write(name, obj_text(model))
    }

    pub fn png(&self, name: &str) -> PngImage {
        decode_png(&self.read(name)).unwrap()
    }

    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Runs the program with the words of `line` as its arguments.
    pub fn run(&self, line: &str) -> Outcome {
        self.run_words(line.split_whitespace())
    }

    pub fn run_words<S: AsRef<std::ffi::OsStr>>(&self, words: impl IntoIterator<Item = S>) -> Outcome {
        let words: Vec<S> = words.into_iter().collect();
        let line: Vec<String> = words.iter().map(|w| w.as_ref().to_string_lossy().into_owned()).collect();
        let line = line.join(" ");
        let mut command = assert_cmd::Command::new(env!("CARGO_BIN_EXE_translux"));
        command.current_dir(self.0.path()).env_remove("TRANSLUX_THREADS").env("RUST_BACKTRACE", "0").timeout(LIMIT);
        let output = command.args(words).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        let code = output.status.code().unwrap_or_else(|| panic!("`{line}` ended by a signal: {stderr}"));
        assert!((0..=7).contains(&code), "`{line}`: exit code {code}: {stderr}");
        assert!(!stderr.contains("panicked"), "`{line}`: {stderr}");
        assert!(!stderr.contains('\u{1b}') && !stderr.contains('\r'), "`{line}` drew on what is no terminal: {stderr}");
        Outcome { line, code, stdout: output.stdout, stderr }
    }

    /// Radiosity of each vertex of a PLY.
    pub fn radiosity(&self, name: &str) -> Vec<DVec3> {
        self.triples(name, ["b_r", "b_g", "b_b"])
    }

    pub fn positions(&self, name: &str) -> Vec<DVec3> {
        self.triples(name, ["x", "y", "z"])
    }

    pub fn triples(&self, name: &str, columns: [&str; 3]) -> Vec<DVec3> {
        let table: PlyVertexTable = read_ply(&self.path(name)).unwrap();
        table.triples(columns).unwrap().into_iter().map(DVec3::from_array).collect()
    }
}

/// How a run ended.
pub struct Outcome {
    pub line: String,
    pub code: i32,
    pub stdout: Vec<u8>,
    pub stderr: String,
}

impl Outcome {
    #[track_caller]
    pub fn ok(self) -> Self {
        assert_eq!(self.code, 0, "`{}`: {}", self.line, self.stderr);
        self
    }

    /// The exit code, and every fragment on standard error.
    #[track_caller]
    pub fn fails(self, code: i32, fragments: &[&str]) -> Self {
        assert_eq!(self.code, code, "`{}`: {}", self.line, self.stderr);
        for fragment in fragments {
            assert!(self.stderr.contains(fragment), "`{}` does not say `{fragment}`: {}", self.line, self.stderr);
        }
        self
    }

    #[track_caller]
    pub fn text(&self) -> String {
        String::from_utf8(self.stdout.clone()).unwrap()
    }

    /// The report, which its schema describes. Wherever memory was expected, no more than a tenth above that was taken.
    #[track_caller]
    pub fn json(&self) -> Value {
        let report: Value =
            serde_json::from_slice(&self.stdout).unwrap_or_else(|e| panic!("`{}`: {e}: {}", self.line, self.text()));
        schema::check(&report);
        let [expected, taken] =
            ["estimated_memory_bytes", "peak_memory_bytes"].map(|of| report["timings"][of].as_f64().unwrap_or(0.0));
        // A chart measures with more than it speaks of, and a driver takes what it likes.
        let is_told = expected > 0.0 && !["chart ", "relight "].iter().any(|command| self.line.starts_with(command));
        assert!(!is_told || taken <= 1.1 * expected, "`{}`: {taken} bytes taken, {expected} expected", self.line);
        report
    }
}

/// A model as OBJ, with a `usemtl` wherever the material changes.
pub fn obj_text(model: &SourceModel) -> String {
    let mut text = String::new();
    for p in &model.positions {
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap();
    }
    let mut current = None;
    for (triangle, &material) in model.triangles.iter().zip(&model.triangle_material) {
        if current != Some(material) {
            writeln!(text, "usemtl {}", model.materials[material as usize]).unwrap();
            current = Some(material);
        }
        let [a, b, c] = triangle.map(|v| v + 1);
        writeln!(text, "f {a} {b} {c}").unwrap();
    }
    text
}

/// The same model with another name of its material.
pub fn called(mut model: SourceModel, name: &str) -> SourceModel {
    model.materials = vec![name.to_owned()];
    model
}

/// The folder of the shared test data, if this machine has it.
pub fn shared_data() -> Option<PathBuf> {
    let root = match std::env::var_os("TRANSLUX_SHARED") {
        Some(path) => PathBuf::from(path),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"),
    };
    let data = root.join("data");
    if data.is_dir() {
        return Some(data);
    }
    eprintln!("WITHOUT ../shared: there is no test data at {}", data.display());
    None
}

/// Largest difference over the largest value.
#[track_caller]
pub fn relative_difference(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    let largest = b.iter().fold(0.0_f64, |m, v| m.max(v.abs().max_element()));
    let difference = a.iter().zip(b).fold(0.0_f64, |m, (a, b)| m.max((*a - *b).abs().max_element()));
    assert!(largest > 0.0, "there is nothing to compare: everything is 0");
    difference / largest
}

/// A page as headless Chromium has it after its scripts, and a picture of it; none without Chromium, which is said.
pub fn browse(folder: &Folder, page: &str) -> Option<(String, PngImage)> {
    let here = |name: &&str| {
        let status = Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        status.is_ok()
    };
    let Some(browser) = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(here) else {
        println!("SKIPPED: no Chromium");
        return None;
    };
    let run = |extra: &str| {
        let output = Command::new(browser)
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--virtual-time-budget=2000",
                "--window-size=1300,1800",
            ])
            .arg(format!("--user-data-dir={}", folder.path("profile").display()))
            .arg(extra)
            .arg(format!("file://{}", folder.path(page).display()))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let text = String::from_utf8(run("--dump-dom")).unwrap();
    assert!(!text.contains("src=\"http") && !text.contains("href=\"http"), "the page needs something else");
    run(&format!("--screenshot={}", folder.path("page.png").display()));
    Some((text, decode_png(&folder.read("page.png")).unwrap()))
}

/// A GLB of a document and its binary chunk.
pub fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let [mut text, mut binary] = [serde_json::to_vec(document).unwrap(), binary.to_vec()];
    text.resize(text.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let word = |n: usize| (n as u32).to_le_bytes();
    let whole = word(28 + text.len() + binary.len());
    let chunks = [&word(text.len())[..], b"JSON", &text, &word(binary.len()), b"BIN\0", &binary];
    [b"glTF\x02\0\0\0", &whole[..], &chunks.concat()].concat()
}
