//! `workflow`: the stage graph as a Snakefile. Each stage of each trial is one job on a shared
//! folder of results; factors are merged in a tree. The same file runs on the cores of one machine
//! and, through Snakemake's executors, on a cluster.
//!
//! The Snakefile is the same for every study. All names given by the user are in a JSON file next
//! to it (`Snakefile.json`), which is read as data, so names of recordings, subjects and folders
//! may contain any character. The mark files of finished jobs are named like exported files
//! ([`aloft_export::names::file`]), which keeps their names unique.
//!
//! Snakemake decides by file times which jobs to start; each job decides by content what there is
//! to do, and ends at once if its result is up to date. A trial that cannot be used is recorded as
//! such: its jobs end successfully and the study goes on without it; the last job of the workflow
//! names the trial and fails. A job that was killed leaves no mark and runs again at the next call.

use aloft_export::names;
use aloft_pipeline::graph::{self, DATED, Need, Scope, Stage, TaskState};
use aloft_pipeline::manifests::Manifests;
use aloft_pipeline::merge;
use aloft_pipeline::stages::STAGES;
use aloft_study::quote;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::format::{MARKER, marker_text};
use aloft_workspace::input;
use aloft_workspace::json::write_json_whole;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::theirs::{refuse_foreign, write_own};
use aloft_workspace::workspace::Workspace;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// One subject's session in a workflow.
#[derive(Debug)]
pub struct Member<'a> {
    /// Its recordings.
    pub session: &'a SubjectSession,
}

impl Member<'_> {
    /// Name in paths: `sub-01~ses-1`, or the study's name if there is only one. The parts contain
    /// no `~`.
    fn key(&self) -> String {
        let id = &self.session.id;
        let parts: Vec<String> = [&id.subject, &id.session].into_iter().flatten().map(|n| names::file(n)).collect();
        if parts.is_empty() { names::file(&self.session.config.name) } else { parts.join("~") }
    }

    /// Command-line arguments that select it.
    fn describe(&self) -> Vec<String> {
        let id = &self.session.id;
        [("subject", &id.subject), ("session", &id.session)]
            .into_iter()
            .flat_map(|(flag, name)| name.iter().flat_map(move |n| quote::option(flag, &quote::pattern(n))))
            .collect()
    }
}

/// How jobs call the program.
#[derive(Debug)]
pub struct Call {
    /// The pipeline file as the user gave it.
    pub pipeline: PathBuf,
    /// `--data` and `--workspace` as the user gave them.
    pub words: Vec<String>,
    /// `--subject` and `--session` as the user gave them: the final verdict covers these.
    pub chosen: Vec<String>,
    /// Folder of results of the whole study.
    pub workspace: PathBuf,
}

/// Roles that a stage runs for; none for a stage of the whole study.
fn roles(stage: &Stage) -> Option<&'static [Role]> {
    match stage.scope {
        Scope::Trial(roles) => Some(roles),
        Scope::Session => None,
    }
}

/// Job group of a stage: the first of the consecutive per-trial stages that come last before a
/// study-wide one. A group goes to the cluster as one job per trial.
fn group(stage: &Stage) -> Option<String> {
    roles(stage)?;
    let at = STAGES.iter().position(|s| s.name == stage.name)?;
    let first = STAGES[..=at].iter().rposition(|s| roles(s).is_none()).map_or(0, |i| i + 1);
    STAGES.get(first).map(|s| format!("from_{}", s.name))
}

/// Short hash of what a stage's jobs depend on besides files: its version and its parameters.
fn settings_hash(stage: &Stage, session: &SubjectSession) -> String {
    let parameters: Vec<Value> = stage.tasks(session).into_iter().map(|t| (stage.parameters)(session, t)).collect();
    let text = json!([stage.version, parameters]).to_string();
    blake3::hash(text.as_bytes()).to_hex()[..12].to_owned()
}

