//! What all figures share: title and caption, the data of the drawing, the layout of a chart.

use serde::{Serialize, Serializer};
use serde_json::{Value, json};

/// Title and caption of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Words<'a> {
    /// Title: what it shows, in a few words.
    pub title: &'a str,
    /// Caption: what to look for.
    pub caption: &'a str,
}

impl<'a> Words<'a> {
    /// Title and caption.
    pub fn new(title: &'a str, caption: &'a str) -> Self {
        Self { title, caption }
    }
}

/// A chart or a player.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// Caption.
    pub caption: String,
    /// Renderer: `chart` or `player`.
    pub drawn_by: &'static str,
    /// Height on the page, pixels.
    pub height: usize,
    #[serde(serialize_with = "inside_script")]
    data: Value,
}

/// JSON that is safe inside a script element: `</` would end it, `<!--` would start a comment.
fn inside_script<S: Serializer>(value: &Value, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&value.to_string().replace('<', "\\u003c"))
}

impl Figure {
    pub(crate) fn new(drawn_by: &'static str, words: Words<'_>, height: usize, data: Value) -> Self {
        Self { title: words.title.to_owned(), caption: words.caption.to_owned(), drawn_by, height, data }
    }

    /// The data of the drawing.
    pub fn data(&self) -> &Value {
        &self.data
    }
}

/// Layout common to all charts.
pub(super) fn base_layout() -> Value {
    json!({
        "margin": {"l": 62, "r": 18, "t": 44, "b": 48},
        "font": {"family": "system-ui, -apple-system, 'Segoe UI', sans-serif", "size": 12.5, "color": "$ink"},
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
        "legend": {"orientation": "h", "yref": "container", "y": 1.0, "yanchor": "top", "x": 0, "itemwidth": 30},
        "hovermode": "closest",
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "$line", "activecolor": "$accent"},
        "hoverlabel": {"bgcolor": "$paper", "bordercolor": "$grid", "font": {"color": "$ink"}}
    })
}

/// A coordinate axis with its title.
pub(super) fn axis(title: &str) -> Value {
    json!({"title": {"text": title, "standoff": 8}, "gridcolor": "$grid", "zerolinecolor": "$line", "linecolor": "$line",
        "showline": true, "ticks": "outside", "ticklen": 4, "tickcolor": "$line", "automargin": true})
}
