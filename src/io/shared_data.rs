//! Files that tests read where this machine has them.

use std::path::{Path, PathBuf};

/// A folder of the shared test data, or `None` with a line that says so.
pub(super) fn shared_data(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join("data").join(folder);
    if path.is_dir() {
        return Some(path);
    }
    println!("WITHOUT ../shared: no test data at {}", path.display());
    None
}