/// Results that no other stage reads, `stage/trial`: if these exist, all others do, too.
fn ends(session: &SubjectSession) -> Vec<String> {
    let name_of = |trial: Option<&TrialEntry>| trial.map(|t| t.name.clone());
    let read: HashSet<(&str, Option<String>)> = STAGES
        .iter()
        .flat_map(|by| by.tasks(session).into_iter().map(move |t| (by, t)))
        .flat_map(|(by, t)| by.needs.iter().flat_map(move |need| need.results(t, session)))
        .map(|(name, of)| (name, name_of(of)))
        .collect();
    let all = STAGES.iter().flat_map(|s| s.tasks(session).into_iter().map(|t| (s.name, t)));
    all.filter(|(name, t)| !read.contains(&(*name, name_of(*t))))
        .map(|(name, t)| format!("{name}/{}", t.map_or(WHOLE_STUDY.to_owned(), |t| names::file(&t.name))))
        .collect()
}

fn plan(member: &Member<'_>) -> Value {
    let session = member.session;
    let trials: serde_json::Map<String, Value> = session
        .included()
        .map(|t| {
            let files: Vec<String> =
                std::iter::once(&t.file).chain(&t.forces).chain(&t.beside).map(|p| p.display().to_string()).collect();
            let choice = quote::option("trial", &quote::pattern(&t.name));
            (names::file(&t.name), json!({"role": t.role.word(), "files": files, "choice": choice}))
        })
        .collect();
    let hashes: serde_json::Map<String, Value> =
        STAGES.iter().map(|s| (s.name.to_owned(), json!(settings_hash(s, session)))).collect();
    let tree = merge::Tree::of(session);
    json!({
        "words": member.describe(),
        "trials": trials,
        "merged": tree.trials().iter().map(|t| names::file(t)).collect::<Vec<_>>(),
        "static_frames": session.config.trials.static_frames.as_ref().map(|f| names::file(&f.trial)),
        "seen": hashes,
        "merge": tree.levels(),
        "ends": ends(session),
    })
}

/// A string as a Python literal: JSON strings are Python strings.
fn python(text: &str) -> String {
    Value::String(text.to_owned()).to_string()
}

fn description_of_roles(roles: &[Role]) -> String {
    let all: Vec<String> = roles.iter().map(|r| python(r.word())).collect();
    format!("[{}]", all.join(", "))
}

/// True if a stage needs another one for the same trials, whose results are made from these: a rule
/// need not list both.
fn implied(stage: &Stage, name: &str, roles: &[Role]) -> bool {
    stage.needs.iter().any(|other| match other {
        Need::Every(by, of) => {
            roles.iter().all(|r| of.contains(r))
                && STAGES
                    .iter()
                    .any(|s| s.name == *by && s.needs.iter().any(|n| matches!(n, Need::Same(n) if *n == name)))
        }
        _ => false,
    })
}

/// Inputs of a stage's rule, one per line.
fn inputs(stage: &Stage) -> Vec<String> {
    let mut out = Vec::new();
    for need in stage.needs {
        match need {
            Need::Recording => out.push("recordings".to_owned()),
            Need::Same(name) => out.push(format!("MARKS + \"/{{study}}/{name}/{{trial}}.done\"")),
            Need::Once(name) => out.push(format!("MARKS + \"/{{study}}/{name}/_study.done\"")),
            // the inputs of the root of the merge tree need not be listed one by one
            Need::Merged(..) => {
                if !out.iter().any(|o| o == "root_of_merges") {
                    out.push("root_of_merges".to_owned());
                }
            }
            Need::Every(name, roles) if implied(stage, name, roles) => {}
            Need::Every(name, roles) => {
                out.push(format!("every({}, {})", python(name), description_of_roles(roles)));
            }
            // one mark stands for all recordings, or the graph would grow with the square of their
            // number
            Need::Times => out.push("MARKS + \"/{study}/times.done\"".to_owned()),
            Need::EveryOrStaticFrames(name, roles) => {
                out.push(format!("every({}, {}, with_static=True)", python(name), description_of_roles(roles)));
            }
        }
    }
    out
}

