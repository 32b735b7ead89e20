//! The catalogue: one file an effect, one line here.

use crate::EffectDefinition;

mod added_mass;
mod body_mass;
mod camera_warp;
mod constant_force;
mod crane;
mod filter_attenuation;
mod flywheel;
mod gravity_scale;
mod gravity_tilt;
mod joint_centre;
mod linear_drag;
mod payload;
mod plate_clock_drift;
mod plate_gain;
mod plate_origin;
mod plate_rotation;
mod plate_tare;
mod plate_time_offset;
mod quadratic_drag;
mod residual_contact;
mod rotational_drag;
mod rotor;
mod soft_tissue;
mod tether;
mod thrust;
mod wind;
mod wobbling_mass;

/// Every effect that comes with the program, physics first.
pub static EFFECTS: &[&EffectDefinition] = &[
    &quadratic_drag::EFFECT,
    &linear_drag::EFFECT,
    &rotational_drag::EFFECT,
    &wind::EFFECT,
    &constant_force::EFFECT,
    &gravity_tilt::EFFECT,
    &gravity_scale::EFFECT,
    &tether::EFFECT,
    &crane::EFFECT,
    &flywheel::EFFECT,
    &rotor::EFFECT,
    &payload::EFFECT,
    &wobbling_mass::EFFECT,
    &added_mass::EFFECT,
    &thrust::EFFECT,
    &residual_contact::EFFECT,
    &plate_time_offset::EFFECT,
    &plate_clock_drift::EFFECT,
    &plate_tare::EFFECT,
    &plate_origin::EFFECT,
    &plate_rotation::EFFECT,
    &plate_gain::EFFECT,
    &filter_attenuation::EFFECT,
    &soft_tissue::EFFECT,
    &joint_centre::EFFECT,
    &camera_warp::EFFECT,
    &body_mass::EFFECT,
];
