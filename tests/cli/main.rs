//! The program as it is typed. One binary, so that it is linked once; a module for each matter.
#![allow(clippy::unwrap_used, missing_docs)]

#[path = "../common/mod.rs"]
mod common;

mod asset;
mod builds;
mod cache;
mod chart;
mod compare_assets;
mod compare_flip;
mod editable;
mod errors;
mod export;
mod gltf_media;
mod growth;
mod import_files;
mod inspect;
mod light;
mod option_files;
mod output;
mod page;
mod pictures;
mod plan;
mod pose_check;
mod reader;
mod refine;
mod relight;
mod revisions;
mod schemas;
mod shards;
mod size_and_mesh;
mod trust;
mod validate;
