//! Simulates markerless software: poses of segments from videos, as Theia3D writes them.
//!
//! The poses are those of the true links in the axes of that software (x to the right, y forwards,
//! z towards the proximal end), with errors of its kind: each joint centre is displaced by a
//! constant that is drawn once for a session, frames have noise, and everything is low-pass
//! filtered.

use crate::physics::TrueMotion;
use crate::random::Stream;
use aloft_body::{Model, State};
use aloft_c3d::{SegmentPoses, SegmentTrack};
use aloft_signal::{Butterworth, CutoffCorrection, DesignError, LowPass};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// The errors of the software.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MarkerlessSpec {
    /// Constant displacement of each joint centre, each axis, m (standard deviation).
    #[serde(alias = "center_sd_m")]
    pub centre_sd_m: f64,
    /// White noise of a segment's origin before smoothing, each axis, m.
    pub noise_m: f64,
    /// White noise of a segment's orientation before smoothing, each axis, rad.
    pub noise_rad: f64,
    /// Cut-off of the low-pass filter, Hz.
    pub cutoff_hz: f64,
}

impl Default for MarkerlessSpec {
    fn default() -> Self {
        Self { centre_sd_m: 0.01, noise_m: 2e-3, noise_rad: 0.02, cutoff_hz: 12.0 }
    }
}

/// Segments of the software: label, link, and where its origin is: the link's own joint, or that of
/// another link.
const SEGMENTS: [(&str, &str, Option<&str>); 15] = [
    ("pelvis", "pelvis", None),
    ("l_thigh", "thigh_l", None),
    ("l_shank", "shank_l", None),
    ("l_foot", "foot_l", None),
    ("r_thigh", "thigh_r", None),
    ("r_shank", "shank_r", None),
    ("r_foot", "foot_r", None),
    ("torso", "torso", Some("head")),
    ("l_uarm", "upper_arm_l", None),
    ("l_larm", "forearm_l", None),
    ("l_hand", "hand_l", None),
    ("r_uarm", "upper_arm_r", None),
    ("r_larm", "forearm_r", None),
    ("r_hand", "hand_r", None),
    ("head", "head", None),
];
/// Toes: the ball of the foot in the foot's frame, in lengths of the software's own model.
const TOES: [(&str, &str); 2] = [("l_toes", "foot_l"), ("r_toes", "foot_r")];
/// From the axes of a link (x forwards, y up, z to the right) to those of the software.
fn axes() -> Matrix3<f64> {
    Matrix3::from_columns(&[Vector3::z(), Vector3::x(), Vector3::y()])
}

/// Poses of all segments, mm, at every `ticks_per_frame`-th tick. `centres` draws what is constant
/// in a session, `noise` what differs from frame to frame.
///
/// # Errors
/// A cut-off beyond half the rate.
pub fn record(
    model: &Model,
    motion: &TrueMotion,
    ticks_per_frame: usize,
    rate_hz: f64,
    spec: &MarkerlessSpec,
    balls_m: &[Vector3<f64>; 2],
    centres: &mut Stream,
    noise: &mut Stream,
) -> Result<SegmentPoses, DesignError> {
    let n_frames = motion.n_ticks() / ticks_per_frame;
    let index = |name: &str| model.links.iter().position(|l| l.name == name);
    let displaced: Vec<Vector3<f64>> = (0..model.n_links()).map(|_| centres.noise() * spec.centre_sd_m).collect();
    // label, link of the axes, link whose joint is the origin, place in the frame of the former
    let mut wanted: Vec<(&str, usize, usize, Vector3<f64>)> = Vec::new();
    for (label, link, at) in SEGMENTS {
        let (Some(link), Some(at)) = (index(link), index(at.unwrap_or(link))) else { continue };
        wanted.push((label, link, at, Vector3::zeros()));
    }
    for ((label, link), ball) in TOES.iter().zip([balls_m[1], balls_m[0]]) {
        let Some(link) = index(link) else { continue };
        wanted.push((label, link, link, ball));
    }
    let mut channels: Vec<Vec<Vec<f64>>> = vec![vec![Vec::new(); 12]; wanted.len()];
    let mut state = State::new(model);
    for frame in 0..n_frames {
        state.forward_position(model, motion.q(frame * ticks_per_frame));
        for ((_, link, at, place), channels) in wanted.iter().zip(&mut channels) {
            // a centre keeps its displacement in the segment above it
            let above = model.links[*at].parent.unwrap_or(*at);
            let base = &state.world_from_link[*at];
            let origin = base.translation.vector
                + base.rotation * place
                + state.world_from_link[above].rotation * displaced[*at]
                + noise.noise() * spec.noise_m;
            let turn = Rotation3::new(noise.noise() * spec.noise_rad);
            let rotation = turn.matrix() * state.world_from_link[*link].rotation.to_rotation_matrix().matrix() * axes();
            let values = rotation.iter().chain(origin.iter());
            channels.iter_mut().zip(values).for_each(|(c, v)| c.push(*v));
        }
    }
    let pass = LowPass { order: 2, cutoff_hz: spec.cutoff_hz, correction: CutoffCorrection::Winter };
    let filter = Butterworth::design(pass, rate_hz)?;
    let segments = wanted
        .iter()
        .zip(channels)
        .map(|((label, ..), mut channels)| {
            for channel in &mut channels {
                filter.filtfilt(channel);
            }
            let matrix = (0..n_frames).map(|f| pose(&channels, f)).collect();
            SegmentTrack { label: format!("{label}_4X4"), matrix, reliability: vec![0.0; n_frames] }
        })
        .collect();
    Ok(SegmentPoses { rate_hz, segments })
}

/// The 4×4 matrix of a frame, translation in mm; smoothed axes are made a rotation again.
fn pose(channels: &[Vec<f64>], frame: usize) -> [f32; 16] {
    let raw = Matrix3::from_iterator((0..9).map(|c| channels[c][frame]));
    let rotation = Rotation3::from_matrix(&raw);
    let mut out = [0.0_f32; 16];
    for column in 0..3 {
        for row in 0..3 {
            out[4 * column + row] = rotation[(row, column)] as f32;
        }
    }
    for (cell, channel) in out[12..15].iter_mut().zip(&channels[9..12]) {
        *cell = (1000.0 * channel[frame]) as f32;
    }
    out[15] = 1.0;
    out
}
