//! Short sketches of the samples of a recording, by which recordings of the same motion are found:
//! one of the marker positions, one of the forces of the plates. Marker positions change with
//! another processing of the cameras or with added noise; the forces of the same recording stay.

use crate::{Markers, Plate};
use nalgebra::Vector3;

/// Number of samples in a sketch.
const LENGTH: usize = 256;
/// Resolution to which positions are compared, m: finer than cameras, coarser than the rounding of
/// formats.
const RESOLUTION_M: f64 = 1e-5;
/// Fewest samples in common that count.
const FEWEST: usize = 12;
/// Resolution to which forces are compared, N: finer than plates, coarser than the rounding of
/// formats.
const RESOLUTION_N: f64 = 0.01;
/// Successive samples of a plate that are compared as one. A single force may occur in any
/// recording by chance, since converters have coarse steps; a run of forces does not.
const RUN: usize = 8;
/// Force from which a plate counts as loaded, N. An unloaded plate shows only zeros or the noise of
/// its amplifier.
const LOADED_N: f64 = 20.0;

/// Sketch of the samples of a recording: the smallest hashes of all marker positions, ascending
/// (a bottom-k sketch; Cohen and Kaplan, Summarizing data using bottom-k sketches, PODC 2007).
/// Labels, times and order do not matter, so that a part of a recording, and a recording exported
/// again under other names, share its samples.
pub fn sample_sketch(markers: &Markers) -> Vec<u64> {
    let all = markers.trajectories.iter().flatten().filter(|p| p.iter().all(|x| x.is_finite()));
    smallest(all.map(|p| hash(&rounded(p, RESOLUTION_M))).collect())
}

/// Sketch of the forces of the plates of a recording, as [`sample_sketch`] of its markers: the
/// smallest hashes of all runs of successive forces on a loaded plate. Only runs without any force
/// that repeats count: a plate that is unloaded, clipped or loaded by a constant, or whose
/// converter resolves no change, shows runs that another recording has as well.
pub fn plate_sketch(plates: &[Plate]) -> Vec<u64> {
    let mut all = Vec::new();
    for plate in plates {
        let forces: Vec<Option<[u64; 3]>> = plate
            .force_n
            .iter()
            .map(|f| (f.iter().all(|x| x.is_finite()) && f.norm() > LOADED_N).then(|| rounded(f, RESOLUTION_N)))
            .collect();
        for run in forces.windows(RUN) {
            let repeats = || run.iter().enumerate().any(|(i, a)| run[..i].contains(a));
            if run.iter().all(Option::is_some) && !repeats() {
                all.push(run.iter().flatten().fold(0, |h, f| mixed(h ^ hash(f))));
            }
        }
    }
    smallest(all)
}

fn rounded(v: &Vector3<f64>, resolution: f64) -> [u64; 3] {
    [v.x, v.y, v.z].map(|x| ((x / resolution).round() as i64).cast_unsigned())
}

fn hash(numbers: &[u64; 3]) -> u64 {
    numbers.iter().fold(0, |h, x| mixed(h ^ x))
}

/// The smallest of these hashes, ascending, each once.
fn smallest(mut all: Vec<u64>) -> Vec<u64> {
    all.sort_unstable();
    all.dedup();
    all.truncate(LENGTH);
    all
}

/// Share of the samples of the shorter recording that are in the other one as well, estimated from
/// their sketches; `None` if too few could be compared.
pub fn share_in_common(a: &[u64], b: &[u64]) -> Option<f64> {
    // both sketches are complete up to the smaller of their largest hashes
    let end = |s: &[u64]| if s.len() < LENGTH { u64::MAX } else { s[LENGTH - 1] };
    let most = end(a).min(end(b));
    let below = |s: &[u64]| s.partition_point(|h| *h <= most);
    let (a, b) = (&a[..below(a)], &b[..below(b)]);
    let common = a.iter().filter(|h| b.binary_search(h).is_ok()).count();
    let fewer = a.len().min(b.len());
    (fewer >= FEWEST).then(|| common as f64 / fewer as f64)
}

