//! An answer with the results that it was computed from.

use crate::held_out::HeldOutError;
use aloft_pipeline::graph::results_hash;
use aloft_pipeline::stages::below_weak_rows;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::from_value;
use aloft_workspace::workspace::Workspace;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// An answer stored in the workspace, with a hash of the results that it was computed from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "serde_json::Value", bound(deserialize = "T: DeserializeOwned"))]
pub struct Kept<T> {
    /// Hash of the results that the answer was computed from ([`looked_at`]).
    pub made_from: String,
    /// Held-out errors with all effects found added to the model, in flight and in contact, as the
    /// stages compute them; empty if none was found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors_after: Vec<HeldOutError>,
    /// Hash of everything that the answer rests on; none where the same question has to be answered
    /// anew.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub question: Option<String>,
    /// The answer.
    #[serde(flatten)]
    pub answer: T,
}

/// A stored answer is read in two steps, its own part and the answer: in one step, a number of the
/// answer that is not defined could not be read.
impl<T: DeserializeOwned> TryFrom<serde_json::Value> for Kept<T> {
    type Error = serde_json::Error;

    fn try_from(stored: serde_json::Value) -> Result<Self, serde_json::Error> {
        #[derive(Deserialize)]
        struct Own {
            made_from: String,
            #[serde(default)]
            errors_after: Vec<HeldOutError>,
            #[serde(default)]
            question: Option<String>,
        }
        let Own { made_from, errors_after, question } = from_value(stored.clone())?;
        Ok(Self { made_from, errors_after, question, answer: from_value(stored)? })
    }
}

/// Hash of the results that a ranking reads: those from which the weak rows of every trial are
/// made. The effects of the model are not part of it.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn looked_at(session: &SubjectSession) -> Result<String, PipelineError> {
    let read = session.included().filter(|t| t.role.is_dynamic()).flat_map(|t| below_weak_rows(t, session));
    Ok(results_hash(&Workspace::open(&session.workspace), read)?.to_hex().to_string())
}
