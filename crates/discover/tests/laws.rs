//! Laws that no effect of the catalogue describes are found with their place, direction, variable
//! and size; the formulas of a law give the columns that were fitted; without a law none is
//! claimed.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test that fails should say where")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_discover::*;
use aloft_effects::{EffectInstance, FormulaEffect, Target};
use aloft_regressor::WeakOptions;
use std::sync::Mutex;

struct Lab {
    truth: common::Truth,
    motion: aloft_body::Motion,
    stretches: Vec<aloft_regressor::Stretch>,
}

/// Thirty throws of a chain with markers of 0.3 mm.
fn lab(seed: u64) -> Lab {
    let truth = common::load("chain_a");
    let motion = truth.noisy(0.3e-3, seed);
    let stretches = truth.stretches();
    Lab { truth, motion, stretches }
}

fn options() -> DiscoverOptions {
    DiscoverOptions { null_draws: 60, rounds: 1, ..Default::default() }
}

impl Lab {
    /// The search on recordings in which a law acts, of such a size that the error is `strength`
    /// times that without it; `size` is the amplitude of the law.
    fn find(&self, law: Option<(&FormulaEffect, f64)>) -> (Discovery, f64) {
        self.find_telling(law, &|_| {})
    }

    /// The same; `tell` receives the progress.
    fn find_telling(&self, law: Option<(&FormulaEffect, f64)>, tell: &(dyn Fn(Told<'_>) + Sync)) -> (Discovery, f64) {
        let body = Body {
            model: &self.truth.model,
            base: &self.truth.base,
            phi: &self.truth.phi,
            prior: None,
            mass_kg: self.truth.mass(),
            plate_centres_m: &[],
        };
        let trials = [TrialInput {
            motion: &self.motion,
            stretches: &self.stretches,
            measured: None,
            plates: &[],
            group: None,
            session_time_s: 0.0,
        }];
        let scene = scene_of(&body, &trials);
        let empty = Session::new(&body, &scene, &trials, &WeakOptions::default())
            .unwrap()
            .with_white_noise(&body, &trials, &WeakOptions::default())
            .unwrap();
        let closed = DiscoverOptions { closed: true, only: vec!["gravity_tilt".to_owned()], ..options() };
        let error = |s: &Session<'_>| discover(s, &catalogue(), &[], &closed).unwrap().held_out_error;
        let floor = error(&empty);
        let mut session = empty.clone();
        let mut size = 0.0;
        if let Some((formula, strength)) = law {
            let compiled = formula.compile(&scene).unwrap();
            let nonlinear = formula.parameters.iter().map(|p| p.start.unwrap()).collect();
            let choice = EffectInstance { effect: &compiled, target: Target::Body, nonlinear, trials: Vec::new() };
            let n = formula.coefficients.len();
            let theta = |a: f64| -> Vec<f64> { (0..n).map(|k| a * [0.6, -0.3, 0.74][k % 3]).collect() };
            let mut big = empty.clone();
            big.inject(&choice, &theta(1.0)).unwrap();
            size = (strength * strength - 1.0).sqrt() * floor / error(&big);
            session.inject(&choice, &theta(size)).unwrap();
        }
        let standing = HeldOutResult {
            held_out_error: error(&session),
            noise_floor: floor,
            noise_floor_ci95: Some([0.88 * floor, 1.12 * floor]),
            by_parameters: None,
        };
        let session = session.with_model_error(Some(standing), None).with_progress(tell);
        (discover(&session, &catalogue(), &[], &options()).unwrap(), size)
    }
}

fn formula(text: &str) -> FormulaEffect {
    serde_yaml::from_str(text).unwrap()
}

struct Case {
    name: &'static str,
    yaml: &'static str,
    carriers: &'static [&'static str],
    action: Action,
    direction: Direction,
    variables: &'static [&'static str],
}

