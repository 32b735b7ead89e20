//! Markers held at one position: exact copies of a position are no measurements.
//!
//! Programs fill a gap with the last position that was seen, and a marker that was lost for the
//! whole recording stays at one point. Either way the stored position repeats to the last digit
//! while the body moves on. At rest, coarse digits repeat, too, so a stretch counts as held only if
//! a marker at rest would not have repeated for so long. There are two kinds of evidence:
//!
//! - **Noise.** A measured position scatters. Scatter of standard deviation σ in an axis stays in
//!   one step `q` of the digits with a probability of at most `q/(σ √2π)`, wherever the marker is;
//!   `n` repeats of three coordinates have its power of `3n`. Where single coordinates repeat, as
//!   those of a marker at rest do in coarse digits, they tell this probability themselves.
//! - **Companions.** Where digits are coarse or positions were smoothed, markers on the same part
//!   of the body contradict: the distance to most of them leaves the range of all other frames by
//!   as much as that range is wide. The foot of somebody who stands keeps its distances.
//!
//! Noise is no evidence where most other markers repeat as well: frames that a program stored twice
//! are left alone.

use crate::{Markers, Trial, Warning, WarningKind};
use nalgebra::Vector3;
use std::cell::OnceCell;
use std::ops::Range;

/// Fewest repeats in a row. Pairs of equal frames occur in recordings of several vendors, up to 20
/// in one file, and do no harm.
const FEWEST: usize = 2;
/// Third differences whose median is the scatter of a short stretch: enough for it to be known
/// within a quarter.
const WINDOW: usize = 20;
/// Median length of a vector of third differences, in standard deviations of a coordinate: √20 for
/// the coefficients 1, −3, 3, −1, times the median 1.538 of the chi distribution of three.
const MEDIAN_OF_THIRD: f64 = 6.879;
/// How much less a marker at rest scatters than one that moves. Static trials of laboratories
/// scatter 7 and 20 times less than their jumps.
const QUIETER: f64 = 20.0;
/// Largest probability that a recording of markers at rest contains such a stretch.
const BY_CHANCE: f64 = 1e-3;
/// Companions that are asked: as many as fix a position. Most of them have to contradict, so that
/// one that is held as well does not hide the others.
const COMPANIONS: usize = 3;
/// Change of the distance to a companion, as a share of the way that the marker covers: the two
/// are on one part of the body. Soft tissue stays below 2 %, parts that a joint connects do not.
const STEADY: f64 = 0.1;
/// Most markers that are named one by one.
const NAMED: usize = 4;

/// Makes positions missing that are copies of another frame, with a warning.
pub(crate) fn frozen_to_missing(trial: &mut Trial) {
    let found = frozen(&trial.markers);
    for (marker, stretches) in &found {
        for frames in stretches {
            trial.markers.trajectories[*marker][frames.clone()].fill(Vector3::repeat(f64::NAN));
        }
    }
    trial.warnings.extend(words(&trial.markers, &found));
}

/// Markers, and the frames in which each is held.
type Held = Vec<(usize, Vec<Range<usize>>)>;

fn words(markers: &Markers, held: &Held) -> Vec<Warning> {
    let number = |frame: usize| u64::from(markers.first_frame) + frame as u64;
    let count = |stretches: &[Range<usize>]| stretches.iter().map(Range::len).sum::<usize>();
    let one = |(marker, stretches): &(usize, Vec<Range<usize>>)| {
        let longest = stretches.iter().max_by_key(|s| s.len())?;
        let range = format!("frames {} to {}", number(longest.start), number(longest.end - 1));
        let place = match stretches.len() {
            1 => format!("in {} frames, {range}", longest.len()),
            n => format!("in {} frames in {n} stretches, the longest {range}", count(stretches)),
        };
        let label = &markers.labels[*marker];
        let message =
            format!("marker `{label}` repeats one position exactly {place}, while others move: it is missing there");
        Some(Warning::new(WarningKind::HeldMarkers, message))
    };
    let mut out: Vec<Warning> = held.iter().take(NAMED).filter_map(one).collect();
    if held.len() > NAMED {
        let more = &held[NAMED..];
        let frames: usize = more.iter().map(|(_, s)| count(s)).sum();
        let message =
            format!("{} more markers repeat positions in the same way in {frames} frames: missing there", more.len());
        out.push(Warning::new(WarningKind::HeldMarkers, message));
    }
    out
}

