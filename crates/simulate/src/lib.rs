//! Forward dynamics and synthetic laboratories with known truth.
//!
//! A [`Scenario`] defines the person or object, its movements, the instruments, and the effects
//! hidden from the laboratory. [`simulate`] runs it and returns a [`Lab`]: recordings as structures
//! ([`LabTrial`]), the same as files ([`LabFile`]: C3D, `subject.yaml` or `object.yaml`, sealed
//! `truth/`), and the [`Truth`]. This crate does not access the disk.
//!
//! Its output is imported like the folder of any other laboratory. It serves to plan recordings
//! (which motion would determine a parameter?) and as a source of test fixtures.
//!
//! # Steps of a simulation
//!
//! | step | module |
//! |---|---|
//! | an individual body: geometry, masses, markers | [`human::person`], [`object`] |
//! | hidden effects: forces, payloads, gravity | [`physics::plant`], [`physics::forces`] |
//! | hidden laws given as formulas | [`physics::law`], [`physics::formula`] |
//! | prescribed motion on the ground | [`human::ground`], [`human::exercise`] |
//! | prescribed motion in the hand | [`object::throws`] |
//! | flight by equations of motion, take-off adjusted | [`human::jump`], [`physics::dynamics`] |
//! | instruments: noise, soft tissue, gaps, plates | [`measure`] |
//! | files | [`lab`], [`truth`] |
//!
//! In flight the residual wrench on the body is zero within rounding; on the ground the plates
//! receive exactly the wrench computed by recursive Newton-Euler, divided between the feet. The
//! classical Runge-Kutta method with half-millisecond steps ([`physics::rk4`]) has an error of
//! 1e-11 m after 0.6 s of tumbling.
//!
//! # Example
//!
//! ```
//! use aloft_simulate::{BodySpec, ChainLab, Hidden, Scenario, ThrowProtocol, simulate};
//!
//! let throws = ThrowProtocol { recordings: 1, throws: 1, calibration_s: 1.0, ..ThrowProtocol::default() };
//! let scenario = Scenario {
//!     name: "one_throw".to_owned(),
//!     seed: 7,
//!     body: BodySpec::Chain(ChainLab { throws, ..ChainLab::default() }),
//!     capture: Default::default(),
//!     hidden: vec![Hidden::QuadraticDrag { drag_area_m2: 0.03, air_density_kgpm3: 1.2 }],
//!     trajectories: false,
//! };
//! let lab = simulate(&scenario)?;
//! assert_eq!(lab.truth.effect, "quadratic_drag");
//! assert!(lab.files.iter().any(|f| f.path == "throws_01.c3d"));
//! # Ok::<(), aloft_simulate::SimulateError>(())
//! ```

mod check;
mod describe;
pub mod error;
mod files;
pub mod hidden;
pub mod human;
pub mod lab;
pub mod measure;
pub mod motion;
pub mod npz;
pub mod object;
pub mod physics;
pub mod random;
pub mod scenario;
pub mod truth;

pub use error::SimulateError;
pub use hidden::{Hidden, Plate};
pub use lab::{Lab, LabFile, LabTrial, simulate};
pub use scenario::{
    BodySpec, CaptureSpec, ChainLab, ChainSpec, CustomLab, HumanLab, JumpProtocol, MarkerSpec, PersonSpec, Scenario,
    ThrowProtocol,
};
pub use truth::Truth;
