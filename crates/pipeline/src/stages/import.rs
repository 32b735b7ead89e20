//! `import`: one recording to a [`Trial`] in SI and the world frame, labels canonical, short gaps filled, artefacts found.

use crate::artifact::save_trial;
use crate::config::Vertical;
use crate::error::{PipelineError, StageFailure};
use crate::graph::{Done, Job, Need, Scope, Stage};
use crate::study::{Role, Study, TrialEntry};
use crate::workspace::write_json;
use aloft_trial::{ArtefactOptions, GapOptions, ImportOptions, QualityOptions, Severity, Trial, TrialQuality, UpAxis};
use aloft_trial::{MarkerSetMatch, apply_marker_set, assess, fill_gaps, find_artefacts};
use serde::{Deserialize, Serialize};
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "import",
    version: 1,
    scope: Scope::Trial(&[Role::Static, Role::Calibration, Role::Identify, Role::Validate]),
    reads: "C3D, or TRC with MOT; marker set",
    gives: "markers, plates, events in SI and one world frame; quality table",
    needs: &[Need::Recording],
    parameters: |study, _| json!({"import": study.config.import, "marker_set": study.marker_set}),
    run,
};

/// What `quality.json` holds.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ImportRecord {
    /// Labels found, missing, unknown.
    pub matched: MarkerSetMatch,
    /// Every fill.
    pub fills: Vec<aloft_trial::GapFill>,
    /// Spikes and swaps.
    pub findings: Vec<aloft_trial::Finding>,
    /// Quality of the trial.
    pub quality: TrialQuality,
}

/// Reads a recording as the pipeline asks for it, before a marker set is applied.
pub fn read_recording(study: &Study, entry: &TrialEntry) -> Result<Trial, StageFailure> {
    let import = &study.config.import;
    let options = ImportOptions {
        up_axis: match import.up_axis {
            Vertical::Auto => None,
            Vertical::X => Some(UpAxis::X),
            Vertical::Y => Some(UpAxis::Y),
            Vertical::Z => Some(UpAxis::Z),
        },
        strip_prefix: import.strip_prefix,
        ..ImportOptions::default()
    };
    read_file(&entry.name, &entry.file, entry.forces.as_deref(), &options)
}

/// Reads one recording from disk.
pub fn read_file(
    name: &str,
    file: &std::path::Path,
    forces: Option<&std::path::Path>,
    options: &ImportOptions,
) -> Result<Trial, StageFailure> {
    let label = |e: aloft_trial::TrialError| StageFailure::new(format!("{}: {e}", file.display()));
    if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("trc")) {
        let text = |p: &std::path::Path| {
            std::fs::read(p).map(|b| String::from_utf8_lossy(&b).into_owned()).map_err(PipelineError::io("read", p))
        };
        let trc = text(file)?;
        let mot = forces.map(text).transpose()?;
        return Trial::from_trc_mot(name, &trc, mot.as_deref(), options).map_err(label);
    }
    let bytes = std::fs::read(file).map_err(PipelineError::io("read", file))?;
    Trial::from_c3d(name, &bytes, options).map_err(label)
}

fn run(job: &Job<'_>) -> Result<Done, StageFailure> {
    let entry = job.trial()?;
    let study = job.study;
    let mut trial = read_recording(study, entry)?;
    let import = &study.config.import;
    let matched = apply_marker_set(&mut trial, &study.marker_set, &import.aliases);
    if matched.present.is_empty() {
        return Err(StageFailure::with_hint(
            format!(
                "{}: none of the {} markers of the set `{}` is in the recording; it has {}",
                entry.file.display(),
                study.marker_set.markers.len(),
                study.marker_set.name,
                abridged(&trial.markers.labels),
            ),
            "choose another `marker_set`, or map the labels under `import: {aliases: …}`",
        ));
    }
    let segments = study.marker_set.segments();
    let artefacts = ArtefactOptions { repair: import.repair, ..ArtefactOptions::default() };
    let findings = find_artefacts(&mut trial, &segments, &artefacts);
    let gaps = GapOptions {
        cubic_limit_s: import.fill_gaps_s,
        rigid_limit_s: import.rigid_fill_s.max(import.fill_gaps_s),
        ..GapOptions::default()
    };
    let fills = fill_gaps(&mut trial, &segments, &gaps);
    let quality = assess(&trial, Some(&matched), &fills, &findings, &QualityOptions::default());
    if let Some(reason) = quality.reasons.iter().find(|r| r.severity() == Severity::Unusable) {
        return Err(StageFailure::with_hint(
            format!("{}: {reason}", entry.file.display()),
            "exclude the trial with a reason under `trials: {exclude: …}`, or export it again",
        ));
    }
    save_trial(job.out, &trial)?;
    let mut done = Done::default();
    done.note("frames", trial.markers.n_frames);
    done.note("rate_hz", trial.markers.rate_hz);
    done.note("markers", matched.present.len());
    done.note("missing_markers", matched.missing.len());
    done.note("plates", trial.plates.len());
    done.note("filled_gaps", fills.len());
    let gaps_left: usize = trial
        .markers
        .labels
        .iter()
        .zip(&trial.markers.trajectories)
        .filter(|(l, _)| matched.present.contains(l))
        .map(|(_, t)| t.iter().filter(|p| !p.x.is_finite()).count())
        .sum();
    done.note("missing_samples", gaps_left);
    done.warnings.extend(trial.warnings.iter().cloned());
    done.warnings.extend(quality.reasons.iter().filter(|r| r.severity() == Severity::Warning).map(ToString::to_string));
    write_json(&job.out.join("quality.json"), &ImportRecord { matched, fills, findings, quality })?;
    Ok(done)
}

/// The first few of many names.
pub fn abridged(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(8).map(String::as_str).collect();
    if names.len() > 8 { format!("{} … ({} in all)", shown.join(", "), names.len()) } else { shown.join(", ") }
}
