//! Inverse kinematics of synthetic trials with known motion.

mod common;

use aloft_ik::{IkError, IkOptions, solve};
use common::{chain, distance, motion, person, trial};
use nalgebra::Vector3;

#[test]
fn perfect_markers_give_the_motion_back() {
    for (subject, size) in [(person(), 0.4), (chain(), 2.0)] {
        let truth = motion(&subject, 300, 100.0, size, 1);
        let trial = trial(&subject, &truth, 100.0, 0.0, 1);
        let result = solve(&subject, &trial, &IkOptions::default()).unwrap();
        assert_eq!(result.report.n_unsolved, 0);
        let worst = (0..300).map(|f| distance(&subject, result.motion.q(f), &truth[f])).fold(0.0, f64::max);
        assert!(worst < 2e-5, "{}: largest coordinate error {worst:e}", subject.facts.name);
        assert!(result.report.max_m < 1e-6, "largest residual {:e} m", result.report.max_m);
    }
}

#[test]
fn chain_is_efficient_and_unbiased() {
    // White noise of known size: the mean error is zero, and the scatter of the errors matches the
    // covariance.
    let subject = chain();
    let n = 4000;
    let truth = motion(&subject, n, 200.0, 1.5, 2);
    let trial = trial(&subject, &truth, 200.0, 3e-4, 2);
    let result = solve(&subject, &trial, &IkOptions::default()).unwrap();
    let nv = subject.model.nv;
    let (mut mean, mut ratio) = (vec![0.0; nv], vec![0.0; nv]);
    let mut dv = vec![0.0; nv];
    for f in 0..n {
        subject.model.difference(&truth[f], result.motion.q(f), &mut dv);
        for i in 0..nv {
            let normed = dv[i] / result.motion.q_sd[f * nv + i];
            mean[i] += normed / n as f64;
            ratio[i] += normed * normed / n as f64;
        }
    }
    for i in 0..nv {
        assert!(mean[i].abs() < 0.06, "coordinate {i}: mean normed error {}", mean[i]);
        // 27 − 7 degrees of freedom behind each variance: E[t²] = 20/18
        assert!((ratio[i] - 20.0 / 18.0).abs() < 0.12, "coordinate {i}: variance ratio {}", ratio[i]);
    }
}

#[test]
fn full_turns_stay_continuous() {
    let subject = chain();
    let truth = motion(&subject, 600, 100.0, 6.0, 3);
    let trial = trial(&subject, &truth, 100.0, 3e-4, 3);
    let result = solve(&subject, &trial, &IkOptions::default()).unwrap();
    for f in 1..600 {
        let (a, b) = (result.motion.q(f - 1), result.motion.q(f));
        let dot: f64 = (3..7).map(|i| a[i] * b[i]).sum();
        assert!(dot > 0.0, "quaternion changes sign at frame {f}");
        assert!((truth[f][7] - b[7]).abs() < 0.05, "hinge at frame {f}: {} for {}", b[7], truth[f][7]);
    }
}

#[test]
fn missing_markers_drop_out_and_hopeless_frames_are_nan() {
    let subject = person();
    let truth = motion(&subject, 120, 100.0, 0.3, 4);
    let mut trial = trial(&subject, &truth, 100.0, 3e-4, 4);
    let nan = Vector3::repeat(f64::NAN);
    for f in 20..40 {
        for label in ["LASI", "RASI", "LTIB"] {
            let m = trial.markers.index(label).unwrap();
            trial.markers.trajectories[m][f] = nan;
        }
    }
    for f in 60..70 {
        // Only one hand remains.
        for m in 0..trial.markers.labels.len() {
            if !["LWRA", "LWRB", "LFIN"].contains(&trial.markers.labels[m].as_str()) {
                trial.markers.trajectories[m][f] = nan;
            }
        }
    }
    for trajectory in &mut trial.markers.trajectories {
        trajectory[100] = nan;
    }
    let result = solve(&subject, &trial, &IkOptions::default()).unwrap();
    assert_eq!(result.report.n_unsolved, 11);
    for f in 0..120 {
        let hopeless = (60..70).contains(&f) || f == 100;
        assert_eq!(result.motion.is_valid(f), !hopeless, "frame {f}");
        if !hopeless {
            let mut dv = vec![0.0; subject.model.nv];
            subject.model.difference(&truth[f], result.motion.q(f), &mut dv);
            for (i, d) in dv.iter().enumerate() {
                let sd = result.motion.q_sd[f * dv.len() + i];
                assert!(d.abs() < 7.0 * sd + 1e-4, "frame {f}, coordinate {i}: error {d}, sd {sd}");
            }
        }
    }
    let fit = result.report.markers.iter().find(|m| m.label == "LTIB").unwrap();
    assert_eq!(fit.n_missing, 31);
}

