//! A law as an effect: a force or couple on one place, in one direction, with a strength that is a
//! product of functions of variables.

use super::kinematics::{Action, Carrier, Direction, Instant, Variable};
use super::shape::{Range, Shape, ShapeParameter};
use aloft_body::Model;
use aloft_effects::{
    About, ActsIn, Coefficient, Columns, Effect, EffectFrame, NonlinearParameter, ParameterKind, Scene, Series, Target,
};
use nalgebra::Vector3;

/// One factor of the strength.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Factor {
    pub variable: Variable,
    pub shape: Shape,
    pub range: Range,
    /// Values of the shape's parameters if they are not fitted.
    pub fixed: Option<Vec<f64>>,
}

impl Factor {
    fn is_distance(&self) -> bool {
        self.variable == Variable::Distance
    }

    /// Parameters of the shape, with their bounds in this variable.
    pub fn parameters(&self) -> Vec<ShapeParameter> {
        self.shape.parameters(self.range, self.is_distance(), self.variable.fastest())
    }
}

/// A law with free coefficients and parameters. Nonlinear parameters in this order: the point on
/// the link (if free), the anchor (if the direction needs one), the parameters of each factor, the
/// delay (if there is one).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Law {
    pub id: String,
    pub carrier: Carrier,
    pub action: Action,
    pub direction: Direction,
    /// Components of the direction that have a coefficient.
    pub components: Vec<usize>,
    /// At most one factor has several linear terms.
    pub factors: Vec<Factor>,
    /// Point on the link, link frame, m: start of a free point, or the point itself.
    pub point: Vector3<f64>,
    pub point_is: PointIs,
    /// Numbers that are added to the variable of each factor; empty for none. Draws of the geometry
    /// move the zeros of joints.
    pub zeros: Vec<f64>,
    /// True if it follows the motion late: the delay is its last nonlinear parameter.
    pub delayed: bool,
}

/// A frame in which a law acts, and the motion that it follows there.
pub(crate) struct LawFrame<'s> {
    /// The law's place in this frame.
    pub now: Instant,
    /// The frames whose motion it follows, with its place in them and their shares: this frame, or
    /// the two between which the motion was a delay earlier.
    pub then: [(EffectFrame<'s>, Instant, f64); 2],
}

/// What is known of the point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum PointIs {
    /// Given, or of no meaning (a couple, the centre of mass of the body).
    Given,
    /// Three unknown coordinates in the link.
    Free,
    /// Two unknown coordinates along these unit vectors of the link, from `point`: a force that
    /// keeps its direction in the link may slide along its line of action.
    OnPlane([Vector3<f64>; 2]),
}

impl PointIs {
    /// Number of nonlinear parameters.
    pub fn unknowns(self) -> usize {
        match self {
            Self::Given => 0,
            Self::Free => 3,
            Self::OnPlane(_) => 2,
        }
    }
}

/// Name of the delay.
pub(crate) const DELAY: &str = "delay";
/// Longest delay of a law, s.
const LONGEST_DELAY_S: f64 = 0.3;
/// Distance from the link's centre of mass within which a point is searched, m.
pub(crate) const POINT_REACH_M: f64 = 0.4;

impl Law {
    /// True if the law needs a point in the world.
    pub fn has_anchor(&self) -> bool {
        self.direction == Direction::Towards || self.factors.iter().any(Factor::is_distance)
    }

    /// The law with the zeros of its joints moved by numbers in the order of velocities; none if it
    /// depends on no joint's angle.
    pub fn with_zeros(&self, model: &Model, moved: &[f64]) -> Option<Self> {
        let of = |f: &Factor| match f.variable {
            Variable::JointAngle(link) => moved.get(model.links[link].joint.v_offset).copied(),
            _ => None,
        };
        let zeros: Vec<Option<f64>> = self.factors.iter().map(of).collect();
        zeros
            .iter()
            .any(Option::is_some)
            .then(|| Self { zeros: zeros.into_iter().map(|z| z.unwrap_or(0.0)).collect(), ..self.clone() })
    }

    /// The delay among the nonlinear parameters, s.
    pub fn delay(&self, nonlinear: &[f64]) -> Option<f64> {
        nonlinear.last().copied().filter(|_| self.delayed)
    }

