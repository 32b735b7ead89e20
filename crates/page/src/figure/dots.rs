//! Dot plot of values with intervals by name: estimates against tables, ratios of candidates.

use super::base::{Figure, Words};
use super::chart::Line;
use super::html::{escape, percent, short, tick, ticks};
use crate::pack;
use serde_json::{Value, json};
use std::fmt::Write;

/// Symbols that can be distinguished without colour.
const SIGNS: [&str; 6] = ["●", "◇", "□", "△", "✕", "☆"];

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
    fn value(&self, i: usize) -> Option<f64> {
        self.values.get(i).copied().filter(|v| v.is_finite())
    }
    fn interval(&self, i: usize) -> Option<[f64; 2]> {
        self.intervals.get(i).copied().filter(|x| x.iter().all(|v| v.is_finite()))
    }
}

/// Range of the abscissa: all values and lines. An interval many times as wide as the values is cut
/// off rather than the values pressed together.
fn range(kinds: &[(usize, &Dots)], lines: &[Line]) -> [f64; 2] {
    let mut out = [f64::INFINITY, f64::NEG_INFINITY];
    let mut grow = |v: f64| {
        if v.is_finite() {
            out = [out[0].min(v), out[1].max(v)];
        }
    };
    kinds.iter().flat_map(|(_, k)| &k.values).for_each(|v| grow(*v));
    lines.iter().for_each(|l| grow(l.at));
    let [low, high] = out;
    if !(low.is_finite() && high.is_finite()) {
        return [0.0, 1.0];
    }
    let (low, high) = (low.min(if low > 0.0 && low < 0.7 * high { 0.0 } else { low }), high);
    let reach = (high - low).max(1e-9 * high.abs()).max(1e-12);
    let (mut from, mut to) = (low, high);
    for end in kinds.iter().flat_map(|(_, k)| &k.intervals).flatten().filter(|v| v.is_finite()) {
        from = from.min(end.max(low - reach));
        to = to.max(end.min(high + reach));
    }
    let margin = 0.03 * (to - from).max(reach);
    [if from == 0.0 { 0.0 } else { from - margin }, to + margin]
}

/// Height of a row of labels above the plot, rem.
const UPPER_REM: f64 = 1.1;
/// Letters that fit beside each other above a narrow plot.
const LETTERS: f64 = 44.0;

/// The row of each label above the plot, 0 on top, and the number of rows: labels that would touch
/// each other stand in different rows. Each is its place, as a share of the width, and its text.
fn rows_of_labels(labels: &[(f64, &str)]) -> (Vec<usize>, usize) {
    let letters = |k: usize| labels[k].1.chars().count() as f64;
    let touch = |i: usize, k: usize| {
        let (left, right) = if labels[i].0 < labels[k].0 { (i, k) } else { (k, i) };
        let (from, to) = (labels[left].0, labels[right].0);
        LETTERS * (to - from) < letters(left) * (1.0 - from) + letters(right) * to + 1.0
    };
    let mut rows: Vec<usize> = Vec::new();
    for i in 0..labels.len() {
        let taken = |row: usize| (0..i).any(|k| rows[k] == row && touch(i, k));
        rows.push((0..=i).find(|row| !taken(*row)).unwrap_or(i));
    }
    let n = rows.iter().max().map_or(0, |m| m + 1);
    (rows, n)
}

