//! Every number of the evidence that is chosen by hand, with its unit, its source and its reason.

/// Degrees of freedom with which the size of the errors is known: eight antithetic draws of four
/// kinds of rows that share their size. The variance of the rows is at least that of the draws,
/// and up to 2.1 times as large in 95 % of all sessions.
pub(super) const NOISE_FREEDOM: f64 = 20.0;

/// Prior probability that nothing is missing; all explanations share the rest evenly.
pub(super) const NOTHING: f64 = 0.5;

/// Odds from which an explanation stands against "nothing missing".
pub(super) const ODDS: f64 = 20.0;

/// Probability that the named explanations hold together.
pub(super) const HELD: f64 = 0.95;

/// Share of the sum of squares that effects take away, up to which what they leave is their own
/// idealisation (area times a constant coefficient, a massless cord): 5 % of the force. A smaller
/// dependence on a variable does not refute an effect.
pub(super) const IDEALISED: f64 = 0.0025;

/// The same, up to which what they leave is no further effect: 10 % of the force, as drag
/// coefficients of bodies vary with speed and posture (Hoerner 1965, ch. 3). With 0.0025 two people
/// of 24 got a force of 6 and 7 % beside a true wind; ten other development sets keep their answers
/// from 0 to 0.03.
pub(super) const FURTHER: f64 = 0.01;

/// Highest order of the autoregression of the rows' errors over windows; the order itself has the
/// least Akaike information. A window overlaps with three on either side; 3 and 16 give the same
/// answers.
pub(super) const MOST_LINKED: usize = 8;

/// Share of the variance of a stretch that is that of all stretches of its kind: eight draws know
/// their own variance to a third, stretches differ by as much. With 0 people's noise comes out too
/// small (of eight development sets one gets an effect too many, and another is left with 1.4 times
/// the noise), with 1 one pair of effects is lost; a share by how much stretches differ is as wrong
/// as 0.
pub(super) const POOLED: f64 = 0.5;

/// Natural-log units behind the best from which on an explanation is not fitted to the end: it
/// would hold less than e⁻¹⁰ of the probability.
pub(super) const FAR_BEHIND: f64 = 10.0;

/// Share of the best one's gain that an explanation [`FAR_BEHIND`] must have to be fitted further.
/// Saves time alone.
pub(super) const SHARE: f64 = 0.5;

/// Steps of a fit to the end.
pub(super) const TO_THE_END: usize = 20;

/// Stages of the fits: Gauss-Newton steps, and the share of the best gain that an explanation must
/// have to take them unless it is not [`FAR_BEHIND`]. They save time alone: what is far behind
/// after five steps is not the likeliest after twenty.
pub(super) const STEPS: [(usize, f64); 3] = [(1, SHARE), (4, SHARE), (TO_THE_END, 0.9)];

/// Turns of the joint fit of several effects, each beside the others.
pub(super) const TURNS: usize = 5;
