//! Effects written by users: a force or moment law as formulas over named quantities, linear in
//! unknown coefficients.
//!
//! ```yaml
//! id: sail
//! title: a sail on the torso
//! point: { link: torso, position_m: [0.1, 0.2, 0.0] }
//! force: ["-c * speed * v_x", "-c * speed * v_y", "-c * speed * v_z"]
//! coefficients: [{ name: c, unit: kg/m, lower: 0 }]
//! ```
//!
//! [`quantities`] lists what formulas may name, besides `q_<link>` and `qd_<link>`, a hinge's
//! (slide's) coordinate and rate.
//!
//! Vectors are in world axes, or in the link's with `axes: link` (positions always in the world);
//! forces act at the point. A law on several links has `parts`, or one part with `link: all`, which
//! acts on every link at that link's own point. Numbers with units are `constants`; formulas with a
//! name are `definitions`, which the law and later definitions may use:
//!
//! ```yaml
//! definitions:
//! - { name: distance, formula: "sqrt(r_x^2 + r_y^2 + r_z^2)" }
//! force: ["-k * r_x / distance", "-k * r_y / distance", "-k * r_z / distance"]
//! ```
//!
//! A law that acts late has a `delay`, the name of a parameter or constant in s: its formulas then
//! have the values that they had that long ago ([`Series::earlier`]). The force acts where the
//! point is now; components along the axes of the link turn with it. Such a law cannot depend on
//! `since_start`, `since_landing` and `to_end`, which are not known of the motion before a stretch.
//!
//! Unknowns have a direction if their names imply one: consecutive coefficients `c_x`, `c_y` (and
//! `c_z`) are the components of a vector, parameters `anchor_x` … or `pulley_x` … a position in the
//! world, `wind_x` … a vector in world axes. Discovery rotates such an effect to other directions
//! when it tests whether two effects can be distinguished.

mod law;
mod parse;
mod quantity;
mod spec;
mod unit;

pub use quantity::{QuantityGroup, quantities};
pub use spec::{
    FormulaAxes, FormulaCoefficient, FormulaConstant, FormulaDefinition, FormulaEffect, FormulaParameter, FormulaPart,
    FormulaPoint,
};

use crate::{
    About, ActsIn, Coefficient, Columns, Effect, EffectKind, EffectsError, LEAD_IN_S, NonlinearParameter,
    ParameterKind, Scene, Series, Target,
};
use law::{Law, Source, Symbol};
use nalgebra::Vector3;

use quantity::{Place, quantity};
use unit::Unit;

/// A user's effect, parsed and checked for a body.
#[derive(Debug)]
pub struct CompiledFormula {
    id: String,
    title: String,
    documentation: String,
    kind: EffectKind,
    acts: ActsIn,
    coefficients: Vec<Coefficient>,
    parameters: Vec<NonlinearParameter>,
    starts: Vec<Vec<f64>>,
    parts: Vec<Part>,
    /// Parameter or constant that is the delay of the law.
    delay: Option<Source>,
}

/// A law on some links.
#[derive(Debug)]
struct Part {
    places: Vec<Place>,
    axes: FormulaAxes,
    /// Laws of force x y z and moment x y z.
    laws: Vec<Option<Law>>,
}

/// True for units that can be parsed.
#[cfg(test)]
pub(crate) fn unit_is_readable(text: &str) -> bool {
    Unit::parse(text).is_ok()
}

