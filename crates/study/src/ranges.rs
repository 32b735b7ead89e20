//! Checks numbers against their ranges and reports where a wrong one is.
//!
//! The ranges are those of the JSON schema, which is generated from the types in [`crate::config`]:
//! one declaration serves `aloft schema`, `aloft check` and `aloft run`. A value is checked against
//! its range before anything is computed from it.

use crate::old_names;
use crate::place::{error_at, find, not_yaml};
use aloft_workspace::error::PipelineError;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;
use serde_yaml::Value;
use std::any::TypeId;
use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// An invalid value: its place, the problem, and the description of the setting.
#[derive(Debug, Clone, PartialEq)]
pub struct Outside {
    /// Path of keys, for example `overrides[1].set.filter.cutoff_hz`.
    pub path: String,
    /// The value and its range.
    pub problem: String,
    /// Description of the setting.
    pub hint: Option<String>,
}

/// Parses YAML with errors that point at the place. A number that is none (NaN, infinite) is
/// refused wherever it stands.
pub fn parse_yaml<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, PipelineError> {
    too_deep(file, text)?;
    let value = serde_yaml::from_str(text).map_err(|error| not_yaml(file, text, &error))?;
    finite(file, text)?;
    Ok(value)
}

/// Parses YAML and checks every number against its range.
///
/// # Errors
/// Points at the place of the invalid value.
pub fn parse<T: DeserializeOwned + JsonSchema + 'static>(file: &str, text: &str) -> Result<T, PipelineError> {
    too_deep(file, text)?;
    let mut value: Value = serde_yaml::from_str(text).map_err(|error| not_yaml(file, text, &error))?;
    let infinite = not_finite(&value, &mut String::new());
    old_names::replace(&mut value);
    if let Some(o) = outside::<T>(&value) {
        return Err(shown(file, text, &o));
    }
    let parsed = serde_yaml::from_str(text).map_err(|error| not_yaml(file, text, &error))?;
    infinite.map_or(Ok(parsed), |o| Err(shown(file, text, &o)))
}

/// The first value that is outside its range, or is not a number where one is required.
pub fn outside<T: JsonSchema + 'static>(value: &Value) -> Option<Outside> {
    let schema = schema_of::<T>();
    Walk { root: &schema }.at(&schema, value, &mut String::new())
}

/// The schema of a type, made once: it takes longer than the reading of most files.
fn schema_of<T: JsonSchema + 'static>() -> Arc<Json> {
    static MADE: LazyLock<Mutex<HashMap<TypeId, Arc<Json>>>> = LazyLock::new(Mutex::default);
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    Arc::clone(made.entry(TypeId::of::<T>()).or_insert_with(|| Arc::new(schemars::schema_for!(T).to_value())))
}

/// Rejects NaN and infinite numbers anywhere in a YAML text.
pub fn finite(file: &str, text: &str) -> Result<(), PipelineError> {
    // none: reading the values refuses a text that is no YAML
    let Ok(value) = serde_yaml::from_str::<Value>(text) else { return Ok(()) };
    match not_finite(&value, &mut String::new()) {
        Some(o) => Err(shown(file, text, &o)),
        None => Ok(()),
    }
}

/// Deepest nesting of lists and mappings: that at which the parser gives up in any case. Before it
/// does, the time that it takes grows with the square of the depth.
const DEEPEST: usize = 128;

/// Refuses YAML that is nested so deeply that the parser would take seconds over it. Brackets
/// within quotes and comments count, too: no text of either kind opens as many without closing
/// them. In block style each level takes at least one column of indentation or one of `- ? :`
/// followed by a space.
fn too_deep(file: &str, text: &str) -> Result<(), PipelineError> {
    let told = |at: usize| {
        let problem = format!("lists and mappings are nested deeper than {DEEPEST}");
        Err(error_at(file, text, Some((at, 1)), &problem, None))
    };
    let mut depth = 0_usize;
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > DEEPEST {
            return told(at);
        }
    }
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        let marks = line.split_whitespace().take_while(|word| matches!(*word, "-" | "?" | ":")).count();
        if marks > DEEPEST {
            return told(at);
        }
        at += line.len();
    }
    Ok(())
}

