//! Hidden effects: a law of the simulator of unit size in a random direction, and the same effect
//! in the catalogue's terms.

use aloft_effects::{EffectInstance, Scene};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::f64::consts::TAU;

/// Effects detectable in flights of a kind of laboratory.
pub fn effects(human: bool) -> &'static [&'static str] {
    const BOTH: [&str; 10] = [
        "quadratic_drag",
        "wind",
        "gravity_tilt",
        "gravity_scale",
        "tether",
        "crane",
        "constant_force",
        "flywheel",
        "thrust",
        "payload",
    ];
    const CHAIN: [&str; 15] = [
        "quadratic_drag",
        "linear_drag",
        "rotational_drag",
        "wind",
        "gravity_tilt",
        "gravity_scale",
        "tether",
        "crane",
        "constant_force",
        "flywheel",
        "rotor",
        "thrust",
        "added_mass",
        "wobbling_mass",
        "payload",
    ];
    if human { &BOTH } else { &CHAIN }
}

/// One hidden effect, scaled by a factor, in the simulator's terms and in the catalogue's.
pub struct Case {
    pub effect: &'static str,
    pub key: String,
    nonlinear: Vec<(&'static str, f64)>,
    /// Coefficients of unit size.
    pub unit: Vec<f64>,
    /// Number of leading coefficients with a true value in the simulator's terms.
    pub known: usize,
    hidden: Box<dyn Fn(f64) -> Value>,
}

impl Case {
    /// The scenario's entry at a multiple of the unit size.
    pub fn hidden(&self, times: f64) -> Value {
        json!([(self.hidden)(times)])
    }
    /// The catalogue's effect at the true values of its nonlinear parameters, with coefficients of
    /// unit size.
    pub fn choice(&self, scene: &Scene, trials: &[String]) -> EffectInstance<'static> {
        let mut choice = EffectInstance::parse(&self.key, scene).unwrap();
        for (name, value) in &self.nonlinear {
            choice.set(scene, name, *value).unwrap();
        }
        if self.effect == "payload" { choice.in_trials(trials) } else { choice }
    }
}

/// Trials that carry the load.
pub fn loaded(human: bool) -> Vec<String> {
    let names: &[&str] = if human { &["jump05", "jump06", "jump07", "jump08"] } else { &["throws_04", "throws_05"] };
    names.iter().map(|n| (*n).to_owned()).collect()
}

