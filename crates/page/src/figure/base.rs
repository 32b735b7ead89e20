//! What all figures share: title, caption, the drawing or the data of the drawing.

use serde::{Serialize, Serializer};
use serde_json::Value;

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

/// A chart, a map or a player.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// Caption.
    pub caption: String,
    /// Renderer: `chart`, `map` or `player` are scripts, `still` is HTML.
    pub drawn_by: &'static str,
    /// Height on the page before it is drawn, pixels.
    pub height: usize,
    /// The drawing, for `still`.
    html: String,
    #[serde(serialize_with = "inside_script")]
    data: Value,
}

/// JSON that is safe inside a script element: `</` would end it, `<!--` would start a comment.
fn inside_script<S: Serializer>(value: &Value, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&value.to_string().replace('<', "\\u003c"))
}

impl Figure {
    pub(crate) fn new(drawn_by: &'static str, words: Words<'_>, height: usize, data: Value) -> Self {
        let (title, caption) = (words.title.to_owned(), words.caption.to_owned());
        Self { title, caption, drawn_by, height, html: String::new(), data }
    }

    /// A drawing in HTML; `data` is for the CSV.
    pub(crate) fn still(words: Words<'_>, html: String, data: Value) -> Self {
        Self { html, ..Self::new("still", words, 0, data) }
    }

    /// The data of the drawing.
    pub fn data(&self) -> &Value {
        &self.data
    }

    /// The drawing, if it is HTML.
    pub fn html(&self) -> &str {
        &self.html
    }
}
