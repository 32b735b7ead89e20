//! Access to recordings that are too large for the repository. Test files of the crates include
//! this file with `#[path]`.

use std::io::Write;
use std::path::{Path, PathBuf};

/// A file or folder of the larger recordings: below `ALOFT_SHARED_DATA`, else below `shared/data`
/// beside the project. If it does not exist, prints on the terminal which test is skipped.
pub fn shared_data(path: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let found = std::env::var_os("ALOFT_SHARED_DATA").map_or_else(beside, PathBuf::from).join(path);
    if found.exists() {
        return Some(found);
    }
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    // written to stderr directly: the test runner captures `println!` and hides the output of
    // passing tests
    let _ = writeln!(std::io::stderr(), "skipped: {test}: {} is not there", found.display());
    None
}
