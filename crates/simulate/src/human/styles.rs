//! Flight styles: bumps on joint coordinates that start and end at rest.

use super::stance::PLAN;
use crate::motion::Jet;
use crate::motion::curve::{window, windowed_sine};
use crate::random::Stream;

/// Movement styles of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Knees pulled to the chest.
    Tuck,
    /// Straight legs forward.
    Pike,
    /// One leg forward, one back.
    Split,
    /// Arms and legs apart.
    Star,
    /// Arms swinging in opposition.
    Swing,
    /// Trunk rotation against the hips.
    Twist,
}

/// All styles.
pub const STYLES: [Style; 6] = [Style::Tuck, Style::Pike, Style::Split, Style::Star, Style::Swing, Style::Twist];

impl Style {
    /// Name for the truth file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tuck => "tuck",
            Self::Pike => "pike",
            Self::Split => "split",
            Self::Star => "star",
            Self::Swing => "swing",
            Self::Twist => "twist",
        }
    }
}

/// A bump on one chart coordinate: a window or a windowed sine.
#[derive(Debug, Clone, Copy)]
pub struct Bump {
    /// Chart coordinate.
    pub coordinate: usize,
    /// Height, rad.
    pub amplitude: f64,
    /// Frequency, Hz; zero for a plain window.
    pub frequency_hz: f64,
    /// Phase, rad.
    pub phase: f64,
}

impl Bump {
    /// Adds the bump at `t` of a flight of `duration` to a jet.
    pub fn add(&self, t: f64, duration: f64, jet: &mut Jet) {
        let b = if self.frequency_hz == 0.0 {
            window(t, duration)
        } else {
            windowed_sine(t, duration, self.frequency_hz, self.phase)
        };
        jet.x += self.amplitude * b.x;
        jet.v += self.amplitude * b.v;
        jet.a += self.amplitude * b.a;
    }
}

// chart coordinates (rotation vectors about X anterior, Y up, Z right)
const TORSO: usize = 6;
const HEAD: usize = 9;
const ARM: [usize; 2] = [12, 19];
const ELBOW: [usize; 2] = [15, 22];
const HAND: [usize; 2] = [16, 23];
const HIP: [usize; 2] = [26, 33];
const KNEE: [usize; 2] = [29, 36];
const ANKLE: [usize; 2] = [30, 37];

/// Draws the bumps of a flight.
pub fn bumps(style: Style, vigour: f64, rng: &mut Stream) -> Vec<Bump> {
    let mut out = Vec::new();
    let size = vigour * rng.between(0.85, 1.25);
    let mut plain = |coordinate: usize, amplitude: f64| {
        debug_assert!(coordinate < PLAN);
        out.push(Bump { coordinate, amplitude: amplitude * size, frequency_hz: 0.0, phase: 0.0 });
    };
    match style {
        Style::Tuck => {
            for side in 0..2 {
                plain(HIP[side] + 2, 1.15);
                plain(KNEE[side], -1.2);
                plain(ARM[side] + 2, 0.5);
            }
            plain(TORSO + 2, -0.35);
        }
        Style::Pike => {
            for side in 0..2 {
                plain(HIP[side] + 2, 0.95);
                plain(KNEE[side], -0.15);
                plain(ARM[side] + 2, 0.7);
            }
            plain(TORSO + 2, -0.45);
        }
        Style::Split => {
            let front = usize::from(rng.sign() > 0.0);
            plain(HIP[front] + 2, 0.95);
            plain(KNEE[front], -0.4);
            plain(HIP[1 - front] + 2, -0.35);
            plain(KNEE[1 - front], -0.8);
            plain(ARM[front] + 2, -0.6);
            plain(ARM[1 - front] + 2, 0.6);
        }
        Style::Star => {
            for (side, sign) in [(0, -1.0), (1, 1.0)] {
                plain(HIP[side], sign * 0.5);
                plain(ARM[side], sign * 0.9);
                plain(KNEE[side], -0.3);
            }
        }
        Style::Swing => {
            let sign = rng.sign();
            plain(ARM[0] + 2, sign * 1.2);
            plain(ARM[1] + 2, -sign * 1.2);
            plain(TORSO + 1, sign * 0.3);
            plain(KNEE[0], -0.6);
            plain(KNEE[1], -0.6);
        }
        Style::Twist => {
            let sign = rng.sign();
            plain(TORSO + 1, sign * 0.55);
            plain(HEAD + 1, sign * 0.3);
            plain(ARM[0] + 1, sign * 0.4);
            plain(ARM[1] + 1, sign * 0.4);
            plain(ARM[0], -0.6);
            plain(ARM[1], 0.6);
            plain(KNEE[0], -0.5);
            plain(KNEE[1], -0.5);
        }
    }
    // all other coordinates move slightly as well
    let mut wave = |coordinate: usize, amplitude: f64| {
        out.push(Bump {
            coordinate,
            amplitude: amplitude * vigour * rng.sign() * rng.between(0.5, 1.25),
            frequency_hz: rng.between(1.4, 3.2),
            phase: rng.phase(),
        });
    };
    for axis in 0..3 {
        wave(TORSO + axis, 0.15);
        wave(HEAD + axis, 0.28);
        for side in 0..2 {
            wave(ARM[side] + axis, 0.34);
            wave(HAND[side] + axis, 0.36);
            wave(HIP[side] + axis, if axis == 2 { 0.2 } else { 0.14 });
            wave(ANKLE[side] + axis, if axis == 2 { 0.32 } else { 0.16 });
        }
    }
    for side in 0..2 {
        wave(ELBOW[side], 0.34);
        wave(KNEE[side], 0.10);
    }
    out
}
