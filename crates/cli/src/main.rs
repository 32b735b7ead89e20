//! The `aloft` command. `main` maps results to exit codes: 0 success; 1 some trials failed (the
//! results of the others are kept); 2 the command or configuration is wrong; 128 and the number of
//! the signal that ended it (130 for Ctrl-C).

mod args;
mod commands;
mod each;
mod errors;
mod findings;
mod ladder;
mod laws;
mod markdown;
mod marker_sets;
mod next;
mod open;
mod progress;
mod render;
mod residuals;
mod run_end;
mod screen;
mod show;
mod show_estimators;
mod show_export;
mod show_session;
mod show_workspace;
mod signals;
mod stop;
mod workflow;

use clap::Parser;
use std::process::ExitCode;

/// Outcome of a command that could be carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Success {
    /// Everything worked.
    Full,
    /// Some trials failed.
    Partial,
}

fn main() -> ExitCode {
    let cli = args::Cli::parse();
    signals::watch();
    let result = commands::dispatch(cli);
    match result {
        Ok(Success::Full) => ExitCode::SUCCESS,
        Ok(Success::Partial) => ExitCode::from(1),
        Err(stop::Stop::PipeClosed) => ExitCode::SUCCESS,
        Err(stop::Stop::Error(report)) => {
            render::error(&report);
            ExitCode::from(2)
        }
    }
}