const CASES: [Case; 16] = [
    Case {
        name: "drag with the power 1.5 of the speed at the end of a link",
        yaml: "id: hidden\npoint: {link: link1, position_m: [-0.2, 0.0, 0.02]}\n\
               force: ['-c*v_x*(speed/one)^0.5', '-c*v_y*(speed/one)^0.5', '-c*v_z*(speed/one)^0.5']\n\
               coefficients: [{name: c, unit: N*s/m}]\nconstants: [{name: one, unit: m/s, value: 1}]",
        carriers: &["link1"],
        action: Action::Force,
        direction: Direction::AgainstVelocity,
        variables: &["speed"],
    },
    Case {
        name: "a couple against the spin, with its cube",
        yaml: "id: hidden\npoint: {link: link0}\n\
               moment: ['-c*omega_x*spin^2', '-c*omega_y*spin^2', '-c*omega_z*spin^2']\n\
               coefficients: [{name: c, unit: N*m*s^3}]",
        carriers: &["link0"],
        action: Action::Couple,
        direction: Direction::AgainstSpin,
        variables: &["spin"],
    },
    Case {
        name: "attraction to a point, falling with the square of the distance",
        yaml: "id: hidden\npoint: {link: link0, position_m: [0.0, 0.18, 0.02]}\n\
               force: ['c*(p_x-r_x)/((p_x-r_x)^2+(p_y-r_y)^2+(p_z-r_z)^2)^1.5', 'c*(p_y-r_y)/((p_x-r_x)^2+(p_y-r_y)^2+(p_z-r_z)^2)^1.5', 'c*(p_z-r_z)/((p_x-r_x)^2+(p_y-r_y)^2+(p_z-r_z)^2)^1.5']\n\
               coefficients: [{name: c, unit: N*m^2}]\n\
               constants: [{name: p_x, unit: m, value: 1.1}, {name: p_y, unit: m, value: -0.4}, {name: p_z, unit: m, value: 2.2}]",
        carriers: &["link0"],
        action: Action::Force,
        direction: Direction::Towards,
        variables: &["distance"],
    },
    Case {
        name: "a jet that is on above a height",
        yaml: "id: hidden\npoint: {link: link1}\naxes: link\n\
               force: ['c_x*(1+tanh((r_z-h)/w))/2', 'c_y*(1+tanh((r_z-h)/w))/2', 'c_z*(1+tanh((r_z-h)/w))/2']\n\
               coefficients: [{name: c_x, unit: N}, {name: c_y, unit: N}, {name: c_z, unit: N}]\n\
               constants: [{name: h, unit: m, value: 1.75}, {name: w, unit: m, value: 0.03}]",
        carriers: &["link1"],
        action: Action::Force,
        direction: Direction::Link,
        variables: &["r_z"],
    },
    Case {
        name: "a force across the velocity",
        yaml: "id: hidden\npoint: {link: link0}\n\
               force: ['c_y*v_z-c_z*v_y', 'c_z*v_x-c_x*v_z', 'c_x*v_y-c_y*v_x']\n\
               coefficients: [{name: c_x, unit: N*s/m}, {name: c_y, unit: N*s/m}, {name: c_z, unit: N*s/m}]",
        carriers: &["link0"],
        action: Action::Force,
        direction: Direction::AcrossVelocity,
        variables: &["speed"],
    },
    Case {
        name: "a couple that grows with the joint angle",
        yaml: "id: hidden\npoint: {link: link1}\naxes: link\nmoment: ['c_x*q_link1', 'c_y*q_link1', 'c_z*q_link1']\n\
               coefficients: [{name: c_x, unit: N*m}, {name: c_y, unit: N*m}, {name: c_z, unit: N*m}]",
        carriers: &["link1"],
        action: Action::Couple,
        direction: Direction::Link,
        variables: &["q_link1"],
    },
    Case {
        name: "a product: a force in the world with the speed, falling with height",
        yaml: "id: hidden\npoint: {link: link0}\n\
               force: ['c_x*speed*exp(-r_z/h)', 'c_y*speed*exp(-r_z/h)', 'c_z*speed*exp(-r_z/h)']\n\
               coefficients: [{name: c_x, unit: N*s/m}, {name: c_y, unit: N*s/m}, {name: c_z, unit: N*s/m}]\n\
               constants: [{name: h, unit: m, value: 0.5}]",
        carriers: &["link0"],
        action: Action::Force,
        direction: Direction::World,
        variables: &["r_z", "speed"],
    },
    Case {
        name: "a force in the link with the joint angle times a velocity, which shows in neither alone",
        yaml: "id: hidden\npoint: {link: link0}\naxes: link\n\
               force: ['c_x*q_link1*v_link_y', 'c_y*q_link1*v_link_y', 'c_z*q_link1*v_link_y']\n\
               coefficients: [{name: c_x, unit: N*s/m}, {name: c_y, unit: N*s/m}, {name: c_z, unit: N*s/m}]",
        carriers: &["link0"],
        action: Action::Force,
        direction: Direction::Link,
        variables: &["q_link1", "v_link_y"],
    },
    Case {
        name: "the pressure of a flow on a wing, along its normal",
        yaml: "id: hidden\npoint: {link: link1}\naxes: link\nforce: ['0', '-c*v_link_y*abs(v_link_x)', '0']\n\
               coefficients: [{name: c, unit: kg/m}]",
        carriers: &["link1"],
        action: Action::Force,
        direction: Direction::Link,
        variables: &["v_link_x", "v_link_y"],
    },
    Case {
        name: "a couple against one spin that grows with the size of another",
        yaml: "id: hidden\npoint: {link: link0}\naxes: link\nmoment: ['-c*omega_link_x*abs(omega_link_z)', '0', '0']\n\
               coefficients: [{name: c, unit: N*m*s^2}]",
        carriers: &["link0"],
        action: Action::Couple,
        direction: Direction::Link,
        variables: &["omega_link_x", "omega_link_z"],
    },
    Case {
        name: "drag that comes and goes with the clock",
        yaml: "id: hidden\npoint: {link: link1, position_m: [-0.2, 0.0, 0.02]}\n\
               force: ['-c*v_x*(1+sin(k*t))', '-c*v_y*(1+sin(k*t))', '-c*v_z*(1+sin(k*t))']\n\
               coefficients: [{name: c, unit: N*s/m}]\nconstants: [{name: k, unit: rad/s, value: 11.0}]",
        carriers: &["link1"],
        action: Action::Force,
        direction: Direction::AgainstVelocity,
        variables: &["speed", "t"],
    },
    Case {
        name: "a wave that travels upwards",
        yaml: "id: hidden\npoint: {link: link0, position_m: [0.0, 0.18, 0.02]}\n\
               force: ['c_x*sin(k*t-m*r_z)', 'c_y*sin(k*t-m*r_z)', 'c_z*sin(k*t-m*r_z)']\n\
               coefficients: [{name: c_x, unit: N}, {name: c_y, unit: N}, {name: c_z, unit: N}]\n\
               constants: [{name: k, unit: rad/s, value: 9.0}, {name: m, unit: rad/m, value: 4.0}]",
        carriers: &["link0"],
        action: Action::Force,
        direction: Direction::World,
        variables: &["r_z", "t"],
    },
    Case {
        name: "a drag that acts late",
        yaml: "id: hidden\npoint: {link: link1, position_m: [-0.2, 0.0, 0.02]}\ndelay: late\n\
               force: ['-c*v_x*speed', '-c*v_y*speed', '-c*v_z*speed']\n\
               coefficients: [{name: c, unit: kg/m}]\nconstants: [{name: late, unit: s, value: 0.068}]",
        carriers: &["link1"],
        action: Action::Force,
        direction: Direction::AgainstVelocity,
        variables: &["speed"],
    },
    Case {
        name: "a couple that follows the joint late",
        yaml: "id: hidden\npoint: {link: link1}\naxes: link\ndelay: late\n\
               moment: ['c_x*qd_link1', 'c_y*qd_link1', 'c_z*qd_link1']\n\
               coefficients: [{name: c_x, unit: N*m*s}, {name: c_y, unit: N*m*s}, {name: c_z, unit: N*m*s}]\n\
               constants: [{name: late, unit: s, value: 0.045}]",
        carriers: &["link1"],
        action: Action::Couple,
        direction: Direction::Link,
        variables: &["qd_link1"],
    },
    Case {
        name: "a force that follows the joint late, which without its delay looks like one on the centre of mass",
        yaml: "id: hidden\npoint: {link: link0, position_m: [-0.04, 0.079, -0.022]}\naxes: link\ndelay: late\n\
               force: ['c_x*qd_link1', 'c_y*qd_link1', 'c_z*qd_link1']\n\
               coefficients: [{name: c_x, unit: N*s}, {name: c_y, unit: N*s}, {name: c_z, unit: N*s}]\n\
               constants: [{name: late, unit: s, value: 0.058}]",
        carriers: &["link0"],
        action: Action::Force,
        direction: Direction::Link,
        variables: &["qd_link1"],
    },
    Case {
        name: "a force that follows the joint angle times an inclination, and neither alone",
        yaml: "id: hidden\npoint: {link: link0, position_m: [-0.03, 0.09, 0.036]}\naxes: link\n\
               force: ['c_x*q_link1*tilt_z', 'c_y*q_link1*tilt_z', 'c_z*q_link1*tilt_z']\n\
               coefficients: [{name: c_x, unit: N}, {name: c_y, unit: N}, {name: c_z, unit: N}]",
        carriers: &["link0"],
        action: Action::Force,
        direction: Direction::Link,
        variables: &["q_link1", "tilt_z"],
    },
];

