//! The page and the table of the suite.

use std::fmt::Write;
use std::path::Path;

use crate::suite::{Cell, Verdict, WAYS, cases, planned};
use crate::{Line, file_of, lines};

const HEAD: &str = "\
# Stability: where methods hold and where they fail

Every method on bodies, media and lights that are odd in one way each, baked for the kind of light of the row and the error that is the method's default, against sums over all
pairs of 65,536 samples (16,384 under soft light) with the rays of `reference`, at up to 1,000 vertices. A row is a body and a light; unless it says something else, the body is a head of
642 vertices, 30 mm, in `skin1`, with 8,192 samples, under three suns: from an odd direction, edge-on to the largest flat area, from behind. The rows `head, suns`, `points` and `skies` have
the samples that each method chooses, and a truth of 196,608 (65,536 under soft light). `scripts/stability` makes this page and [the table](stability.csv) again; `tests/stability` runs a few rows and fails where
one is worse than recorded.

**Promised** is the sum of the stages of the asset's ledger; where an asset holds no transport, what `evaluate --measure` tells. A cell passes where measured / promised lies between 0.5
and 1, where both are below what the truth can tell (0.1 %, or its own error), or where the method refuses and says why. The others are
*pessimistic* (less than half of what was promised), *warned* (more than promised, and a warning names a fault of the mesh, the place of the light, or samples too far apart), or **unannounced** (more than
promised, and nothing says so). More is what exceeds the promised error and that of the truth itself (their squares added) by a fiftieth, since the one is measured at other vertices than the other. Where no light falls at all the error is relative to
what the first light of the row brings. What is not finite, or more negative than the worst vertex that was promised, would be *broken*. An asset that holds transport promises for every light of a row: its worst light decides whether that is pessimistic.

";

fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Passed => "passed",
        Verdict::Refused => "refused",
        Verdict::Warned => "warned",
        Verdict::Pessimistic => "pessimistic",
        Verdict::Unannounced => "**unannounced**",
        Verdict::Broken => "**broken**",
        Verdict::Unfinished => "**unfinished**",
    }
}

fn percent(share: f64) -> String {
    let p = 100.0 * share;
    if p == 0.0 {
        "0".to_owned()
    } else if p >= 100.0 {
        format!("{p:.0}")
    } else if p >= 9.95 {
        format!("{p:.1}")
    } else {
        format!("{p:.2}")
    }
}

/// Writes `stability.md` and `stability.csv`.
pub(crate) fn write(folder: &Path, docs: &Path) -> Result<(), String> {
    let mut cells: Vec<Cell> = Vec::new();
    for case in cases() {
        for line in lines(&folder.join(file_of(&case.name))) {
            if let Line::Cells(own) = line {
                cells.extend(own);
            }
        }
    }
    let drawn = at_random(&folder.join(AT_RANDOM))?;
    let put = |name: &str, text: String| std::fs::write(docs.join(name), text).map_err(|e| format!("{name}: {e}"));
    put("stability.md", text(&cells) + &drawn)?;
    put("stability.csv", csv(&cells))
}

/// Folder of the scenes at random in that of the rows.
const AT_RANDOM: &str = "random";

