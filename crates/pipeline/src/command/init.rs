//! `init`: looks at a folder of recordings and writes a commented pipeline for it. Nothing is overwritten.

use crate::catalog;
use crate::error::PipelineError;
use crate::stages::import::read_file;
use aloft_trial::{ImportOptions, MarkerSet, Trial, recognise};
use nalgebra::Vector3;
use std::fmt::Write;
use std::path::{Path, PathBuf};

struct Seen {
    relative: String,
    stem: String,
    trial: Trial,
}

/// Looks, decides, writes; returns the path written.
pub fn init(folder: &Path, out: Option<&Path>) -> Result<PathBuf, PipelineError> {
    let target = out.map_or_else(|| PathBuf::from("aloft.yaml"), Path::to_path_buf);
    if target.exists() {
        return Err(PipelineError::request_hint(
            format!("{} is there already", target.display()),
            "give another name with --out; nothing is overwritten",
        ));
    }
    if !folder.is_dir() {
        return Err(PipelineError::request(format!("{} is not a folder", folder.display())));
    }
    let (seen, broken) = look(folder)?;
    if seen.is_empty() {
        return Err(PipelineError::request_hint(
            format!("{}: no recording could be read ({} files tried)", folder.display(), broken.len()),
            broken.first().cloned().unwrap_or_else(|| "expected .c3d or .trc files".to_owned()),
        ));
    }
    let text = write(folder, &target, &seen, &broken)?;
    std::fs::write(&target, text).map_err(PipelineError::io("write", &target))?;
    Ok(target)
}

fn look(folder: &Path) -> Result<(Vec<Seen>, Vec<String>), PipelineError> {
    let mut seen = Vec::new();
    let mut broken = Vec::new();
    for entry in walkdir::WalkDir::new(folder).sort_by_file_name().into_iter().flatten() {
        let path = entry.path();
        let known = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d") || e.eq_ignore_ascii_case("trc"));
        if !entry.file_type().is_file() || !known {
            continue;
        }
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let relative = path.strip_prefix(folder).unwrap_or(path).to_string_lossy().replace('\\', "/");
        match read_file(&stem, path, None, &ImportOptions::default()) {
            Ok(trial) => seen.push(Seen { relative, stem, trial }),
            Err(failure) => broken.push(failure.problem),
        }
    }
    Ok((seen, broken))
}

/// Standing still: the median marker moves less than 2 cm about its mean.
fn is_still(trial: &Trial) -> bool {
    let mut spreads: Vec<f64> = trial
        .markers
        .trajectories
        .iter()
        .filter_map(|t| {
            let valid: Vec<&Vector3<f64>> = t.iter().filter(|p| p.x.is_finite()).collect();
            let n = valid.len() as f64;
            (n > 10.0).then(|| {
                let mean = valid.iter().fold(Vector3::zeros(), |a, p| a + **p) / n;
                (valid.iter().map(|p| (**p - mean).norm_squared()).sum::<f64>() / n).sqrt()
            })
        })
        .collect();
    spreads.sort_by(f64::total_cmp);
    spreads.get(spreads.len() / 2).is_some_and(|s| *s < 0.02)
}

fn list(names: &[&Seen]) -> String {
    let quoted: Vec<String> = names.iter().map(|s| format!("\"{}\"", s.relative)).collect();
    format!("[{}]", quoted.join(", "))
}

