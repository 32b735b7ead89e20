//! `init`: inspects a folder of recordings and writes a commented pipeline file for it. Existing
//! files are not overwritten.

mod bodies;
mod choice;
mod facts;
mod look;
mod osim;
mod quiet;
mod robot;
mod roles;
mod subjects;
mod versions;

use self::facts::{StatedFacts, agreed, force_patterns};
use self::look::{Determination, look, name_pattern};
use crate::laboratories;
use aloft_study::catalog;
use aloft_study::data_set::guess_subjects;
use aloft_study::opencap;
use aloft_study::quote;
use aloft_study::recordings::{is_bids, recordings_below, trial_names};
use aloft_trial::Trial;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// How recordings are sorted into folders.
struct Layout {
    /// Subject folders, relative to the folder; empty for one subject.
    subjects: Vec<String>,
    /// Names of the session folders in them; empty if there are none.
    sessions: Vec<String>,
}

/// Largest movement of the median marker in frames that can stand in for a static trial, m.
const STANDS_M: f64 = 0.02;
/// What a user knows about the folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InitOptions {
    /// All recordings are of one subject, whatever names and folders say.
    pub one_subject: bool,
    /// Use only the files that name this subject (SUBJECTS:NAMES).
    pub subject: Option<String>,
}

/// Recordings that are not used, with the reason as a comment.
struct NotUsed {
    why: &'static str,
    names: Vec<String>,
}

/// A pipeline file that was written.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Written {
    /// Its path.
    pub path: PathBuf,
    /// What the user has to look at first, one sentence each.
    pub notes: Vec<String>,
}

/// Inspects the recordings and writes a pipeline file.
///
/// # Errors
/// A pipeline file that is there already; a folder without recordings, or with those of several
/// laboratories or subjects.
pub fn init(folder: &Path, out: Option<&Path>, options: &InitOptions) -> Result<Written, PipelineError> {
    let target = out.map_or_else(|| PathBuf::from("aloft.yaml"), Path::to_path_buf);
    if target.exists() {
        return Err(there_already(folder, &target));
    }
    if !folder.is_dir() {
        return Err(PipelineError::no_folder(&folder.display().to_string()));
    }
    if let Some((text, notes)) = robot::pipeline(folder, &target)? {
        return save(target, &text, notes);
    }
    let layout = match options.one_subject {
        true => Layout { subjects: Vec::new(), sessions: Vec::new() },
        false => layout(folder)?,
    };
    if let (Some(name), Some(first)) = (&options.subject, layout.subjects.first()) {
        let own = layout.subjects.iter().find(|s| *s == name).unwrap_or(first);
        return Err(PipelineError::request_hint(
            format!("--subject {name}: each subject in {} has a folder of its own", folder.display()),
            format!("for one of them: `aloft init {}`; for all: leave `--subject` out", quote::path(&folder.join(own))),
        ));
    }
    let files = recordings_below(folder)?;
    let (seen, broken) = look(folder, &layout.subjects, &files, options.subject.as_deref());
    if layout.subjects.is_empty() {
        look::one_person(folder, &broken, seen.len() + broken.len(), options.subject.as_deref())?;
    }
    if seen.is_empty() {
        return Err(PipelineError::request_hint(
            format!("{}: no recording could be read ({} files tried)", folder.display(), broken.len()),
            broken.first().map_or_else(|| "expected .c3d or .trc files".to_owned(), |b| b.failure.problem.clone()),
        ));
    }
    let unread = look::unread_words(&broken, seen.len() + broken.len());
    let (mut seen, versions) = versions::last(seen);
    let one = layout.subjects.is_empty();
    if one && !options.one_subject {
        versions::name_persons(&mut seen);
    }
    let (seen, others) = match one {
        true => subjects::chosen(folder, seen, options)?,
        false => (seen, Vec::new()),
    };
    let (mut seen, strays) = one_laboratory(folder, seen)?;
    if one {
        let paths: Vec<&Path> = seen.iter().map(|s| Path::new(s.relative.as_str())).collect();
        let names = trial_names(&paths);
        seen.iter_mut().zip(names).for_each(|(s, name)| s.stem = name);
    }
    if one && !options.one_subject {
        bodies::one_body(folder, &seen)?;
    }
    let not_used = [
        NotUsed { why: "raw or filtered versions of the same recordings; not used:", names: versions },
        NotUsed { why: "of other subjects; not used:", names: others },
        NotUsed {
            why: "other marker labels than the rest, so probably of another laboratory; not used:",
            names: strays,
        },
        NotUsed { why: "could not be read:", names: broken.into_iter().map(|b| b.failure.problem).collect() },
    ];
    let name = pipeline_name(folder, &target, options.subject.as_deref());
    let (text, notes) = write(folder, &target, &name, &layout, files.len(), &seen, &not_used)?;
    save(target, &text, unread.into_iter().chain(notes).collect())
}

