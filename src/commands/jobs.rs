//! `translux bake --jobs LIST`: many bakes, one after another, each with all threads and all of the memory.

use std::fmt;
use std::io::Write;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use toml::de::{DeTable, DeValue};

use super::bake::{self, BakeArgs};
use super::configuration::{File, INPUT, KEEPING, Options, Schema, parser_message, table};
use super::console::Console;
use super::failures;
use crate::error::{Error, ExitCode, Result};
use crate::report::text::duration;

/// Options that name a file which a bake writes.
const WRITTEN: [&str; 3] = ["output", "report", "depfile"];

/// The name of what is told of all bakes.
const DEFAULTS: &str = "defaults";
/// The name of what is told of one bake.
const JOB: &str = "job";

/// Bakes of a file, in its order.
pub(super) struct List {
    file: File,
    jobs: Vec<Job>,
}

/// One bake.
struct Job {
    /// Where it stands.
    line: usize,
    options: Options,
    args: BakeArgs,
    /// Whether its warnings about quality are errors.
    strict: bool,
}

/// Reads a list; `typed` beats it, and `parse` makes the arguments of one bake, and whether it is strict.
///
/// # Errors
/// I/O; the command line: whatever is wrong with any job, with its line, so that no bake has begun.
pub(super) fn read(
    path: &Path,
    typed: &Options,
    schema: &Schema,
    parse: impl Fn(&Options) -> std::result::Result<(BakeArgs, bool), clap::Error>,
) -> Result<List> {
    if let Some(key) = [INPUT].iter().chain(&WRITTEN).find(|key| typed.has(key)) {
        let what = if *key == INPUT { format!("`{}`", typed.text(key)) } else { format!("--{key}") };
        return Err(Error::command_line(format!("{what}: each job of --jobs has its own, in its file")));
    }
    let file = File::read(path)?;
    let jobs = jobs(&file, typed, schema, parse)?;
    Ok(List { file, jobs })
}

fn jobs(
    file: &File,
    typed: &Options,
    schema: &Schema,
    parse: impl Fn(&Options) -> std::result::Result<(BakeArgs, bool), clap::Error>,
) -> Result<Vec<Job>> {
    let root = file.parse()?;
    if let Some((name, _)) = root.iter().find(|(name, _)| ![DEFAULTS, JOB].contains(&name.get_ref().as_ref())) {
        let line = file.line(name.span().start);
        return Err(file.error(line, format!("{}: there are [defaults] and [[job]]", name.get_ref())));
    }
    let of_table = |table: &DeTable<'_>, shared: bool| {
        schema.of_table(file, table, |key| match key {
            "strict" => None,
            _ if schema.is_common(key) => Some("this is for all jobs alike: type it beside --jobs"),
            _ if shared && (key == INPUT || WRITTEN.contains(&key)) => Some("each job has its own"),
            _ => None,
        })
    };
    let defaults = table(file, root.get(DEFAULTS), DEFAULTS)?.map(|table| of_table(table, true)).transpose()?;
    let defaults = defaults.unwrap_or_default();
    let list = match root.get(JOB) {
        Some(value) => match value.get_ref() {
            DeValue::Array(array) => &**array,
            _ => return Err(file.error(file.line(value.span().start), "job: write [[job]], once for each bake")),
        },
        None => return Err(file.error(1, "there is no [[job]] to do")),
    };
    let mut jobs: Vec<Job> = Vec::with_capacity(list.len());
    for value in list {
        let line = file.line(value.span().start);
        let own = table(file, Some(value), JOB)?.map(|table| of_table(table, false)).transpose()?.unwrap_or_default();
        let options = schema.over(typed, &schema.over(&own, &defaults));
        let (args, strict) = parse(&options)
            .map_err(|e| file.of_parser(&e, &options).unwrap_or_else(|| file.error(line, parser_message(&e))))?;
        if options.has(KEEPING) {
            return Err(file.error(line, "shard: each shard of a bake is a command of its own"));
        }
        for key in WRITTEN.into_iter().filter(|key| options.has(key)) {
            let path = options.text(key);
            let is_same = |job: &&Job| WRITTEN.iter().any(|key| job.options.text(key) == path);
            if let Some(other) = jobs.iter().find(is_same) {
                let message = format!("{key}: the job of line {} writes {path} too", other.line);
                return Err(file.error(line, message));
            }
        }
        jobs.push(Job { line, options, args, strict });
    }
    Ok(jobs)
}

/// What became of a bake.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct JobReport {
    /// Its line in the list.
    line: usize,
    input: String,
    output: String,
    exit: u8,
    kind: &'static str,
    /// Why it failed.
    message: Option<String>,
    timings: JobTimings,
    /// The report of the bake (`translux.bake.v1`); none where it came to none.
    report: Option<Value>,
}

/// What differs from run to run.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct JobTimings {
    /// Wall-clock seconds.
    seconds: f64,
}

/// What became of all bakes.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct JobsReport {
    jobs: Vec<JobReport>,
    /// Jobs that failed.
    failed: usize,
    /// The largest exit code.
    exit: u8,
}

impl fmt::Display for JobsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let widest = self.jobs.iter().map(|job| job.output.chars().count()).max().unwrap_or(0);
        for job in &self.jobs {
            let (output, time) = (&job.output, duration(job.timings.seconds));
            write!(f, "{:<16} {output:<widest$} {time:>8}", job.kind)?;
            writeln!(f, "{}", job.message.as_ref().map_or(String::new(), |message| format!("  {message}")))?;
        }
        write!(f, "{} of {} done", self.jobs.len() - self.failed, self.jobs.len())
    }
}

/// Bakes the list; the exit code is the largest of all.
///
/// # Errors
/// The command line: settings that a method refuses, before the first bake; output that cannot be written.
pub(super) fn run(list: &List, console: &Console) -> Result<ExitCode> {
    let List { file, jobs } = list;
    for job in jobs {
        bake::check(&job.args, console).map_err(|e| file.located(e, &job.options))?;
    }
    let mut report = JobsReport { jobs: Vec::with_capacity(jobs.len()), failed: 0, exit: 0 };
    let mut worst = ExitCode::Ok;
    for (index, job) in jobs.iter().enumerate() {
        let (input, output) = (job.options.text(INPUT), job.options.text("output"));
        console.note(&format!("[{}/{}] {input} -> {output}", index + 1, jobs.len()));
        let own = console.of_job(job.strict);
        let done = failures::guarded(|| bake::run(&job.args, &own).and_then(|code| own.verdict(code)));
        let (code, message) = match done {
            Ok(code) => (code, None),
            Err(error) => {
                let error = file.located(error, &job.options);
                // The report and the exit code tell it too.
                let _ = writeln!(std::io::stderr(), "translux: {error}");
                (error.code(), Some(error.message().to_owned()))
            }
        };
        if code as u8 > worst as u8 {
            worst = code;
        }
        report.failed += usize::from(code != ExitCode::Ok);
        report.jobs.push(JobReport {
            line: job.line,
            input,
            output,
            exit: code as u8,
            kind: code.kind(),
            message,
            timings: JobTimings { seconds: own.seconds() },
            report: own.taken(),
        });
    }
    report.exit = worst as u8;
    console.say(&report.to_string())?;
    console.report("jobs", &report)?;
    Ok(worst)
}
