//! Applies marker sets to recordings: renames labels to canonical ones and lists missing and
//! unknown markers.

use crate::{MarkerSet, Trial, WarningKind};
use aloft_c3d::split_subject;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Result of applying a marker set to a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MarkerSetMatch {
    /// Name of the set.
    pub set: String,
    /// Canonical labels that the recording has, in the order of the set.
    pub present: Vec<String>,
    /// Labels that were changed: (in the source, canonical).
    pub renamed: Vec<(String, String)>,
    /// The renamed labels that were found only by ignoring case and separators.
    pub guessed: Vec<(String, String)>,
    /// Markers tracked in every trial that the recording lacks, or contains without a single
    /// visible frame.
    pub missing: Vec<String>,
    /// Markers of the static trial that the recording lacks.
    pub missing_static: Vec<String>,
    /// Labels of the recording that are not in the set.
    pub unknown: Vec<String>,
}

/// The label reduced to lower-case letters and digits.
fn normalized(label: &str) -> String {
    label.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// How a recorded label was matched; smaller is more certain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Sureness {
    Same,
    Alias,
    WithoutPrefix,
    Guess,
}

/// Lookup from labels to markers of one set.
struct Lookup {
    exact: BTreeMap<String, (usize, Sureness)>,
    loose: BTreeMap<String, Option<usize>>,
}

impl Lookup {
    fn new(set: &MarkerSet, extra_aliases: &BTreeMap<String, String>) -> Self {
        let mut exact = BTreeMap::new();
        let mut loose: BTreeMap<String, Option<usize>> = BTreeMap::new();
        for (index, marker) in set.markers.iter().enumerate() {
            for (label, sureness) in std::iter::once((&marker.label, Sureness::Same))
                .chain(marker.aliases.iter().map(|alias| (alias, Sureness::Alias)))
            {
                let best = exact.entry(label.clone()).or_insert((index, sureness));
                if sureness < best.1 {
                    *best = (index, sureness);
                }
                // Two markers with the same letters are ambiguous in a loose match.
                loose
                    .entry(normalized(label))
                    .and_modify(|known| {
                        if *known != Some(index) {
                            *known = None;
                        }
                    })
                    .or_insert(Some(index));
            }
        }
        // Aliases stated by the laboratory take precedence.
        for (recorded, canonical) in extra_aliases {
            if let Some(index) = set.markers.iter().position(|m| &m.label == canonical) {
                exact.insert(recorded.clone(), (index, Sureness::Same));
            }
        }
        Self { exact, loose }
    }

    fn find(&self, label: &str) -> Option<(usize, Sureness)> {
        if let Some(found) = self.exact.get(label) {
            return Some(*found);
        }
        let (bare, subject) = split_subject(label);
        if subject.is_some()
            && let Some((index, _)) = self.exact.get(bare)
        {
            return Some((*index, Sureness::WithoutPrefix));
        }
        let key = normalized(bare);
        if key.is_empty() || bare.contains('#') {
            return None;
        }
        self.loose.get(&key).copied().flatten().map(|index| (index, Sureness::Guess))
    }

    /// For each marker of the set, the recorded label with the most certain match (index into
    /// `labels`).
    fn assign(&self, labels: &[String], n_markers: usize) -> Vec<Option<(usize, Sureness)>> {
        let mut best: Vec<Option<(usize, Sureness)>> = vec![None; n_markers];
        for (recorded, label) in labels.iter().enumerate() {
            if let Some((marker, sureness)) = self.find(label)
                && best[marker].is_none_or(|(_, known)| sureness < known)
            {
                best[marker] = Some((recorded, sureness));
            }
        }
        best
    }
}

