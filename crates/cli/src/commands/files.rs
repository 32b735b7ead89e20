//! Files outside a workspace: `aloft inspect`, `simulate`, `init`, `audit`, and the texts about the
//! program itself.

use crate::Success;
use crate::args::Cli;
use crate::render::{command, json, note, out};
use crate::screen::{fitted, width};
use crate::show_export;
use crate::stop::Stop;
use aloft_analysis::{audit, init, inspect, inspect_values, simulate};
use aloft_study::quote;
use clap::CommandFactory;
use std::path::{Path, PathBuf};

/// Shows what is in a recording, or values of it.
pub fn inspect(file: &Path, values: &[String], csv: bool, as_json: bool) -> Result<Success, Stop> {
    if csv || !values.is_empty() {
        let found = inspect_values::values(file, values)?;
        match (as_json, csv) {
            (true, _) => json(&found)?,
            (false, true) => out(found.to_csv())?,
            (false, false) => out(found.to_text())?,
        }
        return Ok(Success::Full);
    }
    let found = inspect::inspect(file)?;
    if as_json {
        json(&found)?
    } else {
        out(fitted(&inspect::to_text(&found, width())))?
    }
    Ok(Success::Full)
}

/// Writes the recordings of a scenario.
pub fn simulate(scenario: &str, folder: &Path, seed: Option<u64>) -> Result<Success, Stop> {
    for file in simulate::simulate(scenario, folder, seed)? {
        out(file.display())?;
    }
    Ok(Success::Full)
}

/// Writes a pipeline for a folder of recordings.
pub fn init(folder: &Path, target: Option<&Path>, options: &init::InitOptions) -> Result<Success, Stop> {
    let written = init::init(folder, target, options)?;
    note(format!("wrote {}", written.path.display()));
    written.notes.iter().for_each(|n| note(format!("warning: {n}")));
    command("next", &format!("aloft check {}", quote::path(&written.path)));
    Ok(Success::Full)
}

/// Checks whether a model balances with its own motion.
pub fn audit(
    model: &Path,
    motion: &[PathBuf],
    markers: &[PathBuf],
    forces: &[PathBuf],
    as_json: bool,
) -> Result<Success, Stop> {
    let found = audit::audit(model, &audit::matched(motion, markers, forces)?)?;
    if as_json {
        json(&found)?
    } else {
        show_export::audited(&found)?
    }
    Ok(Success::Full)
}

/// Prints the notices of the libraries that the program contains.
pub fn licences() -> Result<Success, Stop> {
    out(include_str!("../../../../THIRD-PARTY-NOTICES").trim_end())?;
    Ok(Success::Full)
}

/// Prints the completions of a shell.
pub fn completions(shell: clap_complete::Shell) -> Result<Success, Stop> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "aloft", &mut text);
    out(String::from_utf8_lossy(&text).trim_end())?;
    Ok(Success::Full)
}

/// Prints the manual page.
pub fn man() -> Result<Success, Stop> {
    let mut text = Vec::new();
    clap_mangen::Man::new(Cli::command())
        .render(&mut text)
        .map_err(|e| Stop::Error(miette::miette!("cannot write the manual page: {e}")))?;
    out(String::from_utf8_lossy(&text).trim_end())?;
    Ok(Success::Full)
}
