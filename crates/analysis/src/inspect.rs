//! `inspect`: the contents of a recording, and problems in it.

use aloft_c3d::C3dFile;
use aloft_pipeline::recording::{abridged, read_file};
use aloft_signal::residual_analysis::{ResidualAnalysis, residual_analysis};
use aloft_signal::{CutoffCorrection, LowPass};
use aloft_study::catalog;
use aloft_study::config::FilterConfig;
use aloft_trial::{ImportOptions, MarkerSet, QualityOptions, assess, recognise};
use aloft_workspace::error::PipelineError;
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
    /// Events.
    pub events: Vec<aloft_trial::Event>,
    /// Winter's residual analysis: what a low-pass filter at each cut-off would remove from all
    /// markers together, m; helps to choose a cut-off.
    pub residual_analysis: Option<ResidualAnalysis>,
    /// Built-in marker sets and how well they fit, best first.
    pub marker_sets: Vec<(String, f64)>,
    /// Warnings.
    pub warnings: Vec<String>,
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

/// Reads the file and examines its contents.
pub fn inspect(file: &Path) -> Result<Inspection, PipelineError> {
    let name = aloft_study::recordings::stem_of(file);
    let trial = read_file(&name, file, None, &ImportOptions::default())
        .map_err(|f| PipelineError::Request { problem: f.problem, hint: f.hint })?;
    let analogs = if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d")) {
        let bytes = std::fs::read(file).map_err(PipelineError::io("read", file))?;
        C3dFile::from_bytes(&bytes).map(|f| f.analogs.into_iter().map(|a| a.label).collect()).unwrap_or_default()
    } else {
        Vec::new()
    };
    let quality = assess(&trial, None, &[], &[], &QualityOptions::default());
    let sets: Vec<MarkerSet> = catalog::all("markersets")?;
    let mut warnings: Vec<String> = trial.warnings.iter().map(ToString::to_string).collect();
    warnings.extend(quality.reasons.iter().map(ToString::to_string));
    Ok(Inspection {
        version: 1,
        file: file.display().to_string(),
        frames: trial.markers.n_frames,
        rate_hz: trial.markers.rate_hz,
        duration_s: quality.duration_s,
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
        analogs,
        events: trial.events.clone(),
        residual_analysis: residuals(&trial),
        marker_sets: recognise(&trial, &sets),
        warnings,
    })
}

/// Winter's residual analysis over the coordinates of all markers.
fn residuals(trial: &aloft_trial::Trial) -> Option<ResidualAnalysis> {
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
    residual_analysis(&slices, rate, shape, &cutoffs).ok().filter(|a| a.residual_rms.iter().any(|r| r.is_finite()))
}

/// Cut-offs of the table, Hz.
const CUTOFFS_HZ: [f64; 16] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 25.0, 30.0];

/// Columns of the names and of the numbers in the table of cut-offs.
const NAMES: usize = 16;
const NUMBERS: usize = 7;

/// The inspection as text; the table of cut-offs takes no more than `width` columns.
pub fn to_text(i: &Inspection, width: usize) -> String {
    let mut lines = vec![format!("{}: {} frames at {} Hz ({:.2} s)", i.file, i.frames, i.rate_hz, i.duration_s)];
    let labels: Vec<String> = i.markers.iter().map(|m| m.label.clone()).collect();
    lines.push(format!("markers: {} ({})", labels.len(), abridged(&labels)));
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
        lines.push(format!("analog channels: {} ({})", i.analogs.len(), abridged(&i.analogs)));
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
    lines.extend(i.warnings.iter().map(|w| format!("warning: {w}")));
    lines.join("\n")
}