/// The stretches of frames in which each marker is held.
fn frozen(markers: &Markers) -> Held {
    let tracks = &markers.trajectories;
    if tracks.iter().any(|track| track.len() != markers.n_frames) {
        return Vec::new();
    }
    // the stretches of equal frames of each marker
    let equal: Vec<Vec<Range<usize>>> = tracks
        .iter()
        .map(|track| {
            let steps = aloft_signal::runs_where(track.len(), |f| repeats(track, f));
            steps.into_iter().filter(|s| s.len() >= FEWEST).map(|s| s.start - 1..s.end).collect()
        })
        .collect();
    if equal.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let digits: Vec<f64> = tracks.iter().map(|track| digit(track)).collect();
    let chances: Vec<Option<f64>> =
        tracks.iter().zip(&digits).map(|(track, digit)| chance_of_a_repeat(track, *digit)).collect();
    let usual = aloft_signal::upper_median(&mut chances.iter().copied().flatten().collect::<Vec<f64>>());
    let steps = (tracks.len() * markers.n_frames) as f64;
    let held = |marker: usize| -> Vec<Range<usize>> {
        // a marker that is held from the first frame to the last has no scatter of its own
        let chance = if changes(&tracks[marker]).nth(WINDOW).is_some() { chances[marker] } else { usual };
        let unlikely = |n: usize| chance.is_some_and(|p| steps.ln() + 3.0 * n as f64 * p.ln() < BY_CHANCE.ln());
        let contradicts = |frames: &Range<usize>, near: &[Span]| contradicted(tracks, near, marker, frames);
        let near = OnceCell::new();
        equal[marker]
            .iter()
            .filter(|frames| {
                (unlikely(frames.len() - 1) && others_move(tracks, marker, frames))
                    || contradicts(frames, near.get_or_init(|| companions(tracks, &equal, &digits, marker)))
            })
            .cloned()
            .collect()
    };
    let all = (0..tracks.len()).filter(|marker| !equal[*marker].is_empty());
    all.map(|marker| (marker, held(marker))).filter(|(_, stretches)| !stretches.is_empty()).collect()
}

fn seen(p: &Vector3<f64>) -> bool {
    p.iter().all(|x| x.is_finite())
}

/// True if a frame has the position of the one before.
fn repeats(track: &[Vector3<f64>], frame: usize) -> bool {
    frame > 0 && track[frame] == track[frame - 1] && seen(&track[frame])
}

/// True if most of the other markers do not repeat in these frames.
fn others_move(tracks: &[Vec<Vector3<f64>>], marker: usize, frames: &Range<usize>) -> bool {
    let (mut repeated, mut all) = (0, 0);
    for (_, track) in tracks.iter().enumerate().filter(|(other, _)| *other != marker) {
        for frame in frames.start + 1..frames.end {
            if seen(&track[frame]) && seen(&track[frame - 1]) {
                all += 1;
                repeated += usize::from(repeats(track, frame));
            }
        }
    }
    2 * repeated < all
}

/// Changes of position from one frame to the next, without repeats.
fn changes(track: &[Vector3<f64>]) -> impl Iterator<Item = Vector3<f64>> + '_ {
    track.windows(2).map(|w| w[1] - w[0]).filter(|d| seen(d) && d.amax() > 0.0)
}

/// Step of the digits of a marker: the smallest change of a coordinate, in the coarsest axis.
/// Infinite where one never changes.
fn digit(track: &[Vector3<f64>]) -> f64 {
    let least = |axis: usize| changes(track).map(|d| d[axis].abs()).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    (0..3).map(least).fold(0.0, f64::max)
}

