//! Player for a recording in three dimensions: segments with their shapes, markers, forces,
//! effects.
//!
//! The page's script draws it with three.js, or on a plain canvas where the browser has no WebGL.
//! Places of points on segments are computed in the browser from the poses of the segments, so that
//! a frame takes few bytes.

use crate::figure::{Figure, Words};
use crate::pack;
use serde::Serialize;
use serde_json::{Value, json};

/// A segment: its shape is an ellipsoid.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Segment {
    /// Name.
    pub name: String,
    /// Index of the segment that it hangs on.
    pub parent: Option<usize>,
    /// Centre of the ellipsoid, segment frame, m.
    pub centre_m: [f64; 3],
    /// Axes of the ellipsoid in the segment frame: quaternion x, y, z, w.
    pub turn: [f64; 4],
    /// Semi-axes, m.
    pub radii_m: [f64; 3],
    /// Error that this segment could carry, in multiples of the noise floor; none if unknown.
    pub heat: Option<f64>,
}

/// A point on a segment.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct PointOn {
    /// Name.
    pub name: String,
    /// Index of the segment.
    pub segment: usize,
    /// Position in the segment frame, m.
    pub at_m: [f64; 3],
}

/// What an arrow stands for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ArrowOf {
    /// A measured force.
    #[default]
    Measured,
    /// The force that the model predicts.
    Predicted,
    /// The force of an effect.
    Effect,
    /// The moment of an effect, drawn as a ring about its axis.
    Couple,
}

/// Arrows of one kind, with one or several per frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Arrows {
    /// Name in the legend.
    pub name: String,
    /// What they stand for.
    pub of: ArrowOf,
    /// `frames[frame][arrow]`: foot (m), and force (N) or moment (N·m); NaN if there is none. Every
    /// frame has the same number of arrows.
    pub frames: Vec<Vec<[[f64; 3]; 2]>>,
    /// Fixed point of the room to which a line runs from the foot of each arrow, m.
    pub anchor_m: Option<[f64; 3]>,
    /// True for an effect that is not in the model.
    pub suspected: bool,
}

/// A mass that the model holds at a point.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MassAt {
    /// Name with its size.
    pub name: String,
    /// Index of the segment.
    pub segment: usize,
    /// Position in the segment frame, m.
    pub at_m: [f64; 3],
    /// Mass, kg.
    pub mass_kg: f64,
    /// True for an effect that is not in the model.
    pub suspected: bool,
}

/// A recording; world axes, m, Z up.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Animation {
    /// Name of the recording, by which charts over its time are found; empty for none.
    pub recording: String,
    /// Time of each frame, s.
    pub times_s: Vec<f64>,
    /// True for frames in flight.
    pub in_flight: Vec<bool>,
    /// Frame shown first.
    pub first: usize,
    /// Segments.
    pub segments: Vec<Segment>,
    /// Ends of segments that carry no other segment, or all markers of a body of few segments.
    pub ends: Vec<PointOn>,
    /// `origins[frame][segment]`.
    pub origins: Vec<Vec<[f64; 3]>>,
    /// `turns[frame][segment]`: quaternion x, y, z, w from the segment frame to the world.
    pub turns: Vec<Vec<[f64; 4]>>,
    /// Markers of the model.
    pub markers: Vec<PointOn>,
    /// `measured[frame][marker]`; NaN where missing.
    pub measured: Vec<Vec<[f64; 3]>>,
    /// Centre of mass in each frame.
    pub com_m: Vec<[f64; 3]>,
    /// Displacement of the body in each frame without the effects of the model, m: NaN where it is
    /// not known; empty without effects.
    pub ghost_m: Vec<[f64; 3]>,
    /// Forces, and moments of effects.
    pub arrows: Vec<Arrows>,
    /// Masses.
    pub masses: Vec<MassAt>,
    /// Force that corresponds to one metre of arrow, N: on the ground, in flight.
    pub newtons_per_m: [f64; 2],
    /// Corners of force plates.
    pub plates: Vec<Vec<[f64; 3]>>,
    /// Effects that a caption names but that have no place in space (errors of measurement).
    pub unplaced: Vec<String>,
    /// True if plates measure all that acts outside flights.
    pub plates_complete: bool,
}

