//! A study of many subjects and sessions: one [`SubjectSession`] for each session, with a workspace
//! folder of its own.
//!
//! Results are in `WORKSPACE/<subject>/<session>/<stage>/<trial>/`; for a study of one subject in
//! `WORKSPACE/<stage>/<trial>/`.

use crate::facts::participant_ids;
use crate::inherit::{PipelineFile, fits};
use crate::nearest::{hint, nearest};
use crate::place::error_at_key;
use crate::quote::visible;
use crate::recordings::{SessionId, fold, pattern, recordings_below, trial_name};
use crate::subject_session::{Overrides, Place, SubjectSession};
use aloft_workspace::error::{PipelineError, StageFailure};
use globset::GlobMatcher;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// All subjects and sessions of a pipeline.
#[derive(Debug)]
pub struct DataSet {
    /// The pipeline file.
    pub pipeline: PipelineFile,
    /// Folder of recordings.
    pub data: PathBuf,
    /// Folder of results.
    pub workspace: PathBuf,
    /// True if the study is laid out as several subjects or sessions (even if only one is
    /// selected).
    pub several: bool,
    /// Subjects and sessions that can be processed, sorted.
    pub members: Vec<SubjectSession>,
    /// Those that cannot be processed: no recordings, no body mass …
    pub broken: Vec<BrokenMember>,
    /// Those excluded by the pipeline, with the reason.
    pub excluded: Vec<(SessionId, String)>,
    /// A note on where the workspace was found; none if it is in its usual place.
    pub place_note: Option<String>,
    /// Remarks about the layout: participants without folders, overrides that match nothing.
    pub remarks: Vec<String>,
}

/// A subject or session that cannot be processed.
#[derive(Debug)]
pub struct BrokenMember {
    /// Subject and session.
    pub id: SessionId,
    /// Reason.
    pub failure: StageFailure,
}

struct Folder {
    id: SessionId,
    subject_folder: PathBuf,
    data: PathBuf,
}

impl DataSet {
    /// Folder of recordings and folder of results of a pipeline; what is in them is not looked at.
    ///
    /// # Errors
    /// The pipeline cannot be read, or names no folder of recordings that exists.
    pub fn places(path: &Path, overrides: &Overrides) -> Result<(PathBuf, PathBuf), PipelineError> {
        folders_of(&PipelineFile::read(path)?, overrides)
    }

    /// Reads the pipeline file and finds subjects, sessions, recordings and facts.
    pub fn open(path: &Path, overrides: &Overrides) -> Result<Self, PipelineError> {
        let pipeline = PipelineFile::read(path)?;
        let (data, workspace) = folders_of(&pipeline, overrides)?;
        let named = overrides.workspace.is_some() || pipeline.config.workspace.is_some();
        let place_note = in_the_earlier_place(&workspace, &pipeline.folder(), named);
        let mut set = Self {
            place_note,
            pipeline,
            data,
            workspace,
            several: false,
            members: Vec::new(),
            broken: Vec::new(),
            excluded: Vec::new(),
            remarks: Vec::new(),
        };
        let folders = set.layout()?;
        set.several = folders.is_some();
        let Some(folders) = folders else {
            if !overrides.subjects.is_empty() || !overrides.sessions.is_empty() {
                return Err(PipelineError::request_hint(
                    format!("{} holds one subject: --subject and --session choose among several", set.data.display()),
                    "see `subjects` in the pipeline, participants.tsv, or folders called sub-…",
                ));
            }
            let place = Place {
                id: SessionId::default(),
                data: set.data.clone(),
                workspace: set.workspace.clone(),
                subject_folder: None,
                root: &set.data,
            };
            set.members.push(SubjectSession::bind(&set.pipeline, place)?);
            return Ok(set);
        };
        set.look_at_overrides(&folders);
        let known: Vec<SessionId> = folders.iter().map(|f| f.id.clone()).collect();
        for folder in folders {
            if !chosen(&overrides.subjects, folder.id.subject.as_deref())
                || !chosen(&overrides.sessions, folder.id.session.as_deref())
            {
                continue;
            }
            if let Some(reason) = set.exclusion(&folder.id) {
                set.excluded.push((folder.id, reason));
                continue;
            }
            let mut workspace = set.workspace.clone();
            workspace.extend([&folder.id.subject, &folder.id.session].into_iter().flatten());
            let place = Place {
                id: folder.id.clone(),
                data: folder.data,
                workspace,
                subject_folder: Some(folder.subject_folder),
                root: &set.data,
            };
            match SubjectSession::bind(&set.pipeline, place) {
                Ok(session) => set.members.push(session),
                Err(error) => set.broken.push(BrokenMember { id: folder.id, failure: error.into() }),
            }
        }
        if set.members.is_empty() && set.broken.is_empty() && set.excluded.is_empty() {
            let names: Vec<String> = known.iter().map(ToString::to_string).collect();
            let all: Vec<&str> = names.iter().map(String::as_str).collect();
            let parts: Vec<&str> =
                known.iter().flat_map(|id| [&id.subject, &id.session]).flatten().map(String::as_str).collect();
            let asked = overrides.subjects.iter().chain(&overrides.sessions);
            let near = asked.flat_map(|a| nearest(a, &parts)).map(|n| format!("`{n}`")).next();
            let meant = near.map_or(String::new(), |n| format!("did you mean {n}? "));
            return Err(PipelineError::request_hint(
                "no subject matches --subject and --session",
                format!("{meant}{}", hint("", &all, "there are")),
            ));
        }
        Ok(set)
    }

