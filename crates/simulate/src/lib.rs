//! Forward dynamics and synthetic laboratories with known truth.
//!
//! A [`Scenario`] says who or what is recorded, doing what, by which instruments, and what the laboratory does not know.
//! [`simulate`] plays it and returns a [`Lab`]: recordings as structures ([`LabTrial`]), the same as files ([`LabFile`]:
//! C3D, `subject.yaml` or `object.yaml`, sealed `truth/`), and the [`Truth`]. Nothing here touches the disk.
//!
//! In the flow this stands before everything: a lab folder goes in at import like any other. People use it to plan
//! recordings (which motion would show a parameter?), tests use it for fixtures.
//!
//! # How a session comes about
//!
//! | step | module |
//! |---|---|
//! | an individual body: geometry, masses, markers | [`human::person`], [`object`] |
//! | what is hidden is put into it: forces, payloads, gravity | [`physics::plant`], [`physics::forces`] |
//! | on the ground or in the hand the choreography prescribes | [`human::ground`], [`human::exercise`], [`object::throws`] |
//! | in the air the equations of motion decide; take-off is aimed until the landing is met | [`human::jump`], [`physics::dynamics`] |
//! | instruments see it: noise, soft tissue, gaps, plates | [`measure`] |
//! | files | [`lab`], [`truth`] |
//!
//! In flight the wrench that is left on the body is zero to rounding; on the ground plates get exactly what recursive
//! Newton-Euler demands, divided between the feet. The classical Runge-Kutta method with half-millisecond steps
//! ([`physics::rk4`]) leaves 1e-11 m after 0.6 s of tumbling.
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
pub use hidden::Hidden;
pub use lab::{Lab, LabFile, LabTrial, simulate};
pub use scenario::{
    BodySpec, CaptureSpec, ChainLab, ChainSpec, CustomLab, HumanLab, JumpProtocol, MarkerSpec, PersonSpec, Scenario,
    ThrowProtocol,
};
pub use truth::Truth;
