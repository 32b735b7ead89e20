//! Which effect is missing, by one marginal likelihood over flights and contact together.
//!
//! | module | what it does |
//! |---|---|
//! | `priors` | every number chosen by hand |
//! | `noise` | covariance of the rows' errors from draws, rows in its units |
//! | `model` | rows with the effects of a model |
//! | `starts` | where the fits of an effect begin |
//! | `explanation` | an effect on a target, at the optimum of its unknowns |
//! | `candidates` | explanations, each at the optimum of its unknowns |
//! | `likelihood` | the marginal likelihood of one of them |
//! | `by_recording` | the same with recordings as the units |
//! | `posterior` | probabilities of effects, targets, recordings |
//! | `search` | the likeliest joins the model, and the rest is asked again |
//! | `beyond` | a law where the catalogue leaves too much |
//! | `form` | whether what was found has the form that its law states |
//! | `sizes` | whether sizes from contact, too, predict as well |
//! | `answer` | verdict, effects found, words |

mod answer;
mod autoregression;
mod beyond;
mod by_recording;
mod candidates;
mod explanation;
mod form;
mod likelihood;
mod model;
mod noise;
mod posterior;
mod priors;
mod search;
mod sizes;
mod starts;

pub(crate) use answer::by_evidence;
