//! Every effect of the catalogue is hidden in simulated recordings and recovered at its true size.
//!
//! The simulator is independent of the columns: forces act in its equations of motion, instrument
//! errors in its cameras and plates. Motions come from inverse kinematics of noisy markers,
//! inertial parameters are fitted together with the effect from weak rows, as in `aloft discover`,
//! and the prior of the body has errors typical of anthropometric tables. In the twin, the same
//! session with nothing hidden, every effect has to be zero.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "a test that fails should say where")]

mod chain;
mod kinematics;
mod lab;
#[allow(dead_code, reason = "the table of laboratories needs more of it")]
#[path = "../labs/lab.rs"]
mod labs;
mod law_on_person;
mod person;
mod plates;

use aloft_discover::Estimate;
use aloft_effects::EFFECTS;
use lab::Evidence;

/// One test per effect, and the list of all of them.
macro_rules! recovered {
    ($($effect:ident: $file:ident::$test:ident,)*) => {
        const RECOVERED: &[&str] = &[$(stringify!($effect)),*];
        mod validate_recovery {
            $(#[test] fn $effect() { super::$file::$test(); })*
        }
    };
}

recovered! {
    quadratic_drag: chain::quadratic_drag,
    linear_drag: chain::linear_drag,
    rotational_drag: chain::rotational_drag,
    wind: chain::wind,
    panels: chain::panels,
    constant_force: chain::constant_force,
    gravity_tilt: chain::gravity_tilt,
    gravity_scale: chain::gravity_scale,
    tether: chain::tether,
    crane: chain::crane,
    flywheel: chain::flywheel,
    rotor: chain::rotor,
    payload: chain::payload,
    link_mass: person::link_mass,
    wobbling_mass: chain::wobbling_mass,
    added_mass: chain::added_mass,
    thrust: chain::thrust,
    residual_contact: kinematics::residual_contact,
    plate_time_offset: plates::time_offset,
    plate_clock_drift: plates::clock_drift,
    plate_tare: plates::tare,
    plate_origin: plates::origin,
    plate_rotation: plates::rotation,
    plate_gain: plates::gain,
    filter_attenuation: kinematics::filter,
    soft_tissue: kinematics::soft_tissue,
    marker_overshoot: kinematics::overshoot,
    joint_centre: kinematics::joint_centre,
    camera_warp: kinematics::camera_warp,
    body_mass: plates::body_mass,
}

/// The hidden effect, in the catalogue's terms.
struct Case<'a> {
    key: &'a str,
    truth: &'a [f64],
    nonlinear: &'a [(&'a str, f64)],
    /// Target and nonlinear parameters are estimated, not given.
    sought: bool,
    /// Effects already in the model.
    beside: &'a [&'a str],
    /// Trials in which it acts; all if empty.
    trials: &'a [String],
    /// Share of the effect's size by which a coefficient may be off.
    share: f64,
}

impl Default for Case<'_> {
    fn default() -> Self {
        Self { key: "", truth: &[], nonlinear: &[], sought: false, beside: &[], trials: &[], share: SHARE }
    }
}

/// Default of this share: first-order columns, soft tissue and inaccurate priors leave some per
/// cent.
const SHARE: f64 = 0.1;

/// The hidden coefficients are recovered within a share of the effect's size or three standard
/// errors, and well determined; those of the twin are zero within the same limits. Three, because a
/// session has forty-odd coefficients of which none may fail.
fn recovers(case: &Case<'_>, hidden: &Evidence, twin: &Evidence) {
    let given = |e: &Evidence| e.fit(case.beside, case.key, case.nonlinear, case.trials).coefficients;
    let found = if case.sought {
        let (key, found) = hidden.search(case.key.split('[').next().unwrap());
        assert_eq!(key, case.key);
        found
    } else {
        given(hidden)
    };
    compare(case, &found, case.truth);
    compare(case, &given(twin), &vec![0.0; case.truth.len()]);
}

fn compare(case: &Case<'_>, found: &[Estimate], truth: &[f64]) {
    let of = |e: &Estimate, truth: f64, size: f64| {
        println!("{:28} {:14} {:12.6} ± {:.6} of {truth:.6} {}", case.key, e.name, e.value, e.se, e.unit);
        // zero, at the bound of a coefficient that cannot be negative, is the right answer if
        // nothing is hidden
        if truth == 0.0 && e.value == 0.0 && e.at_bound {
            return;
        }
        assert!((e.value - truth).abs() <= (case.share * size).max(3.0 * e.se), "{}: {e:?}, {truth}", case.key);
        // a column of zeros has no error at all
        assert!(0.0 < e.se && e.se <= 0.5 * size, "{} is not determined: {e:?}", case.key);
    };
    for (e, truth) in found.iter().zip(truth) {
        let alike = found.iter().zip(case.truth).filter(|(o, _)| o.unit == e.unit);
        of(e, *truth, alike.map(|(_, t)| t * t).sum::<f64>().sqrt());
    }
    for (name, truth) in case.nonlinear {
        if let Some(e) = found.iter().find(|e| e.name == *name) {
            // positions and winds within a tenth of a metre, or of a metre per second
            of(e, *truth, truth.abs().max(1.0));
        }
    }
}

/// Effects that act on robots with encoders only: columns are tested in `aloft-effects`, and an
/// encoder with a wrong zero is found in the story of the robot. Laws of joints are found in
/// stories, too.
const OF_ROBOTS: [&str; 2] = ["encoder_offset", "base_time_offset"];

/// A new effect needs a case here, documentation under four headings, units, and bounds or a reason
/// for having none.
#[test]
fn every_effect_is_documented_bounded_and_recovered() {
    let ids: Vec<&str> =
        EFFECTS.iter().filter(|e| !e.acts().in_joints()).map(|e| e.id()).filter(|id| !OF_ROBOTS.contains(id)).collect();
    assert_eq!(ids, RECOVERED, "effects of the catalogue, and cases of recovery");
    chain::plain_evidence().with(|chain, _| {
        person::plain_evidence().with(|person, _| {
            for effect in EFFECTS {
                for heading in ["## Physics", "## Equation", "## Identifiability", "## References"] {
                    let (_, text) = effect.about().documentation.split_once(heading).unwrap_or_default();
                    let text = text.split("\n## ").next().unwrap_or_default().trim();
                    assert!(text.len() > 20, "{}: nothing under `{heading}`", effect.id());
                }
                let mut unknowns = 0;
                for (scene, target) in
                    [chain, person].into_iter().flat_map(|s| effect.targets(s).into_iter().map(move |t| (s, t)))
                {
                    for c in effect.coefficients(scene, target) {
                        let bounded = c.lower.is_finite() && c.upper.is_finite() && c.lower < c.upper;
                        assert!(!c.unit.is_empty() && !c.name.is_empty(), "{} {c:?}", effect.id());
                        assert!(
                            bounded || !effect.about().unbounded.is_empty(),
                            "{} {c:?}: why no bound?",
                            effect.id()
                        );
                        unknowns += 1;
                    }
                    for p in effect.nonlinear(scene, target) {
                        let bounded = p.lower.is_finite() && p.upper.is_finite() && p.lower < p.upper;
                        assert!(!p.unit.is_empty() && bounded && p.scale > 0.0, "{} {p:?}", effect.id());
                    }
                }
                let of_robots = OF_ROBOTS.contains(&effect.id()) || effect.acts().in_joints();
                assert_eq!(unknowns == 0, of_robots, "{} has {unknowns} unknowns", effect.id());
            }
        });
    });
}
