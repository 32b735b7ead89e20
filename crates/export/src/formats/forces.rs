//! Ground reactions for OpenSim: MOT with force, point and free moment of every load, and the XML
//! that assigns each load to a body.

use crate::frame::to_ground;
use crate::loads::{LOADED_N, centre_of_pressure, parts};
use crate::number::{fixed, joined};
use crate::storage::{extent, text};
use crate::xml::Xml;
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport, names};
use aloft_trial::Plate;
use nalgebra::{Vector3, Vector6};

/// The format.
pub static FORMAT: Format = Format {
    name: "forces",
    title: "ground reactions (MOT), external loads and inverse dynamics set-up (XML)",
    readers: "OpenSim, SCONE, OpenSim Moco",
    trial: Some(write),
    subject: None,
};

fn columns(label: &str) -> Vec<String> {
    let part = |stem: &str| ["x", "y", "z"].map(|a| format!("{stem}{a}"));
    [format!("ground_force_{label}_v"), format!("ground_force_{label}_p"), format!("ground_torque_{label}_")]
        .iter()
        .flat_map(|stem| part(stem))
        .collect()
}

fn nine(force: &Vector3<f64>, point: &Vector3<f64>, moment: &Vector3<f64>) -> Vec<f64> {
    [force, point, moment].iter().flat_map(|v| to_ground(v).iter().copied().collect::<Vec<_>>()).collect()
}

fn write(subject: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    let stem = trial.stem();
    let mut out = unfiltered(trial);
    let (Some(forces), Some(smooth)) = (&trial.forces, &trial.smooth) else { return Ok(out) };
    let has_loads = !forces.loads.is_empty();
    if has_loads {
        let labels: Vec<String> = forces.loads.iter().flat_map(|l| columns(&l.label)).collect();
        let rows = (0..trial.n_frames()).map(|f| {
            let values = forces.loads.iter().flat_map(|l| nine(&parts(&l.wrench[f]).0, &l.point_m[f], &l.moment_nm[f]));
            (trial.time_s(f), values.collect())
        });
        let comments = [
            "Forces on the subject (N), points of application (m), moments about these points (N.m); ground axes, Y up.",
            "Filtered like the motion, at its rate. Without load the point is the origin, and the small rest of the wrench is kept.",
        ];
        let mot = text(&format!("{stem}_grf"), false, &comments, &labels, rows, 6);
        let what = format!("ground reactions of {}, filtered like the motion", trial.name);
        out.push(OutFile::text(format!("ID/{stem}_grf.mot"), mot, what));
        out.push(external_loads(subject, trial, &forces.loads));
    }
    let frames = extent(&smooth.accelerations, smooth.n);
    let times = [trial.time_s(frames.start), trial.time_s(frames.end.saturating_sub(1))];
    let mut x = Xml::new();
    x.open("OpenSimDocument", &[("Version", "40000")]);
    x.open("InverseDynamicsTool", &[("name", &stem)]);
    x.leaf("results_directory", ".");
    x.leaf("model_file", &format!("../{}", super::osim::path(subject)));
    x.leaf("time_range", &joined(&times));
    x.leaf("forces_to_exclude", "Muscles");
    if has_loads {
        x.leaf("external_loads_file", &format!("{stem}_external_forces.xml"));
    }
    x.leaf("coordinates_file", &format!("../IK/{stem}_ik_filtered.mot"));
    x.comment("The coordinates are filtered already.");
    x.leaf("lowpass_cutoff_frequency_for_coordinates", "-1");
    x.leaf("output_gen_force_file", &format!("{stem}_id_opensim.sto"));
    let what = format!("set-up of OpenSim's inverse dynamics for {}", trial.name);
    out.push(OutFile { path: format!("ID/{stem}_id_setup.xml"), bytes: x.finish(), what });
    Ok(out)
}

fn external_loads(subject: &SubjectExport, trial: &TrialExport, loads: &[crate::loads::Load]) -> OutFile {
    let stem = trial.stem();
    let mut x = Xml::new();
    x.open("OpenSimDocument", &[("Version", "40000")]);
    x.open("ExternalLoads", &[("name", "externalloads")]).open("objects", &[]);
    for load in loads {
        let body = names::label(&subject.subject.model.links[load.link].name);
        x.open("ExternalForce", &[("name", &format!("plate_{}", load.label))]);
        x.comment(&format!("{} on {body}", load.plate));
        x.leaf("applied_to_body", &body);
        x.leaf("force_expressed_in_body", "ground").leaf("point_expressed_in_body", "ground");
        x.leaf("force_identifier", &format!("ground_force_{}_v", load.label));
        x.leaf("point_identifier", &format!("ground_force_{}_p", load.label));
        x.leaf("torque_identifier", &format!("ground_torque_{}_", load.label));
        x.close();
    }
    x.close().leaf("datafile", &format!("{stem}_grf.mot"));
    let what = format!("external loads of {}: which plate acts on which foot", trial.name);
    OutFile { path: format!("ID/{stem}_external_forces.xml"), bytes: x.finish(), what }
}

/// Plates at their own rate, tared, not filtered; one file if all plates have the same rate and
/// length, else one each.
fn unfiltered(trial: &TrialExport) -> Vec<OutFile> {
    let plates = &trial.trial.plates;
    let together = plates.windows(2).all(|p| p[0].rate_hz == p[1].rate_hz && p[0].force_n.len() == p[1].force_n.len());
    let numbered: Vec<(usize, &Plate)> = plates.iter().enumerate().collect();
    let groups: Vec<(String, &[(usize, &Plate)])> = if together {
        vec![(String::new(), &numbered[..])]
    } else {
        numbered.chunks(1).map(|one| (format!("_{}", one[0].0 + 1), one)).collect()
    };
    let mut out = Vec::new();
    for (suffix, group) in groups {
        let Some((_, first)) = group.first() else { continue };
        let labels: Vec<String> = group.iter().flat_map(|(k, _)| columns(&(k + 1).to_string())).collect();
        let rows = (0..first.force_n.len()).map(|i| {
            let values = group.iter().flat_map(|(_, p)| {
                let (force, moment) = (p.force_n[i], p.moment_nm[i]);
                let w = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
                let point = if force.z > LOADED_N { centre_of_pressure(&w) } else { Vector3::zeros() };
                nine(&force, &point, &(moment - point.cross(&force)))
            });
            (i as f64 / first.rate_hz, values.collect())
        });
        let name = format!("{}_grf_unfiltered{suffix}", trial.stem());
        let comments = [
            "Forces on the subject (N), points of application (m), moments about these points (N.m); ground axes, Y up.",
            "Tared, not filtered, at the plates' own rate. Without load the point is the origin.",
        ];
        let mot = text(&name, false, &comments, &labels, rows, 6);
        let what = format!("ground reactions of {} at {} Hz, tared, not filtered", trial.name, fixed(first.rate_hz, 3));
        out.push(OutFile::text(format!("ID/{name}.mot"), mot, what));
    }
    out
}
