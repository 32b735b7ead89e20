//! A fitted law as an effect of the user's own: formulas with units, as a file that a pipeline can
//! name.

use super::kinematics::{Action, Carrier, Direction};
use super::law::{DELAY, Factor, Law, factor_name};
use super::shape::{KNOTS, Shape};
use crate::wording::digits;
use aloft_effects::{
    ActsIn, Effect, EffectKind, FormulaAxes, FormulaCoefficient, FormulaConstant, FormulaDefinition, FormulaEffect,
    FormulaParameter, FormulaPoint, Scene, Target,
};

/// Speeds and rates below this have no direction, m/s and rad/s.
const STILL: f64 = 1e-9;

impl Law {
    /// The law as formulas, with the values of its nonlinear parameters as starts. `documentation`
    /// is Markdown with the evidence.
    pub fn formula(&self, scene: &Scene, nonlinear: &[f64], documentation: String) -> FormulaEffect {
        let (point, _, parts) = self.divided(nonlinear);
        let axes = match self.direction {
            Direction::Link | Direction::AcrossVelocityInLink => FormulaAxes::Link,
            _ => FormulaAxes::World,
        };
        let mut terms = vec![String::new()];
        let mut definitions = Vec::new();
        let mut define = |name: String, formula: String| definitions.push(FormulaDefinition { name, formula });
        if self.has_anchor() {
            define("distance".to_owned(), "sqrt((anchor_x-r_x)^2+(anchor_y-r_y)^2+(anchor_z-r_z)^2)".to_owned());
        }
        for (i, (f, p)) in self.factors.iter().zip(self.parameters_of(&parts)).enumerate() {
            let names = parameter_names(i, f);
            debug_assert_eq!(names.len(), p.len());
            let one = format!("one_{}", i + 1);
            let mut made = f.shape.formulas(&f.variable.formula(scene), &names, f.range);
            if f.shape == Shape::Curve {
                for (k, hat) in made.iter_mut().enumerate() {
                    let name = if i == 0 { format!("hat{k}") } else { format!("hat{k}_{}", i + 1) };
                    define(name.clone(), replace_word(hat, "one", &one));
                    *hat = name;
                }
            }
            terms = terms
                .iter()
                .flat_map(|t| made.iter().map(move |m| if m == "1" { t.clone() } else { format!("{t}*{m}") }))
                .map(|t| replace_word(&t, "one", &one))
                .collect();
        }
        let component = |axis: usize| -> String {
            let mut sum = Vec::new();
            for (j, term) in terms.iter().enumerate() {
                for &k in &self.components {
                    if let Some(vector) = self.vector_formula(k, axis) {
                        let vector = if vector == "1" { String::new() } else { format!("*{vector}") };
                        sum.push(format!("{}{vector}{term}", self.coefficient_name(j, k)));
                    }
                }
            }
            if sum.is_empty() { "0".to_owned() } else { sum.join(" + ") }
        };
        let three = [component(0), component(1), component(2)];
        let (force, moment) = match self.action {
            Action::Force => (Some(three), None),
            Action::Couple => (None, Some(three)),
        };
        let mut constants = Vec::new();
        for (i, f) in self.factors.iter().enumerate() {
            if f.shape.needs_unit() {
                let unit = f.variable.unit(scene).to_owned();
                constants.push(FormulaConstant { name: format!("one_{}", i + 1), unit, value: 1.0 });
            }
        }
        match self.direction {
            Direction::AgainstVelocity | Direction::AcrossVelocity | Direction::AcrossVelocityInLink => {
                constants.push(FormulaConstant { name: "still".to_owned(), unit: "m/s".to_owned(), value: STILL });
            }
            Direction::AgainstSpin => {
                constants.push(FormulaConstant { name: "still".to_owned(), unit: "1/s".to_owned(), value: STILL });
            }
            _ => {}
        }
        let skipped = self.point_is.unknowns();
        let parameters = self.nonlinear(scene, Target::Body).into_iter().zip(nonlinear).skip(skipped);
        let rounded = |x: f64| (x * 1e5).round() / 1e5;
        FormulaEffect {
            id: self.id.clone(),
            title: "law found on the recordings".to_owned(),
            point: Some(FormulaPoint {
                link: self.carrier.name(scene),
                position_m: match self.carrier {
                    Carrier::Body => None,
                    Carrier::Link(_) => Some(std::array::from_fn(|k| rounded(point[k]))),
                },
            }),
            axes,
            force,
            moment,
            parts: Vec::new(),
            coefficients: self
                .coefficients(scene, Target::Body)
                .into_iter()
                .map(|c| FormulaCoefficient { name: c.name, unit: c.unit, lower: None, upper: None })
                .collect(),
            parameters: parameters
                .map(|(p, value)| FormulaParameter {
                    start: Some(*value),
                    name: p.name,
                    unit: p.unit,
                    lower: p.lower,
                    upper: p.upper,
                })
                .collect(),
            constants,
            definitions,
            delay: self.delayed.then(|| DELAY.to_owned()),
            acts: ActsIn::Flight,
            kind: EffectKind::Physics,
            documentation,
        }
    }

