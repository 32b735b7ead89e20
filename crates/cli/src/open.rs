//! From arguments to studies and back.

use crate::args::PipelineArgs;
use crate::render::note;
use crate::stop::Stop;
use aloft_study::data_set::DataSet;
use aloft_study::quote;
use aloft_study::subject_session::{Overrides, SubjectSession};

/// Folders and choices of the command line.
pub fn overrides(args: &PipelineArgs) -> Overrides {
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

/// Opens one subject of a pipeline again and again, and the whole study if it has several; the
/// first time here, so that its notes are shown once. Of several subjects of which none is chosen
/// the first is opened.
pub fn openers(args: &PipelineArgs) -> Result<(aloft_studio::Opener, Option<aloft_studio::SetOpener>), Stop> {
    let set = open_all(args)?;
    let (mut one, all) = (args.clone(), Overrides { subjects: Vec::new(), sessions: Vec::new(), ..overrides(args) });
    if set.members.len() > 1
        && let Some(first) = set.members.first()
    {
        one.subject = first.id.subject.iter().cloned().collect();
        one.session = first.id.session.iter().cloned().collect();
        note(format!(
            "{} subjects or sessions; opened {}, another: --subject and --session",
            set.members.len(),
            first.id
        ));
    } else {
        set.only()?;
    }
    let several = DataSet::open(&args.pipeline, &all)?.several;
    let pipeline = args.pipeline.clone();
    let open_set: aloft_studio::SetOpener = Box::new(move || DataSet::open(&pipeline, &all));
    Ok((Box::new(move || DataSet::open(&one.pipeline, &overrides(&one))?.only()), several.then_some(open_set)))
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
