//! Shapes of the dependence of a law's strength on one variable.

/// A parameter of a shape.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShapeParameter {
    /// Name in formulas.
    pub name: &'static str,
    /// Exponent of the variable's unit in the parameter's unit.
    pub power: i32,
    pub lower: f64,
    pub upper: f64,
    /// Change that alters the law noticeably.
    pub scale: f64,
}

/// Range of a variable in the recordings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Quantile 1 %.
    pub low: f64,
    /// Quantile 99 %.
    pub high: f64,
}

impl Range {
    /// Largest absolute value.
    pub fn reach(self) -> f64 {
        self.low.abs().max(self.high.abs()).max(1e-9)
    }
    /// Width.
    pub fn width(self) -> f64 {
        (self.high - self.low).max(1e-9)
    }
}

/// A function of one variable x, linear in one or more coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    /// 1
    Constant,
    /// x
    Linear,
    /// 1, x
    Affine,
    /// x, x²
    Parabola,
    /// |x|ⁿ with the sign of x
    Power,
    /// |x|ⁿ
    EvenPower,
    /// |x − x₀|ⁿ with its sign
    ShiftedPower,
    /// exp(x/L)
    Exponential,
    /// x exp(−x/L)
    Surge,
    /// zero for |x| < x₀, then |x| − x₀ with the sign of x
    DeadZone,
    /// zero below x₀, then x − x₀
    RampUp,
    /// zero above x₀, x₀ − x below
    RampDown,
    /// 0 below x₀, 1 above, over the width w
    Switch,
    /// exp(−((x − x₀)/w)²)
    Bell,
    /// 1/(x² + s²)
    Softened,
    /// sin kx
    Sine,
    /// cos kx, sin kx
    Wave,
    /// 1, cos kx, sin kx
    WaveAbout,
    /// 1 for part of every period, 0 otherwise: k, phase, and the cosine that bounds the part
    Pulses,
    /// Hats over equal steps: a curve through free values
    Curve,
}

/// Width of a pulse's edges, in the cosine.
const PULSE_EDGE: f64 = 0.1;

/// Number of values of a free curve.
pub(crate) const KNOTS: usize = 8;

impl Shape {
    /// Shapes that are tried for a variable.
    pub fn of(signed: bool, distance: bool, periodic: bool) -> Vec<Self> {
        if periodic {
            let odd = signed.then_some(Self::Sine);
            return odd.into_iter().chain([Self::Wave, Self::WaveAbout, Self::Pulses]).collect();
        }
        let mut out = vec![Self::Linear, Self::Affine, Self::Parabola, Self::EvenPower, Self::Exponential];
        if signed {
            out.extend([Self::Power, Self::DeadZone, Self::ShiftedPower, Self::Sine, Self::Wave]);
        } else {
            out.push(Self::Surge);
        }
        if distance {
            out.push(Self::Softened);
        }
        out.extend([Self::RampUp, Self::RampDown, Self::Switch, Self::Bell]);
        out
    }

    /// Number of linear terms.
    pub fn terms(self) -> usize {
        match self {
            Self::Affine | Self::Parabola | Self::Wave => 2,
            Self::WaveAbout => 3,
            Self::Curve => KNOTS,
            _ => 1,
        }
    }

