//! Finds missing effects, with their uncertainty and the effects that they can be confused with.
//!
//! A [`Session`] holds the weak rows of every flight and contact stretch in fixed weights, and
//! computes columns of any effect for them. [`discover`] puts them in units of their noise and
//! judges every effect by one marginal likelihood over flights and contact, the inertial parameters
//! projected out; recordings left out one by one have to show it, too.
//!
//! | step | module | what it does |
//! |---|---|---|
//! | rows | `session`, `draws`, `drawn`, `white_noise` | rows, columns of effects, drawn errors |
//! | fit | `problem` | parameters projected out of columns, one Cholesky factor per fold |
//! | fit | `candidate`, `plausible` | coefficients within what physics allows |
//! | fit | `nonlinear` | Gauss-Newton on the nonlinear parameters, again in each fold |
//! | fit | `groups` | the trials in which a load was carried, from force plates or from flights |
//! | judgement | `evidence` | explanations, their marginal likelihood, the answer |
//! | beyond the catalogue | `laws` | where and how an unexplained error acts, and by which law |
//! | joints | `joints` | laws of a robot's joints, from what held-out flights leave in their torques |
//! | intervals | `statistics`, `repeating` | spread over clusters; errors that repeat from trial to trial |
//! | words | `wording` | the result in words |
//! | ladder | `addition`, `ladder` | held-out error before and after one more effect |
//! | self-test | `self_test` | inject and recover on the user's own recordings |
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
//!     plate_centres_m: &[],
//! };
//! let trials = [TrialInput { motion, stretches, measured: None, plates: &[], group: None, session_time_s: 0.0 }];
//! let scene = scene_of(&body, &trials);
//! let weak = WeakOptions::default();
//! // the errors of the recordings: those that a comparison draws, or white noise alone
//! let session = Session::new(&body, &scene, &trials, &weak)?.with_white_noise(&body, &trials, &weak)?;
//! let discovery = discover(&session, &catalogue(), &[], &DiscoverOptions::default())?;
//! println!("{}", discovery.words);
//! # Ok(())
//! # }
//! ```
//!
//! [`Discovery`] serialises to the contract of `aloft discover --json`. An effect that was found
//! goes back in as an `accepted` [`aloft_effects::EffectInstance`] (its key and nonlinear
//! parameters are in [`Found`]); for identification its columns come from
//! [`aloft_effects::columns`], stored in the factors, and `Factor::with_effects` picks them.

mod addition;
mod by_stages;
mod candidate;
mod discover;
mod drawn;
mod draws;
mod error;
mod evidence;
mod groups;
mod held_out;
mod joints;
mod ladder;
mod laws;
mod nonlinear;
mod not_tried;
mod options;
mod plausible;
mod problem;
mod progress;
mod repeating;
mod result;
mod self_test;
mod session;
mod statistics;
mod thin;
mod white_noise;
mod wording;

pub use addition::{addition, detectable, ladder};
pub use by_stages::{Compute, Staged, StagedCoefficient};
pub use discover::{catalogue, discover};
pub use draws::{ContactRows, TrialDraws};
pub use error::DiscoverError;
pub use held_out::HeldOutResult;
pub use joints::{JointCandidate, JointDiscovery, JointFinding, JointInput, JointSearch, discover_joints};
pub use laws::{
    Action, Carrier, Diagnosis, Direction, Entry, FoundLaw, LawKind, NextRecording, OpenWorld, Variable, Work,
};
pub use options::DiscoverOptions;
pub use progress::{Part, Told};
pub use result::{
    Addition, Alternative, Candidate, CandidateEvidence, Discovery, Estimate, Found, Group, Misfit, NotTried, Round,
    SessionEvidence, Verdict,
};
pub use self_test::{Injection, SelfTest, SelfTestOptions, SelfTestProgress, SelfTestRow, self_test};
pub use session::{Body, Session, TrialInput, scene_of};
pub use wording::{TOO_FEW, odds};
