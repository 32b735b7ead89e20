//! Former names of settings and of their values. They keep working: a file that contains one is
//! read as if it had the present name, and commands print a warning.

use serde_yaml::Value;

/// Section, former key, present key.
const KEYS: &[(&str, &str, &str)] = &[("identify", "repeat_correlation", "flight_error_correlation")];

/// Section, key, former value, present value.
const VALUES: &[(&str, &str, &str, &str)] =
    &[("regressor", "rows", "paper", "acceleration"), ("identify", "estimator", "regularized", "regularised")];

/// Replaces former names anywhere in a configuration; returns one sentence for each replacement.
pub fn replace(value: &mut Value) -> Vec<String> {
    let mut found = Vec::new();
    walk(value, &mut found);
    found
}

fn walk(value: &mut Value, found: &mut Vec<String>) {
    match value {
        Value::Mapping(map) => {
            for (section, old, new) in KEYS {
                let Some(Value::Mapping(inner)) = map.get_mut(*section) else { continue };
                // both names in one section: left alone, and the parser reports a repeated setting
                if let (true, Some(setting)) = (!inner.contains_key(*new), inner.get(*old).cloned()) {
                    inner.remove(*old);
                    inner.insert((*new).into(), setting);
                    found.push(format!("`{section}.{old}` is now called `{section}.{new}`"));
                }
            }
            for (section, key, old, new) in VALUES {
                let Some(Value::Mapping(inner)) = map.get_mut(*section) else { continue };
                if inner.get(*key).and_then(Value::as_str) == Some(*old) {
                    inner.insert((*key).into(), (*new).into());
                    found.push(format!("`{section}.{key}: {old}` is now called `{section}.{key}: {new}`"));
                }
            }
            map.values_mut().for_each(|v| walk(v, found));
        }
        Value::Sequence(list) => list.iter_mut().for_each(|v| walk(v, found)),
        _ => {}
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn former_names_are_replaced_at_every_level() {
        let text = "regressor: {rows: paper}\noverrides:\n- {trial: a, set: {identify: {repeat_correlation: 0.2}}}\n";
        let mut value: Value = serde_yaml::from_str(text).unwrap();
        assert_eq!(replace(&mut value).len(), 2);
        assert_eq!(value["regressor"]["rows"], Value::from("acceleration"));
        assert_eq!(value["overrides"][0]["set"]["identify"]["flight_error_correlation"], Value::from(0.2));
        assert!(replace(&mut value).is_empty());
    }
}
