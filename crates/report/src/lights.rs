//! Judgements of recordings in the report, with limits from common practice in the field. Errors
//! of the model are graded by [`aloft_compare::Grade`].

use super::story::{Story, TrialStory};
use super::wording::number;
use aloft_compare::Signal;
use aloft_page::Light;
use aloft_workspace::limits::{FREE_FALL_PERCENT, MARKER_RMS_MM, MISSING_PERCENT, SIGMA_RATIO};
use aloft_workspace::qc::QcLevel;

/// Marker error, RMS, mm.
pub fn marker_rms(mm: f64) -> Light {
    Light::below(mm, MARKER_RMS_MM[0], MARKER_RMS_MM[1])
}

/// The limit of the marker error in words.
pub fn usual_limit() -> String {
    format!("usual limit {} mm", MARKER_RMS_MM[1])
}

/// Deviation of the acceleration of the centre of mass in flight from g, percent.
pub fn free_fall(percent: f64) -> Light {
    Light::below(percent.abs(), FREE_FALL_PERCENT[0], FREE_FALL_PERCENT[1])
}

/// Share of marker samples that were never measured, percent.
pub fn missing(percent: f64) -> Light {
    Light::below(percent, MISSING_PERCENT[0], MISSING_PERCENT[1])
}

/// Singular-value gap σ_N−1/σ_N.
pub fn gap(ratio: f64) -> Light {
    if !ratio.is_finite() {
        Light::Neutral
    } else if ratio >= SIGMA_RATIO[1] {
        Light::Good
    } else if ratio >= SIGMA_RATIO[0] {
        Light::Fair
    } else {
        Light::Poor
    }
}

/// The colour of a grade as a light.
pub fn of(signal: Signal) -> Light {
    match signal {
        Signal::Unknown => Light::Neutral,
        Signal::Good => Light::Good,
        Signal::Fair => Light::Fair,
        Signal::Poor => Light::Poor,
    }
}

/// A ratio with two digits, as the commands print it.
pub fn times(ratio: f64) -> String {
    aloft_compare::significant(ratio, 2)
}

/// Problems of a recording, most serious first.
pub fn remarks(t: &TrialStory<'_>) -> Vec<(Light, String)> {
    let mut out: Vec<(Light, String)> = Vec::new();
    for (stage, f) in &t.failures {
        let hint = f.hint.as_ref().map_or(String::new(), |h| format!(" Hint: {h}."));
        out.push((Light::Poor, format!("{stage} failed: {}.{hint}", f.problem.trim_end_matches('.'))));
    }
    if let Some(k) = &t.kinematics {
        if let Some(mm) = k.marker_rms_mm
            && marker_rms(mm) != Light::Good
        {
            out.push((marker_rms(mm), format!("marker error {} mm ({})", number(mm), usual_limit())));
        }
        if let Some(g) = k.gravity_error_percent
            && free_fall(g) != Light::Good
        {
            let text = format!(
                "in flight the centre of mass accelerates at g {g:+.1} %: flight edges, mass model or frame rate"
            );
            out.push((free_fall(g), text));
        }
    }
    if let Some(p) = t.missing_percent()
        && missing(p) != Light::Good
    {
        out.push((missing(p), format!("{p:.0} % of the marker samples are missing")));
    }
    // a recording with a warning is not good
    out.extend(t.warnings.iter().map(|w| (Light::Fair, w.text.clone())));
    if let Some(e) = &t.against_floor
        && of(e.grade.signal()) > Light::Good
    {
        let text = format!("held-out error is {} times the noise floor in {}", times(e.times_floor), e.place);
        out.push((of(e.grade.signal()), text));
    }
    // warnings of the summary that no stage has put into words
    if out.iter().all(|r| r.0 < Light::Fair) {
        let warned = t.reasons.iter().filter(|r| r.level() == QcLevel::Warning);
        out.extend(warned.map(|r| (Light::Fair, r.meaning().to_owned())));
    }
    out.sort_by_key(|r| std::cmp::Reverse(r.0));
    out
}

/// Judgement of one recording.
pub fn trial(t: &TrialStory<'_>) -> Light {
    if t.entry.excluded.is_some() || t.import.is_none() {
        return Light::Neutral;
    }
    remarks(t).iter().map(|r| r.0).max().unwrap_or(Light::Good).max(Light::Good)
}

/// Judgement of all recordings together, and the number of recordings with each judgement.
pub fn recordings(story: &Story<'_>) -> (Light, String) {
    let used: Vec<Light> = story.trials.iter().filter(|t| t.entry.excluded.is_none()).map(trial).collect();
    let of = |l: Light| used.iter().filter(|u| **u == l).count();
    let excluded = story.trials.len() - used.len();
    let mut parts: Vec<String> = [Light::Good, Light::Fair, Light::Poor]
        .into_iter()
        .filter(|l| of(*l) > 0)
        .map(|l| format!("{} {}", of(l), l.word()))
        .collect();
    if excluded > 0 {
        parts.push(format!("{excluded} excluded"));
    }
    let light = if of(Light::Poor) > 0 {
        if of(Light::Poor) * 2 > used.len() { Light::Poor } else { Light::Fair }
    } else if of(Light::Fair) > 0 {
        Light::Fair
    } else {
        Light::Good
    };
    (light, parts.join(", "))
}
