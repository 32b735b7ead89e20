//! What `import`, `scale` and `ik` do for robots: logs in place of markers, a model file in place
//! of landmarks, sensors combined in place of inverse kinematics.

use crate::graph::{Recording, StageInputs, StageReport};
use crate::recording::{read_recording, unopened};
use crate::results::Results;
use crate::stages::shared::save_subject;
use aloft_body::Motion;
use aloft_compare::PoseErrors;
use aloft_robot::markers::{BaseFromMarkers, LinkMarker, MarkerRecording, PoseNoise, base_from_markers, compare_links};
use aloft_robot::noise::SensorErrors;
use aloft_robot::{
    BaseLog, Columns, FuseInput, FusionReport, InertiaLimits, RobotError, RobotLog, check, fuse, ros, unknown_contacts,
};
use aloft_study::config::ImportConfig;
use aloft_study::facts::Facts;
use aloft_study::recordings::{base_beside, markers_beside, stem_of};
use aloft_study::robot::RobotSetup;
use aloft_trial::{Corrections, Markers, Trial};
use aloft_workspace::artifact::{save_motion, save_trial};
use aloft_workspace::disk::is_there;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::input;
use aloft_workspace::json::{read_json, read_json_if_there, write_json};
use aloft_workspace::qc::QcReason;
use aloft_workspace::table::{Table, read_numbers};
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde_json::json;
use std::path::Path;

/// Ratio of the mass from the scale to that of the model's links which cannot be one robot.
const ANOTHER_MASS: f64 = 2.0;
/// Noise of poses that come from markers, and markers on other links.
const MARKERS: &str = "markers_on_links.json";

/// Contact of links at the frames of the motion.
pub(crate) const CONTACT: &str = "contact.parquet";

pub(crate) fn failed(error: &RobotError) -> StageFailure {
    match error.hint() {
        Some(hint) => StageFailure::with_hint(error.to_string(), hint),
        None => StageFailure::new(error.to_string()),
    }
    .because(match error {
        RobotError::MissingJoint { .. } => QcReason::MissingJoint,
        _ => QcReason::UnreadableFile,
    })
}

fn columns(file: &Path) -> Result<Columns, StageFailure> {
    let shown = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("parquet")) {
        let table = read_numbers(file).map_err(|e| {
            if matches!(e, PipelineError::Io { .. }) {
                return unopened(&stem_of(file), e);
            }
            let hint = "write the file again (`to_parquet` of pandas, `write_parquet` of polars; compression zstd, snappy, gzip or none), or as CSV";
            StageFailure::with_hint(e.to_string(), hint).because(QcReason::UnreadableFile)
        })?;
        return Columns::of(&shown, table.into_columns()).map_err(|e| failed(&e));
    }
    let bytes = input::bytes(file).map_err(|e| unopened(&stem_of(file), e))?;
    Columns::from_csv(&shown, &bytes).map_err(|e| failed(&e))
}

/// A recording as it was read.
pub struct Logged {
    /// The log.
    pub log: RobotLog,
    /// Its base, where that has a clock of its own.
    pub base: Option<BaseLog>,
    /// Noise of the base's poses and markers on other links, where they come from markers.
    pub markers: Option<(PoseNoise, Vec<LinkMarker>)>,
    /// Remarks.
    pub remarks: Vec<String>,
    /// What corrections did, in words.
    pub corrected: Vec<String>,
}

