//! Line charts in panels that share the abscissa, for uPlot.

use super::base::{Figure, Words};
use crate::pack;
use serde_json::{Value, json};

/// Height of a panel, pixels.
const PANEL_PX: usize = 150;
/// Height of the only panel of a chart, pixels.
const SINGLE_PX: usize = 240;

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
    /// Colour of the theme (`c0` …); the next free one if not given.
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

/// Part of the abscissa that a chart over time shows when it opens.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Focus {
    /// Everything.
    #[default]
    All,
    /// The flights, at the scale of the values in flight.
    Flight,
    /// The rest, at its scale.
    Contact,
}

/// A chart: panels that share the abscissa.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart<'a> {
    /// Title of the abscissa, with unit.
    pub x: &'a str,
    /// Number of columns of panels; they are filled column by column.
    pub columns: usize,
    /// Panels.
    pub panels: &'a [Panel],
    /// Flights.
    pub shades: &'a [Shade],
    /// Recording whose time the abscissa is; empty for none. The chart then follows the player.
    pub recording: &'a str,
    /// Part shown first.
    pub focus: Focus,
}

impl Figure {
    /// Panels in columns that share the abscissa, with flights shaded.
    pub fn chart(words: Words<'_>, chart: &Chart<'_>) -> Self {
        let columns = chart.columns.clamp(1, chart.panels.len().max(1));
        let rows = chart.panels.len().div_ceil(columns).max(1);
        let mut pool = Pool::default();
        let panels: Vec<Value> = chart.panels.iter().map(|p| panel(p, &mut pool)).collect();
        let shades: Vec<Value> =
            chart.shades.iter().map(|s| json!([pack::number(s.from), pack::number(s.to)])).collect();
        let panel_px = if rows == 1 { SINGLE_PX } else { PANEL_PX };
        let focus = match chart.focus {
            Focus::All => "all",
            Focus::Flight => "flight",
            Focus::Contact => "contact",
        };
        let data = json!({"kind": "chart", "x": chart.x, "columns": columns, "rows": rows, "panel_px": panel_px, "panels": panels,
            "shades": shades, "recording": chart.recording, "focus": focus, "lists": pool.packed});
        Self::new("chart", words, rows * (panel_px + 34) + 50, data)
    }

    /// As [`Figure::chart`], for an abscissa that is not a recording's time.
    pub fn panels(words: Words<'_>, x: &str, columns: usize, panels: &[Panel], shades: &[Shade]) -> Self {
        Self::chart(words, &Chart { x, columns, panels, shades, ..Chart::default() })
    }
}

fn panel(p: &Panel, pool: &mut Pool) -> Value {
    let series: Vec<Value> = p
        .series
        .iter()
        .map(|s| {
            json!({"name": s.name, "x": pool.add(&s.x), "y": pool.add(&s.y), "points": s.points, "line": !s.no_line, "dashed": s.dashed,
                "colour": s.colour, "quiet": s.quiet || s.name.is_empty()})
        })
        .collect();
    let bands: Vec<Value> = p
        .bands
        .iter()
        .map(|b| json!({"name": b.name, "x": pool.add(&b.x), "mean": pool.add(&b.mean), "sd": pool.add(&b.sd), "colour": b.colour}))
        .collect();
    let lines: Vec<Value> =
        p.lines.iter().map(|l| json!({"at": pack::number(l.at), "upright": l.upright, "label": l.label})).collect();
    json!({"title": p.title, "y": p.y, "series": series, "bands": bands, "lines": lines, "from_zero": p.from_zero, "log": p.log, "ticks": p.ticks})
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
        json!(i)
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
        let panels = [panel("Force x"), panel("Moment x")];
        let shades = [Shade { from: 1.0, to: 2.0 }];
        let chart = Chart {
            x: "time, s",
            columns: 2,
            panels: &panels,
            shades: &shades,
            recording: "jump",
            focus: Focus::Flight,
        };
        let f = Figure::chart(Words::new("t", "c"), &chart);
        let d = f.data();
        assert_eq!(d["lists"].as_array().map(Vec::len), Some(2), "x and y once each");
        assert_eq!((d["panels"][1]["title"].as_str(), d["panels"][1]["y"].as_str()), (Some("Moment x"), Some("N")));
        assert_eq!(
            (d["recording"].as_str(), d["focus"].as_str(), &d["shades"][0]),
            (Some("jump"), Some("flight"), &json!([1.0, 2.0]))
        );
    }
}
