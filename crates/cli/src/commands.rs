//! Each command opens the study, calls the library, and renders the answer as text or JSON.

use crate::Success;
use crate::args::{Cli, Command, EngineArg};
use crate::each::each;
use crate::open::open;
use crate::render::{json, note};
use crate::stop::Stop;
use crate::{marker_sets, workflow};
use aloft_analysis::init::InitOptions;

mod answers;
mod check;
mod effects;
mod files;
mod pages;
mod run;
mod workspace;

/// Carries out a command.
pub fn dispatch(cli: Cli) -> Result<Success, Stop> {
    match cli.command {
        Command::Run(args) => run::run(args),
        Command::Check { pipeline, json: true, .. } => each(&pipeline, true, aloft_analysis::check::check, |_| Ok(())),
        Command::Check { pipeline, json: false, details } => check::show(&pipeline, details),
        Command::Status { pipeline, strict, json } => workspace::status(&pipeline, strict, json),
        Command::Verify { pipeline, strict, json } => workspace::verify(&pipeline, strict, json),
        Command::Summary { pipeline, strict, json } => workspace::summary(&pipeline, strict, json),
        Command::Forget { pipeline, name, dry_run, json } => workspace::forget(&pipeline, &name, dry_run, json),
        Command::Explain { pipeline, strict, trial, stage } => {
            workspace::explain(&pipeline, strict, trial.as_deref(), stage.as_deref())
        }
        Command::Inspect { file, values, csv, json } => files::inspect(&file, &values, csv, json),
        Command::Parameters(args) => answers::parameters(args),
        Command::Compare(args) => answers::compare(args),
        Command::Discover(args) => answers::discover(args),
        Command::Effect { action } => effects::effects(action),
        Command::History { pipeline, strict, details, json } => answers::history(&pipeline, strict, details, json),
        Command::Report { pipeline, strict, out } => pages::report(&pipeline, strict, out.as_deref()),
        Command::Studio { pipeline, port, no_open } => pages::studio(&pipeline, port, no_open),
        Command::Export(args) => pages::export(args),
        Command::Simulate { scenario, out, seed } => files::simulate(&scenario, &out, seed),
        Command::Init { folder, out, one_subject, subject } => {
            files::init(&folder, out.as_deref(), &InitOptions { one_subject, subject })
        }
        Command::Audit { model, motion, markers, forces, json } => {
            files::audit(&model, &motion, &markers, &forces, json)
        }
        Command::MarkerSet { action } => marker_sets::marker_sets(action),
        Command::Workflow { pipeline, engine: EngineArg::Snakemake, out, verdict } => {
            workflow::run(&pipeline, &out, verdict)
        }
        Command::Merge { pipeline, node } => {
            let made = aloft_pipeline::merge::make(&open(&pipeline)?, node)?;
            note(format!("{node}: {}", if made { "merged" } else { "up to date" }));
            Ok(Success::Full)
        }
        Command::Schema => {
            json(&aloft_study::config_schema())?;
            Ok(Success::Full)
        }
        Command::Completions { shell } => files::completions(shell),
        Command::Man => files::man(),
        Command::Licenses => files::licences(),
    }
}
