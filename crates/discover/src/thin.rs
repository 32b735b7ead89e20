//! Fewer clusters of a large session, for computations whose time grows faster than their number.

use crate::problem::Problem;
use crate::session::Session;

/// Fewest clusters (flights or recordings) of the atlas and of the fit of laws.
pub(crate) const FEWEST: usize = 20;

/// Every `step`-th cluster of each of the lists `parts` (indices of clusters): the session and the
/// problem with those, and their indices in order. `None` for a step below two, or if the remaining
/// clusters do not determine the parameters.
pub(crate) fn thin<'a>(
    session: &Session<'a>,
    problem: &Problem,
    step: usize,
    parts: &[Vec<usize>],
) -> Option<(Session<'a>, Problem, Vec<usize>)> {
    if step < 2 {
        return None;
    }
    let mut kept: Vec<usize> = parts.iter().flat_map(|part| part.iter().copied().step_by(step)).collect();
    kept.sort_unstable();
    // none: fewer clusters need not determine the parameters; then all of them are used
    let problem = problem.with_clusters(&kept).ok()?;
    let mut rows = vec![false; session.blocks.len()];
    for &block in problem.clusters.iter().flat_map(|c| &c.blocks) {
        rows[block] = true;
    }
    Some((session.with_rows_of(&rows), problem, kept))
}

/// Clusters of a problem such that they have about `most` flights or contact stretches, but are not
/// fewer than `fewest`.
pub(crate) fn with_at_most<'a>(
    session: &Session<'a>,
    problem: &Problem,
    most: usize,
    fewest: usize,
) -> Option<(Session<'a>, Problem, Vec<usize>)> {
    let stretches: usize = problem.clusters.iter().map(|c| c.blocks.len()).sum();
    let step = stretches.div_ceil(most).min(problem.clusters.len() / fewest);
    thin(session, problem, step, &[(0..problem.clusters.len()).collect()])
}
