//! Cells of text tables: a number, or a word for a missing value. Stated once for every text reader
//! (TRC, MOT and STO, BIDS, logs of robots, tables of participants).
//!
//! Missing are an empty cell and what programs write where they have no value: `NaN` in every
//! spelling, `NA`, `n/a`, `<NA>`, `null`, `nil`, `None`, `missing`, dots, dashes, question marks,
//! the asterisks of Fortran where a number does not fit, the `1.#QNAN`, `-1.#IND`, `1.#INF` of
//! Microsoft's library at any length, and the errors of spreadsheets (`#N/A`, `#DIV/0!`).
//!
//! An infinite value is missing, too: no sensor measures one, and it comes from a division by zero
//! or an overflow.

/// Words for a missing value, in lower case.
const WORDS: [&str; 13] =
    ["nan", "na", "n/a", "n.a.", "<na>", "null", "(null)", "nil", "none", "missing", "inf", "infinity", "undefined"];

/// Characters of which a placeholder consists: `-`, `--`, `…`, `.`, `?`, `***`.
const PLACEHOLDERS: [char; 7] = ['-', '–', '—', '.', '…', '?', '*'];

/// True for an empty cell and for words that mean a missing value.
pub fn is_missing(cell: &str) -> bool {
    let cell = cell.trim().trim_matches('"').trim();
    // most cells are numbers
    if cell.starts_with(|c: char| c.is_ascii_digit()) && !cell.starts_with("1.#") {
        return false;
    }
    if PLACEHOLDERS.iter().any(|p| cell.chars().all(|c| c == *p)) {
        return true;
    }
    let word = cell.strip_prefix(['-', '+']).unwrap_or(cell).to_ascii_lowercase();
    // `nan(ind)` and `nan(snan)` are newer spellings of Microsoft's library
    WORDS.contains(&word.as_str())
        || (word.starts_with("nan(") && word.ends_with(')'))
        || word.starts_with("1.#")
        || is_spreadsheet_error(cell)
}

/// `#N/A`, `#NUM!`, `#DIV/0!` …
fn is_spreadsheet_error(cell: &str) -> bool {
    let Some(code) = cell.strip_prefix('#') else { return false };
    let code = code.trim_end_matches(['!', '?']).to_ascii_uppercase();
    matches!(code.as_str(), "N/A" | "NA" | "NUM" | "DIV/0" | "VALUE" | "REF" | "NAME" | "NULL")
}

/// The number of a cell, NaN where it is missing or infinite; `None` for anything else.
pub fn number(cell: &str) -> Option<f64> {
    match cell.parse::<f64>() {
        Ok(value) if value.is_finite() => Some(value),
        Ok(_) => Some(f64::NAN),
        // none: what is no number and no word for "missing" is refused by the caller
        Err(_) => is_missing(cell).then_some(f64::NAN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_for_a_missing_value_is_missing_and_numbers_and_other_words_are_not() {
        for cell in [
            "",
            " ",
            "nan",
            "NaN",
            "NAN",
            "-nan",
            "+NaN",
            "nan(ind)",
            "-nan(ind)",
            "NaN(snan)",
            "NA",
            "na",
            "n/a",
            "N/A",
            "N.A.",
            "<NA>",
            "null",
            "NULL",
            "(null)",
            "nil",
            "None",
            "none",
            "missing",
            ".",
            "..",
            "-",
            "--",
            "---",
            "–",
            "?",
            "***",
            "1.#QNAN",
            "-1.#QNAN0",
            "1.#IND",
            "-1.#IND00",
            "-1.#J",
            "1.#R",
            "1.#INF",
            "-1.#INF",
            "1.#SNAN",
            "#N/A",
            "#NA",
            "#DIV/0!",
            "#NUM!",
            "#VALUE!",
            "#NAME?",
            "#REF!",
            "#NULL!",
            "inf",
            "-Inf",
            "Infinity",
            "\"\"",
            "\"NaN\"",
            "undefined",
        ] {
            assert!(is_missing(cell), "{cell}");
            assert!(number(cell).is_some_and(f64::is_nan), "{cell}");
        }
        for cell in ["0", "-0.5", ".5", "-.5", "1.", "1e-3", "+7"] {
            assert!(number(cell).is_some_and(f64::is_finite) && !is_missing(cell), "{cell}");
        }
        for cell in ["nano", "x", "-x", "1.5.2", "1,5", "#3", "none3", "1..2", "n", "na n", "-1e", "12-"] {
            assert!(number(cell).is_none() && !is_missing(cell), "{cell}");
        }
        assert_eq!(number("1e400").map(f64::is_nan), Some(true));
    }
}
