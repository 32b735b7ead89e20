//! Flights: the frames in which no external force acts.
//!
//! Runs between import and identification. It finds the frames without external contact from plates
//! ([`from_plates`]), from motion alone ([`from_motion`]), or from both ([`find_flights`]). In such
//! frames the centre of mass has a constant acceleration. That it equals the stated gravity is a
//! result ([`FreeFall`]), not an assumption: a wrong frame rate, unit of length or vertical, and
//! body-weight support, change it. Flights also give the readings of unloaded plates ([`tare`]).

mod centre_of_mass;
mod combine;
mod contact;
mod coverage;
mod error;
mod explain;
mod feet;
mod flight;
mod free_acceleration;
mod free_fall;
mod from_motion;
mod from_plates;
mod impulse;
pub mod options;
mod parabola;
mod tare;
mod timing;
mod warning;
mod wrench;

pub use combine::{combine, find_flights};
pub use contact::{ContactSensor, bounded_by_contact};
pub use coverage::{Coverage, LeftOut, Unmeasured, coverage};
pub use error::FlightError;
pub use explain::{Cause, Evidence, Explanation};
pub use flight::{EdgeSource, Flight, FlightReport, FlightSource, Rejected, RejectionReason};
pub use free_fall::FreeFall;
pub use from_motion::from_motion;
pub use from_plates::from_plates;
pub use impulse::{ImpulseMass, impulse_masses};
pub use options::{FlightMethod, FlightOptions};
pub use tare::{PlateTare, TareSource, apply_tare, tare, unloaded_tare};
pub use timing::{POSTURE_SD_M, PlateDelay, plate_delays};
pub use warning::FlightWarning;
pub use wrench::{FrameWrench, plate_wrench_at_marker_rate, total_wrench};
