//! File formats of the data that stages exchange.

use crate::error::PipelineError;
use crate::json::{read_json, write_json};
use crate::table::Table;
use aloft_body::{Model, Motion};
use aloft_trial::{
    ComputedPoint, Event, Markers, Plate, PointKind, RecordedAt, SessionRecording, Trial, Warning, WarningKind,
};
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use std::path::Path;

#[derive(Serialize, Deserialize)]
struct TrialHead {
    name: String,
    rate_hz: f64,
    first_frame: u32,
    n_frames: usize,
    labels: Vec<String>,
    plates: Vec<PlateHead>,
    events: Vec<Event>,
    computed: Vec<ComputedHead>,
    world_from_source: Rotation3<f64>,
    recorded: Option<RecordedAt>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    person: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    people: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    unused_columns: Vec<String>,
    start_s: f64,
    warnings: Vec<String>,
    /// Subject of each of the `warnings`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    warning_kinds: Vec<WarningKind>,
}

#[derive(Serialize, Deserialize)]
struct PlateHead {
    name: String,
    rate_hz: f64,
    corners_m: Vec<Vector3<f64>>,
}

#[derive(Serialize, Deserialize)]
struct ComputedHead {
    label: String,
    kind: PointKind,
    unit: String,
}

const AXES: [&str; 3] = ["x", "y", "z"];

fn push_vectors(table: &mut Table, name: &str, values: &[Vector3<f64>]) {
    for (i, axis) in AXES.iter().enumerate() {
        table.push(format!("{name}.{axis}"), values.iter().map(|v| v[i]).collect());
    }
}

fn take_vectors(columns: &mut impl Iterator<Item = (String, Vec<f64>)>) -> Vec<Vector3<f64>> {
    let x = columns.next().map(|c| c.1).unwrap_or_default();
    let y = columns.next().map(|c| c.1).unwrap_or_default();
    let z = columns.next().map(|c| c.1).unwrap_or_default();
    x.into_iter().zip(y).zip(z).map(|((x, y), z)| Vector3::new(x, y, z)).collect()
}

/// Writes `markers.parquet`, `plate_<n>.parquet`, `computed.parquet` and `trial.json`.
pub fn save_trial(dir: &Path, trial: &Trial) -> Result<(), PipelineError> {
    let head = TrialHead {
        name: trial.name.clone(),
        rate_hz: trial.markers.rate_hz,
        first_frame: trial.markers.first_frame,
        n_frames: trial.markers.n_frames,
        labels: trial.markers.labels.clone(),
        plates: trial
            .plates
            .iter()
            .map(|p| PlateHead { name: p.name.clone(), rate_hz: p.rate_hz, corners_m: p.corners_m.clone() })
            .collect(),
        events: trial.events.clone(),
        computed: trial
            .computed
            .iter()
            .map(|c| ComputedHead { label: c.label.clone(), kind: c.kind, unit: c.unit.clone() })
            .collect(),
        world_from_source: trial.world_from_source,
        recorded: trial.recorded.clone(),
        person: trial.person.clone(),
        people: trial.people.clone(),
        unused_columns: trial.unused_columns.clone(),
        start_s: trial.start_s,
        warnings: trial.warnings.iter().map(|w| w.message.clone()).collect(),
        warning_kinds: trial.warnings.iter().map(|w| w.kind).collect(),
    };
    write_json(&dir.join("trial.json"), &head)?;
    let mut markers = Table::default();
    let rate = trial.markers.rate_hz;
    markers.push("time_s", (0..trial.markers.n_frames).map(|f| f as f64 / rate).collect());
    for (label, path) in trial.markers.labels.iter().zip(&trial.markers.trajectories) {
        push_vectors(&mut markers, label, path);
    }
    markers.write(&dir.join("markers.parquet"))?;
    for (i, plate) in trial.plates.iter().enumerate() {
        let mut table = Table::default();
        push_vectors(&mut table, "force_n", &plate.force_n);
        push_vectors(&mut table, "moment_nm", &plate.moment_nm);
        table.write(&dir.join(format!("plate_{}.parquet", i + 1)))?;
    }
    if !trial.computed.is_empty() {
        let mut table = Table::default();
        for (i, c) in trial.computed.iter().enumerate() {
            push_vectors(&mut table, &format!("{i}:{}", c.label), &c.values);
        }
        table.write(&dir.join("computed.parquet"))?;
    }
    Ok(())
}

/// Reads what [`save_trial`] wrote.
pub fn load_trial(dir: &Path) -> Result<Trial, PipelineError> {
    load(read_json(&dir.join("trial.json"))?, dir, true)
}

/// The same without trajectories and computed points, for callers that need only plates and times.
pub fn load_trial_without_points(dir: &Path) -> Result<Trial, PipelineError> {
    load(read_json(&dir.join("trial.json"))?, dir, false)
}

/// The same without plates and computed points: a third of the size of a trial.
pub fn load_markers(dir: &Path) -> Result<Trial, PipelineError> {
    let mut head: TrialHead = read_json(&dir.join("trial.json"))?;
    head.plates.clear();
    head.computed.clear();
    load(head, dir, true)
}

/// Marker rate of an imported recording, Hz.
pub fn trial_rate(dir: &Path) -> Result<f64, PipelineError> {
    Ok(read_json::<TrialHead>(&dir.join("trial.json"))?.rate_hz)
}

/// Frames of an imported recording.
pub fn trial_length(dir: &Path) -> Result<usize, PipelineError> {
    Ok(read_json::<TrialHead>(&dir.join("trial.json"))?.n_frames)
}

