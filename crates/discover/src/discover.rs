//! The question of a discovery.

use crate::DiscoverError;
use crate::evidence::by_evidence;
use crate::options::DiscoverOptions;
use crate::result::Discovery;
use crate::session::Session;
use aloft_effects::{Effect, EffectInstance};

/// All effects of the catalogue.
pub fn catalogue() -> Vec<&'static dyn Effect> {
    aloft_effects::EFFECTS.to_vec()
}

/// Searches for missing effects by one marginal likelihood over flights and contact: judges
/// `effects` against the model that already holds `accepted`, adds the likeliest, and asks again
/// until none has the odds to be named. What the catalogue leaves unexplained is searched for laws.
///
/// # Errors
/// [`DiscoverError::TooFew`] with fewer than two flights, or without draws of the recordings'
/// errors ([`Session::with_draws`]), [`DiscoverError::Numeric`] when the rows do not determine the
/// parameters.
pub fn discover(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Discovery, DiscoverError> {
    by_evidence(session, effects, accepted, options)
}
