//! The stability suite: `scripts/stability` runs it.
//!
//! `stability list` names the rows; `stability run NUMBER FOLDER SECONDS` runs one with every method, each within so many seconds, and appends a line for each to its file in the folder;
//! `stability random INDEX FOLDER SECONDS MODELS...` does so for a scene at random, with bodies of our own and those of some files;
//! `stability stages NUMBER METHODS...` prints the stages of what each promises;
//! `stability page FOLDER DOCS` writes the page and the table from the files of a folder.
//!
//! What is in the file already is not run again. A method that was begun twice and has no line does not come to an end: it is recorded as
//! unfinished. The seconds are those of the processor, of all threads together.
#![allow(clippy::print_stdout, clippy::print_stderr)]

mod page;
#[path = "../../tests/stability/suite/mod.rs"]
mod suite;

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use suite::drawn::{drawn, ways};
use suite::{Case, Cell, Session, Verdict, WAYS, Way, cases};

/// Exit status of a run that a method took too long in.
const TOO_LONG: i32 = 124;

/// Attempts at a method: a run may have been stopped for another reason.
const ATTEMPTS: usize = 2;

/// A line of a row's file.
#[derive(Serialize, Deserialize)]
enum Line {
    /// A method begins.
    Begun(String),
    /// Its cells.
    Cells(Vec<Cell>),
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["list"] => {
            cases().iter().for_each(|case| println!("{}", case.name));
            Ok(())
        }
        ["run", number, folder, limit] => case_of(number).and_then(|case| row(&case, &WAYS, (Path::new(folder), limit))),
        ["random", index, folder, limit, models @ ..] => at_random(index, (Path::new(folder), limit), models),
        ["stages", number, names @ ..] => stages(number, names),
        ["page", folder, docs] => page::write(Path::new(folder), Path::new(docs)),
        _ => Err("stability list | run NUMBER FOLDER SECONDS | random INDEX FOLDER SECONDS MODELS... | stages NUMBER METHODS... | page FOLDER DOCS".to_owned()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

/// Processor seconds of this program; 0, so that nothing is stopped, where the system does not tell them.
fn seconds() -> f64 {
    /// Of Linux, on every machine.
    const TICKS_OF_A_SECOND: f64 = 100.0;
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name: Vec<&str> = text.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |index: usize| after_name.get(index).and_then(|word| word.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / TICKS_OF_A_SECOND
}

/// Name of a row's file.
fn file_of(case: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
    format!("{}.jsonl", case.chars().map(plain).collect::<String>())
}

/// Lines of a row's file; none where there is no file.
fn lines(file: &Path) -> Vec<Line> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// The row of a number.
fn case_of(number: &str) -> Result<Case, String> {
    let index: usize = number.parse().map_err(|_| format!("{number}: the number of a row is needed"))?;
    let all = cases();
    let rows = all.len();
    all.into_iter().nth(index).ok_or_else(|| format!("{number}: there are {rows} rows"))
}

/// Prints what some methods, or all, promise for a row, stage by stage.
fn stages(number: &str, names: &[&str]) -> Result<(), String> {
    let case = case_of(number)?;
    let session = Session::new(&case);
    for way in WAYS.iter().filter(|way| names.is_empty() || names.contains(&way.name)) {
        match session.stages(way) {
            Ok(ledgers) => {
                for (of, ledger) in ledgers {
                    println!("{}, {}: {of}, {:.3} %", case.name, way.name, 100.0 * ledger.total_rms());
                    for entry in ledger.entries {
                        let [rms, worst] = [entry.error.rms, entry.error.worst].map(|v| 100.0 * v);
                        println!("  {:20} {rms:8.3} % {worst:8.3} %  {}", entry.stage, entry.note);
                    }
                }
            }
            Err(why) => println!("{}, {}: {}", case.name, way.name, why.message()),
        }
    }
    Ok(())
}

/// Runs what is missing of a scene at random.
fn at_random(index: &str, place: (&Path, &str), models: &[&str]) -> Result<(), String> {
    let index: u64 = index.parse().map_err(|_| format!("{index}: a number is needed"))?;
    let models: Vec<PathBuf> = models.iter().map(PathBuf::from).collect();
    row(&drawn(index, &models), &ways(index), place)
}

/// Runs what is missing of a row. A method that takes too long ends the program, so that the next run goes on with the others.
fn row(case: &Case, ways: &[Way], (folder, limit): (&Path, &str)) -> Result<(), String> {
    let limit: f64 = limit.parse().map_err(|_| format!("{limit}: a number of seconds is needed"))?;
    let file = &folder.join(file_of(&case.name));
    let known = lines(file);
    let mut out = OpenOptions::new().create(true).append(true).open(file).map_err(|e| e.to_string())?;
    let mut put = |line: &Line| -> Result<(), String> {
        let text = serde_json::to_string(line).map_err(|e| e.to_string())?;
        writeln!(out, "{text}").and_then(|()| out.flush()).map_err(|e| e.to_string())
    };
    let begun = Arc::new(Mutex::new(seconds()));
    let watched = Arc::clone(&begun);
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_secs(1));
            if watched.lock().is_ok_and(|begun| seconds() - *begun > limit) {
                std::process::exit(TOO_LONG);
            }
        }
    });
    let mut session = Session::new(case);
    for way in ways {
        let has = |passes: &dyn Fn(&Line) -> bool| known.iter().any(passes);
        if has(&|line| matches!(line, Line::Cells(c) if c.first().is_some_and(|c| c.way == way.name))) {
            continue;
        }
        let attempts = known.iter().filter(|line| matches!(line, Line::Begun(name) if name == way.name)).count();
        let cells = if attempts >= ATTEMPTS {
            let says = || vec![format!("no result within {limit} s")];
            let of =
                |lamp: &suite::lamps::Lamp| Cell::without_figures(case, *lamp, way.name, Verdict::Unfinished, says());
            case.lamps.iter().map(of).collect()
        } else {
            put(&Line::Begun(way.name.to_owned()))?;
            if let Ok(mut begun) = begun.lock() {
                *begun = seconds();
            }
            session.run(way)
        };
        let took = begun.lock().map_or(0.0, |begun| seconds() - *begun);
        for cell in &cells {
            let [found, promised] = [cell.measured.rms, cell.promised.rms].map(|v| 100.0 * v);
            let (case, light, way, verdict) = (&cell.case, &cell.light, &cell.way, cell.verdict);
            println!("{took:6.1} s  {case}, {light}, {way}: {verdict:?}, {found:.3} % of {promised:.3} %");
        }
        put(&Line::Cells(cells))?;
    }
    Ok(())
}