fn save(target: PathBuf, text: &str, notes: Vec<String>) -> Result<Written, PipelineError> {
    if let Some(parent) = target.parent().filter(|p| !p.as_os_str().is_empty()) {
        aloft_workspace::disk::create_dir_all(parent)?;
    }
    aloft_workspace::theirs::write_new(&target, text.as_bytes())?;
    Ok(Written { path: target, notes })
}

/// Name of the pipeline, from which that of its workspace follows: two pipelines of one folder must
/// not share one. That of the file where `--out` names it, else those of folder and subject.
fn pipeline_name(folder: &Path, target: &Path, subject: Option<&str>) -> String {
    let stem = target.file_stem().map(|s| s.to_string_lossy().into_owned()).filter(|s| s != "aloft");
    let of_folder = || {
        let own = folder.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
        let own = own.unwrap_or_else(|| "study".to_owned());
        subject.map_or_else(|| own.clone(), |s| format!("{own}_{s}"))
    };
    let name = stem.unwrap_or_else(of_folder);
    name.replace(|c: char| !c.is_alphanumeric() && c != '-' && c != '_', "_")
}

/// What to do where a pipeline file is there: use it, or write another one.
fn there_already(folder: &Path, target: &Path) -> PipelineError {
    let stem = target.file_stem().map_or("aloft".into(), |s| s.to_string_lossy().into_owned());
    let ending = target.extension().map_or("yaml".into(), |e| e.to_string_lossy().into_owned());
    let free = (2..1000).map(|n| target.with_file_name(format!("{stem}-{n}.{ending}"))).find(|p| !p.exists());
    let fresh = free.map_or_else(|| "FILE".to_owned(), |p| quote::path(&p));
    PipelineError::request_hint(
        format!("{} is there already; nothing is overwritten", target.display()),
        format!(
            "to use it: `aloft run {}`; for a fresh one: `aloft init {} --out {fresh}`",
            quote::path(target),
            quote::path(folder)
        ),
    )
}

/// The recordings of one laboratory, and the names of those with other marker labels that lie among
/// them; an error if folders of several laboratories were given.
fn one_laboratory(folder: &Path, seen: Vec<Determination>) -> Result<(Vec<Determination>, Vec<String>), PipelineError> {
    let labels: Vec<BTreeSet<String>> =
        seen.iter().map(|s| s.trial.markers.labels.iter().map(|l| laboratories::bare(l)).collect()).collect();
    let group = laboratories::groups(&labels);
    let top = |s: &Determination| s.relative.split_once('/').map_or(String::new(), |(first, _)| first.to_owned());
    let mut of_folder: BTreeMap<String, BTreeSet<usize>> = BTreeMap::new();
    for (s, g) in seen.iter().zip(&group) {
        of_folder.entry(top(s)).or_default().insert(*g);
    }
    let apart: Vec<&String> =
        of_folder.iter().filter(|(name, of)| !name.is_empty() && !of.contains(&0)).map(|(name, _)| name).collect();
    if let Some(first) = apart.first() {
        let main: Vec<&String> = of_folder.iter().filter(|(_, of)| of.contains(&0)).map(|(name, _)| name).collect();
        let list = |names: &[&String]| {
            let names: Vec<String> =
                names.iter().map(|n| if n.is_empty() { ".".to_owned() } else { (*n).clone() }).collect();
            aloft_pipeline::recording::abridged(&names)
        };
        return Err(PipelineError::request_hint(
            format!(
                "{} holds recordings of several laboratories: the marker labels in {} have little in common with those in {}",
                folder.display(),
                list(&apart),
                list(&main)
            ),
            format!(
                "one pipeline is for one laboratory; begin with one folder: `aloft init {}`",
                quote::path(&folder.join(first))
            ),
        ));
    }
    let (own, other): (Vec<_>, Vec<_>) = seen.into_iter().zip(group).partition(|(_, g)| *g == 0);
    Ok((own.into_iter().map(|(s, _)| s).collect(), other.into_iter().map(|(s, _)| s.relative).collect()))
}