/// Reads a log with the recording of its base: a table beside it, poses in it, or markers on the
/// base. `corrections` are applied, as to recordings of markers.
pub fn read(
    robot: &RobotSetup,
    import: &ImportConfig,
    corrections: &Corrections,
    recording: &Recording,
) -> Result<Logged, StageFailure> {
    refuse_corrections_of_plates(corrections)?;
    let (log, poses) = if recording.file.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap")) {
        let shown = recording.file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let bytes = input::bytes(&recording.file).map_err(|e| unopened(&recording.name, e))?;
        ros::read(&shown, &bytes, &robot.description.topics).map_err(|e| failed(&e))?
    } else {
        (columns(&recording.file)?, None)
    };
    let mut remarks: Vec<String> = Vec::new();
    if let Some(first) = unknown_contacts(&log, &robot.model).first() {
        remarks.push(format!("the column `{first}` names no link of {}: it is not read", robot.model.file));
    }
    let mut log = RobotLog::of(&log, &robot.model).map_err(|e| failed(&e))?;
    let start_s = log.time_s[0];
    let mut markers = None;
    let mut base = match (base_beside(&recording.file), markers_beside(&recording.file)) {
        (Some(file), _) => Some(BaseLog::of(&columns(&file)?).map_err(|e| failed(&e))?),
        (None, Some(file)) if poses.is_none() && log.base.is_none() => {
            let found = from_markers(robot, import, corrections, recording, &file, start_s)?;
            remarks.extend(found.remarks);
            markers = Some((found.noise, found.others));
            Some(found.base)
        }
        _ => poses.map(|b| BaseLog::of(&b)).transpose().map_err(|e| failed(&e))?,
    };
    if let Some(base) = base.as_mut().filter(|_| markers.is_none()) {
        correct_base(corrections, base, start_s);
    }
    if let Some(base) = &mut log.base {
        correct_base(corrections, base, start_s);
    }
    at_true_rate(corrections, &mut log.time_s, start_s);
    let corrected = corrections.turn().map(|_| corrections.turned()).into_iter();
    let corrected =
        corrected.chain(corrections.rate().map(|ratio| format!("times of the clock divided by {ratio}"))).collect();
    remarks.extend(check(&log, base.as_ref(), &robot.model).map_err(|e| failed(&e))?);
    Ok(Logged { log, base, markers, remarks, corrected })
}

/// A robot's recordings have no force plates.
fn refuse_corrections_of_plates(corrections: &Corrections) -> Result<(), StageFailure> {
    if corrections.plate_delay_s == 0.0 && corrections.plate_zero.is_empty() {
        return Ok(());
    }
    let key = if corrections.plate_zero.is_empty() { "plate_delay_s" } else { "plate_zero" };
    Err(StageFailure::with_hint(
        format!("`corrections: {key}` corrects force plates, and a robot's recordings have none"),
        "take it out; `vertical_deg`, `rate_ratio` and `mass_kg` hold for robots",
    ))
}

/// Times of a clock at the true rate, from the start of the log on.
fn at_true_rate(corrections: &Corrections, time_s: &mut [f64], start_s: f64) {
    if let Some(ratio) = corrections.rate() {
        time_s.iter_mut().for_each(|t| *t = start_s + (*t - start_s) / ratio);
    }
}

/// Poses of a base in the room with the true vertical, at the true rate. What the robot's own
/// sensors measure is in its own axes, and is not turned.
fn correct_base(corrections: &Corrections, base: &mut BaseLog, start_s: f64) {
    at_true_rate(corrections, &mut base.time_s, start_s);
    if let Some(turn) = corrections.turn() {
        base.position_m.iter_mut().for_each(|p| *p = turn * *p);
        base.rotation.iter_mut().for_each(|r| *r = UnitQuaternion::from_rotation_matrix(&turn) * *r);
    }
}

/// The base from the markers beside a log; the clock of the file starts with that of the log until
/// the offset is known.
fn from_markers(
    robot: &RobotSetup,
    import: &ImportConfig,
    corrections: &Corrections,
    recording: &Recording,
    file: &Path,
    start_s: f64,
) -> Result<BaseFromMarkers, StageFailure> {
    let beside = Recording { file: file.to_owned(), forces: None, ..recording.clone() };
    let mut trial = read_recording(import, &[], &beside)?;
    corrections.apply(&mut trial);
    let shown = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let markers = MarkerRecording {
        file: &shown,
        rate_hz: trial.markers.rate_hz,
        start_s,
        labels: &trial.markers.labels,
        trajectories: &trial.markers.trajectories,
    };
    let root = &robot.model.spec.links[0].name;
    base_from_markers(&markers, &robot.description, root).map_err(|e| failed(&e))
}

