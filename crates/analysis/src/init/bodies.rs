//! Whether recordings are of one body with the same markers.
//!
//! Markers of one segment keep their distances, and the distances are those of the body and of the
//! places where the markers sit. Recordings of one session have them in common to some millimetres
//! (skin moves); those of another person, or of another day, do not. No marker set is needed: the
//! pairs are those that keep their distance within a recording.

use super::look::Determination;
use aloft_pipeline::recording::abridged;
use aloft_signal::median_and_deviation;
use aloft_study::quote;
use aloft_trial::Trial;
use aloft_workspace::error::PipelineError;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Frames of a recording that are looked at.
const FRAMES: usize = 200;
/// Fewest frames in which both markers are seen.
const SEEN: usize = 20;
/// Largest spread of a distance that counts as kept, and largest distance on a segment, m.
const KEPT_M: f64 = 0.008;
const SEGMENT_M: f64 = 0.6;
/// Fewest pairs that two recordings have to share, and the median difference of their distances
/// from which they are of two bodies, m: skin moves by some millimetres, the distances of two
/// persons differ by several hundredths of some decimetres.
const PAIRS: usize = 15;
const OTHER_M: f64 = 0.009;

/// Distances that a recording keeps, by the numbers of the two labels.
pub(super) struct Distances(Vec<((u32, u32), f64)>);

/// Distances of every recording; labels have the same number in all of them.
pub(super) fn distances(trials: &[&Trial]) -> Vec<Distances> {
    let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
    for label in trials.iter().flat_map(|t| &t.markers.labels) {
        let next = numbers.len() as u32;
        numbers.entry(label).or_insert(next);
    }
    trials.par_iter().map(|t| Distances::of(t, &numbers)).collect()
}

impl Distances {
    fn of(trial: &Trial, numbers: &BTreeMap<&str, u32>) -> Self {
        let markers = &trial.markers;
        let step = (markers.n_frames / FRAMES).max(1);
        let mut own: Vec<(u32, usize)> =
            markers.labels.iter().enumerate().filter_map(|(i, l)| Some((*numbers.get(l.as_str())?, i))).collect();
        own.sort_unstable();
        let mut out = Vec::new();
        let mut values = Vec::with_capacity(FRAMES + 1);
        for (at, (a, i)) in own.iter().enumerate() {
            for (b, j) in &own[at + 1..] {
                values.clear();
                let pairs = markers.trajectories[*i].iter().zip(&markers.trajectories[*j]).step_by(step);
                values.extend(pairs.map(|(p, q)| (p - q).norm()).filter(|d| d.is_finite()));
                if values.len() >= SEEN
                    && let Some((middle, deviation)) = median_and_deviation(&mut values)
                    && middle < SEGMENT_M
                    && 1.4826 * deviation < KEPT_M
                {
                    out.push(((*a, *b), middle));
                }
            }
        }
        Self(out)
    }

    /// Differences of the distances that both keep, m.
    fn differences(&self, other: &Self) -> Vec<f64> {
        let (mut i, mut j) = (0, 0);
        let mut out = Vec::new();
        while let (Some((a, x)), Some((b, y))) = (self.0.get(i), other.0.get(j)) {
            match a.cmp(b) {
                std::cmp::Ordering::Less => i += 1,
                std::cmp::Ordering::Greater => j += 1,
                std::cmp::Ordering::Equal => {
                    out.push((x - y).abs());
                    (i, j) = (i + 1, j + 1);
                }
            }
        }
        out
    }

    /// Median difference of the distances, m; `None` where too few are shared.
    fn apart(&self, other: &Self) -> Option<f64> {
        let mut differences = self.differences(other);
        (differences.len() >= PAIRS).then(|| aloft_signal::upper_median(&mut differences)).flatten()
    }

    /// Mean difference of the distances to those of some recordings, m: a few markers that sit
    /// elsewhere count, too.
    pub fn mean_difference(&self, others: &[&Self]) -> Option<f64> {
        let all: Vec<f64> = others.iter().flat_map(|o| self.differences(o)).collect();
        (all.len() >= PAIRS).then(|| all.iter().sum::<f64>() / all.len() as f64)
    }
}

