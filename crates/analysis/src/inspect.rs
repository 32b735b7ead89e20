//! `inspect`: the contents of a recording, and problems in it.

use crate::check::{Remark, findings};
use aloft_c3d::C3dFile;
use aloft_pipeline::recording::{abridged, read_file, unreadable};
use aloft_signal::residual_analysis::{ResidualAnalysis, residual_analysis};
use aloft_signal::{CutoffCorrection, LowPass};
use aloft_study::catalog;
use aloft_study::config::FilterConfig;
use aloft_trial::{ImportOptions, MarkerSet, QualityOptions, QualityReason, Trial, assess, recognise};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::input;
use serde::Serialize;
use std::path::Path;

/// Contents of a recording.
#[derive(Debug, Clone, Serialize)]
pub struct Inspection {
    /// Version of this structure.
    pub version: u32,
    /// File.
    pub file: String,
    /// Frames.
    pub frames: usize,
    /// Point rate, Hz.
    pub rate_hz: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Markers, each with the fraction of frames in which it is visible.
    pub markers: Vec<MarkerLine>,
    /// Computed points.
    pub computed: Vec<String>,
    /// Plates.
    pub plates: Vec<PlateLine>,
    /// Analog channels (C3D).
    pub analogs: Vec<String>,
    /// Rate of the analog channels, Hz.
    pub analog_rate_hz: Option<f64>,
    /// Events.
    pub events: Vec<aloft_trial::Event>,
    /// Winter's residual analysis: what a low-pass filter at each cut-off would remove from all
    /// markers together, m; helps to choose a cut-off.
    pub residual_analysis: Option<ResidualAnalysis>,
    /// Built-in marker sets and how well they fit, best first.
    pub marker_sets: Vec<(String, f64)>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// The same by kind, one line each.
    pub findings: Vec<String>,
}

/// One marker.
#[derive(Debug, Clone, Serialize)]
pub struct MarkerLine {
    /// Label.
    pub label: String,
    /// Fraction of frames in which it is visible.
    pub present: f64,
    /// Gaps.
    pub gaps: usize,
    /// Noise along one axis, mm.
    pub noise_mm: Option<f64>,
}

/// One plate.
#[derive(Debug, Clone, Serialize)]
pub struct PlateLine {
    /// Name.
    pub name: String,
    /// Rate, Hz.
    pub rate_hz: f64,
    /// Largest vertical force on the subject, N.
    pub peak_vertical_n: f64,
}

/// What a file holds, for looking at it: a recording, or a file without any marker, such as plates
/// or EMG alone (C3D), or ground reactions (MOT, STO). C3D files come with the parsed file.
pub(crate) fn read_contents(name: &str, file: &Path) -> Result<(Trial, Option<C3dFile>), PipelineError> {
    let options = ImportOptions::default();
    let request = |f: StageFailure| PipelineError::Request { problem: f.problem, hint: f.hint };
    let damaged = |e: aloft_trial::TrialError| request(unreadable(name, file, &e));
    let is = |ending: &str| file.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let bytes = || input::bytes(file);
    if is("mot") || is("sto") {
        let text = String::from_utf8_lossy(&bytes()?).into_owned();
        return Ok((Trial::contents_of_mot(name, &text, &options).map_err(damaged)?, None));
    }
    if !is("trc")
        && !aloft_study::recordings::is_bids(file)
        // none: another format, whose reader names what is wrong
        && let Ok(c3d) = C3dFile::from_bytes(&bytes()?)
    {
        return Ok((Trial::contents_of_c3d(name, &c3d, &options).map_err(damaged)?, Some(c3d)));
    }
    if is("trc") {
        let text = String::from_utf8_lossy(&bytes()?).into_owned();
        return Ok((Trial::contents_of_trc_mot(name, &text, None, &options).map_err(damaged)?, None));
    }
    Ok((read_file(name, file, None, &options).map_err(request)?, None))
}

