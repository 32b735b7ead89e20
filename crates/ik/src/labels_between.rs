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
/// Distance from the model from which a pair of markers is looked at where the whole body fits, m …
const PAIR_M: f64 = 0.015;
/// … and the share of it that an exchange may leave.
const PAIR_SHARE: f64 = 0.5;
/// Angle beyond the range of a pair's joint from which the pair is looked at, rad. An exchange has
/// to take away half of it, with the markers off by no more than this in addition, m.
const BEYOND_RAD: f64 = 0.25;
const ALIKE_M: f64 = 0.003;
/// Most exchanges that are made one after the other.
const ROUNDS: usize = 4;
/// Largest distance of a marker from the mirror image of its mate, m.
const MIRRORED_M: f64 = 0.12;

/// An exchange of several pairs of markers, by their index in the problem.
type Pairs = Vec<(usize, usize)>;

/// Left for right on the whole body, or on all of it but a segment of the middle, where that makes
/// the body fit.
pub(crate) fn exchange_of_sides(subject: &Subject, trial: &Trial) -> Option<LabelExchange> {
    exchange(subject, trial, &[], |body, same, before_m| {
        if before_m < FAILS_M {
            return None;
        }
        let tried = sides(subject, body.problem).into_iter().filter_map(|pairs| {
            let permuted = exchanged(same, &pairs);
            Some((body.error(&permuted, FRAMES)?, permuted))
        });
        let (left, permuted) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (left < SHARE_ALL * before_m && left < FAILS_M).then_some((permuted, left))
    })
}

/// The exchange that makes the body fit; none where it fits as it is, or with no exchange.
pub(crate) fn exchange_between(subject: &Subject, trial: &Trial, within: &[LabelExchange]) -> Option<LabelExchange> {
    exchange(subject, trial, within, |body, same, before_m| {
        if before_m < FAILS_M { body.near(same, before_m) } else { body.anywhere(same, before_m) }
    })
}

