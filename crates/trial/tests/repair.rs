//! Gaps, spikes, swaps and quality on a synthetic segment with known truth.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

use aloft_trial::{
    ArtefactOptions, FillMethod, FindingKind, GapOptions, QualityOptions, QualityReason, Trial, assess, fill_gaps,
    fill_gaps_with_poses, find_artefacts,
};
use nalgebra::{Isometry3, Vector3};

const N: usize = 300;
const LOCAL: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.2, 0.01, 0.0], [0.05, 0.12, 0.03], [0.1, -0.05, 0.09]];

fn pose(frame: usize) -> Isometry3<f64> {
    let t = frame as f64 / 200.0;
    Isometry3::new(
        Vector3::new(0.4 * (3.0 * t).sin(), 0.3 * t, 1.0 + 0.5 * t - 0.5 * 9.81 * t * t * 0.2),
        Vector3::new(1.5 * (2.0 * t).sin(), 3.0 * t, 0.4),
    )
}

/// Uniform noise of standard deviation `sd` from a fixed sequence.
fn noise(seed: u64, sd: f64) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(0xD1B5_4A32_D192_ED03);
    x ^= x >> 30;
    x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x ^= x >> 27;
    x = x.wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^= x >> 31;
    ((x >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12.0_f64.sqrt() * sd
}

/// A rigid segment whose first marker moves with soft tissue.
fn segment(sd: f64) -> (Trial, Vec<Vec<String>>) {
    let labels: Vec<String> = ["A", "B", "C", "D"].map(str::to_owned).to_vec();
    let mut trial = Trial { name: "made".to_owned(), ..Trial::default() };
    trial.markers.rate_hz = 200.0;
    trial.markers.n_frames = N;
    trial.markers.labels = labels.clone();
    trial.markers.trajectories = LOCAL
        .iter()
        .enumerate()
        .map(|(marker, local)| {
            (0..N)
                .map(|frame| {
                    let mut p = Vector3::from(*local);
                    if marker == 0 {
                        p.x += 0.01 * (frame as f64 / 60.0).sin();
                    }
                    let clean = pose(frame).transform_point(&p.into()).coords;
                    clean + Vector3::from_fn(|axis, _| noise((marker * 100_000 + frame * 10 + axis) as u64, sd))
                })
                .collect()
        })
        .collect();
    (trial, vec![labels])
}

#[test]
fn rigid_fill_follows_segment_and_soft_tissue() {
    let (truth, _) = segment(0.0);
    let (mut trial, segments) = segment(0.0003);
    let gaps = [(0, 100, 140), (1, 0, 20), (2, 250, 258), (3, 180, 290)];
    for (marker, from, to) in gaps {
        trial.markers.trajectories[marker][from..to].fill(Vector3::repeat(f64::NAN));
    }
    let fills = fill_gaps(&mut trial, &segments, &GapOptions::default());
    assert_eq!(fills.len(), 3);
    for fill in &fills {
        let marker = trial.markers.index(&fill.marker).unwrap();
        let worst = (fill.first_frame..=fill.last_frame)
            .map(|f| (trial.markers.trajectories[marker][f] - truth.markers.trajectories[marker][f]).norm())
            .fold(0.0, f64::max);
        // At the end of a recording the displacement of the soft tissue is unknown.
        let limit = if fill.first_frame == 0 { 0.006 } else { 0.002 };
        assert!(worst < limit, "{fill:?}: {worst}");
    }
    // Marker D was missing together with C, so C has only two other markers; the gap is short
    // enough for a cubic.
    assert_eq!(fills[2].method, FillMethod::Cubic);
    assert_eq!(fills[0].method, FillMethod::RigidBody { mates: 3 });
    // The long gap stays missing.
    assert!(trial.markers.position(3, 200).is_none());
}

#[test]
fn model_fill_interpolates_the_residual() {
    let (truth, _) = segment(0.0);
    let (mut trial, _) = segment(0.0);
    trial.markers.trajectories[0][50..90].fill(Vector3::repeat(f64::NAN));
    let poses: Vec<_> = (0..N).map(pose).collect();
    let fills = fill_gaps_with_poses(&mut trial, &[("A".to_owned(), &poses)], &GapOptions::default());
    assert_eq!((fills.len(), fills[0].method), (1, FillMethod::Model));
    let worst = (50..90)
        .map(|f| (trial.markers.trajectories[0][f] - truth.markers.trajectories[0][f]).norm())
        .fold(0.0, f64::max);
    assert!(worst < 0.0008, "{worst}");
}

#[test]
fn spikes_and_swaps_are_found_and_only_repaired_when_asked() {
    let (mut trial, segments) = segment(0.0003);
    let clean = trial.clone();
    trial.markers.trajectories[1][60] += Vector3::new(0.03, 0.0, 0.0);
    trial.markers.trajectories[2][120..123].iter_mut().for_each(|p| p.z += 0.08);
    let (a, b) = (clean.markers.trajectories[0].clone(), clean.markers.trajectories[3].clone());
    trial.markers.trajectories[0][200..230].copy_from_slice(&b[200..230]);
    trial.markers.trajectories[3][200..230].copy_from_slice(&a[200..230]);

    let mut broken = trial.clone();
    let found = find_artefacts(&mut trial, &segments, &ArtefactOptions::default());
    assert_eq!(trial.markers.labels, broken.markers.labels);
    // exchanged markers are missing; everything else stays
    for marker in 0..4 {
        for frame in 0..N {
            let at = trial.markers.trajectories[marker][frame];
            let left_out = (marker == 0 || marker == 3) && (200..230).contains(&frame);
            assert!(if left_out { at.x.is_nan() } else { at == broken.markers.trajectories[marker][frame] });
        }
    }
    let seen: Vec<_> = found.iter().map(|f| (f.marker.as_str(), f.first_frame, f.last_frame)).collect();
    assert_eq!(seen[0], ("A", 200, 229), "{found:?}");
    assert_eq!(found[0].kind, FindingKind::Swap { with: "D".to_owned() });
    assert!(seen.contains(&("B", 60, 60)) && seen.contains(&("C", 120, 122)), "{found:?}");

    std::mem::swap(&mut trial, &mut broken);
    let options = ArtefactOptions { repair: true, ..ArtefactOptions::default() };
    let found = find_artefacts(&mut trial, &segments, &options);
    assert!(found.iter().all(|f| f.repaired));
    let fills = fill_gaps(&mut trial, &segments, &GapOptions::default());
    for marker in 0..4 {
        for frame in 0..N {
            let off = trial.markers.trajectories[marker][frame] - clean.markers.trajectories[marker][frame];
            assert!(off.norm() < 0.002, "{marker} {frame} {off}");
        }
    }
    let quality = assess(&trial, None, &fills, &found, &QualityOptions::default());
    assert_eq!(quality.markers[2].filled_frames, 3);
    assert_eq!((quality.markers[2].gaps, quality.markers[2].spikes), (1, 1));
    assert!(quality.reasons.iter().any(|r| matches!(r, QualityReason::LabelSwap { .. })));
}

/// Two segments that turn against each other, as shanks do: markers of one carry the labels of the
/// other for a while.
#[test]
fn a_swap_between_two_segments_is_found() {
    let (mut trial, segments) = segment(0.0003);
    let other = trial.clone();
    for (label, track) in other.markers.labels.iter().zip(&other.markers.trajectories) {
        trial.markers.labels.push(format!("{label}2"));
        let turned = track.iter().map(|p| Vector3::new(-p.y, p.x, p.z + 0.02) + Vector3::new(0.3, 0.1, 0.0));
        trial.markers.trajectories.push(turned.collect());
    }
    let segments = vec![segments[0].clone(), segments[0].iter().map(|l| format!("{l}2")).collect()];
    let clean = trial.clone();
    let (a, b) = (clean.markers.trajectories[1].clone(), clean.markers.trajectories[6].clone());
    trial.markers.trajectories[1][80..180].copy_from_slice(&b[80..180]);
    trial.markers.trajectories[6][80..180].copy_from_slice(&a[80..180]);
    let options = ArtefactOptions { repair: true, ..ArtefactOptions::default() };
    let found = find_artefacts(&mut trial, &segments, &options);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((found[0].marker.as_str(), found[0].first_frame, found[0].last_frame), ("B", 80, 179));
    assert_eq!(found[0].kind, FindingKind::Swap { with: "C2".to_owned() });
    assert!(trial.markers.trajectories == clean.markers.trajectories);
}

#[test]
fn clean_motion_gives_no_finding_and_noise_is_measured() {
    for sd in [0.0001, 0.0003, 0.001] {
        let (mut trial, segments) = segment(sd);
        let found = find_artefacts(&mut trial, &segments, &ArtefactOptions::default());
        assert!(found.is_empty(), "{found:?}");
        let quality = assess(&trial, None, &[], &found, &QualityOptions::default());
        for marker in &quality.markers {
            // Fourth differences of uniform noise are close to normal.
            assert!((marker.noise_rms_m / sd - 1.0).abs() < 0.2, "{sd} {}", marker.noise_rms_m);
            assert_eq!(marker.present_fraction, 1.0);
        }
    }
}

#[test]
fn regress_reasons_of_broken_trials() {
    let (mut trial, _) = segment(0.0);
    for track in &mut trial.markers.trajectories {
        track.fill(Vector3::repeat(f64::NAN));
    }
    let options = QualityOptions { plates_expected: true, ..QualityOptions::default() };
    let quality = assess(&trial, None, &[], &[], &options);
    let words: Vec<String> = quality.reasons.iter().map(ToString::to_string).collect();
    assert_eq!(words, ["no marker is visible in any frame", "no force plates"]);
    let fills = fill_gaps(&mut trial, &[], &GapOptions::default());
    assert!(fills.is_empty());
}
