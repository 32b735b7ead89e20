//! Heat maps of values over two lists. Maps of few cells are tables with their numbers; maps over
//! many columns are drawn by a script.

use super::base::{Figure, Words};
use super::heat::{SHADES, Scale};
use super::html::{escape, short};
use crate::pack;
use serde_json::{Value, json};

/// Maps with more columns than this are drawn without numbers.
const NUMBERS_UP_TO: usize = 16;
/// Height of a row of a map that a script draws, pixels.
const ROW_PX: usize = 14;

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
    /// Quantity shown, with unit.
    pub unit: String,
    /// Resolution to keep, in the unit.
    pub step: f64,
    /// How values become shades.
    pub scale: Scale,
    /// Recording whose time the columns are; empty for none.
    pub recording: String,
}

impl HeatMap {
    fn largest(&self) -> f64 {
        self.z.iter().flatten().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(*v))
    }

    /// Colours with their ends in words; colour is not the only sign, cells hold numbers.
    fn legend(&self) -> String {
        let [from, to] = self.scale.ends(self.largest());
        let shades: String = (0..SHADES).map(|k| format!("<i class=\"h{k}\"></i>")).collect();
        let unit = if self.scale == Scale::TimesFloor { String::new() } else { format!(" · {}", escape(&self.unit)) };
        format!(
            "<p class=\"shades\">{} <span aria-hidden=\"true\">{shades}</span> {}{unit}</p>",
            escape(&from),
            escape(&to)
        )
    }

    fn table(&self, names: &[String]) -> String {
        let largest = self.largest();
        let head: String = names.iter().map(|n| format!("<th scope=\"col\">{}</th>", escape(n))).collect();
        let cell = |v: &f64| match self.scale.shade(*v, largest) {
            Some(k) => format!("<td class=\"h{k}\">{}</td>", short(*v)),
            None => "<td></td>".to_owned(),
        };
        let row = |(name, values): (&String, &Vec<f64>)| {
            let cells: String = values.iter().map(cell).collect();
            format!("<tr><th scope=\"row\">{}</th>{cells}</tr>", escape(name))
        };
        let rows: String = self.y.iter().zip(&self.z).map(row).collect();
        let corner = match self.x_title.as_str() {
            "" => "<td></td>".to_owned(),
            title => format!("<th scope=\"col\">{}</th>", escape(title)),
        };
        format!(
            "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{}\"><table class=\"heat\"><thead><tr>{corner}{head}</tr></thead>\
             <tbody>{rows}</tbody></table></div>{}",
            escape(&self.unit),
            self.legend()
        )
    }
}

impl Figure {
    /// Draws a heat map.
    pub fn heat_map(words: Words<'_>, map: &HeatMap) -> Self {
        let step = if map.step > 0.0 { map.step } else { 1e-3 };
        let z: Vec<Value> = map.z.iter().map(|row| pack::steps(row.iter().copied(), step)).collect();
        let x = match &map.x {
            Columns::Names(names) => json!(names),
            Columns::Values(values) => pack::numbers(values),
        };
        let mut data = json!({"kind": "map", "x": x, "x_title": map.x_title, "y": map.y, "z": z, "unit": map.unit});
        let named = match &map.x {
            Columns::Names(names) if names.len() <= NUMBERS_UP_TO => Some(names),
            _ => None,
        };
        if let Some(names) = named {
            return Self::still(words, map.table(names), data);
        }
        let largest = map.largest();
        let shade = |v: &f64| map.scale.shade(*v, largest).map_or(f64::NAN, |k| k as f64);
        data["shade"] = map.z.iter().map(|row| pack::steps(row.iter().map(shade), 1.0)).collect();
        data["legend"] = json!(map.scale.ends(largest));
        data["recording"] = json!(map.recording);
        Self::new("map", words, map.y.len() * ROW_PX + 58, data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_map_is_a_table_with_holes_and_shades() {
        let map = HeatMap {
            x: Columns::Names(vec!["a".into(), "<b>".into()]),
            y: vec!["r".into()],
            z: vec![vec![f64::NAN, 2.5]],
            unit: "times the floor".into(),
            step: 0.01,
            scale: Scale::TimesFloor,
            ..HeatMap::default()
        };
        let f = Figure::heat_map(Words::new("t", "c"), &map);
        assert!(f.html().contains("<td></td><td class=\"h3\">2.50</td>") && f.html().contains("&lt;b&gt;"));
        assert_eq!(f.data()["z"][0]["b"], pack::base64(&[0, 0x80, 250, 0]));
    }

    #[test]
    fn a_map_over_time_is_drawn_by_the_script() {
        let map = HeatMap {
            x: Columns::Values((0..40).map(f64::from).collect()),
            y: vec!["r".into()],
            z: vec![vec![1.0; 40]],
            recording: "jump".into(),
            ..HeatMap::default()
        };
        let f = Figure::heat_map(Words::new("t", "c"), &map);
        assert_eq!((f.drawn_by, f.data()["recording"].as_str()), ("map", Some("jump")));
    }
}
