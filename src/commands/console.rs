//! Output of a command while it works: progress with remaining time, notes, warnings, stage timings, peak memory.

use std::fmt::Display;
use std::io::Write;
use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use clap::Args;
use serde::Serialize;
use serde_json::Value;
use translux_format::Budget;

use super::meter::{Meter, Telling};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Registry;
use crate::evaluate::memory::Limits;
use crate::math::simd::InstructionSet;
use crate::progress::{Progress, stage};
use crate::report::materials::LookReport;
use crate::report::text::{megabytes, percent};
use crate::report::{Run, StageTime, Timings, document, json};

/// Options of every command.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Common options")]
pub(super) struct Global {
    /// Print nothing but errors and what was asked for
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Print one JSON report on standard output
    #[arg(long, global = true)]
    pub(super) json: bool,
    /// How progress is told
    #[arg(long, global = true, value_name = "HOW", default_value = "auto")]
    progress: Telling,
    /// Turn warnings about quality, size or time into exit code 6
    #[arg(long, global = true)]
    pub(super) strict: bool,
    /// Worker threads (default: the processors that this process may use)
    #[arg(long, global = true, env = "TRANSLUX_THREADS", value_name = "N")]
    pub(super) threads: Option<usize>,
    /// Memory that may be used, such as 4GiB or 800MB (default: 75 % of what there is); what needs more is refused before the work
    #[arg(long, global = true, value_name = "SIZE")]
    max_memory: Option<String>,
    /// Widest instructions of the kernels: baseline, avx2, avx512. Results are the same.
    #[arg(long, global = true, hide = true, env = "TRANSLUX_INSTRUCTIONS", value_name = "SET")]
    pub(super) instructions: Option<InstructionSet>,
}

/// Standard error and the clock of one command.
pub(super) struct Console {
    pub(super) global: Global,
    /// Memory limit in bytes.
    pub(super) max_memory: u64,
    /// Methods and forms that can be used.
    pub(super) registry: Registry,
    state: Mutex<State>,
    meter: Meter,
    started: Instant,
    /// Where reports as JSON go.
    reports: Reports,
}

/// Where reports as JSON go.
enum Reports {
    /// To standard output; whether one has been printed.
    Printed(Arc<AtomicBool>),
    /// To whoever asks for the last one.
    Kept(Mutex<Option<Value>>),
}

#[derive(Default)]
struct State {
    times: Vec<StageTime>,
    /// The most memory that any work was expected to take, bytes; 0 where nobody has estimated.
    estimated_memory: u64,
    warnings: Vec<String>,
    /// Those of the warnings that are about quality.
    faults: Vec<String>,
    looks: Vec<LookReport>,
    /// Stages whose results a cache had.
    reused: Vec<String>,
}

/// Bytes that a process takes beside its data once it works: code that is used, stacks of threads, what the allocator keeps.
const OF_A_PROCESS: u64 = 28 << 20;

impl Console {
    pub(super) fn new(global: &Global, registry: Registry, reported: Arc<AtomicBool>) -> Result<Self> {
        let max_memory = match &global.max_memory {
            Some(text) => parse_size("--max-memory", text, Unitless::Refused)?,
            None => available_memory() / 4 * 3,
        };
        Ok(Self {
            global: global.clone(),
            max_memory,
            registry,
            state: Mutex::default(),
            meter: Meter::new(global.progress, global.quiet),
            started: Instant::now(),
            reports: Reports::Printed(reported),
        })
    }

    /// A console for one of many works: with the same limits, and a report that is kept.
    pub(super) fn of_job(&self, strict: bool) -> Self {
        Self {
            global: Global { strict, ..self.global.clone() },
            max_memory: self.max_memory,
            registry: self.registry.clone(),
            state: Mutex::default(),
            meter: Meter::new(self.global.progress, self.global.quiet),
            started: Instant::now(),
            reports: Reports::Kept(Mutex::default()),
        }
    }

    /// A console for work within a work that tells itself what it does: nothing is printed.
    pub(super) fn silent(&self) -> Self {
        let global = Global { quiet: true, json: false, strict: false, ..self.global.clone() };
        Self { meter: Meter::new(Telling::None, true), global, ..self.of_job(false) }
    }

    /// The report that was kept.
    pub(super) fn taken(&self) -> Option<Value> {
        match &self.reports {
            Reports::Kept(kept) => kept.lock().unwrap_or_else(PoisonError::into_inner).take(),
            Reports::Printed(_) => None,
        }
    }

    /// Limit on what is decoded from a file.
    pub(super) fn budget(&self) -> Budget {
        Budget::bytes(self.max_memory)
    }

