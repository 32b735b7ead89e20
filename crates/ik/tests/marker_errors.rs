//! Marker errors estimated from residuals against known errors: their size and their effect on
//! poses.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use aloft_body::{Motion, State, Subject};
use aloft_ik::{IkOptions, MarkerErrors, Segments, solve};
use aloft_trial::Trial;
use common::{chain, distance, motion, person, trial};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 200.0;
const N: usize = 600;
/// Lag, in frames, of the second difference to which windows of 0.3 s are sensitive.
const LAG: usize = 15;

/// Displaces every marker in its link's axes by its own smooth function of time, `size_m` root mean
/// square per axis.
fn slide(subject: &Subject, truth: &[Vec<f64>], made: &mut Trial, size_m: f64, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut state = State::new(&subject.model);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let waves: Vec<[[f64; 4]; 3]> =
        subject.markers.iter().map(|_| [(); 3].map(|()| [normal(), normal(), normal(), normal()])).collect();
    for (f, q) in truth.iter().enumerate() {
        state.forward_position(&subject.model, q);
        let t = f as f64 / RATE_HZ;
        for ((marker, waves), path) in subject.markers.iter().zip(&waves).zip(&mut made.markers.trajectories) {
            let shift = Vector3::from_fn(|i, _| {
                let [a, b, c, d] = waves[i];
                size_m * (a * (12.0 * t).sin() + b * (12.0 * t).cos() + c * (25.0 * t).sin() + d * (25.0 * t).cos())
                    / 2f64.sqrt()
            });
            path[f] += state.rotation(marker.link) * shift;
        }
    }
}

/// Root mean square of the second difference of an error of the links' origins, over all links.
fn band(subject: &Subject, a: &dyn Fn(usize) -> Vec<f64>, b: &dyn Fn(usize) -> Vec<f64>) -> f64 {
    let mut state = State::new(&subject.model);
    let errors: Vec<Vec<Vector3<f64>>> = (0..N)
        .map(|f| {
            state.forward_position(&subject.model, &a(f));
            let first: Vec<_> = state.world_from_link.iter().map(|p| p.translation.vector).collect();
            state.forward_position(&subject.model, &b(f));
            state.world_from_link.iter().zip(first).map(|(p, x)| p.translation.vector - x).collect()
        })
        .collect();
    let mut sum = 0.0;
    for f in 0..N - 2 * LAG {
        for l in 0..subject.model.n_links() {
            sum += (errors[f][l] - 2.0 * errors[f + LAG][l] + errors[f + 2 * LAG][l]).norm_squared();
        }
    }
    (sum / ((N - 2 * LAG) * subject.model.n_links()) as f64).sqrt()
}

#[test]
fn drawn_errors_move_poses_as_real_ones_do() {
    for (name, subject, noise_m, soft_m) in [
        ("chain, noise", chain(), 5e-4, 0.0),
        ("person, noise", person(), 1e-3, 0.0),
        ("person, soft tissue", person(), 1e-4, 3e-3),
        ("person, both", person(), 5e-4, 2e-3),
    ] {
        let (mut real, mut drawn, mut size) = (0.0f64, 0.0f64, 0.0f64);
        for seed in 0..3 {
            let truth = motion(&subject, N, RATE_HZ, 0.4, 100 + seed);
            let mut made = trial(&subject, &truth, RATE_HZ, noise_m, 200 + seed);
            slide(&subject, &truth, &mut made, soft_m, 300 + seed);
            let solved = solve(&subject, &made, &IkOptions::default()).unwrap().motion;
            let errors = MarkerErrors::of(&subject, &made, &solved, &IkOptions::default()).unwrap().unwrap();
            let sizes: Vec<f64> = errors.sizes_m().map(|(_, s)| s * s).collect();
            size += sizes.iter().sum::<f64>() / sizes.len() as f64 / 3.0;
            let at = |m: &Motion, f: usize| m.q(f).to_vec();
            real += band(&subject, &|f| truth[f].clone(), &|f| at(&solved, f)).powi(2) / 3.0;
            for draw in 0..4 {
                let again = errors.draw(&solved, &|_| true, 1, draw);
                drawn += band(&subject, &|f| at(&solved, f), &|f| at(&again, f)).powi(2) / 12.0;
            }
        }
        // second differences over six: white noise keeps its variance, a sine of ω has 16 sin⁴(ω
        // lag/2) / 6
        let of_wave = |omega: f64| 16.0 * (0.5 * omega * LAG as f64 / RATE_HZ).sin().powi(4) / 6.0;
        let put_in = (noise_m.powi(2) + soft_m.powi(2) * 0.5 * (of_wave(12.0) + of_wave(25.0))).sqrt();
        let (size, ratio) = (size.sqrt() / put_in, (drawn / real).sqrt());
        println!("{name}: size of the errors {size:.3} of what was put in, poses {ratio:.3} of the true errors");
        assert!((0.85..1.18).contains(&size), "{name}: size {size}");
        assert!((0.8..1.25).contains(&ratio), "{name}: poses {ratio}");
    }
}