/// Groups of recordings with the same distances, the largest first; those that cannot be compared
/// are in none. With the groups, the smallest difference between two of them, m.
fn groups(all: &[Distances]) -> (Vec<Vec<usize>>, f64) {
    let mut group: Vec<usize> = (0..all.len()).collect();
    let mut compared = vec![false; all.len()];
    let mut between: Vec<(usize, usize, f64)> = Vec::new();
    for i in 0..all.len() {
        for j in 0..i {
            if group[i] == group[j] {
                continue;
            }
            let Some(apart) = all[i].apart(&all[j]) else { continue };
            (compared[i], compared[j]) = (true, true);
            if apart < OTHER_M {
                let (from, to) = (group[i].max(group[j]), group[i].min(group[j]));
                group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
            } else {
                between.push((i, j, apart));
            }
        }
    }
    let mut out: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for i in (0..all.len()).filter(|i| compared[*i]) {
        out.entry(group[i]).or_default().push(i);
    }
    let mut out: Vec<Vec<usize>> = out.into_values().collect();
    out.sort_by_key(|g| (std::cmp::Reverse(g.len()), g[0]));
    let least = between.iter().filter(|(i, j, _)| group[*i] != group[*j]).map(|b| b.2).fold(f64::INFINITY, f64::min);
    (out, least)
}

/// Checks that the recordings are of one body.
///
/// # Errors
/// Two groups of recordings, or more, whose markers sit differently.
pub(super) fn one_body(folder: &Path, seen: &[Determination]) -> Result<(), PipelineError> {
    let trials: Vec<&Trial> = seen.iter().map(|s| &s.trial).collect();
    let (groups, least) = groups(&distances(&trials));
    if groups.len() < 2 {
        return Ok(());
    }
    let named: Vec<String> = groups
        .iter()
        .map(|g| {
            let names: Vec<String> = g.iter().map(|i| seen[*i].relative.clone()).collect();
            format!("{} ({})", abridged(&names), names.len())
        })
        .collect();
    let of = quote::path(folder);
    Err(PipelineError::request_hint(
        format!(
            "{} holds recordings of {} bodies, or of sessions with the markers in other places: distances between markers that \
             stay the same within a recording differ by {:.0} mm or more (median) between {}",
            folder.display(),
            groups.len(),
            1e3 * least,
            named.join(" and ")
        ),
        format!(
            "one pipeline is for one body with its markers in place: a folder for each, and `aloft init` with the folder that \
             holds them; if it is one session all the same: `aloft init {of} --one-subject`"
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_trial::Markers;
    use nalgebra::{Rotation3, Vector3};

    /// A body of six stiff segments of four markers each, `scale` times as large, that moves; skin
    /// moves by some millimetres.
    fn person(scale: f64, phase: f64) -> Trial {
        let mut labels = Vec::new();
        let mut trajectories = Vec::new();
        for segment in 0..6 {
            for marker in 0..4 {
                let k = f64::from(4 * segment + marker);
                let at = Vector3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.7 * k).sin()) * 0.15 * scale;
                labels.push(format!("S{segment}M{marker}"));
                trajectories.push(
                    (0..300)
                        .map(|f| {
                            let t = phase + 0.05 * f64::from(f);
                            let turn = Rotation3::from_euler_angles(t.sin(), f64::from(segment) * t.cos(), 0.3 * t);
                            let skin = Vector3::repeat(0.003 * (t + k).sin());
                            turn * (at + skin) + Vector3::new(t, f64::from(segment) * t.sin(), 1.0)
                        })
                        .collect(),
                );
            }
        }
        let markers = Markers { rate_hz: 100.0, first_frame: 1, n_frames: 300, labels, trajectories };
        Trial { markers, ..Trial::default() }
    }

    #[test]
    fn two_bodies_are_two_groups_and_one_that_moves_otherwise_is_not() {
        let mut trials = [person(1.0, 0.0), person(1.1, 0.0), person(1.0, 2.0), person(1.1, 4.0), person(1.0, 5.0)];
        // a recording that shares too few markers is in no group
        trials[4].markers.labels.iter_mut().skip(4).for_each(|l| l.insert(0, 'x'));
        let all: Vec<&Trial> = trials.iter().collect();
        let (found, least) = groups(&distances(&all));
        assert_eq!(found, [vec![0, 2], vec![1, 3]]);
        assert!((0.009..0.05).contains(&least), "{least}");
        let alike = [person(1.0, 0.0), person(1.0, 3.0), person(1.02, 1.0)];
        assert_eq!(groups(&distances(&alike.iter().collect::<Vec<_>>())).0.len(), 1);
    }

    #[test]
    fn a_static_with_a_marker_elsewhere_differs_more() {
        let motion = person(1.0, 0.0);
        let mut moved = person(1.0, 2.0);
        for p in &mut moved.markers.trajectories[5] {
            p.z += 0.03;
        }
        let all = distances(&[&motion, &person(1.0, 2.0), &moved]);
        let difference = |i: usize| all[i].mean_difference(&[&all[0]]).unwrap_or(f64::NAN);
        assert!(difference(2) > 1.5 * difference(1), "{} {}", difference(1), difference(2));
    }
}
