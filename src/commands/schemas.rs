//! Schemas of all JSON that the program writes: made of the types that are written, and kept under `docs/schemas`.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use schemars::generate::{SchemaGenerator, SchemaSettings};
use schemars::{JsonSchema, Schema};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::{bake, chart, demo, failures, fixtures, jobs, many, meter, relight, shards, sheet};
use crate::measure::chart::Chart;
use crate::measure::growth::Growth;
use crate::plan::Plan;
use crate::relight::timings::Timings;
use crate::report::Envelope;
use crate::report::blame::BlameReport;
use crate::report::comparison::Comparison;
use crate::report::evaluation::{EvaluationReport, OnMeshReport, WalkReport};
use crate::report::export::ExportReport;
use crate::report::inspection::Inspection;
use crate::report::materials::MaterialsReport;
use crate::report::methods::MethodsReport;
use crate::report::picture::RenderReport;
use crate::report::pose_check::PoseCheckReport;
use crate::report::validation::Validation;

/// Set to write the schemas in place of comparing them.
const WRITE: &str = "TRANSLUX_WRITE_SCHEMAS";

/// A schema of what a name stands for, one of several shapes.
struct Document {
    name: String,
    generator: SchemaGenerator,
    shapes: Vec<Schema>,
}

impl Document {
    fn new(name: &str) -> Self {
        let generator = SchemaSettings::draft2020_12().for_serialize().into_generator();
        Self { name: name.to_owned(), generator, shapes: Vec::new() }
    }

    /// A report of a command.
    fn report(command: &str) -> Self {
        Self::new(&format!("translux.{command}.v1"))
    }

    /// Adds a type that is written as it is.
    fn shape<T: JsonSchema>(mut self) -> Self {
        let mut shape = T::json_schema(&mut self.generator);
        let properties = shape.as_object_mut().unwrap().get_mut("properties").unwrap();
        properties["schema"] = json!({ "const": self.name });
        self.shapes.push(shape);
        self
    }

    /// Adds a body of a report.
    fn body<T: Serialize + JsonSchema + 'static>(self) -> Self {
        self.shape::<Envelope<'static, T>>()
    }

    /// Adds a body of a report, and that of several files.
    fn files<T: Serialize + JsonSchema + 'static>(self) -> Self {
        self.body::<T>().body::<many::Reports<T>>()
    }

    fn finished(mut self) -> (String, Value) {
        let mut all = Map::new();
        all.insert("$schema".into(), "https://json-schema.org/draft/2020-12/schema".into());
        all.insert("title".into(), self.name.clone().into());
        let mut shapes: Vec<Value> = self.shapes.drain(..).map(Value::from).collect();
        for shape in &mut shapes {
            shape.as_object_mut().unwrap().retain(|key, _| !matches!(key.as_str(), "$schema" | "title"));
        }
        match shapes.len() {
            1 => all.extend(shapes.remove(0).as_object().unwrap().clone()),
            _ => drop(all.insert("anyOf".into(), shapes.into())),
        }
        let definitions = self.generator.take_definitions(true);
        if !definitions.is_empty() {
            all.insert("$defs".into(), definitions.into());
        }
        let mut all = Value::from(all);
        unlink(&mut all);
        (self.name, all)
    }
}

/// Names in descriptions are links in the documentation of the code alone.
fn unlink(value: &mut Value) {
    match value {
        Value::String(text) => *text = text.replace("[`", "`").replace("`]", "`"),
        Value::Array(items) => items.iter_mut().for_each(unlink),
        Value::Object(entries) => entries.values_mut().for_each(unlink),
        _ => {}
    }
}

fn documents() -> Vec<Document> {
    let relight = Document::report("relight").body::<relight::AnimationReport<'static>>();
    #[cfg(feature = "gui")]
    let relight = relight.body::<relight::WindowRun<'static>>();
    vec![
        Document::report("bake")
            .body::<bake::BakedReport<'static>>()
            .body::<bake::CurrentReport<'static>>()
            .body::<bake::ForecastReport>()
            .body::<shards::ShardReport>(),
        Document::report("jobs").body::<jobs::JobsReport>(),
        Document::report("evaluate").body::<EvaluationReport>(),
        Document::report("evaluate-on").body::<OnMeshReport>(),
        Document::report("reference").body::<EvaluationReport>().body::<WalkReport>(),
        Document::report("render").body::<RenderReport>(),
        Document::report("sheet").body::<sheet::SheetReport>(),
        Document::report("export").body::<ExportReport>(),
        relight,
        Document::report("inspect").files::<Inspection>(),
        Document::report("blame").body::<BlameReport>(),
        Document::report("pose-check").body::<PoseCheckReport>(),
        Document::report("validate").files::<Validation>(),
        Document::report("compare").files::<Comparison>(),
        Document::report("chart").body::<chart::ChartReport<'static>>().body::<chart::GrowthReport<'static>>(),
        Document::report("materials").body::<MaterialsReport>(),
        Document::report("methods").body::<MethodsReport>(),
        Document::report("demo").body::<demo::DemoReport>(),
        Document::report("fixtures").body::<fixtures::FixturesReport>(),
        Document::new(crate::measure::chart::SCHEMA).shape::<Chart>(),
        Document::new(crate::measure::growth::SCHEMA).shape::<Growth>(),
        Document::new(crate::plan::SCHEMA).shape::<Plan>(),
        Document::new(crate::relight::timings::SCHEMA).shape::<Timings>(),
        Document::new(failures::SCHEMA).shape::<failures::ErrorReport<'static>>(),
        Document::new(meter::SCHEMA).shape::<meter::Line>(),
    ]
}

/// Whoever changes what is written sees here what that does to its readers.
#[test]
fn schemas_are_those_of_the_types() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schemas");
    let write = std::env::var_os(WRITE).is_some();
    let mut names = Vec::new();
    for document in documents() {
        let (name, schema) = document.finished();
        let path = folder.join(format!("{name}.json"));
        names.push(format!("{name}.json"));
        // Without a window there is no report of one.
        let is_whole = cfg!(feature = "gui") || name != "translux.relight.v1";
        if write {
            std::fs::write(&path, format!("{}\n", serde_json::to_string_pretty(&schema).unwrap())).unwrap();
        } else if is_whole {
            let kept = std::fs::read(&path).unwrap_or_default();
            assert!(
                serde_json::from_slice::<Value>(&kept).is_ok_and(|kept| kept == schema),
                "{} is not what is written: a new field is told in CHANGELOG.md and the schema made again with {WRITE}=1; another \
                 meaning or a field less is a new version of the schema",
                path.display()
            );
        }
    }
    names.sort();
    let there = std::fs::read_dir(&folder).unwrap();
    let mut there: Vec<String> = there.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    there.sort();
    assert_eq!(there, names);
}