#[test]
fn perfect_markers_have_no_errors_and_draws_repeat_themselves() {
    let subject = person();
    let truth = motion(&subject, N, RATE_HZ, 0.4, 1);
    let clean = trial(&subject, &truth, RATE_HZ, 0.0, 2);
    let options = IkOptions { tolerance_sd: 1e-9, ..IkOptions::default() };
    let solved = solve(&subject, &clean, &options).unwrap().motion;
    let errors = MarkerErrors::of(&subject, &clean, &solved, &options).unwrap().unwrap();
    assert!(errors.sizes_m().all(|(_, s)| s < 2e-5), "errors of perfect markers");
    let mut noisy = trial(&subject, &truth, RATE_HZ, 1e-3, 3);
    // A gap is bridged, and a marker that was never visible is omitted.
    noisy.markers.trajectories[4][100..140].fill(Vector3::repeat(f64::NAN));
    noisy.markers.trajectories[9].fill(Vector3::repeat(f64::NAN));
    let solved = solve(&subject, &noisy, &IkOptions::default()).unwrap().motion;
    let errors = MarkerErrors::of(&subject, &noisy, &solved, &IkOptions::default()).unwrap().unwrap();
    let (a, b) = (errors.draw(&solved, &|f| f >= 200, 1, 3), errors.draw(&solved, &|f| f >= 200, 1, 3));
    assert!(a.q == b.q && a.q.iter().all(|x| x.is_finite()));
    assert!(a.q[..200 * a.nq] == solved.q[..200 * a.nq], "frames that were not wanted stay");
    assert!(a.q[200 * a.nq..] != solved.q[200 * a.nq..]);
    assert!(errors.draw(&solved, &|_| true, 1, 4).q != errors.draw(&solved, &|_| true, 1, 3).q);
}

#[test]
fn several_draws_at_once_are_those_one_by_one() {
    let subject = person();
    let truth = motion(&subject, N, RATE_HZ, 0.4, 1);
    // errors so large that some poses need more than one step, which moves the solver
    for noise_m in [1e-3, 4e-2] {
        let noisy = trial(&subject, &truth, RATE_HZ, noise_m, 3);
        let solved = solve(&subject, &noisy, &IkOptions::default()).unwrap().motion;
        let errors = MarkerErrors::of(&subject, &noisy, &solved, &IkOptions::default()).unwrap().unwrap();
        // each draw in other frames
        let wanted = |draw: u64, f: usize| draw == 2 || f % 3 != draw as usize % 3;
        let at_once = errors.draw_each(&solved, &wanted, 1, 2..6);
        assert_eq!(at_once.len(), 4);
        for (draw, drawn) in (2..6).zip(&at_once) {
            let alone = errors.draw(&solved, &|f| wanted(draw, f), 1, draw);
            assert!(drawn.q == alone.q, "draw {draw} with markers of {noise_m} m");
        }
    }
}