fn layout(folder: &Path) -> Result<Layout, PipelineError> {
    let name = |p: &PathBuf| p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let subjects = guess_subjects(folder)?;
    let mut sessions: Vec<String> = Vec::new();
    for subject in &subjects {
        let inside: Vec<String> = std::fs::read_dir(subject)
            .map_err(PipelineError::io("list", subject))?
            .map(|e| e.map(|e| e.path()))
            .collect::<Result<Vec<_>, _>>()
            .map_err(PipelineError::io("list", subject))?
            .iter()
            .filter(|p| p.is_dir())
            .map(name)
            .filter(|n| n.starts_with("ses-"))
            .collect();
        if inside.is_empty() {
            sessions.extend(guess_subjects(subject)?.iter().map(name));
        } else {
            sessions.extend(inside);
        }
    }
    sessions.sort();
    sessions.dedup();
    Ok(Layout { subjects: subjects.iter().map(name).collect(), sessions })
}

/// One pattern for names that differ only by a number at their end, or else the names themselves.
fn folder_patterns(names: &[String]) -> Vec<String> {
    let bare = |n: &String| n.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
    let mut patterns: Vec<String> = names.iter().map(bare).collect();
    patterns.sort();
    patterns.dedup();
    if patterns.len() == 1 && patterns.iter().all(|p| !p.is_empty()) && names.len() > 1 {
        patterns.iter().map(|p| format!("{}*", quote::pattern(p))).collect()
    } else {
        names.iter().map(|n| quote::pattern(n)).collect()
    }
}

/// Axis of the recording that points up.
fn up_axis(trial: &Trial) -> String {
    let up = trial.world_from_source.inverse() * Vector3::z();
    let (i, value) = up.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).unwrap_or((2, &1.0));
    format!("{}{}", if *value < 0.0 { "-" } else { "" }, ["X", "Y", "Z"].get(i).unwrap_or(&"Z"))
}

/// How many of the recordings have each value, as text.
fn shares(values: impl Iterator<Item = String>) -> String {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for v in values {
        *counts.entry(v).or_default() += 1;
    }
    match counts.len() {
        1 => counts.into_keys().collect(),
        _ => counts.iter().map(|(v, n)| format!("{v} ({n} recordings)")).collect::<Vec<_>>().join(", "),
    }
}

/// Recordings with one role: by name for one subject, by pattern for several.
fn list(names: &[&Determination], layout: &Layout) -> String {
    let mut quoted: Vec<String> = names
        .iter()
        .map(|s| {
            if layout.subjects.is_empty() {
                quote::yaml_quoted(&quote::pattern(&s.relative))
            } else {
                let ending = if is_bids(Path::new(&s.relative)) {
                    "_motion.tsv".to_owned()
                } else {
                    format!(".{}", s.relative.rsplit('.').next().unwrap_or("c3d"))
                };
                quote::yaml_quoted(&format!("{}{ending}", name_pattern(&s.stem)))
            }
        })
        .collect();
    quoted.sort();
    quoted.dedup();
    format!("[{}]", quoted.join(", "))
}

