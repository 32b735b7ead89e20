//! Whether contact takes part in the identification of a choice of effects, and with which weight.
//!
//! A model takes contact where one of its effects needs it
//! ([`SubjectSession::identifies_from_contact`]). The present model's rows are rotated with its own
//! weight of contact. For a choice of effects that uses contact where the present model does not,
//! the weight is estimated as `identify` estimates it; one that uses flights alone leaves contact
//! out.

use crate::switches::{Switches, stop};
use aloft_regressor::Factor;
use aloft_study::revision::ModelEffect;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};
use std::sync::PoisonError;

/// True if a model of these effects is identified from contact, too.
pub(crate) fn uses_contact(session: &SubjectSession, effects: Vec<ModelEffect>) -> bool {
    SubjectSession { effects, ..session.clone() }.identifies_from_contact()
}

impl Switches {
    /// Weight of contact in the present model; none if it uses flights alone.
    pub(crate) fn present_weight(&self) -> Option<f64> {
        self.predicting.contact_weight().filter(|_| self.contact)
    }

    /// True if a model of these effects uses contact where the present model does not, or the other
    /// way round.
    ///
    /// # Errors
    /// A key without a switch.
    pub fn changes_contact(&self, keys: &[String]) -> Result<bool, PipelineError> {
        Ok(uses_contact(self.session(), self.chosen(keys)?) != self.contact)
    }

    /// Weight of contact for these effects, whose columns are `names`; none if flights alone
    /// identify.
    ///
    /// # Errors
    /// A key without a switch; rows that do not determine the parameters.
    pub(crate) fn weight(&self, keys: &[String], names: &[&str]) -> Result<Option<f64>, PipelineError> {
        if !self.changes_contact(keys)? {
            return Ok(self.present_weight());
        }
        if self.contact {
            return Ok(None);
        }
        let mut held = self.weights.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(weight) = held.get(keys) {
            return Ok(*weight);
        }
        let failed = |f: StageFailure| PipelineError::Request { problem: f.problem, hint: f.hint };
        let own: Result<Vec<Factor>, StageFailure> =
            self.training.iter().map(|f| f.with_effects(names).map_err(stop)).collect();
        let weight = own.and_then(|own| self.predicting.weight_of_contact(&self.subject, &own)).map_err(failed)?;
        held.insert(keys.to_vec(), weight);
        Ok(weight)
    }
}
