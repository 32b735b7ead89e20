//! Commands to type next, quoted for a shell.

use crate::quote;
use crate::subject_session::SubjectSession;
use std::path::{Path, PathBuf};

/// `aloft WORDS PIPELINE …` for this study, with the folders that the pipeline does not name;
/// `last` is an argument after the pipeline.
pub fn command(session: &SubjectSession, words: &str, last: Option<&str>) -> String {
    let mut all = whole_command(session, words);
    all.extend(last.map(str::to_owned));
    // a run brings the whole study up to date; everything else is about this subject
    if words != "run" {
        all.extend(session.id.subject.iter().flat_map(|s| quote::option("subject", s)));
        all.extend(session.id.session.iter().flat_map(|s| quote::option("session", s)));
    }
    quote::line(all)
}

/// The same for all subjects of the study that this one belongs to.
pub fn for_all(session: &SubjectSession, words: &str) -> String {
    quote::line(whole_command(session, words))
}

fn whole_command(session: &SubjectSession, words: &str) -> Vec<String> {
    let mut all: Vec<String> = std::iter::once("aloft").chain(words.split(' ')).map(str::to_owned).collect();
    all.push(quote::argument(&session.config_path));
    let dir = session.config_path.parent().unwrap_or(Path::new(""));
    let (data, workspace) = (whole(&session.data, &session.id), whole_workspace(session));
    if session.config.data.as_ref().is_none_or(|d| !same(&dir.join(d), &data)) {
        all.extend(quote::option("data", &data.display().to_string()));
    }
    let named = session
        .config
        .workspace
        .as_ref()
        .is_some_and(|w| same(&dir.join(w), &workspace) || same(Path::new(w), &workspace));
    let usual = workspace.parent().and_then(Path::file_name).is_some_and(|n| n == "workspaces");
    if !named && !usual {
        all.extend(quote::option("workspace", &workspace.display().to_string()));
    }
    all
}

/// True for two names of the same folder.
fn same(a: &Path, b: &Path) -> bool {
    a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Folder of all subjects, from that of one of them.
fn whole(path: &Path, id: &crate::recordings::SessionId) -> PathBuf {
    let mut out = path.to_path_buf();
    for name in [&id.session, &id.subject].into_iter().flatten() {
        if out.file_name().is_some_and(|n| n.to_string_lossy() == *name) {
            out.pop();
        }
    }
    out
}

fn whole_workspace(session: &SubjectSession) -> PathBuf {
    whole(&session.workspace, &session.id)
}