pub fn case(human: bool, effect: &'static str, seed: u64) -> Case {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xca5e);
    let links: &[&str] = if human { &["pelvis", "torso"] } else { &["link0", "link1"] };
    let link = links[rng.random_range(0..links.len())].to_owned();
    let angle = TAU * rng.random::<f64>();
    let (sin, cos) = angle.sin_cos();
    let high = 2.0 * rng.random::<f64>() - 1.0;
    let flat = (1.0 - high * high).sqrt();
    let any = [flat * cos, flat * sin, high];
    let (reach, height) = if human { (2.5, 1.6) } else { (1.0, 2.6) };
    let anchor = [reach * cos, reach * sin, height];
    let own = |unit: Vec<f64>, hidden: Box<dyn Fn(f64) -> Value>| Case {
        effect,
        key: effect.to_owned(),
        nonlinear: Vec::new(),
        known: unit.len(),
        unit,
        hidden,
    };
    let at = |unit: Vec<f64>, nonlinear: Vec<(&'static str, f64)>, hidden: Box<dyn Fn(f64) -> Value>| Case {
        effect,
        key: format!("{effect}[{link}]"),
        nonlinear,
        known: if effect == "wobbling_mass" { 1 } else { unit.len() },
        unit,
        hidden,
    };
    let place =
        move |which: [&'static str; 3]| vec![(which[0], anchor[0]), (which[1], anchor[1]), (which[2], anchor[2])];
    let point = [("point_x", 0.0), ("point_y", 0.0), ("point_z", 0.0)];
    let name = link.clone();
    match effect {
        "quadratic_drag" => own(vec![1.0], Box::new(|x| json!({"effect": "quadratic_drag", "drag_area_m2": x}))),
        "linear_drag" => own(vec![1.0], Box::new(|x| json!({"effect": "linear_drag", "coefficient_nspm": x}))),
        "rotational_drag" => {
            own(vec![1.0], Box::new(|x| json!({"effect": "rotational_drag", "coefficient_nmsprad": x})))
        }
        "wind" => {
            let speed = if human { 5.0 } else { 3.0 };
            let wind = [speed * cos, speed * sin, 0.0];
            let nonlinear = vec![("wind_x", wind[0]), ("wind_y", wind[1]), ("wind_z", 0.0)];
            let hidden = Box::new(move |x| json!({"effect": "wind", "velocity_mps": wind, "drag_area_m2": x}));
            Case { nonlinear, ..own(vec![1.0], hidden) }
        }
        "gravity_tilt" => {
            // gravity is tilted by small rotations about x and y
            let unit = vec![-9.81 * sin, 9.81 * cos];
            own(
                unit,
                Box::new(move |x: f64| {
                    let deg = x.to_degrees();
                    json!({"effect": "gravity_tilt", "about_x_deg": deg * cos, "about_y_deg": deg * sin})
                }),
            )
        }
        "gravity_scale" => {
            let sign = if cos > 0.0 { 1.0 } else { -1.0 };
            own(vec![sign], Box::new(move |x| json!({"effect": "gravity_scale", "factor": 1.0 + sign * x})))
        }
        "tether" => {
            let rest = if human { 1.2 } else { 0.5 };
            let mut nonlinear = place(["anchor_x", "anchor_y", "anchor_z"]);
            nonlinear.push(("rest_length", rest));
            nonlinear.extend(point);
            at(
                vec![1.0, 0.0],
                nonlinear,
                Box::new(
                    move |x| json!({"effect": "tether", "link": name, "anchor_m": anchor, "rest_length_m": rest, "stiffness_npm": x}),
                ),
            )
        }
        "crane" => {
            let mut nonlinear = place(["pulley_x", "pulley_y", "pulley_z"]);
            nonlinear.extend(point);
            at(
                vec![1.0],
                nonlinear,
                Box::new(move |x| json!({"effect": "crane", "link": name, "pulley_m": anchor, "tension_n": x})),
            )
        }
        "constant_force" => at(
            vec![cos, sin, 0.0],
            point.to_vec(),
            Box::new(
                move |x: f64| json!({"effect": "constant_force", "link": name, "point_m": [0, 0, 0], "force_n": [x * cos, x * sin, 0.0]}),
            ),
        ),
        "flywheel" => at(
            any.to_vec(),
            Vec::new(),
            Box::new(move |x| json!({"effect": "flywheel", "link": name, "momentum_nms": any.map(|a| a * x)})),
        ),
        "rotor" => {
            let axis = any;
            let hz = 1.5 + 2.0 * rng.random::<f64>();
            let unit = (0..9)
                .map(|i| {
                    if i < 3 {
                        axis[i]
                    } else if i < 6 {
                        0.8 * axis[i - 3]
                    } else {
                        0.0
                    }
                })
                .collect();
            at(
                unit,
                vec![("frequency", hz)],
                Box::new(
                    move |x| json!({"effect": "rotor", "link": name, "axis": axis, "mean_nms": x, "swing_nms": 0.8 * x, "frequency_hz": hz}),
                ),
            )
        }
        "thrust" => at(
            vec![any[0], any[1], any[2], 0.0, 0.0, 0.0],
            Vec::new(),
            Box::new(move |x| json!({"effect": "thrust", "link": name, "force_n": any.map(|a| a * x)})),
        ),
        "added_mass" => at(
            vec![1.0],
            point.to_vec(),
            Box::new(move |x| json!({"effect": "added_mass", "link": name, "point_m": [0, 0, 0], "mass_kg": x})),
        ),
        "payload" => {
            let trials = loaded(human);
            at(
                vec![1.0],
                point.to_vec(),
                Box::new(
                    move |x| json!({"effect": "payload", "link": name, "point_m": [0, 0, 0], "mass_kg": x, "trials": trials}),
                ),
            )
        }
        // released from its position of rest
        "wobbling_mass" => at(
            vec![1.0, 1.0, 0.0],
            vec![("frequency", 7.0), ("damping_ratio", 0.15), ("point_x", 0.0), ("point_y", 0.05), ("point_z", 0.0)],
            Box::new(
                move |x| json!({"effect": "wobbling_mass", "link": name, "point_m": [0, 0.05, 0], "mass_kg": x, "frequency_hz": 7, "damping_ratio": 0.15}),
            ),
        ),
        other => panic!("no case `{other}`"),
    }
}
