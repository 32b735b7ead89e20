//! Labels that a whole trial, or a long part of it, has on other markers than the static trial.
//!
//! Two markers of one rigid segment whose labels are exchanged leave every trajectory continuous,
//! so that nothing in the recording alone shows it. The geometry of the segment in the static trial
//! does: the markers no longer fit it rigidly, and fit again once the labels are exchanged back.
//! Clusters that are nearly symmetric also fit when they are turned by half a revolution; there the
//! pose of the neighbouring segment decides, too. Labels that went to another segment, and those of
//! segments with fewer markers, are found by the whole body (`labels_between`).

use aloft_body::rigid::fit_pose_of_seen;
use aloft_body::{State, Subject};
use aloft_signal::{runs_where, upper_median};
use aloft_trial::Trial;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Fewest markers of a segment that are seen together.
const FEWEST: usize = 4;
/// Most markers of a segment for which every exchange of two pairs is tried.
const MOST: usize = 9;
/// Number of frames on which exchanges are compared.
const SAMPLES: usize = 41;
/// An exchange has to leave less than this share of the rigid residual …
const SHARE: f64 = 0.5;
/// … and to remove at least this much of it, m.
const GAIN_M: f64 = 0.002;
/// Share of the rigid residual that it may leave over all frames where the neighbour's pose
/// decides, and in single frames, with an allowance for noise, m.
const OVER_ALL: f64 = 0.7;
const ALIKE: f64 = 1.2;
const NOISE_M: f64 = 0.001;
/// Distance that rounding cannot reach, m.
const ROUNDING_M: f64 = 1e-9;
/// Above this rigid residual the shape alone decides, m; below it the neighbour's pose has to
/// agree.
const SHAPE_M: f64 = 0.010;
/// A segment turned by more than this against its neighbour, compared with the static trial …
const TURNED_RAD: f64 = 1.75;
/// … which the exchange reduces by at least this much.
const TURNED_BACK_RAD: f64 = 1.0;
/// Shortest part of a trial that is repaired, s.
const SHORTEST_S: f64 = 0.1;
/// Share of frames from which on an exchange counts for the whole trial.
const WHOLE: f64 = 0.9;

/// Labels that were on other markers than in the static trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LabelExchange {
    /// Name of the link; of two or more links where markers of one bear the labels of another.
    pub link: String,
    /// Pairs `(label, marker)`: the trajectory recorded as `label` belongs to `marker`.
    pub labels: Vec<(String, String)>,
    /// First frame.
    pub start: usize,
    /// One past the last frame.
    pub end: usize,
    /// Number of frames of the trial.
    pub n_frames: usize,
    /// Root mean square distance of the markers from the static shape before, m (median over
    /// frames).
    pub before_m: f64,
    /// The same after the exchange, m.
    pub after_m: f64,
}

impl std::fmt::Display for LabelExchange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let pairs: Vec<String> = self
            .labels
            .iter()
            .filter(|(a, b)| a < b || !self.labels.contains(&(b.clone(), a.clone())))
            .map(|(a, b)| {
                let both = self.labels.contains(&(b.clone(), a.clone()));
                format!("`{a}` {} `{b}`", if both { "and" } else { "is" })
            })
            .collect();
        let where_ = if self.start == 0 && self.end == self.n_frames {
            "in the whole trial".to_owned()
        } else {
            format!("in frames {} to {}", self.start + 1, self.end)
        };
        write!(
            f,
            "labels exchanged against the static trial {where_}, and exchanged back: {} ({}: markers off the static \
             body by {:.1} mm, now {:.1} mm)",
            pairs.join(", "),
            self.link,
            1e3 * self.before_m,
            1e3 * self.after_m
        )
    }
}

/// A segment with the places of its markers in the static trial and in the recording.
struct Segment {
    link: usize,
    /// Index of the trajectory of each marker.
    sources: Vec<usize>,
    /// Place of each marker in the link frame, m.
    places_m: Vec<Vector3<f64>>,
    /// The neighbour with enough markers: index, and the static rotation of this link in its frame.
    neighbour: Option<(usize, UnitQuaternion<f64>)>,
}

