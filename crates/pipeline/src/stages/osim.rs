//! What `scale`, `calibrate` and `ik` do for an OpenSim model: the file in place of landmarks,
//! nothing refined, inverse kinematics in the file's own coordinates.

use crate::graph::{StageInputs, StageReport};
use crate::stages::shared::fit_options;
use crate::stages::shared::save_subject;
use aloft_ik::{IkReport, MarkerFit};
use aloft_robot::RobotError;
use aloft_robot::osim::{OsimIk, RigidTree};
use aloft_study::config::IkConfig;
use aloft_study::facts::Facts;
use aloft_study::osim::OsimSetup;
use aloft_study::subject_session::Role;
use aloft_workspace::artifact::save_motion;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use aloft_workspace::limits::MARKER_RMS_MM;
use aloft_workspace::qc::QcReason;
use aloft_workspace::table::Table;
use aloft_workspace::warning::StageWarning;

/// Table of the file's coordinates in the results of `ik`.
pub const COORDINATES: &str = "coordinates.parquet";

/// Share of the frames at an end of its range from which a coordinate is remarked upon.
const OFTEN: f64 = 0.05;

fn failed(error: &RobotError) -> StageFailure {
    StageFailure::new(error.to_string())
}

/// `scale`: the file as the subject, already scaled.
pub fn scale(osim: &OsimSetup, facts: &Facts, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let subject = osim.tree.subject(&osim.model, facts.person.clone(), facts.gravity(), osim.spread);
    save_subject(inputs, &subject)?;
    write_json(&inputs.out.join("locked.json"), &Vec::<usize>::new())?;
    let mut done = StageReport::default();
    done.note("links", subject.model.n_links());
    done.note("coordinates", osim.model.coordinates.len());
    done.note("model_mass_kg", osim.tree.mass_kg());
    let ratio = osim.tree.mass_kg() / facts.person.mass_kg;
    if (ratio - 1.0).abs() > 0.02 {
        done.warnings.push(format!(
            "the bodies of {} weigh {:.1} kg, the subject {:.1} kg: masses are scaled by {:.3}",
            osim.name,
            osim.tree.mass_kg(),
            facts.person.mass_kg,
            1.0 / ratio
        ));
    }
    done.warnings.extend(osim.tree.remarks.iter().cloned());
    Ok(done)
}

/// `calibrate`: geometry and marker places stay the file's; joints beyond which the recordings have
/// no marker are held.
pub fn keep_seen(osim: &OsimSetup, facts: &Facts, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let mut done = StageReport::default();
    done.note("used", false);
    let mut seen: Vec<String> = Vec::new();
    for name in inputs.trials_with_role("import", Role::is_dynamic) {
        let trial = inputs.results.load_markers(&name)?;
        for marker in &osim.model.markers {
            let tracked = |i: usize| trial.markers.trajectories[i].iter().any(|p| p.x.is_finite());
            if !seen.contains(&marker.name) && trial.markers.index(&marker.name).is_some_and(tracked) {
                seen.push(marker.name.clone());
            }
        }
    }
    let tree = RigidTree::of(&osim.model, Some(&seen)).map_err(|e| failed(&e))?;
    let mut subject = tree.subject(&osim.model, facts.person.clone(), facts.gravity(), osim.spread);
    let unseen: Vec<String> =
        subject.markers.iter().filter(|m| !seen.contains(&m.label)).map(|m| m.label.clone()).collect();
    subject.markers.retain(|m| seen.contains(&m.label));
    if !unseen.is_empty() {
        done.warnings.push(format!(
            "{} of the {} markers of {} are in no recording: {}",
            unseen.len(),
            osim.model.markers.len(),
            osim.name,
            crate::recording::abridged(&unseen)
        ));
    }
    let still = |m: &&aloft_robot::osim::MergedBody| m.unseen;
    let held: Vec<String> = tree.merged.iter().filter(still).map(|m| m.body.clone()).collect();
    if !held.is_empty() {
        done.warnings.push(format!(
            "no marker beyond their joints, so held as the file has them: {}",
            crate::recording::abridged(&held)
        ));
    }
    save_subject(inputs, &subject)?;
    Ok(done)
}

/// `ik`: markers to the file's coordinates, and from these to the motion of the links.
pub fn motion(osim: &OsimSetup, config: &IkConfig, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let name = inputs.trial()?;
    let mut subject = inputs.results.load_subject("calibrate")?;
    let options = fit_options(config, inputs.results, &mut subject)?;
    let (trial, exchanges) = inputs.results.load_labelled_markers(name)?;
    let seen: Vec<String> = subject.markers.iter().map(|m| m.label.clone()).collect();
    let tree = RigidTree::of(&osim.model, Some(&seen)).map_err(|e| failed(&e))?;
    let solver = OsimIk::new(&osim.model, &tree, &subject.markers, options.marker_sd_m);
    let places: Vec<Option<usize>> = solver.labels().iter().map(|l| trial.markers.index(l)).collect();
    let found = solver.track(name, trial.markers.rate_hz, trial.markers.n_frames, &|marker, frame| {
        places[marker].and_then(|i| trial.markers.position(i, frame))
    });
    let frames = trial.markers.n_frames;
    let mut table = Table::default();
    let names: Vec<String> = osim.model.all_coordinates().iter().map(|c| c.name.clone()).collect();
    table.push_rows(&names, &found.values);
    table.write(&inputs.out.join(COORDINATES))?;
    save_motion(inputs.out, &found.motion, &tree.model)?;
    let report = IkReport::of_motion(&found.motion, found.unconverged);
    write_json(&inputs.out.join("report.json"), &report)?;
    let mut done = StageReport::default();
    if !exchanges.is_empty() {
        write_json(&inputs.out.join("labels.json"), &exchanges)?;
        done.warnings.extend(exchanges.iter().map(|e| StageWarning::new(QcReason::LabelsExchanged, e.to_string())));
        done.note("qc", serde_json::json!([QcReason::LabelsExchanged]));
    }
    done.note("marker_rms_mm", found.rms_m * 1e3);
    done.note("marker_max_mm", found.max_m * 1e3);
    done.note("unsolved_frames", found.unsolved);
    if found.unsolved == frames {
        return Err(StageFailure::with_hint(
            format!("{name}: no frame has four of the model's markers"),
            "compare the labels (`aloft inspect`) with the markers of the model, or map them under `import: {aliases: …}`",
        )
        .because(QcReason::IkFailed));
    }
    if found.unsolved > 0 {
        done.warnings.push(format!("{} of {frames} frames could not be solved", found.unsolved));
    }
    if 1e3 * found.rms_m > MARKER_RMS_MM[1] {
        let of = |m: &&MarkerFit| format!("{} {:.0} mm", m.label, m.rms_m * 1e3);
        let worst = report.worst(4).iter().map(of).collect::<Vec<_>>().join(", ");
        done.warnings.push(StageWarning::new(
            QcReason::IkErrorLarge,
            format!(
                "marker RMS {:.1} mm (usual limit {} mm) with the model as it is in the file; worst: {worst}",
                found.rms_m * 1e3,
                MARKER_RMS_MM[1]
            ),
        ));
    }
    for (coordinate, n) in found.at_range.iter().filter(|(_, n)| *n as f64 > OFTEN * frames as f64) {
        done.warnings.push(format!(
            "coordinate `{coordinate}`: at an end of the range in the file in {n} of {frames} frames; OpenSim stops it there, too"
        ));
    }
    Ok(done)
}
