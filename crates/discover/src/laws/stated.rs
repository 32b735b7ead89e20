//! Whether laws are stated: what they have to do better than.

use super::atlas::Line;
use super::fit::Fitted;
use super::kinematics::Carrier;

/// Laws are the answer if they leave no more than this multiple of the floor.
pub(super) const ANSWERED: f64 = 1.5;
/// Laws that leave more than this share of the error are not named.
const PART: f64 = 0.5;

/// A law as accepted in its round.
#[derive(Clone)]
pub(super) struct Step {
    pub fitted: Fitted,
    /// Error with it over that without (root mean square).
    pub ratio: f64,
    /// Family-wise p-value of its entry.
    pub p: f64,
    /// Other carriers that the rows do not exclude.
    pub also: Vec<Carrier>,
    /// True if it was fitted to flights and contact.
    pub of_both: bool,
}

/// What laws have to do better than.
pub(crate) struct Rivals {
    /// Share of the error in flight that laws have to stay below.
    pub most: f64,
    /// Lines towards points of the room along which effects found act: their strength may depend on
    /// something in another way than the effect says.
    pub lines: Vec<Line>,
}

/// What is said of laws that were found.
pub(super) struct Stated {
    /// True if they are stated.
    pub named: bool,
    /// True if they are the whole answer: what they leave is within the floor.
    pub complete: bool,
}

/// Whether laws that leave the share `ratio` of the error in flight are stated beside the
/// catalogue. `within_floor`: that is within the floor.
pub(super) fn stated(laws: &[Step], ratio: f64, within_floor: bool, catalogue: &Rivals) -> Stated {
    let better = !laws.is_empty() && ratio < catalogue.most;
    Stated { named: better && (within_floor || ratio < PART), complete: better && within_floor }
}
