//! Whatever `next:` prints can be typed: the command ends with exit code 0, and an effect or law
//! that it adds leaves the error that `discover` promised.

use crate::robot_joints::laboratory;
use crate::support::{expect, folder, json, repo};
use serde_json::Value;
use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};

/// Most steps of a chain of proposals: each adds an effect, asks again, or ends with the report.
const MOST: usize = 12;

/// A study that a user follows.
struct Followed {
    dir: tempfile::TempDir,
    pipeline: PathBuf,
    data: PathBuf,
    /// Verdicts of `discover`, in order.
    verdicts: RefCell<Vec<String>>,
    /// Errors of the torques of joints that the last answer promises.
    promised_in_joints: RefCell<Vec<(String, f64)>>,
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
        Self { dir, pipeline: own, data, verdicts: RefCell::default(), promised_in_joints: RefCell::default() }
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

    /// What an answer promises: places, and the errors there.
    fn promised(&self) -> Vec<(String, f64)> {
        let words = [vec!["discover".to_owned()], self.at(), vec!["--json".to_owned()]].concat();
        let found = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
        self.verdicts.borrow_mut().push(found["verdict"].as_str().unwrap().to_owned());
        errors(&found["errors_after"])
    }

    /// What an answer promises of the torques of joints: joints, and the errors there.
    fn promised_of_joints(&self) -> Vec<(String, f64)> {
        let words = [vec!["discover".to_owned()], self.at(), vec!["--json".to_owned()]].concat();
        let found = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
        let joints = found["joints"]["joints"].as_array().cloned().unwrap_or_default();
        let of = |j: &Value| Some((j["joint"].as_str()?.to_owned(), j["held_out_error_after"].as_f64()?));
        joints.iter().filter_map(of).collect()
    }

    /// Errors of the torques of joints that the last rung changed.
    fn reached_in_joints(&self) -> Vec<(String, f64)> {
        let words = [vec!["history".to_owned()], self.at(), vec!["--json".to_owned()]].concat();
        let history = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
        let joints = history["revisions"].as_array().unwrap().last().unwrap()["joints"].as_array().cloned();
        let of = |j: &Value| Some((j["joint"].as_str()?.to_owned(), j["held_out_error"].as_f64()?));
        joints.unwrap_or_default().iter().filter_map(of).collect()
    }

    /// Held-out errors of the last rung, likewise.
    fn reached(&self) -> Vec<(String, f64)> {
        let words = [vec!["history".to_owned()], self.at(), vec!["--json".to_owned()]].concat();
        let history = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
        errors(&history["revisions"].as_array().unwrap().last().unwrap()["errors"])
    }

    /// Follows what is proposed, from `run` on, until the report is; the verbs in their order. Once
    /// all that an answer names is in the model, its error is the promised one.
    fn follow(&self) -> Vec<String> {
        let mut verbs = Vec::new();
        let mut promised: Vec<(String, f64)> = Vec::new();
        let mut next = self.call(&[vec!["run".to_owned()], self.at()].concat());
        while let Some(words) = next.filter(|_| verbs.len() < MOST) {
            assert_eq!(words[0], "aloft", "{words:?}");
            let is_effect = words[1] == "effect";
            verbs.push(if is_effect { words[1..3].join(" ") } else { words[1].clone() });
            next = self.call(&words[1..]);
            match verbs.last().unwrap().as_str() {
                "discover" => {
                    promised = self.promised();
                    *self.promised_in_joints.borrow_mut() = self.promised_of_joints();
                }
                "effect add" if next.as_ref().is_none_or(|n| n[1] != "effect") => {
                    assert!(!promised.is_empty() || !self.promised_in_joints.borrow().is_empty(), "{verbs:?}");
                    let reached = self.reached();
                    for (name, b) in &promised {
                        let (_, a) = reached.iter().find(|r| r.0 == *name).unwrap();
                        assert!((a / b - 1.0).abs() < 1e-6, "{a}, promised {b} in {name}");
                    }
                }
                "report" | "check" => break,
                _ => {}
            }
        }
        verbs
    }
}

