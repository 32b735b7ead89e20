//! Planning of the next flights: joint trajectories that show what the recorded flights show badly.
//!
//! The joints follow splines that begin and end at rest in one posture ([`Wave`]), so that a robot
//! can hold that posture until it is let go. The base's motion follows from conserved momentum
//! ([`fly`]). Splines and the turn at release are chosen so that the information of the flight's
//! rows, added to that of the recordings, leaves the smallest share of the prior's variance
//! ([`aloft_identify::Design`]), within the limits of the joints ([`JointLimits`]) and without
//! links that come closer than in the recordings ([`Extents`]). [`Rehearsal`] simulates the logs of
//! such flights.

mod extent;
mod fly;
mod limits;
mod plan;
mod rehearse;
mod search;
mod wave;

pub use extent::Extents;
pub use fly::{Release, fly};
pub use limits::{JointLimits, Seen};
pub use plan::{Expected, NextFlights, PlanInput, PlannedFlight, plan};
pub use rehearse::Rehearsal;
pub use search::{FrameErrors, PlanOptions};
pub use wave::Wave;
