//! Simulated laboratories with a hidden effect: how often the right name is given, and how often a
//! wrong one.
//!
//! The simulator's physics is independent of the columns. Kinematics are those of a good
//! calibration: inverse kinematics from the measured markers (noise, soft tissue, gaps) in the true
//! geometry, with priors as inaccurate as real ones. Sizes are multiples of the minimum detectable
//! size, taken from the twin of the laboratory with nothing hidden.
//!
//! A few laboratories always run. `ALOFT_LABS=FILE` runs the whole table (`ALOFT_LABS_SEEDS=n` of
//! it, 20 seeds by default; `ALOFT_LABS_ONLY` selects effects, `ALOFT_LABS_OF` kinds,
//! `ALOFT_LABS_SIZES` sizes), writes one line of JSON per laboratory to the file, resumes where it
//! stopped, and writes the table next to it as Markdown.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "a test that fails should say where")]

mod cases;
mod lab;
mod table;

use aloft_discover::*;
use cases::{Case, case, effects, loaded};
use lab::Recorded;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::time::Instant;

/// Sizes as multiples of the minimum detectable size.
const MULTIPLES: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// One laboratory of the table.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Line {
    kind: String,
    seed: u64,
    /// Hidden effect with its link; empty in a twin.
    key: String,
    multiple: f64,
    /// Size in the unit of the effect's first coefficient.
    size: f64,
    verdict: Verdict,
    effects: Vec<String>,
    outcome: String,
    found: Vec<String>,
    /// Held-out error, N: before, with the effects found, and of the twin.
    before: f64,
    after: f64,
    twin: f64,
    /// True value, estimate and standard error of the coefficients found, if the effect was found
    /// on its own link.
    coefficients: Vec<(String, f64, f64, f64)>,
    /// Best candidates of the first round, with ratios.
    ranking: Vec<(String, f64)>,
    /// Run time of `discover` alone.
    seconds: f64,
}

fn outcome(truth: &str, d: &Discovery) -> &'static str {
    let claimed = matches!(d.verdict, Verdict::Supported | Verdict::OneOf);
    match (truth.is_empty(), claimed) {
        (true, true) => "false alarm",
        (true, false) => "nothing",
        (false, false) => "missed",
        (false, true) if d.effects.iter().any(|e| e == truth) => {
            // in `supported` a second name next to the right one is a false claim
            match (d.verdict, d.effects.len()) {
                (_, 1) => "hit",
                (Verdict::Supported, _) => "hit and more",
                _ => "class",
            }
        }
        _ => "wrong",
    }
}

/// Coefficients found and their true values: those of the effect on its own link; for drag with an
/// area per link, their sum.
fn compare(case: &Case, size: f64, d: &Discovery) -> Vec<(String, f64, f64, f64)> {
    let truth: Vec<f64> = case.unit.iter().map(|u| u * size).collect();
    let Some(found) = d.found.iter().find(|f| f.effect == case.effect) else { return Vec::new() };
    if found.key == case.key {
        let main = |k: usize| k < case.known && found.coefficients[k].unit == found.coefficients[0].unit;
        return found
            .coefficients
            .iter()
            .enumerate()
            .filter(|(k, _)| main(*k))
            .map(|(k, e)| (e.name.clone(), truth[k], e.value, e.se))
            .collect();
    }
    Vec::new()
}

