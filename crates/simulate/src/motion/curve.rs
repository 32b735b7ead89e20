//! Smooth curves of one variable from which contact and flight are built: quintic pieces, quintic
//! splines, windows.

/// Value, rate and acceleration of a scalar.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Jet {
    /// Value.
    pub x: f64,
    /// First derivative by time.
    pub v: f64,
    /// Second derivative by time.
    pub a: f64,
}

impl Jet {
    /// A value at rest.
    pub fn rest(x: f64) -> Self {
        Self { x, v: 0.0, a: 0.0 }
    }
}

/// A polynomial of fifth degree on `[0, duration]` with given value, rate and acceleration at both
/// ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quintic {
    coefficients: [f64; 6],
    duration: f64,
}

impl Quintic {
    /// The piece from `start` to `end`; `duration` in seconds, positive.
    pub fn new(start: Jet, end: Jet, duration: f64) -> Self {
        let t = duration;
        let (p0, v0, a0) = (start.x, start.v * t, start.a * t * t);
        let (p1, v1, a1) = (end.x, end.v * t, end.a * t * t);
        let d = p1 - p0;
        Self {
            coefficients: [
                p0,
                v0,
                0.5 * a0,
                10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
                -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
                6.0 * d - 3.0 * v0 - 3.0 * v1 - 0.5 * a0 + 0.5 * a1,
            ],
            duration: t,
        }
    }

    /// Evaluates at `t` seconds after the start; outside the piece the polynomial is extrapolated.
    pub fn at(&self, t: f64) -> Jet {
        let s = t / self.duration;
        let c = &self.coefficients;
        let x = c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5]))));
        let v = c[1] + s * (2.0 * c[2] + s * (3.0 * c[3] + s * (4.0 * c[4] + s * 5.0 * c[5])));
        let a = 2.0 * c[2] + s * (6.0 * c[3] + s * (12.0 * c[4] + s * 20.0 * c[5]));
        Jet { x, v: v / self.duration, a: a / (self.duration * self.duration) }
    }

    /// Duration, s.
    pub fn duration(&self) -> f64 {
        self.duration
    }
}

/// Quintic pieces one after another, each with its own two boundary jets: C² where the jets agree.
#[derive(Debug, Clone, Default)]
pub struct Piecewise {
    starts: Vec<f64>,
    pieces: Vec<Quintic>,
}

impl Piecewise {
    /// Through `(time, jet)` in increasing time; with one knot the curve is constant.
    pub fn through(knots: &[(f64, Jet)]) -> Self {
        let mut curve = Self::default();
        for pair in knots.windows(2) {
            curve.starts.push(pair[0].0);
            curve.pieces.push(Quintic::new(pair[0].1, pair[1].1, (pair[1].0 - pair[0].0).max(1e-6)));
        }
        if let (true, Some((t, jet))) = (curve.pieces.is_empty(), knots.first()) {
            curve.starts.push(*t);
            curve.pieces.push(Quintic::new(*jet, *jet, 1.0));
        }
        curve
    }

    /// Evaluates at time `t`; before the first and after the last knot the outer pieces are
    /// extrapolated.
    pub fn at(&self, t: f64) -> Jet {
        let i = self.starts.partition_point(|s| *s <= t).saturating_sub(1);
        self.pieces.get(i).map_or_else(Jet::default, |piece| piece.at(t - self.starts[i]))
    }
}

/// A vector-valued quintic spline (C⁴) through equally spaced knots, value, rate and acceleration
/// given at both ends.
#[derive(Debug, Clone)]
pub struct Spline {
    start: f64,
    step: f64,
    width: usize,
    /// `[knot][coordinate]`
    jets: Vec<Jet>,
}

