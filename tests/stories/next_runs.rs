//! Whatever `next:` prints can be typed: the command ends with exit code 0, and an effect or law
//! that it adds leaves the error that `discover` promised.

use crate::support::{expect, folder, json, repo};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Most steps of a chain of proposals: each adds an effect, asks again, or ends with the report.
const MOST: usize = 12;

/// A study that a user follows.
struct Followed {
    dir: tempfile::TempDir,
    pipeline: PathBuf,
    data: PathBuf,
}

impl Followed {
    /// A study of a simulated laboratory with a pipeline of its own, beside which laws are written.
    fn simulated(scenario: &str, pipeline: &str) -> Self {
        let dir = folder();
        let (file, data) = (dir.path().join("scenario.yaml"), dir.path().join("lab"));
        fs::write(&file, scenario).unwrap();
        expect(&["simulate", &file.display().to_string(), "--out", &data.display().to_string()], 0);
        Self::of(dir, data, pipeline)
    }

    fn of(dir: tempfile::TempDir, data: PathBuf, pipeline: &str) -> Self {
        let own = dir.path().join("study.yaml");
        let text = fs::read_to_string(repo(&format!("pipelines/{pipeline}.yaml"))).unwrap();
        fs::write(&own, text.replace("../fixtures", &repo("fixtures"))).unwrap();
        Self { dir, pipeline: own, data }
    }

    fn at(&self) -> Vec<String> {
        let ws = self.dir.path().join("ws");
        let show = |p: &Path| p.display().to_string();
        [show(&self.pipeline), "--data".to_owned(), show(&self.data), "--workspace".to_owned(), show(&ws)].to_vec()
    }

    /// Runs a command; what it proposes next.
    fn call(&self, words: &[String]) -> Option<Vec<String>> {
        let (out, err) = expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), 0);
        let line = out.lines().chain(err.lines()).find_map(|l| l.strip_prefix("next: "))?.to_owned();
        Some(shell_words(&line))
    }

    fn errors_after(&self) -> Vec<Value> {
        let words = [vec!["discover".to_owned()], self.at(), vec!["--json".to_owned()]].concat();
        let found = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
        found["errors_after"].as_array().unwrap().clone()
    }

    /// Held-out errors of the last rung.
    fn reached(&self) -> Vec<Value> {
        let words = [vec!["history".to_owned()], self.at(), vec!["--json".to_owned()]].concat();
        let history = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
        history["revisions"].as_array().unwrap().last().unwrap()["errors"].as_array().unwrap().clone()
    }

    /// Follows what is proposed, from `run` on, until the report is; the verbs in their order. Once
    /// all that an answer names is in the model, its error is the promised one.
    fn follow(&self) -> Vec<String> {
        let mut verbs = Vec::new();
        let mut promised: Vec<Value> = Vec::new();
        let mut next = self.call(&[vec!["run".to_owned()], self.at()].concat());
        while let Some(words) = next.filter(|_| verbs.len() < MOST) {
            assert_eq!(words[0], "aloft", "{words:?}");
            let is_effect = words[1] == "effect";
            verbs.push(if is_effect { words[1..3].join(" ") } else { words[1].clone() });
            next = self.call(&words[1..]);
            match verbs.last().unwrap().as_str() {
                "discover" => promised = self.errors_after(),
                "effect add" if next.as_ref().is_none_or(|n| n[1] != "effect") => {
                    assert!(!promised.is_empty(), "{verbs:?}");
                    let reached = self.reached();
                    for e in &promised {
                        let now = reached.iter().find(|r| r["judged_on"] == e["judged_on"]).unwrap();
                        let (a, b) = (now["held_out_error"].as_f64().unwrap(), e["held_out_error"].as_f64().unwrap());
                        assert!((a / b - 1.0).abs() < 1e-6, "{a} N, promised {b} N in {}", e["judged_on"]);
                    }
                }
                "report" | "check" => break,
                _ => {}
            }
        }
        verbs
    }
}