    /// The strength along the direction as one line, for people: variables by name, units of 1 left
    /// out, and the places of a curve's values.
    pub fn strength(&self, scene: &Scene) -> String {
        let mut terms = vec![String::new()];
        for (i, f) in self.factors.iter().enumerate() {
            let names = parameter_names(i, f);
            let x = f.variable.formula(scene);
            let made = if f.shape == Shape::Curve {
                (0..f.shape.terms()).map(|k| format!("hat{k}({x})")).collect()
            } else {
                f.shape.formulas(&x, &names, f.range)
            };
            let signed = f.variable.is_signed();
            let plain = |t: &String| {
                let t = t.replace("/one)", ")");
                let t = if signed { t } else { t.replace(&format!("(abs({x}))"), &x) };
                t.replace(&format!("(abs({x}))"), &format!("abs({x})"))
            };
            terms = terms
                .iter()
                .flat_map(|t| made.iter().map(move |m| if m == "1" { t.clone() } else { format!("{t}*{}", plain(m)) }))
                .collect();
        }
        let names = (0..terms.len()).map(|j| self.term_name(j));
        let sum = names.zip(&terms).map(|(n, t)| format!("{n}{t}")).collect::<Vec<_>>().join(" + ");
        let curves = self.factors.iter().filter(|f| f.shape == Shape::Curve);
        let steps = curves.map(|f| {
            let (low, step) = (f.range.low, f.range.width() / (KNOTS - 1) as f64);
            let x = f.variable.formula(scene);
            let unit =
                Some(f.variable.unit_in_words(scene)).filter(|u| *u != "1").map_or(String::new(), |u| format!(" {u}"));
            let [from, to, by] = [low, f.range.high, step].map(|v| digits(v, 3));
            format!("; hat0 to hat{} peak at {x} = {from} to {to}{unit}, in steps of {by}", KNOTS - 1)
        });
        let late = if self.delayed { format!(" of the motion `{DELAY}` earlier") } else { String::new() };
        sum + &late + &steps.collect::<String>()
    }

    /// Component `axis` of the direction's unit vector `k` as a formula; `None` where it is zero.
    fn vector_formula(&self, k: usize, axis: usize) -> Option<String> {
        let name = |stem: &str, axis: usize| format!("{stem}_{}", ["x", "y", "z"][axis]);
        match self.direction {
            Direction::World | Direction::Link => (k == axis).then(|| "1".to_owned()),
            Direction::AgainstVelocity => Some(format!("(-{}/(speed+still))", name("v", axis))),
            Direction::AgainstSpin => Some(format!("(-{}/(spin+still))", name("omega", axis))),
            Direction::AcrossVelocity | Direction::AcrossVelocityInLink => {
                // (e_k × v)_axis = ε(axis, k, m) v_m
                if axis == k {
                    return None;
                }
                let m = 3 - axis - k;
                let sign = if (axis + 1) % 3 == k { "" } else { "-" };
                Some(format!("({sign}{}/(speed+still))", name("v", m)))
            }
            Direction::SpinCrossVelocity => {
                let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                let product = |i: usize, j: usize| format!("{}*{}", name("omega", i), name("v", j));
                Some(format!("({}-{})", product(a, b), product(b, a)))
            }
            Direction::Towards => {
                let x = ["x", "y", "z"][axis];
                Some(format!("((anchor_{x}-r_{x})/distance)"))
            }
        }
    }
}

/// Names of a factor's parameters in formulas, or their values where these are given.
fn parameter_names(index: usize, f: &Factor) -> Vec<String> {
    if let Some(values) = &f.fixed {
        return values.iter().map(|v| format!("({v})")).collect();
    }
    f.parameters().iter().map(|q| factor_name(index, q.name)).collect()
}

/// Replaces a whole word.
fn replace_word(text: &str, word: &str, by: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    let part = |c: char| c == '_' || c.is_ascii_alphanumeric();
    while let Some(at) = rest.find(word) {
        let before = rest[..at].chars().next_back().is_some_and(part);
        let after = rest[at + word.len()..].chars().next().is_some_and(part);
        out.push_str(&rest[..at]);
        out.push_str(if before || after { word } else { by });
        rest = &rest[at + word.len()..];
    }
    out.push_str(rest);
    out
}

