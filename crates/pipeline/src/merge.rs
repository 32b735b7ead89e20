//! Merges flight factors in a tree that depends only on the study's list of trials: eight trials
//! form a node of the first level, eight nodes one of the next. A failed trial leaves its place
//! empty. The result is therefore the same to the last bit whether one process merges everything or
//! many machines merge one node each (`aloft workflow`), and existing nodes can be reused.
//!
//! Contact stretches are not in the tree: identification weights them against the flights first.

use crate::factors::{load_factors, save_factors};
use crate::graph::Need;
use crate::graph::StageInputs;
use crate::manifests::Manifests;
use crate::stages::STAGES;
use aloft_regressor::{Factor, RowKind, Stretch, StretchKind};
use aloft_study::subject_session::{Role, SubjectSession};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::manifest::{Manifest, Outcome, WHOLE_STUDY};
use aloft_workspace::workspace::Workspace;
use serde_json::json;
use std::collections::BTreeMap;
use std::time::Instant;

/// Number of children of a node.
pub const FAN_IN: usize = 8;

/// Folder of the nodes in a workspace.
const FOLDER: &str = "merge";

/// Stages whose factors are the leaves: those that some stage reads merged.
pub fn leaves() -> Vec<&'static str> {
    let merged = STAGES.iter().flat_map(|s| s.needs).filter_map(|n| match n {
        Need::Merged(name, _) => Some(*name),
        _ => None,
    });
    let mut out: Vec<&str> = Vec::new();
    merged.for_each(|name| {
        if !out.contains(&name) {
            out.push(name)
        }
    });
    out
}

/// Stages that read merged factors.
pub fn readers() -> Vec<&'static str> {
    let merged = |n: &Need| matches!(n, Need::Merged(..));
    STAGES.iter().filter(|s| s.needs.iter().any(merged)).map(|s| s.name).collect()
}

/// Version of the stored nodes; to be raised when their contents change.
const VERSION: u32 = 2;

/// The tree over a study's identification trials.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tree {
    trials: Vec<String>,
}

/// Position of a node: level counted from 1 at the trials upwards, index from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Node {
    /// Level.
    pub level: usize,
    /// Index in its level.
    pub index: usize,
}

impl std::fmt::Display for Node {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}-{}", self.level, self.index)
    }
}

impl std::str::FromStr for Node {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not a node; expected LEVEL-INDEX, for example 1-0");
        let (level, index) = text.split_once('-').ok_or_else(wrong)?;
        let node = Self { level: level.parse().map_err(|_| wrong())?, index: index.parse().map_err(|_| wrong())? };
        if node.level == 0 { Err(wrong()) } else { Ok(node) }
    }
}

impl Tree {
    /// The tree of a study: its identification trials in the order of their names.
    pub fn of(session: &SubjectSession) -> Self {
        Self { trials: session.included().filter(|t| t.role == Role::Identify).map(|t| t.name.clone()).collect() }
    }

    /// The tree of the trials that a stage expects.
    fn expected(trials: &[(String, Role)]) -> Self {
        Self {
            trials: trials.iter().filter(|(_, role)| *role == Role::Identify).map(|(name, _)| name.clone()).collect(),
        }
    }

    /// Number of nodes in each level, first level first; the last level has one node. Empty without
    /// trials.
    pub fn levels(&self) -> Vec<usize> {
        let mut out = Vec::new();
        let mut below = self.trials.len();
        while below > 1 || (below == 1 && out.is_empty()) {
            below = below.div_ceil(FAN_IN);
            out.push(below);
        }
        out
    }

    /// The trials, in the order of the leaves.
    pub fn trials(&self) -> &[String] {
        &self.trials
    }

    fn root(&self) -> Option<Node> {
        let level = self.levels().len();
        (level > 0).then_some(Node { level, index: 0 })
    }

    fn trials_of(&self, node: Node) -> &[String] {
        let first = (node.index * FAN_IN).min(self.trials.len());
        &self.trials[first..(first + FAN_IN).min(self.trials.len())]
    }

    fn nodes_below(&self, node: Node) -> Vec<Node> {
        let below = self.levels().get(node.level.saturating_sub(2)).copied().unwrap_or(0);
        let first = node.index * FAN_IN;
        (first..(first + FAN_IN).min(below)).map(|index| Node { level: node.level - 1, index }).collect()
    }

