//! STO: velocities, accelerations, generalised forces and the residual wrench at the root.

use super::mot::table;
use crate::coordinates::Quantity;
use crate::frame::to_ground;
use crate::loads::parts;
use crate::storage::{extent, text};
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport};

/// The format.
pub static FORMAT: Format = Format {
    name: "sto",
    title: "velocities, accelerations, generalised forces, residual wrench at the root",
    readers: "OpenSim, pandas",
    trial: Some(write),
    subject: None,
};

fn write(subject: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    if subject.osim_file.is_some() {
        // the coordinates of the links are not those of the imported model: OpenSim's own inverse
        // dynamics on the exported motion gives these
        return Ok(Vec::new());
    }
    let stem = trial.stem();
    let mut out = Vec::new();
    if let Some(smooth) = trial.smooth.as_ref().filter(|s| !s.rates.is_empty()) {
        for (suffix, units, values, what) in [
            ("velocities", "deg/s, m/s.", &smooth.rates, "rates"),
            ("accelerations", "deg/s^2, m/s^2.", &smooth.accelerations, "accelerations"),
        ] {
            let name = format!("{stem}_{suffix}");
            let sto = table(subject, trial, &name, units, values, 6);
            let what = format!("{what} of the filtered coordinates of {}", trial.name);
            out.push(OutFile::text(format!("IK/{name}.sto"), sto, what));
        }
    }
    let Some(forces) = &trial.forces else { return Ok(out) };
    let n = subject.coordinates.len();
    let columns: Vec<String> = subject
        .coordinates
        .list
        .iter()
        .map(|c| format!("{}_{}", c.name, if c.quantity == Quantity::Angle { "moment" } else { "force" }))
        .collect();
    let rows =
        extent(&forces.generalised, n).map(|f| (trial.time_s(f), forces.generalised[f * n..(f + 1) * n].to_vec()));
    let comments = [
        "Inverse dynamics with the exported inertias and the plates on the feet. N.m for angles, N for lengths.",
        "Nothing acts at the root: its six rows are the residual of the model.",
    ];
    let sto = text(&format!("{stem}_id"), false, &comments, &columns, rows, 8);
    out.push(OutFile::text(format!("ID/{stem}_id.sto"), sto, format!("inverse dynamics of {}", trial.name)));

    let root = &subject.subject.model.links[0].name;
    let axes = ["x", "y", "z"];
    let columns: Vec<String> = axes
        .iter()
        .map(|a| format!("{root}_residual_force_{a}"))
        .chain(axes.iter().map(|a| format!("{root}_residual_moment_{a}")))
        .chain(std::iter::once("in_flight".to_owned()))
        .collect();
    let flat: Vec<f64> = forces.residual.iter().flat_map(|w| w.iter().copied().collect::<Vec<_>>()).collect();
    let rows = extent(&flat, 6).map(|f| {
        let (force, moment) = parts(&forces.residual[f]);
        let (force, moment) = (to_ground(&force), to_ground(&moment));
        let in_flight = f64::from(u8::from(trial.flights.iter().any(|r| r.contains(&f))));
        (trial.time_s(f), vec![force.x, force.y, force.z, moment.x, moment.y, moment.z, in_flight])
    });
    let comments = [
        "Wrench that the motion needs and nothing measured gives: force (N) and moment about the root's origin (N.m), ground axes, Y up.",
    ];
    let sto = text(&format!("{stem}_residual"), false, &comments, &columns, rows, 8);
    let what = format!("residual wrench of {} at the root, with a column that marks flights", trial.name);
    out.push(OutFile::text(format!("ID/{stem}_residual.sto"), sto, what));
    Ok(out)
}
