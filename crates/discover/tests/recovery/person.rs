//! The person of these tests: a session without hidden effects, simulated and reconstructed once.

use crate::lab::{Evidence, Known, lab, motions};
use crate::{Case, recovers};
use aloft_body::{LinkInertia, Motion};
use aloft_simulate::Lab;
use nalgebra::Matrix3;
use serde_json::{Value, json};
use std::sync::LazyLock;

pub const SEED: u64 = 11;

pub fn person() -> Value {
    json!({"kind": "human", "protocol": {"jumps": 3, "exercises": 2, "exercise_s": 3.0, "static_s": 0.5},
        "person": {"sex": "F", "height_m": 1.68, "mass_kg": 62.0}})
}

/// No marker is lost, so that marker trajectories can be smoothed.
pub static CAPTURE: LazyLock<Value> = LazyLock::new(|| json!({"gap_fraction": 0.0}));

/// The session, and its motions.
pub fn plain() -> &'static (Lab, Vec<Motion>) {
    static PLAIN: LazyLock<(Lab, Vec<Motion>)> = LazyLock::new(|| {
        let lab = lab(&person(), &CAPTURE, SEED, &json!([]));
        let motions = motions(&lab);
        (lab, motions)
    });
    &PLAIN
}

/// Evidence of the session with nothing hidden.
pub fn plain_evidence() -> Evidence {
    Evidence::new(&plain().0, &plain().1, Known::Tables, 0.0)
}

/// The tables leave out a load that the right forearm carries in every trial; the body was weighed
/// with it.
pub fn link_mass() {
    let (lab, motions) = plain();
    let twin = Evidence::new(lab, motions, Known::All, 0.0);
    let arm = twin.model.links.iter().position(|l| l.name == "forearm_r").unwrap();
    let (mass_kg, place) = (0.4, twin.links[arm].com_m);
    let load = LinkInertia { mass_kg, com_m: place, inertia_com_kgm2: Matrix3::zeros() }.to_phi();
    let mut tables = twin.clone();
    tables.links[arm] = LinkInertia::from_phi(&(twin.links[arm].to_phi() - load));
    let scale = twin.mass_kg / (twin.mass_kg - mass_kg);
    for link in &mut tables.links {
        *link = LinkInertia::from_phi(&(link.to_phi() * scale));
    }
    let nonlinear = [("point_x", place.x), ("point_y", place.y), ("point_z", place.z)];
    let case = Case { key: "link_mass[forearm_r]", truth: &[mass_kg], nonlinear: &nonlinear, ..Case::default() };
    recovers(&case, &tables, &twin);
}
