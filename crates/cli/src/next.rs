//! The one command to type next.

use crate::args::PipelineArgs;
use crate::open::description_of;
use aloft_analysis::compare::ComparisonView;
use aloft_analysis::discover::latest;
use aloft_discover::Verdict;
use aloft_study::quote;
use aloft_study::recordings::SessionId;
use aloft_study::subject_session::SubjectSession;

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

/// `aloft effect add P.yaml EFFECT …` for the subjects that were asked about.
pub fn add(key: &str, args: &PipelineArgs) -> String {
    let chosen =
        |flag: &str, names: &[String]| names.iter().flat_map(|n| quote::option(flag, n)).collect::<Vec<String>>();
    let more = [vec![key.to_owned()], chosen("subject", &args.subject), chosen("session", &args.session)].concat();
    line("effect add", args, &more)
}

/// After a run: what failed is explained first; then the missing effect is sought, added, reported.
pub fn after_run(
    views: &[(&SubjectSession, ComparisonView)],
    failed: Option<(&SessionId, Option<(&str, &str)>)>,
    args: &PipelineArgs,
) -> String {
    if let Some((id, task)) = failed {
        let whose = member(id);
        return match task {
            Some((stage, trial)) => line("explain", args, &[vec![trial.to_owned(), stage.to_owned()], whose].concat()),
            None => line("check", args, &whose),
        };
    }
    let [(session, view)] = views else {
        let far = views.iter().any(|(_, v)| is_above(v));
        return if views.is_empty() {
            line("status", args, &[])
        } else {
            line(if far { "discover" } else { "report" }, args, &[])
        };
    };
    let whose = if session.id.subject.is_some() { member(&session.id) } else { Vec::new() };
    if !is_above(view) {
        return line("report", args, &whose);
    }
    // an answer that holds for these results is not asked for again
    match latest(session) {
        None if view.too_few_to_ask() => line("report", args, &whose),
        // what is not shown to be the cause is not proposed
        Some(found)
            if found.verdict == Verdict::Unexplained && found.open.as_ref().is_none_or(|o| o.laws.is_empty()) =>
        {
            line("report", args, &whose)
        }
        Some(found) => {
            let held: Vec<&str> = session.effects.iter().map(|e| e.key.as_str()).collect();
            match found.found.iter().find(|f| !held.contains(&f.key.as_str())) {
                Some(f) => line("effect add", args, &[vec![f.key.clone()], whose].concat()),
                None => line("report", args, &whose),
            }
        }
        None => line("discover", args, &whose),
    }
}

/// True if some error is not at its floor.
pub fn is_above(view: &ComparisonView) -> bool {
    view.errors.iter().any(|e| e.at_floor == Some(false))
}
