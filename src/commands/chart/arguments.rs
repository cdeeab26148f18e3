//! The arguments of `translux chart` as typed.

use std::path::PathBuf;

use clap::Args;

use crate::commands::lights::LightArgs;
use crate::commands::model::PlacementArgs;
use crate::relight::choice::DeviceChoice;

#[derive(Clone, Debug, Args)]
pub(in crate::commands) struct ChartArgs {
    /// OBJ, glTF or GLB files
    #[arg(required_unless_present = "growth", conflicts_with = "growth", value_name = "MODEL")]
    pub(super) models: Vec<PathBuf>,
    /// Folder for the page, the charts, the tables and what is needed to go on after an interruption
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: PathBuf,
    /// A measured material or a TOML file; repeatable
    #[arg(long, value_name = "MATERIAL", default_value = "marble")]
    pub(super) material: Vec<String>,
    #[command(flatten)]
    pub(super) lights: LightArgs,
    /// Methods, separated by commas (default: all)
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    pub(super) methods: Vec<String>,
    /// Two settings of each method, and fewer repetitions; with --scale fewer and smaller sizes
    #[arg(long)]
    pub(super) quick: bool,
    /// How cost grows with vertices, samples and size, on a surface of its own in place of models
    #[arg(long = "scale")]
    pub(super) growth: bool,
    /// With --scale: do not start a bake or a new light that is predicted to take longer than this (default: 120, with
    /// --quick 20); end a bake after twice as long
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub(super) limit_seconds: Option<f64>,
    /// Surface samples of the reference
    #[arg(long, value_name = "N", default_value_t = 1 << 19, conflicts_with = "growth")]
    pub(super) reference_samples: usize,
    /// Where shaders are timed beside the processor: on a graphics adapter if there is one (auto; a software adapter is none),
    /// on whatever adapter there is (gpu), nowhere (cpu)
    #[arg(long, default_value = "auto", conflicts_with = "growth", hide_possible_values = true)]
    pub(super) device: DeviceChoice,
    #[command(flatten)]
    pub(super) placement: PlacementArgs,
}
