//! Simulates a laboratory session: trials as structures, then as files.

use crate::check::{check_capture, check_hidden};
use crate::describe;
use crate::error::SimulateError;
use crate::files::c3d;
use crate::hidden::Hidden;
use crate::human::Person;
use crate::human::person::LABELS;
use crate::human::session::{HumanTrial, play};
use crate::measure::cameras::{self, SoftTissue};
use crate::measure::feet::FootPrints;
use crate::measure::markerless;
use crate::measure::plates::{self, PlateChannels, PlateGeometry};
use crate::object::throws::{self, Session};
use crate::object::{ThrownObject, chain, custom};
use crate::physics::{Body, Plant, TrueMotion, Wrench};
use crate::random::Stream;
use crate::scenario::{BodySpec, HumanLab, Scenario, ThrowProtocol};
use crate::truth::{self, TrialTruth, Truth};
use aloft_c3d::SegmentPoses;
use aloft_trial::{Event, Markers, Trial};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// One file of a laboratory folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabFile {
    /// Path relative to the folder, with `/`.
    pub path: String,
    /// Contents.
    pub bytes: Vec<u8>,
}

/// One recording, measured and true.
#[derive(Debug, Clone)]
pub struct LabTrial {
    /// Name: the file's stem.
    pub name: String,
    /// Kind: `static`, `jump`, `exercise`, `calibration`, `throws`.
    pub kind: &'static str,
    /// Markers as measured, m.
    pub markers: Markers,
    /// Poses of segments, where no markers were worn.
    pub poses: Option<SegmentPoses>,
    /// Plates as measured; empty if there are none.
    pub plates: Vec<PlateChannels>,
    /// Events in the file (some trials have none).
    pub events: Vec<Event>,
    /// Missing stretches.
    pub gaps: Vec<cameras::Gap>,
    /// The true motion, tick by tick.
    pub motion: TrueMotion,
    /// Styles of flights.
    pub styles: Vec<&'static str>,
    /// Number of random draws needed for a feasible trial.
    pub attempts: usize,
    /// True wrench of each plate on the subject about the world origin, at ticks (left, right).
    pub true_plates: Vec<Vec<Wrench>>,
}

/// A whole session.
#[derive(Debug, Clone)]
pub struct Lab {
    /// Name of the scenario.
    pub name: String,
    /// The true body (without payloads): its model carries the stated gravity.
    pub body: Body,
    /// Number of ticks in a camera frame.
    pub ticks_per_frame: usize,
    /// Recordings in the order of the session.
    pub trials: Vec<LabTrial>,
    /// Truth of the session.
    pub truth: Truth,
    /// Everything as files, `truth/` included.
    pub files: Vec<LabFile>,
}

impl Lab {
    /// Finds a recording by name.
    pub fn trial(&self, name: &str) -> Option<&LabTrial> {
        self.trials.iter().find(|t| t.name == name)
    }
}

impl LabTrial {
    /// The recording as an import returns it: markers and calibrated plates in SI units and world
    /// axes.
    pub fn to_trial(&self) -> Trial {
        let per_frame = self.plates.first().map_or(1, |p| p.channels[0].len() / self.markers.n_frames.max(1));
        let rate = self.markers.rate_hz * per_frame as f64;
        Trial {
            name: self.name.clone(),
            markers: self.markers.clone(),
            plates: self.plates.iter().enumerate().map(|(i, p)| p.plate(&format!("FP{}", i + 1), rate)).collect(),
            events: self.events.clone(),
            ..Trial::default()
        }
    }
}

/// Simulates a scenario.
///
/// # Errors
/// [`SimulateError`] if a value of the scenario is invalid, or no feasible motion is found.
pub fn simulate(scenario: &Scenario) -> Result<Lab, SimulateError> {
    check_capture(scenario)?;
    match &scenario.body {
        BodySpec::Human(lab) => human(scenario, lab),
        BodySpec::Chain(lab) => {
            let object = chain::chain(scenario, &lab.object)?;
            thrown(scenario, &object, &lab.throws, true)
        }
        BodySpec::Custom(lab) => {
            let object = custom::custom(scenario, lab)?;
            thrown(scenario, &object, &lab.throws, false)
        }
    }
}

fn true_rate(scenario: &Scenario) -> f64 {
    let stated = scenario.capture.point_rate_hz;
    scenario.hidden.iter().fold(stated, |rate, effect| match effect {
        Hidden::TimeBase { true_rate_hz } => *true_rate_hz,
        _ => rate,
    })
}

