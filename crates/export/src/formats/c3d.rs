//! C3D: the original recording with results added and everything else unchanged.
//!
//! Filled gaps are written as filled (residual 0, as the format marks computed points), repaired
//! samples are replaced; every other sample, channel, group and parameter is kept. New points:
//! joint centres and centre of mass (as markers), joint angles (listed in POINT:ANGLES, degrees).
//! New events: `Flight Start`, `Flight End`, context `General`. The group ALOFT names their source.
//! Integer files become float files, because angles do not fit their scale; the values are
//! unchanged. A recording that was not C3D becomes a new file in our world (Z up, mm), with ground
//! reactions as computed forces and moments.

use crate::channels::joint_centres;
use crate::coordinates::Quantity;
use crate::loads::parts;
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport};
use aloft_c3d::{C3dBuilder, C3dError, C3dFile, FileEvent, Parameter, Point, PointKind, Storage, strip_subject};
use nalgebra::{Rotation3, Vector3};

/// The format.
pub static FORMAT: Format = Format {
    name: "c3d",
    title: "the recording with cleaned markers, joint centres, angles and flight events added",
    readers: "Vicon Nexus, Visual3D, Mokka, ezc3d, BTK",
    trial: Some(write),
    subject: None,
};

fn write(subject: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    let failed = |e: C3dError| ExportError::Recording { trial: trial.name.clone(), problem: e.to_string() };
    let (mut file, source_from_world, filled) = match &trial.source.c3d {
        Some(bytes) => {
            let mut file = C3dFile::from_bytes(bytes).map_err(failed)?;
            let filled = clean(&mut file, trial)?;
            (file, trial.trial.world_from_source.inverse(), Some(filled))
        }
        None => (fresh(trial).map_err(failed)?, Rotation3::identity(), None),
    };
    if file.storage == Storage::Integer {
        file.storage = Storage::Float;
    }
    let before = file.points.len();
    let per_metre = units_per_metre(&file, &trial.name)?;
    for (name, path) in joint_centres(subject, trial) {
        let at = |p: &Vector3<f64>| source_from_world * *p * per_metre;
        add(&mut file, &name, PointKind::Marker, "", path.iter().map(at));
    }
    if let Some(forces) = &trial.forces {
        let at = |p: &Vector3<f64>| source_from_world * *p * per_metre;
        add(&mut file, "COM", PointKind::Marker, "", forces.centre_of_mass_m.iter().map(at));
    }
    add_angles(&mut file, subject, trial);
    add_events(&mut file, trial);
    file.groups.set("ALOFT", Parameter::text("PROGRAM", &subject.program));
    file.groups.set("ALOFT", Parameter::text("ANGLES", subject.coordinates.convention.word()));
    let added = file.points.len() - before;
    let bytes = file.to_bytes().map_err(failed)?;
    let what = match filled {
        Some(n) => format!(
            "`{}` with {n} samples filled or repaired, {added} points and {} flights added; everything else as it was",
            trial.source.name,
            trial.flights.len()
        ),
        None => format!(
            "markers and forces of {} as C3D (Z up, mm), {added} points and {} flights added",
            trial.name,
            trial.flights.len()
        ),
    };
    Ok(vec![OutFile { path: format!("C3D/{}.c3d", trial.stem()), bytes, what }])
}

fn units_per_metre(file: &C3dFile, trial: &str) -> Result<f64, ExportError> {
    file.metres_per_point_unit().map(|m| 1.0 / m).ok_or_else(|| ExportError::Recording {
        trial: trial.to_owned(),
        problem: format!("POINT:UNITS is `{}`, not a length", file.point_unit),
    })
}

/// Fills and repairs samples; returns their number. The recording's markers are the file's labelled
/// markers in the file's order.
fn clean(file: &mut C3dFile, trial: &TrialExport) -> Result<usize, ExportError> {
    let per_metre = units_per_metre(file, &trial.name)?;
    let labelled: Vec<usize> = (0..file.points.len())
        .filter(|&i| {
            let point = &file.points[i];
            let bare = strip_subject(point.label.trim());
            point.kind == PointKind::Marker && !bare.is_empty() && !bare.starts_with('*')
        })
        .collect();
    let markers = &trial.trial.markers;
    let mismatch = |what: &str, expected: usize, found: usize| ExportError::Mismatch {
        what: format!("{}: {what} of {}", trial.name, trial.source.name),
        expected: expected.to_string(),
        found: found.to_string(),
    };
    if labelled.len() != markers.labels.len() {
        return Err(mismatch("labelled markers", markers.labels.len(), labelled.len()));
    }
    if file.n_frames != markers.n_frames {
        return Err(mismatch("frames", markers.n_frames, file.n_frames));
    }
    let source_from_world = trial.trial.world_from_source.inverse();
    let mut filled = 0;
    for (index, path) in labelled.into_iter().zip(&markers.trajectories) {
        let point = &mut file.points[index];
        for (f, p) in path.iter().enumerate().filter(|(_, p)| p.iter().all(|x| x.is_finite())) {
            let new = source_from_world * *p * per_metre;
            let old = Vector3::from(point.xyz[f].map(f64::from));
            // the file has single precision: smaller differences are rounding
            let same = (new - old).amax() <= 1e-5 * (1.0 + old.amax());
            if !same {
                point.xyz[f] = [new.x as f32, new.y as f32, new.z as f32];
                point.residual[f] = 0.0;
                point.cameras[f] = 0;
                filled += 1;
            }
        }
    }
    Ok(filled)
}

