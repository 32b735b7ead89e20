//! What an export is made from, and what a format is.

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
    /// Place below the export's folder, with `/` between folders.
    pub path: String,
    /// Content.
    pub bytes: Vec<u8>,
    /// What it is, for the README: one line.
    pub what: String,
}

impl OutFile {
    /// A file of text.
    pub fn text(path: String, text: String, what: impl Into<String>) -> Self {
        Self { path, bytes: text.into_bytes(), what: what.into() }
    }
}

/// Where the inertias of the exported models come from.
#[derive(Debug, Clone, PartialEq)]
pub enum InertiaSource {
    /// Identified from flights.
    Identified {
        /// Rows, `weak` or `paper`.
        rows: String,
        /// What to keep in mind (the gate's remarks).
        remarks: Vec<String>,
    },
    /// The prior, because of this.
    Prior {
        /// Why nothing better is written.
        reason: String,
    },
}

/// The subject as it is exported.
#[derive(Debug, Clone)]
pub struct SubjectExport {
    /// Name in files.
    pub id: String,
    /// Subject and session of a study of several, as the study calls them: BIDS names files after them.
    pub of_study: [Option<String>; 2],
    /// Model, markers, facts.
    pub subject: Subject,
    /// Inertia of each link, as exported.
    pub links: Vec<LinkInertia>,
    /// Where these come from.
    pub source: InertiaSource,
    /// Coordinates of the model.
    pub coordinates: Coordinates,
    /// Velocity indices that inverse kinematics held at the static posture.
    pub locked: Vec<usize>,
    /// Program and version, for headers.
    pub program: String,
}

impl SubjectExport {
    /// Binds a subject and its inertias.
    ///
    /// # Errors
    /// Another number of inertias than links.
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

    /// True when inverse kinematics held what this coordinate describes: all of its joint, or the two axes across the last turn (whose first
    /// two angles then stay, because a turn about the last axis changes the third angle alone).
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
    /// One wrench a frame; NaN where missing.
    pub wrench: Vec<Vector6<f64>>,
}

/// The recording's own file, for formats that add to it.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceFile {
    /// Name of the file.
    pub name: String,
    /// Its bytes, where it is C3D.
    pub c3d: Option<Vec<u8>>,
}

/// One recording as it is exported.
#[derive(Debug, Clone)]
pub struct TrialExport {
    /// Name, also in files.
    pub name: String,
    /// Its part: `static`, `calibration`, `identify`, `validate`.
    pub role: String,
    /// Cleaned markers, tared plates, events; Z-up world, SI.
    pub trial: Trial,
    /// Motion as inverse kinematics solved it; none for trials that were not solved.
    pub motion: Option<Motion>,
    /// Filtered motion with velocities and accelerations.
    pub filtered: Option<Motion>,
    /// Frames in the air.
    pub flights: Vec<Range<usize>>,
    /// Plates at the frames of the motion.
    pub plates: Vec<PlateAtFrames>,
    /// The recording's own file.
    pub source: SourceFile,
    /// Coordinates of `motion`.
    pub solved: Option<CoordinateSeries>,
    /// Coordinates of `filtered`.
    pub smooth: Option<CoordinateSeries>,
    /// Loads, generalised forces and residuals of `filtered`.
    pub forces: Option<TrialForces>,
}

impl TrialExport {
    /// Name in files: that of no other recording.
    pub fn stem(&self) -> String {
        names::file(&self.name)
    }

    /// Sampling rate of markers and motion, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.trial.markers.rate_hz
    }

    /// Frames.
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
    /// A motion of another model, or with another number of frames than the markers.
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

/// A writer of one recording's files.
pub type TrialWriter = fn(&SubjectExport, &TrialExport) -> Result<Vec<OutFile>, ExportError>;
/// A writer of files that an export has once.
pub type SubjectWriter = fn(&SubjectExport) -> Result<Vec<OutFile>, ExportError>;

/// A format: its documentation and its functions.
#[derive(Debug)]
pub struct Format {
    /// Name that users type.
    pub name: &'static str,
    /// What it is, for help and README.
    pub title: &'static str,
    /// Who opens it.
    pub readers: &'static str,
    /// Files of each recording.
    pub trial: Option<TrialWriter>,
    /// Files that there are once.
    pub subject: Option<SubjectWriter>,
}

impl Format {
    /// The formats of names that users typed; all where there are none.
    ///
    /// # Errors
    /// [`ExportError::UnknownFormat`] with the names that exist.
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
