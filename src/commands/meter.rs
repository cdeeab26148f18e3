//! Progress of long work for people and for programs: a bar on a terminal, a line now and then where there is none, or JSON.

use std::io::{IsTerminal, Write};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use crate::report::text::duration;

/// Schema of a line of JSON.
pub(super) const SCHEMA: &str = "translux.progress.v1";
/// Time between lines for people.
const LINES: Duration = Duration::from_secs(30);
/// Time between lines for programs.
const JSON: Duration = Duration::from_secs(1);

/// How progress is told, on standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Telling {
    /// A bar on a terminal, else lines
    #[default]
    Auto,
    /// A line every 30 seconds
    Lines,
    /// JSON, an object a line: when a stage starts, each second while it lasts, when it ends
    Json,
    /// Nothing
    None,
}

/// What tells the progress of one stage after another.
pub(super) struct Meter {
    form: Form,
    shared: Arc<Mutex<Shared>>,
    /// Ends the thread that tells, when it goes.
    _alive: Option<Sender<()>>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Bar,
    Lines,
    Json,
    Nothing,
}

#[derive(Default)]
struct Shared {
    bar: Option<ProgressBar>,
    stage: Option<Stage>,
}

#[derive(Clone, Copy)]
struct Stage {
    name: &'static str,
    done: u64,
    /// 0 where nobody knows.
    total: u64,
    since: Instant,
}

/// What a line tells.
#[derive(Clone, Copy, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
enum Event {
    Start,
    Progress,
    End,
}

/// Progress for programs.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Line {
    schema: &'static str,
    event: Event,
    stage: &'static str,
    /// Units of work that are done.
    done: u64,
    /// Units of the stage; none where nobody knows.
    total: Option<u64>,
    /// Since the stage began.
    seconds: f64,
}

impl Stage {
    /// A line for people.
    fn text(&self) -> String {
        let seconds = self.since.elapsed().as_secs_f64();
        let (name, time) = (self.name, duration(seconds));
        if self.total == 0 || self.done == 0 {
            return format!("{name}: {time}");
        }
        let share = (self.done as f64 / self.total as f64).min(1.0);
        let left = duration((seconds * (1.0 - share) / share).min(1e9));
        format!("{name}: {:.0} % in {time}, {left} left", 100.0 * share)
    }

    fn json(&self, event: Event) -> String {
        let Self { name: stage, done, total, since } = *self;
        let total = (total > 0).then_some(total);
        let line = Line { schema: SCHEMA, event, stage, done, total, seconds: since.elapsed().as_secs_f64() };
        // Texts and finite numbers are always JSON.
        serde_json::to_string(&line).unwrap_or_default()
    }
}

impl Meter {
    /// Tells as it is asked for; where that says nothing, not if the program is to be quiet.
    pub(super) fn new(telling: Telling, quiet: bool) -> Self {
        let form = match telling {
            Telling::Json => Form::Json,
            Telling::None => Form::Nothing,
            _ if quiet => Form::Nothing,
            Telling::Auto if std::io::stderr().is_terminal() => Form::Bar,
            Telling::Auto | Telling::Lines => Form::Lines,
        };
        let every = match form {
            Form::Lines => Some(LINES),
            Form::Json => Some(JSON),
            Form::Bar | Form::Nothing => None,
        };
        Self::every(form, every, print)
    }

    fn every(form: Form, every: Option<Duration>, mut print: impl FnMut(&str) + Send + 'static) -> Self {
        let shared = Arc::new(Mutex::new(Shared::default()));
        let alive = every.map(|every| {
            let (alive, dead) = channel();
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || {
                while dead.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                    let Some(stage) = lock(&shared).stage else { continue };
                    print(&if form == Form::Json { stage.json(Event::Progress) } else { stage.text() });
                }
            });
            alive
        });
        Self { form, shared, _alive: alive }
    }

    pub(super) fn start(&self, name: &'static str, total: u64) {
        let mut shared = lock(&self.shared);
        let stage = Stage { name, done: 0, total, since: Instant::now() };
        shared.stage = Some(stage);
        if self.form == Form::Json {
            print(&stage.json(Event::Start));
        }
        shared.bar = (self.form == Form::Bar && total > 0).then(|| {
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(10));
            let template = "{msg:12} {bar:40} {percent:>3} %  {eta} left";
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_message(name);
            bar
        });
    }

    pub(super) fn advance(&self, units: u64) {
        let mut shared = lock(&self.shared);
        if let Some(stage) = &mut shared.stage {
            stage.done = stage.done.saturating_add(units);
        }
        if let Some(bar) = &shared.bar {
            bar.inc(units);
        }
    }

    /// The stage that ends, and its seconds.
    pub(super) fn finish(&self) -> Option<(&'static str, f64)> {
        let mut shared = lock(&self.shared);
        if let Some(bar) = shared.bar.take() {
            bar.finish_and_clear();
        }
        let stage = shared.stage.take()?;
        if self.form == Form::Json {
            print(&stage.json(Event::End));
        }
        Some((stage.name, stage.since.elapsed().as_secs_f64()))
    }

    /// Prints something else without a bar in its way.
    pub(super) fn beside(&self, print: impl FnOnce()) {
        match &lock(&self.shared).bar {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }
}

/// Prints a line; where standard error does not take it, it is lost, the work is not.
fn print(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines are told while a stage lasts, units or none, and no more once it has ended.
    #[test]
    fn a_stage_is_told_now_and_then() {
        for (form, expected) in [(Form::Lines, "samples: 25 % in "), (Form::Json, r#""done":1,"total":4,"#)] {
            let (told, lines) = channel();
            let every = Duration::from_millis(5);
            let meter = Meter::every(form, Some(every), move |line| drop(told.send(line.to_owned())));
            meter.start("samples", 4);
            meter.advance(1);
            let line = lines.iter().find(|line| line.contains(expected));
            assert!(line.is_some_and(|line| form == Form::Json || line.ends_with(" left")));
            meter.finish();
            meter.start("walk", 0);
            let line = lines.iter().find(|line| line.contains("walk"));
            assert!(line.is_some_and(|line| !line.contains('%') && !line.contains("left")));
            drop(meter);
            assert!(lines.iter().all(|line| line.contains("walk")), "the thread has ended");
        }
    }
}