fn write(
    folder: &Path,
    target: &Path,
    name: &str,
    layout: &Layout,
    n_files: usize,
    seen: &[Determination],
    not_used: &[NotUsed],
) -> Result<(String, Vec<String>), PipelineError> {
    let mut notes = Vec::new();
    let choice::FittedSet { set, model, fit, unseen, markerless } = choice::choose(seen)?;
    let is_object = model == "two_link";
    let models = if layout.subjects.is_empty() && !is_object {
        osim::find(folder, seen)
    } else {
        osim::Found { best: None, refused: Vec::new() }
    };
    let own_model = models.best;
    let roles::Roles { statics, spare, calibration, identify, validate, apart_mm } =
        roles::roles(seen, is_object, !layout.subjects.is_empty());
    let rest: Vec<&Determination> = identify.iter().chain(&validate).copied().collect();
    if identify.is_empty() {
        let none = format!("{}: no recording to identify from among {}", folder.display(), seen.len());
        // what was left out may be the motion: a pipeline without it would only seem to be one
        if let Some(group) = not_used.iter().find(|g| !g.names.is_empty()) {
            let hint = format!("{} {}", group.why, aloft_pipeline::recording::abridged(&group.names));
            return Err(PipelineError::request_hint(none, hint));
        }
        notes.push(format!("{none}: `identify` is empty; name recordings of free flight or contact there"));
    }
    let plates = seen.iter().map(|s| s.trial.plates.len()).max().unwrap_or(0);
    let rates: BTreeSet<String> = seen.iter().map(|s| format!("{}", s.trial.markers.rate_hz)).collect();
    let data = data_path(folder, target);
    let has_facts =
        ["subject.yaml", "object.yaml", "participants.tsv"].iter().find(|f| input::is_there(&folder.join(f)));
    let own_facts = layout.subjects.iter().all(|s| input::is_there(&folder.join(s).join("subject.yaml")));
    let mut t = String::new();
    let mut line = |s: String| {
        let _ = writeln!(t, "{s}");
    };
    line("# Written by `aloft init`. Look through it, then:".to_owned());
    let path = quote::visible(&quote::path(target));
    line(format!("#   aloft check {path}\n#   aloft run {path}"));
    line(format!("name: {}", quote::yaml(name)));
    line(format!("data: {}", quote::yaml(&data)));
    line(format!(
        "# {n_files} recordings at {} Hz{}",
        rates.into_iter().collect::<Vec<_>>().join(", "),
        // forces in files of their own are not read here
        if plates > 0 { format!("; up to {plates} force plates") } else { String::new() },
    ));
    line(format!(
        "# lengths in {}; upward: {}",
        shares(seen.iter().map(|s| if s.unit.is_empty() {
            "no stated unit (read as mm)".to_owned()
        } else {
            quote::visible(&s.unit)
        })),
        shares(seen.iter().map(|s| up_axis(&s.trial)))
    ));
    if !layout.subjects.is_empty() {
        let names = quote::visible(&aloft_pipeline::recording::abridged(&layout.subjects));
        line(format!("# {} subjects: {names}", layout.subjects.len()));
        line("subjects:".to_owned());
        line(format!("  folders: {}", yaml_list(&folder_patterns(&layout.subjects))));
        if layout.sessions.is_empty() {
            line("  sessions: []          # each subject is one session".to_owned());
        } else {
            line(format!("  sessions: {}", yaml_list(&folder_patterns(&layout.sessions))));
        }
        line("  # exclude: [{subject: NAME, reason: withdrew}]".to_owned());
        line("# what differs for some subjects, sessions or trials:".to_owned());
        line("# overrides:\n#   - {subject: NAME, set: {filter: {cutoff_hz: 8.0}}}\n#   - {subject: NAME, trial: NAME, set: {import: {repair: true}}}".to_owned());
    }
    if let Some(m) = &own_model {
        line(format!(
            "model: {}   # {} of its {} markers are in the recordings; they fit to {:.1} mm (RMS){}",
            quote::yaml(&m.path),
            m.markers.0,
            m.markers.1,
            m.rms_mm,
            match m.others {
                0 => String::new(),
                1 => ", better than those of one other model here".to_owned(),
                n => format!(", better than those of {n} other models here"),
            }
        ));
        line(
            "# the file is taken as it is: its scaling, joints, markers, and inertias in place of tables. Without it:"
                .to_owned(),
        );
        line(format!("#   model: {model}\n#   marker_set: {set}      # fits {:.0} %", fit * 100.0));
    }
    for refused in &models.refused {
        line(format!("# not used: {}", quote::visible(refused)));
    }
    match &unseen {
        _ if own_model.is_some() => {}
        Some(parts) => line(format!(
            "model: {model}   # no markers on {parts}: these parts are not measured, so nothing is identified (see the book, Bodies)"
        )),
        None => line(format!("model: {model}")),
    }
    if let (true, None) = (markerless, &own_model) {
        line("# points that software estimates from videos: joint angles hold; masses and effects cannot be told (see the book, Without markers)".to_owned());
    }
    if own_model.is_some() {
        // the markers are the file's
    } else if fit > 0.5 {
        line(format!("marker_set: {set}      # fits {:.0} %", fit * 100.0));
    } else {
        let draft = format!("aloft markerset draft {} --out my_set.yaml", quote::path(folder));
        line(format!(
            "marker_set: {set}      # fits only {:.0} %: choose another ({}), map labels below, or let `{}` propose one",
            fit * 100.0,
            catalog::names("markersets").join(", "),
            quote::visible(&draft)
        ));
        notes.push(format!(
            "no marker set fits: `{set}` knows only {:.0} % of its markers here; `{draft}` proposes one from the recordings",
            fit * 100.0
        ));
    }
    if is_object {
        line("object: two_link_chain   # how markers define the link frames".to_owned());
    }
    let of_session = opencap::beside(folder).filter(|_| layout.subjects.is_empty() && has_facts.is_none());
    let stated = of_session.as_deref().map(opencap::read).transpose()?.filter(|s| s.mass_kg.is_some());
    match has_facts {
        _ if stated.is_some() => {
            let known = stated.as_ref().is_some_and(|s| s.sex.is_some());
            line(format!(
                "# {}height and mass come from {} of the session",
                if known { "sex, " } else { "" },
                opencap::METADATA
            ));
            if !known {
                line("subject:\n  sex:                  # F or M".to_owned());
            }
        }
        _ if !layout.subjects.is_empty() && own_facts => {
            line("# name, sex, height and mass come from each subject's subject.yaml".to_owned());
        }
        None if !layout.subjects.is_empty() => {
            line(format!(
                "# body masses are not known: put {} beside the subjects' folders,",
                quote::visible(&folder.join("participants.tsv").display().to_string())
            ));
            line("# with the columns (between tabs) participant_id, sex, height (m), mass (kg)".to_owned());
        }
        Some(file) => line(format!("# name, sex, height and mass come from {file} beside the recordings")),
        None if is_object => line("subject:\n  mass_kg:              # from a scale: fill in".to_owned()),
        None if own_model.is_some() => {
            let mass_kg = own_model.as_ref().map_or(f64::NAN, |m| m.mass_kg);
            line(format!(
                "subject:\n  # mass_kg:            # from a scale, kg; without it the {mass_kg:.1} kg of the model's bodies"
            ));
            line("  sex:                  # F or M, for the report".to_owned());
        }
        None => {
            let of = |value: fn(&StatedFacts) -> Option<f64>| agreed(seen.iter().filter_map(|s| value(&s.stated)));
            line("subject:\n  sex:                  # F or M".to_owned());
            line(match of(|s| s.height_m) {
                Some(height) => format!("  height_m: {height:.3}       # stature, m, as the files state it"),
                None => "  height_m:             # stature, m".to_owned(),
            });
            line(match of(|s| s.mass_kg) {
                Some(mass) => format!("  mass_kg: {mass:.2}        # kg, as the files state it: compare with a scale"),
                None => "  mass_kg:              # from a scale, kg: fill in".to_owned(),
            });
        }
    }
    line("trials:".to_owned());
    line(format!("  static: {}", list(&statics, layout)));
    if !spare.is_empty() {
        let names: Vec<String> = spare.iter().map(|s| quote::visible(&s.relative)).collect();
        let mut apart = apart_mm.iter().filter(|mm| mm.is_finite()).map(|mm| format!("{mm:.1}"));
        let best = apart.next().unwrap_or_default();
        let others: Vec<String> = apart.collect();
        line(format!("  # of several static trials one is used; not used: {}", names.join(", ")));
        if others.len() == spare.len() {
            line(format!(
                "  # distances between its markers differ from those in the motion by {best} mm (mean); of the others by {} mm",
                others.join(", ")
            ));
        }
    }
    line(format!("  calibration: {}", list(&calibration, layout)));
    line(format!("  identify: {}      # motion to identify from", list(&identify, layout)));
    line(format!("  validate: {}      # held out for comparison", list(&validate, layout)));
    if statics.is_empty()
        && own_model.is_none()
        && layout.subjects.is_empty()
        && let Some((still, quiet)) = quiet::quietest(&rest)
    {
        let (why, first, last) = if markerless {
            // lengths are alike in every frame, and the median of a moving body is no posture
            let middle = usize::midpoint(quiet.first, quiet.last);
            (
                "without markers no static trial is needed: the software's lengths are the same in every frame"
                    .to_owned(),
                middle,
                middle,
            )
        } else {
            let moved = format!("in these frames the markers move by {:.0} mm (median)", 1e3 * quiet.spread_m);
            let why = if quiet.spread_m < STANDS_M {
                format!("no static trial was found; {moved}")
            } else {
                let why = format!(
                    "no static trial was found, and no frames of quiet standing were found: {moved}; joint places may be off"
                );
                notes.push(format!("{why}; record a static trial"));
                why
            };
            (why, quiet.first, quiet.last)
        };
        line(format!(
            "  # {why}\n  static_frames: {{trial: {}, first: {}, last: {}}}",
            quote::yaml(&still.stem),
            first + 1,
            last + 1
        ));
    }
    if let Some(patterns) = force_patterns(folder, seen) {
        line(format!("  forces: {}      # ground reactions beside the markers", yaml_list(&patterns)));
    }
    for group in not_used.iter().filter(|g| !g.names.is_empty()) {
        line(format!("  # {}", group.why));
        for name in &group.names {
            line(format!("  #   {}", quote::visible(name)));
        }
    }
    line("import:".to_owned());
    line("  up_axis: auto         # x, y, z: the vertical of the recordings".to_owned());
    line("  fill_gaps_s: 0.1      # longest gap that is filled, s".to_owned());
    let several = seen.iter().find(|s| layout.subjects.is_empty() && !s.trial.people.is_empty());
    if let Some((person, people)) = several.and_then(|s| Some((s.trial.person.as_ref()?, s.trial.people.join(", ")))) {
        line(format!(
            "  person: {}   # the recordings hold markers of {}",
            quote::yaml(person),
            quote::visible(&people)
        ));
        notes.push(format!("the recordings hold markers of several people ({people}): those of {person} are used"));
    }
    let renamed = match own_model {
        Some(_) => Vec::new(),
        None => renamed_labels(&set, seen)?,
    };
    if renamed.is_empty() {
        line("  # aliases: {MyLabel: LASI}".to_owned());
    } else {
        let pairs: Vec<String> =
            renamed.iter().map(|(from, to)| format!("{}: {}", quote::yaml_quoted(from), quote::yaml(to))).collect();
        line(format!("  aliases: {{{}}}   # by the words of the labels: look through them", pairs.join(", ")));
        let shown: Vec<String> = renamed.iter().map(|(from, to)| format!("`{from}` as {to}")).collect();
        notes.push(format!("labels mapped by similar names (`import: aliases`): {}", shown.join(", ")));
    }
    line("filter: {order: 3, cutoff_hz: 10.0}   # per pass; two passes".to_owned());
    Ok((t, notes))
}