/// Fit of a segment in one frame with its labels permuted.
struct Fitted {
    rms_m: f64,
    rotation: UnitQuaternion<f64>,
}

impl Segment {
    /// With `permutation[i]` the marker to which trajectory `i` belongs.
    fn fit(&self, trial: &Trial, frame: usize, permutation: &[usize]) -> Option<Fitted> {
        let mut local = [Vector3::zeros(); MOST];
        let mut seen = [Vector3::zeros(); MOST];
        let mut n = 0;
        for (i, &source) in self.sources.iter().enumerate() {
            if let Some(p) = trial.markers.position(source, frame) {
                (local[n], seen[n]) = (self.places_m[permutation[i]], p);
                n += 1;
            }
        }
        if n < FEWEST.min(self.sources.len()) {
            return None;
        }
        let (pose, rms_m) = fit_pose_of_seen(&local[..n], &seen[..n])?;
        Some(Fitted { rms_m, rotation: pose.rotation })
    }

    /// A lower limit of [`Fitted::rms_m`] without a fit: if the distance of two markers differs by
    /// δ from that in the static trial, the squares of their residuals have a sum of at least δ²/2.
    fn least_rms_m(&self, trial: &Trial, frame: usize, permutation: &[usize]) -> f64 {
        let mut seen = [(0, Vector3::zeros()); MOST];
        let mut n = 0;
        let mut largest: f64 = 0.0;
        for (i, &source) in self.sources.iter().enumerate() {
            let Some(p) = trial.markers.position(source, frame) else { continue };
            let place = &self.places_m[permutation[i]];
            for (other, q) in &seen[..n] {
                let still = (place - self.places_m[permutation[*other]]).norm();
                largest = largest.max(((p - q).norm() - still).abs());
            }
            seen[n] = (i, p);
            n += 1;
        }
        largest / (2.0 * n.max(1) as f64).sqrt()
    }
}

/// Segments with at least `fewest` markers in the trial, in the order of links.
fn segments(subject: &Subject, trial: &Trial, fewest: usize) -> Vec<Segment> {
    let model = &subject.model;
    let mut state = State::new(model);
    state.forward_position(model, &subject.static_q);
    let rotation = |link: usize| {
        UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(*state.rotation(link)))
    };
    let mut out: Vec<Segment> = Vec::new();
    for link in 0..model.n_links() {
        let (mut sources, mut places_m) = (Vec::new(), Vec::new());
        for m in subject.markers.iter().filter(|m| m.link == link && m.weight > 0.0) {
            if let (Some(source), true) = (trial.markers.index(&m.label), m.position_m.iter().all(|x| x.is_finite())) {
                sources.push(source);
                places_m.push(m.position_m);
            }
        }
        if (fewest..=MOST).contains(&sources.len()) {
            out.push(Segment { link, sources, places_m, neighbour: None });
        }
    }
    for i in 0..out.len() {
        let mut at = model.links[out[i].link].parent;
        while let Some(parent) = at {
            if let Some(found) = out.iter().position(|s| s.link == parent) {
                out[i].neighbour = Some((found, rotation(parent).inverse() * rotation(out[i].link)));
                break;
            }
            at = model.links[parent].parent;
        }
    }
    out
}

/// All exchanges of one pair, of two pairs, and of three in a ring.
fn permutations(n: usize) -> Vec<Vec<usize>> {
    let same: Vec<usize> = (0..n).collect();
    let mut out = Vec::new();
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).collect();
    for (i, &(a, b)) in pairs.iter().enumerate() {
        let mut one = same.clone();
        one.swap(a, b);
        for &(c, d) in &pairs[i + 1..] {
            if ![a, b].contains(&c) && ![a, b].contains(&d) {
                let mut two = one.clone();
                two.swap(c, d);
                out.push(two);
            }
        }
        for c in (0..n).filter(|c| *c > b) {
            for ring in [[a, b, c], [a, c, b]] {
                let mut three = same.clone();
                (three[ring[0]], three[ring[1]], three[ring[2]]) = (ring[1], ring[2], ring[0]);
                out.push(three);
            }
        }
        out.push(one);
    }
    out
}

