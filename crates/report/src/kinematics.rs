//! How well the model fits the markers, what calibration improved, the free-fall check, and the
//! residual analysis for choosing a cut-off.

use super::story::Story;
use super::{STUDY, calibration, filtering, flights, lights};
use aloft_page::{Block, Chapter, Columns, Figure, HeatMap, Light, Section, Words};
use aloft_workspace::error::PipelineError;

/// The chapter.
///
/// # Errors
/// A result is there and cannot be read.
pub fn chapter(story: &Story<'_>) -> Result<Chapter, PipelineError> {
    let rms: Vec<f64> = story.dynamic().filter_map(|t| t.kinematics.as_ref()?.marker_rms_mm).collect();
    // a signal only where something is wrong: small marker errors say nothing about the model
    let light = match lights::marker_rms(rms.iter().sum::<f64>() / rms.len() as f64) {
        Light::Good => Light::Neutral,
        other => other,
    };
    let mut sections = Vec::new();
    sections.extend(markers(story));
    sections.extend(calibration::section(story)?);
    sections.extend(flights::section(story));
    sections.extend(filtering::section(story));
    if sections.is_empty() {
        let text = "Inverse kinematics has no results.";
        sections.push(Section::new("markers", "Markers", "", vec![Block::remark(Light::Poor, text)]));
    }
    Ok(Chapter {
        id: "kinematics".into(),
        title: "Kinematics".into(),
        group: STUDY.into(),
        light,
        word: String::new(),
        sections,
    })
}

/// Error of each marker in each recording.
fn markers(story: &Story<'_>) -> Option<Section> {
    let solved: Vec<_> = story.dynamic().filter_map(|t| Some((t, t.motion.as_ref()?))).collect();
    let mut labels: Vec<String> = Vec::new();
    for (_, motion) in &solved {
        for label in &motion.marker_labels {
            if !labels.contains(label) {
                labels.push(label.clone());
            }
        }
    }
    if labels.is_empty() {
        return None;
    }
    let rms = |motion: &aloft_body::Motion, label: &str| {
        let n = motion.marker_labels.len();
        let Some(i) = motion.marker_labels.iter().position(|l| l == label) else { return f64::NAN };
        let (mut sum, mut count) = (0.0, 0usize);
        for r in motion.residual_m.iter().skip(i).step_by(n).filter(|r| r.is_finite()) {
            sum += r * r;
            count += 1;
        }
        if count == 0 { f64::NAN } else { 1e3 * (sum / count as f64).sqrt() }
    };
    let mut rows: Vec<(String, Vec<f64>)> =
        labels.iter().map(|l| (l.clone(), solved.iter().map(|(_, m)| rms(m, l)).collect())).collect();
    let worst = |r: &[f64]| r.iter().filter(|v| v.is_finite()).fold(0.0_f64, |a, b| a.max(*b));
    rows.sort_by(|a, b| worst(&b.1).total_cmp(&worst(&a.1)));
    let map = HeatMap {
        x_title: "recording".into(),
        x: Columns::Names(solved.iter().map(|(t, _)| t.entry.name.clone()).collect()),
        y: rows.iter().map(|r| r.0.clone()).collect(),
        z: rows.into_iter().map(|r| r.1).collect(),
        unit: "RMS, mm".into(),
        step: 0.01,
        ..HeatMap::default()
    };
    let words = Words::new(
        "Distance of each marker from the model",
        "Root mean square over the recording, the worst marker on top. A dark row is a marker on soft tissue, or placed wrongly in the static \
         trial; a dark column is a recording in which something went wrong.",
    );
    Some(Section::new(
        "markers",
        "Markers",
        "The distance between the measured and the modelled marker position.",
        vec![Figure::heat_map(words, &map).into()],
    ))
}