/// Largest probability, in any stretch, that a coordinate repeats, from changes of position in
/// which one or two of three coordinates do: of such changes the share `s = (p + p²)/(1 + p + p²)`
/// of coordinates repeats.
fn single_repeats(track: &[Vector3<f64>]) -> f64 {
    let counts: Vec<usize> = changes(track).map(|d| d.iter().filter(|x| **x == 0.0).count()).collect();
    let most = counts.chunks_exact(WINDOW).map(|c| c.iter().sum::<usize>()).max().unwrap_or(0);
    let share = (most as f64 / (3 * WINDOW) as f64).min(2.0 / 3.0);
    0.5 * ((1.0 + 4.0 * share / (1.0 - share)).sqrt() - 1.0)
}

/// Bound of the probability that a coordinate repeats where the marker rests, from its scatter in
/// its quietest stretch and the step of its digits; none where no scatter is seen.
fn chance_of_a_repeat(track: &[Vector3<f64>], digit: f64) -> Option<f64> {
    let (mut pairs, mut opposed) = (0usize, 0usize);
    let mut quietest = f64::INFINITY;
    let (mut before, mut recent): (Option<Vector3<f64>>, Vec<f64>) = (None, Vec::new());
    for frame in 3..track.len() {
        let usable = seen(&track[frame - 3]) && (frame - 2..=frame).all(|f| seen(&track[f]) && !repeats(track, f));
        if !usable {
            before = None;
            recent.clear();
            continue;
        }
        let third = track[frame] - track[frame - 3] - (track[frame - 1] - track[frame - 2]) * 3.0;
        if let Some(before) = before {
            pairs += 1;
            opposed += usize::from(before.dot(&third) < 0.0);
        }
        before = Some(third);
        recent.push(third.norm());
        if recent.len() == WINDOW {
            quietest = quietest.min(aloft_signal::median(&mut recent));
            recent.clear();
        }
    }
    // third differences of white noise turn back in three of four frames, those of movement go on
    let scatters = 2 * opposed > pairs;
    let deviation = quietest / MEDIAN_OF_THIRD;
    let by_noise = || QUIETER * digit / (deviation * std::f64::consts::TAU.sqrt());
    (scatters && quietest.is_finite() && deviation > 0.0 && digit.is_finite())
        .then(|| by_noise().max(single_repeats(track)).min(1.0))
}

/// Least and greatest distance to another marker.
struct Span {
    other: usize,
    low: f64,
    high: f64,
    /// Steps of the digits of both, by which rounding alone changes the distance.
    rounding: f64,
}

/// The distances of a marker to its companions in frames in which neither repeats, the steadiest
/// first.
fn companions(tracks: &[Vec<Vector3<f64>>], equal: &[Vec<Range<usize>>], digits: &[f64], marker: usize) -> Vec<Span> {
    let mut free: Vec<bool> = tracks[marker].iter().map(seen).collect();
    equal[marker].iter().for_each(|frames| free[frames.clone()].fill(false));
    let own = || tracks[marker].iter().zip(&free).filter(|(_, free)| **free).map(|(p, _)| p);
    let low = own().fold(Vector3::repeat(f64::INFINITY), |a, p| a.inf(p));
    let high = own().fold(Vector3::repeat(f64::NEG_INFINITY), |a, p| a.sup(p));
    let extent = (high - low).norm();
    let of = |other: usize| {
        let mut both = free.clone();
        equal[other].iter().for_each(|frames| both[frames.clone()].fill(false));
        let (mut low, mut high, mut n) = (f64::INFINITY, f64::NEG_INFINITY, 0);
        for frame in (0..both.len()).filter(|f| both[*f]) {
            let d = (tracks[marker][frame] - tracks[other][frame]).norm();
            if d.is_finite() {
                (low, high, n) = (low.min(d), high.max(d), n + 1);
            }
        }
        (n >= WINDOW && high - low < STEADY * extent).then_some(Span {
            other,
            low,
            high,
            rounding: digits[marker] + digits[other],
        })
    };
    let mut all: Vec<Span> = (0..tracks.len()).filter(|other| *other != marker).filter_map(of).collect();
    all.sort_by(|a, b| (a.high - a.low).total_cmp(&(b.high - b.low)));
    all.truncate(COMPANIONS);
    all
}