impl Figure {
    /// Values with intervals, one line per name, the first name on top; with vertical reference
    /// lines.
    pub fn dots(words: Words<'_>, x_title: &str, names: &[String], kinds: &[Dots], lines: &[Line]) -> Self {
        // a kind keeps its colour and symbol even if others are empty
        let kinds: Vec<(usize, &Dots)> =
            kinds.iter().enumerate().filter(|(_, k)| k.values.iter().any(|v| v.is_finite())).collect();
        let crowded = (0..names.len()).any(|i| kinds.iter().filter(|(_, k)| k.value(i).is_some()).count() > 1);
        let lanes = if crowded && kinds.iter().any(|(_, k)| !k.intervals.is_empty()) { kinds.len() } else { 1 };
        let [from, to] = range(&kinds, lines);
        let share = |v: f64| ((v - from) / (to - from)).clamp(0.0, 1.0);
        let marks = ticks(from, to, 6);
        let mut html = String::new();
        if kinds.iter().any(|(_, k)| !k.name.is_empty()) {
            html.push_str("<p class=\"legend\">");
            for (k, kind) in &kinds {
                let _ = write!(
                    html,
                    "<span><b class=\"k{k}\">{}</b> {}</span>",
                    SIGNS[k % SIGNS.len()],
                    escape(&kind.name)
                );
            }
            html.push_str("</p>");
        }
        let grid: String =
            marks.iter().map(|m| format!("<i class=\"grid\" style=\"left:{}\"></i>", percent(share(*m)))).collect();
        let refs: String =
            lines.iter().map(|l| format!("<i class=\"ref\" style=\"left:{}\"></i>", percent(share(l.at)))).collect();
        let _ = write!(html, "<div class=\"dots\" style=\"--lanes:{lanes}\">");
        if !lines.is_empty() {
            let at: Vec<(f64, &str)> = lines.iter().map(|l| (share(l.at), l.label.as_str())).collect();
            let (rows, n_rows) = rows_of_labels(&at);
            let label = |((at, text), row): (&(f64, &str), &usize)| {
                // within the plot at any width: moved left by the share of its own width at which
                // it lies
                let at = percent(*at);
                let top = UPPER_REM * *row as f64;
                format!(
                    "<span class=\"at\" style=\"left:{at};transform:translateX(-{at});top:{top}rem\">{}</span>",
                    escape(text)
                )
            };
            let labels: String = at.iter().zip(&rows).map(label).collect();
            let height = UPPER_REM * n_rows as f64;
            let _ =
                write!(html, "<span></span><span class=\"scale upper\" style=\"height:{height}rem\">{labels}</span>");
        }
        for (i, name) in names.iter().enumerate() {
            let _ = write!(html, "<span class=\"name\">{}</span><span class=\"lane\">{grid}{refs}", escape(name));
            for (lane, (k, kind)) in kinds.iter().enumerate() {
                let Some(value) = kind.value(i) else { continue };
                let lane = if lanes > 1 { lane } else { 0 };
                let mut told =
                    format!("{name}, {}: {}", if kind.name.is_empty() { x_title } else { &kind.name }, short(value));
                if let Some([low, high]) = kind.interval(i) {
                    let cut = |outside: bool, side: &str| if outside { format!(" cut-{side}") } else { String::new() };
                    let _ = write!(
                        html,
                        "<i class=\"bar k{k}{}{}\" style=\"left:{};width:{};--lane:{lane}\"></i>",
                        cut(low < from, "low"),
                        cut(high > to, "high"),
                        percent(share(low)),
                        percent(share(high) - share(low))
                    );
                    let _ = write!(told, " ({} to {})", short(low), short(high));
                }
                let _ = write!(
                    html,
                    "<b class=\"dot k{k}\" style=\"left:{};--lane:{lane}\" title=\"{}\">{}</b>",
                    percent(share(value)),
                    escape(&told),
                    SIGNS[k % SIGNS.len()]
                );
            }
            html.push_str("</span>");
        }
        let labels: String = marks
            .iter()
            .map(|m| format!("<span class=\"at\" style=\"left:{}\">{}</span>", percent(share(*m)), tick(*m)))
            .collect();
        let _ = write!(
            html,
            "<span></span><span class=\"scale\">{labels}</span><span></span><span class=\"x-title\">{}</span></div>",
            escape(x_title)
        );
        let data: Vec<Value> = kinds
            .iter()
            .map(|(_, k)| {
                let end = |which: usize| {
                    let ends = (0..names.len()).map(|i| k.interval(i).map_or(f64::NAN, |x| x[which]));
                    pack::numbers(&ends.collect::<Vec<f64>>())
                };
                json!({"name": k.name, "values": pack::numbers(&k.values), "lower": end(0), "upper": end(1)})
            })
            .collect();
        Self::still(words, html, json!({"kind": "dots", "x": x_title, "names": names, "series": data}))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_lie_on_a_round_scale_and_tell_their_interval() {
        let kinds =
            [Dots::with_half("identified", vec![2.0, f64::NAN], &[0.5, 1.0]), Dots::new("<prior>", vec![1.0, 3.0])];
        let f = Figure::dots(Words::new("t", "c"), "mass, kg", &["a".into(), "b".into()], &kinds, &[]);
        let html = f.html();
        assert!(html.contains("title=\"a, identified: 2.00 (1.50 to 2.50)\""), "{html}");
        assert!(html.contains("&lt;prior&gt;") && html.contains(">mass, kg<"));
        assert_eq!(html.matches("class=\"dot k").count(), 3, "a missing value has no dot");
    }

    #[test]
    fn labels_of_lines_that_are_near_stand_in_rows() {
        let (one, floor) = ("explains nothing", "noise floor");
        assert_eq!(rows_of_labels(&[(0.95, one), (0.4, floor)]), (vec![0, 0], 1));
        assert_eq!(rows_of_labels(&[(0.95, one), (0.8, floor), (0.1, "a")]), (vec![0, 1, 0], 2));
        assert_eq!(rows_of_labels(&[(0.12, "floor"), (0.36, "3 ×")]), (vec![0, 0], 1));
        assert_eq!(rows_of_labels(&[]), (vec![], 0));
    }

    #[test]
    fn an_interval_of_any_width_leaves_the_values_apart() {
        let kinds = [Dots { name: String::new(), values: vec![1.0, 2.0], intervals: vec![[-1e6, 1e6], [1.9, 2.1]] }];
        let [from, to] = range(&[(0, &kinds[0])], &[]);
        assert!(to - from < 10.0, "{from} to {to}");
        let f = Figure::dots(Words::new("t", "c"), "x", &["a".into(), "b".into()], &kinds, &[]);
        assert!(f.html().contains("cut-low cut-high"));
    }
}
