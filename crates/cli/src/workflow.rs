//! `aloft workflow`: writes the Snakefile, or reports which results a finished workflow lacks.

use crate::Success;
use crate::args::PipelineArgs;
use crate::each::broken;
use crate::open::{description_of, open_all};
use crate::render::{command, note};
use crate::stop::Stop;
use aloft_analysis::summary;
use aloft_analysis::workflow::{Call, Member, plan_path, verdict, write};
use aloft_study::data_set::DataSet;
use aloft_study::quote;
use std::path::Path;

/// `--data` and `--workspace` as given by the user.
fn folders(args: &PipelineArgs) -> Vec<String> {
    [("data", &args.data), ("workspace", &args.workspace)]
        .into_iter()
        .flat_map(|(flag, path)| path.iter().flat_map(move |p| quote::option(flag, &p.display().to_string())))
        .collect()
}

/// `--subject` and `--session` as given by the user.
fn chosen(args: &PipelineArgs) -> Vec<String> {
    [("subject", &args.subject), ("session", &args.session)]
        .into_iter()
        .flat_map(|(flag, names)| names.iter().flat_map(move |n| quote::option(flag, n)))
        .collect()
}

/// Runs the command.
pub fn run(args: &PipelineArgs, out: &Path, say: bool) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let cannot = broken(&set);
    if say {
        return judge(&set, args, cannot);
    }
    let members: Vec<Member<'_>> = set.members.iter().map(|session| Member { session }).collect();
    let call = Call {
        pipeline: args.pipeline.clone(),
        words: folders(args),
        chosen: chosen(args),
        workspace: set.workspace.clone(),
    };
    write(&members, &call, out)?;
    note(format!("wrote {} and {}", out.display(), plan_path(out).display()));
    command("next", &format!("snakemake -s {} --cores all --keep-going", quote::path(out)));
    Ok(if cannot { Success::Partial } else { Success::Full })
}

/// Reports which results a finished workflow lacks, and writes the summary that every run writes:
/// the jobs did not, because they would have overwritten each other's.
fn judge(set: &DataSet, args: &PipelineArgs, cannot: bool) -> Result<Success, Stop> {
    let (mut first, mut behind) = (0, 0);
    for session in &set.members {
        let lacking = verdict(session)?;
        let whose = if set.several { format!("{}: ", session.id) } else { String::new() };
        for one in lacking.iter().filter(|l| l.first) {
            note(format!("failed: {whose}{} {}: {}", one.stage, one.trial, one.failure.problem));
            if let Some(hint) = &one.failure.hint {
                note(format!("  hint: {hint}"));
            }
        }
        let here = lacking.iter().filter(|l| l.first).count();
        first += here;
        behind += lacking.len() - here;
    }
    summary::summary(set, &description_of(args))?.write(set)?;
    if first + behind == 0 && !cannot {
        note("all results are present and up to date");
        return Ok(Success::Full);
    }
    note(format!("{first} failed or missing, {behind} blocked by them; all others are done"));
    Ok(Success::Partial)
}