fn rule(stage: &Stage) -> String {
    let mut out = String::new();
    let whole = roles(stage).is_none();
    let trial = if whole { "_study" } else { "{trial}" };
    let choice = if whole { "" } else { " {params.choice:q}" };
    let _ = writeln!(out, "rule {}:", stage.name);
    let _ = writeln!(out, "    input:");
    for input in inputs(stage) {
        let _ = writeln!(out, "        {input},");
    }
    let _ = writeln!(out, "    output:\n        touch(MARKS + \"/{{study}}/{}/{trial}.done\"),", stage.name);
    let _ = writeln!(out, "    log:\n        MARKS + \"/{{study}}/{}/{trial}.log\",", stage.name);
    let _ = writeln!(out, "    params:");
    let _ = writeln!(out, "        words=lambda w: STUDIES[w.study][\"words\"],");
    if !whole {
        let _ = writeln!(out, "        choice=lambda w: STUDIES[w.study][\"trials\"][w.trial][\"choice\"],");
    }
    if stage.needs.contains(&Need::Recording) {
        let _ = writeln!(out, "        stamps=stamps,");
    }
    let _ = writeln!(out, "        seen=lambda w: STUDIES[w.study][\"seen\"][{}],", python(stage.name));
    if let Some(group) = group(stage) {
        let _ = writeln!(out, "    group:\n        {}", python(&group));
    }
    let threads = if whole { "THREADS" } else { "1" };
    let _ = writeln!(out, "    threads: {threads}");
    let _ = writeln!(
        out,
        "    shell:\n        \"{{ALOFT}} run {{PIPELINE:q}} {{FOLDERS:q}} {{params.words:q}} --only {}{choice} --shared -j {{threads}} > {{log:q}} 2>&1 || test $? -eq 1\"\n",
        stage.name
    );
    out
}

/// Mark file of the verdict: one for each selection of subjects, so that Snakefiles for different
/// selections can share a folder of results.
fn verdict_name(chosen: &[String]) -> String {
    if chosen.is_empty() {
        return "verdict".to_owned();
    }
    let hash = blake3::hash(json!(chosen).to_string().as_bytes()).to_hex();
    format!("verdict_{}", &hash[..8])
}

