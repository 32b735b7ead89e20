//! Each command: open the study, ask the pipeline, render for people or as JSON.

use crate::args::{Cli, Command, EffectAction, PipelineArgs, RowsArg};
use crate::progress::{Bars, Counted};
use crate::render::{note, out, table};
use crate::{Success, findings, residuals, show, show_estimators};
use aloft_pipeline::command::{
    assess, check, compare, discover, effect, estimators, init, inspect, parameters, report, simulate, status,
};
use aloft_pipeline::config::Rows;
use aloft_pipeline::error::PipelineError;
use aloft_pipeline::graph::Standing;
use aloft_pipeline::runner::{self, Ended, RunReport, Selection};
use aloft_pipeline::study::{Overrides, Study};
use aloft_pipeline::workspace::WHOLE_STUDY;
use clap::CommandFactory;

/// Why a command stopped.
#[derive(Debug)]
pub enum Stop {
    /// The reader of our output went away.
    PipeClosed,
    /// Something is wrong.
    Error(miette::Report),
}

impl From<PipelineError> for Stop {
    fn from(error: PipelineError) -> Self {
        Self::Error(miette::Report::new(error))
    }
}

fn overrides(args: &PipelineArgs) -> Overrides {
    Overrides { data: args.data.clone(), workspace: args.workspace.clone() }
}

fn open(args: &PipelineArgs) -> Result<Study, Stop> {
    Ok(Study::open(&args.pipeline, &overrides(args))?)
}

fn json<T: serde::Serialize>(value: &T) -> Result<(), Stop> {
    let text =
        serde_json::to_string_pretty(value).map_err(|e| Stop::Error(miette::miette!("cannot write JSON: {e}")))?;
    out(text)
}

impl From<RowsArg> for Rows {
    fn from(rows: RowsArg) -> Self {
        match rows {
            RowsArg::Paper => Self::Paper,
            RowsArg::Weak => Self::Weak,
        }
    }
}

/// Carries out a command.
pub fn dispatch(cli: Cli) -> Result<Success, Stop> {
    match cli.command {
        Command::Run { pipeline, from, only, until, trial, dry_run, force, jobs } => {
            let selection = Selection { from, only, until, trials: trial, dry_run, force };
            run(&pipeline, &selection, jobs)
        }
        Command::Check { pipeline } => show_check(&open(&pipeline)?),
        Command::Status { pipeline, json: as_json } => show_status(&open(&pipeline)?, as_json),
        Command::Explain { pipeline, trial, stage } => show_explanation(&open(&pipeline)?, &trial, &stage),
        Command::Inspect { file, json: as_json } => {
            let found = inspect::inspect(&file)?;
            if as_json {
                json(&found)?
            } else {
                out(inspect::to_text(&found))?
            }
            Ok(Success::Full)
        }
        Command::Parameters { pipeline, rows, assess: with_assessment, json: as_json } => {
            let study = open(&pipeline)?;
            if with_assessment {
                assess::assess(&study)?;
            }
            let found = parameters::parameters(&study, rows.map(Rows::from))?;
            if as_json {
                json(&found)?
            } else {
                show::parameters(&found)?
            }
            Ok(Success::Full)
        }
        Command::Compare { pipeline, estimators: true, json: as_json, .. } => {
            let found = estimators::estimators(&open(&pipeline)?)?;
            if as_json {
                json(&found)?
            } else {
                show_estimators::estimators(&found)?
            }
            Ok(Success::Full)
        }
        Command::Compare { pipeline, leave_one_out: true, json: as_json, .. } => {
            let found = estimators::leave_one_out(&open(&pipeline)?)?;
            if as_json {
                json(&found)?
            } else {
                show_estimators::leave_one_out(&found)?
            }
            Ok(Success::Full)
        }
        Command::Compare { pipeline, by, json: as_json, .. } => {
            let found = compare::compare(&open(&pipeline)?)?;
            if as_json {
                json(&found)?
            } else {
                residuals::comparison(&found, &by)?
            }
            Ok(Success::Full)
        }
        Command::Discover { pipeline, only, without, self_test: true, json: as_json } => {
            let options = discover::options(only, without);
            let bar = Counted::new("self-test");
            let found = discover::self_test(&open(&pipeline)?, &options, &|done, all| bar.at(done, all))?;
            drop(bar);
            if as_json {
                json(&found)?
            } else {
                findings::self_test(&found.self_test)?
            }
            Ok(Success::Full)
        }
        Command::Discover { pipeline, only, without, self_test: false, json: as_json } => {
            let options = discover::options(only, without);
            let found = discover::discover(&open(&pipeline)?, &options)?;
            if as_json {
                json(&found)?
            } else {
                findings::discovery(&found, &pipeline)?
            }
            Ok(Success::Full)
        }
        Command::Effect { action } => effects(action),
        Command::History { pipeline, json: as_json } => {
            let found = effect::history(&open(&pipeline)?)?;
            if as_json {
                json(&found)?
            } else {
                findings::history(&found)?
            }
            Ok(Success::Full)
        }
        Command::Report { pipeline, out: target } => {
            let path = report::write(&open(&pipeline)?, target.as_deref())?;
            out(path.display())?;
            Ok(Success::Full)
        }
        Command::Simulate { scenario, out: folder, seed } => {
            for file in simulate::simulate(&scenario, &folder, seed)? {
                out(file.display())?;
            }
            Ok(Success::Full)
        }
        Command::Init { folder, out: target } => {
            let path = init::init(&folder, target.as_deref())?;
            note(format!("wrote {}", path.display()));
            note(format!("next: aloft check {}", path.display()));
            Ok(Success::Full)
        }
        Command::Schema => {
            json(&aloft_pipeline::config_schema())?;
            Ok(Success::Full)
        }
        Command::Completions { shell } => {
            let mut text = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "aloft", &mut text);
            out(String::from_utf8_lossy(&text).trim_end())?;
            Ok(Success::Full)
        }
        Command::Man => {
            let mut text = Vec::new();
            clap_mangen::Man::new(Cli::command())
                .render(&mut text)
                .map_err(|e| Stop::Error(miette::miette!("cannot write the manual page: {e}")))?;
            out(String::from_utf8_lossy(&text).trim_end())?;
            Ok(Success::Full)
        }
    }
}

