//! Finds missing effects, with their uncertainty and the effects that they can be confused with.
//!
//! A [`Session`] holds the weak rows of every flight and contact stretch in fixed weights, and
//! computes columns of any effect for them. [`discover`] refits the inertial parameters together
//! with each candidate, predicts every trial (or flight, where trials are few) from the others, and
//! compares errors:
//!
//! | step | module | what it does |
//! |---|---|---|
//! | evidence | `session`, `floor` | rows, columns of effects, noise floor |
//! | refit | `problem` | parameters projected out of columns, one Cholesky factor per fold |
//! | refit | `candidate` | bounded coefficients |
//! | refit | `nonlinear` | Gauss-Newton on the nonlinear parameters, again in each fold |
//! | ranking | `rank` | choice of target inside each fold, sign-flip null over all effects |
//! | ranking | `groups` | the trials in which a load was carried, from force plates or from flights |
//! | ranking | `other_trials` | whether it acts in trials that flights say nothing of |
//! | ranking | `statistics` | intervals over clusters |
//! | ranking | `placebo` | effects without physical basis |
//! | judgement | `discover`, `ladder`, `pairs` | rounds, pruning, pairs of effects |
//! | beyond the catalogue | `laws` | where and how an unexplained error acts, and by which law |
//! | judgement | `beside` | several effects, each judged again beside the others |
//! | judgement | `judge`, `exchange` | accepted effects, effects that cannot be told apart |
//! | joints | `joints` | laws of a robot's joints, from what held-out flights leave in their torques |
//! | judgement | `contact` | what force plates say of effects that flights named |
//! | judgement | `refused` | effects that are not named although they lower the error in flight |
//! | judgement | `on_which_link` | other links on which an effect explains as much |
//! | judgement | `wording` | the result in words |
//! | intervals | `repeating` | wider intervals for errors that repeat from trial to trial |
//! | ladder | `addition` | held-out error before and after one more effect |
//! | self-test | `self_test` | inject and recover on the user's own recordings |
//! | one likelihood | `evidence` | the same question by one marginal likelihood ([`Method::Evidence`]) |
//!
//! Nothing is weighted by residuals: whitening with them would remove part of the effect being
//! sought.
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
//! let session = Session::new(&body, &scene, &trials, &WeakOptions::default())?;
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
mod beside;
mod beyond;
mod by_stages;
mod candidate;
mod conclude;
mod contact;
mod discover;
mod drawn;
mod draws;
mod error;
mod evidence;
mod exchange;
mod floor;
mod groups;
mod held_out;
mod joints;
mod judge;
mod ladder;
mod laws;
mod limits;
mod nonlinear;
mod not_tried;
mod on_which_link;
mod one_is_enough;
mod only_as_limit;
mod options;
mod other_trials;
mod pairs;
mod placebo;
mod problem;
mod progress;
mod rank;
mod refused;
mod repeating;
mod result;
mod rivals;
mod round;
mod rounds;
mod self_test;
mod session;
mod shown_in_both;
mod sizes;
mod statistics;
mod thin;
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
pub use options::{DiscoverOptions, Method};
pub use progress::{Part, Told};
pub use result::{
    Addition, AgainstLaw, Alternative, Candidate, CandidateEvidence, Confusion, Discovery, Estimate, Found, Group,
    Misfit, NotTried, RivalTest, Round, SessionEvidence, Verdict,
};
pub use self_test::{Injection, SelfTest, SelfTestOptions, SelfTestProgress, SelfTestRow, self_test};
pub use session::{Body, Session, TrialInput, scene_of};
pub use wording::{TOO_FEW, odds};
