//! Each command opens the study, calls the library, and renders the answer as text or JSON.

use crate::args::{AnglesArg, Cli, Command, EffectAction, EngineArg, PipelineArgs, RowsArg};
use crate::each::{broken, each, each_result, each_step, fail, heading, notice, whose};
use crate::markdown::markdown;
use crate::open::{description_of, open, open_all, openers};
use crate::progress::{Bars, Counted, Waiting};
use crate::render::{command, json, note, out, table};
use crate::screen::{Cell, fitted, width};
use crate::stop::Stop;
use crate::{
    Success, findings, ladder, marker_sets, next, residuals, run_end, show, show_estimators, show_export, show_session,
    show_workspace, workflow,
};
use aloft_analysis::freshness::freshness;
use aloft_analysis::next_step::{NextStep, next_step};
use aloft_analysis::{
    asked_before, assess, audit, check, compare, corrections, discover, effect, estimators, export, history, init,
    inspect, inspect_values, next_flights, parameters, simulate, status, summary, verify,
};
use aloft_compare::Signal;
use aloft_discover::Told;
use aloft_pipeline::runner::{self, BatchReport, Ended, RunReport, Selection};
use aloft_study::config::{Angles, Rows};
use aloft_study::data_set::DataSet;
use aloft_study::quote::{self, visible};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use clap::CommandFactory;
use std::path::Path;

impl From<RowsArg> for Rows {
    fn from(rows: RowsArg) -> Self {
        match rows {
            RowsArg::Acceleration => Self::Acceleration,
            RowsArg::Weak => Self::Weak,
        }
    }
}

