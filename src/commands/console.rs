//! What a command says while it works: progress with remaining time, notes, warnings, stage timings, peak memory.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::Global;
use crate::error::{Error, Result};
use crate::evaluate::Registry;
use crate::progress::{Progress, stage};

/// Time that a stage took.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct StageTime {
    /// Name of the stage.
    pub(super) stage: String,
    /// Wall-clock seconds.
    pub(super) seconds: f64,
}

/// How chatty the command is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verbosity {
    /// Errors only.
    Quiet,
    /// Notes and progress on standard error.
    Normal,
}

/// Where results go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// Text for people.
    Text,
    /// One JSON report on standard output.
    Json,
}

/// What a missed quality does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Strictness {
    /// A warning.
    Warn,
    /// Exit code 6.
    Fail,
}

/// Standard error and the clock of one command.
pub(super) struct Console {
    /// Methods and forms that there are.
    pub(super) registry: Registry,
    pub(super) verbosity: Verbosity,
    pub(super) format: Format,
    pub(super) strictness: Strictness,
    /// Bytes that may be used.
    pub(super) max_memory: u64,
    state: Mutex<State>,
    started: Instant,
}

struct State {
    bar: Option<ProgressBar>,
    stage: Option<(&'static str, Instant)>,
    times: Vec<StageTime>,
    warnings: Vec<String>,
}

impl Console {
    pub(super) fn new(global: &Global, registry: Registry) -> Result<Self> {
        let max_memory = match &global.max_memory {
            Some(text) => parse_size(text)?,
            None => available_memory() / 4 * 3,
        };
        Ok(Self {
            registry,
            verbosity: if global.quiet { Verbosity::Quiet } else { Verbosity::Normal },
            format: if global.json { Format::Json } else { Format::Text },
            strictness: if global.strict { Strictness::Fail } else { Strictness::Warn },
            max_memory,
            state: Mutex::new(State { bar: None, stage: None, times: Vec::new(), warnings: Vec::new() }),
            started: Instant::now(),
        })
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// A line for people on standard error.
    pub(super) fn note(&self, line: &str) {
        if self.verbosity == Verbosity::Normal {
            // A note that standard error does not take is lost, the work is not.
            let print = || drop(writeln!(std::io::stderr(), "{line}"));
            match &self.state().bar {
                Some(bar) => bar.suspend(print),
                None => print(),
            }
        }
    }

    /// A warning: printed, and kept for the report.
    pub(super) fn warn(&self, line: &str) {
        self.note(&format!("warning: {line}"));
        self.state().warnings.push(line.to_owned());
    }

    /// Runs `work` as a named stage without units.
    pub(super) fn stage<T>(&self, name: &'static str, work: impl FnOnce() -> T) -> T {
        stage(self, name, work)
    }

    /// Times of the stages so far; a stage that ran several times has one entry with the sum.
    pub(super) fn times(&self) -> Vec<StageTime> {
        let mut sums: Vec<StageTime> = Vec::new();
        for time in &self.state().times {
            match sums.iter_mut().find(|t| t.stage == time.stage) {
                Some(sum) => sum.seconds += time.seconds,
                None => sums.push(time.clone()),
            }
        }
        sums
    }

    /// Warnings so far.
    pub(super) fn warnings(&self) -> Vec<String> {
        self.state().warnings.clone()
    }

    /// Seconds since the command started.
    pub(super) fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Refuses work that the memory limit does not allow; `advice` names the setting that would fit.
    pub(super) fn check_memory(&self, needed: u64, advice: &str) -> Result<()> {
        if needed <= self.max_memory {
            return Ok(());
        }
        let (needed, limit) = (megabytes(needed), megabytes(self.max_memory));
        Err(Error::runtime(format!("about {needed} of memory are needed and {limit} allowed: {advice}")))
    }
}

impl Progress for Console {
    fn start(&self, stage: &'static str, total: u64) {
        let mut state = self.state();
        state.stage = Some((stage, Instant::now()));
        let shown = self.verbosity == Verbosity::Normal && std::io::stderr().is_terminal() && total > 0;
        state.bar = shown.then(|| {
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(10));
            let template = "{msg:12} {bar:40} {percent:>3} %  {eta} left";
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_message(stage);
            bar
        });
    }

