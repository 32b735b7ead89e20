//! Kinematic trees, spatial algebra and dynamics, linear in the inertial parameters.
//!
//! A [`Model`] is constant; a [`State`] is the scratch memory of one frame. Every algorithm takes
//! both and allocates nothing. Spatial vectors are ordered *linear, angular* (as in Pinocchio);
//! coordinates `q` hold, per joint: free `[x y z qx qy qz qw]`, spherical `[qx qy qz qw]`, revolute
//! and prismatic `[q]`, fixed nothing; velocities `v` hold: free `[linear; angular]` and spherical
//! `[angular]`, both in the axes of the moving link.
//!
//! The ten inertial parameters of a link are those of the paper's eq. 4, about the link-frame
//! origin: `φ = [m, mc_x, mc_y, mc_z, Ixx, Iyy, Izz, Iyz, Izx, Ixy]`.
//!
//! Other crates build on this one: scaling sets a model's joint positions, inverse kinematics uses
//! poses and Jacobians, identification uses the rows and [`BaseParameters`], simulation uses the
//! inertia matrix and inverse dynamics.
//!
//! ```
//! use aloft_body::{BaseParameters, JointSpec, LinkSpec, Model, ModelSpec, State};
//! use nalgebra::DMatrix;
//!
//! let link = |name: &str, parent: Option<&str>, joint| LinkSpec {
//!     name: name.into(),
//!     parent: parent.map(Into::into),
//!     joint,
//!     position_m: [0.0, -0.03, 0.01],
//!     rpy_rad: [0.0; 3],
//!     inertia: None,
//! };
//! let links = vec![link("link0", None, JointSpec::Free), link("link1", Some("link0"), JointSpec::RevoluteZ)];
//! let model = Model::from_spec(&ModelSpec::new("two_link".into(), links))?;
//!
//! let mut state = State::new(&model);
//! state.forward_acceleration(&model, &model.neutral(), &vec![0.1; model.nv], &vec![0.0; model.nv]);
//! let base = BaseParameters::of(&model);
//! let mut rows = DMatrix::zeros(6, base.len());
//! state.base_wrench_rows(&model, &base, &mut rows);
//! assert_eq!(base.len(), 17);
//! assert_eq!(base.parameters[0].formula, "m0 + m1");
//! # Ok::<(), aloft_body::BodyError>(())
//! ```

pub mod base_parameters;
pub mod batch;
mod batch_difference;
mod displaced;
mod dynamics;
mod error;
mod formula;
pub mod geometry_equations;
pub mod inertia;
pub mod model;
pub mod motion;
mod regressor;
pub mod rigid;
pub mod rotation;
mod spec;
pub mod state;
pub mod subject;
mod urdf;
mod xml;

pub use base_parameters::{BaseParameter, BaseParameters};
pub use batch::{FrameBatch, FrameBlock, LANES};
pub use batch_difference::FrameDifferences;
pub use error::BodyError;
pub use geometry_equations::{GeometryEquations, PostureFactor};
pub use inertia::{LinkInertia, PHI_NAMES, Phi};
pub use model::{Joint, JointKind, JointSpec, Link, LinkSpec, Model, ModelSpec, STANDARD_GRAVITY_MPS2};
pub use motion::Motion;
pub use state::State;
pub use subject::{EstimatedPoints, LinkBox, ModelMarker, PersonFacts, Sex, Subject};
pub use xml::check_xml;