fn effects(action: EffectAction) -> Result<Success, Stop> {
    let (args, (report, history)) = match action {
        EffectAction::List { pipeline, json: as_json } => {
            let found = effect::list(pipeline.as_deref())?;
            if as_json {
                json(&found)?
            } else {
                findings::effects(&found)?
            }
            return Ok(Success::Full);
        }
        EffectAction::Show { name, pipeline } => {
            let found = effect::show(&name, pipeline.as_deref())?;
            out(format!("# {} ({})\n\n{}", found.title, found.id, found.documentation))?;
            return Ok(Success::Full);
        }
        EffectAction::Add { pipeline, name, set } => {
            let done = effect::add(&open(&pipeline)?, &overrides(&pipeline), &name, &set, &Bars::default())?;
            (pipeline, done)
        }
        EffectAction::Remove { pipeline, name } => {
            let done = effect::remove(&open(&pipeline)?, &overrides(&pipeline), &name, &Bars::default())?;
            (pipeline, done)
        }
    };
    show_run(&report, &args)?;
    findings::history(&history)?;
    Ok(if report.has_trouble() { Success::Partial } else { Success::Full })
}

fn run(args: &PipelineArgs, selection: &Selection, jobs: Option<usize>) -> Result<Success, Stop> {
    if let Some(jobs) = jobs {
        rayon::ThreadPoolBuilder::new()
            .num_threads(jobs)
            .build_global()
            .map_err(|e| Stop::Error(miette::miette!("-j {jobs}: {e}")))?;
    }
    let study = open(args)?;
    let done = runner::run(&study, selection, &Bars::default())?;
    if selection.dry_run {
        return show_dry_run(&done);
    }
    show_run(&done, args)?;
    if done.tasks.iter().any(|t| t.stage == "compare" && matches!(t.ended, Ended::Ran | Ended::UpToDate)) {
        show::brief(&compare::compare(&study)?)?;
    }
    Ok(if done.has_trouble() { Success::Partial } else { Success::Full })
}

fn show_dry_run(done: &RunReport) -> Result<Success, Stop> {
    let mut t = table(&["stage", "trial", "because"]);
    for task in &done.tasks {
        if let Ended::WouldRun(reason) = &task.ended {
            t.add_row([task.stage, &task.trial, reason]);
        }
    }
    if t.is_empty() {
        out("nothing to do: everything is up to date")?
    } else {
        out(t)?
    }
    Ok(Success::Full)
}

