//! Dot plot of values with intervals by name: estimates against tables, ratios of candidates.

use super::base::{Figure, Words, axis, base_layout};
use super::panels::{COLOURS, Line};
use crate::pack;
use serde_json::{Value, json};

/// Symbols that can be distinguished without colour.
const SIGNS: [&str; 6] = ["circle", "diamond-open", "square-open", "triangle-up-open", "cross-thin-open", "star-open"];

/// One kind of value, with one value per name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Dots {
    /// Name in the legend; empty to leave it out of the legend.
    pub name: String,
    /// Values; NaN if missing.
    pub values: Vec<f64>,
    /// Lower and upper ends of the intervals; empty if there are none.
    pub intervals: Vec<[f64; 2]>,
}

impl Dots {
    /// Values without intervals.
    pub fn new(name: impl Into<String>, values: Vec<f64>) -> Self {
        Self { name: name.into(), values, intervals: Vec::new() }
    }
    /// Values with intervals of ± `half`.
    pub fn with_half(name: impl Into<String>, values: Vec<f64>, half: &[f64]) -> Self {
        let intervals = values.iter().zip(half).map(|(v, h)| [v - h, v + h]).collect();
        Self { name: name.into(), values, intervals }
    }
}

impl Figure {
    /// Values with intervals, one line per name, the first name on top; with vertical reference
    /// lines.
    pub fn dots(words: Words<'_>, x_title: &str, names: &[String], kinds: &[Dots], lines: &[Line]) -> Self {
        // a kind keeps its colour and symbol even if others are empty
        let kinds: Vec<(usize, &Dots)> =
            kinds.iter().enumerate().filter(|(_, k)| k.values.iter().any(|v| v.is_finite())).collect();
        let n = kinds.len().max(1) as f64;
        let crowded = (0..names.len())
            .any(|i| kinds.iter().filter(|(_, k)| k.values.get(i).is_some_and(|v| v.is_finite())).count() > 1);
        let apart = crowded && kinds.iter().any(|(_, k)| !k.intervals.is_empty());
        let data: Vec<Value> = kinds
            .iter()
            .enumerate()
            .map(|(place, (k, kind))| {
                // kinds are shifted slightly downwards, so that their intervals do not overlap
                let shift = if apart { (place as f64 / (n - 1.0) - 0.5) * 0.56 } else { 0.0 };
                let y: Vec<f64> = (0..names.len()).map(|i| i as f64 + shift).collect();
                let colour = COLOURS[k % COLOURS.len()];
                let mut t = json!({"type": "scatter", "mode": "markers", "name": kind.name, "x": pack::numbers(&kind.values),
                    "y": pack::numbers(&y), "names": names, "showlegend": !kind.name.is_empty(),
                    "text": names, "hovertemplate": "%{text}: %{x:.4g}<extra>%{fullData.name}</extra>",
                    "marker": {"color": colour, "symbol": SIGNS[k % SIGNS.len()], "size": 9, "line": {"width": 1.8, "color": colour}}});
                if !kind.intervals.is_empty() {
                    let up: Vec<f64> = kind.intervals.iter().zip(&kind.values).map(|(i, v)| i[1] - v).collect();
                    let down: Vec<f64> = kind.intervals.iter().zip(&kind.values).map(|(i, v)| v - i[0]).collect();
                    t["error_x"] = json!({"type": "data", "symmetric": false, "array": pack::numbers(&up),
                        "arrayminus": pack::numbers(&down), "thickness": 1.6, "width": 4, "color": colour});
                }
                t
            })
            .collect();
        let mut layout = base_layout();
        layout["xaxis"] = axis(x_title);
        layout["yaxis"] = axis("");
        layout["yaxis"]["tickvals"] = json!((0..names.len()).collect::<Vec<_>>());
        layout["yaxis"]["ticktext"] = json!(names);
        layout["yaxis"]["range"] = json!([names.len() as f64 - 0.4, -0.6]);
        layout["yaxis"]["zeroline"] = json!(false);
        layout["yaxis"]["ticks"] = json!("");
        let labels: Vec<Value> = lines
            .iter()
            .map(|l| {
                json!({"xref": "x", "yref": "paper", "x": pack::number(l.at), "y": 1, "xanchor": "center", "yanchor": "bottom",
                "text": l.label, "showarrow": false, "font": {"size": 11, "color": "$dim"}})
            })
            .collect();
        layout["annotations"] = Value::Array(labels);
        layout["shapes"] = lines
            .iter()
            .map(|l| {
                json!({"type": "line", "layer": "below", "xref": "x", "yref": "paper", "x0": pack::number(l.at),
                "x1": pack::number(l.at), "y0": 0, "y1": 1, "line": {"color": "$dim", "width": 1.3, "dash": "dot"}})
            })
            .collect();
        if kinds.iter().all(|(_, k)| k.name.is_empty()) {
            layout["showlegend"] = json!(false);
        }
        let row = if apart { 14 + 7 * kinds.len() } else { 21 };
        let height = 44 + 56 + names.len().max(2) * row;
        Self::new(
            "chart",
            words,
            height,
            json!({"data": data, "layout": layout, "lists": [], "x": x_title, "panels": [""]}),
        )
    }
}
