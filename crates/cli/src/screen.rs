//! What fits on the terminal: its width, tables, wrapped text, colour.
//!
//! No line is wider than the terminal (100 columns, or `COLUMNS`, where there is none). Colour
//! repeats what a word says and is never the only sign.

use crate::stop::Stop;
use aloft_compare::Signal;
use aloft_study::quote::{acts_on_terminal, visible};
use std::fmt;
use std::io::IsTerminal;

/// Columns where neither a terminal nor `COLUMNS` tells.
const USUAL: usize = 100;
/// Fewest columns for which anything is laid out.
const LEAST: usize = 40;
/// Spaces between columns.
const GAP: usize = 2;

/// Columns of a line.
pub fn width() -> usize {
    let of_terminal = || console::Term::stdout().size_checked().map(|(_, columns)| usize::from(columns));
    let stated = || std::env::var("COLUMNS").ok().and_then(|c| c.trim().parse().ok());
    let found = if std::io::stdout().is_terminal() { of_terminal().or_else(stated) } else { stated() };
    found.unwrap_or(USUAL).max(LEAST)
}

/// Columns that a text takes.
pub fn columns_of(text: &str) -> usize {
    console::measure_text_width(text)
}

fn coloured() -> bool {
    let unwanted = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
    !unwanted && std::io::stdout().is_terminal() && console::colors_enabled()
}

/// A text in the colour of a judgement.
pub fn paint(text: &str, signal: Signal) -> String {
    if !coloured() {
        return text.to_owned();
    }
    let style = console::Style::new().force_styling(true);
    match signal {
        Signal::Good => style.green(),
        Signal::Fair => style.yellow(),
        Signal::Poor => style.red(),
        Signal::Unknown => style,
    }
    .apply_to(text)
    .to_string()
}

/// A text cut to some columns, with an ellipsis.
pub fn cut(text: &str, columns: usize) -> String {
    console::truncate_str(text, columns, "…").into_owned()
}

/// A label and a text, wrapped to the width; further lines are indented below the text.
pub fn labelled(label: &str, text: &str) -> String {
    let indent = " ".repeat(columns_of(label));
    let options = textwrap::Options::new(width())
        .initial_indent(label)
        .subsequent_indent(&indent)
        .break_words(false)
        .word_splitter(textwrap::WordSplitter::NoHyphenation);
    textwrap::fill(text.trim_end(), options)
}