    /// Merges one factor per trial (none for a trial without one) up to the root.
    fn merge(
        &self,
        leaf: impl Fn(&str) -> Result<Option<Factor>, StageFailure>,
    ) -> Result<Option<Factor>, StageFailure> {
        let mut level: Vec<Option<Factor>> = self.trials.iter().map(|t| leaf(t)).collect::<Result<_, _>>()?;
        for _ in self.levels() {
            level = level.chunks(FAN_IN).map(merged).collect::<Result<_, _>>()?;
        }
        Ok(level.into_iter().next().flatten())
    }
}

fn merged(children: &[Option<Factor>]) -> Result<Option<Factor>, StageFailure> {
    let present: Vec<&Factor> = children.iter().flatten().collect();
    match present.as_slice() {
        [] => Ok(None),
        all => Factor::merge_refs(all).map(Some).map_err(|e| StageFailure::new(e.to_string())),
    }
}

/// Merged flights of one kind of rows among a trial's factors; none without such flights.
fn leaf(factors: &[(Stretch, Factor)], trial: &str, rows: RowKind) -> Result<Option<Factor>, StageFailure> {
    let flights: Vec<Option<Factor>> = factors
        .iter()
        .filter(|(s, f)| s.trial == trial && s.kind == StretchKind::Flight && f.rows == rows)
        .map(|(_, f)| Some(f.clone()))
        .collect();
    merged(&flights)
}

const KINDS: [RowKind; 2] = [RowKind::Weak, RowKind::Acceleration];

/// All flights of the study's identification trials merged into one factor: the root of the tree.
/// It is read from its stored node if that is up to date, and merged from `factors` (those of the
/// trials, in any order of kinds) otherwise. The result is the same.
pub fn root(
    inputs: &StageInputs<'_>,
    factors: &[(Stretch, Factor)],
    rows: RowKind,
) -> Result<Option<Factor>, StageFailure> {
    let tree = Tree::expected(&inputs.expected());
    let workspace = inputs.results.workspace();
    let stored = tree.root().filter(|n| workspace.place(FOLDER, &n.to_string()).is_dir());
    if let Some(node) = stored {
        let names = tree.trials.iter().map(String::as_str).chain([WHOLE_STUDY]);
        let results: Vec<(&str, &str)> = names.flat_map(|t| STAGES.iter().map(move |s| (s.name, t))).collect();
        let manifests = Manifests::of(workspace, &results)?;
        if let Some(manifest) = current(&tree, node, workspace, &manifests)? {
            let stored = load_factors(&workspace.place(FOLDER, &manifest.trial))?;
            return Ok(stored.into_iter().map(|(_, f)| f).find(|f| f.rows == rows));
        }
    }
    tree.merge(|trial| leaf(factors, trial, rows))
}

/// Results with factors below a node of the first level, in the order of the trials.
fn leaves_of(tree: &Tree, node: Node) -> Vec<(&'static str, &str)> {
    let stages = leaves();
    tree.trials_of(node).iter().flat_map(|t| stages.iter().map(move |s| (*s, t.as_str()))).collect()
}

/// Present inputs of a node; none if one of them has not been made.
fn inputs(
    tree: &Tree,
    node: Node,
    workspace: &Workspace,
    manifests: &Manifests,
) -> Result<Option<BTreeMap<String, String>>, PipelineError> {
    if node.level == 1 {
        let made = leaves_of(tree, node).into_iter().filter_map(|(stage, trial)| {
            let sound = manifests.trouble(stage, trial).is_none();
            let m = manifests.get(stage, trial).filter(|_| sound)?;
            Some((format!("{stage}/{trial}"), m.output.clone()))
        });
        return Ok(Some(made.collect()));
    }
    tree.nodes_below(node)
        .into_iter()
        .map(|n| Ok(current(tree, n, workspace, manifests)?.map(|m| (format!("{FOLDER}/{n}"), m.output))))
        .collect()
}

fn current(
    tree: &Tree,
    node: Node,
    workspace: &Workspace,
    manifests: &Manifests,
) -> Result<Option<Manifest>, PipelineError> {
    let name = node.to_string();
    let whole = workspace.damage(FOLDER, &name)?.is_empty();
    let Some(manifest) = workspace.usable(FOLDER, &name)?.filter(|_| whole) else { return Ok(None) };
    let now = inputs(tree, node, workspace, manifests)?;
    Ok(now.is_some_and(|now| manifest.differences(VERSION, &json!({}), &now).is_empty()).then_some(manifest))
}

