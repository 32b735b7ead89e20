//! The subject to be exported: model, coordinates and inertias.

use crate::coordinates::{Convention, Coordinates, expect_length};
use crate::{ExportError, names};
use aloft_body::{JointKind, LinkInertia, Phi, Subject};
use aloft_robot::RobotModel;
use aloft_robot::osim::{OsimModel, RigidTree};

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
        /// What the intervals hold and what they do not.
        intervals: String,
    },
    /// Taken from the prior.
    Prior {
        /// Reason why the prior is used.
        reason: String,
    },
}

/// How well the inertia of a link is known.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LinkKnown {
    /// Half-width of the 95 % interval of its mass, kg.
    pub mass_kg: Option<f64>,
    /// The same of its centre of mass in the link frame, m.
    pub com_m: [Option<f64>; 3],
    /// Where its values come from: `motion`, `from tables`, or which of them are from tables.
    pub from: String,
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
    /// How well each of them is known, in the same order; empty for inertias from tables.
    pub known: Vec<LinkKnown>,
    /// Source of these inertias.
    pub source: InertiaSource,
    /// Coordinates of the model.
    pub coordinates: Coordinates,
    /// Indices of velocities fixed at the static posture in inverse kinematics.
    pub locked: Vec<usize>,
    /// Program and version, for headers.
    pub program: String,
    /// Model files of a robot, which are patched instead of written anew; empty for people and
    /// objects.
    pub robot_files: Vec<RobotFile>,
    /// The OpenSim model that was imported, which is patched instead of written anew.
    pub osim_file: Option<OsimFile>,
}

/// An imported OpenSim model.
#[derive(Debug, Clone)]
pub struct OsimFile {
    /// File name.
    pub name: String,
    /// Its text.
    pub text: String,
    /// The model read from it.
    pub model: OsimModel,
    /// The tree of its links, those of the exported subject.
    pub tree: RigidTree,
    /// Mass of the body over that of the file's bodies.
    pub scale: f64,
    /// Comment for the patched file: how its inertias were made.
    pub provenance: String,
}

/// A robot's model file.
#[derive(Debug, Clone)]
pub struct RobotFile {
    /// File name.
    pub name: String,
    /// Its text.
    pub text: String,
    /// The model read from it.
    pub model: RobotModel,
    /// Comment for the patched file: how its inertials were made.
    pub provenance: String,
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
            known: Vec::new(),
            source,
            locked,
            program: program.to_owned(),
            robot_files: Vec::new(),
            osim_file: None,
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
