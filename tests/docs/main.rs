//! The book in `docs/`: generated pages are those that the code gives, transcripts are what the binary says, links lead somewhere.
//!
//! `ALOFT_UPDATE_DOCS=1 cargo test --release -p aloft-cli --test docs` writes the generated pages and the transcripts again.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod book;
mod generate;
mod json_contract;
mod source;
mod transcript;

use std::path::{Path, PathBuf};

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// The book.
pub fn docs() -> PathBuf {
    root().join("docs")
}

/// Whether pages are to be written rather than compared.
pub fn updating() -> bool {
    std::env::var_os("ALOFT_UPDATE_DOCS").is_some_and(|v| v != "0")
}

/// What to do about a stale page.
pub const AGAIN: &str = "write it again with: ALOFT_UPDATE_DOCS=1 cargo test --release -p aloft-cli --test docs";

/// Runs the binary and gives what it wrote to stdout; it must succeed.
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
