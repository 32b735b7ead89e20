//! What an answer of `discover` rests on, as one hash: the results of all stages, what the pipeline
//! and the files beside it say, the effects of the model, the options, and the program.

use crate::history::with_reference;
use aloft_discover::DiscoverOptions;
use aloft_pipeline::graph::results_hash;
use aloft_pipeline::stages::STAGES;
use aloft_study::subject_session::{FileSizes, SubjectSession};
use aloft_workspace::error::PipelineError;
use aloft_workspace::workspace::Workspace;
use std::fs::File;
use std::sync::OnceLock;

/// Hash of everything that an answer rests on; none if the answer depends on the time that it was
/// given, or if the program cannot be read.
///
/// # Errors
/// A result is there and cannot be read.
pub(crate) fn question(session: &SubjectSession, options: &DiscoverOptions) -> Result<Option<String>, PipelineError> {
    let (None, Some(program)) = (options.budget_s, program()) else { return Ok(None) };
    let results = STAGES.iter().flat_map(|stage| stage.tasks(session).into_iter().map(|trial| (stage.name, trial)));
    let results = results_hash(&Workspace::open(&session.workspace), results)?;
    // The model with what its columns are computed from: the way to it is no part of the question,
    // so that a model that comes back has its answer. Sizes of files are read when first asked for.
    let with = match with_reference(session) {
        Ok(with) => with,
        Err(e @ PipelineError::Io { .. }) => return Err(e),
        // none: without a question the answer is computed, which names what is wrong
        Err(_) => return Ok(None),
    };
    let asked = SubjectSession { sizes: FileSizes::default(), ..with };
    let mut hasher = blake3::Hasher::new();
    hasher.update(program.as_bytes()).update(results.as_bytes());
    hasher.update(format!("{asked:?}\n{options:?}").as_bytes());
    Ok(Some(hasher.finalize().to_hex().to_string()))
}

/// Hash of the program's file.
fn program() -> Option<blake3::Hash> {
    static PROGRAM: OnceLock<Option<blake3::Hash>> = OnceLock::new();
    let read = || {
        let mut hasher = blake3::Hasher::new();
        // none: as above
        hasher.update_reader(File::open(std::env::current_exe().ok()?).ok()?).ok()?;
        Some(hasher.finalize())
    };
    *PROGRAM.get_or_init(read)
}