fn exchange(
    subject: &Subject,
    trial: &Trial,
    within: &[LabelExchange],
    find: impl Fn(&Body<'_>, &[usize], f64) -> Option<(Vec<usize>, f64)>,
) -> Option<LabelExchange> {
    let options = IkOptions::default();
    // none: what fails here fails in the fit as well, which names it
    let mut problem = Problem::new(subject, &options).ok()?;
    problem.deviations = false;
    // none: as above
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
    let body = Body { subject, problem: &problem, options: &options, places };
    let same: Vec<usize> = (0..sources.len()).collect();
    let before_m = body.error(&same, FRAMES)?;
    let (best, left) = find(&body, &same, before_m)?;
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

/// The whole body in some frames, with the places of all markers in each of them.
struct Body<'a> {
    subject: &'a Subject,
    problem: &'a Problem,
    options: &'a IkOptions,
    places: Vec<Vec<Option<Vector3<f64>>>>,
}

/// How the body fits: medians over the frames.
struct Fit {
    /// Distance of every marker from the model, m; NaN where it is not seen.
    distance_m: Vec<f64>,
    /// How far the joint of every link is beyond its range, rad.
    beyond_rad: Vec<f64>,
}

impl Body<'_> {
    /// Median error of the body over the first `most` frames with trajectory `permuted[i]` as
    /// marker `i`, m.
    fn error(&self, permuted: &[usize], most: usize) -> Option<f64> {
        let mut single = Single::new(self.problem, self.options);
        // frames from all over the trial, also where only some are used
        let step = self.places.len().div_ceil(most).max(1);
        let mut all: Vec<f64> =
            self.places.iter().step_by(step).filter_map(|place| single.error(|i| place[permuted[i]])).collect();
        upper_median(&mut all)
    }

    fn fit(&self, permuted: &[usize]) -> Option<Fit> {
        let mut single = Single::new(self.problem, self.options);
        let mut distances = vec![Vec::new(); self.problem.markers.len()];
        let mut beyond = vec![Vec::new(); self.subject.model.n_links()];
        for place in &self.places {
            if single.error(|i| place[permuted[i]]).is_some() {
                single.distances().for_each(|(i, d)| distances[i].push(d));
                beyond.iter_mut().for_each(|b| b.push(0.0));
                for (link, excess) in single.beyond() {
                    let last = beyond[link].last_mut()?;
                    *last = f64::max(*last, excess);
                }
            }
        }
        let middle = |all: &mut Vec<Vec<f64>>| -> Vec<f64> {
            all.iter_mut().map(|v| upper_median(v).unwrap_or(f64::NAN)).collect()
        };
        Some(Fit { distance_m: middle(&mut distances), beyond_rad: middle(&mut beyond) })
    }

    /// The exchanges that leave least of the error of the whole body, one after the other, and the
    /// error left, m.
    fn anywhere(&self, same: &[usize], before_m: f64) -> Option<(Vec<usize>, f64)> {
        let candidates = candidates(self.subject, self.problem);
        let (mut best, mut left) = (same.to_vec(), before_m);
        for _ in 0..ROUNDS {
            let (one, first) = (self.error(&best, 1)?, self.error(&best, FIRST)?);
            let tried = candidates.iter().filter_map(|pairs| {
                let permuted = exchanged(&best, pairs);
                // most are ruled out by one frame
                if self.error(&permuted, 1)? > PROMISING * one {
                    return None;
                }
                let after = self.error(&permuted, FIRST)?;
                (after < SHARE * first).then_some((after, permuted))
            });
            let Some((_, permuted)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            let after = self.error(&permuted, FRAMES)?;
            if after > SHARE * left {
                break;
            }
            (best, left) = (permuted, after);
            if left < 0.5 * FAILS_M {
                break;
            }
        }
        (best != same && left < SHARE_ALL * before_m).then_some((best, left))
    }

    /// Where the body as a whole fits: the pair of markers of a segment or of neighbouring ones
    /// that are off, or whose joint is beyond its range, and that fit once they are exchanged; with
    /// the error left, m.
    fn near(&self, same: &[usize], before_m: f64) -> Option<(Vec<usize>, f64)> {
        let before = self.fit(same)?;
        let off = |fit: &Fit, (i, j): (usize, usize)| {
            let (a, b) = (fit.distance_m[i], fit.distance_m[j]);
            (0.5 * (a * a + b * b)).sqrt()
        };
        let link = |i: usize| self.problem.markers[i].link;
        let beyond = |fit: &Fit, (i, j): (usize, usize)| fit.beyond_rad[link(i)].max(fit.beyond_rad[link(j)]);
        let n = same.len() as f64;
        let tried = neighbours(self.subject, self.problem).into_iter().filter_map(|pair| {
            let (far, turned) = (off(&before, pair) > PAIR_M, beyond(&before, pair) > BEYOND_RAD);
            if !far && !turned {
                return None;
            }
            let permuted = exchanged(same, &vec![pair]);
            let after = self.fit(&permuted)?;
            let nearer = off(&after, pair) < PAIR_SHARE * off(&before, pair);
            let turned_back =
                beyond(&after, pair) < 0.5 * BEYOND_RAD && off(&after, pair) < off(&before, pair) + ALIKE_M;
            if !(far && nearer || turned && turned_back) {
                return None;
            }
            let left = self.error(&permuted, FRAMES)?;
            (n * (before_m * before_m - left * left) > PAIR_M * PAIR_M).then_some((left, permuted))
        });
        tried.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(left, permuted)| (permuted, left))
    }
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

/// Markers that are mirror images of each other.
struct Mirrored {
    /// Of a link with a mate on the other side (index of the first of the two links).
    limbs: BTreeMap<usize, Pairs>,
    /// Of a link in the middle.
    middle: BTreeMap<usize, Pairs>,
}

fn mirrored(subject: &Subject, problem: &Problem) -> Mirrored {
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
    let mut out = Mirrored { limbs: BTreeMap::new(), middle: BTreeMap::new() };
    for (l, link) in links.iter().enumerate() {
        match mate(&link.name).as_deref().map(index) {
            Some(Some(other)) if l < other => {
                out.limbs.insert(l, mates(l, other));
            }
            None => {
                out.middle.insert(l, mates(l, l));
            }
            _ => {}
        }
    }
    out
}

/// Left for right on the whole body, and on all of it but a segment of the middle.
fn sides(subject: &Subject, problem: &Problem) -> Vec<Pairs> {
    let Mirrored { limbs, middle } = mirrored(subject, problem);
    let without = |left_out: Option<usize>| -> Pairs {
        let middle = middle.iter().filter(|(l, _)| Some(**l) != left_out).map(|(_, pairs)| pairs);
        limbs.values().chain(middle).flatten().copied().collect()
    };
    std::iter::once(None).chain(middle.keys().copied().map(Some)).map(without).collect()
}

/// Exchanges that occur in laboratories: left for right on a limb, a part of one, or a segment of
/// the middle; any two markers of a segment or of neighbouring ones.
fn candidates(subject: &Subject, problem: &Problem) -> Vec<Pairs> {
    let Mirrored { limbs, middle } = mirrored(subject, problem);
    let mut out: Vec<Pairs> = middle.into_values().collect();
    for (&l, pairs) in &limbs {
        // the segment alone, and with those between it and the middle of the body
        let (mut limb, mut at) = (pairs.clone(), l);
        out.push(limb.clone());
        while let Some(up) = subject.model.links[at].parent
            && let Some(more) = limbs.get(&up)
        {
            limb.extend(more);
            out.push(limb.clone());
            at = up;
        }
        out.extend(pairs.iter().map(|pair| vec![*pair]));
    }
    out.extend(neighbours(subject, problem).into_iter().map(|pair| vec![pair]));
    out.retain(|pairs| !pairs.is_empty());
    out.sort();
    out.dedup();
    out
}

/// Pairs of markers of one segment, or of a segment and the next.
fn neighbours(subject: &Subject, problem: &Problem) -> Vec<(usize, usize)> {
    let links = &subject.model.links;
    let near = |a: usize, b: usize| a == b || links[a].parent == Some(b) || links[b].parent == Some(a);
    let n = problem.markers.len();
    let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    pairs.filter(|(i, j)| near(problem.markers[*i].link, problem.markers[*j].link)).collect()
}
