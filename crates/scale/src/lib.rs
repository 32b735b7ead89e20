//! Scaling: from a static trial to a model of the individual body.
//!
//! Second stage of the pipeline, between `trial` and `ik`: a static trial, a marker set and
//! anthropometric tables give a [`Subject`](aloft_body::Subject): joint positions, marker
//! coordinates in link frames, prior inertias, and the posture in which the static was recorded.
//!
//! * People: [`scale_person`] — [`statics`] (quiet frames) → [`landmarks`] → joint centres ([`hip`]
//!   and `skeleton`) → [`prior`] from [`anthropometry`] → [`report`] with a closed list of
//!   warnings. [`observe`] lists the coordinates that no marker determines. A calibration over
//!   dynamic trials starts from [`JointUncertainty`] and recomputes the prior with
//!   [`attach_prior`].
//! * Objects: [`scale_object`] — a hinge is located by the motion of the object, not by a marker:
//!   [`functional`] calibration (SCoRE, SARA) for a first guess, then all marker coordinates,
//!   joints and poses of thousands of frames in one least-squares problem.
//!
//! Link axes follow the ISB (x forward, y up, z right, origin at the proximal joint); the world is
//! Z up; lengths are metres.

pub mod anthropometry;
mod bundle;
mod error;
pub mod functional;
mod geometry;
pub mod hip;
pub mod landmarks;
mod object;
mod object_spec;
pub mod observe;
mod person;
mod plausibility;
pub mod prior;
pub mod report;
mod skeleton;
pub mod statics;

pub use anthropometry::Anthropometry;
pub use error::ScaleError;
pub use functional::{FunctionalAxis, FunctionalCentre, sara, score};
pub use hip::HipMethod;
pub use object::{ObjectInput, ObjectJointReport, ObjectOptions, ObjectReport, ScaledObject, scale_object};
pub use object_spec::{HalfPlane, ObjectFrame, ObjectJoint, ObjectLink, ObjectSpec};
pub use person::{PersonInput, ScaleOptions, Scaled, check_span, scale_person};
pub use prior::{CarriedSegment, StaticAnatomy, attach_prior, prior_spread};
pub use report::{JointMethod, JointUncertainty, PlausibilityLimits, ScaleReport, ScaleWarning};
