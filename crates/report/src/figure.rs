//! Charts as the plotting library wants them.

use serde::Serialize;
use serde_json::{Value, json};

/// Colours that stay apart for people who see colours differently (Okabe and Ito).
const COLOURS: [&str; 7] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#444444"];

/// One curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Ordinates; NaN leaves a gap.
    pub y: Vec<f64>,
    /// Half-height of an error bar a point; empty for none.
    pub error: Vec<f64>,
    /// `lines`, `markers` or `lines+markers`.
    pub mode: &'static str,
    /// Dashed.
    pub dashed: bool,
    /// Panel, counted from 0 upward to the last below.
    pub panel: usize,
}

impl Series {
    /// A plain line in the first panel.
    pub fn line(name: impl Into<String>, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), x, y, error: Vec::new(), mode: "lines", dashed: false, panel: 0 }
    }
    /// Points in the first panel.
    pub fn points(name: impl Into<String>, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { mode: "markers", ..Self::line(name, x, y) }
    }
    /// The same in another panel.
    pub fn in_panel(self, panel: usize) -> Self {
        Self { panel, ..self }
    }
    /// The same, dashed.
    pub fn dashed(self) -> Self {
        Self { dashed: true, ..self }
    }
    /// The same with error bars.
    pub fn with_error(self, error: Vec<f64>) -> Self {
        Self { error, ..self }
    }
}

/// A shaded stretch of the abscissa.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shade {
    /// From.
    pub from: f64,
    /// To.
    pub to: f64,
}

/// A mean with a band about it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Band {
    /// Name in the legend.
    pub name: String,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Mean.
    pub mean: Vec<f64>,
    /// Half-height of the band.
    pub sd: Vec<f64>,
    /// Panel.
    pub panel: usize,
}

/// A map of values over two lists of names.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeatMap {
    /// Columns.
    pub x: Vec<String>,
    /// Rows.
    pub y: Vec<String>,
    /// `z[row][column]`; NaN is left blank.
    pub z: Vec<Vec<f64>>,
    /// Unit, for the colour bar.
    pub unit: String,
}

/// A skeleton, markers and forces over time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Animation {
    /// Time of each frame, s.
    pub times_s: Vec<f64>,
    /// Pairs of joint indices.
    pub bones: Vec<(usize, usize)>,
    /// `joints[frame][joint]`, m.
    pub joints: Vec<Vec<[f64; 3]>>,
    /// `measured[frame][marker]`, m; NaN where missing.
    pub measured: Vec<Vec<[f64; 3]>>,
    /// `modelled[frame][marker]`, m.
    pub modelled: Vec<Vec<[f64; 3]>>,
    /// `forces[frame]`: from, to (m) of each arrow.
    pub forces: Vec<Vec<[[f64; 3]; 2]>>,
}

/// A chart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    /// What it shows, in one sentence.
    pub caption: String,
    /// Height on the page, pixels.
    pub height: usize,
    #[serde(skip)]
    plot: Value,
}

fn number(value: f64) -> Value {
    // six significant digits are more than a screen shows, and keep the page small
    if !value.is_finite() {
        return Value::Null;
    }
    let text = format!("{value:.5e}");
    text.parse::<f64>().map_or(Value::Null, |v| json!(v))
}

fn numbers(values: &[f64]) -> Value {
    Value::Array(values.iter().map(|v| number(*v)).collect())
}

fn axis(kind: char, panel: usize) -> String {
    if panel == 0 { kind.to_string() } else { format!("{kind}{}", panel + 1) }
}

fn axis_key(kind: char, panel: usize) -> String {
    if panel == 0 { format!("{kind}axis") } else { format!("{kind}axis{}", panel + 1) }
}

fn base_layout() -> Value {
    json!({
        "margin": {"l": 64, "r": 16, "t": 12, "b": 48},
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#222"},
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        "hovermode": "closest"
    })
}

impl Figure {
    /// Curves in one panel.
    pub fn lines(caption: &str, x_title: &str, y_title: &str, series: Vec<Series>) -> Self {
        Self::panels(caption, x_title, &[y_title], series, &[], &[])
    }