/// Reads the file and examines its contents.
pub fn inspect(file: &Path) -> Result<Inspection, PipelineError> {
    let name = aloft_study::recordings::stem_of(file);
    let (trial, c3d) = read_contents(&name, file)?;
    let quality = assess(&trial, None, &[], &[], &QualityOptions::default());
    let sets: Vec<MarkerSet> = catalog::all("markersets")?;
    let mut remarks: Vec<Remark> = trial.warnings.iter().cloned().map(Remark::Import).collect();
    let of_markers = |r: &&QualityReason| !matches!(r, QualityReason::ColumnsNotUsed { .. });
    let (of_markers, of_forces): (Vec<_>, Vec<_>) = quality.reasons.iter().partition(of_markers);
    if trial.markers.labels.is_empty() {
        let words = "no labelled marker: there is nothing here that the other commands could use";
        remarks.push(Remark::Other(words.to_owned()));
    } else {
        remarks.extend(of_markers.into_iter().cloned().map(Remark::Quality));
    }
    remarks.extend(of_forces.into_iter().cloned().map(Remark::Quality));
    let (analogs, analog_rate_hz) = c3d.map_or((Vec::new(), None), |f| {
        let rate = (!f.analogs.is_empty()).then_some(f.analog_rate_hz);
        (f.analogs, rate)
    });
    // without markers the longest series says how long the recording is
    let seconds = |n: usize, rate_hz: f64| if rate_hz > 0.0 { n as f64 / rate_hz } else { 0.0 };
    let duration_s = trial
        .plates
        .iter()
        .map(|p| seconds(p.force_n.len(), p.rate_hz))
        .chain(analogs.iter().map(|a| seconds(a.values.len(), analog_rate_hz.unwrap_or(0.0))))
        .filter(|_| trial.markers.labels.is_empty())
        .fold(quality.duration_s.max(0.0), f64::max);
    Ok(Inspection {
        version: 1,
        file: file.display().to_string(),
        frames: trial.markers.n_frames,
        rate_hz: trial.markers.rate_hz,
        duration_s,
        markers: quality
            .markers
            .iter()
            .map(|m| MarkerLine {
                label: m.label.clone(),
                present: m.present_fraction,
                gaps: m.gaps,
                noise_mm: m.noise_rms_m.is_finite().then_some(m.noise_rms_m * 1e3),
            })
            .collect(),
        computed: trial.computed.iter().map(|c| c.label.clone()).collect(),
        plates: trial
            .plates
            .iter()
            .map(|p| PlateLine {
                name: p.name.clone(),
                rate_hz: p.rate_hz,
                peak_vertical_n: p.force_n.iter().map(|f| f.z).filter(|f| f.is_finite()).fold(0.0, f64::max),
            })
            .collect(),
        analogs: analogs.into_iter().map(|a| a.label).collect(),
        analog_rate_hz,
        events: trial.events.clone(),
        residual_analysis: residuals(&trial),
        marker_sets: recognise(&trial, &sets),
        warnings: remarks.iter().map(ToString::to_string).collect(),
        findings: findings([(name.as_str(), remarks.as_slice())].into_iter()).into_iter().map(|f| f.text).collect(),
    })
}

/// Winter's residual analysis over the coordinates of all markers.
fn residuals(trial: &Trial) -> Option<ResidualAnalysis> {
    let rate = trial.markers.rate_hz;
    let channels: Vec<Vec<f64>> = trial
        .markers
        .trajectories
        .iter()
        .filter(|path| path.iter().any(|p| p.x.is_finite()))
        .flat_map(|path| (0..3).map(|axis| path.iter().map(|p| p[axis]).collect()))
        .collect();
    let slices: Vec<&[f64]> = channels.iter().map(Vec::as_slice).collect();
    let config = FilterConfig::default();
    let shape = LowPass { order: config.order, cutoff_hz: config.cutoff_hz, correction: CutoffCorrection::None };
    let cutoffs: Vec<f64> = CUTOFFS_HZ.iter().copied().filter(|f| *f <= 0.35 * rate).collect();
    // none: at such a rate no cut-off can be chosen, and the table is left out
    residual_analysis(&slices, rate, shape, &cutoffs).ok().filter(|a| a.residual_rms.iter().any(|r| r.is_finite()))
}

/// Cut-offs of the table, Hz.
const CUTOFFS_HZ: [f64; 16] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 25.0, 30.0];

/// Columns of the names and of the numbers in the table of cut-offs.
const NAMES: usize = 16;
const NUMBERS: usize = 7;