/// A bijection of 64-bit numbers that spreads nearby ones (the finaliser of `SplitMix64`; Steele,
/// Lea and Flood, Fast splittable pseudorandom number generators, OOPSLA 2014).
fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Markers on circles, with a small deviation in every sample that depends on `seed`.
    fn recording(seed: u64, n_markers: usize, n_frames: usize) -> Markers {
        let at = |m: usize, t: usize| {
            let x = 0.01 * t as f64 + m as f64;
            let noise = |k: u64| mixed(seed ^ mixed((m * 100_000 + t) as u64 ^ (k << 40))) as f64 / u64::MAX as f64;
            Vector3::new(x.sin() + 3e-4 * noise(1), x.cos() + 3e-4 * noise(2), x + 3e-4 * noise(3))
        };
        Markers {
            rate_hz: 100.0,
            first_frame: 1,
            n_frames,
            labels: (0..n_markers).map(|m| format!("m{m}")).collect(),
            trajectories: (0..n_markers).map(|m| (0..n_frames).map(|t| at(m, t)).collect()).collect(),
        }
    }

    #[test]
    fn a_part_of_a_recording_shares_its_samples() {
        let whole = recording(1, 9, 1200);
        let mut part = whole.clone();
        part.n_frames = 200;
        for t in &mut part.trajectories {
            *t = t[300..500].to_vec();
        }
        part.trajectories.swap(0, 3);
        // another rounding, and a gap
        part.trajectories[1][20..40].fill(Vector3::repeat(f64::NAN));
        let share = share_in_common(&sample_sketch(&whole), &sample_sketch(&part)).unwrap();
        assert!(share > 0.95, "{share}");
    }

    #[test]
    fn the_same_motion_recorded_twice_shares_nothing() {
        let [a, b] = [1, 2].map(|seed| sample_sketch(&recording(seed, 9, 600)));
        assert_eq!(share_in_common(&a, &b), Some(0.0));
    }

    #[test]
    fn a_body_at_rest_has_few_samples() {
        let mut rest = recording(1, 9, 500);
        for t in &mut rest.trajectories {
            let first = t[0];
            t.fill(first);
        }
        assert_eq!(share_in_common(&sample_sketch(&rest), &sample_sketch(&rest.clone())), None);
    }

    /// A plate of 1000 Hz that is unloaded, then loaded, then unloaded; the noise of its amplifier
    /// depends on `seed`, and its converter has steps of `step_n`.
    fn plate(seed: u64, step_n: f64, load: impl Fn(usize) -> f64) -> Plate {
        let noise = |t: usize, k: u64| 4.0 * (mixed(seed ^ mixed(t as u64 ^ (k << 40))) as f64 / u64::MAX as f64 - 0.5);
        let at = |t: usize| {
            let force = Vector3::new(0.1 * load(t) + noise(t, 1), noise(t, 2), load(t) + noise(t, 3));
            force.map(|x| (x / step_n).round() * step_n)
        };
        Plate { name: "FP1".into(), rate_hz: 1000.0, force_n: (0..4000).map(at).collect(), ..Plate::default() }
    }

    fn stance(t: usize) -> f64 {
        if (1000..3000).contains(&t) { 700.0 + 400.0 * (0.01 * t as f64).sin() } else { 0.0 }
    }

    fn shared(a: &Plate, b: &Plate) -> Option<f64> {
        let of = |p: &Plate| plate_sketch(std::slice::from_ref(p));
        share_in_common(&of(a), &of(b))
    }

    #[test]
    fn a_part_of_a_plate_shares_its_samples() {
        let whole = plate(1, 0.15, stance);
        let mut part = whole.clone();
        part.force_n = part.force_n[1700..2200].iter().map(|f| f.map(|x| f64::from(x as f32))).collect();
        part.force_n[100..110].fill(Vector3::repeat(f64::NAN));
        let share = shared(&whole, &part).unwrap();
        assert!(share > 0.9, "{share}");
    }

    #[test]
    fn the_same_load_measured_twice_shares_nothing() {
        // the noise spans only four steps of this converter
        assert_eq!(shared(&plate(1, 1.0, stance), &plate(2, 1.0, stance)), Some(0.0));
        let standing = |_| 700.0;
        assert_eq!(shared(&plate(1, 0.15, standing), &plate(2, 0.15, standing)), Some(0.0));
    }

    #[test]
    fn a_plate_that_shows_no_motion_has_no_samples() {
        // unloaded; constant load; noise below the steps of the converter; clipped where it is
        // loaded
        let clipped = plate(1, 0.15, |t| if t % 2000 < 1000 { 0.0 } else { 9000.0 });
        let limit = |f: &Vector3<f64>| Vector3::new(0.0, 0.0, f.z.clamp(0.0, 5000.0));
        let clipped = Plate { force_n: clipped.force_n.iter().map(limit).collect(), ..clipped };
        let constant = Plate { force_n: vec![Vector3::new(0.0, 0.0, 650.0); 4000], ..Plate::default() };
        for (what, p) in [
            ("unloaded", plate(1, 0.15, |_| 0.0)),
            ("constant", constant),
            ("coarse", plate(1, 50.0, |_| 700.0)),
            ("clipped", clipped),
        ] {
            assert_eq!(plate_sketch(&[p]), Vec::<u64>::new(), "{what}");
        }
    }
}
