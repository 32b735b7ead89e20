//! Reads documentation from the source files: module documentation, structures with their fields,
//! lists of variants, error messages. It handles the plain style of this repository, not the whole
//! language.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Every Rust file below a folder, sorted.
pub fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(f) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&f) else { continue };
        for path in entries.map(|e| e.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                out.push(path);
            }
        }
    }
    out.sort();
    out
}

/// Module documentation (`//!`) of a file as Markdown below a heading of the given level.
pub fn module_doc(path: &Path, level: usize) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let lines: Vec<&str> = text
        .lines()
        .take_while(|l| l.starts_with("//!"))
        .map(|l| l.strip_prefix("//! ").or(l.strip_prefix("//!")).unwrap())
        .collect();
    markdown(&lines, level)
}

/// Documentation lines as Markdown for readers of the book: links into the code become code,
/// doctests become listings.
pub fn markdown(lines: &[&str], level: usize) -> String {
    let mut out = String::new();
    let mut fence: Option<bool> = None; // inside a listing; true where it is Rust
    for line in lines {
        if line.trim_start().starts_with("```") {
            let opening = fence.is_none();
            let rust = opening && matches!(line.trim(), "```" | "```no_run" | "```rust");
            fence = opening.then_some(rust);
            out.push_str(if rust { "```rust,ignore" } else { line });
        } else if fence == Some(true) && (line.trim() == "#" || line.trim_start().starts_with("# ")) {
            continue;
        } else if fence.is_none() && line.starts_with('#') {
            out.push_str(&"#".repeat(level - 1));
            out.push_str(line);
        } else if fence.is_some() {
            out.push_str(line);
        } else {
            out.push_str(&without_code_links(line));
        }
        out.push('\n');
    }
    out.trim_end().to_owned()
}

/// Removes the links from `[`X`]`, `[`X`](y)` and `[name](crate::…)`.
pub fn without_code_links(line: &str) -> String {
    let mut out = String::new();
    let mut rest = line;
    while let Some(start) = rest.find('[') {
        let Some(length) = rest[start..].find(']') else { break };
        let end = start + length;
        let inner = &rest[start + 1..end];
        let after = &rest[end + 1..];
        let target = after
            .strip_prefix('(')
            .and_then(|a| a.find(')').map(|n| &a[..if a[..n].ends_with('(') { n + 1 } else { n }]));
        let web = target.is_some_and(|t| t.starts_with("http"));
        let code = inner.starts_with('`') && inner.ends_with('`') && inner.len() > 2;
        let to_code = target.is_some_and(|t| t.contains("::") || t.starts_with("mod@") || t.ends_with("()"));
        if web || !(code || to_code) {
            out.push_str(&rest[..=end]);
            rest = after;
        } else {
            out.push_str(&rest[..start]);
            out.push_str(inner);
            rest = target.map_or(after, |t| &after[t.len() + 2..]);
        }
    }
    out + rest
}

/// One field of a structure.
#[derive(Debug, Clone)]
pub struct Field {
    /// Name in JSON.
    pub name: String,
    /// Rust type.
    pub kind: String,
    /// Its documentation on one line.
    pub doc: String,
    /// `#[serde(flatten)]`.
    pub flatten: bool,
}

/// Fields in order.
#[derive(Debug, Clone)]
pub enum Item {
    /// Fields in order.
    Struct(Vec<Field>),
    /// Variants in order: name (serde's, if it is renamed) and documentation; and whether serde
    /// writes them in snake case.
    Enum(Vec<(String, String)>, bool),
}

/// Items by crate and name, each with the names that its file imports from other crates.
#[derive(Debug, Default)]
pub struct Items(BTreeMap<(String, String), (Item, Uses)>);

/// Maps a name to the crate that it is imported from.
pub type Uses = BTreeMap<String, String>;

impl Items {
    /// Reads all crates.
    pub fn read(crates: &Path) -> Self {
        let mut all = Self::default();
        for entry in std::fs::read_dir(crates).unwrap() {
            let folder = entry.unwrap().path();
            let name = folder.file_name().unwrap().to_string_lossy().into_owned();
            for file in rust_files(&folder.join("src")) {
                let text = std::fs::read_to_string(&file).unwrap();
                let uses = uses(&text);
                for (item, body) in items(&text) {
                    all.0.entry((name.clone(), item)).or_insert((body, uses.clone()));
                }
            }
        }
        all
    }

