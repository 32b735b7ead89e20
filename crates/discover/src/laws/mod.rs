//! The search beyond the catalogue: where a force acts that no effect describes, along what, on
//! what it depends, and by which law.
//!
//! | step | module | what it does |
//! |---|---|---|
//! | evidence | `evidence` | residual rows with the body's parameters projected out, for every fold and for random signs |
//! | vocabulary | `kinematics`, `shape` | places, directions, variables; functions of a variable |
//! | atlas | `atlas`, `two_variables` | every place, direction and variable with a free curve, and pairs of variables, ranked by held-out error |
//! | laws | `fit`, `law` | expressions for the best entries, with point, anchor and constants fitted in every fold |
//! | delay | `delayed` | the same law of the motion as it was earlier |
//! | diagnosis | `diagnosis` | what the best entry says without a law |
//! | rounds | `search` | a second factor, the simplest law that is as good, and again on what remains |
//! | contact | `with_contact` | the law that flights and contact show together |
//! | place | `near_joint`, `off_link`, `far_point` | the other link of a joint; whether a point lies on its link; a point of the room that is so far away that only its direction shows |
//! | claim | `stated` | whether laws are stated beside the catalogue |
//! | intervals | `intervals` | those of a law, with errors that are the same in all recordings |
//! | advice | `next` | the recording that tells a law from the next best one |
//! | output | `described`, `formula`, `result`, `wording` | an effect of the user's own, numbers, words |
//!
//! The method joins the weak form of sparse identification (Messenger and Bortz, *Weak SINDy*,
//! 2021) with the projection of known linear unknowns (Frisch and Waugh, 1933), variable projection
//! for constants inside a law (Golub and Pereyra, 1973), units as types (dimensional analysis), and
//! a choice by held-out error and number of unknowns, as in symbolic regression. What is particular
//! here: a candidate is a force on a link of a body whose inertial parameters are unknown too, so
//! that place and direction of the force are found from six rows of a floating base.

mod atlas;
mod delayed;
mod described;
mod diagnosis;
mod evidence;
mod far_point;
mod fit;
mod formula;
mod intervals;
mod kinematics;
mod law;
mod near_joint;
mod next;
mod off_link;
mod one_law;
mod result;
mod search;
mod shape;
mod stated;
mod two_variables;
mod with_contact;
mod wording;
mod work;

pub use kinematics::{Action, Carrier, Direction, Variable};
pub use result::{Diagnosis, Entry, FoundLaw, LawKind, NextRecording, OpenWorld, Work};

pub(crate) use atlas::{Line, PlaceFrames, SPLINES, carriers, columns, range_of, splines, stride};
pub(crate) use kinematics::WHOLE_BODY;
pub(crate) use search::search;
pub(crate) use shape::Range;
pub(crate) use stated::Rivals;
pub(crate) use wording::variable as variable_in_words;
