//! Effects that users write: a force or moment law as formulas over named quantities, linear in unknown coefficients.
//!
//! ```yaml
//! id: sail
//! title: a sail on the torso
//! point: { link: torso, position_m: [0.1, 0.2, 0.0] }
//! force: ["-c * speed * v_x", "-c * speed * v_y", "-c * speed * v_z"]
//! coefficients: [{ name: c, unit: kg/m, lower: 0 }]
//! ```
//!
//! | quantity | unit | meaning |
//! |---|---|---|
//! | `v_x v_y v_z`, `speed` | m/s | velocity of the point |
//! | `a_x a_y a_z` | m/s² | acceleration of the point |
//! | `r_x r_y r_z` | m | place of the point in the world |
//! | `omega_x omega_y omega_z`, `spin` | rad/s | angular velocity of the link |
//! | `alpha_x alpha_y alpha_z` | rad/s² | angular acceleration of the link |
//! | `com_x com_y com_z`, `comv_x …` | m, m/s | whole centre of mass, its velocity |
//! | `t`, `since_start`, `to_end` | s | time in the recording, in the stretch, until its end |
//! | `q_<link>`, `qd_<link>` | rad, rad/s (m, m/s) | a hinge's (slide's) coordinate and rate |
//! | `mass`, `gravity`, `pi` | kg, m/s², 1 | constants |
//!
//! Vectors are in world axes, or in the link's with `axes: link` (places always in the world); forces act at the point.

mod parse;
mod unit;

use crate::{
    ActsIn, Coefficient, Columns, Effect, EffectFrame, EffectKind, EffectsError, FormulaProblem, NonlinearParameter,
    Scene, Series, Target,
};
use aloft_body::JointKind;
use exmex::{Express, FlatEx};
use nalgebra::Vector3;
use parse::Problem;
use serde::{Deserialize, Serialize};
use unit::Unit;

/// An effect as a user writes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FormulaEffect {
    /// Identifier, not one of the catalogue.
    pub id: String,
    /// A few words.
    #[serde(default)]
    pub title: String,
    /// Where the force acts.
    pub point: FormulaPoint,
    /// Axes of vectors and of the law.
    #[serde(default)]
    pub axes: FormulaAxes,
    /// Force in N, three formulas; none when absent.
    #[serde(default)]
    pub force: Option<[String; 3]>,
    /// Free moment in N·m, three formulas; none when absent.
    #[serde(default)]
    pub moment: Option<[String; 3]>,
    /// Unknowns that the law is linear in.
    pub coefficients: Vec<FormulaCoefficient>,
    /// Further unknowns, bounded.
    #[serde(default)]
    pub parameters: Vec<FormulaParameter>,
    /// Where it acts.
    #[serde(default = "both")]
    pub acts: ActsIn,
    /// Physics or artefact.
    #[serde(default = "physics")]
    pub kind: EffectKind,
    /// Text for people.
    #[serde(default)]
    pub documentation: String,
}

fn both() -> ActsIn {
    ActsIn::Both
}
fn physics() -> EffectKind {
    EffectKind::Physics
}

/// A point of a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FormulaPoint {
    /// Name of the link.
    pub link: String,
    /// Place in its frame, m; the link's centre of mass when absent.
    #[serde(default)]
    pub position_m: Option<[f64; 3]>,
}

/// Axes in which vectors are written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FormulaAxes {
    /// The room's.
    #[default]
    World,
    /// The link's.
    Link,
}

/// An unknown of a user's law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FormulaCoefficient {
    /// Name in the formulas.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// Smallest plausible value.
    #[serde(default)]
    pub lower: Option<f64>,
    /// Largest plausible value.
    #[serde(default)]
    pub upper: Option<f64>,
}

/// An unknown that the law is not linear in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FormulaParameter {
    /// Name in the formulas.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Where the search begins; five values across the bounds when absent.
    #[serde(default)]
    pub start: Option<f64>,
}