    /// Curves in panels below one another that share the abscissa, with shaded stretches and bands.
    pub fn panels(
        caption: &str,
        x_title: &str,
        y_titles: &[&str],
        series: Vec<Series>,
        shades: &[Shade],
        bands: &[Band],
    ) -> Self {
        let n = y_titles.len().max(1);
        let mut names: Vec<String> = Vec::new();
        let mut colour = |name: &str| {
            let i = names.iter().position(|n| n == name).unwrap_or_else(|| {
                names.push(name.to_owned());
                names.len() - 1
            });
            (COLOURS[i % COLOURS.len()], i)
        };
        let mut shown: Vec<String> = Vec::new();
        let mut first = |name: &str| {
            let new = !shown.iter().any(|s| s == name);
            if new {
                shown.push(name.to_owned());
            }
            new
        };
        let mut data = Vec::new();
        for band in bands {
            let (c, _) = colour(&band.name);
            let low: Vec<f64> = band.mean.iter().zip(&band.sd).map(|(m, s)| m - s).collect();
            let high: Vec<f64> = band.mean.iter().zip(&band.sd).map(|(m, s)| m + s).collect();
            let (xa, ya) = (axis('x', 0), axis('y', band.panel));
            data.push(json!({"type": "scatter", "x": numbers(&band.x), "y": numbers(&low), "mode": "lines", "line": {"width": 0},
                "xaxis": xa, "yaxis": ya, "showlegend": false, "hoverinfo": "skip"}));
            data.push(json!({"type": "scatter", "x": numbers(&band.x), "y": numbers(&high), "mode": "lines", "line": {"width": 0}, "fill": "tonexty",
                "fillcolor": format!("{c}33"), "xaxis": xa, "yaxis": ya, "showlegend": false, "hoverinfo": "skip"}));
            data.push(json!({"type": "scatter", "x": numbers(&band.x), "y": numbers(&band.mean), "mode": "lines", "name": band.name,
                "line": {"color": c, "width": 2}, "xaxis": xa, "yaxis": ya, "legendgroup": band.name, "showlegend": first(&band.name)}));
        }
        for s in &series {
            let (c, _) = colour(&s.name);
            let mut trace = json!({
                "type": "scatter", "x": numbers(&s.x), "y": numbers(&s.y), "mode": s.mode, "name": s.name,
                "line": {"color": c, "width": 1.6, "dash": if s.dashed { "dash" } else { "solid" }},
                "marker": {"color": c, "size": 7},
                "xaxis": axis('x', 0), "yaxis": axis('y', s.panel), "legendgroup": s.name, "showlegend": first(&s.name)
            });
            if !s.error.is_empty() {
                trace["error_y"] =
                    json!({"type": "data", "array": numbers(&s.error), "visible": true, "color": c, "thickness": 1.4});
            }
            data.push(trace);
        }
        let mut layout = base_layout();
        layout["xaxis"] =
            json!({"title": {"text": x_title}, "gridcolor": "#e6e6e6", "zeroline": false, "anchor": axis('y', n - 1)});
        let gap = 0.035;
        for (i, title) in y_titles.iter().enumerate() {
            let height = (1.0 - gap * (n as f64 - 1.0)) / n as f64;
            let top = 1.0 - i as f64 * (height + gap);
            layout[axis_key('y', i)] = json!({"title": {"text": title}, "domain": [(top - height).max(0.0), top.min(1.0)], "gridcolor": "#e6e6e6", "zerolinecolor": "#bbb"});
        }
        layout["shapes"] = shades
            .iter()
            .map(|s| json!({"type": "rect", "xref": "x", "yref": "paper", "x0": number(s.from), "x1": number(s.to), "y0": 0, "y1": 1, "fillcolor": "#0072B2", "opacity": 0.08, "line": {"width": 0}}))
            .collect();
        Self { caption: caption.to_owned(), height: 120 + 170 * n, plot: json!({"data": data, "layout": layout}) }
    }

    /// Horizontal bars with intervals, one group of bars a name.
    pub fn bars(caption: &str, unit: &str, names: &[String], groups: &[(String, Vec<f64>, Vec<f64>)]) -> Self {
        let data: Vec<Value> = groups
            .iter()
            .enumerate()
            .map(|(i, (group, values, errors))| {
                let mut trace = json!({"type": "bar", "orientation": "h", "y": names, "x": numbers(values), "name": group, "marker": {"color": COLOURS[i % COLOURS.len()]}});
                if errors.iter().any(|e| e.is_finite()) {
                    trace["error_x"] = json!({"type": "data", "array": numbers(errors), "thickness": 1.2});
                }
                trace
            })
            .collect();
        let mut layout = base_layout();
        layout["xaxis"] = json!({"title": {"text": unit}, "gridcolor": "#e6e6e6"});
        layout["yaxis"] = json!({"autorange": "reversed", "automargin": true});
        layout["barmode"] = json!("group");
        let height = 120 + names.len() * (14 * groups.len() + 8);
        Self { caption: caption.to_owned(), height, plot: json!({"data": data, "layout": layout}) }
    }

    /// A map of values.
    pub fn heat_map(caption: &str, map: &HeatMap) -> Self {
        let z: Vec<Value> = map.z.iter().map(|row| numbers(row)).collect();
        let data = json!([{"type": "heatmap", "x": map.x, "y": map.y, "z": z, "colorscale": "Viridis",
            "colorbar": {"title": {"text": map.unit}}, "hoverongaps": false}]);
        let mut layout = base_layout();
        layout["xaxis"] = json!({"automargin": true, "tickangle": -45});
        layout["yaxis"] = json!({"automargin": true, "autorange": "reversed"});
        Self {
            caption: caption.to_owned(),
            height: 140 + 16 * map.y.len(),
            plot: json!({"data": data, "layout": layout}),
        }
    }

