//! What the program prints where, and what it leaves behind when it is interrupted.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::common::{Folder, Outcome};
use translux::geometry::shapes;

const MODEL: &str = "ball.obj --unit mm --material skin1 --samples 500";
const LIGHT: &str = "--light directional:from=1,2,3:irradiance=2";

/// A ball, its asset and its radiosity.
fn ball() -> Folder {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(8.0, 2));
    folder.run(&format!("bake {MODEL} --method two_pass -o a.tlux")).ok();
    folder.run(&format!("evaluate a.tlux {LIGHT} -o b.ply")).ok();
    folder
}

/// One line for each command, all of them successful.
fn every_command() -> Vec<String> {
    vec![
        format!("bake {MODEL} --method two_pass -o c.tlux"),
        format!("evaluate a.tlux {LIGHT} -o c.ply"),
        format!("evaluate a.tlux {LIGHT} --measure -o c.ply"),
        format!("reference {MODEL} {LIGHT} -o c.ply"),
        "inspect a.tlux".to_owned(),
        "compare b.ply b.ply".to_owned(),
        "materials".to_owned(),
        "methods".to_owned(),
        "methods two_pass".to_owned(),
    ]
}

#[test]
fn reports_are_json_with_a_schema() {
    let folder = ball();
    for line in every_command() {
        let outcome = folder.run(&format!("{line} --json")).ok();
        let report = outcome.json();
        let command = line.split(' ').next().unwrap();
        assert_eq!(report["schema"], format!("translux.{command}.v1"), "{line}");
        assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
        assert!(report["timings"]["seconds"].as_f64().unwrap() > 0.0, "{line}");
        assert!(
            report["timings"]["peak_memory_bytes"].as_u64().unwrap() > 1 << 20,
            "{line}: {}",
            report["timings"]["peak_memory_bytes"]
        );
        assert!(report["timings"]["threads"].as_u64().unwrap() >= 1, "{line}");
        assert!(report["warnings"].is_array(), "{line}");
        let stages = report["timings"]["stages"].as_array().unwrap();
        assert!(stages.iter().all(|s| s["stage"].is_string() && s["seconds"].as_f64().unwrap() >= 0.0), "{line}");
        if ["bake", "evaluate", "reference"].contains(&command) {
            assert!(stages.iter().any(|s| s["stage"] == "write"), "{line}: {stages:?}");
            let sum: f64 = stages.iter().map(|s| s["seconds"].as_f64().unwrap()).sum();
            assert!(sum <= report["timings"]["seconds"].as_f64().unwrap(), "{line}: the stages take {sum} s");
        }
    }
}

#[test]
fn quiet_is_silent() {
    let folder = ball();
    for line in every_command() {
        let outcome = folder.run(&format!("{line} -q")).ok();
        assert_eq!(outcome.stderr, "", "{line}");
        let asked_for = ["inspect", "materials", "methods"].contains(&line.split(' ').next().unwrap());
        assert_eq!(!outcome.stdout.is_empty(), asked_for, "{line}: {}", outcome.text());
    }
    folder.run("evaluate none.tlux -o c.ply -q").fails(2, &["translux: none.tlux"]);
}

/// The size line, once, wherever a model is read; standard output stays free.
#[test]
fn the_size_is_said() {
    let folder = ball();
    for line in [format!("bake {MODEL} --method two_pass -o c.tlux"), format!("reference {MODEL} {LIGHT} -o c.ply")] {
        for flags in ["", " --json"] {
            let outcome = folder.run(&format!("{line}{flags}")).ok();
            let sizes: Vec<&str> = outcome.stderr.lines().filter(|l| l.starts_with("SIZE ")).collect();
            let [size] = sizes[..] else { panic!("{}", outcome.stderr) };
            for fragment in ["mm across", "skin1: mean free path 1.30 0.952 0.671 mm", "diffusion length 3.67", "%"] {
                assert!(size.contains(fragment), "{size}");
            }
            assert_eq!(outcome.stdout.is_empty(), flags.is_empty());
        }
    }
}

#[test]
fn standard_output_takes_the_ply_and_nothing_else() {
    let folder = ball();
    for (line, file) in [
        (format!("evaluate a.tlux {LIGHT} -o -"), "b.ply"),
        (format!("reference {MODEL} {LIGHT} --method two_pass -o -"), "b.ply"),
    ] {
        assert!(folder.run(&line).ok().stdout == folder.read(file), "{line}");
    }
    let both: Outcome = folder.run(&format!("evaluate a.tlux {LIGHT} -o - -o c.ply -o d.ply")).ok();
    assert!(both.stdout == folder.read("b.ply") && folder.read("c.ply") == both.stdout);
    assert!(folder.read("d.ply") == both.stdout);
    assert!(folder.run(&format!("bake {MODEL} --method two_pass -o -")).ok().stdout == folder.read("a.tlux"));
    // A closed pipe is an end, not a crash.
    for line in ["inspect a.tlux -q", &format!("evaluate a.tlux {LIGHT} -q -o -")] {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_translux"))
            .current_dir(folder.path(""))
            .args(line.split_whitespace())
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && said.is_empty(), "{line}: {said}");
    }
}

