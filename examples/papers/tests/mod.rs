//! The program's own methods through the library: radiosity against that of `two_pass`, sizes, odd meshes, the same bytes on any number
//! of threads, damaged files; what is valid, and what the crate alone makes of it.

mod bleeding;
mod values;

use std::sync::Arc;

use translux::error::ExitCode;
use translux::evaluate::memory::Limits;
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::methods;
use translux::progress::Silent;
use translux::report::validation::validate;

use crate::hao::{METHOD, registry};
use crate::in_memory::{pairs, scene, try_bake};

#[test]
fn every_encoding_writes_what_is_valid_and_the_crate_alone_does_not_support() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tlux");
    let head = scene(shapes::bumpy_head(1.0, 2), Scale::DiagonalMm(20.0), "marble");
    for encoding in ["raw", "uniform8", "lloyd8", "sh", "reference-points", "bleeding"] {
        let method = registry().method(METHOD).unwrap();
        let asset = try_bake(method, head.clone(), Some(500), &pairs(&[("encoding", encoding)])).unwrap();
        asset.write(&path).unwrap();
        let found = validate(&path, &registry(), Limits::none(), &Silent).unwrap();
        let unknown = found.findings.iter().any(|finding| finding.name.starts_with("Unknown"));
        assert!(found.errors == 0 && !unknown && found.sections > 4, "{encoding}: {found}");
        let error = methods::built_in().open(Arc::new(asset)).err().unwrap();
        assert_eq!(error.code(), ExitCode::Unsupported, "{encoding}");
        assert!(error.message().contains("which this build does not have"), "{error}");
    }
}