    /// Frame `i` of a series and the motion that the law follows there; `frame` is the frame
    /// itself.
    pub fn at<'s>(
        &self,
        series: &'s Series<'_>,
        i: usize,
        frame: &EffectFrame<'s>,
        point: &Vector3<f64>,
        delay: Option<f64>,
    ) -> LawFrame<'s> {
        let now = Instant::of(frame, self.carrier, point);
        let then = match delay {
            None => [(*frame, now, 1.0), (*frame, now, 0.0)],
            Some(delay) => series.earlier(i, delay).map(|(f, share)| (f, Instant::of(&f, self.carrier, point), share)),
        };
        LawFrame { now, then }
    }

    /// Splits the nonlinear parameters: point, anchor, parameters of each factor.
    pub fn divided<'v>(&self, mut rest: &'v [f64]) -> (Vector3<f64>, Vector3<f64>, Vec<&'v [f64]>) {
        let point = match self.point_is {
            PointIs::Free if rest.len() >= 3 => Vector3::from_column_slice(&rest[..3]),
            PointIs::OnPlane([a, b]) if rest.len() >= 2 => self.point + a * rest[0] + b * rest[1],
            _ => self.point,
        };
        rest = &rest[self.point_is.unknowns().min(rest.len())..];
        let anchor = match rest {
            [x, y, z, ..] if self.has_anchor() => Vector3::new(*x, *y, *z),
            _ => Vector3::zeros(),
        };
        rest = &rest[if self.has_anchor() { 3.min(rest.len()) } else { 0 }..];
        let mut parts = Vec::new();
        for f in &self.factors {
            let n = if f.fixed.is_some() { 0 } else { f.parameters().len() };
            let (head, tail) = rest.split_at(n.min(rest.len()));
            parts.push(head);
            rest = tail;
        }
        (point, anchor, parts)
    }

    /// Parameters of each factor, fixed or fitted.
    pub fn parameters_of<'v>(&'v self, parts: &[&'v [f64]]) -> Vec<&'v [f64]> {
        self.factors.iter().zip(parts).map(|(f, p)| f.fixed.as_deref().unwrap_or(p)).collect()
    }

    /// Number of linear terms.
    pub fn terms(&self) -> usize {
        self.factors.iter().map(|f| f.shape.terms()).product()
    }

    /// Number of unknowns: what parsimony counts.
    pub fn unknowns(&self, scene: &Scene) -> usize {
        self.components.len() * self.terms() + self.nonlinear(scene, Target::Body).len()
    }

    /// Values of all linear terms in a frame; `parameters` are those of
    /// [`parameters_of`](Self::parameters_of).
    pub fn strengths(
        &self,
        frame: &EffectFrame<'_>,
        at: &Instant,
        anchor: &Vector3<f64>,
        parameters: &[&[f64]],
        out: &mut Vec<f64>,
    ) {
        out.clear();
        out.push(1.0);
        let mut values = [0.0; super::shape::KNOTS];
        for (i, (f, p)) in self.factors.iter().zip(parameters).enumerate() {
            let n = f.shape.terms();
            let zero = self.zeros.get(i).copied().unwrap_or(0.0);
            f.shape.values(f.variable.value(frame, at, anchor) + zero, p, f.range, &mut values[..n]);
            // every term so far times every one of this factor, from the last one on in its place
            let before = out.len();
            out.resize(before * n, 0.0);
            for b in (0..before).rev() {
                let term = out[b];
                out[b * n..(b + 1) * n].iter_mut().zip(&values).for_each(|(x, v)| *x = term * v);
            }
        }
    }

    /// Names of linear terms.
    pub fn term_name(&self, term: usize) -> String {
        if self.terms() == 1 {
            "f".to_owned()
        } else if self.terms() <= 4 {
            ["f", "g", "h", "l"][term].to_owned()
        } else {
            format!("f{term}")
        }
    }

    /// Name of the coefficient of a term and a component.
    pub fn coefficient_name(&self, term: usize, component: usize) -> String {
        if self.direction.components() == 1 {
            self.term_name(term)
        } else {
            format!("{}_{}", self.term_name(term), ["x", "y", "z"][component])
        }
    }

    /// Unit of the coefficient of a linear term.
    pub fn coefficient_unit(&self, scene: &Scene, term: usize) -> String {
        let mut unit = match self.action {
            Action::Force => "N".to_owned(),
            Action::Couple => "N*m".to_owned(),
        };
        if self.direction == Direction::SpinCrossVelocity {
            unit.push_str("*s^2/m");
        }
        let mut left = term;
        for f in self.factors.iter().rev() {
            let n = f.shape.terms();
            let power = f.shape.unit_powers()[left % n];
            left /= n;
            let of = f.variable.unit(scene);
            if of != "1" && power != 0 {
                let (sign, base) = if power > 0 { ("/", of) } else { ("*", of) };
                unit.push_str(&format!("{sign}({base})^{}", power.abs()));
            }
        }
        simplified(&unit)
    }
}

/// A unit with the parentheses of its parts resolved: `N/(m/s)^2` to `N*s^2/m^2`.
fn simplified(text: &str) -> String {
    text.replace("/(m/s)^1", "*s/m")
        .replace("/(m/s)^2", "*s^2/m^2")
        .replace("*(m/s)^2", "*m^2/s^2")
        .replace("/(1/s)^1", "*s")
        .replace("/(1/s)^2", "*s^2")
        .replace("*(1/s)^2", "/s^2")
        .replace("/(m)^1", "/m")
        .replace("/(m)^2", "/m^2")
        .replace("*(m)^2", "*m^2")
        .replace("/(s)^1", "/s")
        .replace("/(s)^2", "/s^2")
        .replace("*(s)^2", "*s^2")
}