    /// Calls `work` with the limits on the memory of opening an asset; `advice` as in [`Self::check_memory`].
    pub(super) fn with_limits<T>(&self, advice: &str, work: impl FnOnce(Limits<'_>) -> Result<T>) -> Result<T> {
        work(Limits { budget: self.budget(), admit: &|more| self.check_memory(more, advice) })
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Prints a line for people on standard error.
    pub(super) fn note(&self, line: &str) {
        if !self.global.quiet {
            // A note that standard error does not take is lost, the work is not.
            self.meter.beside(|| drop(writeln!(std::io::stderr(), "{line}")));
        }
    }

    /// Prints a warning and keeps it for the report.
    pub(super) fn warn(&self, line: &str) {
        self.note(&format!("warning: {line}"));
        self.state().warnings.push(line.to_owned());
    }

    /// Warns of something for which results are wrong or poor: with `--strict`, the command fails of it at its end.
    pub(super) fn fault(&self, line: &str) {
        self.warn(line);
        self.state().faults.push(line.to_owned());
    }

    /// Keeps a look for the report; returns whether it is a new one.
    pub(super) fn keep_look(&self, look: LookReport) -> bool {
        let mut state = self.state();
        let is_new = !state.looks.contains(&look);
        if is_new {
            state.looks.push(look);
        }
        is_new
    }

    /// Enters stages whose results a cache had.
    pub(super) fn reused(&self, stages: &[&str]) {
        self.state().reused.extend(stages.iter().map(|stage| (*stage).to_owned()));
    }

    /// The exit code of a command that has done its work: with `--strict` an error, if there were faults.
    pub(super) fn verdict(&self, code: ExitCode) -> Result<ExitCode> {
        let faults = self.state().faults.join("; ");
        if self.global.strict && code == ExitCode::Ok && !faults.is_empty() {
            return Err(Error::new(ExitCode::QualityNotMet, faults));
        }
        Ok(code)
    }

    /// Runs `work` as a named stage without units.
    pub(super) fn stage<T>(&self, name: &'static str, work: impl FnOnce() -> T) -> T {
        stage(self, name, work)
    }

    /// Prints a report for people, or as JSON with `--json`; all went well.
    pub(super) fn show<T: Serialize + Display>(&self, command: &str, report: &T) -> Result<ExitCode> {
        if !self.global.json {
            print_line(&report.to_string())?;
        }
        self.report(command, report)
    }

    /// Prints a report as JSON where `--json` asks for it; all went well.
    pub(super) fn report<T: Serialize>(&self, command: &str, report: &T) -> Result<ExitCode> {
        if !self.global.json {
            return Ok(ExitCode::Ok);
        }
        // Each lock is given back before the next: within one statement they would wait for each other.
        let stages = self.state().times.clone();
        let warnings = self.state().warnings.clone();
        let looks = self.state().looks.clone();
        let reused = self.state().reused.clone();
        let estimated_memory_bytes = self.state().estimated_memory;
        let timings = Timings {
            seconds: self.seconds(),
            stages,
            reused,
            estimated_memory_bytes,
            peak_memory_bytes: peak_memory(),
            threads: rayon::current_num_threads(),
        };
        let run = Run { looks, warnings, timings };
        match &self.reports {
            Reports::Printed(reported) => {
                print_line(&json(command, report, &run)?)?;
                reported.store(true, Ordering::Relaxed);
            }
            Reports::Kept(kept) => {
                *kept.lock().unwrap_or_else(PoisonError::into_inner) = Some(document(command, report, &run)?);
            }
        }
        Ok(ExitCode::Ok)
    }

    /// Prints one line of results, unless output is JSON or quiet.
    pub(super) fn say(&self, line: &str) -> Result<()> {
        if self.global.json || self.global.quiet { Ok(()) } else { print_line(line) }
    }

    /// Seconds since the command started.
    pub(super) fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Warns where the measured relative error is above the asked one, or fails where `--strict` asks for it.
    pub(super) fn judge(&self, measured: f64, asked: Option<f64>) -> Result<ExitCode> {
        if let Some(asked) = asked.filter(|asked| measured > *asked) {
            let line = format!("measured error {} is above the asked {}", percent(measured), percent(asked));
            if self.global.strict {
                return Err(Error::new(ExitCode::QualityNotMet, line));
            }
            self.warn(&line);
        }
        Ok(ExitCode::Ok)
    }

    /// Memory that work may take beyond what the process has now, bytes.
    pub(super) fn free_memory(&self) -> u64 {
        self.max_memory.saturating_sub(resident_memory()).saturating_sub(OF_A_PROCESS)
    }

    /// Takes note of work that takes `more` than the process has now; the report tells what was needed, which is returned.
    pub(super) fn foresee_memory(&self, more: u64) -> u64 {
        let needed = resident_memory().saturating_add(OF_A_PROCESS).saturating_add(more);
        let mut state = self.state();
        state.estimated_memory = state.estimated_memory.max(needed);
        needed
    }

    /// Refuses work that takes `more` than the process has now, if the memory limit does not allow it; `advice` names the setting that
    /// would fit.
    pub(super) fn check_memory(&self, more: u64, advice: &str) -> Result<()> {
        let needed = self.foresee_memory(more);
        if needed <= self.max_memory {
            return Ok(());
        }
        let (needed, limit) = (megabytes(needed), megabytes(self.max_memory));
        Err(Error::runtime(format!("about {needed} of memory are needed and {limit} allowed: {advice}")))
    }
}

impl Progress for Console {
    fn start(&self, stage: &'static str, total: u64) {
        self.meter.start(stage, total);
    }

    fn advance(&self, units: u64) {
        self.meter.advance(units);
    }

    fn finish(&self) {
        let Some((stage, seconds)) = self.meter.finish() else { return };
        let mut state = self.state();
        match state.times.iter_mut().find(|time| time.stage == stage) {
            Some(sum) => sum.seconds += seconds,
            None => state.times.push(StageTime { stage: stage.to_owned(), seconds }),
        }
    }
}

/// Prints one line on standard output; a closed pipe is no error.
pub(super) fn print_line(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::new(ExitCode::Io, format!("standard output: {e}")))
        }
        _ => Ok(()),
    }
}