    /// Parameters, with bounds that follow from the range of the variable. `fastest` is the highest
    /// angular frequency that is searched in it, if waves are searched there: the bounds hold it
    /// and what a fit may move it by, a step of the search.
    pub fn parameters(self, range: Range, distance: bool, fastest: Option<f64>) -> Vec<ShapeParameter> {
        let of = |name, power, lower, upper, scale| ShapeParameter { name, power, lower, upper, scale };
        let (a, w) = (range.reach(), range.width());
        let most = fastest.map_or(0.0, |k| k + 3.0 / w).max(400.0 / w);
        let exponent = if distance { of("n", 0, -5.0, 4.0, 0.3) } else { of("n", 0, 0.2, 5.0, 0.3) };
        let threshold = of("x0", 1, range.low, range.high, 0.1 * w);
        match self {
            Self::Constant | Self::Linear | Self::Affine | Self::Parabola | Self::Curve => Vec::new(),
            Self::Power | Self::EvenPower => vec![exponent],
            Self::ShiftedPower => vec![threshold, exponent],
            Self::Exponential => vec![of("rate", -1, -12.0 / w, 12.0 / w, 1.0 / w)],
            Self::Surge => vec![of("peak", 1, 0.02 * a, 3.0 * a, 0.05 * a)],
            Self::DeadZone => vec![of("x0", 1, 0.0, 0.95 * a, 0.1 * a)],
            Self::RampUp | Self::RampDown => vec![threshold],
            Self::Switch => vec![threshold, of("w", 1, 0.005 * w, 0.5 * w, 0.05 * w)],
            Self::Bell => vec![threshold, of("w", 1, 0.03 * w, 2.0 * w, 0.1 * w)],
            Self::Softened => vec![of("s", 1, 0.01, 3.0 * a, 0.1 * a)],
            Self::Sine | Self::Wave | Self::WaveAbout => vec![of("k", -1, 0.3 / w, most, 0.3 / w)],
            Self::Pulses => vec![
                of("k", -1, 0.3 / w, most, 0.3 / w),
                of("phase", 0, -7.0, 7.0, 0.3),
                of("bound", 0, -0.98, 0.98, 0.2),
            ],
        }
    }

    /// Values of the parameters from which a fit starts.
    pub fn starts(self, range: Range, distance: bool) -> Vec<Vec<f64>> {
        let (a, w) = (range.reach(), range.width());
        let at = |share: f64| range.low + share * w;
        let exponents: &[f64] = if distance { &[-3.0, -2.0, -1.0, 0.5, 1.5, 2.0] } else { &[0.5, 1.5, 2.0, 3.0] };
        let places = [0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9];
        match self {
            Self::Constant | Self::Linear | Self::Affine | Self::Parabola | Self::Curve => vec![Vec::new()],
            Self::Power | Self::EvenPower => exponents.iter().map(|n| vec![*n]).collect(),
            Self::ShiftedPower => {
                let pairs = [0.25, 0.4, 0.6, 0.75].iter().flat_map(|s| [1.0, 2.0].map(|n| vec![at(*s), n]));
                pairs.collect()
            }
            Self::Exponential => [-6.0, -3.0, -1.0, 1.0, 3.0, 6.0].iter().map(|r| vec![r / w]).collect(),
            Self::Surge => [0.05, 0.12, 0.3, 0.7].iter().map(|s| vec![s * a]).collect(),
            Self::DeadZone => [0.15, 0.3, 0.5, 0.7].iter().map(|s| vec![s * a]).collect(),
            Self::RampUp | Self::RampDown => places.iter().map(|s| vec![at(*s)]).collect(),
            Self::Switch => places.iter().map(|s| vec![at(*s), 0.04 * w]).collect(),
            Self::Bell => places.iter().flat_map(|s| [0.1, 0.3].map(|b| vec![at(*s), b * w])).collect(),
            Self::Softened => [0.05, 0.2, 0.5].iter().map(|s| vec![s * a]).collect(),
            Self::Sine | Self::Wave | Self::WaveAbout => {
                [2.0, 4.0, 6.0, 9.0, 12.0].iter().map(|k| vec![k / w]).collect()
            }
            Self::Pulses => Vec::new(),
        }
    }

