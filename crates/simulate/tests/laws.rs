//! Hidden laws given as formulas: equal to the built-in effects that they repeat, delayed by what
//! they state, and clear about what they do not understand.
#![allow(clippy::expect_used, clippy::panic, reason = "helpers of tests stand outside of #[test] functions")]

use aloft_simulate::{Hidden, Lab, Scenario, simulate};
use serde_json::{Value, json};

fn hidden(effect: Value) -> Hidden {
    serde_json::from_value(effect).expect("effect")
}

fn chain(effects: &[Value]) -> Scenario {
    let throws = json!({"recordings": 1, "throws": 2, "calibration_s": 1.0, "static_s": 0.5});
    let scenario = json!({"name": "laws", "seed": 3, "body": {"kind": "chain", "throws": throws}, "hidden": effects});
    serde_json::from_value(scenario).expect("scenario")
}

fn human(effects: &[Value]) -> Scenario {
    let person = json!({"sex": "F", "height_m": 1.62, "mass_kg": 58.4});
    let protocol = json!({"jumps": 1, "flights": [1, 1], "exercises": 1, "exercise_s": 1.0, "static_s": 0.5});
    let body = json!({"kind": "human", "person": person, "protocol": protocol});
    serde_json::from_value(json!({"name": "laws", "seed": 3, "body": body, "hidden": effects})).expect("scenario")
}

fn run(scenario: &Scenario) -> Lab {
    simulate(scenario).expect("laboratory")
}

/// Largest difference of coordinates and of the hidden wrench (N, N·m) over all recordings.
fn difference(a: &Lab, b: &Lab) -> (f64, f64) {
    let (mut coordinates, mut wrench) = (0.0f64, 0.0f64);
    for (a, b) in a.trials.iter().zip(&b.trials) {
        assert_eq!(a.motion.q.len(), b.motion.q.len());
        for (x, y) in a.motion.q.iter().zip(&b.motion.q) {
            coordinates = coordinates.max((x - y).abs());
        }
        for (x, y) in a.motion.effects.iter().zip(&b.motion.effects) {
            wrench = wrench.max((x.force_n - y.force_n).amax()).max((x.moment_nm - y.moment_nm).amax());
        }
    }
    (coordinates, wrench)
}

fn same(of: &str, a: &Scenario, b: &Scenario) {
    let (coordinates, wrench) = difference(&run(a), &run(b));
    assert!(coordinates < 1e-9 && wrench < 1e-9, "{of}: {coordinates:e}, {wrench:e} N");
}

#[test]
fn formulas_repeat_the_built_in_effects() {
    let at = [0.0, 0.1, 0.02];
    let cases = [
        (
            "constant force",
            json!({"effect": "constant_force", "link": "link1", "point_m": at, "force_n": [0.1, -0.2, 0.05]}),
            json!({"effect": "law", "link": "link1", "point_m": at, "force": [0.1, "-0.2", "1/20"]}),
        ),
        (
            "thrust",
            json!({"effect": "thrust", "link": "link0", "point_m": at, "force_n": [0.1, -0.2, 0.05]}),
            json!({"effect": "law", "link": "link0", "point_m": at, "axes": "link", "force": [0.1, -0.2, 0.05]}),
        ),
        (
            "tether",
            json!({"effect": "tether", "link": "link0", "point_m": at, "anchor_m": [0.3, -0.2, 2.6],
                "rest_length_m": 0.7, "stiffness_npm": 3.0}),
            {
                let pull = "3*max(dist(0.3, -0.2, 2.6) - 0.7, 0)/dist(0.3, -0.2, 2.6)";
                json!({"effect": "law", "link": "link0", "point_m": at, "force":
                    [format!("{pull}*(0.3 - x)"), format!("{pull}*(-0.2 - y)"), format!("{pull}*(2.6 - z)")]})
            },
        ),
        (
            "flywheel",
            json!({"effect": "flywheel", "link": "link1", "momentum_nms": [0.002, -0.003, 0.001]}),
            json!({"effect": "law", "link": "link1", "axes": "link", "moment":
                ["-(py*0.001 - pz*-0.003)", "-(pz*0.002 - px*0.001)", "-(px*-0.003 - py*0.002)"]}),
        ),
    ];
    for (of, built_in, law) in cases {
        same(of, &chain(&[built_in]), &chain(&[law]));
    }
}