/// The words of a command line, as a shell separates them.
fn shell_words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quoted) = (Vec::new(), String::new(), false);
    for c in line.chars() {
        match c {
            '\'' => quoted = !quoted,
            ' ' if !quoted => words.push(std::mem::take(&mut word)),
            c => word.push(c),
        }
    }
    words.push(word);
    words.retain(|w| !w.is_empty());
    words
}

fn chain(hidden: &str, throws: &str) -> Followed {
    let text = format!("name: chain\nseed: 47\nbody: {{kind: chain, throws: {throws}}}\nhidden: [{hidden}]\n");
    Followed::simulated(&text, "chain")
}

/// Twelve throws in three short recordings.
const FEW: &str = "{recordings: 3, throws: 4, carry_s: [0.9, 1.1], static_s: 0.8, calibration_s: 6.0}";

#[test]
fn what_is_proposed_for_an_effect_that_is_sure_runs_and_keeps_its_promise() {
    let verbs = chain("{effect: quadratic_drag, drag_area_m2: 0.03}", FEW).follow();
    assert_eq!(verbs[..2], ["discover", "effect add"], "{verbs:?}");
    assert_eq!(verbs.last().unwrap(), "report", "{verbs:?}");
}

#[test]
fn what_is_proposed_where_nothing_is_missing_and_for_too_few_flights_runs() {
    assert_eq!(chain("", FEW).follow().last().unwrap(), "report");
    let few = "{recordings: 1, throws: 3, carry_s: [0.9, 1.1], static_s: 0.8, calibration_s: 6.0}";
    assert_eq!(chain("{effect: quadratic_drag, drag_area_m2: 0.03}", few).follow().last().unwrap(), "report");
}

#[test]
fn what_is_proposed_for_a_correction_runs() {
    let person = "{sex: F, height_m: 1.66, mass_kg: 60.0}";
    let body = format!("{{kind: human, person: {person}, protocol: {{jumps: 3, exercises: 1}}}}");
    let text = format!("name: rate\nseed: 35\nbody: {body}\nhidden: [{{effect: time_base, true_rate_hz: 240.0}}]\n");
    assert_eq!(Followed::simulated(&text, "human").follow(), ["check"]);
}

#[test]
#[ignore = "half a minute of a processor each: effects that cannot be told apart, two effects, loads, laws"]
fn what_is_proposed_for_several_effects_and_for_laws_runs_and_keeps_its_promise() {
    let many = "{recordings: 3, throws: 6, carry_s: [0.9, 1.1], static_s: 0.8, calibration_s: 6.0}";
    let two =
        "{effect: quadratic_drag, drag_area_m2: 0.03}, {effect: gravity_tilt, about_x_deg: 0.5, about_y_deg: -0.4}";
    let verbs = chain(two, many).follow();
    assert!(verbs.iter().filter(|v| *v == "effect add").count() >= 2, "{verbs:?}");
    let load = "name: two\nseed: 52\nbody: {kind: human, person: {sex: F, height_m: 1.66, mass_kg: 60.0}, \
        protocol: {jumps: 6, exercises: 2, exercise_s: 3.0}}\nhidden: [{effect: payload, link: hand_r, \
        point_m: [0.0, -0.06, 0.0], mass_kg: 1.2, trials: [jump04, jump05, jump06, exercise02]}]\n";
    assert_eq!(Followed::simulated(load, "human").follow()[..2], ["discover", "effect add"]);
    // a law of the clock, faster than the bounds of its frequency allowed for recordings of this
    // length
    let pulse = "{effect: thrust, link: link1, point_m: [-0.1, 0.0, 0.0], force_n: [0.0, 0.6, 0.0], \
        period_s: 0.21277, on_s: 0.05}";
    let verbs = chain(pulse, "{recordings: 5, throws: 6}").follow();
    assert_eq!(verbs, ["discover", "effect add", "report"]);
}
