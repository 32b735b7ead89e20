//! The person of these tests: a session without hidden effects, simulated and reconstructed once.

use crate::lab::{Evidence, Known, lab, motions};
use aloft_body::Motion;
use aloft_simulate::Lab;
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
