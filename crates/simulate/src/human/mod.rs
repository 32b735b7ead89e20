//! People: individual bodies, jumps that conserve momentum in flight, exercises on the plates.

pub mod air;
pub mod exercise;
pub mod ground;
pub mod jump;
pub mod leg;
pub mod person;
pub mod posture;
pub mod session;
pub mod stance;
pub mod styles;

pub use person::Person;
