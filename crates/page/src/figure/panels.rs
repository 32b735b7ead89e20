//! Line charts in panels that share the abscissa.

use super::base::{Figure, Words, axis, base_layout};
use crate::pack;
use serde_json::{Value, json};

/// Colours that people with colour-vision deficiency can distinguish (Okabe and Ito), as names of
/// the page's theme.
pub(super) const COLOURS: [&str; 6] = ["$c0", "$c1", "$c2", "$c3", "$c4", "$c5"];
const PANEL_PX: f64 = 138.0;
const ROW_GAP_PX: f64 = 34.0;
const FLIGHT_LABELS: usize = 6;

/// One curve.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// Name in the legend; empty to leave it out of the legend.
    pub name: String,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Ordinates; NaN makes a gap.
    pub y: Vec<f64>,
    /// Draw points at the values.
    pub points: bool,
    /// Draw no line between points.
    pub no_line: bool,
    /// Draw the line dashed.
    pub dashed: bool,
    /// Colour of the theme; the next free one if not given.
    pub colour: Option<&'static str>,
    /// Leave it out of the legend; its name is shown under the pointer and in the CSV.
    pub quiet: bool,
}

impl Series {
    /// A plain line.
    pub fn line(name: impl Into<String>, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), x, y, ..Self::default() }
    }
    /// The same curve, dashed.
    pub fn dashed(self) -> Self {
        Self { dashed: true, ..self }
    }
    /// The same curve, with points.
    pub fn with_points(self) -> Self {
        Self { points: true, ..self }
    }
    /// The same curve in a colour of the theme.
    pub fn coloured(self, colour: &'static str) -> Self {
        Self { colour: Some(colour), ..self }
    }
}

/// A shaded interval of the abscissa: a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shade {
    /// Start.
    pub from: f64,
    /// End.
    pub to: f64,
}

/// A mean with a band around it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Band {
    /// Name in the legend.
    pub name: String,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Mean.
    pub mean: Vec<f64>,
    /// Half-height of the band.
    pub sd: Vec<f64>,
    /// Colour of the theme.
    pub colour: Option<&'static str>,
}

/// A reference line across a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Position.
    pub at: f64,
    /// Vertical at an abscissa; otherwise horizontal at an ordinate.
    pub upright: bool,
    /// Label next to it.
    pub label: String,
}

/// One panel.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Panel {
    /// Title.
    pub title: String,
    /// Title of the ordinate, with unit.
    pub y: String,
    /// Curves.
    pub series: Vec<Series>,
    /// Bands.
    pub bands: Vec<Band>,
    /// Reference lines.
    pub lines: Vec<Line>,
    /// True if the ordinate starts at zero.
    pub from_zero: bool,
    /// True if the ordinate is logarithmic.
    pub log: bool,
    /// Names at the abscissae 0, 1, 2 …; empty if the abscissa is a quantity.
    pub ticks: Vec<String>,
}

#[derive(Default)]
struct Names {
    names: Vec<String>,
    shown: Vec<String>,
}

impl Names {
    fn colour(&mut self, name: &str, wanted: Option<&'static str>) -> &'static str {
        if let Some(colour) = wanted {
            return colour;
        }
        let i = self.names.iter().position(|n| n == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        });
        COLOURS[i % COLOURS.len()]
    }
    fn first(&mut self, name: &str) -> bool {
        let new = !name.is_empty() && !self.shown.iter().any(|s| s == name);
        if new {
            self.shown.push(name.to_owned());
        }
        new
    }
}

fn suffix(panel: usize) -> String {
    if panel == 0 { String::new() } else { (panel + 1).to_string() }
}

fn band_traces(band: &Band, panel: usize, pool: &mut Pool, names: &mut Names) -> [Value; 3] {
    let colour = names.colour(&band.name, band.colour);
    let edge = |sign: f64| band.mean.iter().zip(&band.sd).map(|(m, s)| m + sign * s).collect::<Vec<f64>>();
    let (xa, ya) = (format!("x{}", suffix(panel)), format!("y{}", suffix(panel)));
    let x = pool.add(&band.x);
    let rim = |y: Value, fill: bool| {
        let mut t = json!({"type": "scatter", "x": x, "y": y, "mode": "lines", "line": {"width": 0, "color": colour},
            "xaxis": xa, "yaxis": ya, "legendgroup": band.name, "showlegend": false, "hoverinfo": "skip", "csv": false});
        if fill {
            t["fill"] = json!("tonexty");
            t["fillcolor"] = json!(format!("{colour}/0.22"));
        }
        t
    };
    let (low, high) = (pool.add(&edge(-1.0)), pool.add(&edge(1.0)));
    [
        rim(low, false),
        rim(high, true),
        json!({"type": "scatter", "x": x, "y": pool.add(&band.mean), "mode": "lines", "name": band.name,
            "line": {"color": colour, "width": 2}, "xaxis": xa, "yaxis": ya, "legendgroup": band.name,
            "showlegend": names.first(&band.name), "sd": pool.add(&band.sd)}),
    ]
}

