//! An imported OpenSim model with identified inertias, and motions in its own coordinates.

use crate::storage::{extent, text};
use crate::{ExportError, FileCoordinates, InertiaSource, OsimFile, OutFile, SubjectExport, TrialExport};
use aloft_robot::osim::patch::patch;

/// Path of the model.
pub(crate) fn path(subject: &SubjectExport, file: &OsimFile) -> String {
    let stem = file.name.rsplit_once('.').map_or(file.name.as_str(), |(stem, _)| stem);
    match subject.source {
        InertiaSource::Identified { .. } => format!("Models/{stem}_identified.osim"),
        InertiaSource::Prior { .. } => format!("Models/{stem}.osim"),
    }
}

/// The model with the identified inertias; without them the file as it is.
///
/// # Errors
/// [`ExportError::Recording`] if the inertias do not fit the file.
pub(crate) fn model(subject: &SubjectExport, file: &OsimFile) -> Result<Vec<OutFile>, ExportError> {
    let path = path(subject, file);
    if let InertiaSource::Prior { reason } = &subject.source {
        let what = format!("{} as it is: {reason}", file.name);
        return Ok(vec![OutFile::text(path, file.text.clone(), what)]);
    }
    let done = patch(&file.text, &file.model, &file.tree, &subject.links, file.scale, &file.provenance)
        .map_err(|e| ExportError::Recording { trial: file.name.clone(), problem: e.to_string() })?;
    let remarks: String = done.remarks.iter().map(|r| format!("; {r}")).collect();
    let what = format!(
        "{} with the identified inertias of {} bodies; nothing else changed{remarks}",
        file.name,
        done.written.len()
    );
    Ok(vec![OutFile::text(path, done.text, what)])
}

/// The file's coordinates of a recording as inverse kinematics solved them.
pub(crate) fn coordinates(trial: &TrialExport, own: &FileCoordinates) -> OutFile {
    let n = own.names.len();
    let stem = trial.stem();
    let rows = extent(&own.values, n).map(|f| {
        let row = &own.values[f * n..(f + 1) * n];
        let turned = row.iter().zip(&own.is_angle).map(|(v, angle)| if *angle { v.to_degrees() } else { *v });
        (trial.time_s(f), turned.collect())
    });
    let comments = [
        "Angles in degrees, lengths in metres.",
        "Coordinates of the imported model; world with Y up. NaN: the frame could not be solved.",
    ];
    let mot = text(&format!("{stem}_ik"), true, &comments, &own.names, rows, 8);
    let what = format!("coordinates of the imported model in {} as inverse kinematics solved them", trial.name);
    OutFile::text(format!("IK/{stem}_ik.mot"), mot, what)
}