/// Data that the Snakefile reads: everything that has a name.
pub fn plan_of(members: &[Member<'_>], call: &Call) -> Result<Value, PipelineError> {
    let text = input::text(&call.pipeline)?;
    let workspace = call.workspace.display().to_string();
    if workspace.contains(|c: char| "{}<>".contains(c) || c.is_control()) {
        return Err(PipelineError::request_hint(
            format!(
                "{}: Snakemake reads braces, angle brackets and line breaks in a folder of results as its own",
                quote::visible(&workspace)
            ),
            "give --workspace a folder without them",
        ));
    }
    let studies: serde_json::Map<String, Value> = members.iter().map(|m| (m.key(), plan(m))).collect();
    Ok(json!({
        "written_by": WRITTEN_BY,
        "pipeline": quote::argument(&call.pipeline),
        "pipeline_text": text,
        "folders": call.words,
        "chosen": call.chosen,
        "verdict": verdict_name(&call.chosen),
        "workspace": workspace,
        "read_merged": merge::readers(),
        "studies": studies,
    }))
}

/// First words of the files written here, also stored in the plan.
const WRITTEN_BY: &str = "Written by `aloft workflow";

/// The Snakefile, the same for every study.
pub fn snakefile() -> String {
    let mut out = String::new();
    let _ = write!(
        out,
        r#"# {WRITTEN_BY}`, with the file of the same name and the ending `.json` beside it, which holds the study: names are data. Keep both together, and
# write them again when recordings come or go, or when the pipeline changes.
#
#   snakemake -s Snakefile --cores 8 --keep-going               on the cores of this machine
#   snakemake -s Snakefile --jobs 100 --keep-going --executor slurm --default-resources mem_mb=1000 runtime=10
#
# Each stage of each trial is a job on the shared folder of results; stages of one trial travel to a cluster together (groups). A trial that
# cannot be used is recorded and left out; the last job, `verdict`, names it and fails. Killed jobs run again with the next call.
import json
from pathlib import Path

from snakemake.exceptions import WorkflowError

PLAN = json.loads(Path(workflow.snakefile + ".json").read_text(encoding="utf-8"))
ALOFT = config.get("aloft", "aloft")  # --config aloft=/path/to/aloft
THREADS = int(config.get("threads", 2))  # of jobs for a whole study
PIPELINE = PLAN["pipeline"]
FOLDERS = PLAN["folders"]
CHOSEN = PLAN["chosen"]  # subjects and sessions of this file, all where empty
STUDIES = PLAN["studies"]
WORKSPACE = Path(PLAN["workspace"])
MARKS = (WORKSPACE / ".workflow").as_posix()

if Path(PIPELINE).read_bytes() != PLAN["pipeline_text"].encode("utf-8"):
    raise WorkflowError("the pipeline changed: write this file again with `aloft workflow`")

# a new folder of results says what it is before Snakemake puts marks into it
WORKSPACE.mkdir(parents=True, exist_ok=True)
if not any(WORKSPACE.iterdir()):
    (WORKSPACE / {marker}).write_text({marker_text})


def plain(path):
    """Names that Snakemake takes as they are; braces or angle brackets it would read as its own."""
    return path == path.strip() and all(c.isalnum() or c in "_-./ " for c in path)


def recordings(w):
    """Files of a trial whose changes Snakemake sees by their times."""
    return [f for f in STUDIES[w.study]["trials"][w.trial]["files"] if plain(f)]


def stamps(w):
    """Size and time of files that cannot be named as inputs: a job runs again when these change."""
    odd = [Path(f) for f in STUDIES[w.study]["trials"][w.trial]["files"] if not plain(f)]
    return [f"{{f.stat().st_size}} {{f.stat().st_mtime_ns}}" for f in odd if f.exists()]


def every_end(w):
    """Marks of all results that no other stage reads."""
    return [f"{{MARKS}}/{{key}}/{{end}}.done" for key, study in STUDIES.items() for end in study["ends"]]


def every(stage, roles, with_static=False):
    """Marks of a stage for all trials that play one of the roles, and for the one whose frames are the static posture."""

    def of(w):
        study = STUDIES[w.study]
        static = study["static_frames"] if with_static else None
        names = [n for n, t in study["trials"].items() if t["role"] in roles or n == static]
        return [f"{{MARKS}}/{{w.study}}/{{stage}}/{{n}}.done" for n in names]

    return of


def merge_node(w):
    """What a node of the tree merges: trials at the first level, nodes of the level below above it."""
    study, level, index = STUDIES[w.study], int(w.level), int(w.index)
    first, last = index * {fan_in}, (index + 1) * {fan_in}
    if level > 1:
        below = study["merge"][level - 2]
        return [f"{{MARKS}}/{{w.study}}/merge/{{level - 1}}-{{i}}.done" for i in range(first, min(last, below))]
    return [f"{{MARKS}}/{{w.study}}/{{s}}/{{n}}.done" for n in study["merged"][first:last] for s in {leaves}]


def root_of_merges(w):
    """The top of the tree."""
    levels = len(STUDIES[w.study]["merge"])
    return [f"{{MARKS}}/{{w.study}}/merge/{{levels}}-0.done"] if levels else []


wildcard_constraints:
    study="[^/]+",
    trial="[^/]+",
    level="[0-9]+",
    index="[0-9]+",


localrules:
    verdict,
    times,


rule verdict:
    input:
        every_end,
    output:
        touch(MARKS + "/" + PLAN["verdict"] + ".done"),
    shell:
        "{{ALOFT}} workflow {{PIPELINE:q}} {{FOLDERS:q}} {{CHOSEN:q}} --verdict"


"#,
        marker = python(MARKER),
        marker_text = python(&marker_text()),
        fan_in = merge::FAN_IN,
        leaves = json!(merge::leaves()),
    );
    for stage in STAGES {
        out.push_str(&rule(stage));
        out.push('\n');
    }
    out.push_str(&times_rule());
    out.push_str(MERGE_RULE);
    out.push('\n');
    out.trim_end().to_owned() + "\n"
}

/// The rule that waits for all imports, which tell when in the session each recording was made.
fn times_rule() -> String {
    let of = STAGES.iter().find(|s| s.name == DATED).and_then(|s| roles(s)).unwrap_or_default();
    format!(
        "rule times:\n    input:\n        every({}, {}),\n    output:\n        touch(MARKS + \"/{{study}}/times.done\"),\n    shell:\n        \"true\"\n\n\n",
        python(DATED),
        description_of_roles(of)
    )
}

const MERGE_RULE: &str = r#"rule merge:
    input:
        merge_node,
    output:
        touch(MARKS + "/{study}/merge/{level}-{index}.done"),
    log:
        MARKS + "/{study}/merge/{level}-{index}.log",
    params:
        words=lambda w: STUDIES[w.study]["words"],
        seen=lambda w: [STUDIES[w.study]["seen"][s] for s in PLAN["read_merged"]],
    threads: 1
    shell:
        "{ALOFT} merge {PIPELINE:q} {FOLDERS:q} {params.words:q} --node {wildcards.level}-{wildcards.index} > {log:q} 2>&1 || test $? -eq 1"

"#;

/// Path of the JSON file that belongs to a Snakefile.
pub fn plan_path(snakefile: &Path) -> PathBuf {
    let mut name = snakefile.as_os_str().to_owned();
    name.push(".json");
    PathBuf::from(name)
}

/// Writes the Snakefile and its JSON file; other files in their place are not overwritten.
pub fn write(members: &[Member<'_>], call: &Call, out: &Path) -> Result<(), PipelineError> {
    let plan = plan_of(members, call)?;
    let beside = plan_path(out);
    let ours = |old: &[u8]| {
        let text = String::from_utf8_lossy(old);
        // none: a file that is no JSON of ours is not replaced
        let json = || serde_json::from_str::<Value>(&text).is_ok_and(|v| v["written_by"] == WRITTEN_BY);
        text.starts_with(&format!("# {WRITTEN_BY}")) || json()
    };
    for path in [out, beside.as_path()] {
        refuse_foreign(path, "workflow", ours)?;
    }
    write_json_whole(&beside, &plan)?;
    write_own(out, snakefile().as_bytes(), "workflow", ours)
}

/// A result that is missing from a finished workflow.
#[derive(Debug, Clone, PartialEq)]
pub struct Lacking {
    /// Stage.
    pub stage: &'static str,
    /// Trial, or [`WHOLE_STUDY`].
    pub trial: String,
    /// Reason, with a hint if there is one.
    pub failure: StageFailure,
    /// False if it was only blocked by another failure.
    pub first: bool,
}

/// Every result of a study that is missing or not up to date, those that failed by themselves
/// first.
pub fn verdict(session: &SubjectSession) -> Result<Vec<Lacking>, PipelineError> {
    let workspace = Workspace::open(&session.workspace);
    let manifests = Manifests::read_and_examine(session, &workspace, STAGES)?;
    let mut out = Vec::new();
    for stage in STAGES {
        for trial in stage.tasks(session) {
            let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
            let inputs = graph::inputs(stage, trial, session, &workspace, &manifests)?;
            let (failure, first) =
                match graph::task_state(stage, trial, session, &inputs, manifests.get(stage.name, name)) {
                    TaskState::Ok | TaskState::Warning => continue,
                    TaskState::Failed(failure) => (failure, true),
                    TaskState::Missing => (StageFailure::new("has not run"), true),
                    TaskState::Stale(changes) => (StageFailure::new(format!("is stale: {}", changes.join("; "))), true),
                    TaskState::Damaged(problems) => {
                        (StageFailure::new(format!("is damaged: {}", problems.join("; "))), true)
                    }
                    TaskState::Blocked(reason) => (StageFailure::new(reason), false),
                };
            out.push(Lacking { stage: stage.name, trial: name.to_owned(), failure, first });
        }
    }
    out.sort_by_key(|l| !l.first);
    Ok(out)
}
