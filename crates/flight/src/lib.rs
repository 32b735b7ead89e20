//! When no external force acts.
//!
//! Between import and identification: from plates ([`from_plates`]), from motion alone ([`from_motion`]), or from both
//! ([`find_flights`]), the frames in which nothing touches the body. What such frames have in common is a constant acceleration of the
//! centre of mass; that it equals the stated gravity is a result ([`FreeFall`]), not an assumption: a false frame rate, unit of length
//! or vertical, and body-weight support, change it. Flights also tell what plates read when nothing stands on them ([`tare`]).

mod center_of_mass;
mod combine;
mod error;
mod explain;
mod flight;
mod free_acceleration;
mod free_fall;
mod from_motion;
mod from_plates;
mod impulse;
pub mod options;
mod parabola;
mod tare;
mod warning;
mod wrench;

pub use combine::{combine, find_flights};
pub use error::FlightError;
pub use explain::{Cause, Evidence, Explanation};
pub use flight::{EdgeSource, Flight, FlightReport, FlightSource, Rejected, RejectionReason};
pub use free_fall::FreeFall;
pub use from_motion::from_motion;
pub use from_plates::from_plates;
pub use impulse::{ImpulseMass, impulse_masses};
pub use options::{FlightMethod, FlightOptions};
pub use tare::{PlateTare, TareSource, apply_tare, tare, unloaded_tare};
pub use warning::FlightWarning;
pub use wrench::{FrameWrench, plate_wrench_at_marker_rate, total_wrench};