/// Positions are stored with a resolution of 0.1 mm within ±3.2 m; for larger values the packing
/// uses larger steps.
const STEP_M: f64 = 1e-4;
/// Resolution of a quaternion's components.
const STEP_TURN: f64 = 1.0 / 32_767.0;
/// Resolution of forces, N.
const STEP_N: f64 = 1e-4;

fn flat<const N: usize>(frames: &[Vec<[f64; N]>]) -> impl Iterator<Item = f64> + '_ {
    frames.iter().flatten().flatten().copied()
}

fn arrows(kind: &Arrows) -> Value {
    let part = |which: usize| kind.frames.iter().flatten().flat_map(move |a| a[which]);
    json!({"name": kind.name, "of": kind.of, "n": kind.frames.first().map_or(0, Vec::len), "foot": pack::steps(part(0), STEP_M),
        "vector": pack::steps(part(1), STEP_N), "anchor": kind.anchor_m, "suspected": kind.suspected})
}

impl Figure {
    /// A playable recording.
    pub fn animation(words: Words<'_>, a: &Animation) -> Self {
        let data = json!({
            "kind": "player",
            "recording": a.recording,
            "t": pack::numbers(&a.times_s),
            "flight": pack::steps(a.in_flight.iter().map(|f| f64::from(u8::from(*f))), 1.0),
            "first": a.first,
            "segments": a.segments,
            "ends": a.ends,
            "origins": pack::steps(flat(&a.origins), STEP_M),
            "turns": pack::steps(flat(&a.turns), STEP_TURN),
            "markers": a.markers,
            "measured": pack::steps(flat(&a.measured), STEP_M),
            "com": pack::steps(a.com_m.iter().flatten().copied(), STEP_M),
            "ghost": if a.ghost_m.is_empty() { Value::Null } else { pack::steps(a.ghost_m.iter().flatten().copied(), STEP_M) },
            "arrows": a.arrows.iter().map(arrows).collect::<Vec<Value>>(),
            "masses": a.masses,
            "newtons_per_m": a.newtons_per_m,
            "plates": a.plates,
            "unplaced": a.unplaced,
            "plates_complete": a.plates_complete,
        });
        Self::new("player", words, 520, data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_takes_fourteen_bytes_a_segment_and_six_a_marker() {
        let a = Animation {
            times_s: vec![0.0; 30],
            in_flight: vec![false; 30],
            origins: vec![vec![[0.1, f64::NAN, 1.0]; 10]; 30],
            turns: vec![vec![[0.0, 0.0, 0.0, 1.0]; 10]; 30],
            measured: vec![vec![[0.1, 0.2, 1.0]; 20]; 30],
            ..Animation::default()
        };
        let text = Figure::animation(Words::new("t", "c"), &a).data().to_string();
        let packed = 30 * (10 * 14 + 20 * 6) * 4 / 3;
        assert!(text.len() < packed + 1200, "{} bytes for {packed}", text.len());
    }

    #[test]
    fn an_arrow_keeps_its_foot_and_its_force() {
        let none = [f64::NAN; 3];
        let one =
            Arrows { frames: vec![vec![[[0.0, 0.0, 1.0], [0.0, 0.0, -2.0]]], vec![[none, none]]], ..Arrows::default() };
        let packed = arrows(&one);
        assert_eq!((packed["n"].as_u64(), packed["of"].as_str()), (Some(1), Some("measured")));
        let missing = [0u8, 0x80].repeat(3);
        let foot = [&[0, 0, 0, 0, 0x10, 0x27][..], &missing[..]].concat();
        assert_eq!(packed["foot"]["b"], pack::base64(&foot));
    }
}
