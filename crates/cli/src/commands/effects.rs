//! `aloft effect`: the catalogue, and the effects of a model.

use crate::Success;
use crate::args::{EffectAction, PipelineArgs};
use crate::each::{broken, heading};
use crate::markdown::markdown;
use crate::open::{description_of, open_all};
use crate::progress::Bars;
use crate::render::{command, json, note, out};
use crate::stop::Stop;
use crate::{findings, ladder, next, run_end};
use aloft_analysis::next_step::{NextStep, next_step_of};
use aloft_analysis::{effect, outputs, summary};
use aloft_pipeline::runner::RunReport;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk;
use aloft_workspace::error::PipelineError;
use std::path::Path;

/// Carries out an action on effects.
pub fn effects(action: EffectAction) -> Result<Success, Stop> {
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

fn change_effects(
    args: &PipelineArgs,
    details: bool,
    change: impl Fn(&SubjectSession) -> Result<(RunReport, effect::History), PipelineError>,
) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let mut trouble = broken(&set);
    for session in &set.members {
        if set.several {
            heading(&session.id)?;
        }
        let (report, history) = change(session)?;
        run_end::notes(&session.id, &report, details);
        note(run_end::totals(std::iter::once(&report), report.seconds));
        ladder::change(&history, details)?;
        trouble |= report.has_trouble();
    }
    // the tables of the study say what its results say
    let now = open_all(args)?;
    if disk::is_there(&now.workspace.join(outputs::SUMMARY[0]))? {
        summary::summary(&now, &description_of(args))?.write(&now)?;
    }
    let mut steps = Vec::new();
    for session in &set.members {
        steps.push((&session.id, next_step_of(&session.refreshed()?, true)?));
    }
    match steps.as_slice() {
        [(_, NextStep::Advised(advice))] => note(format!("advice: {advice}")),
        [(_, NextStep::Correct { what, .. })] => note(format!("first: {what}")),
        _ => {}
    }
    command("next", &next::for_all(&steps, args));
    Ok(if trouble { Success::Partial } else { Success::Full })
}