    /// Values of the linear terms at `x`.
    pub fn values(self, x: f64, p: &[f64], range: Range, out: &mut [f64]) {
        let p0 = p.first().copied().unwrap_or(0.0);
        let p1 = p.get(1).copied().unwrap_or(1.0);
        match self {
            Self::Constant => out[0] = 1.0,
            Self::Linear => out[0] = x,
            Self::Affine => (out[0], out[1]) = (1.0, x),
            Self::Parabola => (out[0], out[1]) = (x, x * x),
            Self::Power => out[0] = x.signum() * raised(x.abs(), p0),
            Self::EvenPower => out[0] = raised(x.abs(), p0),
            Self::ShiftedPower => out[0] = (x - p0).signum() * raised((x - p0).abs(), p1),
            Self::Exponential => out[0] = (x * p0).exp(),
            Self::Surge => out[0] = x * (-x / p0).exp(),
            Self::DeadZone => out[0] = x.signum() * (x.abs() - p0).max(0.0),
            Self::RampUp => out[0] = (x - p0).max(0.0),
            Self::RampDown => out[0] = (p0 - x).max(0.0),
            Self::Switch => out[0] = 0.5 * (1.0 + ((x - p0) / p1).tanh()),
            Self::Bell => out[0] = (-((x - p0) / p1).powi(2)).exp(),
            Self::Softened => out[0] = 1.0 / (x * x + p0 * p0),
            Self::Sine => out[0] = (x * p0).sin(),
            Self::Wave => (out[0], out[1]) = ((x * p0).cos(), (x * p0).sin()),
            Self::WaveAbout => (out[0], out[1], out[2]) = (1.0, (x * p0).cos(), (x * p0).sin()),
            Self::Pulses => {
                let bound = p.get(2).copied().unwrap_or(0.0);
                out[0] = 0.5 * (1.0 + (((x * p0 - p1).cos() - bound) / PULSE_EDGE).tanh());
            }
            Self::Curve => {
                let step = range.width() / (KNOTS - 1) as f64;
                let at = ((x - range.low) / step).clamp(0.0, (KNOTS - 1) as f64);
                for (k, y) in out.iter_mut().enumerate() {
                    *y = (1.0 - (at - k as f64).abs()).max(0.0);
                }
            }
        }
    }

    /// The linear terms as formulas of the variable `x`, with the names of the parameters. A
    /// non-integer power is taken of x divided by the constant `one`, which has the unit of x and
    /// the value 1.
    pub fn formulas(self, x: &str, p: &[String], range: Range) -> Vec<String> {
        let p0 = p.first().map_or("", String::as_str);
        let p1 = p.get(1).map_or("", String::as_str);
        match self {
            Self::Constant => vec!["1".to_owned()],
            Self::Linear => vec![x.to_owned()],
            Self::Affine => vec!["1".to_owned(), x.to_owned()],
            Self::Parabola => vec![x.to_owned(), format!("{x}^2")],
            Self::Power => vec![format!("signum({x})*(abs({x})/one)^{p0}")],
            Self::EvenPower => vec![format!("(abs({x})/one)^{p0}")],
            Self::ShiftedPower => vec![format!("signum({x}-{p0})*(abs({x}-{p0})/one)^{p1}")],
            Self::Exponential => vec![format!("exp({p0}*{x})")],
            Self::Surge => vec![format!("{x}*exp(-{x}/{p0})")],
            Self::DeadZone => vec![format!("signum({x})*(abs({x})-{p0}+abs(abs({x})-{p0}))/2")],
            Self::RampUp => vec![format!("({x}-{p0}+abs({x}-{p0}))/2")],
            Self::RampDown => vec![format!("({p0}-{x}+abs({p0}-{x}))/2")],
            Self::Switch => vec![format!("(1+tanh(({x}-{p0})/{p1}))/2")],
            Self::Bell => vec![format!("exp(-(({x}-{p0})/{p1})^2)")],
            Self::Softened => vec![format!("1/({x}^2+{p0}^2)")],
            Self::Sine => vec![format!("sin({p0}*{x})")],
            Self::Wave => vec![format!("cos({p0}*{x})"), format!("sin({p0}*{x})")],
            Self::WaveAbout => vec!["1".to_owned(), format!("cos({p0}*{x})"), format!("sin({p0}*{x})")],
            Self::Pulses => {
                let p2 = p.get(2).map_or("", String::as_str);
                vec![format!("(1+tanh((cos({p0}*{x}-{p1})-{p2})/{PULSE_EDGE}))/2")]
            }
            Self::Curve => {
                // linear interpolation between equal steps, constant outside of them
                let step = range.width() / (KNOTS - 1) as f64;
                let from = |k: usize| format!("abs({x}/one-({}))", range.low + step * k as f64);
                let double = 2.0 * step;
                (0..KNOTS)
                    .map(|k| match k {
                        0 => format!("0.5-({}-{})/{double}", from(0), from(1)),
                        k if k == KNOTS - 1 => format!("0.5+({}-{})/{double}", from(k - 1), from(k)),
                        k => format!("({}-2*{}+{})/{double}", from(k - 1), from(k), from(k + 1)),
                    })
                    .collect()
            }
        }
    }

