//! Names that other programs and file systems accept.
//!
//! Names of recordings, subjects and sessions are user data and may contain blanks, quotes, line
//! breaks and anything else that a file system allows. Their encoded forms in an export must be
//! valid everywhere (Windows, macOS, OpenSim, BIDS), and different names must have different
//! encodings. Each function here is injective on names that differ by more than case, and its
//! values also differ by more than case: on a file system that does not distinguish `Jump` from
//! `jump`, two recordings still have two files. Names that need no change are kept.

/// Device names reserved by Windows, with any extension.
const RESERVED: [&str; 22] = [
    "con", "prn", "aux", "nul", "com1", "com2", "com3", "com4", "com5", "com6", "com7", "com8", "com9", "lpt1", "lpt2",
    "lpt3", "lpt4", "lpt5", "lpt6", "lpt7", "lpt8", "lpt9",
];

/// Longest file name written in full, bytes; suffixes such as `_external_forces.xml` are added to
/// it.
const LONGEST: usize = 160;

fn percent(out: &mut String, c: char) {
    let mut bytes = [0; 4];
    for byte in c.encode_utf8(&mut bytes).bytes() {
        out.push_str(&format!("%{byte:02X}"));
    }
}

/// Letters and digits of scripts in which every letter has a single encoding (macOS treats
/// canonically equivalent names as one).
fn is_plain(c: char) -> bool {
    let block = matches!(u32::from(c),
        0..=0x024F | 0x0370..=0x0373 | 0x0375..=0x03FF | 0x0400..=0x052F | 0x3041..=0x3096 | 0x30A1..=0x30FA | 0x4E00..=0x9FFF | 0xAC00..=0xD7A3);
    // letters whose other case is in another alphabet, or two letters
    c.is_alphanumeric() && block && !matches!(c, 'İ' | 'ı' | 'ſ' | 'ß')
}

/// Name of a file or folder: letters, digits, `-`, `_` and `.` are kept, everything else is
/// percent-encoded as in a URL. A dot at either end and the first letter of a name reserved by
/// Windows are encoded, too. Very long names are truncated and end with a hash.
pub fn file(text: &str) -> String {
    let stem = text.split('.').next().unwrap_or(text).to_lowercase();
    let reserved = RESERVED.contains(&stem.as_str());
    let last = text.chars().count().saturating_sub(1);
    let mut name = String::with_capacity(text.len());
    for (i, c) in text.chars().enumerate() {
        let at_an_end = i == 0 || i == last;
        let kept = is_plain(c) || matches!(c, '-' | '_') || (c == '.' && !at_an_end);
        if kept && !(reserved && i == 0) {
            name.push(c);
        } else {
            percent(&mut name, c);
        }
    }
    if name.is_empty() {
        // no other name gives an escape without digits
        return "%_".to_owned();
    }
    if name.len() <= LONGEST {
        return name;
    }
    let mut cut = LONGEST - 20;
    while !name.is_char_boundary(cut) {
        cut -= 1;
    }
    format!("{}%_{:016x}", &name[..cut], fnv1a(text.to_lowercase().as_bytes()))
}

/// Short form of a name whose encoding would be too long: its hash, in letters and digits with
/// which no encoding begins.
pub(crate) fn hashed(text: &str) -> String {
    format!("h{:016x}", fnv1a(text.to_lowercase().as_bytes()))
}

/// FNV-1a, 64 bits.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

/// Labels in models and tables: characters that OpenSim, XML or tab-separated tables do not accept
/// are percent-encoded.
pub(crate) fn label(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_whitespace() || c.is_control() || "%/\\\"'<>&,;*+".contains(c) {
            percent(&mut out, c);
        } else {
            out.push(c);
        }
    }
    out
}

/// Name of the subject in models and headings of an export, which contains one subject: the part
/// before a comma (descriptions of objects continue after it), at most 40 characters, readable
/// rather than reversible.
pub(crate) fn id(text: &str) -> String {
    let short = text.split(',').next().unwrap_or(text).trim();
    let name: String =
        short.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).take(40).collect();
    let name = name.trim_matches('.');
    if name.is_empty() {
        return "subject".to_owned();
    }
    let stem = name.split('.').next().unwrap_or(name).to_lowercase();
    if RESERVED.contains(&stem.as_str()) { format!("{name}_") } else { name.to_owned() }
}

/// ASCII letters and digits of a name, the only characters allowed in a BIDS label.
pub(crate) fn alphanumeric(text: &str) -> String {
    text.chars().filter(char::is_ascii_alphanumeric).collect()
}

/// The characters dropped by [`alphanumeric`] and their positions, in letters and digits: the
/// byte's position in the name, then `u` for `_`, `d` for `-`, `p` for `.`, `s` for a blank, `x`
/// and two hexadecimal digits for any other byte. Empty for names of letters and digits. The
/// original name can be reconstructed from both.
pub(crate) fn dropped(text: &str) -> String {
    let mut out = String::new();
    for (place, byte) in text.bytes().enumerate().filter(|(_, b)| !b.is_ascii_alphanumeric()) {
        out.push_str(&place.to_string());
        match byte {
            b'_' => out.push('u'),
            b'-' => out.push('d'),
            b'.' => out.push('p'),
            b' ' => out.push('s'),
            other => out.push_str(&format!("x{other:02x}")),
        }
    }
    out
}