fn scale_reading(scenario: &Scenario, body: &Body) -> f64 {
    let mass: f64 = body.phi.iter().map(|p| p[0]).sum();
    scenario.hidden.iter().fold(mass, |mass, effect| match effect {
        Hidden::BodyMass { error_kg } => mass + error_kg,
        _ => mass,
    })
}

fn human(scenario: &Scenario, lab: &HumanLab) -> Result<Lab, SimulateError> {
    let protocol = &lab.protocol;
    let seconds = 0.2..=1.2;
    for (field, value) in [("shortest", protocol.flight_s[0]), ("longest", protocol.flight_s[1])] {
        scenario.expect(&format!("body.protocol.flight_s ({field})"), value, seconds.clone(), "0.2 to 1.2 s")?;
    }
    scenario.expect("body.protocol.vigour", protocol.vigour, 0.0..=1.5, "0 to 1.5")?;
    scenario.expect("body.protocol.exercise_s", protocol.exercise_s, 0.5..=120.0, "0.5 to 120 s")?;
    scenario.expect("body.protocol.jumps", protocol.jumps as f64, 0.0..=200.0, "0 to 200")?;
    scenario.expect("body.protocol.exercises", protocol.exercises as f64, 0.0..=200.0, "0 to 200")?;
    scenario.expect("body.protocol.flights", protocol.flights[1] as f64, 1.0..=20.0, "1 to 20")?;
    scenario.expect("body.protocol.static_s", protocol.static_s, 0.2..=60.0, "0.2 to 60 s")?;
    let person = Person::new(scenario, &lab.person)?;
    let n_plates = if protocol.plates { 2 } else { 0 };
    check_hidden(scenario, &person.body, n_plates)?;
    let per_frame = scenario.capture.analog_per_frame;
    // without plates the tick still has to be short enough to integrate the motion
    let ticks_per_frame = refine(scenario, per_frame);
    let tick_s = 1.0 / (true_rate(scenario) * ticks_per_frame as f64);

    let plays = |trial: HumanTrial| -> Result<_, SimulateError> {
        let plant = Plant::new(&person.body, &scenario.hidden, &trial.name())?;
        play(scenario, &person, &plant, protocol, trial, tick_s)
    };
    // markers are attached in the posture of the static trial
    let still = plays(HumanTrial::Static)?;
    let q_rest = still.motion.q(still.motion.n_ticks() / 2).to_vec();
    let capture = &scenario.capture;
    let mut tissue = SoftTissue::of_person(
        &person.body.model,
        &person.markers,
        capture.soft_tissue_m,
        &q_rest,
        &scenario.hidden,
        &mut Stream::new(scenario.capture_seed(), "skin"),
    );
    let mut of_clusters = Stream::new(scenario.capture_seed(), "clusters");
    tissue.move_clusters(&person.body.model, &person.markers, capture.soft_cluster_m, &mut of_clusters);
    let all = HumanTrial::all(protocol);
    let trials: Vec<LabTrial> = all
        .par_iter()
        .enumerate()
        .map(|(index, trial)| -> Result<LabTrial, SimulateError> {
            let played = if *trial == HumanTrial::Static { still.clone() } else { plays(*trial)? };
            let name = trial.name();
            let motion = played.motion;
            let stream = |purpose: &str| Stream::new(scenario.capture_seed(), &format!("{name}/{purpose}"));
            let worn = if *trial == HumanTrial::Static { person.markers.len() } else { LABELS.len() };
            let mut markers = cameras::record(
                &person.body.model,
                &person.markers,
                worn,
                &motion,
                ticks_per_frame,
                &tissue,
                capture,
                &scenario.hidden,
                &mut stream("noise"),
            );
            let poses = match &capture.markerless {
                Some(spec) => {
                    let poses = markerless::record(
                        &person.body.model,
                        &motion,
                        ticks_per_frame,
                        capture.point_rate_hz,
                        spec,
                        &person.ball_m,
                        &mut Stream::new(scenario.capture_seed(), "centres"),
                        &mut stream("poses"),
                    );
                    let field = "capture.markerless.cutoff_hz";
                    Some(
                        poses
                            .map_err(|e| scenario.value_error(field, e.to_string(), "a cut-off below half the rate"))?,
                    )
                }
                None => None,
            };
            let gaps = match trial {
                HumanTrial::Static => Vec::new(),
                _ => cameras::lose(&mut markers, capture, &mut stream("gaps")),
            };
            let (plates, true_plates) = if protocol.plates {
                plate_recordings(scenario, &person, &motion, markers.n_frames, ticks_per_frame, index, &name)
            } else {
                (Vec::new(), Vec::new())
            };
            let events = match trial {
                HumanTrial::Jump(n) if n % 3 == 1 => {
                    foot_events(&true_plates, capture.point_rate_hz * ticks_per_frame as f64)
                }
                _ => Vec::new(),
            };
            Ok(LabTrial {
                kind: trial.kind(),
                markers,
                poses,
                plates,
                events,
                gaps,
                motion,
                styles: played.styles,
                attempts: played.attempts,
                true_plates,
                name,
            })
        })
        .collect::<Result<_, _>>()?;

    let mass = scale_reading(scenario, &person.body);
    let listed: Vec<(String, &'static str)> = trials.iter().map(|t| (t.name.clone(), t.kind)).collect();
    let subject = describe::subject(scenario, &lab.person, mass, protocol.plates, &listed);
    let mut extra = BTreeMap::new();
    let facts = [
        ("subject", serde_json::json!(scenario.name)),
        ("sex", serde_json::json!(lab.person.sex)),
        ("height", serde_json::json!(lab.person.height_m)),
        ("noise_mm", serde_json::json!(1000.0 * capture.marker_noise_m)),
        ("sta_mm", serde_json::json!(1000.0 * capture.soft_tissue_m)),
        ("true_rate", serde_json::json!(true_rate(scenario))),
    ];
    extra.extend(facts.map(|(k, v)| (k.to_owned(), v)));
    let truth = truth_of(
        scenario,
        &person.body,
        truth::markers(&person.body, &person.markers),
        &trials,
        ticks_per_frame,
        "X anterior, Y up, Z right in the upright neutral posture; origin at the proximal joint centre, the pelvis' midway \
         between the hips",
        extra,
    )?;
    finish(scenario, person.body, ticks_per_frame, trials, truth, ("subject.yaml", subject))
}

/// Ticks in a frame: a multiple of the analog samples that makes a tick at most one millisecond
/// long (within rounding).
fn refine(scenario: &Scenario, per_frame: usize) -> usize {
    let needed = (1000.0 / true_rate(scenario) - 1e-9).ceil().max(1.0) as usize;
    // slightly more than a millisecond is acceptable if the true rate only differs from a round one
    // by a small error
    let needed = if (needed as f64 - 1.0) * true_rate(scenario) > 990.0 { needed - 1 } else { needed };
    needed.div_ceil(per_frame).max(1) * per_frame
}

fn plate_recordings(
    scenario: &Scenario,
    person: &Person,
    motion: &TrueMotion,
    n_frames: usize,
    ticks_per_frame: usize,
    index: usize,
    name: &str,
) -> (Vec<PlateChannels>, Vec<Vec<Wrench>>) {
    let capture = &scenario.capture;
    let feet = FootPrints::of(person, motion);
    let mut wrenches: [Vec<Wrench>; 2] = std::array::from_fn(|_| vec![Wrench::default(); motion.n_ticks()]);
    for tick in 0..motion.n_ticks() {
        let flying = motion.flights.iter().any(|[a, b]| (*a..=*b).contains(&tick));
        if !flying {
            let [right, left] = feet.divide(tick, &motion.contact[tick]);
            wrenches[0][tick] = left;
            wrenches[1][tick] = right;
        }
    }
    let samples = n_frames * capture.analog_per_frame;
    let step = ticks_per_frame / capture.analog_per_frame;
    let dt = motion.tick_s * step as f64;
    let (mut offset, mut rate, mut session) = (0.0, 0.0, 0.0);
    for effect in &scenario.hidden {
        match effect {
            Hidden::PlateTimeOffset { offset_s } => offset += offset_s,
            Hidden::ClockDrift { rate_ppm, spacing_s } => {
                rate += 1e-6 * rate_ppm;
                session += spacing_s * index as f64;
            }
            _ => {}
        }
    }
    // time of sample k, in samples of the cameras' clock
    let clock = |k: f64| k - (offset + rate * (session + k * dt)) / dt;
    let channels = wrenches
        .iter()
        .zip(PlateGeometry::pair())
        .enumerate()
        .map(|(plate, (wrench, geometry))| {
            let sampled: Vec<Wrench> = (0..samples).map(|k| wrench[(k * step).min(motion.n_ticks() - 1)]).collect();
            let rng = &mut Stream::new(scenario.capture_seed(), &format!("{name}/plate{}", plate + 1));
            plates::record(plate, &geometry, &sampled, capture, &scenario.hidden, &clock, rng)
        })
        .collect();
    (channels, wrenches.into())
}

/// `Foot Off` and `Foot Strike` where a plate's load crosses 10 N.
fn foot_events(true_plates: &[Vec<Wrench>], tick_rate_hz: f64) -> Vec<Event> {
    let mut events = Vec::new();
    for (plate, context) in true_plates.iter().zip(["Left", "Right"]) {
        for tick in 1..plate.len() {
            let loaded = |t: usize| plate[t].force_n.z > 10.0;
            let label = match (loaded(tick - 1), loaded(tick)) {
                (true, false) => "Foot Off",
                (false, true) => "Foot Strike",
                _ => continue,
            };
            let time_s = tick as f64 / tick_rate_hz;
            events.push(Event { label: label.to_owned(), context: context.to_owned(), time_s });
        }
    }
    events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    events
}

fn thrown(
    scenario: &Scenario,
    object: &ThrownObject,
    protocol: &ThrowProtocol,
    is_chain: bool,
) -> Result<Lab, SimulateError> {
    let p = "body.throws";
    scenario.expect(&format!("{p}.recordings"), protocol.recordings as f64, 1.0..=99.0, "1 to 99")?;
    scenario.expect(&format!("{p}.throws"), protocol.throws as f64, 1.0..=100.0, "1 to 100")?;
    for value in protocol.flight_s {
        scenario.expect(&format!("{p}.flight_s"), value, 0.1..=3.0, "0.1 to 3 s")?;
    }
    for value in protocol.spin_radps {
        scenario.expect(&format!("{p}.spin_radps"), value, 0.0..=60.0, "0 to 60 rad/s")?;
    }
    scenario.expect(&format!("{p}.static_s"), protocol.static_s, 0.1..=60.0, "0.1 to 60 s")?;
    scenario.expect(&format!("{p}.calibration_s"), protocol.calibration_s, 0.5..=120.0, "0.5 to 120 s")?;
    scenario.expect(&format!("{p}.joint_rate_radps"), protocol.joint_rate_radps, 0.0..=60.0, "0 to 60 rad/s")?;
    check_hidden(scenario, &object.body, 0)?;
    let ticks_per_frame = refine(scenario, 1);
    let tick_s = 1.0 / (true_rate(scenario) * ticks_per_frame as f64);
    let calibration = if is_chain { "hinge_calib" } else { "joint_calib" };
    let mut names = vec![("static".to_owned(), "static"), (calibration.to_owned(), "calibration")];
    names.extend((1..=protocol.recordings).map(|i| (format!("throws_{i:02}"), "throws")));
    let session = Session::new(object, protocol);
    let capture = &scenario.capture;
    let trials: Vec<LabTrial> = names
        .par_iter()
        .map(|(name, kind)| -> Result<LabTrial, SimulateError> {
            let plant = Plant::new(&object.body, &scenario.hidden, name)?;
            let stream = |purpose: &str| Stream::new(scenario.capture_seed(), &format!("{name}/{purpose}"));
            let motion_stream = || Stream::new(scenario.seed, &format!("{name}/motion"));
            let ticks = |seconds: f64| (seconds / tick_s).round() as usize;
            let motion = match *kind {
                "static" => throws::lie_still(object, &plant, tick_s, ticks(protocol.static_s))?,
                "calibration" => {
                    throws::calibration(object, &plant, tick_s, ticks(protocol.calibration_s), &mut motion_stream())?
                }
                _ => session.record(&plant, tick_s, &mut motion_stream())?,
            };
            let mut markers = cameras::record(
                &object.body.model,
                &object.markers,
                object.markers.len(),
                &motion,
                ticks_per_frame,
                &SoftTissue::none(),
                capture,
                &scenario.hidden,
                &mut stream("noise"),
            );
            let gaps =
                if *kind == "static" { Vec::new() } else { cameras::lose(&mut markers, capture, &mut stream("gaps")) };
            Ok(LabTrial {
                name: name.clone(),
                kind,
                markers,
                poses: None,
                plates: Vec::new(),
                events: Vec::new(),
                gaps,
                motion,
                styles: Vec::new(),
                attempts: 1,
                true_plates: Vec::new(),
            })
        })
        .collect::<Result<_, _>>()?;

    let mass = scale_reading(scenario, &object.body);
    let (description, extra, frames) = if is_chain {
        let extra = truth::chain_extra(&object.body, &object.markers, object.damping, object.friction);
        (describe::chain(scenario, mass, protocol.recordings), extra, "as object.yaml defines them")
    } else {
        let text = describe::custom(scenario, &object.body.model, &object.markers, mass, protocol.recordings);
        (text, BTreeMap::new(), "those of the model")
    };
    let markers = truth::markers(&object.body, &object.markers);
    let mut truth = truth_of(scenario, &object.body, markers, &trials, ticks_per_frame, frames, extra)?;
    let listed = truth::recordings(&truth.trials);
    truth.extra.extend(listed);
    finish(scenario, object.body.clone(), ticks_per_frame, trials, truth, ("object.yaml", description))
}

fn truth_of(
    scenario: &Scenario,
    body: &Body,
    markers: BTreeMap<String, (String, [f64; 3])>,
    trials: &[LabTrial],
    ticks_per_frame: usize,
    frames: &str,
    extra: BTreeMap<String, serde_json::Value>,
) -> Result<Truth, SimulateError> {
    let c = &scenario.capture;
    let plant = Plant::new(body, &scenario.hidden, "")?;
    let names: Vec<&str> = scenario.hidden.iter().map(Hidden::name).collect();
    let trials = trials
        .iter()
        .map(|t| {
            let flight_frames = truth::flight_frames(&t.motion, ticks_per_frame);
            let clock = c.point_rate_hz * ticks_per_frame as f64;
            let in_flight = t.motion.flights.iter().flat_map(|[a, b]| *a..=*b);
            let payload: f64 = scenario
                .hidden
                .iter()
                .map(|e| match e {
                    Hidden::Payload { mass_kg, trials, .. }
                        if trials.is_empty() || trials.iter().any(|p| t.name.starts_with(p.as_str())) =>
                    {
                        *mass_kg
                    }
                    _ => 0.0,
                })
                .sum();
            TrialTruth {
                trial: t.name.clone(),
                kind: t.kind.to_owned(),
                frames: t.markers.n_frames,
                dur: t.markers.n_frames as f64 / c.point_rate_hz,
                flights: t.motion.flights.iter().map(|f| f.map(|tick| tick as f64 / clock)).collect(),
                flight_frames,
                styles: t.styles.iter().map(|s| (*s).to_owned()).collect(),
                flight_resid: in_flight.map(|k| t.motion.contact[k].force_n.norm()).fold(0.0, f64::max),
                attempts: t.attempts,
                gaps: t.gaps.clone(),
                payload: (payload != 0.0).then_some(payload),
            }
        })
        .collect();
    Ok(Truth {
        schema: "aloft-truth/1",
        dataset: scenario.name.clone(),
        seed: scenario.seed,
        effect: if names.is_empty() { "none".to_owned() } else { names.join("+") },
        hidden: scenario.hidden.clone(),
        true_gravity: plant.model.gravity_mps2.into(),
        nominal_gravity: body.model.gravity_mps2.into(),
        true_rate_hz: true_rate(scenario),
        header_rate_hz: c.point_rate_hz,
        noise_sigma_m: c.marker_noise_m,
        mass_scale: scale_reading(scenario, body),
        phi_order: truth::PHI_ORDER,
        frames: frames.to_owned(),
        links: truth::LinkTruth::of(body),
        markers,
        base: truth::base(body),
        trials,
        extra,
    })
}

fn finish(
    scenario: &Scenario,
    body: Body,
    ticks_per_frame: usize,
    trials: Vec<LabTrial>,
    truth: Truth,
    description: (&str, String),
) -> Result<Lab, SimulateError> {
    let file = |path: String, bytes: Vec<u8>| LabFile { path, bytes };
    let mut files = vec![file(description.0.to_owned(), description.1.into_bytes())];
    let recordings: Vec<LabFile> = trials
        .par_iter()
        .map(|trial| Ok(file(format!("{}.c3d", trial.name), c3d(scenario, trial)?)))
        .collect::<Result<_, SimulateError>>()?;
    files.extend(recordings);
    let json = serde_json::to_vec_pretty(&truth)
        .map_err(|source| SimulateError::Json { scenario: scenario.name.clone(), source })?;
    files.push(file("truth/truth.json".to_owned(), json));
    if scenario.trajectories {
        for trial in &trials {
            let bytes = truth::trajectories(scenario, &body, &trial.motion, ticks_per_frame);
            files.push(file(format!("truth/truth_{}.npz", trial.name), bytes));
        }
    }
    Ok(Lab { name: scenario.name.clone(), body, ticks_per_frame, trials, truth, files })
}