    /// Exponent of the variable's unit in each linear term; a power with a free exponent counts as
    /// a pure number (see [`Shape::formulas`]).
    pub fn unit_powers(self) -> Vec<i32> {
        match self {
            Self::Linear | Self::Surge | Self::DeadZone | Self::RampUp | Self::RampDown => vec![1],
            Self::Affine => vec![0, 1],
            Self::Parabola => vec![1, 2],
            Self::Softened => vec![-2],
            Self::Wave => vec![0; 2],
            Self::WaveAbout => vec![0; 3],
            Self::Curve => vec![0; KNOTS],
            _ => vec![0],
        }
    }

    /// True if the formulas divide by the constant `one`.
    pub fn needs_unit(self) -> bool {
        matches!(self, Self::Power | Self::EvenPower | Self::ShiftedPower | Self::Curve)
    }

    /// The dependence on `x` in words; `unit` is that of x, `signed` if x takes both signs.
    pub fn describe(self, x: &str, unit: &str, p: &[f64], signed: bool) -> String {
        let p0 = p.first().copied().unwrap_or(f64::NAN);
        let p1 = p.get(1).copied().unwrap_or(f64::NAN);
        let with = |v: f64| match unit {
            "1" => format!("{v:.3}"),
            u => format!("{v:.3} {u}"),
        };
        match self {
            Self::Constant => "of constant size".to_owned(),
            Self::Linear => format!("proportional to {x}"),
            Self::Affine => format!("linear in {x}"),
            Self::Parabola => format!("a parabola in {x} without constant part"),
            Self::Power => format!("with the power {p0:.2} of {x}, with its sign"),
            Self::EvenPower if signed => format!("with the power {p0:.2} of the magnitude of {x}"),
            Self::EvenPower => format!("with the power {p0:.2} of {x}"),
            Self::ShiftedPower => format!("with the power {p1:.2} of the difference of {x} from {}", with(p0)),
            Self::Exponential => {
                let grows = if p0 > 0.0 { "growing" } else { "falling" };
                format!("{grows} by the factor e for every {} of {x}", with(p0.recip().abs()))
            }
            Self::Surge => format!("rising with {x}, greatest at {}, and decaying beyond it", with(p0)),
            Self::DeadZone => format!("in proportion to what {x} exceeds {} by, zero below it", with(p0)),
            Self::RampUp => format!("in proportion to what {x} exceeds {} by, zero below it", with(p0)),
            Self::RampDown => format!("in proportion to what {x} is below {} by, zero above it", with(p0)),
            Self::Switch => format!("switched on where {x} exceeds {}", with(p0)),
            Self::Bell => format!("only where {x} is near {}, within about {}", with(p0), with(p1)),
            Self::Softened => format!("proportional to 1/(d² + s²), d {x}, s {}", with(p0)),
            Self::Sine => format!("as the sine of {x}, period {}", with(2.0 * std::f64::consts::PI / p0)),
            Self::Wave | Self::WaveAbout => {
                format!("periodic in {x}, period {}", with(2.0 * std::f64::consts::PI / p0))
            }
            Self::Pulses => {
                let bound = p.get(2).copied().unwrap_or(0.0);
                format!(
                    "switched on for {:.0} % of every period of {} in {x}",
                    100.0 * bound.clamp(-1.0, 1.0).acos() / std::f64::consts::PI,
                    with(2.0 * std::f64::consts::PI / p0)
                )
            }
            Self::Curve => format!("a curve of {x}"),
        }
    }
}

/// xⁿ for x ≥ 0, finite at zero for every n.
fn raised(x: f64, n: f64) -> f64 {
    match n {
        1.0 => x,
        2.0 => x * x,
        n if n < 0.0 => x.max(1e-3).powf(n),
        n => x.powf(n),
    }
}