impl FormulaEffect {
    /// Parses the formulas and checks names, units and linearity.
    ///
    /// # Errors
    /// [`EffectsError::Formula`] with the position of an error in a formula,
    /// [`EffectsError::Place`] for names, units and bounds outside formulas.
    pub fn compile(&self, scene: &Scene) -> Result<CompiledFormula, EffectsError> {
        let known = !self.id.is_empty() && crate::effect(&self.id).is_ok();
        if known || self.id.is_empty() || self.id.contains(['.', '[', ']']) {
            let why = if known { "is an effect of the catalogue" } else { "is empty, or holds one of `. [ ]`" };
            return Err(self.wrong("id", format!("`{}` {why}", self.id)));
        }
        let mut symbols = Vec::new();
        let coefficients = self.read_coefficients(&mut symbols)?;
        let (parameters, starts) = self.read_parameters(&mut symbols)?;
        for (i, c) in self.constants.iter().enumerate() {
            let unit = self.read_unit(&format!("constants[{i}]"), &c.unit)?;
            let place = format!("constants[{i}]");
            symbols.push(Symbol { name: c.name.clone(), source: Source::Constant(c.value), unit, place });
        }
        self.check_names(scene, &symbols)?;
        let delay = self.read_delay(&symbols)?;
        let definitions = law::definitions(&self.id, scene, &symbols, &self.definitions)?;
        let mut parts = Vec::new();
        let parts_of = self.laws();
        for (place, part) in &parts_of {
            let places = self.places(scene, place, &part.point)?;
            let mut laws = Vec::new();
            for (what, texts, unit) in [("force", &part.force, Unit::FORCE), ("moment", &part.moment, Unit::MOMENT)] {
                for axis in 0..3 {
                    laws.push(match texts {
                        None => None,
                        Some(texts) => {
                            let here = format!("{place}{what}[{axis}]");
                            Law::new(&self.id, scene, &symbols, &definitions, &here, &texts[axis], (what, unit))?
                        }
                    });
                }
            }
            if laws.iter().all(Option::is_none) {
                let at = if place.is_empty() { "id".to_owned() } else { format!("{place}point") };
                return Err(self.wrong(&at, "there is neither force nor moment"));
            }
            parts.push(Part { places, axes: part.axes, laws });
        }
        if parts.is_empty() {
            return Err(self.wrong("id", "there is neither a `point` with a law nor `parts`"));
        }
        if self.point.is_none() && (self.force.is_some() || self.moment.is_some()) {
            let at = if self.force.is_some() { "force[0]" } else { "moment[0]" };
            return Err(self.wrong(at, "this law has no `point`: say on which link it acts"));
        }
        let (mut coefficients, mut parameters) = (coefficients, parameters);
        name_directions(&mut coefficients, &mut parameters, parts.iter().all(|p| p.axes == FormulaAxes::World));
        let all = parts.iter().flat_map(|p| &p.laws).flatten().flat_map(|l| &l.sources);
        let mut of_an_end = all.filter_map(|s| match s {
            Source::Quantity(q) => q.counts_from_an_end(),
            _ => None,
        });
        if let Some(name) = of_an_end.next().filter(|_| delay.is_some()) {
            let text = format!("a law with a delay cannot depend on `{name}`, which is not known of the motion before");
            return Err(self.wrong("delay", text));
        }
        let in_laws = |s: &Source| parts.iter().flat_map(|p| &p.laws).flatten().any(|l| l.sources.contains(s));
        let sources = |s: &Source| delay.as_ref() == Some(s) || in_laws(s);
        for s in symbols.iter().filter(|s| !matches!(s.source, Source::Constant(_))) {
            if !sources(&s.source) {
                return Err(self.wrong(&format!("{}.name", s.place), format!("`{}` stands in no formula", s.name)));
            }
        }
        let texts = || {
            let laws = parts_of.iter().flat_map(|(_, p)| [&p.force, &p.moment]).flatten().flatten();
            laws.chain(self.definitions.iter().map(|d| &d.formula))
        };
        for (i, d) in self.definitions.iter().enumerate() {
            // none: a formula that cannot be read is refused when it is compiled
            if !texts().any(|t| parse::parse(t).is_ok_and(|n| n.is_named(&d.name))) {
                let text = format!("`{}` stands in no formula", d.name);
                return Err(self.wrong(&format!("definitions[{i}].name"), text));
            }
        }
        Ok(CompiledFormula {
            id: self.id.clone(),
            title: self.title.clone(),
            documentation: self.documentation.clone(),
            kind: self.kind,
            acts: self.acts,
            coefficients,
            parameters,
            starts,
            parts,
            delay,
        })
    }

    /// The delay of the law: a time within what is known before a span.
    fn read_delay(&self, symbols: &[Symbol]) -> Result<Option<Source>, EffectsError> {
        let Some(name) = &self.delay else { return Ok(None) };
        let of = |s: &&Symbol| s.name == *name && !matches!(s.source, Source::Coefficient(_));
        let Some(symbol) = symbols.iter().find(of) else {
            return Err(self.wrong("delay", format!("`{name}` is neither a parameter nor a constant of this effect")));
        };
        let [lower, upper] = match symbol.source {
            Source::Parameter(k) => [self.parameters[k].lower, self.parameters[k].upper],
            Source::Constant(x) => [x; 2],
            Source::Coefficient(_) | Source::Quantity(_) => [f64::NAN; 2],
        };
        if !symbol.unit.same(Unit::SECOND) || lower.is_nan() || lower < 0.0 || upper > LEAD_IN_S {
            let text =
                format!("`{name}` is {lower} to {upper} {}; a delay is 0 to {LEAD_IN_S} s", symbol.unit.describe());
            return Err(self.wrong("delay", text));
        }
        Ok(Some(symbol.source))
    }

