//! Parameters of a stage as stored in a manifest; different values have different keys.

use serde::Serialize;
use serde_json::Value;

/// A parameter as stored in a manifest. Different values have different keys: NaN, the infinities
/// and −0 are stored as words, because JSON has only `null`, or `-0.0` that equals zero, for them.
pub fn key(value: &impl Serialize) -> Value {
    // YAML can represent the numbers that JSON cannot
    serde_yaml::to_value(value).map_or_else(|e| Value::String(format!("cannot be written: {e}")), of_yaml)
}

fn of_yaml(value: serde_yaml::Value) -> Value {
    use serde_yaml::Value as Yaml;
    match value {
        Yaml::Null => Value::Null,
        Yaml::Bool(b) => Value::Bool(b),
        Yaml::String(s) => Value::String(s),
        Yaml::Sequence(all) => Value::Array(all.into_iter().map(of_yaml).collect()),
        Yaml::Number(n) => {
            let whole = n.as_u64().map(Value::from).or_else(|| n.as_i64().map(Value::from));
            whole.unwrap_or_else(|| of_float(n.as_f64().unwrap_or(f64::NAN)))
        }
        Yaml::Mapping(all) => Value::Object(
            all.into_iter()
                .map(|(k, v)| {
                    let name = match k {
                        Yaml::String(s) => s,
                        other => of_yaml(other).to_string(),
                    };
                    (name, of_yaml(v))
                })
                .collect(),
        ),
        Yaml::Tagged(tagged) => Value::Object([(tagged.tag.to_string(), of_yaml(tagged.value))].into_iter().collect()),
    }
}

fn of_float(x: f64) -> Value {
    if x.is_finite() && (x != 0.0 || x.is_sign_positive()) {
        Value::from(x)
    } else {
        Value::Object([("float".to_owned(), Value::String(format!("{x:?}")))].into_iter().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn different_numbers_are_different_keys() {
        let all: [Option<f64>; 9] = [
            None,
            Some(f64::NAN),
            Some(f64::INFINITY),
            Some(f64::NEG_INFINITY),
            Some(0.0),
            Some(-0.0),
            Some(1.0),
            Some(0.1),
            Some(0.1 + f64::EPSILON / 8.0),
        ];
        for (i, a) in all.iter().enumerate() {
            for (j, b) in all.iter().enumerate() {
                assert_eq!(key(a) == key(b), i == j, "{a:?} and {b:?}");
                // also after writing to a file and reading back
                let back: Value = serde_json::from_str(&key(a).to_string()).ok().unwrap_or_default();
                assert_eq!(back == key(b), i == j, "{a:?} and {b:?}");
            }
        }
        assert_eq!(key(&json!({"a": [1, -2, true, "x", null, 2.5]})), json!({"a": [1, -2, true, "x", null, 2.5]}));
    }
}