fn trace(s: &Series, panel: usize, pool: &mut Pool, names: &mut Names) -> Value {
    let colour = names.colour(&s.name, s.colour);
    let mode = match (s.no_line, s.points) {
        (true, _) => "markers",
        (false, true) => "lines+markers",
        (false, false) => "lines",
    };
    let mut t = json!({
        "type": "scatter", "x": pool.add(&s.x), "y": pool.add(&s.y), "mode": mode, "name": s.name,
        "line": {"color": colour, "width": 1.6, "dash": if s.dashed { "dash" } else { "solid" }},
        "marker": {"color": colour, "size": 8},
        "xaxis": format!("x{}", suffix(panel)), "yaxis": format!("y{}", suffix(panel)),
        "legendgroup": s.name, "showlegend": !s.quiet && names.first(&s.name)
    });
    if s.name.is_empty() {
        t["hoverinfo"] = json!("x+y");
    }
    t
}

fn reference(line: &Line, panel: usize) -> (Value, Value) {
    let (x, y) = (format!("x{}", suffix(panel)), format!("y{}", suffix(panel)));
    let at = pack::number(line.at);
    let style = json!({"color": "$dim", "width": 1.3, "dash": "dot"});
    let font = json!({"size": 11, "color": "$dim"});
    if line.upright {
        (
            json!({"type": "line", "xref": x, "yref": format!("{y} domain"), "x0": at, "x1": at, "y0": 0, "y1": 1, "line": style}),
            json!({"xref": x, "yref": format!("{y} domain"), "x": at, "y": 1, "xanchor": "left", "yanchor": "top",
                "text": line.label, "showarrow": false, "font": font}),
        )
    } else {
        (
            json!({"type": "line", "xref": format!("{x} domain"), "yref": y, "x0": 0, "x1": 1, "y0": at, "y1": at, "line": style}),
            json!({"xref": format!("{x} domain"), "yref": y, "x": 1, "y": at, "xanchor": "right", "yanchor": "bottom",
                "text": line.label, "showarrow": false, "font": font}),
        )
    }
}