fn line(kind: &str, seed: u64, hidden: Option<(&Case, f64, f64)>, twin: f64, recorded: &Recorded) -> Line {
    recorded.with(|_, session| {
        let start = Instant::now();
        let d = discover(session, &catalogue(), &[], &DiscoverOptions::default()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        let first = &d.rounds[0];
        let ranked = first.candidates.iter().take(6).map(|c| (c.key.clone(), c.held_out_ratio));
        Line {
            kind: kind.to_owned(),
            seed,
            key: hidden.map(|h| h.0.key.clone()).unwrap_or_default(),
            multiple: hidden.map_or(0.0, |h| h.1),
            size: hidden.map_or(0.0, |h| h.2),
            verdict: d.verdict,
            outcome: outcome(hidden.map_or("", |h| h.0.effect), &d).to_owned(),
            found: d.found.iter().map(|f| f.key.clone()).collect(),
            before: d.held_out_error,
            after: d.held_out_error_after,
            twin: if twin.is_nan() { d.held_out_error } else { twin },
            coefficients: hidden.map(|h| compare(h.0, h.2, &d)).unwrap_or_default(),
            ranking: ranked.collect(),
            effects: d.effects,
            seconds,
        }
    })
}

/// Size detectable in the twin, in multiples of the case's unit.
fn detectable_size(twin: &Recorded, human: bool, case: &Case) -> f64 {
    twin.with(|scene, session| {
        let choice = case.choice(scene, &loaded(human));
        detectable(session, &[], &choice, &case.unit, &DiscoverOptions::default()).unwrap()
    })
}

#[test]
fn validate_a_few_labs() {
    let twin = Recorded::new(false, 3, &serde_json::json!([])).unwrap();
    let nothing = line("chain", 3, None, f64::NAN, &twin);
    assert_eq!(nothing.outcome, "nothing", "{nothing:?}");
    for effect in ["quadratic_drag", "flywheel"] {
        let case = case(false, effect, 3);
        let size = 2.0 * detectable_size(&twin, false, &case);
        let recorded = Recorded::new(false, 3, &case.hidden(size)).unwrap();
        let line = line("chain", 3, Some((&case, 2.0, size)), nothing.before, &recorded);
        assert!(matches!(line.outcome.as_str(), "hit" | "class"), "{line:?}");
        assert!(line.after < 1.1 * line.twin && line.after < 0.85 * line.before, "{line:?}");
    }
}

/// A person on a tether with a wheel on the back: both are named in turn, and the error falls to
/// that of the twin.
#[test]
fn validate_two_effects_on_a_person() {
    let hidden = serde_json::json!([
        {"effect": "tether", "link": "pelvis", "anchor_m": [-2.5, 0.4, 1.5], "rest_length_m": 1.2, "stiffness_npm": 25},
        {"effect": "flywheel", "link": "torso", "momentum_nms": [0.5, 2.5, 0.5]},
    ]);
    let twin = Recorded::new(true, 4, &serde_json::json!([])).unwrap();
    let recorded = Recorded::new(true, 4, &hidden).unwrap();
    let only = ["tether", "constant_force", "crane", "gravity_tilt", "wind", "flywheel", "rotor", "quadratic_drag"];
    let options = DiscoverOptions { only: only.map(str::to_owned).into(), ..Default::default() };
    let of = |r: &Recorded| r.with(|_, session| discover(session, &catalogue(), &[], &options).unwrap());
    let (plain, d) = (of(&twin), of(&recorded));
    // white noise alone does not account for the skin of a person: nothing is named
    assert!(plain.effects.is_empty(), "{}", plain.words);
    let claimed: Vec<&Round> =
        d.rounds.iter().filter(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf)).collect();
    assert_eq!(claimed.len(), 2, "{}", d.words);
    for name in ["tether", "flywheel"] {
        assert!(claimed.iter().any(|r| r.effects.iter().any(|e| e == name)), "{name}: {}", d.words);
    }
    assert!(
        d.held_out_error_after < 1.15 * plain.held_out_error,
        "{} {}",
        d.held_out_error_after,
        plain.held_out_error
    );
    let wheel = d.found.iter().find(|f| f.effect == "flywheel").unwrap();
    assert!((wheel.coefficients[1].value - 2.5).abs() < (3.0 * wheel.coefficients[1].se).max(0.25), "{wheel:?}");
}

