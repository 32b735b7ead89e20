//! `aloft workflow`: writes the Snakefile, or says what a finished workflow lacks.

use crate::Success;
use crate::args::PipelineArgs;
use crate::commands::{Stop, open};
use crate::render::note;
use aloft_pipeline::command::workflow::{Call, Member, verdict, write};
use std::path::Path;

/// `--data` and `--workspace` as they were given.
fn folders(args: &PipelineArgs) -> Vec<String> {
    [("--data", &args.data), ("--workspace", &args.workspace)]
        .into_iter()
        .filter_map(|(flag, path)| path.as_ref().map(|p| [flag.to_owned(), p.display().to_string()]))
        .flatten()
        .collect()
}

/// Carries it out.
pub fn run(args: &PipelineArgs, out: &Path, say: bool) -> Result<Success, Stop> {
    let study = open(args)?;
    if !say {
        let member = Member { name: study.config.name.clone(), words: Vec::new(), study: &study };
        let call = Call { pipeline: args.pipeline.clone(), words: folders(args), workspace: study.workspace.clone() };
        write(&[member], &call, out)?;
        note(format!("wrote {}", out.display()));
        note(format!("next: snakemake -s {} --cores all --keep-going", out.display()));
        return Ok(Success::Full);
    }
    let lacking = verdict(&study)?;
    for one in lacking.iter().filter(|l| l.first) {
        note(format!("failed: {} {}: {}", one.stage, one.trial, one.failure.problem));
        if let Some(hint) = &one.failure.hint {
            note(format!("  hint: {hint}"));
        }
    }
    let first = lacking.iter().filter(|l| l.first).count();
    if lacking.is_empty() {
        note("everything is there and up to date");
        return Ok(Success::Full);
    }
    note(format!("{first} failed or missing, {} could not follow; all others are done", lacking.len() - first));
    Ok(Success::Partial)
}