/// Exchanges found in a trial by comparison with the subject's static geometry; the trial is not
/// changed.
pub fn label_exchanges(subject: &Subject, trial: &Trial) -> Vec<LabelExchange> {
    // the whole body first: its parts would be found one by one, and not all of them
    if let Some(sides) = crate::labels_between::exchange_of_sides(subject, trial) {
        return vec![sides];
    }
    let all = segments(subject, trial, 3);
    let mut out = Vec::new();
    for segment in all.iter().filter(|s| s.sources.len() >= FEWEST) {
        out.extend(of_segment(subject, trial, segment, &all));
    }
    out.extend(crate::labels_between::exchange_between(subject, trial, &out));
    out
}

fn of_segment(subject: &Subject, trial: &Trial, segment: &Segment, all: &[Segment]) -> Vec<LabelExchange> {
    let n = trial.markers.n_frames;
    let same: Vec<usize> = (0..segment.sources.len()).collect();
    let step = n.div_ceil(SAMPLES).max(1);
    let sampled: Vec<(usize, Fitted)> =
        (0..n).step_by(step).filter_map(|f| segment.fit(trial, f, &same).map(|x| (f, x))).collect();
    // angle between this segment and its neighbour, compared with the static trial
    let turned = |frame: usize, fitted: &Fitted| -> Option<f64> {
        let (index, still) = segment.neighbour.as_ref()?;
        let neighbour = &all[*index];
        let own: Vec<usize> = (0..neighbour.sources.len()).collect();
        let other = neighbour.fit(trial, frame, &own)?;
        Some((still.inverse() * other.rotation.inverse() * fitted.rotation).angle())
    };
    let better = |frame: usize, plain: &Fitted, permutation: &[usize]| -> Option<bool> {
        let changed = segment.fit(trial, frame, permutation)?;
        if plain.rms_m > SHAPE_M {
            return Some(changed.rms_m < SHARE * plain.rms_m && plain.rms_m - changed.rms_m > GAIN_M);
        }
        // a nearly symmetric cluster: its shape is judged over all frames, below
        if changed.rms_m > ALIKE * plain.rms_m + NOISE_M {
            return Some(false);
        }
        let (before, after) = (turned(frame, plain)?, turned(frame, &changed)?);
        Some(before > TURNED_RAD && after < before - TURNED_BACK_RAD)
    };
    let score = |p: &Vec<usize>| -> (usize, f64) {
        let (mut count, mut sum) = (0, 0.0);
        for (f, plain) in &sampled {
            // most exchanges are ruled out by distances; a margin for rounding
            let most = if plain.rms_m > SHAPE_M { SHARE * plain.rms_m } else { ALIKE * plain.rms_m + NOISE_M };
            if segment.least_rms_m(trial, *f, p) > most + ROUNDING_M {
                continue;
            }
            if better(*f, plain, p) == Some(true) {
                count += 1;
                sum += segment.fit(trial, *f, p).map_or(0.0, |x| x.rms_m);
            }
        }
        (count, sum)
    };
    let candidates: Vec<(Vec<usize>, (usize, f64))> =
        permutations(segment.sources.len()).into_iter().map(|p| (score(&p), p)).map(|(s, p)| (p, s)).collect();
    let Some((best, (count, _))) = candidates.iter().max_by(|a, b| a.1.0.cmp(&b.1.0).then(b.1.1.total_cmp(&a.1.1)))
    else {
        return Vec::new();
    };
    if *count < 2 {
        return Vec::new();
    }
    // frame by frame; frames that say nothing (hidden markers) follow their neighbours
    let says: Vec<Option<bool>> =
        (0..n).map(|f| segment.fit(trial, f, &same).and_then(|plain| better(f, &plain, best))).collect();
    let (yes, told) = (says.iter().filter(|s| **s == Some(true)).count(), says.iter().flatten().count());
    let whole = yes as f64 >= WHOLE * told as f64;
    let runs = runs_where(n, |f| whole || says[f] == Some(true));
    let shortest = (SHORTEST_S * trial.markers.rate_hz).ceil() as usize;
    runs.into_iter()
        .filter(|run| run.len() >= shortest.max(3))
        .filter_map(|run| {
            let of = |p: &[usize]| {
                let mut values: Vec<f64> =
                    run.clone().filter_map(|f| segment.fit(trial, f, p).map(|x| x.rms_m)).collect();
                upper_median(&mut values)
            };
            let (before_m, after_m) = (of(&same)?, of(best)?);
            if after_m > OVER_ALL * before_m {
                return None;
            }
            let label = |i: usize| trial.markers.labels[segment.sources[i]].clone();
            let labels = (0..best.len()).filter(|&i| best[i] != i).map(|i| (label(i), label(best[i]))).collect();
            let link = subject.model.links[segment.link].name.clone();
            Some(LabelExchange { link, labels, start: run.start, end: run.end, n_frames: n, before_m, after_m })
        })
        .collect()
}