#[test]
fn drag_on_every_link_is_one_law_for_each() {
    let lab = run(&chain(&[]));
    let total: f64 = lab.body.area_m2.iter().sum();
    let laws: Vec<Value> = (0..2)
        .map(|i| {
            let phi = &lab.body.phi[i];
            let c = 0.08 * lab.body.area_m2[i] / total;
            json!({"effect": "law", "link": format!("link{i}"), "point_m": ([1, 2, 3].map(|k| phi[k] / phi[0])),
                "force": (["vx", "vy", "vz"].map(|v| format!("-{c:.17}*{v}")))})
        })
        .collect();
    same("linear drag", &chain(&[json!({"effect": "linear_drag", "coefficient_nspm": 0.08})]), &chain(&laws));
    // three plates at right angles at one point: the components of the velocity apart
    let axes = [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let plates = axes.map(|n| json!({"link": "link0", "normal": n, "area_m2": 0.02, "point_m": [0.0, 0.1, 0.0]}));
    let panels = json!({"effect": "panels", "plates": plates});
    let law = json!({"effect": "law", "link": "link0", "point_m": [0.0, 0.1, 0.0], "axes": "link",
        "force": (["ux", "uy", "uz"].map(|u| format!("-0.5*1.2*1.2*0.02*abs({u})*{u}")))});
    same("panels", &chain(&[panels]), &chain(&[law]));
}

#[test]
fn laws_act_on_people_and_on_the_whole_body() {
    let built_in = json!({"effect": "constant_force", "link": "torso", "force_n": [5.0, 0.0, 8.0]});
    let law = json!({"effect": "law", "link": "torso", "force": [5, 0, "8"]});
    same("force on the torso", &human(&[built_in]), &human(&[law]));
    // weight lost everywhere is a force at the centre of mass
    let lab = run(&chain(&[]));
    let mass: f64 = lab.body.phi.iter().map(|p| p[0]).sum();
    let lift = format!("{mass:.17}*9.81*0.02");
    let law = json!({"effect": "law", "link": "body", "force": [0, 0, lift]});
    let (a, b) = (run(&chain(&[json!({"effect": "gravity_scale", "factor": 0.98})])), run(&chain(&[law])));
    // the throws are planned with the plant's gravity: compare the accelerations of the first
    // instant in the air
    for lab in [&a, &b] {
        let trial = lab.trial("throws_01").expect("trial");
        let [start, end] = trial.motion.flights[0];
        for tick in start..=end {
            assert!(trial.motion.contact[tick].force_n.norm() < 1e-9);
        }
    }
    let trial = b.trial("throws_01").expect("trial");
    let tick = trial.motion.flights[0][0] + 50;
    let wrench = &trial.motion.effects[tick];
    let mut state = aloft_body::State::new(&lab.body.model);
    state.forward_position(&lab.body.model, trial.motion.q(tick));
    let com = state.centre_of_mass(&lab.body.phi).1;
    assert!((wrench.force_n.z - mass * 9.81 * 0.02).abs() < 1e-12);
    assert!((wrench.moment_nm - com.cross(&wrench.force_n)).norm() < 1e-12);
}

#[test]
fn time_since_release_and_delay() {
    // both forces depend on time alone, so that their values are known at every tick
    let since = json!({"effect": "law", "link": "link0", "force": ["since_start", "t", 0]});
    let late = json!({"effect": "law", "link": "link0", "force": [0, 0, "0.1*t"], "delay_s": 0.0401});
    let lab = run(&chain(&[since, late]));
    let motion = &lab.trial("throws_01").expect("trial").motion;
    let [start, end] = motion.flights[1];
    for tick in [start, start + 1, start + 77, end] {
        let force = motion.effects[tick].force_n;
        assert!((force.x - (tick - start) as f64 * motion.tick_s).abs() < 1e-9);
        assert!((force.y - tick as f64 * motion.tick_s).abs() < 1e-9);
        assert!((force.z - 0.1 * (force.y - 0.0401)).abs() < 1e-9);
    }
    assert!(motion.effects[start - 5].force_n.x == 0.0 && motion.effects[3].force_n.z == 0.0);
    // a law of the state sees the state of that time
    let drag = |delay: f64| json!({"effect": "law", "link": "link1", "force": ["-0.2*vx", "-0.2*vy", "-0.2*vz"], "delay_s": delay});
    let lab = run(&chain(&[drag(0.05)]));
    let motion = &lab.trial("throws_01").expect("trial").motion;
    let model = &lab.body.model;
    let mut state = aloft_body::State::new(model);
    let ago = (0.05 / motion.tick_s).round() as usize;
    let [start, end] = motion.flights[0];
    for tick in [start, start + 20, start + ago, end] {
        state.forward_velocity(model, motion.q(tick - ago), motion.v(tick - ago));
        let velocity = state.point_velocity_in_world(1, &nalgebra::Vector3::zeros());
        // at the take-off tick itself the hand's drive is replaced by free motion of the hinge
        assert!((motion.effects[tick].force_n + velocity * 0.2).norm() < 1e-6, "{tick}");
    }
}

#[test]
fn what_is_not_understood_is_named_with_its_place() {
    let said = |effect: Value| simulate(&chain(&[effect])).expect_err("an error").to_string();
    let of = |force: [&str; 3]| json!({"effect": "law", "link": "link0", "force": force});
    let text = said(of(["0", "0.3*vq", "0"]));
    assert!(text.contains("hidden[0].force[1] `0.3*vq`, character 5: nothing is called `vq`"), "{text}");
    assert!(text.contains("q_link1 qd_link1"), "{text}");
    let text = said(of(["q_link0", "0", "0"]));
    assert!(text.contains("nothing is called `q_link0`"), "{text}");
    let text = said(of(["sqrt(z - 50)", "0", "0"]));
    assert!(text.contains("`sqrt(z - 50)` is NaN at t = "), "{text}");
    let text = said(json!({"effect": "law", "link": "link7", "force": [0, 0, 1]}));
    assert!(text.contains("names the link `link7`"), "{text}");
    let text = said(json!({"effect": "law", "link": "link0"}));
    assert!(text.contains("`force`, `moment` or both"), "{text}");
    let text = said(json!({"effect": "law", "link": "body", "point_m": [0.1, 0.0, 0.0], "force": [0, 0, 1]}));
    assert!(text.contains("centre of mass"), "{text}");
    let text = said(json!({"effect": "law", "link": "link0", "force": [0, 0, "t"], "delay_s": 0.001}));
    assert!(text.contains("0.005 to 0.5 s"), "{text}");
    let plate = json!({"link": "arm", "normal": [0, 0, 1], "area_m2": 0.1});
    let text = said(json!({"effect": "panels", "plates": [plate]}));
    assert!(text.contains("`panels` names the link `arm`"), "{text}");
}

#[test]
fn the_truth_records_the_law() {
    let law = json!({"effect": "law", "link": "link0", "axes": "link", "force": ["sin(6*t)", 0, 0], "delay_s": 0.02});
    let lab = run(&chain(std::slice::from_ref(&law)));
    let file = lab.files.iter().find(|f| f.path == "truth/truth.json").expect("truth");
    let truth: Value = serde_json::from_slice(&file.bytes).expect("json");
    assert_eq!(truth["effect"], "law");
    assert_eq!(hidden(truth["hidden"][0].clone()), hidden(law));
}