/// A new file for a recording that was not C3D.
fn fresh(trial: &TrialExport) -> Result<C3dFile, C3dError> {
    let markers = &trial.trial.markers;
    let mut builder = C3dBuilder::new(markers.rate_hz).first_frame(markers.first_frame.max(1));
    for (label, path) in markers.labels.iter().zip(&markers.trajectories) {
        builder = builder.marker(label, path.iter().map(|p| single(&(p * 1e3))).collect());
    }
    for (k, plate) in trial.plates.iter().enumerate() {
        let force = plate.wrench.iter().map(|w| single(&parts(w).0)).collect();
        let moment = plate.wrench.iter().map(|w| single(&(parts(w).1 * 1e3))).collect();
        builder = builder.computed(&format!("GroundReactionForce{}", k + 1), PointKind::Force, "N", force);
        builder = builder.computed(&format!("GroundReactionMoment{}", k + 1), PointKind::Moment, "Nmm", moment);
    }
    let start_s = start_s(markers.first_frame, markers.rate_hz);
    for event in &trial.trial.events {
        builder = builder.event(&event.label, &event.context, start_s + event.time_s);
    }
    builder.build()
}

fn single(v: &Vector3<f64>) -> [f32; 3] {
    if v.iter().all(|x| x.is_finite()) { [v.x as f32, v.y as f32, v.z as f32] } else { [f32::NAN; 3] }
}

/// Appends a point; a label that already exists in the file gets `_aloft`.
fn add(file: &mut C3dFile, label: &str, kind: PointKind, unit: &str, values: impl Iterator<Item = Vector3<f64>>) {
    let mut label = label.to_owned();
    while file.points.iter().any(|p| strip_subject(&p.label) == label || p.label == label) {
        label.push_str("_aloft");
    }
    let mut xyz: Vec<[f32; 3]> = values.map(|v| single(&v)).collect();
    xyz.resize(file.n_frames, [f32::NAN; 3]);
    let residual = xyz.iter().map(|p| if p[0].is_nan() { f32::NAN } else { 0.0 }).collect();
    let unit = if kind == PointKind::Marker { file.point_unit.clone() } else { unit.to_owned() };
    let cameras = vec![0; file.n_frames];
    file.points.push(Point { label, description: "added by aloft".to_owned(), kind, unit, xyz, residual, cameras });
}

/// One point per joint: its angles in the order of the coordinates, degrees (or the unit of the
/// file's angles).
fn add_angles(file: &mut C3dFile, subject: &SubjectExport, trial: &TrialExport) {
    let Some(solved) = &trial.solved else { return };
    let stated = file.points.iter().find(|p| p.kind == PointKind::Angle).map(|p| p.unit.clone());
    let unit = stated.filter(|u| !u.is_empty()).unwrap_or_else(|| "deg".to_owned());
    let scale = if unit.to_ascii_lowercase().starts_with("rad") { 1.0 } else { 1.0_f64.to_degrees() };
    let c = &subject.coordinates;
    for joint in &c.joints {
        let angles: Vec<usize> =
            (joint.first..joint.first + joint.count).filter(|&k| c.list[k].quantity == Quantity::Angle).collect();
        if angles.is_empty() {
            continue;
        }
        let values = (0..solved.n_frames).map(|f| {
            let value = |n: usize| angles.get(n).map_or(0.0, |&k| solved.values[f * solved.n + k] * scale);
            Vector3::new(value(0), value(1), value(2))
        });
        add(file, &joint.group, PointKind::Angle, &unit, values);
    }
}

/// Time of the first frame on the clock on which frame 1 is at 0 s.
fn start_s(first_frame: u32, rate_hz: f64) -> f64 {
    (f64::from(first_frame) - 1.0).max(0.0) / rate_hz
}

fn add_events(file: &mut C3dFile, trial: &TrialExport) {
    let start = start_s(file.first_frame, file.point_rate_hz);
    let subject = file.events.first().map(|e| e.subject.clone()).unwrap_or_default();
    for flight in &trial.flights {
        for (label, frame) in [("Flight Start", flight.start), ("Flight End", flight.end)] {
            file.events.push(FileEvent {
                label: label.to_owned(),
                context: "General".to_owned(),
                time_s: start + frame as f64 / file.point_rate_hz,
                subject: subject.clone(),
                description: "gravity alone acts".to_owned(),
            });
        }
    }
}
