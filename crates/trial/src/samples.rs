//! A short sketch of the samples of a recording, by which recordings of the same motion are found.

use crate::Markers;

/// Number of samples in a sketch.
const LENGTH: usize = 256;
/// Resolution to which positions are compared, m: finer than cameras, coarser than the rounding of
/// formats.
const RESOLUTION_M: f64 = 1e-5;
/// Fewest samples in common that count.
const FEWEST: usize = 12;

/// Sketch of the samples of a recording: the smallest hashes of all marker positions, ascending
/// (a bottom-k sketch; Cohen and Kaplan, Summarizing data using bottom-k sketches, PODC 2007).
/// Labels, times and order do not matter, so that a part of a recording, and a recording exported
/// again under other names, share its samples.
pub fn sample_sketch(markers: &Markers) -> Vec<u64> {
    let mut all: Vec<u64> = markers
        .trajectories
        .iter()
        .flatten()
        .filter(|p| p.iter().all(|x| x.is_finite()))
        .map(|p| p.iter().fold(0, |h, x| mixed(h ^ ((x / RESOLUTION_M).round() as i64).cast_unsigned())))
        .collect();
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
    use nalgebra::Vector3;

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
}