/// Table of a log as it is kept: times, joints, torques, inertial unit.
fn kept(robot: &RobotSetup, log: &RobotLog) -> Table {
    let mut table = Table::default();
    table.push("time_s", log.time_s.clone());
    let groups = [("q", &log.q), ("dq", &log.dq), ("torque", &log.torque), ("command", &log.command)];
    for (what, values) in groups {
        for (joint, values) in robot.model.joints.iter().zip(values) {
            if !values.is_empty() {
                table.push(format!("{what}.{}", joint.name), values.clone());
            }
        }
    }
    for (what, values) in [("gyro", &log.gyro), ("acc", &log.acc)] {
        if let Some(values) = values {
            push_vectors(&mut table, what, values);
        }
    }
    table
}

fn push_vectors(table: &mut Table, name: &str, values: &[Vector3<f64>]) {
    for (k, axis) in ["x", "y", "z"].iter().enumerate() {
        table.push(format!("{name}.{axis}"), values.iter().map(|v| v[k]).collect());
    }
}

fn kept_base(base: &BaseLog) -> Table {
    let mut table = Table::default();
    table.push("time_s", base.time_s.clone());
    push_vectors(&mut table, "position_m", &base.position_m);
    for (k, axis) in ["x", "y", "z", "w"].iter().enumerate() {
        table.push(format!("rotation.{axis}"), base.rotation.iter().map(|r| r.coords[k]).collect());
    }
    table
}

/// The log of an imported recording.
pub fn load_log(
    robot: &RobotSetup,
    results: Results<'_>,
    name: &str,
) -> Result<(RobotLog, Option<BaseLog>), StageFailure> {
    let place = results.place("import", name)?;
    let mut map = Table::read(&place.join("log.parquet"))?.into_map();
    let vectors = |name: &str, map: &mut std::collections::HashMap<String, Vec<f64>>| {
        let [x, y, z] = ["x", "y", "z"].map(|a| map.remove(&format!("{name}.{a}")));
        let (x, y, z) = (x?, y?, z?);
        Some(x.into_iter().zip(y).zip(z).map(|((x, y), z)| Vector3::new(x, y, z)).collect::<Vec<_>>())
    };
    let (gyro, acc) = (vectors("gyro", &mut map), vectors("acc", &mut map));
    let mut of = |what: &str| -> Vec<Vec<f64>> {
        let joints = robot.model.joints.iter();
        joints.map(|j| map.remove(&format!("{what}.{}", j.name)).unwrap_or_default()).collect()
    };
    let (q, dq, torque, command) = (of("q"), of("dq"), of("torque"), of("command"));
    let time_s = map.remove("time_s").unwrap_or_default();
    let log = RobotLog {
        file: format!("{name} (log)"),
        time_s,
        q,
        dq,
        torque,
        command,
        gyro,
        acc,
        contact: Vec::new(),
        base: None,
    };
    let path = place.join("base.parquet");
    if !is_there(&path)? {
        return Ok((log, None));
    }
    let mut map = Table::read(&path)?.into_map();
    let position_m = vectors("position_m", &mut map).unwrap_or_default();
    let mut part = |a: &str| map.remove(&format!("rotation.{a}")).unwrap_or_default();
    let (x, y, z, w) = (part("x"), part("y"), part("z"), part("w"));
    let rotation =
        (0..w.len()).map(|i| UnitQuaternion::new_unchecked(Quaternion::new(w[i], x[i], y[i], z[i]))).collect();
    let time_s = map.remove("time_s").unwrap_or_default();
    Ok((log, Some(BaseLog { file: format!("{name} (base)"), time_s, position_m, rotation })))
}