    /// The item that a name in a file of a crate refers to: from the crate that the file imports
    /// the name from, else from its own crate, else from the only crate that has it.
    pub fn get(&self, from: &str, uses: &Uses, name: &str) -> Option<(&str, &Item, &Uses)> {
        for krate in [uses.get(name).map(String::as_str), Some(from)].into_iter().flatten() {
            if let Some(((k, _), (item, uses))) = self.0.get_key_value(&(krate.to_owned(), name.to_owned())) {
                return Some((k, item, uses));
            }
        }
        let others: Vec<_> = self.0.iter().filter(|((_, n), _)| n == name).collect();
        match others.as_slice() {
            [((k, _), (item, uses))] => Some((k, item, uses)),
            _ => None,
        }
    }
}

/// Names imported by `use aloft_…::{…};`.
fn uses(text: &str) -> Uses {
    let mut out = Uses::new();
    for statement in text.split(';') {
        let Some(rest) = statement.find("use aloft_").map(|i| &statement[i + 10..]) else { continue };
        let krate: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        for name in rest[krate.len()..].split(|c: char| !(c.is_alphanumeric() || c == '_')) {
            if name.starts_with(char::is_uppercase) {
                out.insert(name.to_owned(), krate.clone());
            }
        }
    }
    out
}

fn items(text: &str) -> Vec<(String, Item)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut out = Vec::new();
    for (i, line) in lines.iter().enumerate() {
        let declared = ["pub struct ", "pub enum "].iter().find_map(|k| line.strip_prefix(k).map(|r| (*k, r)));
        let Some((keyword, rest)) = declared else { continue };
        if !line.ends_with('{') {
            continue;
        }
        let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        let end = lines[i..].iter().position(|l| *l == "}").map_or(lines.len(), |n| i + n);
        let body = &lines[i + 1..end];
        let above = lines[..i].iter().rev().take_while(|l| l.starts_with("#[") || l.starts_with("///"));
        let snake = above.into_iter().any(|l| l.contains("snake_case"));
        out.push((
            name,
            if keyword.contains("struct") { Item::Struct(fields(body)) } else { Item::Enum(variants(body), snake) },
        ));
    }
    out
}

fn fields(body: &[&str]) -> Vec<Field> {
    let mut out = Vec::new();
    let (mut doc, mut flatten, mut skipped, mut renamed) = (Vec::new(), false, false, None);
    for line in body {
        let line = line.trim();
        if let Some(d) = line.strip_prefix("///") {
            doc.push(d.trim());
        } else if line.starts_with("#[") {
            flatten |= line.contains("flatten");
            skipped |= line.contains("serde(skip)");
            renamed = renamed.or(line.split_once("rename = \"").and_then(|(_, r)| r.split('"').next()));
        } else if let Some((name, kind)) = line.strip_prefix("pub ").and_then(|l| l.split_once(": ")) {
            let name = renamed.take().unwrap_or(name).trim_start_matches("r#").to_owned();
            let doc = without_code_links(&std::mem::take(&mut doc).join(" "));
            // what is skipped is in no JSON
            if !std::mem::take(&mut skipped) {
                out.push(Field { name, kind: kind.trim_end_matches(',').to_owned(), doc, flatten });
            }
            flatten = false;
        }
    }
    out
}

fn variants(body: &[&str]) -> Vec<(String, String)> {
    let mut out = Vec::new();
    let (mut doc, mut renamed) = (Vec::new(), None);
    for line in body {
        let inner = line.strip_prefix("    ").unwrap_or(line);
        if let Some(d) = inner.strip_prefix("///") {
            doc.push(d.trim());
        } else if let Some(rest) = inner.strip_prefix("#[serde(rename = \"") {
            renamed = rest.split('"').next().map(str::to_owned);
        } else if inner.starts_with(char::is_uppercase) {
            let own = || inner.chars().take_while(|c| c.is_alphanumeric()).collect();
            let name = renamed.take().unwrap_or_else(own);
            out.push((name, without_code_links(&std::mem::take(&mut doc).join(" "))));
        }
    }
    out
}

