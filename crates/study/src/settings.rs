//! Settings that are tried out one by one, by their place in the pipeline file.

use crate::config::PipelineConfig;
use crate::ranges::{Outside, outside};
use aloft_workspace::error::PipelineError;
use serde_yaml::{Mapping, Value};
use std::collections::BTreeMap;

/// A setting that can be tried: its place in the pipeline file, a title and what its value means.
#[derive(Debug, Clone, Copy)]
pub struct Adjustable {
    /// Place in the pipeline file, sections and key with dots between them.
    pub path: &'static str,
    /// Title.
    pub title: &'static str,
    /// Unit; empty for none.
    pub unit: &'static str,
    /// What the value means where that is not plain.
    pub note: &'static str,
}

/// The settings that are tried most.
pub static ADJUSTABLE: [Adjustable; 7] = [
    Adjustable {
        path: "filter.cutoff_hz",
        title: "Filter cut-off",
        unit: "Hz",
        note: "forces on frames; no part in weak rows",
    },
    Adjustable {
        path: "regressor.window_s",
        title: "Window in flight",
        unit: "s",
        note: "0: by the length of each flight. Also the windows that judge flights, so errors with other windows differ in kind",
    },
    Adjustable {
        path: "identify.prior_weight",
        title: "Weight of the prior",
        unit: "",
        note: "0: held-out error decides",
    },
    Adjustable { path: "flight.min_duration_s", title: "Shortest flight", unit: "s", note: "" },
    Adjustable { path: "flight.threshold_n", title: "Unloaded plate below", unit: "N", note: "" },
    Adjustable { path: "ik.marker_sd_m", title: "Marker standard deviation", unit: "m", note: "" },
    Adjustable { path: "calibrate.frames", title: "Frames of the calibration", unit: "", note: "" },
];

/// The number at a place of a configuration; none if there is no number.
pub fn number_at(config: &PipelineConfig, path: &str) -> Option<f64> {
    // none: every configuration can be written
    let mut value = serde_yaml::to_value(config).ok()?;
    for key in path.split('.') {
        value = value.get(key)?.clone();
    }
    value.as_f64()
}

/// A configuration with other numbers at some places, checked as a pipeline file is.
///
/// # Errors
/// A place that pipelines do not have, a value outside its range.
pub fn with_numbers(config: &PipelineConfig, numbers: &BTreeMap<String, f64>) -> Result<PipelineConfig, PipelineError> {
    let wrong = |e: &dyn std::fmt::Display| PipelineError::request(format!("the settings cannot be used: {e}"));
    let mut value = serde_yaml::to_value(config).map_err(|e| wrong(&e))?;
    for (path, number) in numbers {
        // whole numbers stay whole, because some settings are counts
        let number = if number.fract() == 0.0 && number.abs() < 1e15 {
            Value::from(*number as i64)
        } else {
            Value::from(*number)
        };
        let mut at = &mut value;
        let keys: Vec<&str> = path.split('.').collect();
        for (i, key) in keys.iter().enumerate() {
            let Value::Mapping(map) = at else { return Err(wrong(&format!("`{path}` is not a pipeline setting"))) };
            let empty = || if i + 1 == keys.len() { Value::Null } else { Value::Mapping(Mapping::new()) };
            at = map.entry(Value::from(*key)).or_insert_with(empty);
        }
        *at = number;
    }
    if let Some(Outside { path, problem, hint }) = outside::<PipelineConfig>(&value) {
        return Err(PipelineError::Request { problem: format!("`{path}`: {problem}"), hint });
    }
    serde_yaml::from_value(value).map_err(|e| wrong(&e))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn config() -> PipelineConfig {
        serde_yaml::from_str("{name: t, data: d, model: m, marker_set: s, filter: {order: 3, cutoff_hz: 10.0}}")
            .unwrap()
    }

    #[test]
    fn numbers_reach_their_places_and_nothing_else_changes() {
        let changes = [("filter.cutoff_hz", 6.0), ("ik.weights.C7", 0.5), ("calibrate.frames", 200.0)];
        let changes = changes.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        let mut found = with_numbers(&config(), &changes).unwrap();
        assert_eq!((found.filter.cutoff_hz, found.calibrate.frames), (6.0, 200));
        assert_eq!(found.ik.weights.remove("C7"), Some(0.5));
        assert_eq!(number_at(&found, "filter.cutoff_hz"), Some(6.0));
        (found.filter.cutoff_hz, found.calibrate.frames) = (10.0, config().calibrate.frames);
        assert_eq!(found, config());
    }

    #[test]
    fn every_adjustable_setting_exists() {
        for a in &ADJUSTABLE {
            assert!(number_at(&config(), a.path).is_some(), "{}", a.path);
        }
    }

    #[test]
    fn what_a_pipeline_would_refuse_is_refused() {
        for (path, value) in
            [("filter.cutoff_hz", -1.0), ("filter.cutof_hz", 6.0), ("nothing.at", 1.0), ("name.x", 1.0)]
        {
            let changes = BTreeMap::from([(path.to_owned(), value)]);
            assert!(with_numbers(&config(), &changes).is_err(), "{path}");
        }
    }
}
