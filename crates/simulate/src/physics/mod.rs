//! The physics of the simulator: forward dynamics of a floating tree, force laws, a Runge-Kutta
//! step.

pub mod dynamics;
pub mod forces;
pub mod formula;
pub mod law;
pub mod plant;
pub mod player;
pub mod rk4;

pub use dynamics::{Drive, ForwardDynamics};
pub use forces::{ForceField, Wrench};
pub use law::{Instant, Past};
pub use plant::{Body, Plant};
pub use player::{Player, TrueMotion};
