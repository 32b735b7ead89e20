//! `aloft run`.

use crate::Success;
use crate::args::RunArgs;
use crate::each::broken;
use crate::open::{description_of, open_all};
use crate::progress::Bars;
use crate::render::{note, out, table};
use crate::run_end;
use crate::stop::Stop;
use aloft_analysis::{corrections, summary};
use aloft_pipeline::runner::{self, BatchReport, Ended, Selection};
use aloft_study::data_set::DataSet;
use aloft_study::quote::visible;

/// Runs the stages of a pipeline.
pub fn run(args: RunArgs) -> Result<Success, Stop> {
    let RunArgs { pipeline, from, only, until, trial, dry_run, force, shared, wait, jobs, details } = args;
    let selection = &Selection { from, only, until, trials: trial, dry_run, force, shared, wait };
    let args = &pipeline;
    if let Some(jobs) = jobs {
        rayon::ThreadPoolBuilder::new()
            .num_threads(jobs)
            .build_global()
            .map_err(|e| Stop::Error(miette::miette!("-j {jobs}: {e}")))?;
    }
    let set = open_all(args)?;
    if !selection.dry_run && !selection.shared {
        set.members.iter().try_for_each(corrections::keep_reached)?;
    }
    let done = runner::run_all(&set, selection, &Bars::default())?;
    if selection.dry_run {
        return show_dry_run(&set, &done);
    }
    if !selection.shared {
        for session in &set.members {
            if let Some(action) = corrections::add_rung(session)? {
                note(format!("new model revision: {action} (`aloft history` shows it)"));
            }
        }
    }
    let nothing = done.runs.iter().all(|r| r.report.is_err()) && !done.runs.is_empty();
    // parallel jobs would overwrite each other's summary; `aloft summary` writes it when they are
    // done
    let summary = if selection.shared { None } else { Some(summary::summary(&set, &description_of(args))?) };
    if let Some(summary) = &summary {
        summary.write(&set)?;
    }
    if nothing {
        let first = done.runs.into_iter().next().map(|r| r.report);
        return first.map_or(Ok(Success::Partial), |report| report.map(|_| Success::Full).map_err(Into::into));
    }
    let trouble = run_end::show(&set, &done, args, summary.as_ref(), details)?;
    Ok(if trouble { Success::Partial } else { Success::Full })
}

fn show_dry_run(set: &DataSet, done: &BatchReport) -> Result<Success, Stop> {
    let (header, last): (&[&str], usize) =
        if set.several { (&["stage", "trial", "of", "because"], 3) } else { (&["stage", "trial", "because"], 2) };
    let mut t = table(header).left(&[1, 2]).wrapped(last);
    for (id, report) in done.reports() {
        for task in &report.tasks {
            if let Ended::WouldRun(reason) = &task.ended {
                let mut cells = vec![task.stage.to_owned(), visible(&task.trial)];
                if set.several {
                    cells.push(id.to_string());
                }
                cells.push(reason.clone());
                t.add_row(cells);
            }
        }
    }
    for run in &done.runs {
        match &run.report {
            Err(error) => note(format!("failed: {}: {error}", run.id)),
            Ok(report) => report.notes.iter().for_each(note),
        }
    }
    if t.is_empty() {
        out("nothing to do: everything is up to date")?
    } else {
        out(t)?
    }
    Ok(if broken(set) | done.runs.iter().any(|r| r.report.is_err()) { Success::Partial } else { Success::Full })
}
