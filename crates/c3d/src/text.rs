//! Text in a file: bytes that are usually ASCII, sometimes UTF-8 or Windows-1252, kept as stored.

use std::fmt;

/// Bytes of a name, description or string as stored, so that writing reproduces them.
#[derive(Clone, PartialEq, Eq, Default, Hash)]
pub struct Text(pub Vec<u8>);

impl Text {
    /// As a string: UTF-8 where valid, else one character per byte (Latin-1).
    pub fn decode(&self) -> String {
        decode(&self.0)
    }
    /// Whether the text equals this name, ignoring ASCII case and surrounding blanks.
    pub fn is(&self, name: &str) -> bool {
        trim(&self.0).eq_ignore_ascii_case(name.as_bytes())
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Self {
        Self(text.as_bytes().to_vec())
    }
}

impl fmt::Display for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.decode())
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.decode())
    }
}

/// Decodes after removing blanks and NULs at both ends.
pub(crate) fn decode(bytes: &[u8]) -> String {
    let bytes = trim(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        // none: bytes that are no UTF-8 are Latin-1
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

fn trim(bytes: &[u8]) -> &[u8] {
    let blank = |b: &u8| *b == 0 || b.is_ascii_whitespace();
    let start = bytes.iter().position(|b| !blank(b)).unwrap_or(bytes.len());
    let end = bytes.iter().rposition(|b| !blank(b)).map_or(start, |last| last + 1);
    &bytes[start..end]
}

/// A label without its subject, and the subject: `Anna:LASI` is `LASI` of `Anna`. Both without
/// surrounding blanks.
pub fn split_subject(label: &str) -> (&str, Option<&str>) {
    match label.rsplit_once(':') {
        Some((subject, rest)) if !rest.trim().is_empty() => (rest.trim(), Some(subject.trim())),
        _ => (label.trim(), None),
    }
}

/// A label without its subject: `Anna:LASI` becomes `LASI`.
pub fn strip_subject(label: &str) -> &str {
    split_subject(label).0
}

/// Whether a trajectory was never named: its label is empty or `*12`. Programs also write `U12` or
/// `C_7` for such trajectories, but laboratories use the same names for cluster markers; those are
/// kept, because losing a marker is worse than keeping an unnamed trajectory.
pub fn is_unlabelled(label: &str) -> bool {
    let label = strip_subject(label);
    label.is_empty() || label.starts_with('*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_text_keeps_odd_bytes() {
        assert_eq!(decode(b"  LASI \0\0"), "LASI");
        assert_eq!(decode(b"Gew\xf6lbe "), "Gew\u{f6}lbe");
        assert_eq!(decode("Gewölbe".as_bytes()), "Gewölbe");
        assert_eq!(decode(b"\0\0"), "");
    }

    #[test]
    fn regress_subjects_and_unlabelled() {
        assert_eq!(strip_subject("Anna:LASI"), "LASI");
        assert_eq!(strip_subject("LASI"), "LASI");
        assert_eq!(strip_subject("Anna:"), "Anna:");
        assert_eq!(split_subject(" Anna : LASI "), ("LASI", Some("Anna")));
        assert_eq!(split_subject("Lab:Anna:LASI"), ("LASI", Some("Lab:Anna")));
        assert_eq!(split_subject(" LASI "), ("LASI", None));
        assert!(is_unlabelled("*12") && is_unlabelled(" ") && is_unlabelled("Anna:*3"));
        for named in ["C7", "LASI", "UPA", "U12", "C_7"] {
            assert!(!is_unlabelled(named), "{named}");
        }
    }
}
