//! Three successive rotations about axes of the moving link.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use std::f64::consts::{PI, TAU};

/// An order of three rotations: `R = R(s₀ e_i, q₀) R(s₁ e_j, q₁) R(s₂ e_k, q₂)`, each about an axis
/// of the frame after the preceding rotations. Neighbouring axes differ; the first and the last may
/// be the same (proper Euler angles, such as Y-X-Y).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sequence {
    /// Index of each axis: 0 x, 1 y, 2 z.
    pub axes: [usize; 3],
    /// Sign of each axis.
    pub signs: [f64; 3],
    /// For proper Euler angles: the middle angle is negative by default (the ISB's elevation)
    /// rather than positive.
    pub negative_middle: bool,
}

/// Below this sine the first and the last rotation cannot be separated, and the first angle is
/// kept.
const SINGULAR: f64 = 1e-7;

fn turn(axis: usize, angle: f64) -> Matrix3<f64> {
    let mut e = Vector3::zeros();
    e[axis] = 1.0;
    Rotation3::from_axis_angle(&Unit::new_unchecked(e), angle).into_inner()
}

fn nearest_turn(angle: f64, to: f64) -> f64 {
    angle + TAU * ((to - angle) / TAU).round()
}

impl Sequence {
    /// Rotations about three different axes with signs.
    pub const fn new(axes: [usize; 3], signs: [f64; 3]) -> Self {
        Self { axes, signs, negative_middle: false }
    }

    /// A signed axis as a vector.
    pub fn axis(&self, turn: usize) -> Vector3<f64> {
        let mut e = Vector3::zeros();
        e[self.axes[turn]] = self.signs[turn];
        e
    }

    /// True when the first axis is also the last.
    pub(crate) fn is_proper_euler(&self) -> bool {
        self.axes[0] == self.axes[2]
    }

    /// The axes as letters, `z-x-y`.
    pub fn letters(&self) -> String {
        self.axes.map(|a| ["x", "y", "z"][a]).join("-")
    }

    /// Rotation of angles (rad).
    pub fn matrix(&self, angles: &[f64; 3]) -> Matrix3<f64> {
        let t = |k: usize| turn(self.axes[k], self.signs[k] * angles[k]);
        t(0) * t(1) * t(2)
    }

    /// Distance of the angles from gimbal lock: 1 is farthest, 0 is gimbal lock (|cos| of the
    /// middle angle; |sin| for proper Euler angles).
    pub fn regularity(&self, angles: &[f64; 3]) -> f64 {
        if self.is_proper_euler() { angles[1].sin().abs() } else { angles[1].cos().abs() }
    }

