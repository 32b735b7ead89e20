//! A recording to be exported.

use crate::coordinates::{CoordinateSeries, expect_length};
use crate::dynamics::{self, TrialForces};
use crate::loads::PlateAtFrames;
use crate::subject::SubjectExport;
use crate::{ExportError, names};
use aloft_body::Motion;
use aloft_trial::Trial;
use std::ops::Range;

/// The original file of the recording, for formats that add to it.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceFile {
    /// Name of the file.
    pub name: String,
    /// Its bytes, if it is C3D.
    pub c3d: Option<Vec<u8>>,
}

/// Values of an imported model's own coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct FileCoordinates {
    /// Names in the file.
    pub names: Vec<String>,
    /// True for values that OpenSim's tables hold in degrees.
    pub is_angle: Vec<bool>,
    /// Frames × coordinates, rad and m; NaN where unsolved.
    pub values: Vec<f64>,
}

/// One recording to be exported.
#[derive(Debug, Clone)]
pub struct TrialExport {
    /// Name, also used in files.
    pub name: String,
    /// Role: `static`, `calibration`, `identify`, `validate`.
    pub role: String,
    /// Cleaned markers, tared plates, events; Z-up world, SI.
    pub trial: Trial,
    /// Motion as inverse kinematics solved it; none for trials that were not solved.
    pub motion: Option<Motion>,
    /// Filtered motion with velocities and accelerations.
    pub filtered: Option<Motion>,
    /// Ranges of frames in flight.
    pub flights: Vec<Range<usize>>,
    /// Plates at the frames of the motion.
    pub plates: Vec<PlateAtFrames>,
    /// The original file of the recording.
    pub source: SourceFile,
    /// The motion in the coordinates of an imported OpenSim model.
    pub file_coordinates: Option<FileCoordinates>,
    /// Coordinates of `motion`.
    pub solved: Option<CoordinateSeries>,
    /// Coordinates of `filtered`.
    pub smooth: Option<CoordinateSeries>,
    /// Loads, generalised forces and residuals of `filtered`.
    pub forces: Option<TrialForces>,
}

impl TrialExport {
    /// Unique name of the recording in file names.
    pub fn stem(&self) -> String {
        names::file(&self.name)
    }

    /// Sampling rate of markers and motion, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.trial.markers.rate_hz
    }

    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.trial.markers.n_frames
    }

    /// Time of a frame since the first one of the recording, s.
    pub fn time_s(&self, frame: usize) -> f64 {
        frame as f64 / self.rate_hz()
    }

    /// Computes coordinates and forces from the motions.
    ///
    /// # Errors
    /// A motion of another model, or with a different number of frames from the markers.
    pub fn prepare(&mut self, subject: &SubjectExport) -> Result<(), ExportError> {
        let model = &subject.subject.model;
        for motion in self.motion.iter().chain(&self.filtered) {
            expect_length(&format!("{}: frames of the motion", self.name), self.n_frames(), motion.n_frames())?;
        }
        for plate in &self.plates {
            expect_length(&format!("{}: frames of {}", self.name, plate.name), self.n_frames(), plate.wrench.len())?;
        }
        self.solved = self.motion.as_ref().map(|m| subject.coordinates.series(model, m)).transpose()?;
        self.smooth = self.filtered.as_ref().map(|m| subject.coordinates.series(model, m)).transpose()?;
        self.forces = match (&self.filtered, &self.smooth) {
            (Some(motion), Some(series)) if !motion.a.is_empty() => {
                Some(dynamics::forces(subject, motion, series, &self.plates))
            }
            _ => None,
        };
        Ok(())
    }
}