/// Held-out errors of a list, by the place where they are judged.
fn errors(list: &Value) -> Vec<(String, f64)> {
    let of = |e: &Value| (e["judged_on"].as_str().unwrap().to_owned(), e["held_out_error"].as_f64().unwrap());
    list.as_array().unwrap().iter().map(of).collect()
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
fn what_is_proposed_where_effects_cannot_be_told_apart_runs_and_keeps_its_promise() {
    let study = chain("{effect: constant_force, link: link0, force_n: [0.02, 0.0, 0.0]}", FEW);
    assert_eq!(study.follow(), ["discover", "effect add", "report"]);
    assert_eq!(*study.verdicts.borrow(), ["one_of"], "the test has lost its case");
}

#[test]
fn what_is_proposed_where_nothing_can_be_detected_runs() {
    let body = "{kind: chain, throws: {recordings: 2, throws: 3}}";
    let text = format!("name: few\nseed: 64\nbody: {body}\ncapture: {{marker_noise_m: 0.0003}}\nhidden: []\n");
    let study = Followed::simulated(&text, "chain");
    assert_eq!(study.follow(), ["discover", "report"]);
    assert_eq!(*study.verdicts.borrow(), ["not_detectable"], "the test has lost its case");
}

/// No effect of the catalogue explains a force that pulses; a law does, which is added by its name.
#[test]
fn what_is_proposed_for_what_the_catalogue_does_not_explain_runs_and_keeps_its_promise() {
    let study = chain(PULSE, FEW);
    assert_eq!(study.follow(), ["discover", "effect add", "report"]);
    assert_eq!(*study.verdicts.borrow(), ["unexplained"], "the test has lost its case");
}

/// A force that pulses at 4.7 Hz: faster than the bounds of its frequency once allowed for
/// recordings of this length.
const PULSE: &str = "{effect: thrust, link: link1, point_m: [-0.1, 0.0, 0.0], force_n: [0.0, 0.6, 0.0], \
    period_s: 0.21277, on_s: 0.05}";

/// The body is at its floor, and the torque of one joint is not: `run` proposes to ask, and the law
/// leaves the error of the torque that was promised.
#[test]
fn what_is_proposed_for_a_law_of_a_joint_runs_and_keeps_its_promise() {
    let dir = folder();
    let data = dir.path().join("lab");
    laboratory(&data, 11, Some(("l_elbow", |_, v| 0.6 * (-(v / 0.8).powi(2)).exp() * v.signum())));
    let study = Followed::of(dir, data, "robot");
    assert_eq!(study.follow(), ["discover", "effect add", "report"]);
    assert_eq!(*study.verdicts.borrow(), ["nothing_missing"], "the test has lost its case");
    let (promised, reached) = (study.promised_in_joints.borrow().clone(), study.reached_in_joints());
    let (_, a) = reached.iter().find(|r| r.0 == "l_elbow").unwrap();
    let (_, b) = promised.iter().find(|r| r.0 == "l_elbow").unwrap();
    assert!((a / b - 1.0).abs() < 1e-6, "{a}, promised {b}");
}

/// Without a hidden law the joints are at their floors, too, and nothing is asked.
#[test]
fn nothing_is_asked_of_a_robot_whose_body_and_joints_are_at_their_floors() {
    let dir = folder();
    let data = dir.path().join("lab");
    laboratory(&data, 21, None);
    assert_eq!(Followed::of(dir, data, "robot").follow(), ["report"]);
}

/// Six throws in each recording instead of four.
#[test]
fn what_is_proposed_for_two_effects_runs_and_keeps_its_promise() {
    let many = "{recordings: 3, throws: 6, carry_s: [0.9, 1.1], static_s: 0.8, calibration_s: 6.0}";
    let two =
        "{effect: quadratic_drag, drag_area_m2: 0.03}, {effect: gravity_tilt, about_x_deg: 0.5, about_y_deg: -0.4}";
    let verbs = chain(two, many).follow();
    assert!(verbs.iter().filter(|v| *v == "effect add").count() >= 2, "{verbs:?}");
}

/// A load that is carried in some recordings, of which some hold no flight.
#[test]
fn what_is_proposed_for_a_load_in_some_recordings_runs_and_keeps_its_promise() {
    let load = "name: two\nseed: 52\nbody: {kind: human, person: {sex: F, height_m: 1.66, mass_kg: 60.0}, \
        protocol: {jumps: 6, exercises: 2, exercise_s: 3.0}}\nhidden: [{effect: payload, link: hand_r, \
        point_m: [0.0, -0.06, 0.0], mass_kg: 1.2, trials: [jump04, jump05, jump06, exercise02]}]\n";
    assert_eq!(Followed::simulated(load, "human").follow()[..2], ["discover", "effect add"]);
}

#[test]
fn what_is_proposed_for_a_law_of_many_flights_runs_and_keeps_its_promise() {
    let verbs = chain(PULSE, "{recordings: 5, throws: 6}").follow();
    assert_eq!(verbs, ["discover", "effect add", "report"]);
}
