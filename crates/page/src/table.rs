//! Tables of text, with links and lights in their cells.

use crate::Light;
use serde::Serialize;

/// Columns whose longest cell has at most this many characters are not wrapped.
const SHORT: usize = 28;

/// One cell.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Cell {
    /// Text.
    pub text: String,
    /// Link target: the identifier of a chapter or section with `#` in front, or a relative path;
    /// empty for none.
    pub link: String,
    /// Judgement, shown as a symbol and a word before the text.
    pub light: Option<Light>,
    /// Word of the judgement where it is not that of the light; empty for that one.
    pub word: String,
    /// Explanation below the text, in smaller letters; empty for none.
    pub note: String,
}

impl Cell {
    /// The same cell with a link.
    pub fn to(self, link: impl Into<String>) -> Self {
        Self { link: link.into(), ..self }
    }
    /// The same cell with an explanation below it.
    pub fn with_note(self, note: impl Into<String>) -> Self {
        Self { note: note.into(), ..self }
    }
    /// A cell with a judgement in words of its own and nothing else.
    pub fn sign(light: Light, word: impl Into<String>) -> Self {
        Self { word: word.into(), light: Some(light), ..Self::default() }
    }
    /// A cell with a judgement in words of its own before the text.
    pub fn judged(light: Light, word: impl Into<String>, text: impl Into<String>) -> Self {
        Self { word: word.into(), text: text.into(), light: Some(light), ..Self::default() }
    }
    /// A cell with a judgement and its word.
    pub fn light(light: Light, text: impl Into<String>) -> Self {
        Self { text: text.into(), light: Some(light), ..Self::default() }
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self { text, ..Self::default() }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

/// A table of text.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Table {
    /// Title.
    pub title: String,
    /// Caption: what the table shows.
    pub caption: String,
    /// Column heads, with units.
    pub header: Vec<String>,
    /// Rows; the first cell of each row is its name.
    pub rows: Vec<Vec<Cell>>,
    /// True if a reader chooses two of the columns after the first; without a script all are shown.
    pub two_at_a_time: bool,
    /// CSS class of each column: empty for numbers (right), `w` for words (left), `w n` for words
    /// too short to wrap, `w noted` for words with explanations, which take what width is left.
    classes: Vec<&'static str>,
}

impl Table {
    /// A table; columns in which every cell is a number or missing are set as numbers.
    pub fn new<C: Into<Cell>>(title: &str, caption: &str, header: &[&str], rows: Vec<Vec<C>>) -> Self {
        let rows: Vec<Vec<Cell>> = rows.into_iter().map(|r| r.into_iter().map(Into::into).collect()).collect();
        let class = |i: usize| {
            let cells = || rows.iter().filter_map(|r| r.get(i));
            if !cells().any(|c| c.light.is_some() || !is_number(&c.text)) {
                ""
            } else if cells().any(|c| !c.note.is_empty()) {
                "w noted"
            } else if cells().all(|c| c.text.chars().count() + c.word.chars().count() <= SHORT) {
                "w n"
            } else {
                "w"
            }
        };
        let classes = (0..header.len()).map(class).collect();
        Self {
            title: title.to_owned(),
            caption: caption.to_owned(),
            header: header.iter().map(|h| (*h).to_owned()).collect(),
            rows,
            two_at_a_time: false,
            classes,
        }
    }

    /// The same table, of which two columns beside the first are shown, as the reader chooses.
    #[must_use]
    pub fn two_at_a_time(self) -> Self {
        Self { two_at_a_time: true, ..self }
    }
}

/// True for text that looks like numbers: digits, signs, exponents, and the dash of a missing
/// value.
fn is_number(text: &str) -> bool {
    text.is_empty()
        || text == "–"
        || text.split_whitespace().all(|t| t.replace('−', "-").parse::<f64>().is_ok() || t == "±" || t == "–")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_numbers_are_told_from_columns_of_words() {
        let t = Table::new(
            "t",
            "",
            &["name", "value", "remark"],
            vec![vec!["a", "−1.5e-3", "x"], vec!["b", "–", ""], vec!["c", "1.0  2.0 ± 3", ""]],
        );
        assert_eq!(t.classes, ["w n", "", "w n"]);
    }
}
