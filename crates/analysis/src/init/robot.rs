//! A folder of a robot: joint logs, a description, a model file.

use super::{data_path, pipeline_name};
use aloft_study::quote;
use aloft_study::recordings::{base_beside, fold, log_stem, logs_below, markers_beside, stem_of};
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What the program reads of a robot's folder.
struct Logs {
    /// One log for each recording, relative to the folder.
    logs: Vec<PathBuf>,
    /// The same recordings in other formats.
    spare: Vec<String>,
}

/// The pipeline of a folder that holds joint logs of a robot, with notes; none for other folders.
///
/// # Errors
/// Logs without a description, or a description without logs.
pub(super) fn pipeline(folder: &Path, target: &Path) -> Result<Option<(String, Vec<String>)>, PipelineError> {
    let described = ["robot.yaml", "robot.yml"].into_iter().find(|name| input::is_there(&folder.join(name)));
    let Logs { logs, spare } = logs(folder, described.is_some())?;
    let Some(described) = described else {
        return if logs.is_empty() { Ok(None) } else { Err(undescribed(folder, &logs)) };
    };
    if logs.is_empty() {
        return Err(PipelineError::request_hint(
            format!("{} has {described}, and no joint log", folder.display()),
            "expected NAME_robot.csv, .csv.gz or .parquet, or NAME.mcap",
        ));
    }
    let stands = |log: &&PathBuf| fold(&stem_of(log)).contains("static");
    let (statics, moving): (Vec<&PathBuf>, Vec<&PathBuf>) = logs.iter().partition(stands);
    let list = |of: &[&PathBuf]| {
        let names: Vec<String> =
            of.iter().map(|log| quote::yaml_quoted(&quote::pattern(&log.to_string_lossy()))).collect();
        format!("[{}]", names.join(", "))
    };
    let baseless: Vec<String> = moving
        .iter()
        .filter(|log| log.extension().is_some_and(|e| e != "mcap"))
        .map(|log| folder.join(log))
        .filter(|log| base_beside(log).is_none() && markers_beside(log).is_none())
        .map(|log| stem_of(&log))
        .collect();
    let mut t = String::new();
    let path = quote::visible(&quote::path(target));
    let _ = writeln!(t, "# Written by `aloft init`. Look through it, then:");
    let _ = writeln!(t, "#   aloft check {path}\n#   aloft run {path}");
    let _ = writeln!(t, "name: {}", quote::yaml(&pipeline_name(folder, target, None)));
    let _ = writeln!(t, "data: {}", quote::yaml(&data_path(folder, target)));
    let _ = writeln!(t, "robot:");
    let _ = writeln!(
        t,
        "  description: {described}     # beside the recordings: mass, model files, inertial unit, noise of the sensors"
    );
    let _ = writeln!(
        t,
        "  # how far the model file's inertias may be off, one standard deviation\n  mass_rel: 0.15\n  com_m: 0.012\n  radius_rel: 0.12"
    );
    let _ = writeln!(t, "trials:\n  static: {}\n  calibration: []", list(&statics));
    let _ = writeln!(t, "  identify: {}      # flights are found in all of them", list(&moving));
    let _ = writeln!(t, "  validate: []");
    if !spare.is_empty() {
        let _ =
            writeln!(t, "  # the same recordings in other formats; not used: {}", quote::visible(&spare.join(", ")));
    }
    let _ =
        writeln!(t, "regressor: {{weighting: whitened}}      # by the noise of encoders, base pose and inertial unit");
    let _ = writeln!(t, "filter: {{order: 3, cutoff_hz: 30.0}}   # robots move their joints faster than people");
    let mut notes = Vec::new();
    if !baseless.is_empty() {
        notes.push(format!(
            "{}: no pose of the base beside the log (NAME_base.csv or NAME_markers.c3d); it has to be in the log's own columns",
            aloft_pipeline::recording::abridged(&baseless)
        ));
    }
    Ok(Some((t, notes)))
}

/// Logs in the folder, one for each recording: csv before Parquet before MCAP. Without a
/// description only names that say that they are a robot's.
fn logs(folder: &Path, described: bool) -> Result<Logs, PipelineError> {
    let order = |log: &Path| {
        let name = log.to_string_lossy().into_owned();
        [".csv.gz", ".csv", ".parquet", ".mcap"].iter().position(|end| name.ends_with(end))
    };
    let says_robot = |log: &Path| log.to_string_lossy().contains("_robot.");
    let mut all = logs_below(folder)?;
    if described {
        all.retain(|log| log.components().count() == 1);
        // of tables beside logs that say so only those are logs
        let named = all.iter().any(|log| says_robot(log));
        all.retain(|log| !named || says_robot(log) || log.extension().is_some_and(|e| e == "mcap"));
    } else {
        all.retain(|log| says_robot(log));
    }
    let mut of_stem: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for log in all {
        let at = log.with_file_name(log_stem(&log).unwrap_or_default());
        of_stem.entry(at.to_string_lossy().into_owned()).or_default().push(log);
    }
    let (mut logs, mut spare) = (Vec::new(), Vec::new());
    for mut same in of_stem.into_values() {
        same.sort_by_key(|log| order(log));
        let mut same = same.into_iter();
        logs.extend(same.next());
        spare.extend(same.map(|log| log.to_string_lossy().into_owned()));
    }
    Ok(Logs { logs, spare })
}

fn undescribed(folder: &Path, logs: &[PathBuf]) -> PipelineError {
    let models: Vec<PathBuf> = walkdir::WalkDir::new(folder)
        .sort_by_file_name()
        .into_iter()
        // none: only the example of a hint
        .filter_map(Result::ok)
        .filter(|e| e.path().extension().is_some_and(|x| x == "urdf" || x == "xml" || x == "mjcf"))
        .filter_map(|e| e.path().strip_prefix(folder).ok().map(Path::to_path_buf))
        .collect();
    let model = models.first().map_or_else(
        || "{urdf: MODEL.urdf}".to_owned(),
        |m| {
            let kind = if m.extension().is_some_and(|x| x == "urdf") { "urdf" } else { "mjcf" };
            format!("{{{kind}: {}}}", m.display())
        },
    );
    let first = logs.first().map(|l| l.display().to_string()).unwrap_or_default();
    PipelineError::request_hint(
        format!(
            "{} holds joint logs of a robot ({first}{}), and nothing says which robot",
            folder.display(),
            if logs.len() > 1 { ", …" } else { "" }
        ),
        format!(
            "write {} with the mass from a scale and the model file, at least: `total_mass_kg: …` and `model: {model}`",
            folder.join("robot.yaml").display()
        ),
    )
}