fn report(name: &str, d: &Discovery) {
    println!("{name}: {} {:?}", d.words, d.effects);
    if let Some(o) = &d.open {
        for l in &o.laws {
            println!("  {:?} {:?} {:?} {:?}", l.carrier, l.direction, l.variables, l.effect.force);
        }
    }
}

fn found(case: &Case, strength: f64) -> FoundLaw {
    let (d, _) = lab(7).find(Some((&formula(case.yaml), strength)));
    report(case.name, &d);
    let open = d.open.as_ref().unwrap();
    assert!(open.complete, "{}: {}", case.name, d.words);
    let law = &open.laws[0];
    assert!(case.carriers.contains(&law.carrier.as_str()), "{}: {}", case.name, law.carrier);
    assert_eq!((law.action, law.direction), (case.action, case.direction), "{}", case.name);
    let mut variables = law.variables.clone();
    variables.sort();
    assert_eq!(variables, case.variables, "{}", case.name);
    assert!(open.times_floor_after.unwrap() < 1.3, "{}: {:?}", case.name, open.times_floor_after);
    assert_eq!((d.verdict, d.effects.len()), (Verdict::Unexplained, 0));
    formulas_are_those_of_the_law(law);
    law.clone()
}

/// The law as a file compiles to an effect with the same unknowns.
fn formulas_are_those_of_the_law(law: &FoundLaw) {
    let text = serde_yaml::to_string(&law.effect).unwrap();
    assert_eq!(formula(&text), law.effect);
    let truth = common::load("chain_a");
    let scene = aloft_effects::Scene::new(&truth.model, &truth.phi, &[]);
    let compiled = law.effect.compile(&scene).unwrap();
    let effect: &dyn aloft_effects::Effect = &compiled;
    let names = |l: &[Estimate]| l.iter().map(|e| (e.name.clone(), e.unit.clone())).collect::<Vec<_>>();
    let linear = effect.coefficients(&scene, Target::Body).into_iter().map(|c| (c.name, c.unit));
    let nonlinear = effect.nonlinear(&scene, Target::Body).into_iter().map(|p| (p.name, p.unit));
    assert_eq!(names(&law.coefficients), linear.collect::<Vec<_>>());
    assert_eq!(names(&law.parameters), nonlinear.collect::<Vec<_>>());
}