/// BIDS label of a subject or session: letters and digits, then `Z` and the dropped characters
/// ([`dropped`]). Names that contain a `z` end with `Z`, so that no name equals the label of
/// another.
pub(crate) fn bids(text: &str) -> String {
    let plain = alphanumeric(text);
    let code = dropped(text);
    if plain.len() + code.len() > 60 {
        return format!("{}Z{}", &plain[..plain.len().min(20)], hashed(text));
    }
    if code.is_empty() && !plain.is_empty() && !plain.contains(['z', 'Z']) {
        return plain;
    }
    format!("{plain}Z{code}")
}

/// A text that no spreadsheet computes: one that begins like a formula (`= + - @`, a tab or a
/// carriage return) and is no number gets an apostrophe in front, which spreadsheets take as
/// "text". Names of recordings and markers come from others, and a formula in one could call a
/// program or an address.
pub fn no_formula(text: &str) -> std::borrow::Cow<'_, str> {
    let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']) && text.parse::<f64>().is_err();
    if formula { format!("'{text}").into() } else { text.into() }
}

/// A text as a cell of CSV: no formula, and in quotes where it holds a comma, a quote or a line
/// break.
pub fn csv_cell(text: &str) -> String {
    let text = no_formula(text);
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn regress_names_stay_readable() {
        assert_eq!(label("LASI"), "LASI");
        assert_eq!(label("L ASI"), "L%20ASI");
        assert_eq!(file("throws_01"), "throws_01");
        assert_eq!(file("Müller-01"), "Müller-01");
        assert_eq!(file("../s 01"), "%2E.%2Fs%2001");
        assert_eq!(file("con.x"), "%63on.x");
        assert_eq!(bids("sub01a"), "sub01a");
        assert_eq!(bids("sub_01-a"), "sub01aZ3u6d");
        assert_eq!(id("two-link chain, one passive joint"), "two-link_chain");
    }

    /// All strings of up to five characters from a set of problematic characters, and names known
    /// to collide.
    fn hostile() -> Vec<String> {
        let alphabet =
            ['a', 'z', 'Z', '1', '_', ' ', '.', '-', '%', 'u', '\'', '/', '\\', '\n', 'ü', '\u{308}', 'Ω', '\u{2126}'];
        let mut all = vec![String::new()];
        let mut last = all.clone();
        for _ in 0..4 {
            last = last.iter().flat_map(|s| alphabet.iter().map(move |c| format!("{s}{c}"))).collect();
            all.extend(last.iter().cloned());
        }
        for name in ["con", "CON.txt", "nul", "con_", "%63on", "throws_a b", "throws_a_b", "throws_1", "throws1"] {
            all.push(name.to_owned());
        }
        let long = "x".repeat(300);
        all.extend([format!("{long}1"), format!("{long}2"), format!("{long} "), "ü".repeat(120)]);
        all.sort();
        all.dedup();
        all
    }

    /// A name as compared by the file systems of Windows and macOS: case folded, composed letters.
    fn folded(name: &str) -> String {
        name.to_lowercase().replace("u\u{308}", "ü").replace('\u{2126}', "ω")
    }

    fn is_injective(encode: impl Fn(&str) -> String) {
        let mut seen: BTreeMap<String, String> = BTreeMap::new();
        for name in hostile() {
            let key = encode(&name);
            if let Some(other) = seen.insert(key.clone(), name.clone()) {
                assert!(other.to_lowercase() == name.to_lowercase(), "{other:?} and {name:?} both become {key:?}");
            }
        }
    }

    #[test]
    fn different_names_have_different_files_on_every_file_system() {
        is_injective(|n| folded(&file(n)));
        for name in hostile() {
            let out = file(&name);
            assert!(!out.is_empty() && out.len() <= 160 && !out.starts_with('.') && !out.ends_with('.'), "{out}");
            assert!(out.chars().all(|c| c.is_alphanumeric() || "-_.%".contains(c)), "{out}");
            let stem = out.split('.').next().unwrap_or_default().to_lowercase();
            assert!(!RESERVED.contains(&stem.as_str()), "{out}");
        }
    }

    #[test]
    fn labels_of_bids_are_letters_and_digits_and_differ() {
        is_injective(|n| bids(n).to_lowercase());
        is_injective(|n| format!("{} {}", alphanumeric(n).to_lowercase(), dropped(n)));
        assert!(hostile().iter().all(|n| bids(n).chars().all(|c| c.is_ascii_alphanumeric()) && !bids(n).is_empty()));
    }

    #[test]
    fn labels_differ_and_hold_nothing_that_separates() {
        is_injective(label);
        assert!(hostile().iter().all(|n| !label(n).contains(|c: char| c.is_whitespace() || "/\\'\"".contains(c))));
    }
}
