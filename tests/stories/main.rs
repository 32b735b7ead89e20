//! Stories: commands as a user types them, on recordings that the tests create, through the real
//! binary.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod batch;
mod broken_lab;
mod clusters;
mod corrections;
mod corrections_each;
mod demo;
mod estimators;
mod export;
mod few_flights;
mod help;
mod invisible;
mod kill;
mod layout;
mod loop_on_people;
mod markerless;
mod names;
mod newcomer;
mod one_interval;
mod one_stage_again;
mod osim;
mod own_effect;
mod part_of_a_body;
mod plates_of_others;
mod ready_made;
mod report;
mod right_results;
mod robot;
mod robot_contact;
mod robot_coverage;
mod robot_joint_coverage;
mod robot_joints;
mod robot_markers;
mod robot_next;
mod second_effect;
mod settings;
mod several_effects;
#[path = "../shared_data.rs"]
mod shared;
mod stated_mass;
mod studio;
mod support;
mod surfaces;
mod tilted;
mod workflow;