/// Carries out a command.
pub fn dispatch(cli: Cli) -> Result<Success, Stop> {
    match cli.command {
        Command::Run { pipeline, from, only, until, trial, dry_run, force, shared, wait, jobs, details } => {
            let selection = Selection { from, only, until, trials: trial, dry_run, force, shared, wait };
            run(&pipeline, &selection, jobs, details)
        }
        Command::Check { pipeline, json: true, .. } => each(&pipeline, true, check::check, |_| Ok(())),
        Command::Check { pipeline, json: false, details } => show_check(&pipeline, details),
        Command::Status { pipeline, strict, json: as_json } => {
            let late = std::cell::Cell::new(false);
            let ask = |session: &SubjectSession| {
                late.set(late.get() || !freshness(session)?.is_current());
                status::status(session)
            };
            Ok(strict.judge(each(&pipeline, as_json, ask, show_workspace::status)?, late.get()))
        }
        Command::Verify { pipeline, strict, json: as_json } => {
            let (damaged, late) = (std::cell::Cell::new(false), std::cell::Cell::new(false));
            let ask = |session: &SubjectSession| {
                let found = verify::verify(session)?;
                damaged.set(damaged.get() || !found.damaged.is_empty());
                late.set(late.get() || !found.stale.is_empty());
                Ok(found)
            };
            let done = each(&pipeline, as_json, ask, show_workspace::verified)?;
            Ok(if damaged.get() { Success::Partial } else { strict.judge(done, late.get()) })
        }
        Command::Summary { pipeline, strict, json: as_json } => {
            let set = open_all(&pipeline)?;
            let found = summary::summary(&set, &description_of(&pipeline))?;
            for session in &set.members {
                notice(session, &freshness(session)?);
            }
            if as_json {
                json(&found)?
            } else {
                out(show::summary(&found))?
            }
            Ok(strict.judge(Success::Full, !found.stale.is_empty()))
        }
        Command::Explain { pipeline, strict, trial, stage } => {
            let done = show_workspace::explain(&pipeline, trial.as_deref(), stage.as_deref())?;
            let mut late = false;
            for session in &open_all(&pipeline)?.members {
                late = late || !freshness(session)?.is_current();
            }
            Ok(strict.judge(done, late))
        }
        Command::Inspect { file, json: as_json, values, csv } if csv || !values.is_empty() => {
            let found = inspect_values::values(&file, &values)?;
            match (as_json, csv) {
                (true, _) => json(&found)?,
                (false, true) => out(found.to_csv())?,
                (false, false) => out(found.to_text())?,
            }
            Ok(Success::Full)
        }
        Command::Inspect { file, json: as_json, .. } => {
            let found = inspect::inspect(&file)?;
            if as_json {
                json(&found)?
            } else {
                out(fitted(&inspect::to_text(&found, width())))?
            }
            Ok(Success::Full)
        }
        Command::Parameters { pipeline, strict, rows, assess: with_assessment, next_flights: dir, json: as_json } => {
            let ask = |session: &SubjectSession| {
                if dir.is_some() {
                    next_flights::refuse_without_robot(session)?;
                }
                if with_assessment {
                    let _bar = Waiting::new("assessing");
                    assess::assess(session)?;
                }
                if let Some(dir) = &dir {
                    for file in next_flights::copy_to(session, dir)? {
                        note(format!("written: {}", file.display()));
                    }
                }
                parameters::parameters(session, rows.map(Rows::from))
            };
            each_result(&pipeline, strict, as_json, &parameters::READS, ask, show::parameters)
        }
        Command::Compare { pipeline, strict, estimators: true, json: as_json, .. } => {
            let ask = waiting("comparing estimators", estimators::estimators);
            each_result(&pipeline, strict, as_json, &[], ask, show_estimators::estimators)
        }
        Command::Compare { pipeline, strict, leave_one_out: true, json: as_json, .. } => {
            let ask = waiting("leaving out each trial", estimators::leave_one_out);
            each_result(&pipeline, strict, as_json, &[], ask, show_estimators::leave_one_out)
        }
        Command::Compare { pipeline, strict, by, details, json: as_json, .. } => {
            let show = |session: &SubjectSession, current: bool, found: &compare::ComparisonView| {
                residuals::comparison(found, &by, details)?;
                if by.is_empty() {
                    next::show(&next_step(session, found, current), &session.id, &pipeline);
                }
                Ok(())
            };
            each_step(&pipeline, strict, as_json, &compare::READS, compare::compare, show)
        }
        Command::Discover { pipeline, strict, only, without, self_test: true, json: as_json, .. } => {
            let options = discover::options(only, without, true, None);
            let ask = |session: &SubjectSession| {
                let bar = Counted::new("self-test");
                discover::self_test(session, &options, &|done, all| bar.at(done, all))
            };
            each_result(&pipeline, strict, as_json, &[], ask, |found| findings::self_test(&found.self_test))
        }
        Command::Discover {
            pipeline,
            strict,
            only,
            without,
            closed,
            budget,
            self_test: false,
            again,
            details,
            json: as_json,
        } => {
            let options = discover::options(only, without, closed, budget);
            let ask = |session: &SubjectSession| {
                if let Some(before) = asked_before::answered(session, &options).filter(|_| !again) {
                    note(format!(
                        "{}stored answer: nothing it depends on has changed (`--again` computes it anew)",
                        whose(session)
                    ));
                    return Ok(before);
                }
                let bar = Counted::new(&format!("discover {}", session.id));
                discover::discover(session, &options, &|told| match told {
                    Told::Steps { part, done, expected } => bar.in_part(&part.to_string(), done, expected),
                    Told::SoFar(words) => bar.aside(|| note(format!("{}so far: {words}", whose(session)))),
                })
            };
            let show = |session: &SubjectSession, current: bool, found: &discover::DiscoveryView| {
                findings::discovery(found, details)?;
                findings::next(found, session, current, &pipeline)
            };
            each_step(&pipeline, strict, as_json, &[], ask, show)
        }
        Command::Effect { action } => effects(action),
        Command::History { pipeline, strict, details, json: as_json } => {
            let show = |session: &SubjectSession, current: bool, found: &effect::History| {
                ladder::history(found, details)?;
                // a study that was not compared yet has no next step but a run
                let step = compare::compare(session).map_or(NextStep::Run, |view| next_step(session, &view, current));
                next::show(&step, &session.id, &pipeline);
                Ok(())
            };
            each_step(&pipeline, strict, as_json, &history::READS, effect::history, show)
        }
        Command::Report { pipeline, strict, out: target } => {
            let set = open_all(&pipeline)?;
            // write the page over the whole study only if the whole study was selected
            if set.several && target.is_none() && pipeline.subject.is_empty() && pipeline.session.is_empty() {
                let done = aloft_report::write_set(&set)?;
                for page in &done.pages {
                    out(page.display())?;
                }
                let trouble = broken(&set) || !done.failed.is_empty();
                for (id, error) in done.failed {
                    fail(&id, &error.into());
                }
                let mut late = false;
                for session in &set.members {
                    let fresh = freshness(session)?;
                    notice(session, &fresh);
                    late = late || !fresh.is_current();
                }
                return Ok(strict.judge(if trouble { Success::Partial } else { Success::Full }, late));
            }
            let n = set.members.len();
            if n > 1 && target.is_some() {
                return Err(PipelineError::request_hint(
                    format!("--out names one file, and there are {n} subjects or sessions"),
                    "choose one with --subject and --session, or omit --out: each page is then written to its workspace",
                )
                .into());
            }
            let write =
                |session: &SubjectSession| aloft_report::write(session, target.as_deref()).map(|path| Written { path });
            each_result(&pipeline, strict, false, &[], write, |done| out(done.path.display()))
        }
        Command::Studio { pipeline, port, no_open } => studio(&pipeline, port, no_open),
        Command::Export { pipeline, strict, to, format, trial, angles } => {
            let angles = angles.map(|a| match a {
                AnglesArg::Model => Angles::Model,
                AnglesArg::Isb => Angles::Isb,
            });
            let ask = |session: &SubjectSession| {
                // in a study of several, each subject and session gets its own folder
                let to = to.as_ref().map(|to| export::place_of(to, &session.id));
                let options = export::ExportOptions { to, formats: format.clone(), trials: trial.clone(), angles };
                export::export(session, &options)
            };
            let trouble = std::cell::Cell::new(false);
            let done = each_result(&pipeline, strict, false, &[], ask, |done| {
                trouble.set(trouble.get() || !done.failures.is_empty());
                show_export::exported(done)
            })?;
            Ok(if trouble.get() { Success::Partial } else { done })
        }
        Command::Simulate { scenario, out: folder, seed } => {
            for file in simulate::simulate(&scenario, &folder, seed)? {
                out(file.display())?;
            }
            Ok(Success::Full)
        }
        Command::Init { folder, out: target, one_subject, subject } => {
            let written = init::init(&folder, target.as_deref(), &init::InitOptions { one_subject, subject })?;
            note(format!("wrote {}", written.path.display()));
            written.notes.iter().for_each(|n| note(format!("warning: {n}")));
            command("next", &format!("aloft check {}", quote::path(&written.path)));
            Ok(Success::Full)
        }
        Command::Audit { model, motion, markers, forces, json: as_json } => {
            let found = audit::audit(&model, &audit::matched(&motion, &markers, &forces)?)?;
            if as_json {
                json(&found)?
            } else {
                show_export::audited(&found)?
            }
            Ok(Success::Full)
        }
        Command::MarkerSet { action } => marker_sets::marker_sets(action),
        Command::Workflow { pipeline, engine: EngineArg::Snakemake, out: target, verdict } => {
            workflow::run(&pipeline, &target, verdict)
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
    match action {
        EffectAction::List { pipeline, json: as_json } => {
            let found = effect::list(pipeline.as_deref())?;
            if as_json {
                json(&found)?
            } else {
                findings::effects(&found)?
            }
            Ok(Success::Full)
        }
        EffectAction::Show { words } => {
            let (name, pipeline) = name_and_pipeline(&words);
            let found = effect::show(name, pipeline)?;
            out(markdown(&found.markdown()))?;
            Ok(Success::Full)
        }
        EffectAction::Add { pipeline, name, set, details, wait } => {
            let (pipeline, name) = in_order(pipeline, name);
            change_effects(&pipeline, details, |session| effect::add(session, &name, &set, wait, &Bars::default()))
        }
        EffectAction::Remove { pipeline, name, details, wait } => {
            let (pipeline, name) = in_order(pipeline, name);
            change_effects(&pipeline, details, |session| effect::remove(session, &name, wait, &Bars::default()))
        }
    }
}

fn is_pipeline(word: &str) -> bool {
    let path = Path::new(word);
    path.is_file() || path.extension().is_some_and(|e| e == "yaml" || e == "yml")
}

/// Pipeline and name in either order: the pipeline comes first, as everywhere; the other order was
/// that of earlier versions.
fn name_and_pipeline(words: &[String]) -> (&str, Option<&Path>) {
    match words {
        [name] => (name, None),
        [first, second, ..] if is_pipeline(second) && !is_pipeline(first) => (first, Some(Path::new(second))),
        [first, second, ..] => (second, Some(Path::new(first))),
        [] => ("", None),
    }
}

fn in_order(mut pipeline: PipelineArgs, name: String) -> (PipelineArgs, String) {
    let first = pipeline.pipeline.display().to_string();
    if is_pipeline(&name) && !is_pipeline(&first) {
        pipeline.pipeline = name.into();
        return (pipeline, first);
    }
    (pipeline, name)
}

/// Shows that something is going on while an answer is computed that takes more than a second.
fn waiting<T>(
    what: &'static str,
    ask: impl Fn(&SubjectSession) -> Result<T, PipelineError>,
) -> impl Fn(&SubjectSession) -> Result<T, PipelineError> {
    move |session| {
        let _bar = Waiting::new(what);
        ask(session)
    }
}

fn change_effects(
    args: &PipelineArgs,
    details: bool,
    change: impl Fn(&SubjectSession) -> Result<(RunReport, effect::History), PipelineError>,
) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let mut trouble = broken(&set);
    let mut steps = Vec::new();
    for session in &set.members {
        if set.several {
            heading(&session.id)?;
        }
        let (report, history) = change(session)?;
        run_end::notes(&session.id, &report, details);
        note(run_end::totals(std::iter::once(&report), report.seconds));
        ladder::change(&history, details)?;
        trouble |= report.has_trouble();
        let now = session.refreshed()?;
        steps.push((&session.id, compare::compare(&now).map_or(NextStep::Run, |view| next_step(&now, &view, true))));
    }
    match steps.as_slice() {
        [(_, NextStep::Advised(advice))] => note(format!("advice: {advice}")),
        [(_, NextStep::Correct { what, .. })] => note(format!("first: {what}")),
        _ => {}
    }
    command("next", &next::for_all(&steps, args));
    Ok(if trouble { Success::Partial } else { Success::Full })
}

fn run(args: &PipelineArgs, selection: &Selection, jobs: Option<usize>, details: bool) -> Result<Success, Stop> {
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
        summary.write(&set.workspace)?;
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

fn show_check(args: &PipelineArgs, details: bool) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let mut trouble = broken(&set);
    for session in &set.members {
        if set.several {
            heading(&session.id)?;
        }
        trouble |= show_one_check(session, args, details)?;
    }
    for (id, reason) in &set.excluded {
        note(format!("excluded: {id}: {reason}"));
    }
    for remark in &set.remarks {
        note(format!("warning: {remark}"));
    }
    if !trouble {
        let mut steps = Vec::new();
        for session in &set.members {
            let current = freshness(session).is_ok_and(|f| f.is_current());
            let view = if current { compare::compare(session).ok() } else { None };
            steps.push((&session.id, view.map_or(NextStep::Run, |view| next_step(session, &view, true))));
        }
        let step = if steps.is_empty() { next::line("run", args, &[]) } else { next::for_all(&steps, args) };
        command("next", &step);
    }
    Ok(if trouble { Success::Partial } else { Success::Full })
}

/// Most kinds of remarks that a check shows.
const FINDINGS: usize = 20;

fn show_one_check(session: &SubjectSession, args: &PipelineArgs, details: bool) -> Result<bool, Stop> {
    let found = {
        let _bar = Waiting::new("reading recordings");
        check::check(session)?
    };
    let mut t = table(&["trial", "role", "frames", "rate Hz", "markers", "plates", "remarks"]).left(&[1]);
    for row in &found.trials {
        let n = row.remarks.len().to_string();
        t.add_row([
            Cell::from(visible(&row.name)),
            row.role.clone().into(),
            row.frames.map_or("–".to_owned(), |n| n.to_string()).into(),
            row.rate_hz.map_or("–".to_owned(), |r| format!("{r:.0}")).into(),
            row.markers.clone().into(),
            row.plates.map_or("–".to_owned(), |n| n.to_string()).into(),
            match (row.broken, row.remarks.is_empty()) {
                (true, _) => Cell::judged(format!("{n} broken"), Signal::Poor),
                (false, false) => Cell::judged(n, Signal::Fair),
                (false, true) => n.into(),
            },
        ]);
    }
    out(t)?;
    show_session::session_check(&found.session)?;
    show_session::offers(&found.offers)?;
    if details {
        for row in found.trials.iter().filter(|r| r.broken).chain(found.trials.iter().filter(|r| !r.broken)) {
            for remark in &row.remarks {
                note(format!("{}: {}: {remark}", if row.broken { "broken" } else { "warning" }, row.name));
            }
        }
    } else {
        for f in found.findings.iter().take(FINDINGS) {
            note(format!("{}: {}", if f.broken { "broken" } else { "warning" }, f.sentence(found.trials.len())));
        }
        let rest = found.findings.len().saturating_sub(FINDINGS);
        let remarks: usize = found.trials.iter().map(|t| t.remarks.len()).sum();
        if rest > 0 || remarks > found.findings.len() {
            let more = if rest > 0 { format!("{rest} more kinds of remarks; ") } else { String::new() };
            let all = next::line("check", args, &["--details".to_owned()]);
            note(format!("{more}each of the {remarks} remarks: {all}"));
        }
    }
    for remark in &found.remarks {
        note(format!("warning: {remark}"));
    }
    Ok(found.trials.iter().any(|t| t.broken))
}

/// A page that was written.
#[derive(serde::Serialize)]
struct Written {
    path: std::path::PathBuf,
}

/// Serves the live page until the process ends.
fn studio(pipeline: &PipelineArgs, port: u16, no_open: bool) -> Result<Success, Stop> {
    let (open, open_set) = openers(pipeline)?;
    let server = aloft_studio::Server::bind(open, open_set, port)?;
    let address = server.address();
    out(&address)?;
    note("the page is for this machine only; Ctrl-C ends it");
    if !no_open && let Err(e) = open::that_detached(&address) {
        note(format!("no browser could be opened ({e}); open the address above"));
    }
    server.run()?;
    Ok(Success::Full)
}