/// What scenes at random came to, by way; nothing where none was run.
fn at_random(folder: &Path) -> Result<String, String> {
    let Ok(files) = std::fs::read_dir(folder) else { return Ok(String::new()) };
    let paths: Vec<_> = files.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let mut runs: Vec<Vec<Cell>> = Vec::new();
    for path in paths.iter().filter(|path| path.extension().is_some_and(|suffix| suffix == "jsonl")) {
        runs.extend(lines(path).into_iter().filter_map(|line| match line {
            Line::Cells(cells) => Some(cells),
            Line::Begun(_) => None,
        }));
    }
    let mut text = SCENES.to_owned();
    let ways: Vec<&str> = planned().iter().chain(&WAYS).map(|way| way.name).collect();
    for way in ways {
        let of_way: Vec<&Vec<Cell>> = runs.iter().filter(|cells| cells.first().is_some_and(|c| c.way == way)).collect();
        let count =
            |verdict: Verdict| of_way.iter().flat_map(|cells| cells.iter()).filter(|c| c.verdict == verdict).count();
        // The worst light of a scene, of those that are brighter than the truth can tell.
        let largest = |cells: &[Cell], of: fn(&Cell) -> f64| cells.iter().map(of).fold(0.0, f64::max);
        let shares: Vec<f64> = of_way
            .iter()
            .map(|cells| [largest(cells, |c| c.measured.rms), largest(cells, |c| c.promised.rms)])
            .filter(|[_, promised]| *promised > 0.0)
            .map(|[measured, promised]| measured / promised)
            .collect();
        let within = shares.iter().filter(|share| **share >= 0.5).count();
        let counts = [Verdict::Passed, Verdict::Refused, Verdict::Pessimistic, Verdict::Warned, Verdict::Unannounced]
            .map(|verdict| count(verdict).to_string());
        let largest = shares.iter().copied().fold(0.0, f64::max);
        let _ = writeln!(
            text,
            "| `{way}` | {} | {} | {} | {largest:.2} | {within} of {} |",
            of_way.len(),
            counts.join(" | "),
            count(Verdict::Broken) + count(Verdict::Unfinished),
            shares.len()
        );
    }
    text.push_str("\nMore than was promised, and nothing says so:\n\n| scene | light | method | measured / promised | the truth's own |\n| --- | --- | --- | --- | --- |\n");
    let mut missed: Vec<&Cell> = runs.iter().flatten().filter(|c| c.verdict == Verdict::Unannounced).collect();
    missed.sort_by(|a, b| (&a.case, &a.way, &a.light).cmp(&(&b.case, &b.way, &b.light)));
    for c in missed {
        let [measured, promised, own] = [c.measured.rms, c.promised.rms, c.truth].map(percent);
        let _ = writeln!(text, "| {} | {} | `{}` | {measured} / {promised} % | {own} % |", c.case, c.light, c.way);
    }
    Ok(text)
}

fn csv(cells: &[Cell]) -> String {
    let mut text = "row;light;method;verdict;promised rms;measured rms;promised p999;measured p999;promised worst;measured worst;promised \
                    dark;measured dark;between vertices;clamped share;truth's own rms;bytes/vertex;says\n"
        .to_owned();
    for c in cells {
        let says: Vec<String> = c.says.iter().map(|line| line.replace([';', '\n'], ",")).collect();
        let _ = write!(text, "{};{};{};{:?}", c.case, c.light, c.way, c.verdict);
        let (p, m) = (&c.promised, &c.measured);
        for value in [p.rms, m.rms, p.p999, m.p999, p.worst, m.worst, p.dark, m.dark, c.between, c.clamped, c.truth] {
            let _ = write!(text, ";{value:.3e}");
        }
        let _ = writeln!(text, ";{:.1};{}", c.bytes_per_vertex, says.join(" | "));
    }
    text
}