    /// A playable skeleton: measured markers, model markers, bones and force arrows.
    pub fn animation(caption: &str, a: &Animation) -> Self {
        let points = |list: &[[f64; 3]]| -> [Value; 3] {
            [0, 1, 2].map(|k| Value::Array(list.iter().map(|p| number((p[k] * 1e3).round() / 1e3)).collect()))
        };
        let segments = |pairs: &mut dyn Iterator<Item = ([f64; 3], [f64; 3])>| -> [Value; 3] {
            let mut out = [Vec::new(), Vec::new(), Vec::new()];
            for (p, q) in pairs {
                for k in 0..3 {
                    out[k].push(number((p[k] * 1e3).round() / 1e3));
                    out[k].push(number((q[k] * 1e3).round() / 1e3));
                    out[k].push(Value::Null);
                }
            }
            out.map(Value::Array)
        };
        let frame = |f: usize| -> Vec<Value> {
            let joints = &a.joints[f];
            let [bx, by, bz] = segments(&mut a.bones.iter().map(|(i, j)| (joints[*i], joints[*j])));
            let [mx, my, mz] = points(&a.measured[f]);
            let [px, py, pz] = points(&a.modelled[f]);
            let [fx, fy, fz] = segments(&mut a.forces[f].iter().map(|s| (s[0], s[1])));
            vec![
                json!({"x": bx, "y": by, "z": bz}),
                json!({"x": mx, "y": my, "z": mz}),
                json!({"x": px, "y": py, "z": pz}),
                json!({"x": fx, "y": fy, "z": fz}),
            ]
        };
        let styles = [
            json!({"type": "scatter3d", "mode": "lines", "name": "model", "line": {"color": "#444444", "width": 6}}),
            json!({"type": "scatter3d", "mode": "markers", "name": "measured markers", "marker": {"color": "#D55E00", "size": 3}}),
            json!({"type": "scatter3d", "mode": "markers", "name": "model markers", "marker": {"color": "#0072B2", "size": 3, "symbol": "circle-open"}}),
            json!({"type": "scatter3d", "mode": "lines", "name": "force", "line": {"color": "#009E73", "width": 5}}),
        ];
        let merge = |style: &Value, points: Value| {
            let mut trace = style.clone();
            for key in ["x", "y", "z"] {
                trace[key] = points[key].clone();
            }
            trace
        };
        let n = a.times_s.len();
        let data: Vec<Value> =
            if n == 0 { Vec::new() } else { styles.iter().zip(frame(0)).map(|(s, p)| merge(s, p)).collect() };
        let frames: Vec<Value> = (0..n).map(|f| json!({"name": f.to_string(), "data": frame(f)})).collect();
        let steps: Vec<Value> = (0..n)
            .map(|f| json!({"method": "animate", "label": format!("{:.2} s", a.times_s[f]), "args": [[f.to_string()], {"mode": "immediate", "frame": {"duration": 0, "redraw": true}, "transition": {"duration": 0}}]}))
            .collect();
        let (low, high) = extent(a);
        let mut layout = base_layout();
        layout["scene"] = json!({
            "aspectmode": "data",
            "xaxis": {"title": {"text": "x (m)"}, "range": [number(low[0]), number(high[0])]},
            "yaxis": {"title": {"text": "y (m)"}, "range": [number(low[1]), number(high[1])]},
            "zaxis": {"title": {"text": "z (m)"}, "range": [number(low[2]), number(high[2])]},
            "camera": {"eye": {"x": 1.2, "y": -1.6, "z": 0.5}}
        });
        let step_ms = if n > 1 { (a.times_s[1] - a.times_s[0]) * 1000.0 } else { 40.0 };
        layout["updatemenus"] = json!([{"type": "buttons", "showactive": false, "x": 0, "y": 0, "xanchor": "left", "yanchor": "top", "direction": "left",
        "buttons": [
            {"label": "Play", "method": "animate", "args": [null, {"fromcurrent": true, "frame": {"duration": step_ms, "redraw": true}, "transition": {"duration": 0}}]},
            {"label": "Pause", "method": "animate", "args": [[null], {"mode": "immediate", "frame": {"duration": 0, "redraw": true}}]}
        ]}]);
        layout["sliders"] =
            json!([{"steps": steps, "x": 0.16, "len": 0.84, "y": 0, "currentvalue": {"prefix": "t = "}}]);
        Self {
            caption: caption.to_owned(),
            height: 620,
            plot: json!({"data": data, "layout": layout, "frames": frames}),
        }
    }

    /// The chart for the plotting library: `data`, `layout`, `frames`.
    pub(crate) fn to_plot(&self) -> Value {
        self.plot.clone()
    }
}

fn extent(a: &Animation) -> ([f64; 3], [f64; 3]) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in a.joints.iter().chain(&a.measured).flatten().filter(|p| p.iter().all(|x| x.is_finite())) {
        for k in 0..3 {
            low[k] = low[k].min(p[k] - 0.15);
            high[k] = high[k].max(p[k] + 0.15);
        }
    }
    (low, high)
}
