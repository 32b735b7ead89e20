//! Which effect is missing, how sure, and what it can be confused with.
mod candidate;
mod discover;
mod error;
mod floor;
mod nonlinear;
mod placebo;
mod problem;
mod rank;
mod result;
mod self_test;
mod session;
mod statistics;
mod words;

pub use discover::{DiscoverOptions, catalogue, discover};
pub use error::DiscoverError;
pub use result::{Alternative, Candidate, Confusion, Discovery, Estimate, Found, Round, Verdict};
pub use self_test::{Injection, SelfTest, self_test};
pub use session::{Body, Session, TrialInput, scene_of};