    /// The only study; if there are several, an error that explains how to choose.
    pub fn only(mut self) -> Result<SubjectSession, PipelineError> {
        if self.members.len() == 1 && self.broken.is_empty() {
            return self.members.pop().ok_or_else(|| PipelineError::request("no study"));
        }
        if let (true, Some(b)) = (self.members.is_empty(), self.broken.pop()) {
            return Err(PipelineError::Request {
                problem: format!("{}: {}", b.id, b.failure.problem),
                hint: b.failure.hint,
            });
        }
        let names: Vec<String> = self.members.iter().map(|m| m.id.to_string()).collect();
        Err(PipelineError::request_hint(
            format!("{} holds {} subjects or sessions; this needs one", self.data.display(), names.len()),
            format!("choose with --subject and --session among {}", names.join(", ")),
        ))
    }

    /// Number of trials that are not excluded, over all members.
    pub fn n_trials(&self) -> usize {
        self.members.iter().map(|m| m.included().count()).sum()
    }

    /// Folders of subjects and sessions; none for a study of one subject.
    fn layout(&mut self) -> Result<Option<Vec<Folder>>, PipelineError> {
        let ids = participant_ids(&self.data)?;
        let config = self.pipeline.config.subjects.clone();
        let explicit = config.as_ref().is_some_and(|c| !c.folders.is_empty());
        let subjects = if let (true, Some(c)) = (explicit, &config) {
            self.folders_matching(&self.data, &c.folders, "folders")?
        } else {
            let of_table: Vec<PathBuf> = ids.iter().filter_map(|id| named_folder(&self.data, id)).collect();
            if of_table.is_empty() {
                self.folders_matching(&self.data, &["sub-*".to_owned()], "folders")?
            } else {
                of_table
            }
        };
        if subjects.is_empty() {
            return match config {
                None => Ok(None),
                Some(c) => Err(error_at_key(
                    &self.pipeline.name(),
                    &self.pipeline.text,
                    "subjects",
                    format!("{}: no folder of a subject ({})", self.data.display(), c.folders.join(", ")),
                    Some("give `folders: [NAME or PATTERN, …]` relative to the data folder".to_owned()),
                )),
            };
        }
        let sessions = config.map_or_else(|| vec!["ses-*".to_owned()], |c| c.sessions);
        let mut folders = Vec::new();
        for subject in &subjects {
            let name = self.subject_name(subject, &subjects);
            let of_subject = self.folders_matching(subject, &sessions, "sessions")?;
            let mut push = |session: Option<String>, data: &Path| {
                folders.push(Folder {
                    id: SessionId { subject: Some(name.clone()), session },
                    subject_folder: subject.clone(),
                    data: data.to_path_buf(),
                });
            };
            if of_subject.is_empty() {
                push(None, subject);
            }
            for session in &of_subject {
                let relative = session.strip_prefix(subject).unwrap_or(session);
                push(Some(joined(relative)), session);
            }
        }
        folders.sort_by(|a, b| a.id.cmp(&b.id));
        self.ids_are_distinct(&folders)?;
        self.remarks.extend(
            ids.iter()
                .filter(|id| named_folder(&self.data, id).is_none())
                .map(|id| format!("participants.tsv names `{id}`, for whom there is no folder")),
        );
        if !ids.is_empty() {
            self.remarks.extend(
                subjects
                    .iter()
                    .filter(|s| !ids.iter().any(|id| named_folder(&self.data, id).as_ref() == Some(*s)))
                    .map(|s| format!("{} is not in participants.tsv", s.display())),
            );
        }
        Ok(Some(folders))
    }

