//! Names that other programs accept.

/// Labels of models and tables: blanks and separators of paths become `_`.
pub(crate) fn label(text: &str) -> String {
    text.trim().chars().map(|c| if c.is_whitespace() || "/\\\"'<>&,;".contains(c) { '_' } else { c }).collect()
}

/// Names of files: letters, digits, `-`, `_` and `.` stay, the rest becomes `_`; never empty, never hidden.
pub(crate) fn file(text: &str) -> String {
    let name: String =
        text.trim().chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
    let name = name.trim_start_matches('.');
    if name.is_empty() { "subject".to_owned() } else { name.to_owned() }
}

/// Identifier of a subject for files: what stands before a comma (descriptions of objects go on behind it), at most 40 letters.
pub(crate) fn id(text: &str) -> String {
    file(text.split(',').next().unwrap_or(text)).chars().take(40).collect()
}

/// BIDS labels: letters and digits only.
pub(crate) fn bids(text: &str) -> String {
    let name: String = text.chars().filter(char::is_ascii_alphanumeric).collect();
    if name.is_empty() { "01".to_owned() } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_names_stay_readable() {
        assert_eq!(label("L ASI"), "L_ASI");
        assert_eq!(file("../s 01"), "_s_01");
        assert_eq!(file("Müller-01"), "Müller-01");
        assert_eq!(bids("sub_01-a"), "sub01a");
        assert_eq!(id("two-link chain, one passive joint"), "two-link_chain");
    }
}