impl Spline {
    /// `values[knot * width + i]` at `start + knot·step`; `first` and `last` give rates and
    /// accelerations at the ends (their values must be the first and last row). At least two knots.
    pub fn new(start: f64, step: f64, width: usize, values: &[f64], first: &[Jet], last: &[Jet]) -> Self {
        let n = values.len() / width;
        let mut jets: Vec<Jet> = values.iter().map(|x| Jet::rest(*x)).collect();
        // In units of the step, continuity of the third and fourth derivative at an inner knot,
        // with v and a unknown: v: 24 v₋ + 72·0 … (derived from the Hermite form of the quintic;
        // both are linear in neighbouring v and a) third: −24 v₋ − 3 a₋ + 0·v + 18 a + 24 v₊ − 3 a₊
        // = 60 (p₊ − 2p + p₋) fourth: 168 v₋ + 24 a₋ + 384 v + 0·a + 168 v₊ − 24 a₊ = 360 (p₊ − p₋)
        let (lower, diagonal, upper) =
            ([[-24.0, -3.0], [168.0, 24.0]], [[0.0, 18.0], [384.0, 0.0]], [[24.0, -3.0], [168.0, -24.0]]);
        let inner = n.saturating_sub(2);
        // block elimination: the factors are the same for every coordinate
        let mut gain = vec![[[0.0; 2]; 2]; inner];
        let mut pivot_inverse = vec![[[0.0; 2]; 2]; inner];
        for k in 0..inner {
            let mut pivot = diagonal;
            if k > 0 {
                pivot = subtract(&pivot, &multiply(&lower, &gain[k - 1]));
            }
            pivot_inverse[k] = invert(&pivot);
            gain[k] = multiply(&pivot_inverse[k], &upper);
        }
        let mut solution = vec![[0.0; 2]; inner];
        for i in 0..width {
            let scaled = |jet: &Jet| [jet.v * step, jet.a * step * step];
            let (head, tail) = (scaled(&first[i]), scaled(&last[i]));
            let p = |knot: usize| values[knot * width + i];
            for k in 0..inner {
                let (p0, p1, p2) = (p(k), p(k + 1), p(k + 2));
                let mut rhs = [60.0 * (p2 - 2.0 * p1 + p0), 360.0 * (p2 - p0)];
                let before = if k == 0 { head } else { solution[k - 1] };
                let take = apply(&lower, &before);
                rhs = [rhs[0] - take[0], rhs[1] - take[1]];
                if k + 1 == inner {
                    let take = apply(&upper, &tail);
                    rhs = [rhs[0] - take[0], rhs[1] - take[1]];
                }
                solution[k] = apply(&pivot_inverse[k], &rhs);
            }
            for k in (0..inner).rev() {
                if k + 1 < inner {
                    let take = apply(&gain[k], &solution[k + 1]);
                    solution[k] = [solution[k][0] - take[0], solution[k][1] - take[1]];
                }
                let jet = &mut jets[(k + 1) * width + i];
                (jet.v, jet.a) = (solution[k][0] / step, solution[k][1] / (step * step));
            }
            (jets[i].v, jets[i].a) = (first[i].v, first[i].a);
            let end = &mut jets[(n - 1) * width + i];
            (end.v, end.a) = (last[i].v, last[i].a);
        }
        Self { start, step, width, jets }
    }

    /// All coordinates at time `t`.
    pub fn at(&self, t: f64, out: &mut [Jet]) {
        let n = self.jets.len() / self.width;
        let k = (((t - self.start) / self.step).floor().max(0.0) as usize).min(n - 2);
        let local = t - self.start - k as f64 * self.step;
        for (i, jet) in out.iter_mut().enumerate().take(self.width) {
            *jet =
                Quintic::new(self.jets[k * self.width + i], self.jets[(k + 1) * self.width + i], self.step).at(local);
        }
    }
}

type Block = [[f64; 2]; 2];