#[test]
fn regress_bent_elbow_does_not_flip() {
    // arms swing through straight; one marker on the upper arm, none on the forearm
    let subject = person();
    let truth = motion(&subject, 800, 200.0, 0.35, 5);
    let trial = trial(&subject, &truth, 200.0, 3e-3, 5);
    let result = solve(&subject, &trial, &IkOptions::default()).unwrap();
    for name in ["forearm_r", "forearm_l"] {
        let q = subject.model.links[subject.model.link_index(name).unwrap()].joint.q_offset;
        for f in 0..800 {
            let (found, expected) = (result.motion.q(f)[q], truth[f][q]);
            assert!(found > -0.1, "{name} frame {f}: {found} rad for {expected}");
        }
    }
}

#[test]
fn same_result_at_any_number_of_threads() {
    let subject = person();
    let truth = motion(&subject, 250, 100.0, 0.3, 6);
    let mut trial = trial(&subject, &truth, 100.0, 1e-3, 6);
    for (label, from) in [("LELB", 30), ("LTIB", 110), ("LANK", 115), ("RKNE", 128), ("RPSI", 200)] {
        let m = trial.markers.index(label).unwrap();
        trial.markers.trajectories[m][from..from + 20].fill(Vector3::repeat(f64::NAN));
    }
    let options = IkOptions { chunk_frames: 64, ..IkOptions::default() };
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solve(&subject, &trial, &options).unwrap())
    };
    let (one, four) = (run(1), run(4));
    assert_eq!(one.motion.q, four.motion.q);
    // The sequences agree with a single one to the tolerance of the minimisation.
    let whole = solve(&subject, &trial, &IkOptions::default()).unwrap();
    for f in 0..250 {
        assert!(distance(&subject, one.motion.q(f), whole.motion.q(f)) < 1e-4, "frame {f}");
    }
}

/// A hinge that turns three times while the recording is solved in pieces, each of which begins at
/// the posture at rest: its angle goes on over the boundaries, and through a gap.
#[test]
fn the_angle_of_a_hinge_that_turns_many_times_is_continuous() {
    let subject = chain();
    let q = subject.model.links[1].joint.q_offset;
    let mut truth = motion(&subject, 250, 100.0, 0.3, 9);
    let turned = |f: usize| 0.5 + 3.0 * std::f64::consts::TAU * f as f64 / 250.0;
    truth.iter_mut().enumerate().for_each(|(f, x)| x[q] = turned(f));
    let mut trial = trial(&subject, &truth, 100.0, 3e-4, 9);
    for trajectory in &mut trial.markers.trajectories {
        trajectory[100..104].fill(Vector3::repeat(f64::NAN));
    }
    let options = IkOptions { chunk_frames: 64, warm_up_frames: 10, ..IkOptions::default() };
    let found = solve(&subject, &trial, &options).unwrap().motion;
    let valid: Vec<usize> = (0..250).filter(|f| found.is_valid(*f)).collect();
    assert!(valid.len() > 240);
    let apart = |f: usize| found.q(f)[q] - turned(f);
    let turns = apart(0) / std::f64::consts::TAU;
    assert!((turns - turns.round()).abs() < 0.01, "{turns}");
    for f in valid {
        assert!((apart(f) - apart(0)).abs() < 0.05, "frame {f}: {} rad for {}", found.q(f)[q], turned(f));
    }
}

