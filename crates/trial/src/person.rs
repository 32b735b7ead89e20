//! The person that a recording names, and names compared.

use aloft_c3d::C3dFile;

/// The person that SUBJECTS:NAMES of a file states, if it states exactly one.
pub fn person_of(file: &C3dFile) -> Option<String> {
    let names = file.groups.get("SUBJECTS", "NAMES").map(|p| p.strings()).unwrap_or_default();
    let mut named = names.iter().map(|n| n.trim()).filter(|n| !n.is_empty());
    named.next().filter(|_| named.next().is_none()).map(str::to_owned)
}

/// A name as it is compared with others: without regard to capitals, spaces and punctuation.
pub fn person_key(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}