    /// Angles (rad) of a rotation. Of the two equivalent triples, and of whole turns, those nearest
    /// to `previous` are taken; without it the usual ones (middle angle within ±90°; for proper
    /// Euler angles of the given sign).
    pub fn angles(&self, r: &Matrix3<f64>, previous: Option<&[f64; 3]>) -> [f64; 3] {
        let [i, j, _] = self.axes;
        let k = 3 - i - j;
        // +1 where (i, j, k) is a cyclic order
        let e = if (j + 3 - i) % 3 == 1 { 1.0 } else { -1.0 };
        let (mut plain, sine) = if self.is_proper_euler() {
            let sine = r[(j, i)].hypot(r[(k, i)]);
            let b = sine.atan2(r[(i, i)]);
            ([r[(j, i)].atan2(-e * r[(k, i)]), b, r[(i, j)].atan2(e * r[(i, k)])], sine)
        } else {
            let cosine = r[(i, i)].hypot(r[(i, j)]);
            let b = (e * r[(i, k)]).atan2(cosine);
            ([(-e * r[(j, k)]).atan2(r[(k, k)]), b, (-e * r[(i, j)]).atan2(r[(i, i)])], cosine)
        };
        if sine < SINGULAR {
            // keep the first angle; the last one takes the remaining rotation
            plain[0] = previous.map_or(0.0, |p| self.signs[0] * p[0]);
            let rest = (turn(i, plain[0]) * turn(j, plain[1])).transpose() * r;
            let last = self.axes[2];
            let (u, v) = ((last + 1) % 3, (last + 2) % 3);
            plain[2] = rest[(v, u)].atan2(rest[(u, u)]);
        }
        let signed = |a: [f64; 3]| [self.signs[0] * a[0], self.signs[1] * a[1], self.signs[2] * a[2]];
        let first = signed(plain);
        let middle = if self.is_proper_euler() { -plain[1] } else { PI - plain[1] };
        let other = signed([plain[0] + PI, middle, plain[2] + PI]);
        let wrapped = |a: [f64; 3], to: &[f64; 3]| std::array::from_fn(|n| nearest_turn(a[n], to[n]));
        match previous {
            Some(p) => {
                let (a, b): ([f64; 3], [f64; 3]) = (wrapped(first, p), wrapped(other, p));
                let far = |x: &[f64; 3]| x.iter().zip(p).map(|(x, p)| (x - p).abs()).fold(0.0, f64::max);
                if far(&a) <= far(&b) { a } else { b }
            }
            None => {
                let turned = self.is_proper_euler() && (first[1] > 0.0) == self.negative_middle && first[1] != 0.0;
                wrapped(if turned { other } else { first }, &[0.0; 3])
            }
        }
    }

    /// The matrix J with `ω = J q̇`, ω in the axes of the moving link.
    pub(crate) fn velocity_matrix(&self, angles: &[f64; 3]) -> Matrix3<f64> {
        let t = |k: usize| turn(self.axes[k], self.signs[k] * angles[k]).transpose();
        let last = t(2);
        Matrix3::from_columns(&[last * t(1) * self.axis(0), last * self.axis(1), self.axis(2)])
    }

    /// Rates and accelerations (rad/s, rad/s²) from angular velocity and acceleration in the axes
    /// of the moving link; NaN in gimbal lock.
    pub fn rates(&self, angles: &[f64; 3], omega: &Vector3<f64>, alpha: &Vector3<f64>) -> ([f64; 3], [f64; 3]) {
        let j = self.velocity_matrix(angles);
        let Some(inverse) = (self.regularity(angles) > SINGULAR).then(|| j.try_inverse()).flatten() else {
            return ([f64::NAN; 3], [f64::NAN; 3]);
        };
        let rates = inverse * omega;
        // Each axis rotates with the frames after it: d/dt (Rᵀ a) = −w × (Rᵀ a).
        let (c0, c1, c2) = (j.column(0).into_owned(), j.column(1).into_owned(), j.column(2).into_owned());
        let behind_1 = c2 * rates[2];
        let behind_0 = behind_1 + c1 * rates[1];
        let drift = -behind_0.cross(&c0) * rates[0] - behind_1.cross(&c1) * rates[1];
        (rates.into(), (inverse * (alpha - drift)).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [[usize; 3]; 12] = [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
        [0, 1, 0],
        [0, 2, 0],
        [1, 0, 1],
        [1, 2, 1],
        [2, 0, 2],
        [2, 1, 2],
    ];
    const SIGNS: [[f64; 3]; 4] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]];