fn write(folder: &Path, target: &Path, seen: &[Seen], broken: &[String]) -> Result<String, PipelineError> {
    let sets: Vec<MarkerSet> = catalog::all("markersets")?;
    let mut totals: Vec<(&MarkerSet, f64)> = sets
        .iter()
        .map(|set| {
            let sum: f64 = seen
                .iter()
                .map(|s| recognise(&s.trial, &sets).into_iter().find(|(n, _)| n == &set.name).map_or(0.0, |(_, v)| v))
                .sum();
            (set, sum / seen.len() as f64)
        })
        .collect();
    totals.sort_by(|a, b| b.1.total_cmp(&a.1));
    let best = totals.first();
    let (set, fit) = best.map_or(("plug-in-gait-35", 0.0), |(s, f)| (s.name.as_str(), *f));
    let model = best.map_or("human34", |(s, _)| s.model.as_str());
    let is_object = model == "two_link";
    let lower = |s: &Seen| s.stem.to_lowercase();
    let calibration: Vec<&Seen> = seen.iter().filter(|s| lower(s).contains("calib")).collect();
    let mut statics: Vec<&Seen> =
        seen.iter().filter(|s| lower(s).contains("static") || lower(s).contains("cal_pose")).collect();
    if statics.is_empty() {
        statics = seen.iter().filter(|s| is_still(&s.trial) && !lower(s).contains("calib")).collect();
    }
    let is = |group: &[&Seen], s: &Seen| group.iter().any(|g| g.relative == s.relative);
    let rest: Vec<&Seen> = seen.iter().filter(|s| !is(&statics, s) && !is(&calibration, s)).collect();
    let held = ["exercise", "squat", "gait", "walk", "valid"];
    let mut validate: Vec<&Seen> = rest.iter().copied().filter(|s| held.iter().any(|h| lower(s).contains(h))).collect();
    let mut identify: Vec<&Seen> = rest.iter().copied().filter(|s| !is(&validate, s)).collect();
    if identify.is_empty() {
        std::mem::swap(&mut identify, &mut validate);
    }
    let plates = seen.iter().map(|s| s.trial.plates.len()).max().unwrap_or(0);
    let rates: std::collections::BTreeSet<String> =
        seen.iter().map(|s| format!("{}", s.trial.markers.rate_hz)).collect();
    let data = data_path(folder, target);
    let name = folder
        .canonicalize()
        .ok()
        .and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()))
        .unwrap_or_else(|| "study".to_owned());
    let has_facts = ["subject.yaml", "object.yaml", "participants.tsv"].iter().find(|f| folder.join(f).is_file());
    let mut t = String::new();
    let mut line = |s: String| {
        let _ = writeln!(t, "{s}");
    };
    line("# Written by `aloft init`. Look through it, then:".to_owned());
    line(format!("#   aloft check {0}\n#   aloft run {0}", target.display()));
    line(format!("name: {}", name.replace(|c: char| !c.is_alphanumeric() && c != '-' && c != '_', "_")));
    line(format!("data: {}", serde_yaml::to_string(&data).unwrap_or(data).trim()));
    line(format!(
        "# {} recordings at {} Hz, {} force plates",
        seen.len(),
        rates.into_iter().collect::<Vec<_>>().join(", "),
        plates
    ));
    line(format!("model: {model}"));
    if fit > 0.5 {
        line(format!("marker_set: {set}      # fits {:.0} %", fit * 100.0));
    } else {
        line(format!(
            "marker_set: {set}      # fits only {:.0} %: choose another ({}) or map labels below",
            fit * 100.0,
            catalog::names("markersets").join(", ")
        ));
    }
    if is_object {
        line("object: two_link_chain   # how markers define the link frames".to_owned());
    }
    match has_facts {
        Some(file) => line(format!("# name, sex, height and mass come from {file} beside the recordings")),
        None if is_object => line("subject:\n  mass_kg:              # from a scale: fill in".to_owned()),
        None => line("subject:\n  sex:                  # F or M\n  height_m:             # stature, m\n  mass_kg:              # from a scale, kg: fill in".to_owned()),
    }
    line("trials:".to_owned());
    line(format!("  static: {}", list(&statics)));
    line(format!("  calibration: {}", list(&calibration)));
    line(format!("  identify: {}      # motion to identify from", list(&identify)));
    line(format!("  validate: {}      # held out for comparison", list(&validate)));
    if statics.is_empty()
        && let Some(first) = rest.first()
    {
        line(format!(
            "  # no static trial was found: quiet frames of a dynamic trial can serve\n  static_frames: {{trial: {}, first: 1, last: 30}}",
            first.stem
        ));
    }
    if !broken.is_empty() {
        line("  # could not be read:".to_owned());
        for b in broken {
            line(format!("  #   {}", b.replace('\n', " ")));
        }
    }
    line("import:".to_owned());
    line("  up_axis: auto         # x, y, z: the vertical of the recordings".to_owned());
    line("  fill_gaps_s: 0.1      # longest gap that is filled, s".to_owned());
    line("  # aliases: {MyLabel: LASI}".to_owned());
    line("filter: {order: 3, cutoff_hz: 10.0}   # per pass; two passes".to_owned());
    Ok(t)
}

/// The folder relative to the pipeline file where that is a plain path, absolute otherwise.
fn data_path(folder: &Path, target: &Path) -> String {
    let absolute = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let base =
        target.parent().filter(|p| !p.as_os_str().is_empty()).map_or_else(|| PathBuf::from("."), Path::to_path_buf);
    let base = base.canonicalize().unwrap_or(base);
    match absolute.strip_prefix(&base) {
        Ok(relative) if relative.as_os_str().is_empty() => ".".to_owned(),
        Ok(relative) => relative.to_string_lossy().into_owned(),
        Err(_) => absolute.to_string_lossy().into_owned(),
    }
}