    fn wrong(&self, place: &str, problem: impl Into<String>) -> EffectsError {
        EffectsError::Place { effect: self.id.clone(), place: place.to_owned(), problem: problem.into() }
    }

    fn read_unit(&self, place: &str, text: &str) -> Result<Unit, EffectsError> {
        Unit::parse(text)
            .map_err(|bad| self.wrong(&format!("{place}.unit"), format!("`{bad}` is no SI unit (of `{text}`)")))
    }

    fn read_coefficients(&self, symbols: &mut Vec<Symbol>) -> Result<Vec<Coefficient>, EffectsError> {
        let mut out = Vec::new();
        for (k, c) in self.coefficients.iter().enumerate() {
            let place = format!("coefficients[{k}]");
            let unit = self.read_unit(&place, &c.unit)?;
            let (lower, upper) = (c.lower.unwrap_or(f64::NEG_INFINITY), c.upper.unwrap_or(f64::INFINITY));
            if lower >= upper {
                return Err(self.wrong(&format!("{place}.lower"), format!("`{}`: bounds {lower} to {upper}", c.name)));
            }
            symbols.push(Symbol { name: c.name.clone(), source: Source::Coefficient(k), unit, place });
            out.push(Coefficient::within(c.name.clone(), &c.unit, lower, upper));
        }
        if out.is_empty() {
            return Err(self.wrong("coefficients", "there are no coefficients, so nothing can be fitted"));
        }
        Ok(out)
    }

    fn read_parameters(
        &self,
        symbols: &mut Vec<Symbol>,
    ) -> Result<(Vec<NonlinearParameter>, Vec<Vec<f64>>), EffectsError> {
        let mut out = Vec::new();
        let mut starts = vec![Vec::new()];
        for (k, p) in self.parameters.iter().enumerate() {
            let place = format!("parameters[{k}]");
            let unit = self.read_unit(&place, &p.unit)?;
            let inside = p.start.is_none_or(|s| (p.lower..=p.upper).contains(&s));
            if !(p.lower < p.upper && p.lower.is_finite() && p.upper.is_finite() && inside) {
                let start = p.start.map_or(String::new(), |s| format!(", start {s}"));
                let text = format!("`{}`: bounds {} to {}{start}", p.name, p.lower, p.upper);
                return Err(self.wrong(&format!("{place}.lower"), text));
            }
            symbols.push(Symbol { name: p.name.clone(), source: Source::Parameter(k), unit, place });
            let range = p.upper - p.lower;
            out.push(NonlinearParameter::new(p.name.clone(), &p.unit, p.lower, p.upper, 0.02 * range));
            let values = p
                .start
                .map_or_else(|| (0..5).map(|i| p.lower + range * (0.1 + 0.2 * f64::from(i))).collect(), |s| vec![s]);
            starts =
                starts.iter().flat_map(|s| values.iter().map(|v| [s.as_slice(), &[*v]].concat())).take(625).collect();
        }
        Ok((out, starts))
    }

    fn check_names(&self, scene: &Scene, symbols: &[Symbol]) -> Result<(), EffectsError> {
        let unknowns = symbols.iter().map(|s| (s.name.as_str(), s.place.clone()));
        let defined = self.definitions.iter().enumerate().map(|(i, d)| (d.name.as_str(), format!("definitions[{i}]")));
        let all: Vec<(&str, String)> = unknowns.chain(defined).collect();
        for (i, (name, place)) in all.iter().enumerate() {
            let place = format!("{place}.name");
            let letter = |(j, c): (usize, char)| c == '_' || c.is_ascii_alphabetic() || (j > 0 && c.is_ascii_digit());
            let word = !name.is_empty() && name.chars().enumerate().all(letter);
            if !word || quantity(scene, name).is_some() || parse::FUNCTIONS.contains(name) {
                let text = format!("`{name}` cannot be a name here: it is a quantity, a function, or no word");
                return Err(self.wrong(&place, text));
            }
            if all[..i].iter().any(|(other, _)| other == name) {
                return Err(self.wrong(&place, format!("two things have the name `{name}`")));
            }
        }
        Ok(())
    }

    fn places(&self, scene: &Scene, place: &str, point: &FormulaPoint) -> Result<Vec<Place>, EffectsError> {
        let links = &scene.model.links;
        let at =
            |link: usize| Place { link, point: Some(point.position_m.map_or(scene.link_com_m[link], Vector3::from)) };
        match links.iter().position(|l| l.name == point.link) {
            Some(link) => Ok(vec![at(link)]),
            None if point.link == "all" => Ok((0..links.len()).map(at).collect()),
            None if point.link == "body" && point.position_m.is_some() => {
                let text = "the centre of mass of the body has no position on a link: remove `position_m`";
                Err(self.wrong(&format!("{place}point.position_m"), text))
            }
            None if point.link == "body" => Ok(vec![Place { link: 0, point: None }]),
            None => {
                let known = links.iter().map(|l| format!("`{}`", l.name)).collect::<Vec<_>>().join(", ");
                let text = format!(
                    "there is no link `{}`; there are {known}, `body` (its centre of mass), and `all`",
                    point.link
                );
                Err(self.wrong(&format!("{place}point.link"), text))
            }
        }
    }
}