/// True for a shape that is a curve through free values, not an expression.
pub(crate) fn is_curve(law: &Law) -> bool {
    law.factors.iter().any(|f| f.shape == Shape::Curve)
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::Variable;
    use super::super::law::PointIs;
    use super::super::near_joint::tests::trunk_and_arm;
    use super::super::shape::Range;
    use super::*;
    use aloft_body::{Model, Motion, Phi};
    use aloft_effects::{Columns, Series, Span, TrialMotion};
    use nalgebra::{UnitQuaternion, Vector3};

    /// A smooth motion of two links, 0.6 s.
    fn motion(model: &Model) -> Motion {
        let rate_hz = 100.0;
        let mut q = Vec::new();
        for frame in 0..60 {
            let t = f64::from(frame) / rate_hz;
            q.extend([1.0 + 2.0 * t, 0.3 - 1.5 * t, 1.0 + 3.0 * t - 4.9 * t * t]);
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(1.5 * t, 2.0 * (2.0 * t).sin(), 0.5 - 3.0 * t));
            q.extend(turn.coords.iter());
            q.push(0.4 * (5.0 * t).sin());
        }
        Motion { trial: "smooth".into(), rate_hz, nq: model.nq, nv: model.nv, q, ..Motion::default() }
    }

    /// Columns of an effect at values of its nonlinear parameters.
    fn columns(series: &Series<'_>, scene: &Scene, effect: &dyn Effect, values: &[f64]) -> Columns {
        let mut out = Columns::zeros(series.len(), effect.coefficients(scene, Target::Body).len());
        effect.evaluate(series, Target::Body, values, &mut out);
        out
    }

    /// The largest difference between the columns of a law and those of its formula, over the
    /// largest value.
    fn difference(series: &Series<'_>, scene: &Scene, law: &Law) -> Result<f64, Box<dyn std::error::Error>> {
        let of_law = law.nonlinear(scene, Target::Body);
        let values: Vec<f64> = of_law.iter().map(|q| q.lower + 0.3 * (q.upper - q.lower)).collect();
        let effect = FormulaEffect { acts: ActsIn::Both, ..law.formula(scene, &values, String::new()) };
        let compiled = effect.compile(scene)?;
        let value = |name: &str| of_law.iter().position(|q| q.name == name).map(|i| values[i]);
        let of_formula: Option<Vec<f64>> =
            compiled.nonlinear(scene, Target::Body).iter().map(|q| value(&q.name)).collect();
        let names =
            |e: &dyn Effect| e.coefficients(scene, Target::Body).into_iter().map(|c| c.name).collect::<Vec<_>>();
        assert_eq!(names(law), names(&compiled));
        let ours = columns(series, scene, law, &values);
        let theirs =
            columns(series, scene, &compiled, &of_formula.ok_or("a parameter of the formula is not the law's")?);
        let (mut largest, mut off) = (0.0f64, 0.0f64);
        for frame in 0..series.len() {
            let (a, b) = (ours.matrix(frame), theirs.matrix(frame));
            largest = largest.max(a.amax());
            off = off.max((a - b).amax());
        }
        Ok(if largest > 0.0 { off / largest } else { off })
    }

    /// Forces and couples of all directions and shapes, alone and as products, compile as effects
    /// of the user's own, and have the columns of the law in flight and in contact.
    #[test]
    fn every_law_as_an_effect_of_the_user_has_the_columns_of_the_law() -> Result<(), Box<dyn std::error::Error>> {
        let model = trunk_and_arm([0.0, 0.25, 0.02])?;
        let scene = Scene::new(&model, &vec![Phi::repeat(1.0); model.links.len()], &[]);
        let motion = motion(&model);
        let span = |first_frame, end_frame, flight| Span { first_frame, end_frame, flight };
        let spans = [span(5, 30, true), span(30, 55, false)];
        let trial = TrialMotion { motion: &motion, spans: &spans, plates: &[], session_time_s: 0.0 };
        let series = Series::new(&scene, &trial)?;
        let range = Range { low: 0.612_345_678_901_234_5, high: 1.987_654_321_098_765_4 };
        let factor = |variable, shape| Factor { variable, shape, range, fixed: None };
        let variables = [
            Variable::Distance,
            Variable::VelocityInWorld(2),
            Variable::SpinInLink(0),
            Variable::JointAngle(1),
            Variable::SinceTakeOff,
            Variable::Clock,
        ];
        let second =
            [None, Some(factor(Variable::JointRate(1), Shape::Power)), Some(factor(Variable::Speed, Shape::Switch))];
        let mut count = 0;
        for action in [Action::Force, Action::Couple] {
            for direction in Direction::FIXED.into_iter().chain([Direction::Towards]) {
                for variable in variables {
                    let shapes = Shape::of(variable.is_signed(), variable == Variable::Distance, false);
                    for shape in shapes.into_iter().chain([Shape::Curve]) {
                        for (second, delayed) in second.iter().zip([false, false, true]) {
                            // not known of the motion before a stretch
                            let delayed = delayed && variable != Variable::SinceTakeOff;
                            let law = Law {
                                id: "law".to_owned(),
                                carrier: Carrier::Link(1),
                                action,
                                direction,
                                components: (0..direction.components()).collect(),
                                factors: std::iter::once(factor(variable, shape)).chain(second.clone()).collect(),
                                point: Vector3::new(0.01, 0.02, 0.03),
                                point_is: PointIs::Given,
                                zeros: Vec::new(),
                                delayed,
                            };
                            let what = format!("{action:?} {direction:?} {variable:?} {shape:?} {second:?} {delayed}");
                            let off = difference(&series, &scene, &law).map_err(|e| format!("{what}: {e}"))?;
                            assert!(off < 1e-6, "{what}: {off:e}");
                            count += 1;
                        }
                    }
                }
            }
        }
        assert!(count > 2500, "{count}");
        Ok(())
    }
}
