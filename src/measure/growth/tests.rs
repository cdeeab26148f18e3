use super::super::chart::draw::{as_png, as_svg};
use super::draw::{Curves, cost_text, size_text};
use super::*;

/// Three sizes of two methods: the cost of one grows with the square, that of the other with the size; the largest size
/// of the latter was not timed.
pub(crate) fn example() -> Growth {
    let point = |method: &str, size: f64, exponent: f64, relit: bool| {
        let cost = 1e-3 * size.powf(exponent);
        Point {
            axis: Axis::Vertices,
            method: method.into(),
            size,
            vertices: size as usize,
            size_mm: 30.0,
            size_over_mean_free_path: 90.0,
            command: format!("translux bake knot-{size}.glb --material \"a, b\""),
            costs: Some(Costs {
                samples: 1000,
                bake_seconds: cost,
                bake_stages: vec![("samples".into(), 0.5 * cost)],
                peak_memory_bytes: 10_000_000,
                file_bytes: 90_000,
                bytes: (size * 40.0) as u64,
                environment_bytes: 0,
                resident_bytes: (size * 100.0) as u64,
                open_ms: 1.0,
                relight_ms: relit.then(|| Quantiles::of([cost * 100.0])),
                relights: usize::from(relit),
            }),
            skipped: (!relit)
                .then(|| Skipped { what: Missing::Relight, reason: "about 9 min predicted, 2 min allowed".into() }),
        }
    };
    let mut points: Vec<Point> = [1e3, 1e4, 1e5].map(|size| point("reference", size, 1.5, true)).into();
    points.extend([1e3, 1e4, 1e5].map(|size| point("two_pass", size, 1.0, size < 9e4)));
    points.push(Point {
        costs: None,
        skipped: Some(Skipped { what: Missing::Bake, reason: "<too> much memory".into() }),
        ..point("two_pass", 1e6, 1.0, true)
    });
    let mut growth = Growth {
        schema: SCHEMA.into(),
        version: "0".into(),
        machine: Machine { processor: "a <processor>".into(), threads: 2, load: Some(0.5) },
        limits: Limits { seconds: 120.0, memory_bytes: 4_000_000_000 },
        material: "marble".into(),
        light: "constant:radiance=1".into(),
        surface: surface::DESCRIPTION.into(),
        fixed_samples: None,
        points,
        growing: Vec::new(),
    };
    growth.fit();
    growth
}

fn of<'a>(growth: &'a Growth, method: &str, quantity: Quantity) -> &'a Growing {
    growth.growing.iter().find(|g| g.method == method && g.quantity == quantity).unwrap()
}

#[test]
fn what_grows_faster_than_size_is_a_finding_with_its_reason() {
    let growth = example();
    let bake = of(&growth, "reference", Quantity::BakeSeconds);
    assert!(bake.finding && bake.explanation.is_none());
    assert!((bake.law.unwrap().exponent - 1.5).abs() < 1e-9 && (bake.end_exponent.unwrap() - 1.5).abs() < 1e-9);
    assert!(page::finding_text(bake).ends_with("not explained"), "{}", page::finding_text(bake));
    let relight = of(&growth, "reference", Quantity::RelightMs);
    assert!(relight.finding && page::finding_text(relight).contains("all pairs"));
    let fine = of(&growth, "two_pass", Quantity::BakeSeconds);
    assert!(!fine.finding && fine.explanation.is_none() && (fine.law.unwrap().exponent - 1.0).abs() < 1e-9);
    // Two timings are no fit.
    assert_eq!(of(&growth, "two_pass", Quantity::RelightMs).law, None);
    // All points have what every process has, and none has an environment.
    let memory = of(&growth, "two_pass", Quantity::PeakMemoryBytes);
    assert_eq!((memory.law, memory.below_floor.as_slice()), (None, &[1e3, 1e4, 1e5][..]));
    assert!(!growth.growing.iter().any(|g| g.quantity == Quantity::EnvironmentBytes));
    assert_eq!(growth.findings().count(), 2);
}

#[test]
fn a_bend_at_the_end_is_a_finding_too() {
    let mut growth = example();
    let costs = [1.0, 1.0, 1.0, 1.0, 6.0];
    let template = growth.points[0].clone();
    growth.points = costs
        .iter()
        .enumerate()
        .map(|(i, seconds)| {
            let mut point = Point { size: 3f64.powi(i as i32), ..template.clone() };
            point.costs.as_mut().unwrap().bake_seconds = *seconds;
            point
        })
        .collect();
    growth.fit();
    let bake = of(&growth, "reference", Quantity::BakeSeconds);
    assert!(
        bake.law.unwrap().exponent < FASTER_THAN_SIZE && bake.end_exponent.unwrap() > 1.5 && bake.finding,
        "{bake:?}"
    );
}

