//! Recordings as C3D files.

use crate::error::SimulateError;
use crate::lab::LabTrial;
use crate::scenario::{BodySpec, Scenario};
use aloft_c3d::{C3dBuilder, FileEvent, Parameter, PlateDescription};

/// A recording as C3D: mm, Intel floats, plates of type 2 with their channels, subject and events.
pub(crate) fn c3d(scenario: &Scenario, trial: &LabTrial) -> Result<Vec<u8>, SimulateError> {
    let fail = |source| SimulateError::C3d { trial: trial.name.clone(), source };
    let capture = &scenario.capture;
    let mut builder = C3dBuilder::new(capture.point_rate_hz);
    if let Some(poses) = &trial.poses {
        builder = builder.poses(poses.clone());
    }
    let worn = if trial.poses.is_some() { 0 } else { trial.markers.labels.len() };
    for (label, trajectory) in trial.markers.labels.iter().zip(&trial.markers.trajectories).take(worn) {
        let xyz = trajectory.iter().map(|p| std::array::from_fn(|i| (1000.0 * p[i]) as f32)).collect();
        builder = builder.marker(label, xyz);
    }
    if !trial.plates.is_empty() {
        builder = builder.analog_rate_hz(capture.point_rate_hz * capture.analog_per_frame as f64);
    }
    for (plate, recorded) in trial.plates.iter().enumerate() {
        for (i, values) in recorded.channels.iter().enumerate() {
            let name = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"][i];
            let (unit, scale) = if i < 3 { ("N", 1.0) } else { ("Nmm", 1000.0) };
            let values = values.iter().map(|x| scale * x).collect();
            builder = builder.analog(&format!("{name}{}", plate + 1), unit, values);
        }
        let millimetres = |v: &nalgebra::Vector3<f64>| [1000.0 * v.x, 1000.0 * v.y, 1000.0 * v.z];
        builder = builder.described_plate(PlateDescription {
            kind: 2,
            corners: recorded.geometry.corners_m.each_ref().map(millimetres),
            origin: millimetres(&recorded.geometry.origin_m),
            channels: (6 * plate..6 * plate + 6).collect(),
            ..PlateDescription::default()
        });
    }
    let is_person = matches!(scenario.body, BodySpec::Human(_));
    let subject = if is_person { scenario.name.clone() } else { String::new() };
    if is_person {
        builder = builder
            .parameter("SUBJECTS", Parameter::integer("USED", 1))
            .parameter("SUBJECTS", Parameter::texts("NAMES", &[&subject]))
            .parameter("SUBJECTS", Parameter::integer("IS_STATIC", i16::from(trial.kind == "static")))
            .parameter("SUBJECTS", Parameter::integer("USES_PREFIXES", 0));
    }
    for event in &trial.events {
        builder = builder.full_event(FileEvent {
            label: event.label.clone(),
            context: event.context.clone(),
            time_s: event.time_s,
            subject: subject.clone(),
            ..FileEvent::default()
        });
    }
    builder.build().and_then(|file| file.to_bytes()).map_err(fail)
}
