//! Effects that could not be tried because their law gives no numbers on these recordings.

use crate::candidate::is_usable;
use crate::problem::Domain;
use crate::result::NotTried;
use crate::session::{Session, Word};
use aloft_effects::Effect;

/// Largest number of combinations of target and starting values that are checked.
const LOOKED_AT: usize = 60;

/// Where the law of an effect gives no numbers; none if it does everywhere, or if it has no columns
/// here.
pub(crate) fn not_tried(session: &Session<'_>, effect: &dyn Effect, domain: Domain) -> Option<NotTried> {
    let (mut made, mut wrong) = (0, 0);
    let mut first: Option<String> = None;
    let targets = effect.targets(session.scene);
    let all = targets.iter().flat_map(|t| effect.starts(session.scene, *t).into_iter().map(move |s| (*t, s)));
    for (target, start) in all.take(LOOKED_AT) {
        let Some(columns) = session.columns(effect, target, &start, domain) else { continue };
        made += 1;
        let at: Vec<usize> = (0..columns.len()).filter(|&i| !columns[i].iter().all(|x| is_usable(*x))).collect();
        let Some(&block) = at.first() else { continue };
        wrong += 1;
        if first.is_none() {
            let block = &session.blocks[block];
            let values = effect.nonlinear(session.scene, target);
            let values: Vec<String> =
                values.iter().zip(&start).map(|(p, x)| format!("{} = {x} {}", p.name, p.unit)).collect();
            let with = if values.is_empty() { String::new() } else { format!(" with {}", values.join(", ")) };
            first = Some(format!(
                "its law gives NaN or infinity in {} of {} stretches{with}, the first a {} of `{}`",
                at.len(),
                columns.len(),
                block.kind.word(),
                session.trials[block.trial]
            ));
        }
    }
    first.map(|because| NotTried { effect: effect.id().to_owned(), because, in_part: wrong < made })
}

impl Session<'_> {
    /// Why a choice cannot be added to a model: its law gives no numbers somewhere. None where it
    /// gives numbers everywhere.
    pub fn without_numbers(&self, choice: &aloft_effects::EffectInstance<'_>) -> Option<String> {
        let columns = self.columns_of(choice, Domain::Contact)?;
        let wrong = |i: &usize| !columns[*i].iter().all(|x| is_usable(*x));
        let at: Vec<usize> = (0..columns.len()).filter(wrong).collect();
        let block = &self.blocks[*at.first()?];
        Some(format!(
            "its law gives NaN or infinity in {} of {} stretches, the first a {} of `{}`",
            at.len(),
            columns.len(),
            block.kind.word(),
            self.trials[block.trial]
        ))
    }
}