fn shown(file: &str, text: &str, o: &Outside) -> PipelineError {
    let at = find(text, &o.path).map(|at| (at, text[at..].find(['\n', ',', '}', ']']).unwrap_or(1).max(1)));
    error_at(file, text, at, &o.problem, o.hint.clone())
}

fn step<T>(path: &mut String, with: &str, inside: impl FnOnce(&mut String) -> Option<T>) -> Option<T> {
    let before = path.len();
    if !with.starts_with('[') && before > 0 {
        path.push('.');
    }
    path.push_str(with);
    let out = inside(path);
    if out.is_none() {
        path.truncate(before);
    }
    out
}

/// The number of a YAML value; NaN for one too large to represent.
fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Number(n) => n.as_f64(),
        _ => None,
    }
}

fn not_finite(value: &Value, path: &mut String) -> Option<Outside> {
    match value {
        Value::Number(_) => number(value).filter(|x| !x.is_finite()).map(|x| Outside {
            path: path.clone(),
            problem: format!("`{path}` is {x}, which is not a finite number"),
            hint: Some("give a finite number, or leave the setting out".to_owned()),
        }),
        Value::Sequence(list) => {
            list.iter().enumerate().find_map(|(i, v)| step(path, &format!("[{i}]"), |p| not_finite(v, p)))
        }
        Value::Mapping(map) => {
            map.iter().find_map(|(k, v)| step(path, k.as_str().unwrap_or_default(), |p| not_finite(v, p)))
        }
        Value::Tagged(t) => not_finite(&t.value, path),
        _ => None,
    }
}

struct Walk<'s> {
    root: &'s Json,
}

impl Walk<'_> {
    fn at(&self, schema: &Json, value: &Value, path: &mut String) -> Option<Outside> {
        if let Some(place) = schema.get("$ref").and_then(Json::as_str) {
            let target = self.root.pointer(place.trim_start_matches('#'))?;
            if let Some(o) = self.at(target, value, path) {
                return Some(o);
            }
        }
        for key in ["anyOf", "allOf", "oneOf"] {
            let branches = schema.get(key).and_then(Json::as_array);
            if let Some(o) = branches.into_iter().flatten().find_map(|branch| self.at(branch, value, path)) {
                return Some(o);
            }
        }
        match value {
            Value::Mapping(map) => map.iter().find_map(|(key, inner)| {
                let key = key.as_str()?;
                let own =
                    schema.get("properties").and_then(|p| p.get(key)).or_else(|| schema.get("additionalProperties"))?;
                step(path, key, |p| self.at(own, inner, p))
            }),
            Value::Sequence(list) => {
                let items = schema.get("items")?;
                list.iter().enumerate().find_map(|(i, v)| step(path, &format!("[{i}]"), |p| self.at(items, v, p)))
            }
            Value::Tagged(t) => self.at(schema, &t.value, path),
            Value::Null => None,
            _ => Self::scalar(schema, value, path),
        }
    }

    /// Checks a single value against a schema that requires a number.
    fn scalar(schema: &Json, value: &Value, path: &str) -> Option<Outside> {
        let whole = wants(schema)?;
        let limit = |key: &str| schema.get(key).and_then(Json::as_f64);
        let (low, high) = (limit("minimum"), limit("maximum"));
        let inside = |x: f64| {
            x.is_finite() && low.is_none_or(|l| x >= l) && high.is_none_or(|h| x <= h) && !(whole && x.fract() != 0.0)
        };
        if number(value).is_some_and(inside) {
            return None;
        }
        let found = match value {
            Value::String(s) => format!("`{s}`"),
            Value::Bool(b) => b.to_string(),
            other => number(other).map_or_else(|| "no number".to_owned(), shortest),
        };
        let kind = if whole { "a whole number" } else { "a number" };
        let range = match (low, high) {
            (Some(l), Some(h)) => format!("{kind} from {} to {}", shortest(l), shortest(h)),
            (Some(l), None) => format!("{kind} from {} on", shortest(l)),
            (None, Some(h)) => format!("{kind} up to {}", shortest(h)),
            (None, None) => kind.to_owned(),
        };
        Some(Outside {
            path: path.to_owned(),
            problem: format!("`{path}` is {found}, expected {range}"),
            hint: hint_for(value, schema),
        })
    }
}

