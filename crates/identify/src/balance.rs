//! Weights contact rows relative to flight rows.
//!
//! Contact rows contain errors that flights do not have: impacts, plate errors, soft tissue that
//! oscillates after a landing. In one least-squares problem with equal weights they would dominate
//! the flights by their number and their error. Each kind is therefore weighted by its own held-out
//! error: every stretch is predicted from all others, the root mean square of its rows is computed
//! separately for flights and contact, contact rows are multiplied by the ratio of the two, and
//! this is repeated until the ratio converges. Only this ratio is estimated from residuals, and
//! only for identification; stored factors keep their fixed weights.

use crate::clusters::Clusters;
use crate::system::System;
use crate::{IdentifyError, Prior};
use aloft_regressor::{Factor, StretchKind};
use serde::{Deserialize, Serialize};

/// Held-out errors of both kinds, and the resulting weight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KindBalance {
    /// Root mean square of the rows of a flight predicted from all other stretches.
    pub flight_rms: f64,
    /// The same for contact stretches, in their fixed weights.
    pub contact_rms: f64,
    /// Factor of contact rows: `flight_rms / contact_rms`, at most 1.
    pub contact_weight: f64,
    /// Numbers of flight and contact stretches.
    pub stretches: [usize; 2],
}

/// Largest number of iterations.
const ROUNDS: usize = 8;
/// Fewest stretches of a kind needed to estimate its error.
const FEWEST: usize = 2;

/// Contact factors multiplied by the weight that follows from their held-out error. They are
/// unchanged, and nothing is reported, if a kind has fewer than two stretches.
///
/// # Errors
/// As [`crate::identify`].
pub fn balanced(
    factors: &[Factor],
    mass_kg: f64,
    prior: Option<&Prior>,
) -> Result<(Vec<Factor>, Option<KindBalance>), IdentifyError> {
    let is_contact = |f: &Factor| f.kind == StretchKind::Contact;
    let contacts = factors.iter().filter(|f| is_contact(f)).count();
    let stretches = [factors.len() - contacts, contacts];
    if stretches.iter().any(|n| *n < FEWEST) {
        return Ok((factors.to_vec(), None));
    }
    let scaled = |weight: f64| -> Vec<Factor> {
        factors.iter().map(|f| if is_contact(f) { f.scaled(weight) } else { f.clone() }).collect()
    };
    let mut balance = KindBalance { flight_rms: f64::NAN, contact_rms: f64::NAN, contact_weight: 1.0, stretches };
    for _ in 0..ROUNDS {
        let now = scaled(balance.contact_weight);
        let merged = Factor::merge(&now)?;
        let system = System::new(&merged, mass_kg, prior)?;
        let weight = if prior.is_some() { system.row_variance() } else { 0.0 };
        let x = system.solve(weight).x;
        let held_out = Clusters::new(&now, &merged, mass_kg, prior, weight, &x)?.held_out();
        let rms = |contact: bool| {
            let (squares, rows) = now
                .iter()
                .zip(&held_out)
                .filter(|(f, _)| is_contact(f) == contact)
                .fold((0.0, 0), |sum, (_, h)| (sum.0 + h.0, sum.1 + h.1));
            (squares / rows.max(1) as f64).sqrt()
        };
        balance.flight_rms = rms(false);
        balance.contact_rms = rms(true) / balance.contact_weight;
        let next = (balance.flight_rms / balance.contact_rms).min(1.0);
        if !(next.is_finite() && next > 0.0) {
            return Err(IdentifyError::Numeric("held-out errors of flights and contact are not finite".to_owned()));
        }
        let settled = (next / balance.contact_weight).ln().abs() < 0.01;
        balance.contact_weight = next;
        if settled {
            break;
        }
    }
    Ok((scaled(balance.contact_weight), Some(balance)))
}