    /// Checks that each subject and session has a results folder of its own, also on file systems
    /// that ignore case.
    fn ids_are_distinct(&self, folders: &[Folder]) -> Result<(), PipelineError> {
        let mut seen: BTreeMap<(String, Option<String>), &Folder> = BTreeMap::new();
        for folder in folders.iter().filter(|f| self.exclusion(&f.id).is_none()) {
            let subject = folder.id.subject.as_deref().map(fold).unwrap_or_default();
            if let Some(other) = seen.insert((subject, folder.id.session.as_deref().map(fold)), folder) {
                let shown =
                    |f: &Folder| visible(&f.data.strip_prefix(&self.data).unwrap_or(&f.data).display().to_string());
                return Err(PipelineError::request_hint(
                    format!(
                        "the folders {} and {} are both `{}`: results of one would replace the other's",
                        shown(other),
                        shown(folder),
                        visible(&folder.id.to_string())
                    ),
                    "rename one of the folders (upper and lower case count as the same), or name one of them under `subjects: {folders: …}`",
                ));
            }
        }
        Ok(())
    }

    /// The last part of a subject's path, or the whole path if two would have the same name.
    fn subject_name(&self, folder: &Path, all: &[PathBuf]) -> String {
        let last = |p: &Path| p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        if all.iter().filter(|p| fold(&last(p)) == fold(&last(folder))).count() == 1 {
            return last(folder);
        }
        joined(folder.strip_prefix(&self.data).unwrap_or(folder))
    }

    fn folders_matching(&self, base: &Path, patterns: &[String], key: &str) -> Result<Vec<PathBuf>, PipelineError> {
        let (file, text) = (self.pipeline.name(), &self.pipeline.text);
        let matchers: Vec<GlobMatcher> =
            patterns.iter().map(|p| pattern(p.trim_end_matches('/'), key, &file, text)).collect::<Result<_, _>>()?;
        let deepest = patterns.iter().map(|p| p.trim_end_matches('/').split('/').count()).max().unwrap_or(0);
        let mut found: Vec<PathBuf> = walkdir::WalkDir::new(base)
            .min_depth(1)
            .max_depth(deepest.max(1))
            .sort_by_file_name()
            .into_iter()
            .filter_entry(|e| !e.file_name().to_string_lossy().starts_with('.'))
            .filter_map(|e| e.map_err(|e| unlisted(base, e, patterns)).map_or_else(|e| e.map(Err), |e| Some(Ok(e))))
            .collect::<Result<Vec<_>, _>>()?
            .into_iter()
            .filter(|e| e.path().is_dir() && !e.path().join(aloft_workspace::format::MARKER).is_file())
            .filter(|e| e.path().strip_prefix(base).is_ok_and(|r| matchers.iter().any(|m| m.is_match(r))))
            .map(walkdir::DirEntry::into_path)
            .collect();
        // a name written without wildcards must exist
        for p in patterns.iter().filter(|p| !p.contains(['*', '?', '[', '{'])) {
            let folder = base.join(p);
            if key == "folders" && !found.contains(&folder) {
                return Err(error_at_key(
                    &file,
                    text,
                    key,
                    format!("there is no folder `{p}` in {}", base.display()),
                    Some("correct the name, or leave the subject out of `folders`".to_owned()),
                ));
            }
        }
        found.sort();
        Ok(found)
    }

