//! Whether an effect that acts in some trials also acts in those that flights say nothing of.
//!
//! The trials in which a load was carried are told from flights. A trial without a flight, such as
//! an exercise that is held out, may be one of them or not; a model that leaves the load out there
//! predicts it as wrongly as one that invents it. Each such trial is predicted both ways from the
//! trials with flights, with the size that the flights show, and the effect acts there if that
//! leaves less error. What the laboratory says of a trial stands.

use crate::problem::Problem;
use crate::rank::EffectScore;
use crate::session::Session;
use nalgebra::{DMatrix, DVector};

/// Adds to the trials of an effect's variants those without rows in `flights` whose contact shows
/// that it acts there, too; `contact` holds all rows.
pub(crate) fn tell_other_trials(
    session: &Session<'_>,
    flights: &Problem,
    contact: &Problem,
    score: &mut EffectScore<'_>,
) {
    let mut told: Vec<(Vec<bool>, Vec<bool>)> = Vec::new();
    let mut order: Vec<usize> = (0..score.scored.len()).filter(|&i| score.scored[i].gain > 0.0).collect();
    order.sort_by(|&a, &b| score.scored[b].gain.total_cmp(&score.scored[a].gain));
    // the variant that explains most decides for all with the same trials
    for i in order {
        let scored = &score.scored[i];
        let group = &scored.variant.group;
        if group.is_empty() || told.iter().any(|(from, _)| from == group) {
            continue;
        }
        let everywhere = scored.variant.columns_everywhere(session, contact);
        let acting = everywhere.and_then(|c| acting(session, flights, contact, group, &c, &scored.theta));
        told.push((group.clone(), acting.unwrap_or_else(|| group.clone())));
    }
    for scored in &mut score.scored {
        let group = &mut scored.variant.group;
        if let Some((_, acting)) = told.iter().find(|(from, _)| from == group) {
            group.clone_from(acting);
        }
    }
}

/// The trials in which an effect acts, those without flights among them; `columns` are those of the
/// effect acting in every trial, by cluster of `contact`. `None` if there is nothing to tell.
fn acting(
    session: &Session<'_>,
    flights: &Problem,
    contact: &Problem,
    group: &[bool],
    columns: &[DMatrix<f64>],
    theta: &DVector<f64>,
) -> Option<Vec<bool>> {
    let known = |trial: usize| flights.clusters.iter().any(|c| c.trial == trial);
    let (with, others): (Vec<usize>, Vec<usize>) =
        (0..contact.clusters.len()).partition(|&g| known(contact.clusters[g].trial));
    let open: Vec<usize> =
        others.into_iter().filter(|&g| session.groups[contact.clusters[g].trial].is_none()).collect();
    if open.is_empty() || with.is_empty() {
        return None;
    }
    let from = session.or_named(contact.with_clusters(&with))?;
    let masked: Vec<DMatrix<f64>> =
        with.iter().map(|&g| &columns[g] * f64::from(u8::from(group[contact.clusters[g].trial]))).collect();
    let (ac, _, _) = from.products(&masked, None);
    let parameters = from.cholesky.solve(&(&from.right - ac * theta));
    let mut out = group.to_vec();
    let mut trials: Vec<usize> = open.iter().map(|&g| contact.clusters[g].trial).collect();
    trials.dedup();
    for trial in trials {
        let mut errors = [0.0; 2];
        for &g in open.iter().filter(|&&g| contact.clusters[g].trial == trial) {
            let cluster = &contact.clusters[g];
            let left = &cluster.b - &cluster.a * &parameters;
            let beside = &left - &columns[g] * theta;
            for &row in &cluster.judged {
                errors[0] += left[row].powi(2);
                errors[1] += beside[row].powi(2);
            }
        }
        out[trial] = errors[1] < errors[0];
    }
    Some(out)
}
