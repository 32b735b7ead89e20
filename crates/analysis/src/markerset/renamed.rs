//! Labels that a laboratory renamed: unknown ones whose words name a marker that is missing.

use super::known::Labels;
use aloft_trial::{MarkerSet, Trial, apply_marker_set};
use std::collections::BTreeMap;

/// Pairs (recorded label, label of the set): in most recordings the first is unknown and the second
/// missing, the words of the first name the landmark of the second (or its link, where neither has
/// a landmark), and no other label does.
pub(crate) fn renamed(sets: &[MarkerSet], set: &MarkerSet, trials: &[&Trial]) -> Vec<(String, String)> {
    let mut missing: BTreeMap<String, usize> = BTreeMap::new();
    let mut unknown: BTreeMap<String, usize> = BTreeMap::new();
    for trial in trials {
        let found = apply_marker_set(&mut (*trial).clone(), set, &BTreeMap::new());
        for (labels, counts) in [(found.missing, &mut missing), (found.unknown, &mut unknown)] {
            for label in labels {
                *counts.entry(label).or_default() += 1;
            }
        }
    }
    let often = |n: usize| 2 * n > trials.len();
    let known = Labels::of(sets);
    let places: Vec<(&String, (String, Option<String>))> = unknown
        .iter()
        .filter(|(_, n)| often(**n))
        .filter_map(|(label, _)| known.place(label).map(|p| (label, (p.link, p.landmark))))
        .collect();
    let wanted: Vec<(&String, (String, Option<String>))> = set
        .markers
        .iter()
        .filter(|m| missing.get(&m.label).is_some_and(|n| often(*n)))
        .map(|m| (&m.label, (m.link.clone(), m.landmark.clone())))
        .collect();
    // a landmark says where a marker is, a link alone does not say which of several
    let fits = |a: &(String, Option<String>), b: &(String, Option<String>)| match (&a.1, &b.1) {
        (Some(a), Some(b)) => a == b,
        (None, None) => a.0 == b.0,
        _ => false,
    };
    wanted
        .iter()
        .filter_map(|(label, place)| {
            let mut by_words = places.iter().filter(|(_, p)| fits(p, place));
            let recorded = by_words.next()?.0;
            let alone = by_words.next().is_none() && wanted.iter().filter(|(_, w)| fits(w, place)).count() == 1;
            alone.then(|| (recorded.clone(), (*label).clone()))
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use aloft_study::catalog;
    use aloft_trial::Markers;
    use nalgebra::Vector3;

    #[test]
    fn words_name_what_is_missing_and_numbers_do_not() {
        let sets: Vec<MarkerSet> = catalog::all("markersets").unwrap();
        let set = sets.iter().find(|s| s.name == "plug-in-gait-35").unwrap();
        let recorded = |label: &str| match label {
            "LASI" => "Left ASIS".to_owned(),
            "RASI" => "Right ASIS".to_owned(),
            "LTHI" => "L_Thigh".to_owned(),
            "RTOE" => "M17".to_owned(),
            other => other.to_owned(),
        };
        let labels: Vec<String> = set.markers.iter().filter(|m| !m.static_only).map(|m| recorded(&m.label)).collect();
        let trajectories = vec![vec![Vector3::zeros(); 3]; labels.len()];
        let markers = Markers { rate_hz: 100.0, first_frame: 1, n_frames: 3, labels, trajectories };
        let trial = Trial { markers, ..Trial::default() };
        let found = renamed(&sets, set, &[&trial]);
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        assert_eq!(found, [pair("Left ASIS", "LASI"), pair("Right ASIS", "RASI"), pair("L_Thigh", "LTHI")]);
    }
}