#[test]
fn locked_coordinates_stay() {
    let subject = person();
    let truth = motion(&subject, 30, 100.0, 0.2, 7);
    let trial = trial(&subject, &truth, 100.0, 0.0, 7);
    let head = &subject.model.links[subject.model.link_index("head").unwrap()].joint;
    let knee = &subject.model.links[subject.model.link_index("shank_r").unwrap()].joint;
    let locked = vec![head.v_offset, head.v_offset + 1, head.v_offset + 2, knee.v_offset];
    let result = solve(&subject, &trial, &IkOptions { locked, ..IkOptions::default() }).unwrap();
    for f in 0..30 {
        let q = result.motion.q(f);
        for i in 0..4 {
            assert!((q[head.q_offset + i] - subject.static_q[head.q_offset + i]).abs() < 1e-12);
        }
        assert_eq!(q[knee.q_offset], subject.static_q[knee.q_offset]);
        assert_eq!(result.motion.q_sd[f * subject.model.nv + knee.v_offset], 0.0);
    }
}

#[test]
fn unseen_coordinates_rest() {
    let mut subject = person();
    subject.markers.retain(|m| !m.label.ends_with("HD"));
    let truth = motion(&subject, 50, 100.0, 0.3, 8);
    let trial = trial(&subject, &truth, 100.0, 1e-3, 8);
    let result = solve(&subject, &trial, &IkOptions::default()).unwrap();
    let head = subject.model.links[subject.model.link_index("head").unwrap()].joint;
    for f in 0..50 {
        let q = &result.motion.q(f)[head.q_offset..head.q_offset + 4];
        let rest = &subject.static_q[head.q_offset..head.q_offset + 4];
        let dot: f64 = q.iter().zip(rest).map(|(a, b)| a * b).sum();
        assert!(dot.abs() > 1.0 - 1e-9);
        assert!(result.motion.q_sd[f * subject.model.nv + head.v_offset] > 1.0);
    }
}

#[test]
fn regress_misfits_are_errors_with_names() {
    let subject = person();
    let truth = motion(&subject, 5, 100.0, 0.1, 9);
    let mut trial = trial(&subject, &truth, 100.0, 0.0, 9);
    for label in &mut trial.markers.labels {
        label.push('x');
    }
    assert!(matches!(solve(&subject, &trial, &IkOptions::default()), Err(IkError::TooFewMarkers { found: 0, .. })));
    let bad = IkOptions { locked: vec![40], ..IkOptions::default() };
    assert!(matches!(solve(&subject, &trial, &bad), Err(IkError::Mismatch { .. })));
    let bad = IkOptions { marker_sd_m: 0.0, ..IkOptions::default() };
    assert!(matches!(solve(&subject, &trial, &bad), Err(IkError::Option { option: "marker_sd_m", .. })));
    let empty = aloft_trial::Trial { markers: aloft_trial::Markers::default(), ..trial.clone() };
    assert!(solve(&subject, &empty, &IkOptions::default()).is_err());
}

#[test]
fn a_short_gap_leaves_no_step() {
    // Markers are a few millimetres off their model positions, as on soft tissue; some are missing
    // for a tenth of a second.
    let subject = person();
    let truth = motion(&subject, 200, 200.0, 0.3, 10);
    let mut worn = subject.clone();
    for (i, marker) in worn.markers.iter_mut().enumerate() {
        let x = i as f64;
        marker.position_m += Vector3::new(x.sin(), (2.0 * x).sin(), (3.0 * x).sin()) * 4e-3;
    }
    let whole = trial(&worn, &truth, 200.0, 1e-4, 10);
    let mut gappy = whole.clone();
    for (label, from) in [("LELB", 30), ("RELB", 100), ("LTIB", 110), ("RKNE", 60), ("LASI", 150)] {
        let m = gappy.markers.index(label).unwrap();
        gappy.markers.trajectories[m][from..from + 20].fill(Vector3::repeat(f64::NAN));
    }
    let expected = solve(&subject, &whole, &IkOptions::default()).unwrap().motion;
    let worst = |options: &IkOptions| {
        let result = solve(&subject, &gappy, options).unwrap();
        (0..200).map(|f| distance(&subject, result.motion.q(f), expected.q(f))).fold(0.0, f64::max)
    };
    let bridged = worst(&IkOptions::default());
    let open = worst(&IkOptions { bridge_gaps_s: 0.0, ..IkOptions::default() });
    assert!(bridged < 0.03, "bridged gaps still move coordinates by {bridged} rad");
    assert!(open > 3.0 * bridged, "without bridging {open} rad, with it {bridged} rad");
    let report = solve(&subject, &gappy, &IkOptions::default()).unwrap().report;
    assert_eq!(report.n_bridged, 90);
    assert_eq!(report.markers.iter().map(|m| m.n_missing).sum::<usize>(), 100);
}