/// Output that cannot be written is an error, help and version included, and is noticed before the work.
#[test]
#[cfg(target_os = "linux")]
fn what_cannot_be_written_is_an_error() {
    let folder = ball();
    let full = || std::process::Stdio::from(std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    for line in ["--help", "--version", "bake --help", "methods", "inspect a.tlux", "inspect a.tlux --json"] {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_translux"));
        let output = command.current_dir(folder.path("")).args(line.split(' ')).stdout(full()).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {stderr}");
        assert!(stderr.contains("standard output"), "{line}: {stderr}");
    }
    // The folder is tried before the model is read: that the model does not exist is not noticed.
    for line in [
        "bake none.obj --unit mm --material marble -o /proc/a.tlux",
        "reference none.obj --unit mm --material marble -o /proc/a.ply",
        "evaluate none.tlux -o /proc/a.ply",
        "render none.tlux -o /proc/a.png",
    ] {
        folder.run(line).fails(2, &["-o", "/proc/a."]);
    }
    // A limit on the size of files is an error, not the end of the process.
    let line = format!("ulimit -f 1; exec \"$0\" evaluate a.tlux {LIGHT} -o limited.ply");
    let mut shell = std::process::Command::new("sh");
    let output =
        shell.current_dir(folder.path("")).args(["-c", &line, env!("CARGO_BIN_EXE_translux")]).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && stderr.contains("limited.ply"), "{:?}: {stderr}", output.status);
    assert_eq!(folder.names(), ["a.tlux", "b.ply", "ball.obj"]);
}

/// A link stays a link, and the file that it names is replaced.
#[test]
#[cfg(unix)]
fn an_output_that_is_a_link_stays_one() {
    let folder = ball();
    std::fs::create_dir(folder.path("store")).unwrap();
    std::os::unix::fs::symlink("store/c.ply", folder.path("c.ply")).unwrap();
    for _ in 0..2 {
        folder.run(&format!("evaluate a.tlux {LIGHT} -o c.ply")).ok();
        assert!(folder.path("c.ply").is_symlink());
        assert!(folder.read("store/c.ply") == folder.read("b.ply"));
    }
}

/// A target that exists is replaced whole, with its permissions.
#[test]
#[cfg(unix)]
fn an_existing_file_is_replaced_and_keeps_its_mode() {
    use std::os::unix::fs::PermissionsExt;
    let folder = ball();
    folder.write("c.ply", vec![7; 1 << 20]);
    std::fs::set_permissions(folder.path("c.ply"), std::fs::Permissions::from_mode(0o640)).unwrap();
    folder.run(&format!("evaluate a.tlux {LIGHT} -o c.ply")).ok();
    assert!(folder.read("c.ply") == folder.read("b.ply"));
    assert_eq!(std::fs::metadata(folder.path("c.ply")).unwrap().permissions().mode() & 0o777, 0o640);
    assert_eq!(folder.names(), ["a.tlux", "b.ply", "ball.obj", "c.ply"]);
}

/// Names need not be UTF-8, nor free of spaces; a report shows them as well as it can.
#[test]
#[cfg(target_os = "linux")]
fn names_may_hold_any_bytes() {
    use std::os::unix::ffi::OsStringExt;
    let folder = ball();
    let name = |suffix: &str| std::ffi::OsString::from_vec([b"b \xff:=,".as_slice(), suffix.as_bytes()].concat());
    std::fs::copy(folder.path("ball.obj"), folder.path("").join(name(".obj"))).unwrap();
    let run = |command: &str, input: &str, rest: &str, output: Option<&str>| {
        let mut words = vec![command.into(), name(input)];
        words.extend(rest.split_whitespace().map(std::ffi::OsString::from));
        words.extend(output.into_iter().flat_map(|suffix| ["-o".into(), name(suffix)]));
        folder.run_words(words).ok().json()
    };
    run("bake", ".obj", "--unit mm --material skin1 --samples 500 --method two_pass --json", Some(".tlux"));
    run("evaluate", ".tlux", &format!("{LIGHT} --json"), Some(".ply"));
    run("inspect", ".tlux", "--json", None);
    let report = run("compare", ".ply", "b.ply --json", None);
    assert_eq!(report["equal"], true);
    assert_eq!(report["a"], "b \u{fffd}:=,.ply");
}

#[cfg(unix)]
mod interrupts {
    use super::*;
    use std::process::{Child, Command, Output, Stdio};
    use std::time::{Duration, Instant};

