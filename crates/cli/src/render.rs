//! Tables and messages as text. Data goes to stdout, messages to stderr.

use crate::stop::Stop;
use aloft_analysis::parameters::half_of;
use aloft_study::quote::visible;
use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use std::io::Write;

/// An empty table with a header; the first column is left-aligned, the others right-aligned.
pub fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING).set_content_arrangement(ContentArrangement::Disabled).set_header(header);
    for (i, column) in table.column_iter_mut().enumerate() {
        column.set_padding((0, 2));
        if i > 0 {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// Prints to stdout; a closed pipe ends the command without a message.
pub fn out(text: impl std::fmt::Display) -> Result<(), Stop> {
    writeln!(std::io::stdout(), "{text}").map_err(|e| match e.kind() {
        std::io::ErrorKind::BrokenPipe => Stop::PipeClosed,
        _ => Stop::Error(miette::miette!("cannot write to the standard output: {e}")),
    })
}

/// Prints one line to stderr. Line breaks and control characters in names are escaped, so that they
/// cannot act on the terminal.
pub fn note(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{}", visible(&text.to_string()));
}

/// Prints a command that can be copied to a shell, unchanged: line breaks are inside quotes.
pub fn command(label: &str, text: &str) {
    let _ = writeln!(std::io::stderr(), "{label}: {text}");
}

/// Prints an error with its location and hint.
pub fn error(report: &miette::Report) {
    let _ = writeln!(std::io::stderr(), "{report:?}");
}

/// Half-width of a 95 % interval with two significant digits; a dash if there is none.
pub fn half(ci95: Option<[f64; 2]>) -> String {
    significant(half_of(ci95).unwrap_or(f64::NAN), 2)
}

/// `± 1.2`, `at its bound`, or nothing.
pub fn plus_minus(ci95: Option<[f64; 2]>, at_bound: bool) -> String {
    match ci95 {
        Some(_) => format!(" ± {}", half(ci95)),
        None if at_bound => " (at its bound)".to_owned(),
        None => String::new(),
    }
}

/// A number with this many significant digits.
pub fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = value.abs().log10().floor() as i32;
    if magnitude < -6 {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let decimals = (digits as i32 - 1 - magnitude).clamp(0, 12) as usize;
    format!("{value:.decimals$}")
}

/// Prints a value as JSON.
pub fn json<T: serde::Serialize>(value: &T) -> Result<(), Stop> {
    let text =
        serde_json::to_string_pretty(value).map_err(|e| Stop::Error(miette::miette!("cannot write JSON: {e}")))?;
    out(text)
}
