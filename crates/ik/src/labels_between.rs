//! Labels that a whole trial has on markers of another segment (left for right, knee for ankle), or
//! exchanged on a segment with too few markers for its shape to tell.
//!
//! Each segment may keep its shape, because left and right are mirror images; but the body no
//! longer fits: joints come apart, or turn beyond their ranges. Some frames are fitted with the
//! labels as they are. Only where that fails, exchanges are tried, and the one is taken that makes
//! the whole body fit.

use crate::IkOptions;
use crate::labels::LabelExchange;
use crate::problem::Problem;
use crate::solve::{Single, match_markers};
use aloft_body::Subject;
use aloft_signal::upper_median;
use aloft_trial::Trial;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Frames that are fitted.
const FRAMES: usize = 7;
/// Frames on which candidates are compared first.
const FIRST: usize = 3;
/// Error of the body from which exchanges are looked for, m.
const FAILS_M: f64 = 0.020;
/// Share of the error in the first frame above which an exchange is not tried on the others.
const PROMISING: f64 = 0.8;
/// An exchange has to leave less than this share of the error …
const SHARE: f64 = 0.6;
/// … and several together less than this.
const SHARE_ALL: f64 = 0.5;
/// Most exchanges that are made one after the other.
const ROUNDS: usize = 4;
/// Largest distance of a marker from the mirror image of its mate, m.
const MIRRORED_M: f64 = 0.12;

/// An exchange of several pairs of markers, by their index in the problem.
type Pairs = Vec<(usize, usize)>;

