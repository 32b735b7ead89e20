//! Missing laws of a robot's joints, from what held-out flights leave in their torques.
//!
//! The rules of evidence are those of the rows of the body: a law is refitted beside body and joint
//! without each flight (or recording) in turn and judged on it; the best of all laws and joints has
//! to beat the same search on residuals with flipped signs; laws that the flights cannot tell apart
//! are named together; an error that remains far above its floor is unexplained.

mod fit;
mod result;
mod search;
mod wording;

pub use result::{JointCandidate, JointDiscovery, JointFinding};
pub use search::{JointInput, JointSearch, discover_joints};