/// Makes one node; true if there was something to do.
pub fn make(session: &SubjectSession, node: Node) -> Result<bool, PipelineError> {
    let tree = Tree::of(session);
    let levels = tree.levels();
    if levels.get(node.level - 1).is_none_or(|n| node.index >= *n) {
        return Err(PipelineError::request_hint(
            format!("the tree has no node {node}"),
            format!("nodes a level: {levels:?}, from 1-0 to {}-0", levels.len()),
        ));
    }
    let workspace = Workspace::open(&session.workspace);
    let _lock = workspace.lock_shared()?;
    let manifests = Manifests::read(session, &workspace, STAGES)?;
    if current(&tree, node, &workspace, &manifests)?.is_some() {
        return Ok(false);
    }
    let Some(made_from) = inputs(&tree, node, &workspace, &manifests)? else {
        return Err(PipelineError::request_hint(
            format!("what node {node} merges has not been made"),
            "make the nodes of the level below first",
        ));
    };
    let _task = workspace.lock_task(FOLDER, &node.to_string())?;
    let started = Instant::now();
    let mut out: Vec<(Stretch, Factor)> = Vec::new();
    let fail = |f: StageFailure| PipelineError::Request { problem: f.problem, hint: f.hint };
    for key in made_from.keys() {
        if let Some((folder, name)) = key.split_once('/')
            && let Some(problem) = workspace.damage(folder, name)?.into_iter().next()
        {
            return Err(PipelineError::Damaged { path: workspace.place(folder, name), problem });
        }
    }
    let mut below: Vec<Vec<(Stretch, Factor)>> = Vec::new();
    // in the order of the tree, which is not the order of the names
    let parts: Vec<String> = match node.level {
        1 => leaves_of(&tree, node).into_iter().map(|(stage, trial)| format!("{stage}/{trial}")).collect(),
        _ => tree.nodes_below(node).iter().map(|n| format!("{FOLDER}/{n}")).collect(),
    };
    for key in parts.iter().filter(|k| made_from.contains_key(*k)) {
        if let Some((folder, name)) = key.split_once('/') {
            below.push(load_factors(&workspace.place(folder, name))?);
        }
    }
    for rows in KINDS {
        let children: Vec<Option<Factor>> = if node.level == 1 {
            let all: Vec<(Stretch, Factor)> = below.iter().flatten().cloned().collect();
            tree.trials_of(node).iter().map(|t| leaf(&all, t, rows)).collect::<Result<_, _>>().map_err(fail)?
        } else {
            below.iter().map(|b| b.iter().map(|(_, f)| f).find(|f| f.rows == rows).cloned()).collect()
        };
        if let Some(factor) = merged(&children).map_err(fail)? {
            out.push((factor.as_stretch(), factor));
        }
    }
    let name = node.to_string();
    let scratch = workspace.scratch(FOLDER, &name)?;
    save_factors(&scratch, &out)?;
    let manifest = Manifest {
        stage: FOLDER.to_owned(),
        trial: name,
        version: VERSION,
        parameters: json!({}),
        inputs: made_from,
        outcome: Outcome::Ok,
        warnings: Vec::new(),
        summary: BTreeMap::new(),
        output: String::new(),
        files: BTreeMap::new(),
        seconds: started.elapsed().as_secs_f64(),
        program: env!("CARGO_PKG_VERSION").to_owned(),
    };
    workspace.commit(scratch, manifest)?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(n: usize) -> Tree {
        Tree { trials: (0..n).map(|i| format!("t{i:03}")).collect() }
    }

    #[test]
    fn every_trial_is_below_the_root_once() {
        for n in [0, 1, 7, 8, 9, 64, 65, 600] {
            let tree = tree(n);
            let levels = tree.levels();
            assert_eq!(levels.is_empty(), n == 0);
            let mut nodes: Vec<Node> = tree.root().into_iter().collect();
            let mut seen = 0;
            while let Some(node) = nodes.pop() {
                if node.level == 1 { seen += tree.trials_of(node).len() } else { nodes.extend(tree.nodes_below(node)) }
            }
            assert_eq!(seen, n);
        }
        assert_eq!(tree(600).levels(), [75, 10, 2, 1]);
    }

    #[test]
    fn nodes_are_written_as_level_and_index() {
        let node: Node = "2-13".parse().unwrap();
        assert_eq!((node.level, node.index, node.to_string().as_str()), (2, 13, "2-13"));
        for wrong in ["2", "0-1", "a-b", "1-"] {
            assert!(wrong.parse::<Node>().is_err());
        }
    }
}
