//! Answers from results: `aloft parameters`, `compare`, `discover` and `history`.

use crate::args::{CompareArgs, DiscoverArgs, ParametersArgs, PipelineArgs, RowsArg, StrictArgs};
use crate::each::{each_result, each_step, whose};
use crate::progress::{Counted, Waiting};
use crate::render::note;
use crate::stop::Stop;
use crate::{Success, findings, ladder, next, residuals, show, show_estimators};
use aloft_analysis::next_step::{next_step, next_step_of};
use aloft_analysis::{asked_before, assess, compare, discover, effect, estimators, history, next_flights, parameters};
use aloft_discover::Told;
use aloft_study::config::Rows;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use std::cell::Cell;

impl From<RowsArg> for Rows {
    fn from(rows: RowsArg) -> Self {
        match rows {
            RowsArg::Acceleration => Self::Acceleration,
            RowsArg::Weak => Self::Weak,
        }
    }
}

/// Shows the identified parameters.
pub fn parameters(args: ParametersArgs) -> Result<Success, Stop> {
    let ParametersArgs { pipeline, strict, rows, assess: with_assessment, next_flights: dir, json } = args;
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
    each_result(&pipeline, strict, json, &parameters::READS, ask, show::parameters)
}

/// Compares the model with measurement.
pub fn compare(args: CompareArgs) -> Result<Success, Stop> {
    let CompareArgs { pipeline, strict, estimators, leave_one_out, by, details, json } = args;
    if estimators {
        let ask = waiting("comparing estimators", estimators::estimators);
        return each_result(&pipeline, strict, json, &[], ask, show_estimators::estimators);
    }
    if leave_one_out {
        let ask = waiting("leaving out each trial", estimators::leave_one_out);
        return each_result(&pipeline, strict, json, &[], ask, show_estimators::leave_one_out);
    }
    let show = |session: &SubjectSession, current: bool, found: &compare::ComparisonView| {
        residuals::comparison(found, &by, details)?;
        if by.is_empty() {
            next::show(&next_step(session, found, current)?, &session.id, &pipeline);
        }
        Ok(())
    };
    each_step(&pipeline, strict, json, &compare::READS, compare::compare, show)
}

/// Says which effect is missing.
pub fn discover(args: DiscoverArgs) -> Result<Success, Stop> {
    let DiscoverArgs { pipeline, strict, only, without, closed, budget, self_test, again, details, json } = args;
    if self_test {
        let options = discover::options(only, without, true, None);
        let ask = |session: &SubjectSession| {
            let bar = Counted::new("self-test");
            discover::self_test(session, &options, &|done, all| bar.at(done, all))
        };
        return each_result(&pipeline, strict, json, &[], ask, |found| findings::self_test(&found.self_test));
    }
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
    let incomplete = Cell::new(false);
    let ask = |session: &SubjectSession| {
        let found = ask(session)?;
        for what in &found.not_computed {
            note(format!("{}could not be computed: {what}", whose(session)));
        }
        if !found.not_computed.is_empty() {
            note(format!(
                "{}this answer is not whole (the ranking's estimates stand there) and was not stored",
                whose(session)
            ));
        } else if let Some(why) = &found.not_stored {
            note(format!(
                "{}the answer could not be stored, so that `effect add` does not find it: {why}",
                whose(session)
            ));
        }
        incomplete.set(incomplete.get() || !found.is_kept());
        Ok(found)
    };
    let show = |session: &SubjectSession, current: bool, found: &discover::DiscoveryView| {
        findings::discovery(found, details)?;
        if found.is_kept() { findings::next(found, session, current, &pipeline) } else { Ok(()) }
    };
    let done = each_step(&pipeline, strict, json, &[], ask, show)?;
    Ok(if incomplete.get() { Success::Partial } else { done })
}

/// Shows the ladder of model revisions.
pub fn history(args: &PipelineArgs, strict: StrictArgs, details: bool, as_json: bool) -> Result<Success, Stop> {
    let show = |session: &SubjectSession, current: bool, found: &effect::History| {
        ladder::history(found, details)?;
        next::show(&next_step_of(session, current)?, &session.id, args);
        Ok(())
    };
    each_step(args, strict, as_json, &history::READS, effect::history, show)
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