    fn start(folder: &Folder, line: &str) -> Child {
        // A shell without job control has what it starts in the background ignore interrupts, these tests and their children included.
        let mut command = match cfg!(target_os = "linux") {
            true => {
                let mut command = Command::new("env");
                command.args(["--default-signal=INT,TERM,HUP", env!("CARGO_BIN_EXE_translux")]);
                command
            }
            false => Command::new(env!("CARGO_BIN_EXE_translux")),
        };
        command.current_dir(folder.path("")).args(line.split_whitespace());
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    fn signal(child: &Child, name: &str) {
        // It may have ended already; then there is nothing to signal.
        let _ = Command::new("kill").args([name, &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
    }

    fn end(child: Child) -> Output {
        let started = Instant::now();
        let output = child.wait_with_output().unwrap();
        assert!(started.elapsed() < Duration::from_secs(5), "the signal was not heard");
        output
    }

    /// Minutes of work, interrupted: nothing new, nothing lost.
    #[test]
    fn long_work_leaves_nothing_behind() {
        let folder = Folder::new();
        folder.obj("head.obj", &shapes::bumpy_head(30.0, 6)).write("old.ply", "precious");
        for (name, target, code) in [("-TERM", "out.ply", 143), ("-INT", "out.ply", 130), ("-HUP", "old.ply", 129)] {
            let line = "reference head.obj --unit mm --material skin1 --samples 1000000 --threads 2 -o";
            let child = start(&folder, &format!("{line} {target}"));
            std::thread::sleep(Duration::from_millis(700));
            signal(&child, name);
            let output = end(child);
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(code), "{name}: {stderr}");
            assert!(stderr.contains("interrupted"), "{name}: {stderr}");
            assert_eq!(folder.names(), ["head.obj", "old.ply"], "{name}");
            assert_eq!(folder.read("old.ply"), b"precious");
        }
    }

    /// What was killed leaves a file that the next write into that folder removes; what whoever started us ignores does not end us.
    #[test]
    fn what_is_killed_is_tidied_up_and_nohup_is_heeded() {
        let folder = ball();
        folder.write(".translux-dead00.part", "half");
        folder.run(&format!("evaluate a.tlux {LIGHT} -o c.ply")).ok();
        assert_eq!(folder.names(), ["a.tlux", "b.ply", "ball.obj", "c.ply"]);
        folder.obj("head.obj", &shapes::bumpy_head(30.0, 5));
        let work = "reference head.obj --unit mm --material skin1 --samples 20000 --no-measure -o d.ply";
        let line = format!("trap '' HUP; exec \"$0\" {work}");
        let mut shell = Command::new("sh");
        shell.current_dir(folder.path("")).args(["-c", &line, env!("CARGO_BIN_EXE_translux")]);
        let child = shell.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(300));
        signal(&child, "-HUP");
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(folder.path("d.ply").exists());
    }

    /// Short work, interrupted at any moment: the old file or the new one, whole, and no temporary file.
    #[test]
    fn a_file_is_the_old_one_or_the_new_one() {
        let folder = ball();
        folder.write("c.ply", "precious");
        let line = format!("evaluate a.tlux {LIGHT} -o c.ply -o d.ply");
        let once = Instant::now();
        folder.run(&line).ok();
        let whole_run = once.elapsed();
        let (old, new) = (b"precious".to_vec(), folder.read("b.ply"));
        let mut codes = [0, 0];
        for step in 0..30u32 {
            // A machine that has become slower gets more time, until a run has come to its end.
            let slower = 1 << step.saturating_sub(23);
            if slower > 1 && codes[0] > 0 {
                break;
            }
            folder.write("c.ply", &old);
            let _ = std::fs::remove_file(folder.path("d.ply"));
            let child = start(&folder, &line);
            std::thread::sleep(whole_run * slower * step / 20);
            signal(&child, "-TERM");
            let output = end(child);
            let (c, names) = (folder.read("c.ply"), folder.names());
            let stderr = String::from_utf8_lossy(&output.stderr);
            // Before the program listens, the signal ends it as it ends any other.
            match output.status.code() {
                Some(0) => codes[0] += 1,
                Some(143) | None => codes[1] += 1,
                other => panic!("step {step}: exit code {other:?}: {stderr}"),
            }
            assert!(c == old || c == new, "step {step}: {} bytes", c.len());
            assert!(names.iter().all(|n| !n.contains("translux") && !n.ends_with(".part")), "step {step}: {names:?}");
            if output.status.success() || names.iter().any(|n| n == "d.ply") {
                assert!(c == new && folder.read("d.ply") == new, "step {step}");
            }
        }
        assert!(codes[0] > 0 && codes[1] > 0, "the moments were not spread: {codes:?}");
    }
}
