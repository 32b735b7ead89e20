//! The one command to type next.

use crate::args::PipelineArgs;
use crate::open::description_of;
use crate::render::{command, note};
use aloft_analysis::next_step::{Begin, NextStep};
use aloft_study::quote;
use aloft_study::recordings::SessionId;

/// `--subject` and `--session` for a member of a study of several.
fn member(id: &SessionId) -> Vec<String> {
    let of = |flag: &str, name: &Option<String>| {
        name.iter().flat_map(|n| quote::option(flag, &quote::pattern(n))).collect::<Vec<_>>()
    };
    [of("subject", &id.subject), of("session", &id.session)].concat()
}

/// `aloft VERB P.yaml …`, quoted for a shell.
pub fn line(verb: &str, args: &PipelineArgs, more: &[String]) -> String {
    let rest = if more.is_empty() { String::new() } else { format!(" {}", quote::line(more)) };
    format!("aloft {verb} {}{rest}", description_of(args))
}

/// `aloft effect add P.yaml EFFECT …` for this subject and session.
pub fn add(key: &str, id: &SessionId, args: &PipelineArgs) -> String {
    line("effect add", args, &[vec![key.to_owned()], member(id)].concat())
}

/// The command for a step of one subject and session. Where nothing is left to ask or to add, the
/// report shows where the error sits.
pub fn command_for(step: &NextStep, id: &SessionId, args: &PipelineArgs) -> String {
    match step {
        NextStep::Correct { begin: Begin::Check, .. } => line("check", args, &member(id)),
        NextStep::Run | NextStep::Correct { begin: Begin::Setting, .. } => line("run", args, &member(id)),
        NextStep::Discover { .. } => line("discover", args, &member(id)),
        NextStep::Add { key, .. } => add(key, id, args),
        NextStep::Remove { key } => line("effect remove", args, &[vec![key.clone()], member(id)].concat()),
        NextStep::Correct { begin: Begin::Report, .. }
        | NextStep::Record(_)
        | NextStep::Advised(_)
        | NextStep::Use
        | NextStep::Look => line("report", args, &member(id)),
    }
}

/// Shows the step of one subject and session: what the answer of `discover` advises, then the
/// command to type.
pub fn show(step: &NextStep, id: &SessionId, args: &PipelineArgs) {
    if let NextStep::Advised(advice) = step {
        note(format!("advice: {advice}"));
    }
    if let NextStep::Correct { what, .. } = step {
        note(format!("first: {what}"));
    }
    command("next", &command_for(step, id, args));
}

/// The command for several subjects and sessions: one for all of them where they have the same
/// step.
pub fn for_all(steps: &[(&SessionId, NextStep)], args: &PipelineArgs) -> String {
    let of_all = |verb: &str, key: Option<&String>| {
        let chosen = [chosen("subject", &args.subject), chosen("session", &args.session)].concat();
        line(verb, args, &[key.cloned().into_iter().collect(), chosen].concat())
    };
    let any = |wanted: fn(&NextStep) -> bool| steps.iter().find(|(_, step)| wanted(step));
    match steps {
        [] => of_all("status", None),
        [(id, step)] => command_for(step, id, args),
        [(_, NextStep::Add { key, .. }), rest @ ..]
            if rest.iter().all(|(_, s)| matches!(s, NextStep::Add { key: other, .. } if other == key)) =>
        {
            of_all("effect add", Some(key))
        }
        _ if any(|s| matches!(s, NextStep::Run | NextStep::Correct { begin: Begin::Setting, .. })).is_some() => {
            of_all("run", None)
        }
        _ if any(|s| matches!(s, NextStep::Correct { begin: Begin::Check, .. })).is_some() => of_all("check", None),
        _ if any(|s| matches!(s, NextStep::Correct { .. })).is_some() => of_all("report", None),
        _ if any(|s| matches!(s, NextStep::Discover { .. })).is_some() => of_all("discover", None),
        _ => match any(|s| matches!(s, NextStep::Add { .. } | NextStep::Remove { .. })) {
            Some((id, step)) => command_for(step, id, args),
            None => of_all("report", None),
        },
    }
}

/// `--subject` or `--session` as they were chosen.
fn chosen(flag: &str, names: &[String]) -> Vec<String> {
    names.iter().flat_map(|n| quote::option(flag, n)).collect()
}

/// After a run: what failed is explained first; then the missing effect is sought, added, reported.
pub fn after_run(
    steps: &[(&SessionId, NextStep)],
    failed: Option<(&SessionId, Option<(&str, &str)>)>,
    args: &PipelineArgs,
) -> String {
    match failed {
        Some((id, Some((stage, trial)))) => {
            line("explain", args, &[vec![trial.to_owned(), stage.to_owned()], member(id)].concat())
        }
        Some((id, None)) => line("check", args, &member(id)),
        None => for_all(steps, args),
    }
}
