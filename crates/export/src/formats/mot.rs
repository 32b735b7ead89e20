//! MOT: coordinates of the exported model in degrees and metres, as solved and filtered; set-up
//! file for OpenSim's inverse kinematics.

use crate::coordinates::Quantity;
use crate::number::{exact, fixed, joined};
use crate::storage::{extent, text};
use crate::xml::Xml;
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport, names};
use std::ops::Range;

/// The format.
pub static FORMAT: Format = Format {
    name: "mot",
    title: "joint coordinates in degrees (as solved, filtered), marker errors, OpenSim set-up",
    readers: "OpenSim, SCONE, Kinetics Toolkit, pandas",
    trial: Some(write),
    subject: None,
};

/// Values of one frame with angles in degrees.
pub(crate) fn degrees(subject: &SubjectExport, row: &[f64]) -> Vec<f64> {
    let turn = |q: Quantity| if q == Quantity::Angle { 1.0_f64.to_degrees() } else { 1.0 };
    row.iter().zip(&subject.coordinates.list).map(|(v, c)| v * turn(c.quantity)).collect()
}

/// Table of coordinates, rates or accelerations.
pub(crate) fn table(
    subject: &SubjectExport,
    trial: &TrialExport,
    name: &str,
    units: &str,
    values: &[f64],
    decimals: usize,
) -> String {
    let n = subject.coordinates.len();
    let columns: Vec<String> = subject.coordinates.list.iter().map(|c| c.name.clone()).collect();
    let frames = extent(values, n);
    let rows = frames.map(|f| (trial.time_s(f), degrees(subject, &values[f * n..(f + 1) * n])));
    let comments = [units, "Coordinates of the model in Models; world with Y up. NaN: the frame could not be solved."];
    text(name, true, &comments, &columns, rows, decimals)
}

fn write(subject: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    let stem = trial.stem();
    let mut out = Vec::new();
    let units = "Angles in degrees, lengths in metres.";
    if let Some(own) = &trial.file_coordinates {
        let frames = extent(&own.values, own.names.len());
        return Ok(vec![
            crate::osim_file::coordinates(trial, own),
            setup(subject, trial, frames),
            marker_errors(trial),
        ]);
    }
    if let Some(solved) = &trial.solved {
        let mot = table(subject, trial, &format!("{stem}_ik"), units, &solved.values, 8);
        let what = format!("joint coordinates of {} as inverse kinematics solved them", trial.name);
        out.push(OutFile::text(format!("IK/{stem}_ik.mot"), mot, what));
        out.push(setup(subject, trial, extent(&solved.values, solved.n)));
        out.push(marker_errors(trial));
    }
    if let Some(smooth) = &trial.smooth {
        let mot = table(subject, trial, &format!("{stem}_ik_filtered"), units, &smooth.values, 8);
        let what =
            format!("joint coordinates of {} after the low-pass filter; inverse dynamics uses these", trial.name);
        out.push(OutFile::text(format!("IK/{stem}_ik_filtered.mot"), mot, what));
    }
    Ok(out)
}

/// Set-up of OpenSim's own inverse kinematics on our TRC and model; its output file does not
/// overwrite ours.
fn setup(subject: &SubjectExport, trial: &TrialExport, frames: Range<usize>) -> OutFile {
    let stem = trial.stem();
    let times = [trial.time_s(frames.start), trial.time_s(frames.end.saturating_sub(1))];
    let mut x = Xml::new();
    x.open("OpenSimDocument", &[("Version", "40000")]);
    x.open("InverseKinematicsTool", &[("name", &stem)]);
    x.leaf("model_file", &format!("../{}", super::osim::path(subject)));
    x.leaf("marker_file", &format!("../{}", super::trc::path(trial)));
    x.leaf("time_range", &joined(&times));
    x.leaf("output_motion_file", &format!("{stem}_ik_opensim.mot"));
    x.leaf("report_errors", "true").leaf("constraint_weight", "Inf").leaf("accuracy", "1e-07");
    x.open("IKTaskSet", &[]).open("objects", &[]);
    for marker in &subject.subject.markers {
        let seen = trial.trial.markers.index(&marker.label).is_some();
        x.open("IKMarkerTask", &[("name", &names::label(&marker.label))]);
        x.leaf("apply", if seen && marker.weight > 0.0 { "true" } else { "false" });
        x.leaf("weight", &exact(marker.weight)).close();
    }
    let what = format!("set-up of OpenSim's inverse kinematics for {}", trial.name);
    OutFile { path: format!("IK/{stem}_ik_setup.xml"), bytes: x.finish(), what }
}

/// Distance between each marker and its position on the model, frame by frame.
fn marker_errors(trial: &TrialExport) -> OutFile {
    let mut csv = "time [s],rms [m],max [m]".to_owned();
    let empty = aloft_body::Motion::default();
    let motion = trial.motion.as_ref().unwrap_or(&empty);
    for label in &motion.marker_labels {
        csv.push_str(&format!(",{}", names::csv_cell(&format!("{} [m]", names::label(label)))));
    }
    csv.push('\n');
    let n = motion.marker_labels.len();
    let cell = |v: f64| if v.is_finite() { fixed(v, 7) } else { String::new() };
    for f in 0..motion.n_frames() {
        let row = &motion.residual_m[f * n..(f + 1) * n];
        let max = row.iter().copied().filter(|r| r.is_finite()).fold(f64::NAN, f64::max);
        csv.push_str(&format!("{},{},{}", fixed(trial.time_s(f), 8), cell(motion.frame_rms_m(f)), cell(max)));
        for value in row {
            csv.push(',');
            csv.push_str(&cell(*value));
        }
        csv.push('\n');
    }
    let what = format!("distance of each marker of {} from the model, frame by frame", trial.name);
    OutFile::text(format!("IK/{}_marker_errors.csv", trial.stem()), csv, what)
}
