//! Heat maps of values over two lists; small ones also show the numbers.

use super::base::{Figure, Words, axis, base_layout};
use crate::pack;
use serde_json::{Value, json};

/// Maps with fewer cells than this show their numbers.
const NUMBERS_IN: usize = 260;

/// Columns of a map.
#[derive(Debug, Clone, PartialEq)]
pub enum Columns {
    /// Names.
    Names(Vec<String>),
    /// Values along an axis, ascending.
    Values(Vec<f64>),
}

impl Default for Columns {
    fn default() -> Self {
        Self::Names(Vec::new())
    }
}

/// A heat map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HeatMap {
    /// Title of the columns, with unit.
    pub x_title: String,
    /// Columns.
    pub x: Columns,
    /// Rows, the first on top.
    pub y: Vec<String>,
    /// `z[row][column]`; NaN cells are blank.
    pub z: Vec<Vec<f64>>,
    /// Quantity shown, with unit, for the colour bar.
    pub unit: String,
    /// Resolution to keep, in the unit.
    pub step: f64,
    /// Upper end of the colour scale; the largest value if not given.
    pub top: Option<f64>,
    /// Numbers for the cells and the CSV if `z` gives only their shade, and their quantity with
    /// unit.
    pub values: Option<(Vec<Vec<f64>>, String)>,
}

/// Formats with three significant digits.
fn short(v: f64) -> String {
    let a = v.abs();
    if !v.is_finite() {
        String::new()
    } else if a >= 100.0 {
        format!("{v:.0}")
    } else if a >= 10.0 {
        format!("{v:.1}")
    } else if a >= 1.0 || a == 0.0 {
        format!("{v:.2}")
    } else if a >= 0.001 {
        format!("{:.*}", 2 + (-a.log10()).floor() as usize + usize::from(a < 0.1), v)
    } else {
        format!("{v:.1e}")
    }
}

impl Figure {
    /// Draws a heat map.
    pub fn heat_map(words: Words<'_>, map: &HeatMap) -> Self {
        let width = map.z.first().map_or(0, Vec::len);
        let cells = width * map.y.len();
        let step = if map.step > 0.0 { map.step } else { 1e-3 };
        let z: Vec<Value> = map.z.iter().map(|row| pack::steps(row.iter().copied(), step)).collect();
        let largest = map.z.iter().flatten().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(*v));
        let x = match &map.x {
            Columns::Names(names) => json!(names),
            Columns::Values(values) => pack::numbers(values),
        };
        let mut trace = json!({"type": "heatmap", "x": x, "y": map.y, "z": z, "colorscale": "$sequence", "zmin": 0,
            "zmax": pack::number(map.top.unwrap_or(largest).max(step)), "hoverongaps": false, "name": map.unit,
            "hovertemplate": format!("%{{y}} · %{{x}}: %{{z:.4g}} <extra>{}</extra>", map.unit),
            "colorbar": {"title": {"text": map.unit, "side": "right"}, "thickness": 12, "outlinewidth": 0}});
        let mut layout = base_layout();
        layout["xaxis"] = axis(&map.x_title);
        layout["yaxis"] = axis("");
        layout["yaxis"]["autorange"] = json!("reversed");
        for key in ["xaxis", "yaxis"] {
            layout[key]["showgrid"] = json!(false);
            layout[key]["ticks"] = json!("");
            layout[key]["showline"] = json!(false);
            layout[key]["zeroline"] = json!(false);
        }
        // names stay text: `01` is not a number
        layout["yaxis"]["type"] = json!("category");
        if matches!(map.x, Columns::Names(_)) {
            layout["xaxis"]["type"] = json!("category");
            trace["xgap"] = json!(1);
            trace["ygap"] = json!(1);
        }
        let crowded = cells >= NUMBERS_IN || width > 16;
        if !crowded && cells > 0 {
            trace["texttemplate"] = json!("%{z:.3~g}");
            trace["textfont"] = json!({"size": 11});
        }
        if let Some((values, unit)) = &map.values {
            trace["values"] = values.iter().map(|row| pack::numbers(row)).collect();
            trace["text"] = values.iter().map(|row| row.iter().map(|v| short(*v)).collect::<Value>()).collect();
            trace["texttemplate"] = json!("%{text}");
            trace["textfont"] = json!({"size": 11});
            trace["hovertemplate"] =
                json!(format!("%{{y}} · %{{x}}: %{{text}} {unit} (shade %{{z:.2f}})<extra></extra>"));
        }
        layout["margin"]["t"] = json!(32);
        let row = if crowded { 15 } else { 22 };
        let height = 32 + 80 + map.y.len().max(3) * row;
        let plot = json!({"data": [trace], "layout": layout, "lists": [], "x": map.x_title, "panels": [map.values.as_ref().map_or(&map.unit, |v| &v.1)]});
        Self::new("chart", words, height, plot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_keeps_its_holes_and_its_unit() {
        let map = HeatMap {
            x: Columns::Names(vec!["a".into(), "b".into()]),
            y: vec!["r".into()],
            z: vec![vec![f64::NAN, 2.5]],
            unit: "mm".into(),
            step: 0.01,
            ..HeatMap::default()
        };
        let f = Figure::heat_map(Words::new("t", "c"), &map);
        let z = &f.data()["data"][0]["z"][0];
        assert_eq!(z["s"], 0.01);
        assert_eq!(z["b"], pack::base64(&[0, 0x80, 250, 0]));
        assert_eq!(f.data()["data"][0]["colorbar"]["title"]["text"], "mm");
        assert_eq!(f.data()["data"][0]["zmax"], 2.5);
    }
}