#[test]
fn the_table_has_a_line_for_each_point_and_the_json_comes_back() {
    let growth = example();
    let table = table::csv(&growth.points);
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines.len(), 1 + growth.points.len());
    assert!(lines[0].starts_with("axis,method,size,vertices,samples,"), "{}", lines[0]);
    assert!(lines[1].starts_with("vertices,reference,1000,1000,1000,30,90,31.6228,10000000,"), "{}", lines[1]);
    assert!(lines[1].ends_with(",\"translux bake knot-1000.glb --material \"\"a, b\"\"\""), "{}", lines[1]);
    assert!(lines[6].contains(",relight,\"about 9 min predicted, 2 min allowed\","), "{}", lines[6]);
    assert!(lines[7].contains(",bake,<too> much memory,"), "{}", lines[7]);
    let json = serde_json::to_string(&growth).unwrap();
    let value: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(value["schema"], "translux.growth-file.v1");
    assert_eq!(value["points"][6]["skipped"]["what"], "bake");
    assert!(value["points"][6]["costs"].is_null());
    let back: Growth = serde_json::from_str(&json).unwrap();
    assert_eq!((back.points.len(), back.growing.len()), (growth.points.len(), growth.growing.len()));
}

#[test]
fn charts_and_page_say_everything() {
    let growth = example();
    let curves = Curves::of(&growth, Axis::Vertices, Quantity::BakeSeconds).unwrap();
    let svg = as_svg(&curves).unwrap();
    for text in
        ["Time to bake against vertices", "exponent 1.50", "(faster than size)", "exponent 1.00", "10k", "100 s"]
    {
        assert!(svg.contains(text), "{text}: {svg}");
    }
    assert_eq!(as_png(&curves).unwrap(), as_png(&curves).unwrap());
    assert_eq!(Curves::of(&growth, Axis::Vertices, Quantity::EnvironmentBytes), None);
    assert_eq!(Curves::of(&growth, Axis::Samples, Quantity::Bytes), None);
    let page = page::page(&growth, &[(curves.title, svg)]);
    for text in
        ["a &lt;processor&gt;", "&lt;too&gt; much memory", "all pairs", "not explained", "below 32 MB", "about 9 min"]
    {
        assert!(page.contains(text), "{text}");
    }
    assert_eq!(page.matches("<tr title=").count(), growth.points.len());
    assert!(!page.contains("NaN") && !page.contains("<too>"));
}

#[test]
fn an_empty_measurement_is_a_page_too() {
    let mut growth = example();
    growth.points.clear();
    growth.fit();
    assert!(growth.growing.is_empty());
    assert!(page::page(&growth, &[]).contains("Nothing grows faster than size"));
}

#[test]
fn numbers_have_plain_units() {
    assert_eq!(size_text(Axis::Vertices, 29_999.0), "30k");
    assert_eq!(size_text(Axis::Samples, 1_048_576.0), "1.05M");
    assert_eq!(size_text(Axis::Ratio, 31.62), "31.6");
    assert_eq!(cost_text(Quantity::BakeSeconds, 0.25), "250 ms");
    assert_eq!(cost_text(Quantity::BakeSeconds, 300.0), "5 min");
    assert_eq!(cost_text(Quantity::RelightMs, 1.5), "1.5 ms");
    assert_eq!(cost_text(Quantity::RelightMs, 2500.0), "2.5 s");
    assert_eq!(cost_text(Quantity::Bytes, 1.2e9), "1.2 GB");
    assert_eq!(cost_text(Quantity::Bytes, 0.5), "0.5 B");
}

#[test]
fn what_would_pass_a_limit_is_not_started_and_says_so() {
    let seconds = |s: f64| format!("{s} s");
    let bytes = |b: u64| format!("{b} B");
    let limits = Limits { seconds: 100.0, memory_bytes: 1000 };
    assert_eq!(limits.too_long(None, seconds), None);
    assert_eq!(limits.too_long(Some(125.0), seconds), None);
    let reason = limits.too_long(Some(126.0), seconds).unwrap();
    assert!(reason.contains("126 s") && reason.contains("100 s"), "{reason}");
    assert!(
        limits.too_long(Some(f64::NAN), seconds).is_some() && limits.too_long(Some(f64::INFINITY), seconds).is_some()
    );
    assert_eq!(limits.too_large(1000, bytes), None);
    let reason = limits.too_large(1001, bytes).unwrap();
    assert!(reason.contains("1001 B") && reason.contains("1000 B"), "{reason}");
    assert_eq!(limits.kill_seconds(), 200.0);
}
