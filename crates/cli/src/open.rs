//! From arguments to studies and back.

use crate::args::PipelineArgs;
use crate::render::note;
use crate::stop::Stop;
use aloft_study::data_set::DataSet;
use aloft_study::quote;
use aloft_study::subject_session::{Overrides, SubjectSession};

fn overrides(args: &PipelineArgs) -> Overrides {
    Overrides {
        data: args.data.clone(),
        workspace: args.workspace.clone(),
        subjects: args.subject.clone(),
        sessions: args.session.clone(),
    }
}

/// The one study of a pipeline.
pub fn open(args: &PipelineArgs) -> Result<SubjectSession, Stop> {
    Ok(open_all(args)?.only()?)
}

/// Opens the one study of a pipeline again and again; the first time here, so that its notes are
/// shown once.
pub fn opener(args: &PipelineArgs) -> Result<aloft_studio::Opener, Stop> {
    open(args)?;
    let args = args.clone();
    Ok(Box::new(move || DataSet::open(&args.pipeline, &overrides(&args))?.only()))
}

/// All subjects and sessions selected on the command line.
pub fn open_all(args: &PipelineArgs) -> Result<DataSet, Stop> {
    let set = DataSet::open(&args.pipeline, &overrides(args))?;
    if let Some(place) = &set.place_note {
        note(format!("note: {place}"));
    }
    for old in &set.pipeline.old_names {
        note(format!("warning: {}: {old}", set.pipeline.name()));
    }
    Ok(set)
}

/// Arguments that repeat the pipeline and folders after a command's name, for a shell.
pub fn description_of(args: &PipelineArgs) -> String {
    quote::pipeline(&args.pipeline, args.data.as_deref(), args.workspace.as_deref())
}
