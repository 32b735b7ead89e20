//! Every number of the evidence that is chosen by hand, with its unit, its source and its reason.
//! [`NOISE_FREEDOM`], [`LINKED`], [`OWN`], [`POOLED`] and [`SHARED`] are those of a first trial on
//! other simulators; none has an ablation yet.

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
/// idealisation (area times a constant coefficient, a massless cord): 5 % of the force.
pub(super) const IDEALISED: f64 = 0.0025;

/// Windows whose errors are linked: a window overlaps with three on either side; five leave the
/// autocorrelation of a smoother inside.
pub(super) const LINKED: usize = 5;

/// Share of the variance of a row that is its own: rounding of the draws' storage and what the
/// autocorrelation does not follow. Keeps the covariance of overlapping windows invertible.
pub(super) const OWN: f64 = 1e-3;

/// Share of the variance of a stretch that is that of all stretches of its kind: eight draws know
/// their own variance to a third, stretches differ by as much.
pub(super) const POOLED: f64 = 0.5;

/// Share of the errors that all recordings of a session have alike. The draws hold one geometry
/// each, and no record of which part of an error it made.
pub(super) const SHARED: f64 = 0.5;

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