impl Effect for Law {
    fn about(&self) -> About<'_> {
        About { id: &self.id, title: "law found on the recordings", acts: ActsIn::Both, ..About::PLAIN }
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        vec![Target::Body]
    }
    fn coefficients(&self, scene: &Scene, _: Target) -> Vec<Coefficient> {
        let mut out = Vec::new();
        for term in 0..self.terms() {
            for &k in &self.components {
                let mut c = Coefficient::free(self.coefficient_name(term, k), &self.coefficient_unit(scene, term));
                if self.components.len() == 3 {
                    c.kind = match self.direction {
                        Direction::World | Direction::AcrossVelocity => ParameterKind::VectorInWorld(k),
                        _ => ParameterKind::VectorOnLink(k),
                    };
                }
                out.push(c);
            }
        }
        out
    }
    fn nonlinear(&self, scene: &Scene, _: Target) -> Vec<NonlinearParameter> {
        let mut out = Vec::new();
        match self.point_is {
            PointIs::Given => {}
            PointIs::Free => {
                let centre = scene.link_com_m[self.carrier.link()];
                out.extend(NonlinearParameter::point_on_link("point", &centre, POINT_REACH_M));
            }
            PointIs::OnPlane(_) => {
                let of = |name| NonlinearParameter::new(name, "m", -POINT_REACH_M, POINT_REACH_M, 0.2 * POINT_REACH_M);
                out.extend(["offset_1", "offset_2"].map(of));
            }
        }
        if self.has_anchor() {
            out.extend(NonlinearParameter::point_in_world("anchor", &scene.volume_centre_m, 6.0));
        }
        for (i, f) in self.factors.iter().enumerate().filter(|(_, f)| f.fixed.is_none()) {
            for p in f.parameters() {
                let base = f.variable.unit(scene);
                let unit = match (p.power, base) {
                    (0, _) | (_, "1") => "1".to_owned(),
                    (1, b) => b.to_owned(),
                    (_, "s") => "1/s".to_owned(),
                    (_, "m") => "1/m".to_owned(),
                    (_, "m/s") => "s/m".to_owned(),
                    (_, "1/s") => "s".to_owned(),
                    (n, b) => format!("({b})^{n}"),
                };
                out.push(NonlinearParameter::new(factor_name(i, p.name), &unit, p.lower, p.upper, p.scale));
            }
        }
        if self.delayed {
            out.push(NonlinearParameter::new(DELAY, "s", 0.0, LONGEST_DELAY_S, 0.02));
        }
        out
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, nonlinear: &[f64], out: &mut Columns) {
        let (point, anchor, parts) = self.divided(nonlinear);
        let parameters = self.parameters_of(&parts);
        let delay = self.delay(nonlinear);
        let mut strengths = Vec::new();
        for (i, frame) in series.instants() {
            let LawFrame { now, then } = self.at(series, i, &frame, &point, delay);
            for (of, at, share) in then.iter().filter(|(_, _, share)| *share != 0.0) {
                self.strengths(of, at, &anchor, &parameters, &mut strengths);
                let mut column = 0;
                for s in &strengths {
                    for &k in &self.components {
                        let v = self.direction.vector_of(k, at, &now, &anchor) * (s * share);
                        match self.action {
                            Action::Force => out.force_at(i, column, &v, &now.position),
                            Action::Couple => out.couple(i, column, &v),
                        }
                        column += 1;
                    }
                }
            }
        }
    }
}

/// Name of a factor's parameter: with a number for all factors but the first.
pub(crate) fn factor_name(factor: usize, name: &str) -> String {
    if factor == 0 { name.to_owned() } else { format!("{name}_{}", factor + 1) }
}

#[cfg(test)]
mod tests {
    use super::super::shape::Shape;
    use super::*;

    /// A force that pulses at 4.7 Hz was found in recordings of 17 s, and its frequency was beyond
    /// the bounds of its law.
    #[test]
    fn regress_the_bounds_of_a_wave_hold_every_frequency_that_is_searched() {
        for (variable, slowest) in
            [(Variable::Clock, 0.15 * 2.0 * std::f64::consts::PI), (Variable::JointAngle(1), 0.0)]
        {
            let fastest = variable.fastest().unwrap_or(0.0);
            for width in [0.4, 3.0, 17.0, 90.0, 1200.0] {
                for shape in [Shape::Sine, Shape::Wave, Shape::WaveAbout, Shape::Pulses] {
                    let range = Range { low: 0.0, high: width };
                    let k = Factor { variable, shape, range, fixed: None }.parameters().remove(0);
                    assert!(k.lower <= slowest.max(2.5 / width), "{shape:?} over {width}: from {}", k.lower);
                    assert!(k.upper > fastest, "{shape:?} over {width}: to {}", k.upper);
                }
            }
        }
    }
}