/// Several markers of one leg are missing at the same time while it moves fast: the motion across
/// the gaps must be as good as smoothness and the other markers allow, with accelerations of the
/// size that noise alone causes.
#[test]
fn several_missing_markers_of_a_limb_leave_its_motion_smooth() {
    let subject = person();
    let truth = motion(&subject, 200, 200.0, 0.5, 11);
    let whole = trial(&subject, &truth, 200.0, 5e-4, 11);
    let mut gappy = whole.clone();
    let gaps =
        [("LKNE", 60, 88), ("LTIB", 80, 92), ("LHEE", 50, 85), ("LANK", 90, 110), ("RELB", 120, 150), ("C7", 95, 130)];
    for (label, from, to) in gaps {
        let m = gappy.markers.index(label).unwrap();
        gappy.markers.trajectories[m][from..to].fill(Vector3::repeat(f64::NAN));
    }
    let error = |trial: &aloft_trial::Trial| {
        let motion = solve(&subject, trial, &IkOptions::default()).unwrap().motion;
        let mut dv = vec![0.0; subject.model.nv];
        let errors: Vec<Vec<f64>> = (0..200)
            .map(|f| {
                subject.model.difference(&truth[f], motion.q(f), &mut dv);
                dv.clone()
            })
            .collect();
        // second differences over 0.05 s, to which forces over windows are sensitive
        let second = |f: usize, j: usize| errors[f - 10][j] - 2.0 * errors[f][j] + errors[f + 10][j];
        let squares = (50..150).flat_map(|f| (0..dv.len()).map(move |j| (f, j))).map(|(f, j)| second(f, j).powi(2));
        (squares.sum::<f64>() / (100.0 * dv.len() as f64)).sqrt()
    };
    let (complete, bridged) = (error(&whole), error(&gappy));
    println!("second differences of errors: {complete:.2e} rad without gaps, {bridged:.2e} rad with gaps");
    assert!(bridged < 1.2 * complete, "with gaps {bridged} rad, without {complete} rad");
}

/// Markers of one foot are recorded upside down for the first frames (as a bad reconstruction gives
/// them), then right: the foot stays on the wrong branch unless it is turned to its markers.
#[test]
fn a_segment_on_a_wrong_branch_is_turned_to_its_markers() {
    let mut person = person();
    // three markers on the foot that lie nearly in a plane with its long axis
    let foot = person.model.links.iter().position(|l| l.name == "foot_l").unwrap();
    person.markers.retain(|m| m.link != foot);
    for (label, at) in [
        ("F1", [0.02, -0.03, 0.02]),
        ("F2", [0.15, -0.05, 0.03]),
        ("F3", [0.14, -0.05, -0.04]),
        ("F4", [-0.05, -0.04, 0.0]),
    ] {
        person.markers.push(aloft_body::ModelMarker {
            label: label.into(),
            link: foot,
            position_m: at.into(),
            weight: 1.0,
        });
    }
    let motion = motion(&person, 60, 200.0, 0.15, 3);
    let mut trial = trial(&person, &motion, 200.0, 0.0005, 4);
    let mut state = aloft_body::State::new(&person.model);
    for (frame, q) in motion.iter().enumerate().take(20) {
        state.forward_position(&person.model, q);
        for m in person.markers.iter().filter(|m| m.link == foot) {
            let over = Vector3::new(-m.position_m.x, m.position_m.y, -m.position_m.z);
            let index = trial.markers.index(&m.label).unwrap();
            trial.markers.trajectories[index][frame] = state.point_in_world(foot, &over);
        }
    }
    let found = solve(&person, &trial, &IkOptions::default()).unwrap();
    for (frame, q) in motion.iter().enumerate().skip(20) {
        let off = distance(&person, found.motion.q(frame), q);
        assert!(off < 0.1, "frame {frame}: {off} rad");
    }
    // while it was upside down, the report says so
    let beyond = found.report.beyond_range.iter().find(|b| b.link == "foot_l").unwrap();
    assert!(beyond.n_frames >= 18 && beyond.n_frames <= 22 && beyond.worst_deg > 60.0, "{beyond:?}");
    assert!(found.report.beyond_range.iter().all(|b| b.link == "foot_l"), "{:?}", found.report.beyond_range);
}