    #[test]
    fn angles_give_the_rotation_back_for_all_orders_and_signs() {
        for axes in ALL {
            for signs in SIGNS {
                let s = Sequence::new(axes, signs);
                for n in 0..200 {
                    let x = f64::from(n);
                    let angles = [(1.7 * x).sin() * 3.0, (0.9 * x + 0.4).cos() * 1.5, (2.3 * x).cos() * 3.0];
                    let r = s.matrix(&angles);
                    let found = s.angles(&r, None);
                    assert!((s.matrix(&found) - r).norm() < 1e-12, "{axes:?} {angles:?}");
                    let near = s.angles(&r, Some(&angles));
                    for k in 0..3 {
                        assert!((near[k] - angles[k]).abs() < 1e-6 || s.regularity(&angles) < 1e-5, "{axes:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_path_through_gimbal_lock_and_whole_turns_stays_continuous() {
        for s in [Sequence::new([2, 0, 1], [1.0, -1.0, -1.0]), Sequence::new([1, 0, 1], [1.0; 3])] {
            let path = |t: f64| [0.3 + 7.0 * t, 4.0 * t - 0.5003, 0.2 - 9.0 * t];
            let mut last = path(0.0);
            for n in 1..=2000 {
                let truth = path(f64::from(n) / 2000.0);
                last = s.angles(&s.matrix(&truth), Some(&last));
                assert!((s.matrix(&last) - s.matrix(&truth)).norm() < 1e-12);
                for k in 0..3 {
                    assert!((last[k] - truth[k]).abs() < 1e-5, "{n}: {last:?} {truth:?}");
                }
            }
        }
    }

    #[test]
    fn in_gimbal_lock_the_rotation_is_still_right() {
        for axes in ALL {
            let s = Sequence::new(axes, [1.0, -1.0, 1.0]);
            let lock = if s.is_proper_euler() { [0.0, PI] } else { [PI / 2.0, -PI / 2.0] };
            for b in lock {
                let r = s.matrix(&[0.7, b, -1.1]);
                for previous in [None, Some([0.6, b, -1.0])] {
                    let found = s.angles(&r, previous.as_ref());
                    assert!((s.matrix(&found) - r).norm() < 1e-7, "{axes:?} {found:?}");
                }
                assert!(s.rates(&[0.7, b, -1.1], &Vector3::x(), &Vector3::y()).0[0].is_nan());
            }
        }
    }

    #[test]
    fn rates_are_the_derivatives_of_the_angles() {
        let path = |t: f64| [0.4 * (3.0 * t).sin(), 0.6 + 0.5 * t, 1.1 * (2.0 * t).cos()];
        for axes in ALL {
            let s = Sequence::new(axes, [-1.0, 1.0, -1.0]);
            let (t, h) = (0.3, 1e-4);
            let omega = |t: f64| {
                let r = (s.matrix(&path(t + h)) - s.matrix(&path(t - h))) / (2.0 * h);
                let w = s.matrix(&path(t)).transpose() * r;
                Vector3::new(w[(2, 1)] - w[(1, 2)], w[(0, 2)] - w[(2, 0)], w[(1, 0)] - w[(0, 1)]) / 2.0
            };
            let alpha = (omega(t + h) - omega(t - h)) / (2.0 * h);
            let (rates, accelerations) = s.rates(&path(t), &omega(t), &alpha);
            for k in 0..3 {
                let d1 = (path(t + h)[k] - path(t - h)[k]) / (2.0 * h);
                let d2 = (path(t + h)[k] - 2.0 * path(t)[k] + path(t - h)[k]) / (h * h);
                assert!((rates[k] - d1).abs() < 1e-6, "{axes:?} {k}");
                assert!((accelerations[k] - d2).abs() < 1e-4, "{axes:?} {k}: {} {d2}", accelerations[k]);
            }
        }
    }

    #[test]
    fn validate_isb_shoulder_against_words() {
        // Wu et al. 2005: 0° is abduction, 90° forward flexion; elevation is negative; at rest the
        // arm hangs along −y.
        let s = Sequence { negative_middle: true, ..Sequence::new([1, 0, 1], [1.0; 3]) };
        let arm = |plane: f64, elevation: f64| s.matrix(&[plane, elevation, 0.0]) * -Vector3::y();
        assert!((arm(0.0, -PI / 2.0) - Vector3::z()).norm() < 1e-12, "abduction points to the right");
        assert!((arm(PI / 2.0, -PI / 2.0) - Vector3::x()).norm() < 1e-12, "flexion points forward");
        assert!(s.angles(&s.matrix(&[0.2, -0.9, 0.1]), None)[1] < 0.0);
    }
}