/// The inspection as text; the table of cut-offs takes no more than `width` columns.
pub fn to_text(i: &Inspection, width: usize) -> String {
    let labels: Vec<String> = i.markers.iter().map(|m| m.label.clone()).collect();
    let mut lines = if labels.is_empty() {
        vec![format!("{}: no markers ({:.2} s)", i.file, i.duration_s)]
    } else {
        vec![
            format!("{}: {} frames at {} Hz ({:.2} s)", i.file, i.frames, i.rate_hz, i.duration_s),
            format!("markers: {} ({})", labels.len(), abridged(&labels)),
        ]
    };
    for m in i.markers.iter().filter(|m| m.present < 1.0) {
        lines.push(format!("  {}: seen in {:.1} % of the frames, {} gaps", m.label, 100.0 * m.present, m.gaps));
    }
    if !i.computed.is_empty() {
        lines.push(format!("computed points: {} ({})", i.computed.len(), abridged(&i.computed)));
    }
    for p in &i.plates {
        lines.push(format!("plate {}: {} Hz, largest vertical force {:.0} N", p.name, p.rate_hz, p.peak_vertical_n));
    }
    if !i.analogs.is_empty() {
        let rate = i.analog_rate_hz.map_or(String::new(), |r| format!(" at {r} Hz"));
        lines.push(format!("analog channels: {}{rate} ({})", i.analogs.len(), abridged(&i.analogs)));
    }
    for e in &i.events {
        lines.push(format!("event at {:.3} s: {} {}", e.time_s, e.context, e.label));
    }
    if let Some(a) = &i.residual_analysis {
        let row = |what: &str, values: &[String]| {
            format!("  {what:<14}{}", values.iter().map(|v| format!("{v:>NUMBERS$}")).collect::<String>())
        };
        lines.push(
            "what a low-pass takes away from the markers (order 3, both ways; Winter's residual analysis):".to_owned(),
        );
        let cutoffs: Vec<String> = a.cutoff_hz.iter().map(|f| format!("{f:.0}")).collect();
        let residuals: Vec<String> = a.residual_rms.iter().map(|r| format!("{:.2}", 1e3 * r)).collect();
        let fit = (width.saturating_sub(NAMES) / NUMBERS).max(1);
        for (cutoffs, residuals) in cutoffs.chunks(fit).zip(residuals.chunks(fit)) {
            lines.push(row("cut-off, Hz", cutoffs));
            lines.push(row("residual, mm", residuals));
        }
        if let (Some(noise), Some(hz)) = (a.noise_rms, a.suggested_cutoff_hz) {
            lines.push(format!(
                "  noise by extrapolation {:.2} mm; at {hz:.1} Hz as much signal is lost as noise is kept",
                1e3 * noise
            ));
        }
    }
    if let Some((name, score)) = i.marker_sets.first().filter(|(_, s)| *s > 0.3) {
        lines.push(format!("marker set: most like `{name}` (fit {score:.2} of 1)"));
    }
    lines.extend(i.findings.iter().map(|w| format!("warning: {w}")));
    lines.join("\n")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use aloft_c3d::C3dBuilder;

    fn inspected(name: &str, bytes: &[u8]) -> String {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        to_text(&inspect(&path).unwrap(), 100)
    }

    #[test]
    fn a_file_with_forces_alone_is_shown() {
        let mot = "forces\nversion=1\nnRows=3\nnColumns=7\nendheader\n\
                   time\tground_force_vx\tground_force_vy\tground_force_vz\tground_force_px\tground_force_py\tground_force_pz\n\
                   2.00\t1\t600\t2\t0.1\t0\t0.2\n2.01\t1\t610\t2\t0.1\t0\t0.2\n2.02\t1\t605\t2\t0.1\t0\t0.2\n";
        let text = inspected("grf.mot", mot.as_bytes());
        assert!(text.contains("no markers (0.03 s)"), "{text}");
        assert!(text.contains("largest vertical force 610 N"), "{text}");
    }

    #[test]
    fn a_file_with_channels_alone_is_shown_and_has_values() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("emg.c3d");
        let emg = (0..2000).map(|i| f64::from(i % 7)).collect::<Vec<f64>>();
        let built = C3dBuilder::new(100.0).analog_rate_hz(1000.0).analog("GASL", "V", emg).build().unwrap();
        std::fs::write(&path, built.to_bytes().unwrap()).unwrap();
        let text = to_text(&inspect(&path).unwrap(), 100);
        assert!(text.contains("no markers (2.00 s)"), "{text}");
        assert!(text.contains("analog channels: 1 at 1000 Hz (GASL)"), "{text}");
        let table = crate::inspect_values::values(&path, &["GASL".to_owned()]).unwrap();
        assert_eq!(table.to_csv().lines().nth(4), Some("4,0.003,3"));
        let none = crate::inspect_values::values(&path, &[]).unwrap_err();
        assert!(matches!(none, PipelineError::Request { hint: Some(h), .. } if h.contains("--values GASL")));
    }

    #[test]
    fn many_absences_are_one_line() {
        let hidden = |from: usize| -> Vec<[f32; 3]> {
            (0..100).map(|f| if f < from { [f32::NAN; 3] } else { [1.0, 2.0, 1000.0] }).collect()
        };
        let file = C3dBuilder::new(100.0)
            .marker("LASI", hidden(40))
            .marker("RASI", hidden(50))
            .marker("SACR", hidden(60))
            .build()
            .unwrap();
        let text = inspected("walk.c3d", &file.to_bytes().unwrap());
        let said: Vec<&str> =
            text.lines().filter(|l| l.contains("missing in") || l.contains("gaps too long")).collect();
        assert_eq!(said, ["warning: 3 gaps too long to fill in 3 markers: LASI, RASI, SACR"], "{text}");
    }
}