/// What a size without a unit is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unitless {
    /// Bytes.
    Bytes,
    /// A mistake: whoever types 300 means no bytes.
    Refused,
}

/// A size as it is typed for an option, in bytes.
pub(super) fn parse_size(flag: &str, text: &str, unitless: Unitless) -> Result<u64> {
    let trimmed = text.trim();
    let split = trimmed.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(trimmed.len());
    let (number, unit) = trimmed.split_at(split);
    let factor = match unit.to_ascii_lowercase().as_str() {
        "" if unitless == Unitless::Refused => {
            return Err(Error::command_line(format!(
                "{flag} {text}: a unit is needed, as in {number}MB, {number}GiB or {number}B"
            )));
        }
        "" | "b" => 1.0,
        "k" | "kib" => 1024.0,
        "kb" => 1e3,
        "m" | "mib" => 1024.0 * 1024.0,
        "mb" => 1e6,
        "g" | "gib" => 1024.0 * 1024.0 * 1024.0,
        "gb" => 1e9,
        _ => f64::NAN,
    };
    match number.trim().parse::<f64>().map(|value| value * factor) {
        Ok(bytes) if bytes.is_finite() && bytes > 0.0 => Ok(bytes as u64),
        _ => Err(Error::command_line(format!("{flag} {text}: a size such as 4GiB or 800MB is needed"))),
    }
}

/// Memory that this process could have: the system's available memory, or a cgroup's limit where that is less.
fn available_memory() -> u64 {
    let group = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"]
        .iter()
        .find_map(|p| std::fs::read_to_string(p).ok()?.trim().parse::<u64>().ok());
    proc_bytes("/proc/meminfo", "MemAvailable:").unwrap_or(8 << 30).min(group.unwrap_or(u64::MAX))
}

/// Resident size of this process, in bytes; 0 where the system does not report it.
fn resident_memory() -> u64 {
    proc_bytes("/proc/self/status", "VmRSS:").unwrap_or(0)
}

/// Largest resident size of this process so far, in bytes; 0 where the system does not report it.
fn peak_memory() -> u64 {
    proc_bytes("/proc/self/status", "VmHWM:").unwrap_or(0)
}

/// A size that the system tells in a file, in bytes.
fn proc_bytes(path: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(path).ok()?;
    let kib = text.lines().find_map(|line| line.strip_prefix(name))?.trim().trim_end_matches("kB").trim();
    Some(kib.parse::<u64>().ok()? * 1024)
}

/// The value of an option that must lie in a range.
pub(super) fn in_range<T: PartialOrd + Display>(flag: &str, value: T, range: RangeInclusive<T>) -> Result<T> {
    if range.contains(&value) {
        return Ok(value);
    }
    let (least, most) = range.into_inner();
    Err(Error::command_line(format!("{flag} {value}: a number from {least} to {most} is needed")))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_their_units() {
        let size = |text| parse_size("--max-memory", text, Unitless::Refused);
        assert_eq!(size("4GiB").unwrap(), 4 << 30);
        assert_eq!(size("800MB").unwrap(), 800_000_000);
        assert_eq!(size("1.5 k").unwrap(), 1536);
        assert_eq!(size("300B").unwrap(), 300);
        for bad in ["", "GiB", "-1GB", "4 parsecs", "nan", "300"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_size("--max-bytes", "300", Unitless::Bytes).unwrap(), 300);
    }
}
