//! `aloft workflow`: writes the Snakefile, or says what a finished workflow lacks.

use crate::Success;
use crate::args::PipelineArgs;
use crate::commands::{Stop, open_all};
use crate::each::broken;
use crate::render::note;
use aloft_pipeline::command::workflow::{Call, Member, verdict, write};
use aloft_pipeline::studies::StudySet;
use std::path::Path;

/// `--data` and `--workspace` as they were given.
fn folders(args: &PipelineArgs) -> Vec<String> {
    [("--data", &args.data), ("--workspace", &args.workspace)]
        .into_iter()
        .filter_map(|(flag, path)| path.as_ref().map(|p| [flag.to_owned(), p.display().to_string()]))
        .flatten()
        .collect()
}

/// `--subject` and `--session` as they were given.
fn chosen(args: &PipelineArgs) -> Vec<String> {
    [("--subject", &args.subject), ("--session", &args.session)]
        .into_iter()
        .flat_map(|(flag, names)| names.iter().flat_map(move |n| [flag.to_owned(), n.clone()]))
        .collect()
}

/// Carries it out.
pub fn run(args: &PipelineArgs, out: &Path, say: bool) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let cannot = broken(&set);
    if say {
        return judge(&set, cannot);
    }
    let members: Vec<Member<'_>> = set
        .members
        .iter()
        .map(|study| {
            let parts = [("--subject", &study.id.subject), ("--session", &study.id.session)];
            let chosen: Vec<(&str, &String)> = parts.iter().filter_map(|(f, v)| Some((*f, v.as_ref()?))).collect();
            let name = chosen.iter().map(|(_, v)| v.as_str()).collect::<Vec<_>>().join("_");
            Member {
                name: if name.is_empty() { study.config.name.clone() } else { name },
                words: chosen.iter().flat_map(|(f, v)| [(*f).to_owned(), (*v).clone()]).collect(),
                study,
            }
        })
        .collect();
    let call = Call {
        pipeline: args.pipeline.clone(),
        words: folders(args),
        chosen: chosen(args),
        workspace: set.workspace.clone(),
    };
    write(&members, &call, out)?;
    note(format!("wrote {}", out.display()));
    note(format!("next: snakemake -s {} --cores all --keep-going", out.display()));
    Ok(if cannot { Success::Partial } else { Success::Full })
}

/// Says what a finished workflow lacks.
fn judge(set: &StudySet, cannot: bool) -> Result<Success, Stop> {
    let (mut first, mut behind) = (0, 0);
    for study in &set.members {
        let lacking = verdict(study)?;
        let whose = if set.several { format!("{}: ", study.id) } else { String::new() };
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
    if first + behind == 0 && !cannot {
        note("everything is there and up to date");
        return Ok(Success::Full);
    }
    note(format!("{first} failed or missing, {behind} could not follow; all others are done"));
    Ok(Success::Partial)
}