fn show_run(done: &RunReport, args: &PipelineArgs) -> Result<(), Stop> {
    for task in &done.tasks {
        for warning in task.warnings.iter().filter(|_| task.ended == Ended::Ran) {
            note(format!("warning: {} {}: {warning}", task.stage, task.trial));
        }
    }
    for (task, failure) in done.failures() {
        note(format!("failed: {} {}: {}", task.stage, task.trial, failure.problem));
        if let Some(hint) = &failure.hint {
            note(format!("  hint: {hint}"));
        }
        if task.trial != WHOLE_STUDY {
            let folder = |flag: &str, path: &Option<std::path::PathBuf>| {
                path.as_ref().map_or(String::new(), |p| format!(" --{flag} {}", p.display()))
            };
            note(format!(
                "  again: aloft run {}{}{} --trial {}",
                args.pipeline.display(),
                folder("data", &args.data),
                folder("workspace", &args.workspace),
                task.trial
            ));
        }
    }
    let blocked = done.tasks.iter().filter(|t| matches!(t.ended, Ended::Blocked(_))).count();
    let failed = done.failures().count();
    let mut parts = vec![format!("{} done", done.ran()), format!("{} up to date", done.up_to_date())];
    if failed > 0 {
        parts.push(format!("{failed} failed"));
    }
    if blocked > 0 {
        parts.push(format!("{blocked} could not follow"));
    }
    note(format!("{} in {:.1} s", parts.join(", "), done.seconds));
    Ok(())
}

fn show_check(study: &Study) -> Result<Success, Stop> {
    let found = check::check(study)?;
    let mut t = table(&["trial", "role", "frames", "rate Hz", "markers", "plates", "remarks"]);
    for row in &found.trials {
        t.add_row([
            row.name.clone(),
            row.role.clone(),
            row.frames.map_or("–".to_owned(), |n| n.to_string()),
            row.rate_hz.map_or("–".to_owned(), |r| format!("{r:.0}")),
            row.markers.clone(),
            row.plates.map_or("–".to_owned(), |n| n.to_string()),
            row.remarks.len().to_string(),
        ]);
    }
    out(t)?;
    for row in &found.trials {
        for remark in &row.remarks {
            note(format!("{}: {}: {remark}", if row.broken { "broken" } else { "warning" }, row.name));
        }
    }
    for remark in &found.remarks {
        note(format!("warning: {remark}"));
    }
    Ok(if found.trials.iter().any(|t| t.broken) { Success::Partial } else { Success::Full })
}

fn show_status(study: &Study, as_json: bool) -> Result<Success, Stop> {
    let found = status::status(study)?;
    if as_json {
        json(&found)?;
    } else {
        let mut header = vec!["trial", "role"];
        header.extend(found.stages.iter().copied());
        let mut t = table(&header);
        for row in &found.rows {
            t.add_row([row.trial.clone(), row.role.clone()].into_iter().chain(row.cells.iter().cloned()));
        }
        out(t)?;
    }
    Ok(Success::Full)
}

fn show_explanation(study: &Study, trial: &str, stage: &str) -> Result<Success, Stop> {
    let found = status::explain(study, trial, stage)?;
    out(format!("{stage} of {trial}: {}", found.standing.word()))?;
    match &found.standing {
        Standing::Stale(changes) => {
            for change in changes {
                out(format!("  {change}"))?;
            }
        }
        Standing::Failed(failure) => {
            out(format!("  {}", failure.problem))?;
            if let Some(hint) = &failure.hint {
                out(format!("  hint: {hint}"))?;
            }
        }
        Standing::Blocked(reason) => out(format!("  {reason}"))?,
        _ => {}
    }
    if let Some(m) = &found.manifest {
        for warning in &m.warnings {
            out(format!("  warning: {warning}"))?;
        }
        for (key, value) in &m.summary {
            out(format!("  {key}: {value}"))?;
        }
        out(format!("  made by aloft {} in {:.2} s from", m.program, m.seconds))?;
        for (name, hash) in &m.inputs {
            out(format!("    {name} {}", hash.get(..12).unwrap_or(hash)))?;
        }
    }
    Ok(Success::Full)
}