/// Moves trajectories to the labels to which they belong.
pub fn exchange_labels(trial: &mut Trial, exchanges: &[LabelExchange]) {
    for exchange in exchanges {
        let moves: Vec<(usize, usize)> = exchange
            .labels
            .iter()
            .filter_map(|(from, to)| Some((trial.markers.index(from)?, trial.markers.index(to)?)))
            .collect();
        let frames = exchange.start..exchange.end.min(trial.markers.n_frames);
        let taken: Vec<Vec<Vector3<f64>>> =
            moves.iter().map(|(from, _)| trial.markers.trajectories[*from][frames.clone()].to_vec()).collect();
        for ((_, to), path) in moves.iter().zip(taken) {
            trial.markers.trajectories[*to][frames.clone()].copy_from_slice(&path);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn permutations_are_different_and_complete() {
        let all = permutations(5);
        // 10 pairs, 15 double pairs, 20 rings
        assert_eq!(all.len(), 45);
        let mut sorted = all.clone();
        sorted.sort();
        sorted.dedup();
        assert_eq!(sorted.len(), 45);
        assert!(all.iter().all(|p| {
            let mut q = p.clone();
            q.sort_unstable();
            q == [0, 1, 2, 3, 4] && *p != [0, 1, 2, 3, 4]
        }));
    }

    #[test]
    fn no_fit_is_better_than_its_lower_limit() {
        let places_m = [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.1, 0.05, 0.02], [0.03, -0.1, 0.08], [0.0, 0.1, -0.09]];
        let places_m: Vec<Vector3<f64>> = places_m.map(Vector3::from).to_vec();
        let mut trial = Trial::default();
        trial.markers.n_frames = 6;
        let moved = |f: usize, i: usize, p: &Vector3<f64>| {
            let turn = UnitQuaternion::from_euler_angles(0.3 * f as f64, 1.0, -0.5 * f as f64);
            let noise = Vector3::from_fn(|k, _| ((7 * f + 3 * i + k) as f64).sin());
            // hidden once
            if (f, i) == (2, 1) {
                Vector3::repeat(f64::NAN)
            } else {
                turn * p + Vector3::x() + noise * 0.004 * f as f64
            }
        };
        trial.markers.trajectories =
            places_m.iter().enumerate().map(|(i, p)| (0..6).map(|f| moved(f, i, p)).collect()).collect();
        trial.markers.labels = (0..5).map(|i| format!("m{i}")).collect();
        let segment = Segment { link: 0, sources: (0..5).collect(), places_m, neighbour: None };
        let mut closest: f64 = 0.0;
        for frame in 0..6 {
            for permutation in permutations(5).into_iter().chain([(0..5).collect()]) {
                let rms_m = segment.fit(&trial, frame, &permutation).unwrap().rms_m;
                let least = segment.least_rms_m(&trial, frame, &permutation);
                assert!(least <= rms_m + 1e-12, "{least} above {rms_m}");
                closest = closest.max(least / rms_m);
            }
        }
        assert!(closest > 0.5, "a limit of {closest} of the residual rules nothing out");
    }
}
