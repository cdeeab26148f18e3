//! A bake in a process of its own, for separate memory and time, ended when it takes too long.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, ExitCode, Result};
use crate::io::atomic;
use crate::measure::growth::Limits;
use crate::report::StageTime;

/// Interval at which a running bake is polled.
const POLL: Duration = Duration::from_millis(10);

/// Outcome of a bake.
pub(super) enum Outcome {
    /// The paths of its asset and its report.
    Done(PathBuf, BakeCost),
    /// The bake took too long, after this many seconds.
    Ended(f64),
    /// The bake ran out of memory or failed otherwise, with its message.
    Failed(String),
}

/// The cost of a bake as its report tells it.
#[derive(Deserialize)]
pub(super) struct BakeCost {
    timings: CostTimings,
}

#[derive(Deserialize)]
struct CostTimings {
    seconds: f64,
    stages: Vec<StageTime>,
    peak_memory_bytes: u64,
}

impl BakeCost {
    /// Wall-clock seconds.
    pub(super) fn seconds(&self) -> f64 {
        self.timings.seconds
    }

    /// Largest resident size, bytes.
    pub(super) fn peak_memory_bytes(&self) -> u64 {
        self.timings.peak_memory_bytes
    }

    /// Names and seconds of the stages.
    pub(super) fn stages(&self) -> Vec<(String, f64)> {
        self.timings.stages.iter().map(|s| (s.stage.clone(), s.seconds)).collect()
    }
}

/// What an earlier run stored in a file, if it can be read.
pub(super) fn stored<T: DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_slice(&std::fs::read(path).ok()?).ok()
}

/// Stores a value for later runs.
pub(super) fn store<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    let bytes = serde_json::to_vec(value).map_err(|e| Error::runtime(format!("{}: {e}", path.display())))?;
    atomic::write(path, &bytes)
}

/// A bake as a command line.
pub(super) struct Bake<'a> {
    /// Arguments of the program.
    pub(super) words: &'a [String],
    /// Stem of the names of this bake's files.
    pub(super) key: &'a str,
    pub(super) work: &'a Path,
    /// Limits of time and memory; none for no limits.
    pub(super) limits: Option<Limits>,
}

/// Bakes, or takes an asset and a report that exist already.
///
/// # Errors
/// A bake that fails for another reason than memory and time, with its exit code; I/O.
pub(super) fn bake(bake: &Bake) -> Result<Outcome> {
    let file = |suffix: &str| bake.work.join(format!("{}.{suffix}", bake.key));
    let (asset, report_path) = (file("tlux"), file("json"));
    if let Some(cost) = stored(&report_path).filter(|_| asset.is_file()) {
        return Ok(Outcome::Done(asset, cost));
    }
    // A folder of its own: whatever an ended bake leaves goes with it.
    let folder = file("part");
    let fail = |e: std::io::Error| Error::io(&folder, &e);
    remove(&folder)?;
    std::fs::create_dir_all(&folder).map_err(fail)?;
    let outcome = run(bake, &folder);
    if let Ok(Outcome::Done(made, _)) = &outcome {
        std::fs::rename(made, &asset).map_err(fail)?;
        let report = std::fs::read(folder.join("report.json")).map_err(fail)?;
        // Last: a report without its asset is not taken.
        atomic::write(&report_path, &report)?;
    }
    remove(&folder)?;
    outcome.map(|outcome| match outcome {
        Outcome::Done(_, report) => Outcome::Done(asset, report),
        other => other,
    })
}

fn remove(folder: &Path) -> Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(folder, &e)),
        _ => Ok(()),
    }
}

fn run(bake: &Bake, folder: &Path) -> Result<Outcome> {
    let command = format!("translux {}", bake.words.join(" "));
    let made = folder.join("asset.tlux");
    let paths = ["report.json", "errors.txt"].map(|name| folder.join(name));
    let create = |path: &PathBuf| File::create(path).map_err(|e| Error::io(path, &e));
    let program = std::env::current_exe().map_err(|e| Error::runtime(format!("where this program is: {e}")))?;
    let mut child = Command::new(program)
        .args(bake.words)
        .args(["--json", "-q", "--threads", &rayon::current_num_threads().to_string()])
        .args(bake.limits.map(|l| format!("--max-memory={}B", l.memory_bytes)))
        .arg("-o")
        .arg(&made)
        .stdin(Stdio::null())
        .stdout(create(&paths[0])?)
        .stderr(create(&paths[1])?)
        .spawn()
        .map_err(|e| Error::runtime(format!("{command}: {e}")))?;
    let started = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if bake.limits.is_some_and(|l| started.elapsed().as_secs_f64() > l.kill_seconds()) => {
                // It may have ended by itself just now.
                let _ = child.kill();
                let _ = child.wait();
                return Ok(Outcome::Ended(started.elapsed().as_secs_f64()));
            }
            Ok(None) => std::thread::sleep(POLL),
            Err(e) => return Err(Error::runtime(format!("{command}: {e}"))),
        }
    };
    let read = |path: &PathBuf| std::fs::read(path).map_err(|e| Error::io(path, &e));
    if status.success() {
        let report = serde_json::from_slice(&read(&paths[0])?)
            .map_err(|e| Error::runtime(format!("{command}: its report: {e}")))?;
        return Ok(Outcome::Done(made, report));
    }
    let said = read(&paths[1])?;
    let said = String::from_utf8_lossy(&said).trim().trim_start_matches("translux: ").to_owned();
    match status.code() {
        None => Ok(Outcome::Failed("was ended by the system, which may have run out of memory".to_owned())),
        Some(code) if code == ExitCode::Runtime as i32 => Ok(Outcome::Failed(said)),
        Some(code) => {
            let known = ExitCode::ALL.iter().find(|(known, _)| code == *known as i32);
            Err(Error::new(known.map_or(ExitCode::Runtime, |(code, _)| *code), format!("{command}: {said}")))
        }
    }
}