/// `import`: reads and checks a log and its base.
pub fn import(
    robot: &RobotSetup,
    import: &ImportConfig,
    corrections: &Corrections,
    inputs: &StageInputs<'_>,
) -> Result<StageReport, StageFailure> {
    let recording = inputs.recording()?;
    let Logged { log, base, markers, remarks, corrected } = read(robot, import, corrections, recording)?;
    let mut done = StageReport::default();
    if !corrected.is_empty() {
        done.note("corrected", json!(corrected));
    }
    if let Some((noise, _)) = &markers {
        done.note("marker_noise_mm", noise.marker_m * 1e3);
        write_json(&inputs.out.join(MARKERS), &markers)?;
    }
    kept(robot, &log).write(&inputs.out.join("log.parquet"))?;
    if let Some(base) = base.as_ref().or(log.base.as_ref()) {
        kept_base(base).write(&inputs.out.join("base.parquet"))?;
    }
    let contact = log.contact_at_frames().map_err(|e| failed(&e))?;
    if !contact.is_empty() {
        let mut table = Table::default();
        for (name, values) in contact {
            table.push(name, values);
        }
        table.write(&inputs.out.join(CONTACT))?;
    }
    write_json(&inputs.out.join("clock.json"), &base.is_none())?;
    let (n, rate_hz) = log.frames().map_err(|e| failed(&e))?;
    let duration_s = n as f64 / rate_hz;
    save_trial(
        inputs.out,
        &Trial {
            name: recording.name.clone(),
            markers: Markers { rate_hz, first_frame: 1, n_frames: n, labels: Vec::new(), trajectories: Vec::new() },
            plates: Vec::new(),
            events: Vec::new(),
            computed: Vec::new(),
            world_from_source: Rotation3::identity(),
            recorded: None,
            person: None,
            people: Vec::new(),
            unused_columns: Vec::new(),
            start_s: log.time_s[0],
            warnings: Vec::new(),
        },
    )?;
    done.note("frames", n);
    done.note("rate_hz", rate_hz);
    done.note("joints", robot.model.joints.len());
    done.note("torques", log.torque.iter().filter(|t| !t.is_empty()).count());
    done.note("inertial_unit", log.gyro.is_some() && log.acc.is_some());
    done.note("duration_s", duration_s);
    done.note("plates", 0);
    done.warnings.extend(remarks);
    Ok(done)
}

/// `scale`: the model file as the subject.
pub fn scale(robot: &RobotSetup, facts: &Facts, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let mut subject =
        aloft_robot::subject(&robot.model, &robot.description, facts.person.clone(), facts.gravity(), robot.spread)
            .map_err(|e| failed(&e))?;
    let ratio = robot.model.mass_kg() / facts.person.mass_kg;
    if !(1.0 / ANOTHER_MASS..ANOTHER_MASS).contains(&ratio) {
        return Err(StageFailure::with_hint(
            format!(
                "the description says that the robot weighs {} kg, and the links of {} weigh {:.2} kg together",
                facts.person.mass_kg,
                robot.model.file,
                robot.model.mass_kg()
            ),
            "`total_mass_kg` is the mass of the whole robot in kg, as it flew; the model's masses are in kg, too",
        ));
    }
    let mut done = StageReport { warnings: robot.model.remarks.clone().into(), ..StageReport::default() };
    if let Some(margin_m) = robot.limits_margin_m {
        let limits = InertiaLimits::of(&robot.model, &subject, margin_m);
        let limited = limits.boxes.iter().flatten().count();
        done.note("links_with_limits", limited);
        subject.provenance.push(format!(
            "inertias of {limited} links are held inside the box about their collision geometry and a margin of {margin_m} m"
        ));
        if !limits.do_not_fit.is_empty() {
            done.warnings.push(format!(
                "the inertia in {} does not fit into the collision geometry of {}: no limit is set there",
                robot.model.file,
                limits.do_not_fit.join(", ")
            ));
        }
        if limited == 0 {
            done.warnings.push(format!(
                "`inertia_limits: collision` has no effect: no link of {} has a limit (meshes are not read)",
                robot.model.file
            ));
        }
        subject.boxes = limits.boxes;
    }
    save_subject(inputs, &subject)?;
    write_json(&inputs.out.join("locked.json"), &Vec::<usize>::new())?;
    done.note("links", subject.model.n_links());
    done.note("joints", robot.model.joints.len());
    done.note("model_mass_kg", robot.model.mass_kg());
    if (ratio - 1.0).abs() > 0.02 {
        done.warnings.push(format!(
            "the model's links weigh {:.2} kg, the scale says {:.2} kg: masses are scaled by {:.3}",
            robot.model.mass_kg(),
            facts.person.mass_kg,
            1.0 / ratio
        ));
    }
    Ok(done)
}