/// A text of several lines, each wrapped to the width and continued below with a larger indent.
pub fn fitted(text: &str) -> String {
    let line = |line: &str| {
        let indent = " ".repeat(line.len() - line.trim_start().len() + 2);
        let options = textwrap::Options::new(width())
            .subsequent_indent(&indent)
            .break_words(false)
            .word_splitter(textwrap::WordSplitter::NoHyphenation);
        textwrap::fill(line, options)
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

/// A label and a text on a single line, cut where it is too long.
pub fn one_line(label: &str, text: &str) -> String {
    cut(&format!("{label}{text}"), width())
}

/// A label and the words of a shell command. A command longer than a line continues after `\`, so
/// that the lines can be copied as they are.
pub fn command_lines(label: &str, words: &[String]) -> String {
    let (mut lines, mut line) = (Vec::new(), label.to_owned());
    for (i, word) in words.iter().enumerate() {
        let after = if i + 1 < words.len() { 2 } else { 0 };
        if i > 1 && columns_of(&line) + 1 + columns_of(word) + after > width() {
            lines.push(format!("{line} \\"));
            line = format!("    {word}");
        } else {
            let space = if i == 0 { "" } else { " " };
            line = format!("{line}{space}{word}");
        }
    }
    lines.push(line);
    lines.join("\n")
}

/// A value of a table.
#[derive(Debug, Clone, Default)]
pub struct Cell {
    text: String,
    signal: Option<Signal>,
}

/// A name in a cell stays on its line and has no colour of its own.
fn shown(text: String) -> String {
    if text.contains(acts_on_terminal) { visible(&text) } else { text }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self { text: shown(text.into()), signal: None }
    }
}

impl Cell {
    /// A value in the colour of a judgement.
    pub fn judged(text: impl Into<String>, signal: Signal) -> Self {
        Self { text: shown(text.into()), signal: Some(signal) }
    }
}

/// A table that fits the width: the first column names the row, the others are right-aligned unless
/// stated. Where it is too wide, the columns that may be left out go first; then the others
/// continue in a second block below, with the names again.
#[derive(Debug)]
pub struct Grid {
    header: Vec<String>,
    rows: Vec<Vec<Cell>>,
    left: Vec<usize>,
    wrapped: Option<usize>,
    optional: Vec<usize>,
}

/// An empty table with a header.
pub fn table(header: &[&str]) -> Grid {
    Grid {
        header: header.iter().map(|h| (*h).to_owned()).collect(),
        rows: Vec::new(),
        left: vec![0],
        wrapped: None,
        optional: Vec::new(),
    }
}

/// Width of these columns with the gaps between them.
fn total(shown: &[usize], sizes: &[usize]) -> usize {
    shown.iter().map(|c| sizes[*c]).sum::<usize>() + GAP * shown.len().saturating_sub(1)
}

impl Grid {
    /// Adds a row.
    pub fn add_row<C: Into<Cell>>(&mut self, cells: impl IntoIterator<Item = C>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }
    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
    /// Aligns columns of words to the left.
    #[must_use]
    pub fn left(mut self, columns: &[usize]) -> Self {
        self.left.extend(columns);
        self
    }
    /// Columns that are left out where the width does not suffice, the first of them first.
    #[must_use]
    pub fn optional(mut self, columns: &[usize]) -> Self {
        self.optional.extend(columns);
        self
    }
    /// A column of text whose lines are broken where the width does not suffice.
    #[must_use]
    pub fn wrapped(mut self, column: usize) -> Self {
        self.wrapped = Some(column);
        self.left.push(column);
        self
    }

    /// Headers of the columns that this width leaves out.
    pub fn left_out(&self) -> Vec<&str> {
        let shown = self.shown(&self.sizes(), width());
        (0..self.header.len()).filter(|c| !shown.contains(c)).map(|c| self.header[c].as_str()).collect()
    }

    /// Width of each column.
    fn sizes(&self) -> Vec<usize> {
        let cell = |row: &[Cell], c: usize| row.get(c).map_or(0, |cell| columns_of(&cell.text));
        (0..self.header.len())
            .map(|c| self.rows.iter().map(|r| cell(r, c)).fold(columns_of(&self.header[c]), usize::max))
            .collect()
    }

    /// Columns that are shown.
    fn shown(&self, sizes: &[usize], width: usize) -> Vec<usize> {
        let mut shown: Vec<usize> = (0..self.header.len()).collect();
        for drop in &self.optional {
            if total(&shown, sizes) > width {
                shown.retain(|c| c != drop);
            }
        }
        shown
    }

    fn lines(&self, width: usize) -> Vec<String> {
        let mut sizes = self.sizes();
        let shown = self.shown(&sizes, width);
        if let Some(w) = self.wrapped.filter(|w| shown.contains(w) && total(&shown, &sizes) > width) {
            let others = total(&shown, &sizes) - sizes[w];
            let words = self.rows.iter().filter_map(|r| r.get(w)).flat_map(|c| c.text.split_whitespace());
            let longest = words.map(columns_of).fold(12, usize::max);
            // where not even a word fits beside the others, the column continues below
            let left = width.saturating_sub(others);
            sizes[w] = if left < longest { width.saturating_sub(sizes[0] + GAP).max(12) } else { left }.min(sizes[w]);
        }
        if total(&shown, &sizes) > width {
            sizes[0] = sizes[0].min((width / 2).max(12));
        }
        let mut blocks: Vec<Vec<usize>> = vec![vec![0]];
        for c in shown.into_iter().skip(1) {
            let Some(last) = blocks.last_mut() else { continue };
            last.push(c);
            if last.len() > 2 && total(last, &sizes) > width {
                last.pop();
                blocks.push(vec![0, c]);
            }
        }
        let mut out = Vec::new();
        for (i, block) in blocks.iter().enumerate() {
            if i > 0 {
                out.push(String::new());
            }
            let head: Vec<Cell> = self.header.iter().map(|h| h.as_str().into()).collect();
            out.extend(self.row(&head, block, &sizes, width));
            for row in &self.rows {
                out.extend(self.row(row, block, &sizes, width));
            }
        }
        out
    }

    /// The lines of one row.
    fn row(&self, row: &[Cell], block: &[usize], sizes: &[usize], width: usize) -> Vec<String> {
        let empty = Cell::default();
        let pieces: Vec<Vec<String>> = block
            .iter()
            .map(|&c| {
                let text = &row.get(c).unwrap_or(&empty).text;
                let size = sizes[c].min(width);
                if columns_of(text) <= size {
                    vec![text.clone()]
                } else if self.wrapped == Some(c) {
                    textwrap::wrap(text, size).into_iter().map(std::borrow::Cow::into_owned).collect()
                } else {
                    vec![cut(text, size)]
                }
            })
            .collect();
        let height = pieces.iter().map(Vec::len).max().unwrap_or(1);
        (0..height)
            .map(|line| {
                let cells: Vec<String> = block
                    .iter()
                    .zip(&pieces)
                    .map(|(&c, lines)| {
                        let text = lines.get(line).map_or("", String::as_str);
                        let pad = " ".repeat(sizes[c].saturating_sub(columns_of(text)));
                        let painted = match row.get(c).and_then(|cell| cell.signal) {
                            Some(signal) if !text.is_empty() => paint(text, signal),
                            _ => text.to_owned(),
                        };
                        if self.left.contains(&c) { format!("{painted}{pad}") } else { format!("{pad}{painted}") }
                    })
                    .collect();
                cells.join(&" ".repeat(GAP)).trim_end().to_owned()
            })
            .collect()
    }
}

impl fmt::Display for Grid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.lines(width()).join("\n"))
    }
}

