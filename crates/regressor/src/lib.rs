//! Rows and factors: the information about the parameters in one flight.
//!
//! The equations of motion of a flight are linear in the base parameters φ_B and in the
//! coefficients θ of candidate effects. This crate computes the rows of these equations from the
//! motion of one flight (or of one contact phase with plates), either the paper's from
//! accelerations ([`acceleration_factor`]) or weak ones from momentum ([`weak_factor`]), and keeps
//! only the upper triangle of a QR factorisation, a [`Factor`]. Estimation, resampling, leaving out
//! and adding use factors.
//!
//! Uses the results of `flight` and is used by `identify`.

pub mod acceleration;
mod body_windows;
mod error;
pub mod factor;
#[cfg(test)]
mod four_joints;
pub mod limits;
pub mod matrix_noise;
pub mod noise;
pub mod repeated;
pub mod stretch;
pub mod test_function;
mod triangle;
mod velocities;
pub mod weak;
pub mod weak_windows;

pub use acceleration::{AccelerationOptions, AccelerationRows, acceleration_factor};
pub use body_windows::{BodyWindows, body_windows};
pub use error::RegressorError;
pub use factor::{Columns, Factor, RowKind, leave_group_out, leave_one_out};
pub use limits::{FAIR_TIMES_FLOOR, FLOOR_KNOWN_WITHIN, POOR_TIMES_FLOOR};
pub use matrix_noise::{MatrixNoise, MotionErrors, disturbed};
pub use noise::{CoordinateNoise, Noise};
pub use repeated::{RepeatedErrors, Seen, SeenBody, carried, overlays};
pub use stretch::{Acting, EffectColumns, Stretch, StretchKind};
pub use test_function::TestFunction;
pub use test_function::window_centres;
pub use velocities::run_velocities;
pub use weak::{body_radius_m, weak_factor, weak_factor_with_noise, weak_factor_with_repeated};
pub use weak_windows::{WeakOptions, WeakRows, weak_rows};
