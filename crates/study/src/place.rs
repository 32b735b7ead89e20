//! Errors that point at their place in a YAML text: what the parser says, and errors found after
//! parsing, for which the place is found again in the text.

use crate::nearest::nearest;
use crate::quote::acts_on_terminal;
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
    let problem = line.map_or_else(|| problem.to_owned(), |l| format!("line {l}: {problem}"));
    quoted(file, text, at, problem, hint)
}

/// Columns of a line up to which the place in it is shown below a message; a longer line takes the
/// screen, and the library that draws it fails beyond column 65,535.
const LONGEST_SHOWN: usize = 500;

/// A configuration error that quotes the text at a byte, if its line and those beside it are short
/// enough to be read.
fn quoted(file: &str, text: &str, at: Option<(usize, usize)>, problem: String, hint: Option<String>) -> PipelineError {
    let short = |byte: usize| {
        let begin = text.get(..byte)?.rfind('\n').map_or(0, |n| text[..n].rfind('\n').map_or(0, |m| m + 1));
        let all = text[begin..].lines();
        let own = text[begin..byte].matches('\n').count();
        all.take(own + 2)
            .all(|line| line.len() <= LONGEST_SHOWN)
            .then(|| text[byte..].lines().next().map_or(0, str::len))
    };
    let at = at.and_then(|(byte, length)| {
        let rest = short(byte)?;
        Some(SourceSpan::new(SourceOffset::from(byte), length.min(rest.max(1))))
    });
    let problem = match problem.char_indices().nth(LONGEST_SHOWN) {
        Some((end, _)) => format!("{}…", &problem[..end]),
        None => problem,
    };
    // of a text that is not quoted only the name is needed
    let text = if at.is_some() { shown_as_text(text) } else { String::new() };
    PipelineError::Config { file: file.to_owned(), problem, text: NamedSource::new(file, text), at, hint }
}

/// A text of the same length without characters that act on a terminal.
fn shown_as_text(text: &str) -> String {
    let same_length = |c: char| match c.len_utf8() {
        1 => '?',
        2 => '¿',
        _ => '\u{fffd}',
    };
    let plain = |c: char| matches!(c, '\n' | '\r' | '\t') || !acts_on_terminal(c);
    text.chars().map(|c| if plain(c) { c } else { same_length(c) }).collect()
}

/// What the parser says, with its place.
pub(crate) fn not_yaml(file: &str, text: &str, error: &serde_yaml::Error) -> PipelineError {
    let at = error.location().map(|l| {
        let byte = SourceOffset::from_location(text, l.line(), l.column()).offset();
        (byte.min(text.len()), token_length(text, l.index()))
    });
    let full = error.to_string();
    let hint = meant(&full);
    let problem = match full.rfind(" at line ") {
        Some(cut) => full[..cut].to_owned(),
        None => full,
    };
    let problem = match error.location() {
        Some(l) => format!("line {}: {problem}", l.line()),
        None => problem,
    };
    quoted(file, text, at, problem, hint)
}

/// The known name nearest to one that the parser does not know.
fn meant(problem: &str) -> Option<String> {
    let quoted: Vec<&str> = problem[problem.find("unknown ")?..].split('`').skip(1).step_by(2).collect();
    let (unknown, known) = quoted.split_first()?;
    let near = nearest(unknown, known).first().map(|name| format!("did you mean `{name}`?"))?;
    Some(near)
}

fn token_length(text: &str, index: usize) -> usize {
    text.get(index..).map_or(0, |rest| rest.find([' ', ':', '\n']).unwrap_or(rest.len())).max(1)
}

/// A configuration error that points at the first line on which `key:` stands.
pub fn error_at_key(
    file: &str,
    text: &str,
    key: &str,
    problem: impl Into<String>,
    hint: Option<String>,
) -> PipelineError {
    // plain, or in quotes as in JSON
    let forms = [key.to_owned(), format!("\"{key}\""), format!("'{key}'")];
    let is_key = |line: &str| {
        let rest = forms.iter().find_map(|form| line.strip_prefix(form.as_str()));
        rest.is_some_and(|rest| rest.trim_start().starts_with(':'))
    };
    let mut offset = 0;
    let mut at = None;
    for line in text.split_inclusive('\n') {
        let trimmed = line.trim_start();
        if is_key(trimmed) {
            at = Some((offset + line.len() - trimmed.len(), trimmed.trim_end().len()));
            break;
        }
        offset += line.len();
    }
    error_at(file, text, at, &problem.into(), hint)
}

/// A configuration error that points at an item of the list under `key:` (at the key where items do
/// not begin lines of their own).
pub fn error_at_item(
    file: &str,
    text: &str,
    key: &str,
    item: usize,
    problem: impl Into<String>,
    hint: Option<String>,
) -> PipelineError {
    let mut offset = 0;
    // where each line's words begin in the text, how far they are indented, and the words
    let mut lines = text.split_inclusive('\n').map(|line| {
        let indent = line.len() - line.trim_start().len();
        offset += line.len();
        (offset - line.len() + indent, indent, line.trim())
    });
    let below = lines.by_ref().find(|(_, _, l)| l.starts_with(&format!("{key}:")));
    let list: Vec<(usize, usize, &str)> =
        lines.take_while(|(_, indent, l)| *indent > 0 || l.is_empty() || l.starts_with(['-', '#'])).collect();
    let own = list.iter().find(|(_, _, l)| l.starts_with("- ")).map_or(0, |(_, indent, _)| *indent);
    let mut items = list.iter().filter(|(_, indent, l)| *indent == own && l.starts_with("- "));
    match below.and_then(|_| items.nth(item)) {
        Some((begin, _, line)) => error_at(file, text, Some((*begin, line.len())), &problem.into(), hint),
        None => error_at_key(file, text, key, problem, hint),
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

    fn drawn(text: &str) -> String {
        let error = crate::ranges::parse_yaml::<serde_yaml::Value>("p.yaml", text).unwrap_err();
        format!("{:?}", miette::Report::new(error))
    }

    #[test]
    fn regress_an_error_far_to_the_right_is_reported_without_its_line() {
        // the library that draws the place fails beyond column 65,535
        for far in [10, 400, 499, 501, 65_530, 65_540, 300_000] {
            for text in [
                format!("{}: [", "a ".repeat(far)),
                format!("a: {}\nb: [}}\n", "x".repeat(far)),
                format!("b: [}}\na: {}\n", "x".repeat(far)),
                format!("{}: [}}", "ä".repeat(far)),
                format!("a: \"{}\" x: [}}", "\t".repeat(far)),
                format!("a: {{b: c, {}", "}".repeat(far)),
            ] {
                let shown = drawn(&text);
                assert!(shown.contains("p.yaml"), "{far}: {shown}");
                assert!(shown.len() < 20_000, "{far}: {} bytes", shown.len());
            }
        }
    }

    #[test]
    fn a_quoted_line_cannot_act_on_the_terminal() {
        let shown = drawn("a: \u{9b}31m\u{202e}\n[\n");
        assert!(!shown.contains(['\u{9b}', '\u{202e}']), "{shown:?}");
        assert!(!drawn("a: \u{1b}[31m\n[\n").contains("\u{1b}[31m\n"));
    }
}