/// Prints sentences as wrapped paragraphs with a dash.
pub fn list(lines: &[String]) -> Result<(), Stop> {
    lines.iter().try_for_each(|line| crate::render::out(labelled("- ", line)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Grid {
        let mut grid = table(&["trial", "error N", "floor N", "remark"]).wrapped(3);
        grid.add_row(["jump01", "29.2", "12.1", "a long remark that does not fit into what is left of the line"]);
        grid.add_row(["a trial with quite a long name", "1.0", "12.1", ""]);
        grid
    }

    #[test]
    fn no_line_of_a_table_is_wider_than_the_screen() {
        for width in 40..130 {
            let lines = sample().lines(width);
            assert!(lines.iter().all(|l| columns_of(l) <= width), "{width}: {lines:#?}");
            let all = lines.join(" ").replace(' ', "");
            assert!(all.contains("29.2") && all.contains("12.1"), "{width}: {lines:#?}");
        }
    }

    #[test]
    fn columns_that_may_be_left_out_go_before_others_continue_below() {
        let mut grid = table(&["trial", "one", "two", "three"]).optional(&[2]);
        grid.add_row(["jump01", "1111111111", "2222222222", "3333333333"]);
        assert_eq!(grid.lines(60)[1], "jump01  1111111111  2222222222  3333333333");
        assert_eq!(grid.lines(40)[1], "jump01  1111111111  3333333333");
        assert_eq!(
            grid.lines(20),
            ["trial          one", "jump01  1111111111", "", "trial        three", "jump01  3333333333"]
        );
    }
}