/// When an imported recording was made and how long it is, to place it in the session; and the
/// number of its plates.
pub fn session_recording(dir: &Path, needed: bool) -> Result<(SessionRecording, usize), PipelineError> {
    let head: TrialHead = read_json(&dir.join("trial.json"))?;
    let plates = head.plates.len();
    let recording = SessionRecording {
        duration_s: head.n_frames as f64 / head.rate_hz,
        name: head.name,
        recorded: head.recorded,
        start_s: head.start_s,
        needed,
    };
    Ok((recording, plates))
}

fn load(head: TrialHead, dir: &Path, points: bool) -> Result<Trial, PipelineError> {
    let trajectories = if points {
        let mut columns = Table::read(&dir.join("markers.parquet"))?.into_columns().into_iter().skip(1);
        head.labels.iter().map(|_| take_vectors(&mut columns)).collect()
    } else {
        Vec::new()
    };
    let mut plates = Vec::new();
    for (i, p) in head.plates.into_iter().enumerate() {
        let mut columns = Table::read(&dir.join(format!("plate_{}.parquet", i + 1)))?.into_columns().into_iter();
        let force_n = take_vectors(&mut columns);
        let moment_nm = take_vectors(&mut columns);
        plates.push(Plate { name: p.name, rate_hz: p.rate_hz, corners_m: p.corners_m, force_n, moment_nm });
    }
    let mut computed = Vec::new();
    if points && !head.computed.is_empty() {
        let mut columns = Table::read(&dir.join("computed.parquet"))?.into_columns().into_iter();
        for c in head.computed {
            let values = take_vectors(&mut columns);
            computed.push(ComputedPoint { label: c.label, kind: c.kind, unit: c.unit, values });
        }
    }
    Ok(Trial {
        name: head.name,
        markers: Markers {
            rate_hz: head.rate_hz,
            first_frame: head.first_frame,
            n_frames: head.n_frames,
            labels: if points { head.labels } else { Vec::new() },
            trajectories,
        },
        plates,
        events: head.events,
        computed,
        world_from_source: head.world_from_source,
        recorded: head.recorded,
        person: head.person,
        people: head.people,
        unused_columns: head.unused_columns,
        start_s: head.start_s,
        warnings: head
            .warnings
            .into_iter()
            .zip(head.warning_kinds.into_iter().chain(std::iter::repeat(WarningKind::Unspecified)))
            .map(|(message, kind)| Warning { kind, message })
            .collect(),
    })
}

/// Centres of the plates of an imported recording, world, m.
pub fn plate_centres(dir: &Path) -> Result<Vec<Vector3<f64>>, PipelineError> {
    let head: TrialHead = read_json(&dir.join("trial.json"))?;
    let middle = |p: &PlateHead| p.corners_m.iter().sum::<Vector3<f64>>() / p.corners_m.len().max(1) as f64;
    Ok(head.plates.iter().map(middle).collect())
}

#[derive(Serialize, Deserialize)]
struct MotionHead {
    trial: String,
    rate_hz: f64,
    nq: usize,
    nv: usize,
    has_derivatives: bool,
    has_sd: bool,
    marker_labels: Vec<String>,
}

/// Writes `motion.parquet`, `residuals.parquet` and `motion.json`.
pub fn save_motion(dir: &Path, motion: &Motion, model: &Model) -> Result<(), PipelineError> {
    let head = MotionHead {
        trial: motion.trial.clone(),
        rate_hz: motion.rate_hz,
        nq: motion.nq,
        nv: motion.nv,
        has_derivatives: !motion.v.is_empty(),
        has_sd: !motion.q_sd.is_empty(),
        marker_labels: motion.marker_labels.clone(),
    };
    write_json(&dir.join("motion.json"), &head)?;
    let mut table = Table::default();
    table.push("time_s", (0..motion.n_frames()).map(|f| f as f64 / motion.rate_hz).collect());
    table.push_rows(&model.coordinate_names(), &motion.q);
    let rates = model.velocity_names();
    if head.has_derivatives {
        table.push_rows(&rates, &motion.v);
        table.push_rows(&rates.iter().map(|n| format!("d/dt {n}")).collect::<Vec<_>>(), &motion.a);
    }
    if head.has_sd {
        table.push_rows(&rates.iter().map(|n| format!("sd {n}")).collect::<Vec<_>>(), &motion.q_sd);
    }
    table.write(&dir.join("motion.parquet"))?;
    let mut residuals = Table::default();
    residuals.push_rows(&motion.marker_labels, &motion.residual_m);
    residuals.write(&dir.join("residuals.parquet"))
}

/// Reads what [`save_motion`] wrote.
pub fn load_motion(dir: &Path) -> Result<Motion, PipelineError> {
    let head: MotionHead = read_json(&dir.join("motion.json"))?;
    let table = Table::read(&dir.join("motion.parquet"))?;
    let mut at = 1;
    let mut take = |wanted: bool, width: usize| {
        if wanted {
            at += width;
            table.rows(at - width, at)
        } else {
            Vec::new()
        }
    };
    let q = take(true, head.nq);
    let v = take(head.has_derivatives, head.nv);
    let a = take(head.has_derivatives, head.nv);
    let q_sd = take(head.has_sd, head.nv);
    let residuals = Table::read(&dir.join("residuals.parquet"))?;
    let residual_m = residuals.rows(0, head.marker_labels.len());
    Ok(Motion {
        trial: head.trial,
        rate_hz: head.rate_hz,
        nq: head.nq,
        nv: head.nv,
        q,
        v,
        a,
        marker_labels: head.marker_labels,
        residual_m,
        q_sd,
    })
}
