//! `aloft check`.

use crate::args::PipelineArgs;
use crate::each::{broken, heading};
use crate::open::open_all;
use crate::progress::Waiting;
use crate::render::{command, note, out, table};
use crate::screen::Cell;
use crate::stop::Stop;
use crate::{Success, next, show_session};
use aloft_analysis::check;
use aloft_analysis::freshness::freshness;
use aloft_analysis::next_step::{Begin, NextStep, next_step_of};
use aloft_compare::Signal;
use aloft_study::quote::visible;
use aloft_study::subject_session::SubjectSession;

/// Shows the check of a pipeline and its recordings.
pub fn show(args: &PipelineArgs, details: bool) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let mut trouble = broken(&set);
    for session in &set.members {
        if set.several {
            heading(&session.id)?;
        }
        trouble |= show_one(session, args, details)?;
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
            let current = freshness(session)?.is_current();
            let step = if current { next_step_of(session, true)? } else { NextStep::Run };
            // the block stands above: written into the pipeline, it takes a run
            let step = match step {
                NextStep::Correct { what, begin: Begin::Check } => NextStep::Correct { what, begin: Begin::Setting },
                other => other,
            };
            steps.push((&session.id, step));
        }
        let step = if steps.is_empty() { next::line("run", args, &[]) } else { next::for_all(&steps, args) };
        command("next", &step);
    }
    Ok(if trouble { Success::Partial } else { Success::Full })
}

/// Most kinds of remarks that a check shows.
const FINDINGS: usize = 20;

fn show_one(session: &SubjectSession, args: &PipelineArgs, details: bool) -> Result<bool, Stop> {
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
    show_session::explanations(&found.explanations, &session.id, args);
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