/// `ik`: encoders, base pose and inertial unit to motion.
pub fn motion(robot: &RobotSetup, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let name = inputs.trial()?;
    let subject = inputs.results.load_subject("calibrate")?;
    let (mut log, mut base) = load_log(robot, inputs.results, name)?;
    let own_clock: bool = read_json(&inputs.results.place("import", name)?.join("clock.json"))?;
    if own_clock {
        log.base = base.take();
    }
    let root = &subject.model.links[0].name;
    let imu = robot.description.imu.as_ref();
    let mut done = StageReport::default();
    if let Some(other) = imu.and_then(|i| i.link.as_ref()).filter(|l| *l != root) {
        done.warnings.push(format!("the inertial unit is on `{other}`, not on the base `{root}`: it is not used"));
        (log.gyro, log.acc) = (None, None);
    }
    let path = inputs.results.place("import", name)?.join(MARKERS);
    let markers: Option<(PoseNoise, Vec<LinkMarker>)> = read_json_if_there(&path)?;
    let noise = robot.description.noise;
    let noise = markers.as_ref().map_or(noise, |(own, _)| own.of(noise));
    let bridged_s = robot.fill_gaps_s;
    let input = FuseInput { trial: name, model: &subject.model, log: &log, base: base.as_ref(), imu, noise, bridged_s };
    let (motion, report) = fuse(&input).map_err(|e| failed(&e))?;
    if let (Some((own, others)), Some(base)) = (&markers, &base) {
        let offset_s = report.clock_offset_s.unwrap_or(0.0);
        let (found, remarks) = compare_links(&subject.model, &motion, log.time_s[0], base, offset_s, others, own);
        write_json(&inputs.out.join("link_markers.json"), &found)?;
        done.warnings.extend(remarks);
    }
    save_motion(inputs.out, &motion, &subject.model)?;
    write_json(&inputs.out.join("fusion.json"), &report)?;
    done.note("unsolved_frames", report.inner_missing_frames);
    if let (Some(offset), Some(sd)) = (report.clock_offset_s, report.clock_offset_sd_s) {
        done.note("clock_offset_ms", offset * 1e3);
        done.note("clock_offset_sd_ms", sd * 1e3);
    }
    done.note("base_position_sd_mm", report.position_sd_m * 1e3);
    done.note("base_orientation_sd_deg", report.orientation_sd_rad.to_degrees());
    for (key, ratio) in [("orientation_ratio", report.orientation_ratio), ("position_ratio", report.position_ratio)] {
        if let Some(ratio) = ratio {
            done.note(key, ratio);
        }
    }
    done.warnings.extend(report.warnings.iter().cloned());
    Ok(done)
}

/// Errors of a robot's sensors, for the floor of a comparison.
#[derive(Debug)]
pub struct RobotErrors(SensorErrors);

impl RobotErrors {
    /// From the report of a recording's motion; none if it was made from markers.
    pub fn load(results: Results<'_>, motion: &Motion) -> Result<Option<Self>, StageFailure> {
        let path = results.place("ik", &motion.trial)?.join("fusion.json");
        let report: Option<FusionReport> = read_json_if_there(&path)?;
        Ok(report.map(|report| Self(SensorErrors::new(report, motion.rate_hz))))
    }

    /// The motion with the errors of each draw added and subtracted.
    pub fn pairs(&self, motion: &Motion, seed: u64, draws: usize) -> Vec<[Motion; 2]> {
        (0..draws as u64).map(|draw| self.0.pair(motion, seed, draw)).collect()
    }
}

impl PoseErrors for RobotErrors {
    fn draw(&self, motion: &Motion, wanted: &dyn Fn(usize) -> bool, seed: u64, draw: u64) -> Motion {
        self.0.draw(motion, wanted, seed, draw)
    }
}