/// Labels of the recordings that name markers of the set in other words.
fn renamed_labels(set: &str, seen: &[Determination]) -> Result<Vec<(String, String)>, PipelineError> {
    let sets: Vec<aloft_trial::MarkerSet> = catalog::all("markersets")?;
    let trials: Vec<&Trial> = seen.iter().map(|s| &s.trial).collect();
    Ok(sets.iter().find(|s| s.name == set).map(|s| crate::markerset::renamed(&sets, s, &trials)).unwrap_or_default())
}

fn yaml_list(names: &[String]) -> String {
    format!("[{}]", names.iter().map(|n| quote::yaml_quoted(n)).collect::<Vec<_>>().join(", "))
}

/// The data folder as written in the pipeline file: relative if that is a plain path, absolute
/// otherwise.
fn data_path(folder: &Path, target: &Path) -> String {
    let absolute = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let base =
        target.parent().filter(|p| !p.as_os_str().is_empty()).map_or_else(|| PathBuf::from("."), Path::to_path_buf);
    let base = base.canonicalize().unwrap_or(base);
    match absolute.strip_prefix(&base) {
        Ok(relative) if relative.as_os_str().is_empty() => ".".to_owned(),
        Ok(relative) => relative.to_string_lossy().into_owned(),
        // none: a folder elsewhere has its whole path
        Err(_) => absolute.to_string_lossy().into_owned(),
    }
}
