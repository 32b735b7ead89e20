//! One formula: parsed, units checked, linear in the coefficients.

use super::parse::{self, Definition, Problem};
use super::quantity::{Quantity, names, quantity};
use super::spec::FormulaDefinition;
use super::unit::Unit;
use crate::{EffectsError, FormulaProblem, Scene};
use exmex::{Express, FlatEx};

/// Origin of a variable in a formula.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Source {
    Quantity(Quantity),
    Coefficient(usize),
    Parameter(usize),
    Constant(f64),
}

/// A name given by the user, and its meaning.
pub(super) struct Symbol {
    pub name: String,
    pub source: Source,
    pub unit: Unit,
    /// Position in the file: `coefficients[0]`.
    pub place: String,
}

/// An error in the formula `text` at `place` of an effect.
fn wrong_formula(effect: &str, place: &str, text: &str, p: Problem) -> EffectsError {
    EffectsError::Formula(Box::new(FormulaProblem {
        effect: effect.to_owned(),
        entry: place.to_owned(),
        formula: text.to_owned(),
        position: p.at,
        problem: p.text,
    }))
}

/// Unit of what a name stands for.
fn unit_of(scene: &Scene, symbols: &[Symbol], definitions: &[Definition], name: &str) -> Result<Unit, String> {
    let own = symbols.iter().find(|s| s.name == name).map(|s| s.unit);
    own.or_else(|| quantity(scene, name).map(|(_, u)| u)).ok_or_else(|| {
        let own = symbols.iter().map(|s| &s.name).chain(definitions.iter().map(|d| &d.name));
        let own = own.map(String::as_str).collect::<Vec<_>>().join(" ");
        format!("nothing is called `{name}`; there are {own}, {}, and q_<link>, qd_<link> of hinges", names())
    })
}

/// Parses the definitions of an effect and checks their units, each after those before it.
pub(super) fn definitions(
    effect: &str,
    scene: &Scene,
    symbols: &[Symbol],
    given: &[FormulaDefinition],
) -> Result<Vec<Definition>, EffectsError> {
    let mut out: Vec<Definition> = Vec::new();
    for (i, d) in given.iter().enumerate() {
        let fail = |p: Problem| wrong_formula(effect, &format!("definitions[{i}].formula"), &d.formula, p);
        let made = Definition::new(&d.name, &d.formula, &out).map_err(fail)?;
        made.node.unit(&|name| unit_of(scene, symbols, &out, name)).map_err(fail)?;
        out.push(made);
    }
    Ok(out)
}

#[derive(Debug)]
pub(super) struct Law {
    expression: FlatEx<f64>,
    /// Origins of the expression's variables, in their order.
    pub sources: Vec<Source>,
}

impl Law {
    /// Parses a formula; `None` for a formula that is zero. `place` is the formula's position in
    /// the file, `force[0]`.
    pub fn new(
        effect: &str,
        scene: &Scene,
        symbols: &[Symbol],
        definitions: &[Definition],
        place: &str,
        text: &str,
        wanted: (&str, Unit),
    ) -> Result<Option<Self>, EffectsError> {
        let fail = |p: Problem| wrong_formula(effect, place, text, p);
        let node = parse::parse(text).and_then(|node| node.with(definitions)).map_err(fail)?;
        let find = |name: &str| {
            symbols
                .iter()
                .find(|s| s.name == name)
                .map(|s| (s.source, s.unit))
                .or_else(|| quantity(scene, name).map(|(q, u)| (Source::Quantity(q), u)))
        };
        let unit = node.unit(&|name| unit_of(scene, symbols, definitions, name)).map_err(fail)?;
        if node.constant() == Some(0.0) {
            return Ok(None);
        }
        let (what, wanted) = wanted;
        if !unit.same(wanted) {
            let text = format!("the unit is {}, a {what} has {}", unit.describe(), wanted.describe());
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
        let law = Self { expression, sources };
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

    /// Value of the formula; `values` is workspace.
    pub fn value(&self, values: &mut Vec<f64>, of: impl Fn(Source) -> f64) -> f64 {
        values.clear();
        values.extend(self.sources.iter().map(|s| of(*s)));
        self.expression.eval(values).unwrap_or(f64::NAN)
    }

    /// Checks that the formula is linear in the coefficients, without a constant part, at arbitrary
    /// values of everything else.
    fn check_linear(&self, symbols: &[Symbol]) -> Result<(), String> {
        let n = symbols.iter().filter(|s| matches!(s.source, Source::Coefficient(_))).count();
        let mut values = Vec::new();
        for trial in 0..6u32 {
            // arbitrary but fixed numbers of order one, positive so that roots and logarithms exist
            let arbitrary =
                |i: usize| 0.3 + ((i as f64 + 1.0) * 0.754_877_666 + f64::from(trial) * 0.569_840_29).fract();
            let mut at = |c: &dyn Fn(usize) -> f64| {
                self.value(&mut values, |s| match s {
                    Source::Coefficient(k) => c(k),
                    Source::Constant(x) => x,
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