    fn exclusion(&self, id: &SessionId) -> Option<String> {
        let list = self.pipeline.config.subjects.as_ref().map_or(&[][..], |s| &s.exclude);
        list.iter()
            .find(|e| {
                fits(Some(&e.subject), id.subject.as_deref()) && fits(e.session.as_deref(), id.session.as_deref())
            })
            .map(|e| e.reason.clone())
    }

    fn look_at_overrides(&mut self, folders: &[Folder]) {
        for o in &self.pipeline.config.overrides {
            let used = folders.iter().any(|f| {
                fits(o.subject.as_deref(), f.id.subject.as_deref())
                    && fits(o.session.as_deref(), f.id.session.as_deref())
            });
            if !used {
                let whom: Vec<&str> = [&o.subject, &o.session].into_iter().flatten().map(String::as_str).collect();
                self.remarks.push(format!("the override for {} matches no subject or session", whom.join(" ")));
            }
        }
    }
}

fn chosen(patterns: &[String], name: Option<&str>) -> bool {
    patterns.is_empty() || patterns.iter().any(|p| fits(Some(p), name))
}

fn joined(relative: &Path) -> String {
    relative.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("-")
}

/// The folder of a participant, named by its identifier with or without `sub-`.
fn named_folder(root: &Path, id: &str) -> Option<PathBuf> {
    let bare = id.strip_prefix("sub-").unwrap_or(id);
    [id.to_owned(), bare.to_owned(), format!("sub-{bare}")].iter().map(|n| root.join(n)).find(|p| p.is_dir())
}

/// Folders of recordings and of results.
fn folders_of(pipeline: &PipelineFile, overrides: &Overrides) -> Result<(PathBuf, PathBuf), PipelineError> {
    let (file, dir, config) = (pipeline.name(), pipeline.folder(), &pipeline.config);
    let data = match (&overrides.data, &config.data) {
        (Some(d), _) => d.clone(),
        (None, Some(d)) => dir.join(d),
        (None, None) => {
            return Err(PipelineError::request_hint(
                format!("{file}: no folder of recordings"),
                "add `data: FOLDER` to the pipeline, or give --data FOLDER",
            ));
        }
    };
    if let Some(given) = overrides.data.as_ref().filter(|d| !d.is_dir()) {
        return Err(PipelineError::no_folder(&format!("--data {}", given.display())));
    }
    if !data.is_dir() {
        return Err(error_at_key(
            &file,
            &pipeline.text,
            "data",
            format!("{} is not a folder", data.display()),
            Some("give the folder that holds the recordings, relative to the pipeline file, or --data".to_owned()),
        ));
    }
    let workspace = match (&overrides.workspace, &config.workspace) {
        (Some(w), _) => w.clone(),
        (None, Some(w)) => dir.join(w),
        (None, None) => {
            let name = data.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
            if !stays_inside(&config.name) {
                return Err(error_at_key(
                    &file,
                    &pipeline.text,
                    "name",
                    format!(
                        "`{}` leads out of the folder `{WORKSPACES}`, where results are kept",
                        visible(&config.name)
                    ),
                    Some(
                        "give a name without `..` and without a leading `/`, or name the folder: `workspace: FOLDER`"
                            .to_owned(),
                    ),
                ));
            }
            let name = format!("{}-{}", config.name, name.unwrap_or_else(|| "data".to_owned()));
            default_workspace(&dir, &name)
        }
    };
    Ok((data, workspace))
}

/// Folder beside the pipeline file that holds the workspaces of pipelines that name none.
const WORKSPACES: &str = "workspaces";

/// True for a name that stays below the folder that it is joined to.
fn stays_inside(name: &str) -> bool {
    let plain = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
    // a backslash separates folders on some systems only
    Path::new(name).components().all(plain) && Path::new(&name.replace('\\', "/")).components().all(plain)
}