impl Figure {
    /// Panels in `columns` columns that share the abscissa, filled column by column, with flights
    /// shaded.
    pub fn panels(words: Words<'_>, x_title: &str, columns: usize, panels: &[Panel], shades: &[Shade]) -> Self {
        let columns = columns.clamp(1, panels.len().max(1));
        let rows = panels.len().div_ceil(columns).max(1);
        let (mut pool, mut names, mut data) = (Pool::default(), Names::default(), Vec::new());
        let (mut shapes, mut notes) = (Vec::new(), Vec::new());
        let mut layout = base_layout();
        let panel_px = if rows == 1 { 230.0 } else { PANEL_PX };
        let inner = panel_px * rows as f64 + ROW_GAP_PX * (rows as f64 - 1.0);
        let column_gap = if columns > 2 { 0.075 } else { 0.09 };
        let width = (1.0 - column_gap * (columns as f64 - 1.0)) / columns as f64;
        for (i, panel) in panels.iter().enumerate() {
            let (column, row) = (i / rows, i % rows);
            let top = 1.0 - row as f64 * (panel_px + ROW_GAP_PX) / inner;
            let left = column as f64 * (width + column_gap);
            let last = row + 1 == rows || i + 1 == panels.len();
            let mut x = axis(if last { x_title } else { "" });
            x["domain"] = json!([left, (left + width).min(1.0)]);
            x["anchor"] = json!(format!("y{}", suffix(i)));
            x["zeroline"] = json!(false);
            x["showticklabels"] = json!(last);
            if !panel.ticks.is_empty() {
                x["tickvals"] = json!((0..panel.ticks.len()).collect::<Vec<_>>());
                x["ticktext"] = json!(panel.ticks);
                x["range"] = json!([-0.4, panel.ticks.len() as f64 - 0.6]);
            }
            if i > 0 {
                x["matches"] = json!("x");
            }
            let mut y = axis(&panel.y);
            y["domain"] = json!([(top - panel_px / inner).max(0.0), top.min(1.0)]);
            y["anchor"] = json!(format!("x{}", suffix(i)));
            y["nticks"] = json!(6);
            if panel.log {
                y["type"] = json!("log");
                y["dtick"] = json!(1);
            }
            if panel.from_zero {
                y["rangemode"] = json!("tozero");
            }
            layout[format!("xaxis{}", suffix(i))] = x;
            layout[format!("yaxis{}", suffix(i))] = y;
            if !panel.title.is_empty() {
                notes.push(json!({"xref": format!("x{} domain", suffix(i)), "yref": format!("y{} domain", suffix(i)),
                    "x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom", "text": format!("<b>{}</b>", panel.title),
                    "showarrow": false, "font": {"size": 12.5}}));
            }
            for shade in shades {
                shapes.push(json!({"type": "rect", "layer": "below", "xref": format!("x{}", suffix(i)),
                    "yref": format!("y{} domain", suffix(i)), "x0": pack::number(shade.from), "x1": pack::number(shade.to),
                    "y0": 0, "y1": 1, "fillcolor": "$shade", "line": {"width": 0}}));
                if row == 0 && shades.len() <= FLIGHT_LABELS {
                    notes.push(json!({"xref": format!("x{}", suffix(i)), "yref": format!("y{} domain", suffix(i)),
                        "x": pack::number((shade.from + shade.to) / 2.0), "y": 1, "xanchor": "center", "yanchor": "top",
                        "text": "flight", "showarrow": false, "font": {"size": 10.5, "color": "$dim"}}));
                }
            }
            for line in &panel.lines {
                let (shape, note) = reference(line, i);
                shapes.push(shape);
                notes.push(note);
            }
            data.extend(panel.bands.iter().flat_map(|b| band_traces(b, i, &mut pool, &mut names)));
            data.extend(panel.series.iter().map(|s| trace(s, i, &mut pool, &mut names)));
        }
        layout["shapes"] = Value::Array(shapes);
        layout["annotations"] = Value::Array(notes);
        if data.iter().all(|t| t["showlegend"] == json!(false)) {
            layout["showlegend"] = json!(false);
        }
        let titles: Vec<String> = panels
            .iter()
            .map(|p| match (p.title.is_empty(), p.y.is_empty()) {
                (false, false) => format!("{}, {}", p.title, p.y),
                (true, _) => p.y.clone(),
                (false, true) => p.title.clone(),
            })
            .collect();
        let height = inner as usize + 44 + 56;
        let plot = json!({"data": data, "layout": layout, "lists": pool.packed, "x": x_title, "panels": titles});
        Self::new("chart", words, height, plot)
    }
}

/// Lists of numbers that several curves share, packed once.
#[derive(Default)]
struct Pool {
    lists: Vec<Vec<f64>>,
    packed: Vec<Value>,
}

impl Pool {
    fn add(&mut self, values: &[f64]) -> Value {
        let same = |l: &Vec<f64>| {
            l.len() == values.len() && l.iter().zip(values).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
        };
        let i = self.lists.iter().position(same).unwrap_or_else(|| {
            self.lists.push(values.to_vec());
            self.packed.push(pack::numbers(values));
            self.lists.len() - 1
        });
        json!({"$": "list", "i": i})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_share_abscissae_and_say_units() {
        let x: Vec<f64> = (0..50).map(f64::from).collect();
        let y = x.iter().map(|t| t * t).collect::<Vec<f64>>();
        let panel = |title: &str| Panel {
            title: title.into(),
            y: "N".into(),
            series: vec![Series::line("a", x.clone(), y.clone()), Series::line("b", x.clone(), y.clone())],
            ..Panel::default()
        };
        let f = Figure::panels(
            Words::new("t", "c"),
            "time, s",
            2,
            &[panel("Force x"), panel("Moment x")],
            &[Shade { from: 1.0, to: 2.0 }],
        );
        let d = f.data();
        assert_eq!(d["lists"].as_array().map(Vec::len), Some(2), "x and y once each");
        assert_eq!(d["panels"], json!(["Force x, N", "Moment x, N"]));
        assert_eq!(d["layout"]["xaxis2"]["matches"], "x");
        let legend = d["data"].as_array().unwrap().iter().filter(|t| t["showlegend"] == true).count();
        assert_eq!(legend, 2, "each name once in the legend");
    }
}