/// The exchange that makes the body fit; none where it fits as it is, or with no exchange.
pub(crate) fn exchange_between(subject: &Subject, trial: &Trial, within: &[LabelExchange]) -> Option<LabelExchange> {
    let options = IkOptions::default();
    let mut problem = Problem::new(subject, &options).ok()?;
    problem.deviations = false;
    let sources = match_markers(&mut problem, subject, trial).ok()?;
    let frames = frames(trial, &sources);
    // places of the markers in the chosen frames, with the exchanges within segments made
    let mut own: Vec<Vec<usize>> = vec![sources.clone(); frames.len()];
    for exchange in within {
        for (from, to) in &exchange.labels {
            let at = |label: &String| problem.markers.iter().position(|m| m.label == *label);
            if let (Some(source), Some(marker)) = (trial.markers.index(from), at(to)) {
                let held = |f: usize| (exchange.start..exchange.end).contains(&f);
                own.iter_mut().zip(&frames).filter(|(_, f)| held(**f)).for_each(|(own, _)| own[marker] = source);
            }
        }
    }
    let places: Vec<Vec<Option<Vector3<f64>>>> = frames
        .iter()
        .zip(&own)
        .map(|(frame, own)| own.iter().map(|source| trial.markers.position(*source, *frame)).collect())
        .collect();
    let same: Vec<usize> = (0..sources.len()).collect();
    let before_m = error(&problem, &options, &places, &same, FRAMES)?;
    if before_m < FAILS_M {
        return None;
    }
    let candidates = candidates(subject, &problem);
    let (mut best, mut left) = (same.clone(), before_m);
    for _ in 0..ROUNDS {
        let one = error(&problem, &options, &places, &best, 1)?;
        let first = error(&problem, &options, &places, &best, FIRST)?;
        let tried = candidates.iter().filter_map(|pairs| {
            let permuted = exchanged(&best, pairs);
            // most are ruled out by one frame
            if error(&problem, &options, &places, &permuted, 1)? > PROMISING * one {
                return None;
            }
            let after = error(&problem, &options, &places, &permuted, FIRST)?;
            (after < SHARE * first).then_some((after, permuted))
        });
        let Some((_, permuted)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        let after = error(&problem, &options, &places, &permuted, FRAMES)?;
        if after > SHARE * left {
            break;
        }
        (best, left) = (permuted, after);
        if left < 0.5 * FAILS_M {
            break;
        }
    }
    if best == same || left > SHARE_ALL * before_m {
        return None;
    }
    let label = |i: usize| problem.markers[i].label.clone();
    let changed = || (0..best.len()).filter(|&i| best[i] != i);
    let mut links: Vec<String> = changed().map(|i| subject.model.links[problem.markers[i].link].name.clone()).collect();
    links.sort();
    links.dedup();
    Some(LabelExchange {
        link: links.join(", "),
        // the trajectory with the label of `best[i]` belongs to marker `i`
        labels: changed().map(|i| (label(best[i]), label(i))).collect(),
        start: 0,
        end: trial.markers.n_frames,
        n_frames: trial.markers.n_frames,
        before_m,
        after_m: left,
    })
}

/// Frames all over the trial in which most markers are seen.
fn frames(trial: &Trial, sources: &[usize]) -> Vec<usize> {
    let seen = |f: usize| sources.iter().filter(|s| trial.markers.position(**s, f).is_some()).count();
    let n = trial.markers.n_frames;
    let counts: Vec<usize> = (0..n).map(seen).collect();
    let most = counts.iter().copied().max().unwrap_or(0);
    let good: Vec<usize> = (0..n).filter(|f| counts[*f] == most).collect();
    let step = good.len().div_ceil(FRAMES).max(1);
    good.into_iter().skip(step / 2).step_by(step).collect()
}

/// Median error of the body over the first `most` frames with trajectory `permuted[i]` as marker
/// `i`, m.
fn error(
    problem: &Problem,
    options: &IkOptions,
    places: &[Vec<Option<Vector3<f64>>>],
    permuted: &[usize],
    most: usize,
) -> Option<f64> {
    let mut single = Single::new(problem, options);
    // frames from all over the trial, also where only some are used
    let step = places.len().div_ceil(most).max(1);
    let mut all: Vec<f64> =
        places.iter().step_by(step).filter_map(|place| single.error(|i| place[permuted[i]])).collect();
    upper_median(&mut all)
}

fn exchanged(of: &[usize], pairs: &Pairs) -> Vec<usize> {
    let mut out = of.to_vec();
    for (a, b) in pairs {
        out.swap(*a, *b);
    }
    out
}

/// The link on the other side, by its name.
fn mate(name: &str) -> Option<String> {
    let swap = |from: &str, to: &str| name.strip_suffix(from).map(|stem| format!("{stem}{to}"));
    swap("_r", "_l").or_else(|| swap("_l", "_r"))
}

/// Exchanges that occur in laboratories: left for right on a limb, a part of one, or a segment of
/// the middle; any two markers of a segment or of neighbouring ones.
fn candidates(subject: &Subject, problem: &Problem) -> Vec<Pairs> {
    let links = &subject.model.links;
    let index = |name: &str| links.iter().position(|l| l.name == name);
    let mirrored = |p: &Vector3<f64>| Vector3::new(p.x, p.y, -p.z);
    let on = |link: usize| (0..problem.markers.len()).filter(move |i| problem.markers[*i].link == link);
    // each marker of `a` with the nearest free one of the mirror image of `b`
    let mates = |a: usize, b: usize| -> Pairs {
        let mut all: Vec<(f64, usize, usize)> = on(a)
            .flat_map(|i| on(b).map(move |j| (i, j)))
            .filter(|(i, j)| a != b || i < j)
            .map(|(i, j)| ((problem.markers[i].position - mirrored(&problem.markers[j].position)).norm(), i, j))
            .filter(|(far, ..)| *far < MIRRORED_M)
            .collect();
        all.sort_by(|x, y| x.0.total_cmp(&y.0));
        let mut used = Vec::new();
        all.retain(|(_, i, j)| {
            let free = !used.contains(i) && !used.contains(j);
            if free {
                used.extend([*i, *j]);
            }
            free
        });
        all.into_iter().map(|(_, i, j)| (i, j)).collect()
    };
    let mut out: Vec<Pairs> = Vec::new();
    let mut of_link: BTreeMap<usize, Pairs> = BTreeMap::new();
    for (l, link) in links.iter().enumerate() {
        match mate(&link.name).as_deref().map(index) {
            Some(Some(other)) if l < other => {
                of_link.insert(l, mates(l, other));
            }
            None => out.push(mates(l, l)),
            _ => {}
        }
    }
    for (&l, pairs) in &of_link {
        // the segment alone, and with those between it and the middle of the body
        let (mut limb, mut at) = (pairs.clone(), l);
        out.push(limb.clone());
        while let Some(up) = links[at].parent
            && let Some(more) = of_link.get(&up)
        {
            limb.extend(more);
            out.push(limb.clone());
            at = up;
        }
        out.extend(pairs.iter().map(|pair| vec![*pair]));
    }
    for i in 0..problem.markers.len() {
        for j in i + 1..problem.markers.len() {
            let (a, b) = (problem.markers[i].link, problem.markers[j].link);
            if a == b || links[a].parent == Some(b) || links[b].parent == Some(a) {
                out.push(vec![(i, j)]);
            }
        }
    }
    out.retain(|pairs| !pairs.is_empty());
    out.sort();
    out.dedup();
    out
}