    fn advance(&self, units: u64) {
        if let Some(bar) = &self.state().bar {
            bar.inc(units);
        }
    }

    fn finish(&self) {
        let mut state = self.state();
        if let Some(bar) = state.bar.take() {
            bar.finish_and_clear();
        }
        if let Some((stage, since)) = state.stage.take() {
            let seconds = since.elapsed().as_secs_f64();
            state.times.push(StageTime { stage: stage.to_owned(), seconds });
        }
    }
}

/// A duration as people say it.
pub(super) fn duration(seconds: f64) -> String {
    if seconds < 1.0 {
        format!("{:.0} ms", seconds * 1e3)
    } else if seconds < 120.0 {
        format!("{seconds:.1} s")
    } else {
        let whole = Duration::from_secs_f64(seconds).as_secs();
        format!("{} min {} s", whole / 60, whole % 60)
    }
}

/// A size as people say it.
pub(super) fn megabytes(bytes: u64) -> String {
    if bytes < 1 << 20 {
        format!("{:.1} KiB", bytes as f64 / 1024.0)
    } else if bytes < 1 << 30 {
        format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
    } else {
        format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30))
    }
}

/// A share as people say it.
pub(super) fn percent(share: f64) -> String {
    format!("{} %", significant(100.0 * share))
}

/// A number with three significant digits.
pub(super) fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if value.abs() < 1e-4 {
        return format!("{value:.1e}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.digits$}")
}

fn parse_size(text: &str) -> Result<u64> {
    let trimmed = text.trim();
    let split = trimmed.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(trimmed.len());
    let (number, unit) = trimmed.split_at(split);
    let factor = match unit.to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kib" => 1024.0,
        "kb" => 1e3,
        "m" | "mib" => 1024.0 * 1024.0,
        "mb" => 1e6,
        "g" | "gib" => 1024.0 * 1024.0 * 1024.0,
        "gb" => 1e9,
        _ => return Err(Error::command_line(format!("--max-memory {text}: a size such as 4GiB or 800MB is needed"))),
    };
    match number.trim().parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok((value * factor) as u64),
        _ => Err(Error::command_line(format!("--max-memory {text}: a size such as 4GiB or 800MB is needed"))),
    }
}

/// Memory that this process could have: what the system has available, less where a cgroup allows less.
fn available_memory() -> u64 {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let system = read("/proc/meminfo").and_then(|text| {
        let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:").map(str::to_owned))?;
        line.trim().trim_end_matches("kB").trim().parse::<u64>().ok().map(|kib| kib * 1024)
    });
    let group = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"]
        .iter()
        .find_map(|p| read(p)?.trim().parse::<u64>().ok());
    system.unwrap_or(8 << 30).min(group.unwrap_or(u64::MAX))
}

/// Largest resident size of this process so far, in bytes; 0 where the system does not tell.
pub(super) fn peak_memory() -> u64 {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|status| {
            let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:").map(str::to_owned))?;
            line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()
        })
        .map_or(0, |kib| kib * 1024)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_their_units() {
        assert_eq!(parse_size("4GiB").unwrap(), 4 << 30);
        assert_eq!(parse_size("800MB").unwrap(), 800_000_000);
        assert_eq!(parse_size("1.5 k").unwrap(), 1536);
        for bad in ["", "GiB", "-1GB", "4 parsecs", "nan"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(percent(0.001234), "0.123 %");
        assert_eq!(significant(1234.5), "1234");
        assert_eq!(percent(1.2e-9), "1.2e-7 %");
        assert_eq!(duration(0.25), "250 ms");
        assert_eq!(megabytes(3 << 20), "3.0 MiB");
    }
}
