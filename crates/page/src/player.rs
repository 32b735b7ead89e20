//! Player for a recording in three dimensions: bones, measured and model markers, forces.
//!
//! It is drawn on a plain canvas by the page's own script, so that a page can hold any number of
//! recordings (browsers limit WebGL views to a few) and old computers are fast enough.

use crate::figure::{Figure, Words};
use crate::pack;
use serde_json::{Value, json};

/// A kind of arrow, with one or several arrows per frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Arrows {
    /// Name in the legend.
    pub name: String,
    /// `frames[frame][arrow]`: start and tip, m; NaN if there is none. Every frame has the same
    /// number of arrows.
    pub frames: Vec<Vec<[[f64; 3]; 2]>>,
}

/// A skeleton, markers and forces over time; world axes, m, Z up.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Animation {
    /// Time of each frame, s.
    pub times_s: Vec<f64>,
    /// True for frames in flight.
    pub in_flight: Vec<bool>,
    /// Frame shown first.
    pub first: usize,
    /// Pairs of joint indices.
    pub bones: Vec<(usize, usize)>,
    /// Names of the joints, for the CSV.
    pub joint_names: Vec<String>,
    /// `joints[frame][joint]`; NaN where unknown.
    pub joints: Vec<Vec<[f64; 3]>>,
    /// Names of the markers.
    pub labels: Vec<String>,
    /// `measured[frame][marker]`; NaN where missing.
    pub measured: Vec<Vec<[f64; 3]>>,
    /// `modelled[frame][marker]`.
    pub modelled: Vec<Vec<[f64; 3]>>,
    /// Forces.
    pub arrows: Vec<Arrows>,
    /// Force that corresponds to one metre of arrow, N.
    pub newtons_per_m: f64,
    /// Corners of force plates.
    pub plates: Vec<Vec<[f64; 3]>>,
}

/// Positions are stored with a resolution of 0.1 mm within ±3.2 m; for larger values the packing
/// uses larger steps.
const STEP_M: f64 = 1e-4;

fn flat(frames: &[Vec<[f64; 3]>]) -> impl Iterator<Item = f64> + '_ {
    frames.iter().flatten().flatten().copied()
}

impl Figure {
    /// A playable skeleton: measured markers, model markers, bones and force arrows.
    pub fn animation(words: Words<'_>, a: &Animation) -> Self {
        let arrows: Vec<Value> = a
            .arrows
            .iter()
            .map(|kind| {
                json!({"name": kind.name, "n": kind.frames.first().map_or(0, Vec::len),
                    "at": pack::steps(kind.frames.iter().flatten().flatten().flatten().copied(), STEP_M)})
            })
            .collect();
        let data = json!({
            "t": pack::numbers(&a.times_s),
            "flight": pack::steps(a.in_flight.iter().map(|f| f64::from(u8::from(*f))), 1.0),
            "first": a.first,
            "bones": a.bones,
            "joint_names": a.joint_names,
            "n_joints": a.joints.first().map_or(0, Vec::len),
            "joints": pack::steps(flat(&a.joints), STEP_M),
            "labels": a.labels,
            "measured": pack::steps(flat(&a.measured), STEP_M),
            "modelled": pack::steps(flat(&a.modelled), STEP_M),
            "arrows": arrows,
            "newtons_per_m": a.newtons_per_m,
            "plates": a.plates,
        });
        Self::new("player", words, 540, data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_takes_six_bytes_a_point() {
        let point = vec![vec![[0.1, f64::NAN, 1.0]; 10]; 30];
        let a = Animation {
            times_s: vec![0.0; 30],
            in_flight: vec![false; 30],
            joints: point.clone(),
            measured: point.clone(),
            modelled: point,
            ..Animation::default()
        };
        let text = Figure::animation(Words::new("t", "c"), &a).data().to_string();
        let packed = 3 * 30 * 10 * 6 * 4 / 3;
        assert!(text.len() < packed + 900, "{} bytes for {packed}", text.len());
    }
}