/// A user's effect, read and checked against a body.
#[derive(Debug)]
pub struct CompiledFormula {
    spec: FormulaEffect,
    link: usize,
    point: Vector3<f64>,
    coefficients: Vec<Coefficient>,
    parameters: Vec<NonlinearParameter>,
    starts: Vec<Vec<f64>>,
    /// Force x y z, moment x y z.
    laws: Vec<Option<Law>>,
}

#[derive(Debug)]
struct Law {
    expression: FlatEx<f64>,
    /// Where each variable of the expression comes from, in its order.
    sources: Vec<Source>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    Quantity(Quantity),
    Coefficient(usize),
    Parameter(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Quantity {
    V(usize),
    Speed,
    A(usize),
    R(usize),
    Omega(usize),
    Spin,
    Alpha(usize),
    Com(usize),
    ComV(usize),
    Time,
    SinceStart,
    ToEnd,
    Coordinate(usize),
    Rate(usize),
    Mass,
    Gravity,
    Pi,
}

/// True for units that can be read.
#[cfg(test)]
pub(crate) fn unit_is_readable(text: &str) -> bool {
    Unit::parse(text).is_ok()
}

/// Quantities by name, besides the joints'.
const QUANTITIES: &str = "v_x v_y v_z speed a_x a_y a_z r_x r_y r_z omega_x omega_y omega_z spin alpha_x alpha_y alpha_z \
com_x com_y com_z comv_x comv_y comv_z t since_start to_end mass gravity pi";

fn quantity(scene: &Scene, name: &str) -> Option<(Quantity, Unit)> {
    let (m, per_s, per_s2) = (Unit([1.0, 0.0, 0.0]), Unit([0.0, 0.0, -1.0]), Unit([0.0, 0.0, -2.0]));
    let speed = m.times(per_s, 1.0);
    let plain = match name {
        "speed" => Some((Quantity::Speed, speed)),
        "spin" => Some((Quantity::Spin, per_s)),
        "t" => Some((Quantity::Time, per_s.raised(-1.0))),
        "since_start" => Some((Quantity::SinceStart, per_s.raised(-1.0))),
        "to_end" => Some((Quantity::ToEnd, per_s.raised(-1.0))),
        "mass" => Some((Quantity::Mass, Unit([0.0, 1.0, 0.0]))),
        "gravity" => Some((Quantity::Gravity, m.times(per_s2, 1.0))),
        "pi" => Some((Quantity::Pi, Unit::NONE)),
        _ => None,
    };
    if plain.is_some() {
        return plain;
    }
    let (stem, rest) = name.split_once('_')?;
    if stem == "q" || stem == "qd" {
        let joint = &scene.model.links.iter().find(|l| l.name == rest)?.joint;
        let unit = match joint.kind {
            JointKind::Revolute(_) => Unit::NONE,
            JointKind::Prismatic(_) => m,
            _ => return None,
        };
        return Some(match stem {
            "q" => (Quantity::Coordinate(joint.q_offset), unit),
            _ => (Quantity::Rate(joint.v_offset), unit.times(per_s, 1.0)),
        });
    }
    let axis = ["x", "y", "z"].iter().position(|a| *a == rest)?;
    Some(match stem {
        "v" => (Quantity::V(axis), speed),
        "a" => (Quantity::A(axis), m.times(per_s2, 1.0)),
        "r" => (Quantity::R(axis), m),
        "omega" => (Quantity::Omega(axis), per_s),
        "alpha" => (Quantity::Alpha(axis), per_s2),
        "com" => (Quantity::Com(axis), m),
        "comv" => (Quantity::ComV(axis), speed),
        _ => return None,
    })
}

impl FormulaEffect {
    /// Reads the formulas and checks names, units and linearity.
    ///
    /// # Errors
    /// [`EffectsError::Formula`] with the place of what is wrong, [`EffectsError::Spec`] for names, units and bounds outside of formulas.
    pub fn compile(&self, scene: &Scene) -> Result<CompiledFormula, EffectsError> {
        let spec = |problem: String| EffectsError::Spec { effect: self.id.clone(), problem };
        if crate::effect(&self.id).is_ok() || self.id.is_empty() || self.id.contains(['.', '[', ']']) {
            return Err(spec("the identifier is taken, empty, or holds one of `. [ ]`".to_owned()));
        }
        let known = || scene.model.links.iter().map(|l| format!("`{}`", l.name)).collect::<Vec<_>>().join(", ");
        let link = scene
            .model
            .links
            .iter()
            .position(|l| l.name == self.point.link)
            .ok_or_else(|| spec(format!("there is no link `{}`; there are {}", self.point.link, known())))?;
        let point = self.point.position_m.map_or(scene.link_com_m[link], Vector3::from);
        let unit_of = |name: &str, text: &str| {
            Unit::parse(text).map_err(|bad| spec(format!("`{name}`: `{bad}` is no SI unit (of `{text}`)")))
        };
        let mut symbols: Vec<(String, Source, Unit)> = Vec::new();
        let mut coefficients = Vec::new();
        for (k, c) in self.coefficients.iter().enumerate() {
            symbols.push((c.name.clone(), Source::Coefficient(k), unit_of(&c.name, &c.unit)?));
            let (lower, upper) = (c.lower.unwrap_or(f64::NEG_INFINITY), c.upper.unwrap_or(f64::INFINITY));
            if lower >= upper {
                return Err(spec(format!("`{}`: bounds {lower} to {upper}", c.name)));
            }
            coefficients.push(Coefficient::within(c.name.clone(), &c.unit, lower, upper));
        }
        if coefficients.is_empty() {
            return Err(spec("it has no coefficients, so nothing can be fitted".to_owned()));
        }
        let mut parameters = Vec::new();
        let mut starts = vec![Vec::new()];
        for (k, p) in self.parameters.iter().enumerate() {
            symbols.push((p.name.clone(), Source::Parameter(k), unit_of(&p.name, &p.unit)?));
            let inside = p.start.is_none_or(|s| (p.lower..=p.upper).contains(&s));
            if !(p.lower < p.upper && p.lower.is_finite() && p.upper.is_finite() && inside) {
                return Err(spec(format!("`{}`: bounds {} to {}, start {:?}", p.name, p.lower, p.upper, p.start)));
            }
            let range = p.upper - p.lower;
            parameters.push(NonlinearParameter::new(p.name.clone(), &p.unit, p.lower, p.upper, 0.02 * range));
            let values = p
                .start
                .map_or_else(|| (0..5).map(|i| p.lower + range * (0.1 + 0.2 * f64::from(i))).collect(), |s| vec![s]);
            starts =
                starts.iter().flat_map(|s| values.iter().map(|v| [s.as_slice(), &[*v]].concat())).take(625).collect();
        }
        for (i, (name, _, _)) in symbols.iter().enumerate() {
            let word = name
                .chars()
                .enumerate()
                .all(|(j, c)| c == '_' || c.is_ascii_alphabetic() || (j > 0 && c.is_ascii_digit()));
            if name.is_empty() || !word || quantity(scene, name).is_some() || parse::FUNCTIONS.contains(&name.as_str())
            {
                return Err(spec(format!("`{name}` cannot name an unknown: it is a quantity, a function, or no word")));
            }
            if symbols[..i].iter().any(|(n, _, _)| n == name) {
                return Err(spec(format!("two unknowns have the name `{name}`")));
            }
        }
        let mut laws = Vec::new();
        for (what, texts, unit) in [("force", &self.force, Unit::FORCE), ("moment", &self.moment, Unit::MOMENT)] {
            for axis in 0..3 {
                laws.push(match texts {
                    None => None,
                    Some(texts) => self.law(scene, &symbols, &format!("{what}[{axis}]"), &texts[axis], unit)?,
                });
            }
        }
        if laws.iter().all(Option::is_none) {
            return Err(spec("it has neither force nor moment".to_owned()));
        }
        for (name, source, _) in &symbols {
            if !laws.iter().flatten().any(|l| l.sources.contains(source)) {
                return Err(spec(format!("`{name}` stands in no formula")));
            }
        }
        Ok(CompiledFormula { spec: self.clone(), link, point, coefficients, parameters, starts, laws })
    }

    fn law(
        &self,
        scene: &Scene,
        symbols: &[(String, Source, Unit)],
        entry: &str,
        text: &str,
        wanted: Unit,
    ) -> Result<Option<Law>, EffectsError> {
        let fail = |p: Problem| {
            EffectsError::Formula(Box::new(FormulaProblem {
                effect: self.id.clone(),
                entry: entry.to_owned(),
                formula: text.to_owned(),
                position: p.at,
                problem: p.text,
            }))
        };
        let node = parse::parse(text).map_err(fail)?;
        let find = |name: &str| {
            symbols
                .iter()
                .find(|(n, _, _)| n == name)
                .map(|(_, s, u)| (*s, *u))
                .or_else(|| quantity(scene, name).map(|(q, u)| (Source::Quantity(q), u)))
        };
        let lookup = |name: &str| {
            find(name).map(|f| f.1).ok_or_else(|| {
                let own = symbols.iter().map(|s| s.0.as_str()).collect::<Vec<_>>().join(" ");
                format!("nothing is called `{name}`; there are {own}, {QUANTITIES}, and q_<link>, qd_<link> of hinges")
            })
        };
        let unit = node.unit(&lookup).map_err(fail)?;
        if node.constant() == Some(0.0) {
            return Ok(None);
        }
        if !unit.same(wanted) {
            let text = format!("the unit is {}, a {} has {}", unit.words(), &entry[..entry.len() - 3], wanted.words());
            return Err(fail(Problem { at: node.at, text }));
        }
        let expression =
            exmex::parse::<f64>(&node.explicit()).map_err(|e| fail(Problem { at: node.at, text: e.to_string() }))?;
        let sources: Vec<Source> = expression
            .var_names()
            .iter()
            .map(|n| find(n.trim_matches(['{', '}'])).map(|f| f.0))
            .collect::<Option<_>>()
            .ok_or_else(|| fail(Problem { at: node.at, text: "a name was lost".to_owned() }))?;
        let law = Law { expression, sources };
        law.check_linear(symbols).map_err(|text| {
            let mut names = Vec::new();
            node.names(&mut names);
            let at = names
                .iter()
                .find(|(n, _)| matches!(find(n), Some((Source::Coefficient(_), _))))
                .map_or(node.at, |n| n.1);
            fail(Problem { at, text })
        })?;
        Ok(Some(law))
    }
}

impl Law {
    fn value(&self, values: &mut Vec<f64>, of: impl Fn(Source) -> f64) -> f64 {
        values.clear();
        values.extend(self.sources.iter().map(|s| of(*s)));
        self.expression.eval(values).unwrap_or(f64::NAN)
    }

    /// Linear in the coefficients, and nothing beside them: tried at arbitrary values of everything else.
    fn check_linear(&self, symbols: &[(String, Source, Unit)]) -> Result<(), String> {
        let n = symbols.iter().filter(|s| matches!(s.1, Source::Coefficient(_))).count();
        let mut values = Vec::new();
        for trial in 0..6u32 {
            // arbitrary but fixed numbers of order one, positive so that roots and logarithms exist
            let arbitrary =
                |i: usize| 0.3 + ((i as f64 + 1.0) * 0.754_877_666 + f64::from(trial) * 0.569_840_29).fract();
            let mut at = |c: &dyn Fn(usize) -> f64| {
                self.value(&mut values, |s| match s {
                    Source::Coefficient(k) => c(k),
                    other => arbitrary(self.sources.iter().position(|x| *x == other).unwrap_or(0)),
                })
            };
            let none = at(&|_| 0.0);
            if !none.is_finite() {
                continue;
            }
            let units: Vec<f64> = (0..n).map(|k| at(&|j| f64::from(u8::from(j == k)))).collect();
            let mixed = |k: usize| 0.7 + 0.31 * k as f64 * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let both = at(&mixed);
            let mirrored = at(&|k| -mixed(k));
            let size = units.iter().fold(none.abs() + both.abs(), |m, u| m + u.abs()).max(1e-12);
            if none.abs() > 1e-9 * size {
                return Err("a part has no coefficient: an effect of known size belongs into the model".to_owned());
            }
            let sum: f64 = units.iter().enumerate().map(|(k, u)| mixed(k) * u).sum();
            if (sum - both).abs() > 1e-9 * size || (both + mirrored).abs() > 1e-9 * size {
                return Err("the formula is not linear in its coefficients: make this one a parameter".to_owned());
            }
        }
        Ok(())
    }
}

impl CompiledFormula {
    fn quantity(&self, f: &EffectFrame<'_>, q: Quantity) -> f64 {
        let link = &f.links[self.link];
        let turn = |v: Vector3<f64>| match self.spec.axes {
            FormulaAxes::World => v,
            FormulaAxes::Link => link.rotation.tr_mul(&v),
        };
        match q {
            Quantity::V(k) => turn(link.point_velocity(&self.point))[k],
            Quantity::Speed => link.point_velocity(&self.point).norm(),
            Quantity::A(k) => turn(link.point_acceleration(&self.point))[k],
            Quantity::R(k) => link.point(&self.point)[k],
            Quantity::Omega(k) => turn(link.omega)[k],
            Quantity::Spin => link.omega.norm(),
            Quantity::Alpha(k) => turn(link.alpha)[k],
            Quantity::Com(k) => f.com[k],
            Quantity::ComV(k) => turn(f.com_velocity)[k],
            Quantity::Time => f.time_s,
            Quantity::SinceStart => f.since_start_s,
            Quantity::ToEnd => f.to_end_s,
            Quantity::Coordinate(i) => f.q[i],
            Quantity::Rate(i) => f.v[i],
            Quantity::Mass => f.scene.mass_kg,
            Quantity::Gravity => f.scene.gravity(),
            Quantity::Pi => std::f64::consts::PI,
        }
    }
}

impl Effect for CompiledFormula {
    fn id(&self) -> &str {
        &self.spec.id
    }
    fn title(&self) -> &str {
        &self.spec.title
    }
    fn kind(&self) -> EffectKind {
        self.spec.kind
    }
    fn acts(&self) -> ActsIn {
        self.spec.acts
    }
    fn documentation(&self) -> &str {
        &self.spec.documentation
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        vec![Target::Link(self.link)]
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        self.coefficients.clone()
    }
    fn nonlinear(&self, _: &Scene, _: Target) -> Vec<NonlinearParameter> {
        self.parameters.clone()
    }
    fn starts(&self, _: &Scene, _: Target) -> Vec<Vec<f64>> {
        self.starts.clone()
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, nonlinear: &[f64], out: &mut Columns) {
        let mut values = Vec::new();
        for i in 0..series.len() {
            let f = series.frame(i);
            if !self.spec.acts.in_contact() && !f.flight || !self.spec.acts.in_flight() && f.flight {
                continue;
            }
            let link = &f.links[self.link];
            let at = link.point(&self.point);
            for k in 0..self.coefficients.len() {
                let mut six = [0.0; 6];
                for (x, law) in six.iter_mut().zip(&self.laws) {
                    if let Some(law) = law {
                        *x = law.value(&mut values, |s| match s {
                            Source::Quantity(q) => self.quantity(&f, q),
                            Source::Coefficient(j) => f64::from(u8::from(j == k)),
                            Source::Parameter(j) => nonlinear.get(j).copied().unwrap_or(f64::NAN),
                        });
                    }
                }
                let mut force = Vector3::new(six[0], six[1], six[2]);
                let mut moment = Vector3::new(six[3], six[4], six[5]);
                if self.spec.axes == FormulaAxes::Link {
                    force = link.rotation * force;
                    moment = link.rotation * moment;
                }
                out.force_at(i, k, &force, &at);
                out.couple(i, k, &moment);
            }
        }
    }
}
