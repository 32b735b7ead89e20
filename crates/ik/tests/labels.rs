//! Labels on other markers than in the static trial: found by the shape of segments, exchanged
//! back.
#![allow(clippy::unwrap_used, reason = "helpers of tests, not library code")]

mod common;

use aloft_body::{ModelMarker, Subject};
use aloft_ik::{IkOptions, exchange_labels, label_exchanges, solve};
use aloft_trial::Trial;
use nalgebra::Vector3;

/// The person with a cluster on one thigh; `places` in the thigh's frame.
fn with_cluster(places: &[[f64; 3]]) -> Subject {
    let mut person = common::person();
    let thigh = person.model.links.iter().position(|l| l.name == "thigh_r").unwrap();
    person.markers.retain(|m| m.link != thigh);
    for (i, at) in places.iter().enumerate() {
        person.markers.push(ModelMarker {
            label: format!("T{i}"),
            link: thigh,
            position_m: Vector3::from(*at),
            weight: 1.0,
        });
    }
    person
}

fn swapped(trial: &Trial, pairs: &[(&str, &str)], frames: std::ops::Range<usize>) -> Trial {
    let mut out = trial.clone();
    for (a, b) in pairs {
        let (a, b) = (trial.markers.index(a).unwrap(), trial.markers.index(b).unwrap());
        for f in frames.clone() {
            out.markers.trajectories[a][f] = trial.markers.trajectories[b][f];
            out.markers.trajectories[b][f] = trial.markers.trajectories[a][f];
        }
    }
    out
}

const CLUSTER: [[f64; 3]; 5] =
    [[0.05, -0.1, 0.06], [0.03, -0.25, 0.07], [-0.04, -0.12, 0.05], [0.06, -0.3, 0.0], [0.0, -0.4, 0.06]];

#[test]
fn labels_exchanged_in_a_trial_or_a_part_of_it_are_found_and_exchanged_back() {
    let person = with_cluster(&CLUSTER);
    let motion = common::motion(&person, 300, 100.0, 0.3, 1);
    // soft tissue and noise of some millimetres
    let clean = common::trial(&person, &motion, 100.0, 0.003, 2);
    assert!(label_exchanges(&person, &clean).is_empty());
    for (pairs, frames) in [
        (vec![("T0", "T3")], 0..300),
        (vec![("T0", "T1"), ("T2", "T4")], 0..300),
        (vec![("T1", "T2")], 120..300),
        (vec![("T3", "T4")], 0..90),
    ] {
        let mut bad = swapped(&clean, &pairs, frames.clone());
        let found = label_exchanges(&person, &bad);
        assert_eq!(found.len(), 1, "{pairs:?}: {found:?}");
        assert!(found[0].start.abs_diff(frames.start) <= 2 && found[0].end.abs_diff(frames.end) <= 2, "{found:?}");
        assert_eq!(found[0].labels.len(), 2 * pairs.len());
        assert!(found[0].to_string().contains(&format!("`{}` and `{}`", pairs[0].0, pairs[0].1)), "{}", found[0]);
        exchange_labels(&mut bad, &found);
        let same = clean.markers.trajectories.iter().zip(&bad.markers.trajectories);
        let wrong: usize = same.map(|(a, b)| a.iter().zip(b).filter(|(p, q)| p != q).count()).sum();
        assert!(wrong <= 4 * 4, "{pairs:?}: {wrong}");
    }
}

#[test]
fn a_cluster_that_is_symmetric_is_decided_by_its_neighbour() {
    // turned by half a revolution about the long axis it fits within 5 mm
    let places = [[0.05, -0.15, 0.06], [-0.05, -0.15, -0.063], [0.052, -0.3, 0.061], [-0.05, -0.302, -0.06]];
    let person = with_cluster(&places);
    let motion = common::motion(&person, 200, 100.0, 0.25, 5);
    let clean = common::trial(&person, &motion, 100.0, 0.0007, 6);
    assert!(label_exchanges(&person, &clean).is_empty());
    let mut bad = swapped(&clean, &[("T0", "T1"), ("T2", "T3")], 0..200);
    let found = label_exchanges(&person, &bad);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].before_m < 0.01 && (found[0].start, found[0].end) == (0, 200), "{found:?}");
    exchange_labels(&mut bad, &found);
    let solved = solve(&person, &bad, &IkOptions::default()).unwrap();
    let off = (0..200).map(|f| common::distance(&person, solved.motion.q(f), &motion[f])).fold(0.0, f64::max);
    assert!(off < 0.2, "{off}");
}

#[test]
fn labels_on_markers_of_other_segments_are_found_by_the_whole_body() {
    let person = common::person();
    let motion = common::motion(&person, 120, 100.0, 0.3, 1);
    let clean = common::trial(&person, &motion, 100.0, 0.003, 2);
    assert!(label_exchanges(&person, &clean).is_empty());
    let labels = || person.markers.iter().map(|m| m.label.clone());
    let right =
        |label: &String| labels().find(|l| l[1..] == label[1..] && l.starts_with('R') && label.starts_with('L'));
    let sides: Vec<(String, String)> = labels().filter_map(|l| Some((l.clone(), right(&l)?))).collect();
    for pairs in [
        // a leg without its foot, a foot back to front, an arm, knee and ankle
        vec![("LTHI", "RTHI"), ("LKNE", "RKNE"), ("LTIB", "RTIB"), ("LANK", "RANK")],
        vec![("RHEE", "RTOE")],
        vec![("LELB", "RELB"), ("LWRA", "RWRA"), ("LWRB", "RWRB"), ("LFIN", "RFIN")],
        vec![("RKNE", "RANK")],
        // two markers of a hand's side that are near each other
        vec![("LWRA", "LWRB")],
        // the whole body, left for right
        sides.iter().map(|(a, b)| (a.as_str(), b.as_str())).collect(),
    ] {
        let bad = swapped(&clean, &pairs, 0..120);
        let found = label_exchanges(&person, &bad);
        let mut right = bad.clone();
        exchange_labels(&mut right, &found);
        assert!(right.markers.trajectories == clean.markers.trajectories, "{pairs:?}: {found:?}");
        assert_eq!(found.len(), 1, "{pairs:?}: {found:?}");
        assert_eq!((found[0].start, found[0].end), (0, 120));
    }
}