/// Assigns directions to the unknowns of a formula according to their names.
fn name_directions(coefficients: &mut [Coefficient], parameters: &mut [NonlinearParameter], in_world: bool) {
    let of_axes: fn(usize) -> ParameterKind =
        if in_world { ParameterKind::VectorInWorld } else { ParameterKind::VectorOnLink };
    let names: Vec<String> = coefficients.iter().map(|c| c.name.clone()).collect();
    for (at, n, _) in triples(&names) {
        (0..n).for_each(|k| coefficients[at + k].kind = of_axes(k));
    }
    let names: Vec<String> = parameters.iter().map(|p| p.name.clone()).collect();
    for (at, n, stem) in triples(&names) {
        let kind: fn(usize) -> ParameterKind = match stem.as_str() {
            "anchor" | "pulley" => ParameterKind::PointInWorld,
            "wind" => ParameterKind::VectorInWorld,
            _ => continue,
        };
        (0..n).for_each(|k| parameters[at + k].kind = kind(k));
    }
    let plain = |kind: ParameterKind| kind == ParameterKind::Scalar;
    let directed = !(coefficients.iter().all(|c| plain(c.kind)) && parameters.iter().all(|p| plain(p.kind)));
    // two coefficients of either sign, with no other directed unknown: taken as the horizontal
    // components of a vector
    if let (false, [x, y]) = (directed, &mut coefficients[..])
        && x.lower < 0.0
        && y.lower < 0.0
    {
        (x.kind, y.kind) = (of_axes(0), of_axes(1));
    }
}

/// Consecutive names `stem_x`, `stem_y` and possibly `stem_z`: the index of the first, their
/// number, the stem.
fn triples(names: &[String]) -> Vec<(usize, usize, String)> {
    let of = |at: usize| {
        let stem = names[at].strip_suffix("_x")?;
        let is = |k: usize, axis: &str| names.get(at + k).is_some_and(|n| *n == format!("{stem}_{axis}"));
        is(1, "y").then(|| (at, if is(2, "z") { 3 } else { 2 }, stem.to_owned()))
    };
    (0..names.len()).filter_map(of).collect()
}

impl Effect for CompiledFormula {
    fn about(&self) -> About<'_> {
        About {
            id: &self.id,
            title: &self.title,
            kind: self.kind,
            acts: self.acts,
            documentation: &self.documentation,
            ..About::PLAIN
        }
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        vec![Target::Body]
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
        let given = |j: usize| nonlinear.get(j).copied().unwrap_or(f64::NAN);
        let delay = self.delay.map(|source| match source {
            Source::Parameter(j) => given(j),
            Source::Constant(x) => x,
            Source::Coefficient(_) | Source::Quantity(_) => f64::NAN,
        });
        for i in 0..series.len() {
            let f = series.frame(i);
            let of = delay.map_or([(f, 1.0), (f, 0.0)], |delay| series.earlier(i, delay));
            if !self.acts.in_contact() && !f.flight || !self.acts.in_flight() && f.flight {
                continue;
            }
            for part in &self.parts {
                for place in &part.places {
                    let link = &f.links[place.link];
                    for k in 0..self.coefficients.len() {
                        let mut six = [0.0; 6];
                        for (x, law) in six.iter_mut().zip(&part.laws) {
                            let Some(law) = law else { continue };
                            for (then, share) in of.iter().filter(|(_, share)| *share != 0.0) {
                                *x += share
                                    * law.value(&mut values, |s| match s {
                                        Source::Quantity(q) => q.value(then, place, part.axes),
                                        Source::Coefficient(j) => f64::from(u8::from(j == k)),
                                        Source::Parameter(j) => given(j),
                                        Source::Constant(x) => x,
                                    });
                            }
                        }
                        let mut force = Vector3::new(six[0], six[1], six[2]);
                        let mut moment = Vector3::new(six[3], six[4], six[5]);
                        if part.axes == FormulaAxes::Link {
                            force = link.rotation * force;
                            moment = link.rotation * moment;
                        }
                        out.force_at(i, k, &force, &place.position(&f));
                        out.couple(i, k, &moment);
                    }
                }
            }
        }
    }
}
