//! TRC: marker trajectories for OpenSim, Y up, mm. Missing markers are empty cells.

use crate::frame::to_ground;
use crate::number::fixed;
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport, names};

/// The format.
pub static FORMAT: Format = Format {
    name: "trc",
    title: "cleaned markers, Y up, mm",
    readers: "OpenSim, AddBiomechanics, OpenCap tools",
    trial: Some(write),
    subject: None,
};

/// Path of a trial's file.
pub(crate) fn path(trial: &TrialExport) -> String {
    format!("MarkerData/{}.trc", trial.stem())
}

fn write(_: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    let markers = &trial.trial.markers;
    let (n, rate) = (markers.labels.len(), fixed(trial.rate_hz(), 6));
    let frames = markers.n_frames;
    let mut text = format!("PathFileType\t4\t(X/Y/Z)\t{}.trc\n", trial.stem());
    text.push_str(
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n",
    );
    text.push_str(&format!("{rate}\t{rate}\t{frames}\t{n}\tmm\t{rate}\t{}\t{frames}\n", markers.first_frame));
    text.push_str("Frame#\tTime");
    for label in &markers.labels {
        text.push_str(&format!("\t{}\t\t", names::label(label)));
    }
    text.push_str("\n\t");
    for k in 1..=n {
        text.push_str(&format!("\tX{k}\tY{k}\tZ{k}"));
    }
    text.push_str("\n\n");
    for f in 0..frames {
        text.push_str(&format!("{}\t{}", f + 1, fixed(trial.time_s(f), 8)));
        for marker in 0..n {
            match markers.position(marker, f) {
                Some(p) => {
                    for value in to_ground(&p).iter() {
                        text.push('\t');
                        text.push_str(&fixed(value * 1e3, 5));
                    }
                }
                None => text.push_str("\t\t\t"),
            }
        }
        text.push('\n');
    }
    let what = format!("{n} cleaned markers of {} over {frames} frames", trial.name);
    Ok(vec![OutFile::text(path(trial), text, what)])
}
