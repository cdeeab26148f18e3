//! A thin version of the stability suite: rows on which every method has failed before, against the verdicts that `docs/stability.csv`
//! records. `scripts/stability` runs all rows and writes that file and its page.
#![allow(clippy::unwrap_used)]

mod suite;

use std::collections::BTreeMap;
use std::path::Path;

use suite::{Case, Cell, Session, Verdict, WAYS, Way, cases};

/// The recorded verdicts by case, light and way.
fn recorded() -> BTreeMap<[String; 3], String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/stability.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(';').collect();
        ([0, 1, 2].map(|i| cells[i].to_owned()), cells[3].to_owned())
    };
    text.lines().skip(1).map(row).collect()
}

/// What is wrong with the cells of a case, against the record.
fn worse(cells: &[Cell], recorded: &BTreeMap<[String; 3], String>) -> Vec<String> {
    let told = |cell: &Cell| {
        let key = [&cell.case, &cell.light, &cell.way].map(String::clone);
        let verdict = format!("{:?}", cell.verdict);
        let known = recorded.get(&key).cloned().unwrap_or_else(|| "nothing".to_owned());
        let good = matches!(cell.verdict, Verdict::Passed | Verdict::Refused);
        let (found, promised) = (100.0 * cell.measured.rms, 100.0 * cell.promised.rms);
        (cell.verdict == Verdict::Broken || (!good && verdict != known))
            .then(|| format!("{key:?}: {verdict}, recorded {known}; {found:.3} % of {promised:.3} %; {:?}", cell.says))
    };
    cells.iter().filter_map(told).collect()
}

fn check(name: &str, ways: impl Fn(&Way) -> bool) {
    let case: Case = cases().into_iter().find(|case| case.name == name).unwrap();
    let recorded = recorded();
    let (mut wrong, mut session) = (Vec::new(), Session::new(&case));
    for way in WAYS.iter().filter(|way| ways(way)) {
        let cells = session.run(way);
        assert_eq!(cells.len(), case.lamps.len());
        wrong.extend(worse(&cells, &recorded));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_cube_of_twelve_triangles() {
    check("cube of 12 triangles", |_| true);
}

#[test]
fn mixed_winding() {
    check("mixed winding", |way| ["two_pass", "filtered_normals"].contains(&way.name));
}

#[test]
fn one_triangle() {
    check("one triangle", |_| true);
}

#[test]
fn an_open_plane() {
    check("open plane", |way| ["two_pass", "all_frequency", "texture_space"].contains(&way.name));
}

#[test]
fn a_body_of_many_mean_free_paths() {
    check("head of 10 m", |way| ["two_pass", "texture_space"].contains(&way.name));
}

#[test]
fn a_basis_outside_its_range() {
    check("edited to what no basis holds", |way| way.name == "editable stored");
}