fn multiply(a: &Block, b: &Block) -> Block {
    let e = |i: usize, j: usize| a[i][0] * b[0][j] + a[i][1] * b[1][j];
    [[e(0, 0), e(0, 1)], [e(1, 0), e(1, 1)]]
}
fn subtract(a: &Block, b: &Block) -> Block {
    [[a[0][0] - b[0][0], a[0][1] - b[0][1]], [a[1][0] - b[1][0], a[1][1] - b[1][1]]]
}
fn apply(a: &Block, x: &[f64; 2]) -> [f64; 2] {
    [a[0][0] * x[0] + a[0][1] * x[1], a[1][0] * x[0] + a[1][1] * x[1]]
}
fn invert(a: &Block) -> Block {
    let d = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    [[a[1][1] / d, -a[0][1] / d], [-a[1][0] / d, a[0][0] / d]]
}

/// `64 s³(1−s)³` on `[0, 1]`: one in the middle, and zero at both ends with two derivatives. Jet
/// with respect to `t = s·duration`.
pub fn window(t: f64, duration: f64) -> Jet {
    let s = t / duration;
    if !(0.0..=1.0).contains(&s) {
        return Jet::default();
    }
    let r = 1.0 - s;
    let (p, d) = (s * r, r - s);
    Jet { x: 64.0 * p * p * p, v: 192.0 * p * p * d / duration, a: 384.0 * p * (d * d - p) / (duration * duration) }
}

/// `window · sin(2π f t + phase)`.
pub fn windowed_sine(t: f64, duration: f64, frequency_hz: f64, phase: f64) -> Jet {
    let w = window(t, duration);
    let rate = 2.0 * std::f64::consts::PI * frequency_hz;
    let (sin, cos) = (rate * t + phase).sin_cos();
    Jet {
        x: w.x * sin,
        v: w.v * sin + w.x * rate * cos,
        a: w.a * sin + 2.0 * w.v * rate * cos - w.x * rate * rate * sin,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quintic_meets_its_ends() {
        let (a, b) = (Jet { x: 1.0, v: -2.0, a: 3.0 }, Jet { x: -0.5, v: 0.7, a: -9.0 });
        let q = Quintic::new(a, b, 0.37);
        for (t, want) in [(0.0, a), (0.37, b)] {
            let got = q.at(t);
            assert!((got.x - want.x).abs() + (got.v - want.v).abs() + (got.a - want.a).abs() < 1e-11);
        }
    }

    #[test]
    fn spline_reproduces_smooth_functions_with_high_order() {
        let f = |t: f64| Jet { x: (3.0 * t).sin(), v: 3.0 * (3.0 * t).cos(), a: -9.0 * (3.0 * t).sin() };
        let error = |n: usize| {
            let step = 1.0 / n as f64;
            let values: Vec<f64> = (0..=n).map(|k| f(0.2 + k as f64 * step).x).collect();
            let spline = Spline::new(0.2, step, 1, &values, &[f(0.2)], &[f(1.2)]);
            let mut worst = 0.0f64;
            for k in 0..1000 {
                let t = 0.2 + k as f64 / 1000.0;
                let mut out = [Jet::default()];
                spline.at(t, &mut out);
                worst = worst.max((out[0].x - f(t).x).abs());
            }
            worst
        };
        let (coarse, fine) = (error(10), error(20));
        assert!(fine < 1e-8 && coarse / fine > 40.0, "{coarse:e} {fine:e}: sixth order expected");
    }

    #[test]
    fn windowed_sine_derivatives() {
        let h = 1e-5;
        for t in [0.05, 0.2, 0.41] {
            let f = |t| windowed_sine(t, 0.5, 3.0, 0.4);
            let (m, c, p) = (f(t - h), f(t), f(t + h));
            assert!(((p.x - m.x) / (2.0 * h) - c.v).abs() < 1e-5 && ((p.v - m.v) / (2.0 * h) - c.a).abs() < 1e-3);
        }
        assert_eq!(windowed_sine(0.0, 0.5, 3.0, 0.4).x, 0.0);
    }
}
