//! Checks of the book in `docs/`: generated pages match the code, transcripts match the output of
//! the binary, links have targets.
//!
//! `ALOFT_UPDATE_DOCS=1 cargo test --release -p aloft-cli --test docs` writes the generated pages
//! and the transcripts again.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod book;
mod generate;
mod json_contract;
mod promises;
mod source;
mod transcript;

use std::path::{Path, PathBuf};

/// Root folder of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// Folder of the book.
pub fn docs() -> PathBuf {
    root().join("docs")
}

/// True if pages are to be written rather than compared.
pub fn updating() -> bool {
    std::env::var_os("ALOFT_UPDATE_DOCS").is_some_and(|v| v != "0")
}

/// Command that updates a stale page.
pub const AGAIN: &str = "write it again with: ALOFT_UPDATE_DOCS=1 cargo test --release -p aloft-cli --test docs";

/// Runs the binary and returns its stdout; the command must succeed.
pub fn aloft(words: &[&str]) -> String {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_aloft"))
        .args(words)
        .env("NO_COLOR", "1")
        .env("COLUMNS", "100")
        .output()
        .unwrap();
    assert!(output.status.success(), "aloft {words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}
