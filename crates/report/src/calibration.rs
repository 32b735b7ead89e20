//! Result of the geometry calibration over all recordings.

use super::headline::sentence_of;
use super::story::Story;
use super::wording::{card, number};
use aloft_page::{Block, Dots, Figure, Light, Section, Table, Words};
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use serde::Deserialize;

/// Contents of the report of `calibrate`; missing values are allowed.
#[derive(Debug, Deserialize)]
struct Report {
    frames_used: usize,
    frames_held_out: usize,
    held_out_rms_before_m: Option<f64>,
    held_out_rms_after_m: Option<f64>,
    joints: Vec<Joint>,
    contradiction: Option<String>,
    markers: Vec<Marker>,
}

#[derive(Debug, Deserialize)]
struct Joint {
    link: String,
    moved_m: Option<f64>,
    sd_m: Option<f64>,
    axis_turned_rad: Option<f64>,
}

#[derive(Debug, Deserialize)]
struct Marker {
    label: String,
    rms_before_m: Option<f64>,
    rms_after_m: Option<f64>,
}

fn mm(m: Option<f64>) -> f64 {
    m.map_or(f64::NAN, |m| 1e3 * m)
}

/// The section; none for objects, or if nothing was calibrated.
///
/// # Errors
/// The report of the calibration is there and cannot be read.
pub fn section(story: &Story<'_>) -> Result<Option<Section>, PipelineError> {
    // objects and models of OpenSim have a report of another form, which is not shown
    if story.session.is_rigid() || story.session.osim.is_some() {
        return Ok(None);
    }
    let report = read_json_if_there(&story.ws.place("calibrate", WHOLE_STUDY).join("report.json"))?;
    report.map_or(Ok(None), |r| of(story, &r))
}

fn of(story: &Story<'_>, r: &Report) -> Result<Option<Section>, PipelineError> {
    let manifest = story.ws.manifest("calibrate", WHOLE_STUDY)?;
    let used = manifest.and_then(|m| m.summary.get("used").and_then(serde_json::Value::as_bool));
    let (before, after) = (mm(r.held_out_rms_before_m), mm(r.held_out_rms_after_m));
    let light = if after < before && r.contradiction.is_none() { Light::Good } else { Light::Fair };
    let moved: Vec<f64> = r.joints.iter().map(|j| mm(j.moved_m)).filter(|m| m.is_finite()).collect();
    let mut blocks = vec![Block::Cards {
        cards: vec![
            card(
                "Marker error with landmarks alone",
                format!("{} mm", number(before)),
                format!("{} frames held out", r.frames_held_out),
                Light::Neutral,
            ),
            card("After calibration", format!("{} mm", number(after)), format!("{} frames used", r.frames_used), light),
            card(
                "Joint centres moved by",
                format!("{} mm", number(moved.iter().sum::<f64>() / moved.len() as f64)),
                "mean over joints",
                Light::Neutral,
            ),
        ],
    }];
    if used == Some(false) {
        blocks.push(Block::remark(Light::Fair, "The held-out error did not fall: the landmarks' geometry was kept."));
    }
    blocks.extend(r.contradiction.iter().map(|words| Block::remark(Light::Poor, sentence_of(words))));
    let mut markers: Vec<&Marker> = r.markers.iter().collect();
    markers.sort_by(|a, b| mm(b.rms_before_m).total_cmp(&mm(a.rms_before_m)));
    let names: Vec<String> = markers.iter().map(|m| m.label.clone()).collect();
    let kinds = [
        Dots::new("after calibration", markers.iter().map(|m| mm(m.rms_after_m)).collect()),
        Dots::new("landmarks alone", markers.iter().map(|m| mm(m.rms_before_m)).collect()),
    ];
    let words = Words::new(
        "Error of each marker before and after",
        "Root mean square over the frames that took part and held-out frames. Calibration should move every point to the left.",
    );
    blocks.push(Figure::dots(words, "RMS, mm", &names, &kinds, &[]).into());
    let rows = r
        .joints
        .iter()
        .map(|j| {
            let turned = j.axis_turned_rad.map_or("–".to_owned(), |a| number(a.to_degrees()));
            vec![j.link.replace('_', " "), number(mm(j.moved_m)), number(mm(j.sd_m)), turned]
        })
        .collect();
    let table = Table::new(
        "Joint centres and hinge axes",
        "How far each moved from where landmarks put it; standard deviation root mean square over axes.",
        &["joint of", "moved, mm", "standard deviation, mm", "hinge axis turned, °"],
        rows,
    );
    blocks.push(table.into());
    Ok(Some(Section::new(
        "calibration",
        "What calibration gained",
        "Joint centres, hinge axes and marker places were refined over all recordings on markers alone; the error is evaluated on held-out frames.",
        blocks,
    )))
}