fn text(cells: &[Cell]) -> String {
    let mut text = HEAD.to_owned();
    let of = |way: &str, verdict: Verdict| cells.iter().filter(|c| c.way == way && c.verdict == verdict).count();
    let verdicts = [
        Verdict::Passed,
        Verdict::Refused,
        Verdict::Pessimistic,
        Verdict::Warned,
        Verdict::Unannounced,
        Verdict::Broken,
        Verdict::Unfinished,
    ];
    text.push_str(
        "## Counts\n\n| method | passed | refused | pessimistic | warned | unannounced | broken | unfinished |\n",
    );
    text.push_str("| --- | --- | --- | --- | --- | --- | --- | --- |\n");
    for way in WAYS {
        let counts: Vec<String> = verdicts.iter().map(|v| of(way.name, *v).to_string()).collect();
        let _ = writeln!(text, "| `{}` | {} |", way.name, counts.join(" | "));
    }
    let total = |v: Verdict| cells.iter().filter(|c| c.verdict == v).count();
    let counts: Vec<String> = verdicts.iter().map(|v| total(*v).to_string()).collect();
    let _ = writeln!(text, "| all {} | {} |\n", cells.len(), counts.join(" | "));
    text.push_str(REASONS);
    text.push_str(ROWS);
    let _ = writeln!(text, "| row | {} |", WAYS.map(|way| format!("`{}`", way.name)).join(" | "));
    let _ = writeln!(text, "| --- |{}", " --- |".repeat(WAYS.len()));
    for case in cases() {
        // Rows about lights have one each, rows about bodies the worst of theirs.
        let lights: Vec<Vec<String>> = match case.lamps.len() {
            ..=3 => vec![case.lamps.iter().map(|lamp| lamp.name()).collect()],
            _ => case.lamps.iter().map(|lamp| vec![lamp.name()]).collect(),
        };
        for light in &lights {
            let cell = |way: &str| {
                let own = cells.iter().filter(|c| c.case == case.name && c.way == way && light.contains(&c.light));
                own.max_by(|a, b| rank(a).total_cmp(&rank(b))).map_or("not run".to_owned(), short)
            };
            let row: Vec<String> = WAYS.iter().map(|way| cell(way.name)).collect();
            let name =
                if lights.len() > 1 { format!("{}: {}", case.name, light.join(", ")) } else { case.name.clone() };
            let _ = writeln!(text, "| {name} | {} |", row.join(" | "));
        }
    }
    text.push_str(FAILED);
    for c in cells.iter().filter(|c| !matches!(c.verdict, Verdict::Passed | Verdict::Refused)) {
        let (p, m) = (&c.promised, &c.measured);
        let pair = |m: f64, p: f64| format!("{} / {}", percent(m), percent(p));
        let ratio = if p.rms > 0.0 { format!("{:.2}", m.rms / p.rms) } else { String::new() };
        let figures = match c.verdict {
            Verdict::Unfinished => [const { String::new() }; 8],
            _ => [
                pair(m.rms, p.rms),
                ratio,
                pair(m.p999, p.p999),
                pair(m.worst, p.worst),
                pair(m.dark, p.dark),
                percent(c.between),
                percent(c.clamped),
                format!("{:.0}", c.bytes_per_vertex),
            ],
        };
        let says = c.says.join("; ").replace('|', "/").replace('\n', " ");
        let (case, light, way, how) = (&c.case, &c.light, &c.way, verdict(c.verdict));
        let _ = writeln!(text, "| {case} | {light} | `{way}` | {how} | {} | {says} |", figures.join(" | "));
    }
    text
}

/// A cell of the table of rows.
fn short(c: &Cell) -> String {
    let figures = format!("{} / {}", percent(c.measured.rms), percent(c.promised.rms));
    match c.verdict {
        Verdict::Passed => figures,
        Verdict::Refused => "r".to_owned(),
        Verdict::Pessimistic => format!("{figures} p"),
        Verdict::Warned => format!("{figures} w"),
        Verdict::Unannounced => format!("{figures} **u**"),
        Verdict::Broken => "**b**".to_owned(),
        Verdict::Unfinished => "**-**".to_owned(),
    }
}

/// The worse, the larger.
fn rank(c: &Cell) -> f64 {
    let verdict = match c.verdict {
        Verdict::Refused => 0.0,
        Verdict::Passed => 1.0,
        Verdict::Pessimistic => 2.0,
        Verdict::Warned => 3.0,
        Verdict::Unannounced => 4.0,
        Verdict::Unfinished => 5.0,
        Verdict::Broken => 6.0,
    };
    let excess = c.measured.rms / c.promised.rms.max(1e-12);
    verdict + 1.0 - 1.0 / (1.0 + excess)
}

const ROWS: &str = "\
## Rows

Measured / promised RMS in %, under the worst light of the row; r: refused, p: pessimistic, w: warned, **u**: unannounced, **b**: broken, **-**: unfinished.

";

const SCENES: &str = "
## Scenes at random

Bodies (half of them models that `scripts/stability --random N MODELS...` is given, the others heads, boxes, balls, tori, knots and planes of 12 to 20,000 triangles, turned, drawn out, a tenth with holes), 3 to 300 mm, presets and media of any
coefficients, three lights of one kind from any side and 1.05 to 8 radii away; each baked by the planner with both models, and by two methods in turn, on defaults. `auto` promises what was asked (1 %, or what it says instead);
it is pessimistic where the worst of the three lights is less than half of what its verdict found. The share of a scene is the worst light's measured error over the largest that is promised; the truth's own error is in what is measured.