/// Largest distance of a marker between a motion of one subject and that of another, m.
fn farthest(a: (&Subject, &Motion), b: (&Subject, &Motion)) -> f64 {
    let places = |(subject, motion): (&Subject, &Motion), f: usize| -> Vec<Vector3<f64>> {
        let mut state = State::new(&subject.model);
        state.forward_position(&subject.model, motion.q(f));
        subject.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m)).collect()
    };
    let distance =
        |f: usize| places(a, f).into_iter().zip(places(b, f)).map(|(x, y)| (x - y).norm()).fold(0.0, f64::max);
    (0..a.1.n_frames()).map(distance).fold(0.0, f64::max)
}

/// One marker on the upper arm and none on the forearm: when the arm is nearly straight, small
/// errors turn it about its length by radians, which the first order continues to any angle.
#[test]
fn errors_of_a_straight_arm_stay_as_small_as_those_of_its_markers() {
    let subject = person();
    let elbow = subject.model.links.iter().find(|l| l.name == "forearm_l").unwrap().joint.q_offset;
    let mut truth = motion(&subject, N, RATE_HZ, 0.2, 5);
    for (f, q) in truth.iter_mut().enumerate() {
        q[elbow] = 0.02 + 0.4 * (2.0 * f as f64 / RATE_HZ).sin().abs();
    }
    let mut made = trial(&subject, &truth, RATE_HZ, 5e-4, 6);
    slide(&subject, &truth, &mut made, 3e-3, 7);
    let solved = solve(&subject, &made, &IkOptions::default()).unwrap().motion;
    let errors = MarkerErrors::of(&subject, &made, &solved, &IkOptions::default()).unwrap().unwrap();
    let largest = (0..8).map(|d| farthest((&subject, &solved), (&subject, &errors.draw(&solved, &|_| true, 1, d))));
    let largest = largest.fold(0.0, f64::max);
    let mut longer = subject.clone();
    let forearm = longer.model.links.iter().position(|l| l.name == "forearm_l").unwrap();
    longer.model.links[forearm].joint.parent_from_joint.translation.vector *= 0.96;
    let other = &errors.with_geometry(&solved, &|_| true, std::slice::from_ref(&longer))[0];
    let moved = farthest((&subject, &solved), (&longer, other));
    println!("largest move of a marker: errors {:.1} mm, another length {:.1} mm", 1e3 * largest, 1e3 * moved);
    assert!(largest < 0.04, "errors of 3 mm move a marker by {:.0} mm", 1e3 * largest);
    assert!(moved < 0.02, "an upper arm that is 4 % shorter moves a marker by {:.0} mm", 1e3 * moved);
}

/// Poses under another geometry start where those of the last frames lead; they are those that a
/// fit from the motion itself gives, also where an arm is nearly straight and bends to either side.
#[test]
fn poses_under_another_geometry_are_those_of_each_frame_alone() {
    let subject = person();
    let elbow = subject.model.links.iter().find(|l| l.name == "forearm_l").unwrap().joint.q_offset;
    let mut truth = motion(&subject, N, RATE_HZ, 0.2, 5);
    for (f, q) in truth.iter_mut().enumerate() {
        q[elbow] = 0.02 + 0.4 * (2.0 * f as f64 / RATE_HZ).sin().abs();
    }
    let mut made = trial(&subject, &truth, RATE_HZ, 5e-4, 6);
    slide(&subject, &truth, &mut made, 3e-3, 7);
    let solved = solve(&subject, &made, &IkOptions::default()).unwrap().motion;
    let errors = MarkerErrors::of(&subject, &made, &solved, &IkOptions::default()).unwrap().unwrap();
    let forearm = subject.model.links.iter().position(|l| l.name == "forearm_l").unwrap();
    let others: Vec<Subject> = [0.9, 0.96, 0.99, 1.01, 1.04, 1.1]
        .map(|length| {
            let mut other = subject.clone();
            other.model.links[forearm].joint.parent_from_joint.translation.vector *= length;
            other
        })
        .to_vec();
    let together = errors.with_geometry(&solved, &|_| true, &others);
    // no two frames in a row
    let halves = [0, 1].map(|odd| errors.with_geometry(&solved, &|f| f % 2 == odd, &others));
    let (mut worst, mut far) = (0.0_f64, 0);
    for ((other, all), alone) in others.iter().zip(&together).zip(halves[0].iter().zip(&halves[1])) {
        for f in 0..N {
            let alone = if f % 2 == 0 { alone.0 } else { alone.1 };
            let apart = distance(other, all.q(f), alone.q(f));
            worst = worst.max(apart);
            far += usize::from(apart > 0.02);
        }
    }
    println!("largest distance {worst:.4} rad, {far} of {} poses beyond 0.02 rad", N * others.len());
    assert!(far * 100 < N * others.len(), "{far} poses differ by more than 0.02 rad, up to {worst}");
}

