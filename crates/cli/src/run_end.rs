//! The end of a run: at most twelve lines, failures first.

use crate::args::PipelineArgs;
use crate::errors::{self, figure, judgement};
use crate::next;
use crate::open::description_of;
use crate::render::{brief_note, command, note, out, significant};
use crate::screen::{Cell, columns_of, cut, labelled, table, width};
use crate::stop::Stop;
use aloft_analysis::compare::{ComparisonView, compare};
use aloft_analysis::corrections::offers;
use aloft_analysis::left_out::left_out;
use aloft_analysis::next_step::{NextStep, next_step};
use aloft_analysis::persons::{chosen_person, persons, several_persons};
use aloft_analysis::repeated::{EXCLUDE, repeated, repeated_words};
use aloft_analysis::session_check::session_check;
use aloft_analysis::summary::Summary;
use aloft_pipeline::runner::{BatchReport, Ended, RunReport};
use aloft_study::data_set::DataSet;
use aloft_study::quote::visible;
use aloft_study::recordings::SessionId;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};

/// Most lines of the end of a run.
const LINES: usize = 12;
/// Most lines on what failed.
const FAILED: usize = 3;

/// Something that failed: which result, and why.
struct Failed {
    id: SessionId,
    /// Stage and trial; none for a subject that could not be processed at all.
    task: Option<(&'static str, String)>,
    failure: StageFailure,
}

impl Failed {
    fn place(&self) -> String {
        let whose = self.id.subject.is_some().then(|| self.id.to_string());
        let (stage, trial) = self.task.as_ref().map_or((None, None), |(s, t)| (Some((*s).to_owned()), Some(t.clone())));
        [stage, whose, trial].into_iter().flatten().collect::<Vec<_>>().join(" ")
    }
}

/// Shows the end of a run; true if something failed.
pub fn show(
    set: &DataSet,
    done: &BatchReport,
    args: &PipelineArgs,
    summary: Option<&Summary>,
    details: bool,
) -> Result<bool, Stop> {
    for (id, report) in done.reports() {
        notes(id, report, details);
    }
    let failed = failures(set, done);
    if details {
        for f in &failed {
            whole(f, args);
        }
    } else {
        brief(&failed);
    }
    note(totals(done.reports().map(|(_, r)| r), done.seconds));
    let (mut views, mut trouble) = (Vec::new(), !failed.is_empty() || done.has_trouble());
    for (session, run) in set.members.iter().zip(&done.runs) {
        // none: the reason was shown above
        let Ok(report) = &run.report else { continue };
        if report.tasks.iter().any(|t| t.stage == "compare" && matches!(t.ended, Ended::Ran | Ended::UpToDate)) {
            match compare(session) {
                Ok(view) => views.push((session, view)),
                Err(error) => {
                    trouble = true;
                    note(format!("failed: {}: {error}", session.id));
                }
            }
        }
    }
    match views.as_slice() {
        [] => {}
        [(_, view)] if !set.several => {
            errors::block(view)?;
            if details {
                crate::show::frames(view)?;
            }
        }
        many => {
            several(many, LINES.saturating_sub(5 + failed.len().min(FAILED)))?;
            if let Some(line) = to_do(many) {
                out(line)?;
            }
        }
    }
    for session in &set.members {
        if let Some(words) = chosen_person(session)? {
            out(labelled("person      ", &words))?;
        }
        if let Some(words) = several_persons(&persons(session)?) {
            out(labelled("persons     ", &words))?;
        }
        if let Some(words) = repeated_words(&repeated(session)?) {
            out(labelled("repeated    ", &format!("{words}; {EXCLUDE}")))?;
        }
        if let Some(words) = left_out(session)? {
            out(labelled("left out    ", &words))?;
        }
    }
    if let Some(summary) = summary {
        if let Some(line) = warnings(summary, far_joint_mm(&views)) {
            out(line)?;
        }
        if details {
            out("")?;
            out(crate::show::summary(summary))?;
            for session in &set.members {
                let checked = session_check(session)?;
                crate::show_session::session_check(&checked)?;
                crate::show_session::offers(&offers(session, &checked)?)?;
            }
        }
    }
    let steps: Vec<(&SessionId, NextStep)> = views
        .iter()
        .map(|(session, view)| Ok((&session.id, next_step(session, view, true)?)))
        .collect::<Result<_, PipelineError>>()?;
    command("next", &next::after_run(&steps, failed_task(&failed), args));
    Ok(trouble)
}

fn failed_task(failed: &[Failed]) -> Option<(&SessionId, Option<(&str, &str)>)> {
    failed.first().map(|f| (&f.id, f.task.as_ref().map(|(s, t)| (*s, t.as_str()))))
}

/// What the run found and repaired; with details also every warning.
pub fn notes(id: &SessionId, done: &RunReport, details: bool) {
    let whose = if id.subject.is_some() { format!("{id} ") } else { String::new() };
    for line in &done.notes {
        note(format!("{whose}{line}"));
    }
    if !details {
        return;
    }
    for task in &done.tasks {
        for warning in &task.warnings {
            note(format!("warning: {whose}{} {}: {warning}", task.stage, task.trial));
        }
    }
}

/// Everything that failed, in the order of the study.
fn failures(set: &DataSet, done: &BatchReport) -> Vec<Failed> {
    let mut out: Vec<Failed> =
        set.broken.iter().map(|b| Failed { id: b.id.clone(), task: None, failure: b.failure.clone() }).collect();
    for run in &done.runs {
        match &run.report {
            Ok(report) => out.extend(report.failures().map(|(task, failure)| Failed {
                id: run.id.clone(),
                task: Some((task.stage, task.trial.clone())),
                failure: failure.clone(),
            })),
            Err(error) => out.push(Failed {
                id: run.id.clone(),
                task: None,
                failure: StageFailure { problem: error.to_string(), ..StageFailure::new("") },
            }),
        }
    }
    out
}

/// One failure with its hint and the command that repeats it.
fn whole(f: &Failed, args: &PipelineArgs) {
    note(format!("failed: {}: {}", f.place(), f.failure.problem));
    if let Some(hint) = &f.failure.hint {
        note(format!("  hint: {hint}"));
    }
    if let Some((_, trial)) = &f.task {
        command("  again", &aloft_analysis::summary::again(&description_of(args), &f.id, trial));
    }
}

/// The failures in at most three lines.
fn brief(failed: &[Failed]) {
    let Some(first) = failed.first() else { return };
    // the first one whole: what was found and what was expected stand at its end
    note(format!("failed: {}: {}", first.place(), first.failure.problem));
    if let Some(hint) = &first.failure.hint {
        brief_note(format!("  hint: {hint}"));
    }
    match failed {
        [] | [_] => {}
        [_, second] => brief_note(format!("failed: {}: {}", second.place(), second.failure.problem)),
        [_, rest @ ..] => {
            let places: Vec<String> = rest.iter().map(|f| visible(&f.place())).collect();
            brief_note(format!("failed: {} more: {}", rest.len(), places.join(", ")));
        }
    }
}

/// Subjects and sessions, the one farthest above its floor first.
fn several(views: &[(&SubjectSession, ComparisonView)], rows: usize) -> Result<(), Stop> {
    let worst = |v: &ComparisonView| v.errors.iter().filter_map(|e| e.times_floor).fold(f64::NAN, f64::max);
    let mut order: Vec<&(&SubjectSession, ComparisonView)> = views.iter().collect();
    order.sort_by(|a, b| worst(&b.1).total_cmp(&worst(&a.1)).then(a.0.id.cmp(&b.0.id)));
    let header = [
        "subject",
        "flights",
        "without",
        "in flight N",
        "floor N",
        "times floor",
        "in contact N",
        "floor N",
        "times floor",
        "judged",
    ];
    let mut t = table(&header).left(&[9]).optional(&[1, 4, 7]);
    let shown = if order.len() > rows { rows.saturating_sub(1) } else { order.len() };
    for (session, view) in order.iter().take(shown) {
        let of = |place: &str| view.errors.iter().find(|e| e.judged_on == place);
        let error = |place: &str| figure(of(place).map(|e| e.held_out_error));
        let floor = |place: &str| figure(of(place).and_then(|e| e.noise_floor));
        let times = |place: &str| of(place).and_then(|e| e.times_floor).map_or("–".to_owned(), |t| significant(t, 2));
        let judged = view.errors.iter().max_by_key(|e| e.grade).map_or_else(|| Cell::from("–"), judgement);
        let name = if session.id.subject.is_some() { session.id.to_string() } else { errors::short(&view.subject) };
        t.add_row([
            Cell::from(visible(&name)),
            view.parameters.flights.to_string().into(),
            view.left_out.len().to_string().into(),
            error("flight").into(),
            floor("flight").into(),
            times("flight").into(),
            error("contact").into(),
            floor("contact").into(),
            times("contact").into(),
            judged,
        ]);
    }
    out(t)?;
    if shown < order.len() {
        out(format!("… and {} nearer to their floors", order.len() - shown))?;
    }
    Ok(())
}

/// What to do about the subjects whose gate did not pass.
fn to_do(views: &[(&SubjectSession, ComparisonView)]) -> Option<String> {
    let short: Vec<(String, &str)> = views
        .iter()
        .filter(|(_, v)| !v.parameters.gate_passed)
        .filter_map(|(s, v)| Some((visible(&s.id.to_string()), v.parameters.to_do.as_deref()?)))
        .collect();
    let (first, text) = short.first()?;
    let whose = match short.len() {
        1 => first.clone(),
        n => format!("{n} of {} ({first} …)", views.len()),
    };
    Some(labelled("to do       ", &format!("gate not passed: {whose}: {text}; all: aloft parameters")))
}

/// Largest distance of a joint from its landmarks, mm, where motion and landmarks contradict each
/// other about joints.
fn far_joint_mm(views: &[(&SubjectSession, ComparisonView)]) -> Option<f64> {
    let reports = views.iter().filter_map(|(_, v)| v.calibration.as_ref()).map(|c| &c.report);
    let joints = reports.filter(|r| r.contradiction.is_some()).flat_map(|r| &r.joints);
    joints.map(|j| 1e3 * j.moved_m).max_by(f64::total_cmp)
}

/// Joints far from their landmarks, and the recordings with warnings and the reasons, in one line.
fn warnings(summary: &Summary, far_joint_mm: Option<f64>) -> Option<String> {
    let of = |word: &str| summary.rows.iter().filter(|r| r.qc == word).count();
    let all = summary.rows.len();
    let reasons: Vec<String> = summary
        .reasons
        .iter()
        .filter(|r| {
            summary.rows.iter().any(|row| row.qc == "warning" && row.reasons.iter().any(|q| q.code() == r.reason))
        })
        .map(|r| r.reason.replace('_', " "))
        .collect();
    let n = of("warning");
    let joints = far_joint_mm.map(|mm| format!("joint {mm:.0} mm from its landmarks (aloft check)"));
    if let (0, Some(joints)) = (n, &joints) {
        return Some(cut(&format!("warnings    {joints}"), width()));
    }
    let joints = joints.map_or(String::new(), |words| format!("{words}; "));
    // as many reasons as the line takes, each whole
    let mut line = format!("warnings    {joints}{n} of {all} recordings (aloft summary):");
    for (i, reason) in reasons.iter().enumerate() {
        let (space, more) = (if i > 0 { ", " } else { " " }, if i + 1 < reasons.len() { 3 } else { 0 });
        if columns_of(&line) + space.len() + columns_of(reason) + more > width() {
            line.push_str(" …");
            break;
        }
        line = format!("{line}{space}{reason}");
    }
    (n > 0).then(|| cut(&line, width()))
}

/// One line: how many tasks ran, were up to date, failed, or were blocked by failures.
pub fn totals<'r>(reports: impl Iterator<Item = &'r RunReport>, seconds: f64) -> String {
    let (mut ran, mut current, mut failed, mut blocked) = (0, 0, 0, 0);
    for done in reports {
        ran += done.ran();
        current += done.up_to_date();
        failed += done.failures().count();
        blocked += done.tasks.iter().filter(|t| matches!(t.ended, Ended::Blocked(_))).count();
    }
    let mut parts = vec![format!("{ran} done"), format!("{current} up to date")];
    if failed > 0 {
        parts.push(format!("{failed} failed"));
    }
    if blocked > 0 {
        parts.push(format!("{blocked} blocked by earlier failures"));
    }
    format!(
        "{} in {} s",
        parts.join(", "),
        if seconds < 1.0 { format!("{seconds:.2}") } else { format!("{seconds:.1}") }
    )
}
