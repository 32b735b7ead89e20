//! The catalogue: one file an effect, which states everything about it, and its name here.

use crate::Effect;

mod added_mass;
mod asymmetric_friction;
mod base_time_offset;
mod body_mass;
mod camera_warp;
mod cogging;
mod constant_force;
mod crane;
mod encoder_offset;
mod filter_attenuation;
mod flywheel;
mod gain_curve;
mod gravity_scale;
mod gravity_tilt;
mod joint_centre;
mod joint_spring;
mod linear_drag;
mod link_mass;
mod load_friction;
mod marker_overshoot;
mod panels;
mod payload;
mod plate_clock_drift;
mod plate_gain;
mod plate_origin;
mod plate_rotation;
mod plate_tare;
mod plate_time_offset;
mod quadratic_drag;
mod quadratic_friction;
mod residual_contact;
mod rotational_drag;
mod rotor;
mod soft_tissue;
mod stribeck;
mod tether;
mod thrust;
mod torque_offset;
mod wind;
mod wobbling_mass;

/// Every effect that comes with the program, physics first.
pub static EFFECTS: &[&dyn Effect] = &[
    &quadratic_drag::QuadraticDrag,
    &linear_drag::LinearDrag,
    &rotational_drag::RotationalDrag,
    &wind::Wind,
    &panels::Panels,
    &constant_force::ConstantForce,
    &gravity_tilt::GravityTilt,
    &gravity_scale::GravityScale,
    &tether::Tether,
    &crane::Crane,
    &flywheel::Flywheel,
    &rotor::Rotor,
    &payload::Payload,
    &link_mass::LinkMass,
    &wobbling_mass::WobblingMass,
    &added_mass::AddedMass,
    &thrust::Thrust,
    &residual_contact::ResidualContact,
    &plate_time_offset::PlateTimeOffset,
    &plate_clock_drift::PlateClockDrift,
    &plate_tare::PlateTare,
    &plate_origin::PlateOrigin,
    &plate_rotation::PlateRotation,
    &plate_gain::PlateGain,
    &filter_attenuation::FilterAttenuation,
    &soft_tissue::SoftTissue,
    &marker_overshoot::MarkerOvershoot,
    &joint_centre::JointCentre,
    &encoder_offset::EncoderOffset,
    &base_time_offset::BaseTimeOffset,
    &camera_warp::CameraWarp,
    &body_mass::BodyMass,
    &stribeck::Stribeck,
    &asymmetric_friction::AsymmetricFriction,
    &quadratic_friction::QuadraticFriction,
    &load_friction::LoadFriction,
    &joint_spring::JointSpring,
    &cogging::Cogging,
    &torque_offset::TorqueOffset,
    &gain_curve::GainCurve,
];
