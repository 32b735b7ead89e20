//! What is refused in XML before it is parsed: nesting that would exhaust the stack of the parsers,
//! and entities that would multiply the text.

/// Deepest nesting of elements. MJCF nests the bodies of a chain, some elements each; the parsers
/// call themselves for each level, and the threads that read models have a stack of 2 MB.
const DEEPEST: usize = 250;

/// Checks a text of XML before a parser reads it; whether it is well-formed is left to the parser.
///
/// # Errors
/// Elements nested deeper than 250; entities that hold markup or other entities, or whose values
/// together are longer than the text.
pub fn check_xml(text: &str) -> Result<(), String> {
    let mut rest = text;
    let (mut depth, mut expanded) = (0_usize, 0_usize);
    while let Some(at) = rest.find('<') {
        rest = &rest[at..];
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((begin, end)) = skipped.iter().find(|(begin, _)| rest.starts_with(begin)) {
            let inside = &rest[begin.len()..];
            rest = inside.find(end).map_or("", |at| &inside[at + end.len()..]);
            continue;
        }
        let (tag, after) = tag(rest);
        if tag.starts_with("<!") {
            for (name, value) in entities(tag) {
                if value.contains(['&', '<']) {
                    return Err(format!(
                        "the entity `{name}` holds markup or other entities: write its text where it is used"
                    ));
                }
                expanded += value.len() * text.matches(&format!("&{name};")).count();
            }
            if expanded > text.len() {
                return Err(format!(
                    "its entities expand to {expanded} bytes, more than the file has ({}): write their text where it is used",
                    text.len()
                ));
            }
        } else if tag.starts_with("</") {
            depth = depth.saturating_sub(1);
        } else if !tag.ends_with("/>") {
            depth += 1;
            if depth > DEEPEST {
                let line = text[..text.len() - rest.len()].matches('\n').count() + 1;
                return Err(format!("line {line}: elements are nested deeper than {DEEPEST}"));
            }
        }
        rest = after;
    }
    Ok(())
}

/// The tag at the beginning of a text up to its `>`, and what follows. Quotes and the square
/// brackets of a DOCTYPE may hold `>`.
fn tag(text: &str) -> (&str, &str) {
    let (mut quote, mut bracket) = (None, false);
    for (at, byte) in text.bytes().enumerate() {
        match (quote, byte) {
            (Some(open), _) if byte == open => quote = None,
            (Some(_), _) => {}
            (None, b'"' | b'\'') => quote = Some(byte),
            (None, b'[') => bracket = true,
            (None, b']') => bracket = false,
            (None, b'>') if !(bracket && text.starts_with("<!")) => return text.split_at(at + 1),
            _ => {}
        }
    }
    (text, "")
}

/// Names and values of the entities that a DOCTYPE defines.
fn entities(doctype: &str) -> impl Iterator<Item = (&str, &str)> {
    doctype.split("<!ENTITY").skip(1).filter_map(|text| {
        let (name, rest) = text.trim_start().split_once(char::is_whitespace)?;
        let quote = rest.find(['"', '\''])?;
        let value = &rest[quote + 1..];
        Some((name, &value[..value.find(&rest[quote..=quote]).unwrap_or(value.len())]))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn nested(levels: usize) -> String {
        format!("<a>{}{}</a>", "<b x=\"1>\">\n".repeat(levels - 1), "</b>".repeat(levels - 1))
    }

    #[test]
    fn nesting_is_bounded_and_its_line_told() {
        assert_eq!(check_xml(&nested(DEEPEST)), Ok(()));
        let told = check_xml(&nested(DEEPEST + 1)).unwrap_err();
        assert_eq!(told, "line 250: elements are nested deeper than 250");
        let flat = format!("<a>{}</a>", "<b/><c></c><!-- <d> --><![CDATA[<e>]]><?f <g>?>".repeat(1000));
        assert_eq!(check_xml(&flat), Ok(()));
        for end in 0..200 {
            let _ = check_xml(&nested(40)[..end]);
        }
    }

    #[test]
    fn entities_are_read_where_they_are_short() {
        let with = |subset: &str, body: &str| check_xml(&format!("<!DOCTYPE r [{subset}]><r>{body}</r>"));
        assert_eq!(with("<!ENTITY r \"0.1 0.2\"> <!ELEMENT x (y)>", "<x a='&r;'/>"), Ok(()));
        assert!(with("<!ENTITY a 'x'><!ENTITY b '&a;&a;'>", "&b;").unwrap_err().contains("`b` holds markup"));
        let long = format!("<!ENTITY a '{}'>", "x".repeat(1000));
        assert!(with(&long, &"&a;".repeat(1000)).unwrap_err().contains("expand to 1000000 bytes"));
    }
}