#[test]
fn validate_labs() {
    let Some(path) = std::env::var_os("ALOFT_LABS").map(std::path::PathBuf::from) else {
        println!("skipped: ALOFT_LABS=FILE runs the table of simulated laboratories");
        return;
    };
    let word = |name: &str, or: &str| std::env::var(name).unwrap_or_else(|_| or.to_owned());
    let seeds: u64 = word("ALOFT_LABS_SEEDS", "20").parse().unwrap();
    let only = word("ALOFT_LABS_ONLY", "");
    let kinds = word("ALOFT_LABS_OF", "chain human");
    let sizes: Vec<f64> =
        word("ALOFT_LABS_SIZES", "0.5 1 2 4").split_whitespace().map(|s| s.parse().unwrap()).collect();
    let wanted = |effect: &str| only.is_empty() || only.split_whitespace().any(|o| o == effect);
    let mut lines: Vec<Line> = std::fs::read_to_string(&path)
        .ok()
        .unwrap_or_default()
        .lines()
        .filter_map(|l| serde_json::from_str(l).ok())
        .collect();
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&path).unwrap();
    for seed in 1..=seeds {
        for kind in kinds.split_whitespace() {
            let human = kind == "human";
            // every effect at every size, spread evenly over the seeds
            let all: Vec<(&str, f64)> =
                effects(human).iter().flat_map(|e| MULTIPLES.iter().map(move |m| (*e, *m))).collect();
            let stride = seeds.min(10);
            let mine: Vec<(&str, f64)> = all
                .into_iter()
                .enumerate()
                .filter(|(i, (e, m))| *i as u64 % stride == (seed - 1) % stride && wanted(e) && sizes.contains(m))
                .map(|(_, c)| c)
                .collect();
            let done = |key: &str, m: f64, lines: &[Line]| {
                lines.iter().find(|l| l.kind == kind && l.seed == seed && l.key == key && l.multiple == m).cloned()
            };
            let twin_line = done("", 0.0, &lines);
            let left: Vec<(Case, f64)> = mine
                .iter()
                .map(|(e, m)| (case(human, e, seed), *m))
                .filter(|(c, m)| done(&c.key, *m, &lines).is_none())
                .collect();
            if twin_line.is_some() && left.is_empty() {
                continue;
            }
            let Some(twin) = Recorded::new(human, seed, &serde_json::json!([])) else { continue };
            let mut keep = |line: Line, lines: &mut Vec<Line>| {
                writeln!(file, "{}", serde_json::to_string(&line).unwrap()).unwrap();
                println!(
                    "{kind} {seed} `{}` x{} -> {:?} {:?} [{}] before {:.4} after {:.4} twin {:.4} {:.1} s\n      {:?}\n      {:?}",
                    line.key,
                    line.multiple,
                    line.verdict,
                    line.effects,
                    line.outcome,
                    line.before,
                    line.after,
                    line.twin,
                    line.seconds,
                    line.ranking,
                    line.coefficients
                );
                lines.push(line);
            };
            let twin_line = twin_line.unwrap_or_else(|| {
                let made = line(kind, seed, None, f64::NAN, &twin);
                keep(made.clone(), &mut lines);
                made
            });
            for (case, multiple) in left {
                let size = multiple * detectable_size(&twin, human, &case);
                let Some(recorded) = Recorded::new(human, seed, &case.hidden(size)) else {
                    println!("{kind} {seed} `{}` x{multiple}: cannot be simulated", case.key);
                    continue;
                };
                let made = line(kind, seed, Some((&case, multiple, size)), twin_line.before, &recorded);
                keep(made, &mut lines);
            }
        }
    }
    let text = table::markdown(&lines);
    println!("{text}");
    std::fs::write(path.with_extension("md"), text).unwrap();
    let share = |of: &dyn Fn(&&Line) -> bool, among: &dyn Fn(&&Line) -> bool| {
        let n = lines.iter().filter(among).count();
        lines.iter().filter(among).filter(of).count() as f64 / n.max(1) as f64
    };
    let wrong = share(&|l| l.outcome == "wrong", &|l| !l.key.is_empty());
    let alarms = share(&|l| l.outcome == "false alarm", &|l| l.key.is_empty());
    assert!(wrong <= 0.05 && alarms <= 0.05, "wrong names {wrong:.3}, false alarms {alarms:.3}");
}