/// What the setting is, and the number without the unit that stands behind it.
fn hint_for(value: &Value, schema: &Json) -> Option<String> {
    let bare = value.as_str().and_then(|s| s.split_whitespace().next()).filter(|word| word.parse::<f64>().is_ok());
    let bare = bare.map(|word| format!("write {word} without quotes and without a unit. "));
    let what = schema.get("description").and_then(Json::as_str);
    (bare.is_some() || what.is_some()).then(|| bare.unwrap_or_default() + what.unwrap_or_default())
}

/// Shortest form of a number: with an exponent instead of a row of zeros.
fn shortest(x: f64) -> String {
    if x != 0.0 && x.is_finite() && !(1e-4..1e7).contains(&x.abs()) { format!("{x:e}") } else { format!("{x}") }
}

/// Whether a schema requires a number and nothing else (apart from null), and whether it must be
/// whole.
fn wants(schema: &Json) -> Option<bool> {
    let words: Vec<&str> = match schema.get("type")? {
        Json::String(s) => vec![s],
        Json::Array(all) => all.iter().filter_map(Json::as_str).filter(|w| *w != "null").collect(),
        _ => return None,
    };
    match words.as_slice() {
        ["integer"] => Some(true),
        ["number"] => Some(false),
        _ => None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use crate::config::PipelineConfig;

    const BASE: &str = "name: x\nmodel: human34\nmarker_set: plug-in-gait-35\n";

    fn say(more: &str) -> String {
        parse::<PipelineConfig>("p.yaml", &format!("{BASE}{more}")).unwrap_err().to_string()
    }

    #[test]
    fn unit_a_value_outside_is_told_with_line_and_range() {
        assert_eq!(
            say("filter:\n  cutoff_hz: -1\n"),
            "p.yaml: line 5: `filter.cutoff_hz` is -1, expected a number from 0.1 to 1000"
        );
        assert!(
            say("filter: {order: 2.5}\n")
                .contains("line 4: `filter.order` is 2.5, expected a whole number from 1 to 12")
        );
        assert!(
            say("subject:\n  gravity_mps2: abc\n")
                .contains("line 5: `subject.gravity_mps2` is `abc`, expected a number")
        );
        assert!(say("subject: {mass_kg: .nan}\n").contains("`subject.mass_kg` is NaN"));
        assert!(say("ik: {weights: {LASI: .inf}}\n").contains("`ik.weights.LASI` is inf"));
        let over = "overrides:\n- {subject: a, set: {filter: {cutoff_hz: 5.0}}}\n- {subject: b, set: {flight: {threshold_n: -20}}}\n";
        assert!(say(over).contains("line 6: `overrides[1].set.flight.threshold_n` is -20"), "{}", say(over));
        assert!(parse::<PipelineConfig>("p.yaml", BASE).is_ok());
    }

    #[test]
    fn every_numeric_setting_has_a_range() {
        fn visit(schema: &Json, path: &str, n: &mut usize) {
            if wants(schema).is_some() {
                *n += 1;
                let bounds = [&schema["minimum"], &schema["maximum"]].map(Json::as_f64);
                assert!(bounds[0].is_some() && bounds[1].is_some() && bounds[0] < bounds[1], "{path}: {schema}");
            }
            match schema {
                Json::Object(map) => map.iter().for_each(|(k, v)| visit(v, &format!("{path}/{k}"), n)),
                Json::Array(list) => list.iter().enumerate().for_each(|(i, v)| visit(v, &format!("{path}/{i}"), n)),
                _ => {}
            }
        }
        let mut n = 0;
        visit(&crate::config_schema().to_value(), "", &mut n);
        assert!(n >= 30, "{n}");
    }
}
