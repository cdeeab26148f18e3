//! Options in files: `--config`, `--print-config` and lists of jobs; progress for programs; pages of the manual.

use serde_json::Value;
use translux::geometry::shapes;

use crate::common::Folder;

const BAKE: &str = "bake ball.obj --unit mm --material marble --method two_pass --samples 150 --set points=4";

fn folder() -> Folder {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(1.5, 1));
    folder
}

/// A bake's own options as a file, with the values as types of TOML and as the text that would be typed.
#[test]
fn a_file_gives_the_bake_that_its_options_give() {
    let folder = folder();
    folder.run(&format!("{BAKE} -o typed.tlux")).ok();
    let is_same = |line: &str| {
        folder.run(&format!("{line} -o a.tlux")).ok();
        folder.read("a.tlux") == folder.read("typed.tlux")
    };
    folder.write(
        "typed.toml",
        "input = \"ball.obj\"\nunit = \"mm\"\nmaterial = [\"marble\"]\nmethod = \"two_pass\"\nsamples = 150\nset = { points = 4 }\n",
    );
    folder.write(
        "texts.toml",
        "input = 'ball.obj'\nunit = 'mm'\nmaterial = 'marble'\nmethod = 'two_pass'\nsamples = '150'\nset = ['points=4']\n",
    );
    for file in ["typed.toml", "texts.toml"] {
        assert!(is_same(&format!("bake --config {file}")));
        let printed = folder.run(&format!("bake --config {file} -o a.tlux --print-config")).ok().text();
        assert!(printed.contains("samples = 150\n") && printed.contains("set = \"points=4\"\n"), "{printed}");
        folder.write("printed.toml", &printed);
        assert_eq!(folder.run("bake --config printed.toml --print-config").ok().text(), printed);
        assert!(is_same("bake --config=printed.toml"));
    }
    // What is typed beats the file: a value, a value for a name, one of several that exclude each other, an option in place of a flag.
    folder.write(
        "other.toml",
        "unit = 'cm'\nmaterial = 'skin1'\nsamples = 99\nset = ['points=2']\nmethod = 'reference'\nif-changed = true\n",
    );
    assert!(is_same(&format!("{BAKE} --config other.toml")));
    folder.run("bake --config other.toml ball.obj --size-mm 3 --dry-run -o a.tlux --method two_pass").ok();
    // Both without a file.
    let printed = folder.run(&format!("{BAKE} -o a.tlux --strict --print-config")).ok().text();
    assert!(printed.contains("strict = true\n") && !printed.contains("quiet"), "{printed}");
}

#[test]
fn errors_in_a_file_name_its_line() {
    let folder = folder();
    let bake = "bake --config a.toml ball.obj -o a.tlux";
    for (text, place, fragment) in [
        ("unit = 'mm'\nsize_mm = 3", "a.toml:2: size_mm", "did you mean size-mm?"),
        ("unit = 'mm'\n\ncolour = 3", "a.toml:3: colour", "no such option"),
        ("config = 'b.toml'", "a.toml:1: config", "no such option"),
        ("unit = 'mm'\nstrict = 1", "a.toml:2: strict", "true or false"),
        ("unit = { a = 3 }", "a.toml:1: unit", "a text or a number"),
        ("unit = 'ell'", "a.toml:1: ", "[possible values: mm, cm, m]"),
        ("samples = -3", "a.toml:1: ", "--samples"),
        ("unit = 'mm'\nsize-mm = 3", "a.toml:", "cannot be used with"),
        ("unit = 'mm'\nmax-rms = '700%'", "a.toml:2: --max-rms", "700%"),
        ("method = 'two-pass'\nunit = 'mm'", "a.toml:1: ", "two-pass"),
        ("unit = 'mm'\nmethod = 'two_pass'\n[set]\ncolour = 'red'", "a.toml:4: ", "no such key"),
        ("unit = 'mm\n", "a.toml:1: ", ""),
    ] {
        folder.write("a.toml", text);
        folder.run(bake).fails(1, &[place, fragment]);
    }
    let report = folder.run(&format!("{bake} --json")).json();
    assert_eq!((&report["path"], &report["line"]), (&"a.toml".into(), &1.into()));
    folder.run("bake --config none.toml ball.obj -o a.tlux").fails(2, &["none.toml"]);
    folder.write("a.toml", "unit = 'mm'");
    folder.run("bake --config a.toml -o a.tlux").fails(1, &["<MODEL>"]);
    assert!(!folder.path("a.tlux").exists());
}

