//! Which effect is missing, how sure, and what it can be confused with.
//!
//! A [`Session`] holds the weak rows of every flight and contact stretch in fixed weights, and makes columns of any effect for them.
//! [`discover`] refits the inertial parameters together with each candidate, predicts every trial (or flight, where trials are few) from the
//! others, and compares errors:
//!
//! | step | module | what it does |
//! |---|---|---|
//! | evidence | `session`, `floor` | rows, columns of effects, what a perfect model would leave |
//! | refit | `problem`, `candidate`, `nonlinear` | parameters taken out of columns, one Cholesky factor a fold; bounded coefficients; Gauss-Newton on the rest, again in each fold |
//! | ranking | `rank`, `placebo`, `statistics` | choice of target inside each fold, intervals over clusters, sign-flip null over the whole library, effects that do not exist |
//! | judgement | `discover`, `judge`, `exchange`, `ladder`, `pairs`, `words` | what is believed and what cannot be told apart, second rounds, pairs, pruning, words |
//! | intervals | `repeating` | errors that repeat from trial to trial make intervals wider |
//! | ladder | `addition` | one effect more: held-out error before and after, from rows or stored factors |
//! | self-test | `self_test` | inject and recover on the user's own recordings |
//!
//! Nothing is weighted by residuals: whitening with them would eat the effect that is sought.
//!
//! ```no_run
//! # use aloft_body::{BaseParameters, Motion, Phi, Subject};
//! # use aloft_discover::*;
//! # use aloft_identify::Prior;
//! # use aloft_regressor::{Stretch, WeakOptions};
//! # fn of(subject: &Subject, base: &BaseParameters, phi: &[Phi], prior: &Prior, motion: &Motion, stretches: &[Stretch]) -> Result<(), DiscoverError> {
//! let body = Body {
//!     model: &subject.model,
//!     base,
//!     phi,
//!     prior: Some(prior),
//!     mass_kg: subject.facts.mass_kg,
//!     plate_centers_m: &[],
//! };
//! let trials = [TrialInput { motion, stretches, measured: None, plates: &[], group: None, session_time_s: 0.0 }];
//! let scene = scene_of(&body, &trials);
//! let session = Session::new(&body, &scene, &trials, &WeakOptions::default())?;
//! let discovery = discover(&session, &catalogue(), &[], &DiscoverOptions::default())?;
//! println!("{}", discovery.words);
//! # Ok(())
//! # }
//! ```
//!
//! [`Discovery`] serialises to the contract of `aloft discover --json`. An effect that was found goes back in as an `accepted`
//! [`aloft_effects::Choice`] (its key and nonlinear parameters are in [`Found`]); for identification its columns come from
//! [`aloft_effects::columns`], stored in the factors, and `Factor::with_effects` picks them.

mod addition;
mod candidate;
mod discover;
mod error;
mod exchange;
mod floor;
mod judge;
mod ladder;
mod nonlinear;
mod not_tried;
mod options;
mod pairs;
mod placebo;
mod problem;
mod rank;
mod repeating;
mod result;
mod self_test;
mod session;
mod statistics;
mod words;

pub use addition::{addition, detectable, ladder};
pub use discover::{catalogue, discover};
pub use error::DiscoverError;
pub use floor::Standing;
pub use not_tried::NotTried;
pub use options::DiscoverOptions;
pub use result::{Addition, Alternative, Candidate, Confusion, Discovery, Duel, Estimate, Found, Round, Verdict};
pub use self_test::{Injection, SelfTest, SelfTestOptions, SelfTestProgress, SelfTestRow, self_test};
pub use session::{Body, Session, TrialInput, scene_of};