| method | scenes | passed | refused | pessimistic | warned | unannounced | broken, unfinished | worst share | at least half |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
";

const FAILED: &str = "
## Cells that do not pass

In % of the RMS radiosity, measured / promised; dark is relative to the mean of the dark part. All cells are in [the table](stability.csv).

| row | light | method | verdict | RMS | ratio | 99.9 % | worst | dark half | between vertices | clamped | bytes/vertex | says |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
";

/// Why cells do not pass, and what is left: written by hand after a run.
const REASONS: &str = "\
## What fails, and why

Of the run of 2026-11-29, evening; 21 cells were unannounced in that of the afternoon, whose ledgers of `quantized_lights` and `all_frequency` had no error of samples, and that of `editable stored` none of its near field. The row of a million triangles takes longer than all others together and was not run: on a program of the day before `reference` and `two_pass` did not end within 240 processor seconds under three suns, `editable` was pessimistic (0.43 of 1.32 %), and with stored transport it passed (0.93 of 1.03 %), as did `quantized_lights` (1.80 of 2.84 %).

| what | why |
| --- | --- |
| `filtered_normals`, a sun along a sheet, 653 of 639 %; a spot of half a degree | its error differs by direction, most under light that grazes, where little light falls and the error is relative to that: forty suns and lamps in its ledger, and a tenth more, do not have the worst of all; a spot narrower than the vertices lie apart falls on none of them, and the warning of narrow spots knows samples alone |
| `filtered_normals`, a lamp on the surface or inside the body | it has the light's direction at the vertex, and no surface around it; a warning names the light |
| `texture_space`, facing walls, a sun behind; under a sky beside `one coefficient`, 0.26 of 0.19 % | the terminator passes between texels there, and under no sun of the ledger; rays of the sky |
| `texture_space`, 8 to 12 % off on a head of 10 m and at an albedo of 0.001 (*unannounced* there: 12.3 of 11.2 %) | texels at the edges of charts do not cover all of the surface, and light leaves where it enters; its ledger says most of it |
| `editable` (*warned*), a head of 1 and 10 m, an albedo of 0.001 | samples lie 8 to 100 mean free paths apart: a single vertex at the edge of a shadow is off by a quarter to a half, under one sun and not under another; a warning says it where samples are kept, and ledgers of `quantized_lights` and `all_frequency`, which keep none, have it among the errors of their samples |
| `all_frequency`, edge-on to a plane (*unannounced*: 13.3 of 13.0 %), a sheet or a triangle | 1,024 harmonics resolve 6 degrees: light 3 degrees above a plane is up to two thirds too bright or too dark; the ledger says so since edge-on suns are among its lights, and is pessimistic for other suns |
| `quantized_lights`, `all_frequency`, `editable stored`, pessimistic | the ledger has edge-on suns, under which little light falls and errors are large beside it, and adds its stages up; with the squares of the samples' error and of the rest 23 fewer cells would be, and 2 more unannounced; `editable stored` promises for 13 materials |
| `two_pass`, `reference`, pessimistic on the sheet, the elephant and under a narrow spot | errors of sampling are told by half as many samples, which miss thin parts that all of them have |
| a light on the surface, and a spot narrower than the samples lie apart (*warned*) | warnings name them |
| between vertices, all methods that end at vertices | a mesh property: 68 % on the cube of 12 triangles, 21 % on walls that face each other; the import warns from 5 % on, `render` takes the exitance at each pixel where the asset gathers at run time, and `bake --refine auto` adds the vertices that the others need |
| dark half of `quantized_lights` and `all_frequency` | errors of functions of the light and of their coding are as large in the dark as in the light; told by the bake, not mended |

Not in the table: constants of the medium in 8 bits (the encodings of `examples/papers` have them, no method does), and calibrated kernels, which the [planner](planner.md#calibrated-kernels) and the [model](model.md) have pages for.

";