/// Converts `CamelCase` to snake case as serde does.
pub fn snake(name: &str) -> String {
    let mut out = String::new();
    for (i, c) in name.char_indices() {
        if c.is_uppercase() && i > 0 {
            out.push('_');
        }
        out.extend(c.to_lowercase());
    }
    out
}

/// One message of an error type: its meaning, the text with placeholders, the hint.
#[derive(Debug)]
pub struct Message {
    /// Documentation.
    pub doc: String,
    /// Text.
    pub text: String,
    /// Hint.
    pub help: Option<String>,
}

/// Messages of the `thiserror` enums of a file: `(enum, messages)`.
pub fn messages(text: &str) -> Vec<(String, Vec<Message>)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut out: Vec<(String, Vec<Message>)> = Vec::new();
    let (mut doc, mut attributes): (Vec<&str>, String) = (Vec::new(), String::new());
    let mut i = 0;
    while i < lines.len() {
        let line = lines[i];
        if let Some(rest) = line.strip_prefix("pub enum ") {
            out.push((rest.trim_end_matches(" {").to_owned(), Vec::new()));
            (doc, attributes) = (Vec::new(), String::new());
        } else if let Some(d) = line.strip_prefix("    ///") {
            doc.push(d.trim());
        } else if line.starts_with("    #[") {
            // an attribute may span several lines
            loop {
                attributes.push_str(lines[i].trim());
                attributes.push('\n');
                if lines[i].trim_end().ends_with(")]") || i + 1 == lines.len() {
                    break;
                }
                i += 1;
            }
        } else if line.starts_with("    ") && line[4..].starts_with(char::is_uppercase) {
            if let (Some(text), Some(last)) = (quoted_after(&attributes, "error("), out.last_mut()) {
                let help = quoted_after(&attributes, "help(");
                last.1.push(Message { doc: without_code_links(&doc.join(" ")), text, help });
            }
            (doc, attributes) = (Vec::new(), String::new());
        }
        i += 1;
    }
    out.retain(|(_, m)| !m.is_empty());
    out
}

/// The string literal that follows a word.
fn quoted_after(text: &str, word: &str) -> Option<String> {
    let rest = text[text.find(word)? + word.len()..].trim_start().strip_prefix('"')?;
    let mut out = String::new();
    let mut chars = rest.chars();
    while let Some(c) = chars.next() {
        match c {
            '"' => return Some(out),
            '\\' => match chars.next()? {
                'n' => out.push(' '),
                '\n' => {}
                other => out.push(other),
            },
            '\n' => {}
            other => out.push(other),
        }
    }
    None
}

#[test]
fn links_into_the_code_become_code() {
    assert_eq!(without_code_links("see [`Trial`] and [`x`](crate::x)."), "see `Trial` and `x`.");
    assert_eq!(without_code_links("[a page](https://x.org) [0, 1]"), "[a page](https://x.org) [0, 1]");
    assert_eq!(without_code_links("[`simex()`](simex()) q[3]"), "`simex()` q[3]");
}

#[test]
fn messages_and_fields_are_read() {
    let text = "/// E.\npub enum E {\n    /// Why\n    /// it is.\n    #[error(\"{file}: cannot \\\"read\\\"\")]\n    #[diagnostic(help(\"do this\"))]\n    One {\n        /// F.\n        file: String,\n    },\n}\n";
    let found = messages(text);
    assert_eq!(found[0].1[0].text, "{file}: cannot \"read\"");
    assert_eq!(found[0].1[0].doc, "Why it is.");
    assert_eq!(found[0].1[0].help.as_deref(), Some("do this"));
    let skipped = "    /// No JSON.\n    #[serde(skip)]\n    pub z: u8,\n";
    let found =
        items(&format!("pub struct A {{\n{skipped}    /// One.\n    #[serde(flatten)]\n    pub a: Option<B>,\n}}\n"));
    let Item::Struct(fields) = &found[0].1 else { panic!() };
    assert!(fields[0].flatten && fields[0].doc == "One." && fields[0].kind == "Option<B>");
}
