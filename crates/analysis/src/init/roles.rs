//! What each recording is for. Names decide where they are clear; what a recording shows decides
//! the rest, in any language: nobody moves in a static trial, and only flights identify a body.

use super::bodies::{Distances, distances};
use super::look::{Determination, is_still, name_pattern};
use aloft_trial::{Trial, falls};
use std::collections::BTreeMap;

/// Words of the names of static trials, and of recordings that are held out.
const STATIC: [&str; 2] = ["static", "cal_pose"];
const HELD: [&str; 5] = ["exercise", "squat", "gait", "walk", "valid"];
/// Word of the names of calibrations: of the joints of an object; of people, trials to stand still.
const CALIBRATION: &str = "calib";
/// Share of the most markers that a static trial has to have.
const COMPLETE: f64 = 0.5;
/// Share of the frames in which a marker has to be seen to count.
const SEEN: f64 = 0.5;

/// Recordings by their use.
#[derive(Default)]
pub(super) struct Roles<'a> {
    pub statics: Vec<&'a Determination>,
    /// Static trials that are not used, since one is enough.
    pub spare: Vec<&'a Determination>,
    pub calibration: Vec<&'a Determination>,
    pub identify: Vec<&'a Determination>,
    pub validate: Vec<&'a Determination>,
    /// Mean difference of the distances between markers of the static trial to those in the motion,
    /// and of the spare ones, mm; empty with one static trial.
    pub apart_mm: Vec<f64>,
}

fn lower(s: &Determination) -> String {
    s.stem.to_lowercase()
}

fn is(group: &[&Determination], s: &Determination) -> bool {
    group.iter().any(|g| g.relative == s.relative)
}

/// Number of markers that are seen in most frames.
fn n_seen(trial: &Trial) -> usize {
    let enough = SEEN * trial.markers.n_frames as f64;
    let seen = |t: &&Vec<_>| t.iter().filter(|p: &&nalgebra::Vector3<f64>| p.x.is_finite()).count() as f64 >= enough;
    trial.markers.trajectories.iter().filter(seen).count()
}

/// Sorts the recordings of an object, or of persons; `several` is true for those of several
/// subjects, whose pipeline names kinds of recordings instead of files.
pub(super) fn roles(seen: &[Determination], is_object: bool, several: bool) -> Roles<'_> {
    let mut out = Roles::default();
    let most = seen.iter().map(|s| n_seen(&s.trial)).max().unwrap_or(0) as f64;
    let stands = |s: &Determination| is_still(&s.trial) && n_seen(&s.trial) as f64 >= COMPLETE * most;
    let named = |s: &Determination, words: &[&str]| words.iter().any(|w| lower(s).contains(w));
    let calibrates = |s: &Determination| lower(s).contains(CALIBRATION) && (is_object || !stands(s));
    out.calibration = seen.iter().filter(|s| calibrates(s) && !named(s, &STATIC)).collect();
    out.statics = seen.iter().filter(|s| named(s, &STATIC)).collect();
    let mut stills: Vec<&Determination> = Vec::new();
    if out.statics.is_empty() {
        stills = seen.iter().filter(|s| stands(s) && !is(&out.calibration, s)).collect();
        // quiet standing may be what was studied: the best one is the static trial
        out.statics.clone_from(&stills);
    }
    if !several && !is_object && out.statics.len() > 1 {
        let (best, rest, apart_mm) = best_static(seen, std::mem::take(&mut out.statics));
        out.statics = vec![best];
        out.apart_mm = apart_mm;
        if stills.is_empty() {
            out.spare = rest;
        }
    }
    let rest: Vec<&Determination> =
        seen.iter().filter(|s| !is(&out.statics, s) && !is(&out.spare, s) && !is(&out.calibration, s)).collect();
    (out.identify, out.validate) = halves(rest, is_object, several);
    out
}

/// The static trial with the most markers; among equal ones that whose markers sit as in the
/// motion. With it the others, and how far the markers of each are off, mm, in that order.
fn best_static<'a>(
    seen: &[Determination],
    statics: Vec<&'a Determination>,
) -> (&'a Determination, Vec<&'a Determination>, Vec<f64>) {
    let motion: Vec<&Determination> = seen.iter().filter(|s| !is(&statics, s)).collect();
    let trials: Vec<&Trial> = statics.iter().chain(&motion).map(|s| &s.trial).collect();
    let all = distances(&trials);
    let (own, others) = all.split_at(statics.len());
    let others: Vec<&Distances> = others.iter().collect();
    let mut ranked: Vec<(usize, f64, &Determination)> = statics
        .iter()
        .zip(own)
        .map(|(s, d)| (n_seen(&s.trial), d.mean_difference(&others).map_or(f64::NAN, |m| 1e3 * m), *s))
        .collect();
    ranked.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)).then_with(|| a.2.relative.cmp(&b.2.relative)));
    let apart = ranked.iter().map(|r| r.1).collect();
    let mut ordered = ranked.into_iter().map(|r| r.2);
    // the list is not empty
    let best = ordered.next().unwrap_or(statics[0]);
    (best, ordered.collect(), apart)
}

