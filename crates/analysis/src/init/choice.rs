//! The marker set and the model that fit a folder's recordings best.

use super::look::Determination;
use aloft_body::ModelSpec;
use aloft_study::catalog;
use aloft_trial::{MarkerSet, recognise};
use aloft_workspace::error::PipelineError;
use std::collections::BTreeSet;

/// The choice, with the reason where the model is not the whole body.
pub(super) struct FittedSet {
    pub set: String,
    pub model: String,
    /// Fit, 0 to 1.
    pub fit: f64,
    /// Parts of the body without markers, in words.
    pub unseen: Option<String>,
    /// True if software estimates the points from videos.
    pub markerless: bool,
}

/// A part of a body as a model: the markers of a set on its links.
fn part_of(set: &MarkerSet, model: &ModelSpec) -> MarkerSet {
    let on = |link: &str| model.links.iter().any(|l| l.name == link);
    let mut part = set.clone();
    part.markers.retain(|m| on(&m.link));
    part
}

/// Score of every set for every recording, the sum over recordings by set, best first.
fn ranked(seen: &[Determination], sets: &[MarkerSet]) -> Vec<(String, f64)> {
    let mut totals: Vec<(String, f64)> = sets.iter().map(|s| (s.name.clone(), 0.0)).collect();
    for s in seen {
        for (name, score) in recognise(&s.trial, sets) {
            if let Some(total) = totals.iter_mut().find(|t| t.0 == name) {
                total.1 += score / seen.len() as f64;
            }
        }
    }
    totals.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    totals
}

/// Links whose markers are in at least half of the recordings that hold any marker of the set.
fn links_with_markers(seen: &[Determination], set: &MarkerSet) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let present: Vec<BTreeSet<String>> = seen
        .iter()
        .map(|s| {
            let mut trial = s.trial.clone();
            aloft_trial::apply_marker_set(&mut trial, set, &Default::default()).present.into_iter().collect()
        })
        .filter(|labels: &BTreeSet<String>| !labels.is_empty())
        .collect();
    for marker in set.markers.iter().filter(|m| m.tracking && !m.static_only) {
        let n = present.iter().filter(|labels| labels.contains(&marker.label)).count();
        if 2 * n >= present.len().max(1) {
            found.insert(marker.link.clone());
        }
    }
    found
}

/// Chooses marker set and model. A model of a part of the body is chosen only where the recordings
/// have no marker on the others: on no arm, and for legs and pelvis alone on no trunk either.
pub(super) fn choose(seen: &[Determination]) -> Result<FittedSet, PipelineError> {
    let sets: Vec<MarkerSet> = catalog::all("markersets")?;
    let models: Vec<ModelSpec> = catalog::all("models")?;
    let parts: Vec<&ModelSpec> = models.iter().filter(|m| !m.carries.is_empty()).collect();
    let whole = ranked(seen, &sets);
    let mut best = FittedSet {
        set: "plug-in-gait-35".to_owned(),
        model: "human34".to_owned(),
        fit: 0.0,
        unseen: None,
        markerless: false,
    };
    if let Some((name, fit)) = whole.first()
        && let Some(set) = sets.iter().find(|s| s.name == *name)
    {
        best = FittedSet { set: name.clone(), model: set.model.clone(), fit: *fit, unseen: None, markerless: false };
    }
    for model in parts {
        let of_part: Vec<MarkerSet> = sets
            .iter()
            .filter(|s| s.model != model.name)
            .map(|s| part_of(s, model))
            .filter(|s| !s.markers.is_empty())
            .collect();
        let Some((name, fit)) = ranked(seen, &of_part).into_iter().next() else { continue };
        let Some(set) = sets.iter().find(|s| s.name == name) else { continue };
        let marked = links_with_markers(seen, set);
        let in_part = |link: &String| model.links.iter().any(|l| l.name == *link);
        // a head alone does not make a whole body
        let beyond = marked.iter().any(|link| !in_part(link) && link != "head");
        let complete = model.links.iter().all(|l| marked.contains(&l.name));
        if complete && !beyond && fit > best.fit {
            // none: built-in models can be built
            let unseen = aloft_body::Model::from_spec(model).ok().and_then(|m| m.unseen_parts());
            best = FittedSet { set: name, model: model.name.clone(), fit, unseen, markerless: false };
        }
    }
    best.markerless = sets.iter().any(|s| s.name == best.set && s.markerless.is_some());
    Ok(best)
}
