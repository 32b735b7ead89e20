//! Inputs of an export, and the definition of a format.

use crate::coordinates::{Coordinates, expect_length};
use crate::dynamics::{self, TrialForces};
use crate::{Convention, CoordinateSeries, ExportError, names};
use aloft_body::{JointKind, LinkInertia, Motion, Phi, Subject};
use aloft_trial::Trial;
use nalgebra::Vector6;
use std::ops::Range;

/// One file of an export, in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct OutFile {
    /// Path below the export's folder, with `/` between folders.
    pub path: String,
    /// Content.
    pub bytes: Vec<u8>,
    /// One-line description for the README.
    pub what: String,
}

impl OutFile {
    /// A text file.
    pub fn text(path: String, text: String, what: impl Into<String>) -> Self {
        Self { path, bytes: text.into_bytes(), what: what.into() }
    }
}

/// Source of the inertias in the exported models.
#[derive(Debug, Clone, PartialEq)]
pub enum InertiaSource {
    /// Identified from flights.
    Identified {
        /// Kind of rows, `weak` or `paper`.
        rows: String,
        /// Remarks of the gate.
        remarks: Vec<String>,
        /// Values that motion did not determine, by link (`thigh_l: mass, inertia`); they come from
        /// the table.
        from_table: Vec<String>,
    },
    /// Taken from the prior.
    Prior {
        /// Reason why the prior is used.
        reason: String,
    },
}

/// The subject to be exported.
#[derive(Debug, Clone)]
pub struct SubjectExport {
    /// Name used in files.
    pub id: String,
    /// Names of subject and session in a study of several subjects, from which BIDS file names are
    /// built.
    pub of_study: [Option<String>; 2],
    /// Model, markers, facts.
    pub subject: Subject,
    /// Inertia of each link, as exported.
    pub links: Vec<LinkInertia>,
    /// Source of these inertias.
    pub source: InertiaSource,
    /// Coordinates of the model.
    pub coordinates: Coordinates,
    /// Indices of velocities fixed at the static posture in inverse kinematics.
    pub locked: Vec<usize>,
    /// Program and version, for headers.
    pub program: String,
}

impl SubjectExport {
    /// Combines a subject and its inertias.
    ///
    /// # Errors
    /// The number of inertias differs from that of links.
    pub fn new(
        subject: Subject,
        links: Vec<LinkInertia>,
        source: InertiaSource,
        convention: Convention,
        locked: Vec<usize>,
        program: &str,
    ) -> Result<Self, ExportError> {
        expect_length("inertias of the links", subject.model.n_links(), links.len())?;
        Ok(Self {
            id: names::id(&subject.facts.name),
            of_study: [None, None],
            coordinates: Coordinates::of(&subject.model, convention),
            subject,
            links,
            source,
            locked,
            program: program.to_owned(),
        })
    }

    /// The inertias as parameter vectors.
    pub fn phi(&self) -> Vec<Phi> {
        self.links.iter().map(LinkInertia::to_phi).collect()
    }

    /// True if inverse kinematics fixed this coordinate: all of its joint, or the two axes
    /// perpendicular to the last rotation (then the first two angles are constant, because a
    /// rotation about the last axis changes only the third angle).
    pub(crate) fn is_locked(&self, coordinate: usize) -> bool {
        let link = self.coordinates.list[coordinate].link;
        let (own, joint) = (&self.subject.model.links[link].joint, &self.coordinates.joints[link]);
        let held = |k: usize| self.locked.contains(&(own.v_offset + k));
        let n = own.kind.nv();
        if n > 0 && (0..n).all(held) {
            return true;
        }
        let (JointKind::Spherical, Some(sequence)) = (own.kind, joint.sequence) else { return false };
        let last = sequence.axes[2];
        coordinate < joint.first + 2 && (0..3).all(|axis| (axis == last) != held(axis))
    }
}

/// A plate's reaction on the subject at the frames of the motion, filtered like the motion: world force (N) and moment about the
/// world origin (N·m).
#[derive(Debug, Clone, PartialEq)]
pub struct PlateAtFrames {
    /// Name.
    pub name: String,
    /// One wrench per frame; NaN where missing.
    pub wrench: Vec<Vector6<f64>>,
}

/// The original file of the recording, for formats that add to it.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceFile {
    /// Name of the file.
    pub name: String,
    /// Its bytes, if it is C3D.
    pub c3d: Option<Vec<u8>>,
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

/// Writes the files of one recording.
pub type TrialWriter = fn(&SubjectExport, &TrialExport) -> Result<Vec<OutFile>, ExportError>;
/// Writes the files that occur once per export.
pub type SubjectWriter = fn(&SubjectExport) -> Result<Vec<OutFile>, ExportError>;

/// A format: its documentation and its functions.
#[derive(Debug)]
pub struct Format {
    /// Name typed by users.
    pub name: &'static str,
    /// Description, for help and README.
    pub title: &'static str,
    /// Programs that read it.
    pub readers: &'static str,
    /// Files of each recording.
    pub trial: Option<TrialWriter>,
    /// Files that occur once.
    pub subject: Option<SubjectWriter>,
}

impl Format {
    /// The formats with the names typed by users; all if no name is given.
    ///
    /// # Errors
    /// [`ExportError::UnknownFormat`] with the available names.
    pub fn choose(names: &[String]) -> Result<Vec<&'static Self>, ExportError> {
        let all = crate::FORMATS;
        if names.is_empty() {
            return Ok(all.to_vec());
        }
        for name in names {
            if !all.iter().any(|f| f.name.eq_ignore_ascii_case(name)) {
                return Err(ExportError::UnknownFormat {
                    found: name.clone(),
                    known: all.iter().map(|f| f.name).collect::<Vec<_>>().join(", "),
                });
            }
        }
        Ok(all.iter().filter(|f| names.iter().any(|n| f.name.eq_ignore_ascii_case(n))).copied().collect())
    }
}
