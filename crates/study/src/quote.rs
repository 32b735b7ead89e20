//! Quotes names: every name that the program prints as part of a command, a pattern or YAML passes
//! through this module.
//!
//! Recordings, subjects, sessions and folders may have any name that a file system allows. A
//! command printed for copying must mean the same to a shell as to this program, whatever
//! characters the names contain.

use std::path::Path;

/// Quotes a word for a POSIX shell: unchanged if nothing in it is special, otherwise in single
/// quotes.
pub fn word(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=@%+,".contains(c);
    // `a=b` at the start of a line would set a variable, but no printed command begins with a name
    if !text.is_empty() && text.chars().all(plain) {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Joins the words of a command into one line for a shell.
pub fn line<T: AsRef<str>>(words: impl IntoIterator<Item = T>) -> String {
    words.into_iter().map(|w| word(w.as_ref())).collect::<Vec<_>>().join(" ")
}

/// A path as a separate argument. A path that begins with `-` is changed so that it is not read as
/// an option.
pub fn argument(path: &Path) -> String {
    let text = path.display().to_string();
    if text.starts_with('-') { format!("./{text}") } else { text }
}

/// A path in a printed command, quoted.
pub fn path(path: &Path) -> String {
    word(&argument(path))
}

/// `--flag VALUE` as the words of a command; a value that begins with `-` is joined to its flag.
pub fn option(flag: &str, value: &str) -> Vec<String> {
    if value.starts_with('-') { vec![format!("--{flag}={value}")] } else { vec![format!("--{flag}"), value.to_owned()] }
}

/// A pipeline with the folders that replace its own, as the arguments of a command.
pub fn pipeline(path: &Path, data: Option<&Path>, workspace: Option<&Path>) -> String {
    let folder = |flag: &str, path: Option<&Path>| path.map_or(Vec::new(), |p| option(flag, &p.display().to_string()));
    let mut words = vec![argument(path)];
    words.extend(folder("data", data));
    words.extend(folder("workspace", workspace));
    line(words)
}

/// The pattern that matches exactly this name.
pub fn pattern(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            '*' | '?' | '[' | ']' | '{' | '}' => {
                out.push('[');
                out.push(c);
                out.push(']');
            }
            // on systems where `\` separates folders, it cannot occur in a name
            '\\' if !cfg!(windows) => out.push_str("\\\\"),
            c => out.push(c),
        }
    }
    out
}

/// A string in YAML, on one line: unquoted if YAML reads it as the same string, otherwise in double
/// quotes.
pub fn yaml(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "_-./".contains(c);
    let letter = text.chars().next().is_some_and(|c| c.is_alphabetic() || c == '_');
    // none: what does not read back the same is quoted
    let same = || serde_yaml::from_str::<serde_yaml::Value>(text).is_ok_and(|back| back.as_str() == Some(text));
    if letter && text.chars().all(plain) && same() {
        return text.to_owned();
    }
    yaml_quoted(text)
}

/// A string in YAML, in double quotes, on one line.
pub fn yaml_quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            '\t' => out.push_str("\\t"),
            // control characters, and characters that YAML treats as line breaks or does not allow
            c if c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}') => {
                out.push_str(&format!("\\U{:08x}", u32::from(c)));
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// True for characters that a terminal obeys instead of showing them: control characters, breaks of
/// lines and paragraphs, and those that turn the direction of writing.
pub fn acts_on_terminal(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{2028}' | '\u{2029}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// A text on one line, for comments and tables: control characters are escaped as in source code.
pub fn visible(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if acts_on_terminal(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    /// Names that contain what shells, patterns and YAML treat as special: every pair of pieces.
    fn hostile() -> Vec<String> {
        let pieces = [
            "a",
            " ",
            "'",
            "\"",
            "'''",
            "$(touch x)",
            "`touch x`",
            "$HOME",
            "\\",
            "\n",
            "\t",
            "-",
            "--help",
            "*",
            "?",
            "[a]",
            "]",
            "{a,b}",
            "!",
            "#",
            ";touch x",
            "&",
            "|",
            "<",
            ">",
            "(",
            ")",
            "~",
            "=",
            "%",
            "ü",
            "日本",
            "\u{2028}",
            "\u{7f}",
            "\u{1b}[31m",
            "null",
            "1",
            "1e3",
            "yes",
            ": ",
            "- ",
            "&a",
            "*a",
            "|-",
            "@",
            "%s",
            "{",
            "}",
            ",",
        ];
        let pairs = pieces.iter().flat_map(|a| pieces.iter().map(move |b| format!("{a}{b}")));
        pieces.iter().map(|p| (*p).to_owned()).chain(pairs).collect()
    }

    #[cfg(unix)]
    #[test]
    fn a_shell_reads_every_word_back() {
        let dir = tempfile::tempdir().unwrap();
        for chunk in hostile().chunks(400) {
            let script = format!("printf '%s\\0' {}", line(chunk));
            let out = std::process::Command::new("sh").arg("-c").arg(&script).current_dir(dir.path()).output().unwrap();
            let back: Vec<String> =
                String::from_utf8(out.stdout).unwrap().split_terminator('\0').map(str::to_owned).collect();
            assert_eq!(back, chunk, "{}", String::from_utf8_lossy(&out.stderr));
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "a name was executed");
    }

    #[test]
    fn a_pattern_matches_its_name_and_no_other() {
        let names = hostile();
        for name in &names {
            let glob = globset::Glob::new(&pattern(name)).unwrap().compile_matcher();
            assert!(glob.is_match(name), "{name:?} as {:?}", pattern(name));
            let others: Vec<&String> = names.iter().filter(|n| *n != name && glob.is_match(n)).collect();
            assert!(others.is_empty(), "{name:?} also matches {others:?}");
        }
    }

    #[test]
    fn yaml_reads_every_name_back_in_lists_and_mappings() {
        for name in hostile() {
            let text = format!("list: [{0}, {0}]\nmap: {{trial: {0}}}\n{0}: 1\n", yaml(&name));
            let value: serde_yaml::Value =
                serde_yaml::from_str(&text).unwrap_or_else(|e| panic!("{name:?}: {e}\n{text}"));
            assert_eq!(value["list"][1].as_str(), Some(name.as_str()), "{text}");
            assert_eq!(value["map"]["trial"].as_str(), Some(name.as_str()), "{text}");
            assert!(value.as_mapping().is_some_and(|m| m.contains_key(name.as_str())), "{text}");
            assert_eq!(yaml(&name).lines().count(), 1);
        }
    }

    #[test]
    fn options_and_arguments_never_look_like_flags() {
        for name in hostile() {
            let words = option("trial", &name);
            assert!(words.len() == 1 || !words[1].starts_with('-'), "{words:?}");
            assert!(!argument(Path::new(&name)).starts_with('-'));
            assert!(!visible(&name).contains(char::is_control));
        }
    }
}