/// True if most companions are in these frames where the marker cannot be.
fn contradicted(tracks: &[Vec<Vector3<f64>>], companions: &[Span], marker: usize, frames: &Range<usize>) -> bool {
    let leaves = |span: &&Span| {
        let middle = 0.5 * (span.low + span.high);
        let distance = |f: usize| (tracks[marker][f] - tracks[span.other][f]).norm();
        frames.clone().any(|f| (distance(f) - middle).abs() > span.high - span.low + span.rounding)
    };
    let left = companions.iter().filter(leaves).count();
    left >= 2 && 2 * left > companions.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// Frames of the recordings, at 200 Hz.
    const FRAMES: usize = 600;

    /// A deterministic scatter, roughly normal, of unit deviation.
    fn scatter(seed: &mut u64) -> f64 {
        let mut uniform = || {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*seed >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    /// Two bodies of four markers: one rests for the first half and then tumbles, the other tumbles
    /// all the time. Noise in metres, stored in steps of `digit_m`.
    fn recording(noise_m: f64, digit_m: f64) -> Trial {
        let mut seed = 11;
        let corners = [[0.1, 0.0, 0.02], [-0.1, 0.03, 0.0], [0.0, 0.12, -0.02], [0.02, -0.1, 0.05]];
        let pose = |body: usize, frame: usize| {
            let t = match body {
                0 => frame.saturating_sub(FRAMES / 2) as f64 / 200.0,
                _ => frame as f64 / 200.0,
            };
            let turn = Rotation3::from_euler_angles(3.0 * (2.0 * t).sin(), 2.0 * (1.3 * t).sin(), 1.5 * t);
            (turn, Vector3::new(0.8 * body as f64 + 0.3 * (4.0 * t).sin(), 0.4 * (3.0 * t).sin(), 1.0 + 0.3 * t))
        };
        let mut labels = Vec::new();
        let mut trajectories = Vec::new();
        for body in 0..2 {
            for (k, corner) in corners.iter().enumerate() {
                labels.push(format!("b{body}m{k}"));
                let place = |frame: usize| {
                    let (turn, origin) = pose(body, frame);
                    origin + turn * Vector3::from_column_slice(corner)
                };
                let stored = |x: f64| if digit_m > 0.0 { (x / digit_m).round() * digit_m } else { x };
                let noise = |seed: &mut u64| Vector3::from_fn(|_, _| noise_m * scatter(seed));
                trajectories.push((0..FRAMES).map(|f| (place(f) + noise(&mut seed)).map(stored)).collect());
            }
        }
        let markers = Markers { rate_hz: 200.0, first_frame: 1, n_frames: FRAMES, labels, trajectories };
        Trial { markers, ..Trial::default() }
    }

    fn hold(trial: &mut Trial, marker: usize, frames: Range<usize>) {
        let track = &mut trial.markers.trajectories[marker];
        let held = track[frames.start];
        track[frames].fill(held);
    }

    /// Frames that are missing of each marker, and the warnings.
    fn missing(mut trial: Trial) -> (Vec<(usize, usize)>, Vec<String>) {
        frozen_to_missing(&mut trial);
        let count = |t: &Vec<Vector3<f64>>| t.iter().filter(|p| !seen(p)).count();
        let counts = trial.markers.trajectories.iter().map(count).enumerate().filter(|(_, n)| *n > 0).collect();
        (counts, trial.warnings.into_iter().map(|w| w.message).collect())
    }

    /// Digits of recordings: none (double precision), a micrometre, a tenth of a millimetre.
    const DIGITS: [f64; 3] = [0.0, 1e-6, 1e-4];

    #[test]
    fn what_is_measured_stays_whatever_its_noise_and_digits() {
        // without noise and with coarse digits the first body repeats for 1.5 s while the other
        // tumbles
        for noise in [0.0, 1e-5, 1e-4, 5e-4] {
            for digit in [0.0, 1e-6, 1e-5, 1e-4, 5e-4, 1e-3] {
                assert_eq!(missing(recording(noise, digit)), (Vec::new(), Vec::new()), "{noise} m, digits {digit} m");
            }
        }
    }

    #[test]
    fn a_marker_that_is_held_while_its_body_moves_is_missing_there() {
        for (noise, digit) in [0.0, 3e-4].into_iter().flat_map(|n| DIGITS.map(|d| (n, d))) {
            let mut trial = recording(noise, digit);
            hold(&mut trial, 5, 200..300);
            let (counts, words) = missing(trial);
            assert_eq!(counts, [(5, 100)], "{noise} m, digits {digit} m");
            let told = "marker `b1m1` repeats one position exactly in 100 frames, frames 201 to 300, while others move: it is missing there";
            assert_eq!(words, [told]);
        }
    }

    #[test]
    fn markers_held_together_or_at_an_end_are_missing_there() {
        for digit in DIGITS {
            let mut trial = recording(3e-4, digit);
            hold(&mut trial, 1, 400..500);
            hold(&mut trial, 2, 400..500);
            hold(&mut trial, 4, 0..60);
            hold(&mut trial, 7, FRAMES - 60..FRAMES);
            hold(&mut trial, 7, 100..110);
            let (counts, words) = missing(trial);
            assert_eq!(counts, [(1, 100), (2, 100), (4, 60), (7, 70)], "digits {digit} m");
            assert!(words[3].contains("in 70 frames in 2 stretches, the longest frames 541 to 600"), "{words:?}");
        }
    }

    /// With noise a held marker is known also where its body rests, and from the first frame to the
    /// last; without, a rest cannot be told from it, and does no harm.
    #[test]
    fn a_marker_that_is_held_at_rest_is_known_by_its_missing_noise() {
        let counts = |noise: f64, digit: f64, frames: Range<usize>| {
            let mut trial = recording(noise, digit);
            hold(&mut trial, 0, frames);
            missing(trial).0
        };
        assert_eq!(counts(3e-4, 0.0, 100..150), [(0, 50)]);
        assert_eq!(counts(3e-4, 1e-6, 100..150), [(0, 50)]);
        assert_eq!(counts(3e-4, 1e-4, 100..150), []);
        assert_eq!(counts(3e-4, 0.0, 0..FRAMES), [(0, FRAMES)]);
        assert_eq!(counts(0.0, 0.0, 100..150), []);
        assert_eq!(counts(1e-5, 1e-3, 100..150), []);
    }

    /// A tool on a table in digits of 0.05 mm, beside a person who moves, and then in the hand: it
    /// repeats for seconds.
    #[test]
    fn a_tool_that_rests_is_not_held() {
        for (noise, digit) in [(1e-5, 5e-5), (2e-5, 1e-4), (5e-6, 5e-5)] {
            let (mut trial, moving) = (recording(noise, digit), recording(2e-4, digit));
            for marker in 0..8 {
                let from = if marker < 4 { FRAMES / 2 } else { 0 };
                trial.markers.trajectories[marker][from..]
                    .copy_from_slice(&moving.markers.trajectories[marker][from..]);
            }
            assert_eq!(missing(trial), (Vec::new(), Vec::new()), "{noise} m, digits {digit} m");
        }
    }

    #[test]
    fn a_recording_that_repeats_as_a_whole_is_left_alone() {
        for frames in [0..FRAMES, 200..300] {
            let mut trial = recording(3e-4, 0.0);
            (0..8).for_each(|marker| hold(&mut trial, marker, frames.clone()));
            assert_eq!(missing(trial), (Vec::new(), Vec::new()));
        }
        assert_eq!(missing(Trial::default()), (Vec::new(), Vec::new()));
    }

    #[test]
    fn many_held_markers_are_counted() {
        let mut trial = recording(3e-4, 0.0);
        (0..8).for_each(|marker| hold(&mut trial, marker, 20 + 60 * marker..50 + 60 * marker));
        let (counts, words) = missing(trial);
        assert_eq!(counts.len(), 8);
        assert_eq!(words.len(), 5);
        assert_eq!(words[4], "4 more markers repeat positions in the same way in 120 frames: missing there");
    }
}
