//! Locates nodes in a YAML text, so that errors found after parsing can point at their place, too.

use aloft_workspace::error::PipelineError;
use miette::{NamedSource, SourceOffset, SourceSpan};
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

/// A step from a YAML node to one of its children.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    Key(String),
    Item(usize),
}

/// Parses a path such as `effects.define[0].parts[1].force[2]`.
fn steps(path: &str) -> Vec<Step> {
    let mut out = Vec::new();
    for word in path.split('.').filter(|w| !w.is_empty()) {
        let mut rest = word.split('[');
        if let Some(key) = rest.next().filter(|k| !k.is_empty()) {
            out.push(Step::Key(key.to_owned()));
        }
        out.extend(rest.filter_map(|i| i.trim_end_matches(']').parse().ok()).map(Step::Item));
    }
    out
}

/// Follows the steps and fails at their end, so that the parser reports that position.
struct Walk<'a>(&'a [Step]);

const HERE: &str = "here";

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();
    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("anything")
    }
    fn visit_bool<E: Error>(self, _: bool) -> Result<(), E> {
        Err(E::custom(HERE))
    }
    fn visit_i64<E: Error>(self, _: i64) -> Result<(), E> {
        Err(E::custom(HERE))
    }
    fn visit_u64<E: Error>(self, _: u64) -> Result<(), E> {
        Err(E::custom(HERE))
    }
    fn visit_f64<E: Error>(self, _: f64) -> Result<(), E> {
        Err(E::custom(HERE))
    }
    fn visit_str<E: Error>(self, _: &str) -> Result<(), E> {
        Err(E::custom(HERE))
    }
    fn visit_unit<E: Error>(self) -> Result<(), E> {
        Err(E::custom(HERE))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let Some((Step::Item(wanted), rest)) = self.0.split_first() else { return Err(A::Error::custom(HERE)) };
        for _ in 0..*wanted {
            seq.next_element::<IgnoredAny>()?;
        }
        seq.next_element_seed(Walk(rest))?;
        Err(A::Error::custom(HERE))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Some((Step::Key(wanted), rest)) = self.0.split_first() else { return Err(A::Error::custom(HERE)) };
        while let Some(key) = map.next_key::<String>()? {
            if key == *wanted {
                map.next_value_seed(Walk(rest))?;
            } else {
                map.next_value::<IgnoredAny>()?;
            }
        }
        Err(A::Error::custom(HERE))
    }
}

/// Byte at which the node of a path begins; if the path does not exist in full, that of its last
/// existing node.
pub fn find(text: &str, path: &str) -> Option<usize> {
    let error = Walk(&steps(path)).deserialize(serde_yaml::Deserializer::from_str(text)).err()?;
    let at = error.location()?;
    (at.index() < text.len()).then(|| at.index())
}

/// Byte of a character in a string value that begins at byte `start` (quotes included). If the text
/// is written differently from the value (folded, with escapes), the value's first byte.
pub fn inside(text: &str, start: usize, value: &str, characters: usize) -> usize {
    let rest = &text[start..];
    let begin = match rest.chars().next() {
        Some('"' | '\'') => start + 1,
        Some('|' | '>') => start + rest.find(value).unwrap_or(0),
        _ => start,
    };
    if !text[begin..].starts_with(value) {
        return start;
    }
    begin + value.char_indices().nth(characters).map_or(value.len(), |(byte, _)| byte)
}

/// A configuration error at a byte of a text; the message names the line.
pub fn error_at(
    file: &str,
    text: &str,
    at: Option<(usize, usize)>,
    problem: &str,
    hint: Option<String>,
) -> PipelineError {
    let line = at.map(|(byte, _)| text[..byte.min(text.len())].matches('\n').count() + 1);
    PipelineError::Config {
        file: file.to_owned(),
        problem: line.map_or_else(|| problem.to_owned(), |l| format!("line {l}: {problem}")),
        text: NamedSource::new(file, text.to_owned()),
        at: at.map(|(byte, length)| SourceSpan::new(SourceOffset::from(byte), length)),
        hint,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    const TEXT: &str =
        "a: 1\nb:\n  - {x: \"one + two\", y: [p, 'q r']}\n  - x: plain * text   # remark\n    z: >\n      folded\n";

    #[test]
    fn nodes_are_found_at_their_first_byte() {
        for (path, begins) in [
            ("a", "1\n"),
            ("b[0].x", "\"one"),
            ("b[0].y[1]", "'q r'"),
            ("b[1].x", "plain"),
            ("b[1].z", ">\n"),
            ("b[0].y", "[p"),
        ] {
            let at = find(TEXT, path).unwrap();
            assert!(TEXT[at..].starts_with(begins), "{path}: {:?}", &TEXT[at..]);
        }
    }

    #[test]
    fn characters_of_a_value_are_found() {
        let of = |path: &str, value: &str, i: usize| {
            let at = inside(TEXT, find(TEXT, path).unwrap(), value, i);
            TEXT[at..].chars().next().unwrap()
        };
        assert_eq!(of("b[0].x", "one + two", 4), '+');
        assert_eq!(of("b[0].y[1]", "q r", 2), 'r');
        assert_eq!(of("b[1].x", "plain * text", 6), '*');
        assert_eq!(of("b[1].z", "folded", 3), 'd');
    }
}