#[test]
fn jobs_are_done_whatever_becomes_of_the_others() {
    let folder = folder();
    folder.write(
        "list.toml",
        "[defaults]\nunit = 'mm'\nmaterial = 'marble'\nmethod = 'two_pass'\nset = { points = 4 }\nsamples = 99\n
[[job]]\ninput = 'ball.obj'\noutput = 'a.tlux'\n
[[job]]\ninput = 'none.obj'\noutput = 'b.tlux'\n
[[job]]\ninput = 'ball.obj'\noutput = 'c.tlux'\nset = { points = 2 }\nsize-mm = 4\nmaterial = 'skin1'\n
[[job]]\ninput = 'ball.obj'\noutput = 'none/d.tlux'\n",
    );
    let done = folder.run("bake --jobs list.toml --samples 150 --json").fails(2, &["none.obj", "none/d.tlux"]);
    let report = done.json();
    assert_eq!(
        (&report["schema"], &report["failed"], &report["exit"]),
        (&"translux.jobs.v1".into(), &2.into(), &2.into())
    );
    let jobs = report["jobs"].as_array().unwrap();
    let exits: Vec<&Value> = jobs.iter().map(|job| &job["exit"]).collect();
    assert_eq!(exits, [0, 2, 0, 2]);
    assert_eq!((&jobs[0]["line"], &jobs[0]["report"]["written"]), (&8.into(), &true.into()));
    assert!((jobs[2]["report"]["diagonal_mm"].as_f64().unwrap() - 4.0).abs() < 1e-4);
    assert_eq!(jobs[2]["report"]["media"][0]["name"], "skin1");
    assert!(jobs[1]["report"].is_null() && jobs[1]["message"].as_str().unwrap().contains("none.obj"));
    assert_eq!(folder.names(), ["a.tlux", "ball.obj", "c.tlux", "list.toml"]);
    // The bytes of a bake alone.
    folder.run(&format!("{BAKE} -o typed.tlux")).ok();
    assert!(folder.read("typed.tlux") == folder.read("a.tlux"));
    let text = folder.run("bake --jobs list.toml --samples 150").fails(2, &["[3/4] ball.obj -> c.tlux"]).text();
    assert!(text.contains("2 of 4 done") && text.lines().count() == 5, "{text}");

    for (list, fragments) in [
        ("[[job]]\ninput='ball.obj'\noutput='x.tlux'\nthreads=2", ["list.toml:4: threads", "beside --jobs"]),
        ("[[job]]\ninput='ball.obj'\n", ["list.toml:1: ", "--output"]),
        ("[[job]]\ninput='a'\noutput='x.tlux'\n[[job]]\ninput='a'\noutput='x.tlux'", ["list.toml:4: output", "line 1"]),
        ("[[job]]\ninput='a'\noutput='x.tlux'\nmax-rms=7", ["list.toml:4: --max-rms", "7"]),
        ("[default]\nunit='mm'", ["list.toml:1: default", "[[job]]"]),
        ("[defaults]\noutput='x.tlux'", ["list.toml:2: output", "its own"]),
        ("", ["list.toml:1: ", "[[job]]"]),
    ] {
        folder.write("list.toml", list);
        folder.run("bake --jobs list.toml").fails(1, &fragments);
    }
    folder.run("bake ball.obj --jobs list.toml").fails(1, &["`ball.obj`", "its own"]);
    folder.run("bake --jobs list.toml --config a.toml").fails(1, &["--config", "--jobs"]);
}

#[test]
fn progress_can_be_read_by_programs() {
    let folder = folder();
    let done = folder.run(&format!("{BAKE} -o a.tlux -q --progress json")).ok();
    let lines: Vec<Value> = done.stderr.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    lines.iter().for_each(crate::common::schema::check);
    assert!(lines.len() >= 4 && lines.iter().all(|line| line["schema"] == "translux.progress.v1"));
    for stage in lines.iter().filter(|line| line["event"] == "start") {
        let end = lines.iter().find(|line| line["event"] == "end" && line["stage"] == stage["stage"]).unwrap();
        assert!(end["seconds"].as_f64().unwrap() >= 0.0 && end["total"] == stage["total"]);
        assert!(end["total"].is_null() || end["done"] == end["total"], "{end}");
    }
    assert_eq!(folder.run(&format!("{BAKE} -o a.tlux -q")).ok().stderr, "");
}

#[test]
fn pages_of_the_manual_have_what_help_has() {
    let folder = folder();
    let page = folder.run("man bake").ok().text();
    assert!(page.starts_with(".ie") && page.contains("translux\\-bake") && page.contains("\\-\\-max\\-rms"), "{page}");
    assert!(folder.run("man").ok().text().contains("Exit codes"));
    folder.run("man nothing").fails(1, &["man nothing", "bake"]);
    folder.run("man -o pages").ok();
    for page in ["translux.1", "translux-bake.1", "translux-man.1"] {
        assert!(folder.path("pages").join(page).is_file(), "{page}");
    }
}

#[test]
fn several_files_are_compared_with_one() {
    let folder = folder();
    for (name, samples) in [("a", 150), ("b", 150), ("c", 60)] {
        folder.run(&format!("{BAKE} -o {name}.tlux").replace("--samples 150", &format!("--samples {samples}"))).ok();
    }
    folder.run("compare a.tlux b.tlux a.tlux").ok();
    let compared = folder.run("compare c.tlux b.tlux none.tlux a.tlux --json").fails(7, &["none.tlux"]).json();
    let files: Vec<_> = compared["files"].as_array().unwrap().iter().map(|file| (&file["a"], &file["equal"])).collect();
    assert_eq!(files, [(&"c.tlux".into(), &false.into()), (&"b.tlux".into(), &true.into())]);
    assert_eq!((&compared["failed"][0]["path"], &compared["failed"][0]["exit"]), (&"none.tlux".into(), &2.into()));
    assert_eq!(folder.run("compare b.tlux b.tlux a.tlux -q").ok().text(), "");
}