/// The workspace of a pipeline that names none: beside the pipeline file. Earlier versions put it
/// into the current folder, where it is still found.
fn default_workspace(dir: &Path, name: &str) -> PathBuf {
    let beside = dir.join(WORKSPACES).join(name);
    let earlier = Path::new(WORKSPACES).join(name);
    let is_workspace = |p: &Path| p.join(aloft_workspace::format::MARKER).is_file();
    if !is_workspace(&beside) && is_workspace(&earlier) { earlier } else { beside }
}

/// A note for a workspace that was found in the current folder and not beside the pipeline file.
fn in_the_earlier_place(workspace: &Path, dir: &Path, named: bool) -> Option<String> {
    let elsewhere = !named && workspace.starts_with(WORKSPACES) && !dir.as_os_str().is_empty();
    let same = || workspace.canonicalize().ok() == dir.join(workspace).canonicalize().ok();
    (elsewhere && !same()).then(|| {
        format!(
            "results are in {}, where earlier versions put them; new ones lie beside the pipeline file: move the folder to {}, or name it with \
             --workspace",
            workspace.display(),
            dir.join(workspace).display()
        )
    })
}

/// The error of a folder in which these patterns would find something and which cannot be listed:
/// what stands in it would be missing without a word. None for any other folder.
fn unlisted(base: &Path, error: walkdir::Error, patterns: &[String]) -> Option<PipelineError> {
    let path = error.path().unwrap_or(base).to_path_buf();
    // none: it is `base` itself
    let inside = path.strip_prefix(base).ok().filter(|p| !p.as_os_str().is_empty());
    let depth = inside.map_or(0, |p| p.components().count());
    let may_hold = |pattern: &String| {
        let parts: Vec<&str> = pattern.trim_end_matches('/').split('/').collect();
        // none: a part of a pattern that is none by itself, such as `{a`, may stand for anything
        let first = globset::Glob::new(&parts[..depth.min(parts.len())].join("/")).ok();
        depth < parts.len() && first.is_none_or(|g| inside.is_none_or(|p| g.compile_matcher().is_match(p)))
    };
    patterns.iter().any(may_hold).then(|| {
        let reason = error.into_io_error().unwrap_or_else(|| std::io::Error::other("a loop of links"));
        PipelineError::io("list", &path)(reason)
    })
}

/// Guesses the subject folders of a study that has no pipeline yet: those named in
/// `participants.tsv`, `sub-*`, or folders that each hold recordings of the same names. Returns
/// none if there are fewer than two.
pub fn guess_subjects(root: &Path) -> Result<Vec<PathBuf>, PipelineError> {
    let of_table: Vec<PathBuf> = participant_ids(root)?.iter().filter_map(|id| named_folder(root, id)).collect();
    if !of_table.is_empty() {
        return Ok(of_table);
    }
    let mut folders: Vec<PathBuf> = std::fs::read_dir(root)
        .map_err(PipelineError::io("list", root))?
        .map(|e| e.map(|e| e.path()))
        .collect::<Result<_, _>>()
        .map_err(PipelineError::io("list", root))?;
    folders.retain(|p| p.is_dir() && !p.join(aloft_workspace::format::MARKER).is_file());
    folders.sort();
    let named: Vec<PathBuf> = folders
        .iter()
        .filter(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with("sub-")))
        .cloned()
        .collect();
    if !named.is_empty() {
        return Ok(named);
    }
    let stems = |folder: &Path| -> Result<Vec<String>, PipelineError> {
        Ok(recordings_below(folder)?.iter().map(|p| trial_name(&folder.join(p)).to_lowercase()).collect())
    };
    let mut with = Vec::new();
    for folder in folders {
        let names = stems(&folder)?;
        if !names.is_empty() {
            with.push((folder, names));
        }
    }
    // folders into which one subject's recordings are sorted by kind share no names; folders of
    // several subjects do
    let shares =
        |i: usize| with.iter().enumerate().any(|(j, (_, other))| j != i && other.iter().any(|n| with[i].1.contains(n)));
    let alike: Vec<PathBuf> = (0..with.len()).filter(|i| shares(*i)).map(|i| with[i].0.clone()).collect();
    Ok(if alike.len() >= 2 { alike } else { Vec::new() })
}