macro_rules! laws {
    ($($test:ident: $index:literal,)*) => { $(#[test] fn $test() { assert_eq!(found(&CASES[$index], 12.0).effect.delay, None); })* };
}

laws! {
    drag_with_an_unusual_power: 0,
    couple_with_the_cube_of_the_spin: 1,
    attraction_to_a_point: 2,
    jet_above_a_height: 3,
    force_across_the_velocity: 4,
    couple_by_the_joint_angle: 5,
    product_of_speed_and_height: 6,
    product_of_joint_angle_and_velocity: 7,
    flow_on_a_wing: 8,
    couple_by_two_spins: 9,
    drag_by_the_clock: 10,
    travelling_wave: 11,
    product_of_joint_angle_and_inclination: 15,
}

/// A law that acts late is stated with its delay, and none at once has one (above).
#[test]
fn delays_of_a_drag_a_couple_and_a_force() {
    for (case, expected) in [(&CASES[12], 0.068), (&CASES[13], 0.045), (&CASES[14], 0.058)] {
        let law = found(case, 12.0);
        assert_eq!(law.effect.delay.as_deref(), Some("delay"), "{}", case.name);
        let delay = law.parameters.iter().find(|p| p.name == "delay").unwrap();
        let [low, high] = delay.ci95.unwrap();
        println!("delay {} {low} {high}", delay.value);
        assert!((delay.value - expected).abs() < 0.004, "{}: {}", case.name, delay.value);
        assert!(low - 0.001 < expected && expected < high + 0.001, "{low} to {high}");
        assert!(law.text.contains("it follows the motion"), "{}", law.text);
    }
}

/// The catalogue's answer is told before the search, then what the search knows, with its steps.
#[test]
fn what_is_known_is_told_while_the_search_goes_on() {
    let heard: Mutex<Vec<(Option<Part>, String)>> = Mutex::default();
    let tell = |told: Told<'_>| {
        heard.lock().unwrap().push(match told {
            Told::Steps { part, done, expected } => {
                assert!(done <= expected, "{done} of {expected}");
                (Some(part), String::new())
            }
            Told::SoFar(words) => (None, words.to_owned()),
        });
    };
    let (d, _) = lab(7).find_telling(Some((&formula(CASES[0].yaml), 12.0)), &tell);
    let heard = heard.into_inner().unwrap();
    let words: Vec<&str> = heard.iter().filter(|(part, _)| part.is_none()).map(|(_, w)| w.as_str()).collect();
    assert!(words[0].contains("times the noise floor") && words[0].contains("beyond the catalogue"), "{words:?}");
    assert!(words[1].contains("a force on `link1`, against the velocity"), "{words:?}");
    assert!(words[2].contains(&d.open.unwrap().laws[0].text), "{words:?}");
    let first = |part: Part| heard.iter().position(|(p, _)| *p == Some(part)).unwrap();
    let so_far = heard.iter().position(|(p, _)| p.is_none()).unwrap();
    assert!(first(Part::Catalogue) < so_far && so_far < first(Part::Atlas) && first(Part::Atlas) < first(Part::Laws));
    // a drag may act late, so that delays are tried, and told one by one
    let delays = heard.iter().filter(|(p, _)| *p == Some(Part::Delays)).count();
    assert!(first(Part::Laws) < first(Part::Delays) && delays > 5, "{delays}");
}

#[test]
fn no_law_is_claimed_where_there_is_none() {
    for seed in 1..4 {
        let (d, _) = lab(seed).find(None);
        assert!(d.open.is_none_or(|o| o.laws.is_empty()), "seed {seed}");
    }
}

/// A drag with the root of the speed, at 2.5 times the error without it, fits `linear_drag` nearly
/// as well: the form of that effect is refuted, and the law is stated with its power.
#[test]
fn an_effect_whose_form_is_refuted_is_not_named() {
    let root = CASES[0].yaml.replace("(speed/one)^0.5", "(speed/one)^(-0.5)");
    let (d, _) = lab(7).find(Some((&formula(&root), 2.5)));
    report("a drag with the root of the speed", &d);
    assert_eq!((d.verdict, d.effects.len()), (Verdict::Unexplained, 0), "{}", d.words);
    let law = &d.open.as_ref().unwrap().laws[0];
    assert_eq!((law.carrier.as_str(), law.direction), ("link1", Direction::AgainstVelocity), "{}", law.text);
    assert_eq!(law.variables, ["speed"]);
}

/// A drag of one link along the velocity of its point relative to a wind, times a function of the
/// speed.
fn drag(strength: &str, wind: [f64; 3]) -> FormulaEffect {
    let [x, y, z] = wind.map(|w| if w == 0.0 { String::new() } else { format!("-({w})*one") });
    let speed = format!("sqrt((v_x{x})^2+(v_y{y})^2+(v_z{z})^2)");
    let of = strength.replace("speed", &speed);
    formula(&format!(
        "id: hidden\npoint: {{link: link0, position_m: [-0.04, 0.2, 0.03]}}\n\
         force: ['-c*(v_x{x})*{of}', '-c*(v_y{y})*{of}', '-c*(v_z{z})*{of}']\n\
         coefficients: [{{name: c, unit: N*s/m}}]\nconstants: [{{name: one, unit: m/s, value: 1}}]"
    ))
}

/// A drag that begins at 1 m/s fits `quadratic_drag` nearly as well; with the power 1.5 two drags
/// do. The strength of each grows in another way, which its own point shows.
#[test]
fn an_effect_whose_strength_grows_in_another_way_is_not_named() {
    for (name, strength) in
        [("begins at 1 m/s", "0.5*(speed/one-1+abs(speed/one-1))*one/speed"), ("power 1.5", "(speed/one)^0.5")]
    {
        let (d, _) = lab(7).find(Some((&drag(strength, [0.0; 3]), 6.0)));
        report(name, &d);
        assert_eq!((d.verdict, d.effects.len()), (Verdict::Unexplained, 0), "{name}: {}", d.words);
        let law = &d.open.as_ref().unwrap().laws[0];
        assert_eq!((law.carrier.as_str(), law.direction), ("link0", Direction::AgainstVelocity), "{}", law.text);
        assert_eq!(law.variables, ["speed"], "{}", law.text);
    }
}

/// A force towards a point of the room, times a function of the distance from it.
fn field(strength: &str) -> FormulaEffect {
    let d = "sqrt((p_x-r_x)^2+(p_y-r_y)^2+(p_z-r_z)^2)";
    let of = strength.replace("distance", d);
    formula(&format!(
        "id: hidden\npoint: {{link: link0, position_m: [0.01, 0.11, -0.03]}}\n\
         force: ['c*(p_x-r_x)*{of}', 'c*(p_y-r_y)*{of}', 'c*(p_z-r_z)*{of}']\n\
         coefficients: [{{name: c, unit: N/m}}]\n\
         constants: [{{name: p_x, unit: m, value: -1.1}}, {{name: p_y, unit: m, value: 0.2}}, {{name: p_z, unit: m, value: 2.4}}, {{name: one, unit: m, value: 1}}]"
    ))
}

/// A pull that grows with the cube of the distance fits an elastic line nearly as well. The law
/// predicts the flights better, and the line is not named; a line is, beside the best law.
#[test]
fn an_effect_is_not_named_where_a_law_predicts_better() {
    let (cube, _) = lab(7).find(Some((&field("(distance/one)^2"), 8.0)));
    report("a field with the cube of the distance", &cube);
    assert_eq!((cube.verdict, cube.effects.len()), (Verdict::Unexplained, 0), "{}", cube.words);
    let law = &cube.open.as_ref().unwrap().laws[0];
    assert_eq!((law.carrier.as_str(), law.direction), ("link0", Direction::Towards), "{}", law.text);
    assert_eq!(law.variables, ["distance"], "{}", law.text);
    let (line, _) = lab(7).find(Some((&field("(1-0.5*one/distance)"), 8.0)));
    report("an elastic line", &line);
    assert_eq!(line.effects, ["tether"], "{}", line.words);
}

/// A level wind is named as itself, and a drag that acts late is not named as a drag of still air.
#[test]
fn a_drag_that_acts_late_is_no_drag_of_still_air() {
    let (level, _) = lab(7).find(Some((&drag("speed/one", [1.5, 0.0, 0.0]), 4.0)));
    assert!(level.effects.iter().any(|e| e == "wind"), "{}", level.words);
    let [weak, late] = [2.0, 4.0].map(|strength| lab(7).find(Some((&formula(CASES[12].yaml), strength))).0);
    report("a drag that acts late", &late);
    assert_ne!(weak.verdict, Verdict::Supported, "{}", weak.words);
    assert!(late.effects.iter().all(|e| e != "quadratic_drag"), "{}", late.words);
}

#[test]
fn a_listed_effect_is_named_as_itself() {
    let drag = formula(
        "id: hidden\npoint: {link: all}\n\
         force: ['-c*area_share*v_x*speed', '-c*area_share*v_y*speed', '-c*area_share*v_z*speed']\n\
         coefficients: [{name: c, unit: kg/m}]",
    );
    let (d, _) = lab(7).find(Some((&drag, 12.0)));
    assert_eq!(d.effects, ["quadratic_drag"], "{}", d.words);
    assert!(d.open.is_none());
}