/// Renames labels to the canonical ones of a set: exact names and aliases first, then without the
/// prefix `Subject:`, then ignoring case and separators (with a warning). `extra_aliases` maps
/// labels of this laboratory to canonical ones. Unknown markers keep their labels; nothing is
/// removed.
pub fn apply_marker_set(
    trial: &mut Trial,
    set: &MarkerSet,
    extra_aliases: &BTreeMap<String, String>,
) -> MarkerSetMatch {
    let lookup = Lookup::new(set, extra_aliases);
    let assigned = lookup.assign(&trial.markers.labels, set.markers.len());
    let mut outcome = MarkerSetMatch { set: set.name.clone(), ..MarkerSetMatch::default() };
    let mut known = vec![false; trial.markers.labels.len()];
    for (marker, found) in set.markers.iter().zip(&assigned) {
        let visible = found.is_some_and(|(recorded, _)| {
            trial.markers.trajectories[recorded].iter().any(|p| p.iter().all(|x| x.is_finite()))
        });
        if !visible {
            if marker.static_only {
                outcome.missing_static.push(marker.label.clone());
            } else if marker.tracking && !marker.optional {
                outcome.missing.push(marker.label.clone());
            }
        }
        let Some((recorded, sureness)) = *found else { continue };
        known[recorded] = true;
        outcome.present.push(marker.label.clone());
        let label = &trial.markers.labels[recorded];
        if label != &marker.label {
            let pair = (label.clone(), marker.label.clone());
            if sureness == Sureness::Guess {
                outcome.guessed.push(pair.clone());
            }
            outcome.renamed.push(pair);
        }
    }
    outcome.unknown =
        trial.markers.labels.iter().zip(&known).filter(|(_, known)| !**known).map(|(label, _)| label.clone()).collect();
    for (marker, found) in set.markers.iter().zip(&assigned) {
        if let Some((recorded, _)) = *found {
            // An unknown marker with the canonical name would now be a duplicate.
            if let Some(stranger) = trial.markers.index(&marker.label)
                && stranger != recorded
            {
                trial.markers.labels[stranger].push_str("#unused");
            }
            trial.markers.labels[recorded].clone_from(&marker.label);
        }
    }
    if !outcome.guessed.is_empty() {
        let pairs: Vec<String> = outcome.guessed.iter().map(|(from, to)| format!("`{from}` as `{to}`")).collect();
        trial.warn(WarningKind::Labels, format!("labels read by ignoring case and separators: {}", pairs.join(", ")));
    }
    outcome
}

/// Score of each set for the recording, best first: the fraction of the set's required markers that
/// are present, times the fraction of the recording's labels in the set to the power 1/4 (virtual
/// and extra markers are common), times the fraction of all its markers that are present, optional
/// ones included, to the power 1/16 (prefers the smaller of two matching sets). 1 is a perfect
/// match.
pub fn recognise(trial: &Trial, sets: &[MarkerSet]) -> Vec<(String, f64)> {
    let mut scores: Vec<(String, f64)> = sets
        .iter()
        .map(|set| {
            let assigned = Lookup::new(set, &BTreeMap::new()).assign(&trial.markers.labels, set.markers.len());
            let required = |m: &crate::MarkerDefinition| m.tracking && !m.static_only && !m.optional;
            let wanted = set.markers.iter().filter(|m| required(m)).count();
            let found = set.markers.iter().zip(&assigned).filter(|(m, a)| required(m) && a.is_some()).count();
            let explained = assigned.iter().flatten().count();
            let worn = set.markers.iter().filter(|m| !m.static_only).count().max(1);
            let seen = set.markers.iter().zip(&assigned).filter(|(m, a)| !m.static_only && a.is_some()).count();
            let score = if wanted == 0 || trial.markers.labels.is_empty() {
                0.0
            } else {
                found as f64 / wanted as f64
                    * (explained as f64 / trial.markers.labels.len() as f64).powf(0.25)
                    * (seen as f64 / worn as f64).powf(1.0 / 16.0)
            };
            (set.name.clone(), score)
        })
        .collect();
    scores.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    scores
}

impl MarkerSet {
    /// Labels of the markers on each link, for rigid fills and swap checks: tracked markers only,
    /// in the order of the set.
    pub fn segments(&self) -> Vec<Vec<String>> {
        let mut links: Vec<(&str, Vec<String>)> = Vec::new();
        for marker in self.markers.iter().filter(|m| m.tracking) {
            match links.iter_mut().find(|(link, _)| *link == marker.link) {
                Some((_, labels)) => labels.push(marker.label.clone()),
                None => links.push((&marker.link, vec![marker.label.clone()])),
            }
        }
        links.into_iter().map(|(_, labels)| labels).collect()
    }
}