/// A marker that was put back elsewhere, and a hinge that bends, do not count as noise of a rigid
/// body's markers: each link's own fit tells the noise, and the rest is named.
#[test]
fn errors_of_the_model_are_no_noise_of_a_rigid_body() {
    const NOISE_M: f64 = 4e-4;
    let subject = chain();
    let truth = motion(&subject, N, RATE_HZ, 0.4, 7);
    let size = |e: &MarkerErrors| {
        let all: Vec<f64> = e.sizes_m().map(|(_, s)| s * s).collect();
        (all.iter().sum::<f64>() / all.len() as f64).sqrt() / NOISE_M
    };
    let of = |subject: &Subject, made: &Trial| {
        let solved = solve(subject, made, &IkOptions::default()).unwrap().motion;
        let options = IkOptions::default();
        let rigid = MarkerErrors::of_rigid(subject, made, &solved, &options).unwrap().unwrap();
        let fitted = MarkerErrors::of(subject, made, &solved, &options).unwrap().unwrap();
        (size(&rigid), size(&fitted), Segments::of(subject, made, &solved).unwrap())
    };
    let clean = trial(&subject, &truth, RATE_HZ, NOISE_M, 8);
    let (rigid, fitted, segments) = of(&subject, &clean);
    println!("clean: {rigid:.2}, {fitted:.2}; joints {:.2e}", segments.joints_m.unwrap());
    assert!((0.9..1.1).contains(&rigid) && (0.9..1.1).contains(&fitted));
    assert!((segments.sd_m / NOISE_M - 1.0).abs() < 0.05);
    assert!(segments.joints_m.unwrap() < 1.3 * NOISE_M);
    assert!(segments.most_displaced().unwrap().3 < 1.0);

    // the recording has a marker 12 mm from where the model has it
    let mut other = subject.clone();
    let moved = other.markers.iter().position(|m| m.link == 1).unwrap();
    other.markers[moved].position_m += Vector3::new(0.0, 0.0, 0.012);
    let displaced = trial(&other, &truth, RATE_HZ, NOISE_M, 8);
    let (rigid, _, segments) = of(&subject, &displaced);
    assert!((0.9..1.1).contains(&rigid), "{rigid}");
    let (_, label, distance_m, _) = segments.most_displaced().unwrap();
    assert_eq!(label, other.markers[moved].label);
    assert!((distance_m - 0.012).abs() < 5e-4, "{distance_m}");

    // all markers of the second link turn about an axis that is not the hinge's
    let mut bent = clean.clone();
    let mut state = State::new(&subject.model);
    for (f, q) in truth.iter().enumerate() {
        state.forward_position(&subject.model, q);
        let own = state.world_from_link[1];
        let angle = 0.15 * (12.0 * f as f64 / RATE_HZ).sin();
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(angle, 0.0, 0.0));
        for (marker, path) in subject.markers.iter().zip(&mut bent.markers.trajectories) {
            if marker.link == 1 {
                let local = own.inverse_transform_point(&path[f].into());
                path[f] = (own * (turn * local)).coords;
            }
        }
    }
    let (rigid, fitted, segments) = of(&subject, &bent);
    println!("bent: {rigid:.2} by segments, {fitted:.2} by the model; joints {:.2e}", segments.joints_m.unwrap());
    assert!((0.9..1.1).contains(&rigid), "{rigid}");
    assert!(fitted > 1.8, "the model's residuals grow: {fitted}");
    assert!(segments.joints_m.unwrap() > 10.0 * NOISE_M);
    assert!(segments.gaps[0].axis_rad > 0.05, "{:?}", segments.gaps);
}