/// Recordings to identify from, and those that are held out. People who never leave the ground show
/// nothing to identify from: where others jump, such recordings test the model. Without a
/// difference, names decide.
fn halves(rest: Vec<&Determination>, is_object: bool, several: bool) -> (Vec<&Determination>, Vec<&Determination>) {
    let by_name = |s: &Determination| HELD.iter().any(|h| lower(s).contains(h));
    let each: BTreeMap<&str, bool> =
        rest.iter().map(|s| (s.relative.as_str(), !is_object && falls(&s.trial))).collect();
    let falls = |s: &Determination| each.get(s.relative.as_str()).copied().unwrap_or(false);
    // recordings and falls of each kind: names that differ by a number
    let mut kinds: BTreeMap<String, (usize, usize)> = BTreeMap::new();
    for s in &rest {
        let kind = kinds.entry(name_pattern(&s.stem)).or_default();
        *kind = (kind.0 + 1, kind.1 + usize::from(falls(s)));
    }
    let of = |s: &Determination| {
        let (all, flying) = kinds.get(&name_pattern(&s.stem)).copied().unwrap_or_default();
        // a jump whose markers are lost in the air is still one; a pattern holds all of its kind
        if several { flying > 0 } else { falls(s) || 2 * flying > all }
    };
    let differ = rest.iter().any(|s| of(s)) && rest.iter().any(|s| !of(s));
    let (validate, identify): (Vec<_>, Vec<_>) =
        rest.into_iter().partition(|s| if differ { !of(s) } else { by_name(s) });
    if identify.is_empty() { (validate, identify) } else { (identify, validate) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::facts::StatedFacts;
    use aloft_trial::Markers;
    use nalgebra::Vector3;

    /// Six markers whose middle moves along `height`.
    fn of(stem: &str, height: impl Fn(f64) -> f64) -> Determination {
        let n_frames = 200;
        let track = |m: usize| -> Vec<Vector3<f64>> {
            let x = 0.1 * m as f64;
            (0..n_frames).map(|f| Vector3::new(x, x * x, 0.2 * x + height(f as f64 / 100.0))).collect()
        };
        let markers = Markers {
            rate_hz: 100.0,
            first_frame: 1,
            n_frames,
            labels: (0..6).map(|m| format!("M{m}")).collect(),
            trajectories: (0..6).map(track).collect(),
        };
        Determination {
            relative: format!("{stem}.c3d"),
            stem: stem.to_owned(),
            trial: Trial { markers, ..Trial::default() },
            unit: String::new(),
            stated: StatedFacts::default(),
        }
    }

    fn jump(t: f64) -> f64 {
        let air = (t - 0.8).clamp(0.0, 0.5);
        1.0 + 2.45 * air - 4.905 * air * air
    }

    fn squat(t: f64) -> f64 {
        1.0 + 0.2 * (3.0 * t).sin()
    }

    fn names<'a>(list: &[&'a Determination]) -> Vec<&'a str> {
        list.iter().map(|s| s.stem.as_str()).collect()
    }

    #[test]
    fn what_a_recording_shows_decides_where_names_do_not() {
        let seen = [of("Sprung1", jump), of("Sprung2", jump), of("Kniebeuge", squat), of("Ruhe", |_| 1.0)];
        let found = roles(&seen, false, false);
        assert_eq!(names(&found.statics), ["Ruhe"]);
        assert_eq!((names(&found.identify), names(&found.validate)), (vec!["Sprung1", "Sprung2"], vec!["Kniebeuge"]));
        // a squat jump flies, whatever its name says
        let seen = [of("squat_jump", jump), of("slow", squat), of("Calib", |_| 1.0)];
        let found = roles(&seen, false, false);
        assert_eq!((names(&found.statics), names(&found.calibration)), (vec!["Calib"], vec![]));
        assert_eq!((names(&found.identify), names(&found.validate)), (vec!["squat_jump"], vec!["slow"]));
        // without jumps, roles follow from names
        let seen = [of("walk1", squat), of("throw", squat), of("static", |_| 1.0)];
        let found = roles(&seen, false, false);
        assert_eq!((names(&found.identify), names(&found.validate)), (vec!["throw"], vec!["walk1"]));
        // a calibration of an object moves its joints
        let seen = [of("calib", |_| 1.0), of("throw1", jump), of("static", |_| 1.0)];
        let found = roles(&seen, true, false);
        assert_eq!((names(&found.calibration), names(&found.identify)), (vec!["calib"], vec!["throw1"]));
    }

    #[test]
    fn one_static_trial_is_used_and_quiet_standing_is_compared() {
        let seen = [of("jump", jump), of("static1", |_| 1.0), of("static2", |_| 1.0)];
        let found = roles(&seen, false, false);
        assert_eq!((names(&found.statics), names(&found.spare)), (vec!["static1"], vec!["static2"]));
        assert_eq!(names(&found.identify), ["jump"]);
        let seen = [of("a", |_| 1.0), of("b", |_| 1.0), of("c", |_| 1.0)];
        let found = roles(&seen, false, false);
        assert_eq!((found.statics.len(), found.identify.len(), found.spare.len()), (1, 2, 0));
    }
}
