//! The page on the contents of `--json` output: generated from the structures that are written, and
//! checked against the actual output of the commands.

use crate::source::{Item, Items, Uses, snake};
use crate::{aloft, root};
use std::collections::BTreeSet;
use std::fmt::Write;

/// Commands with `--json`, and the crate and structure that they write.
const COMMANDS: &[(&str, &str, &str)] = &[
    ("parameters", "pipeline", "ParametersView"),
    ("compare", "pipeline", "ComparisonView"),
    ("compare --estimators", "pipeline", "EstimatorsView"),
    ("compare --leave-one-out", "pipeline", "LeaveOneOutView"),
    ("discover", "pipeline", "DiscoveryView"),
    ("history", "pipeline", "History"),
    ("check", "pipeline", "Check"),
    ("status", "pipeline", "Status"),
    ("inspect", "pipeline", "Inspection"),
    ("summary", "pipeline", "Summary"),
    ("verify", "pipeline", "Verified"),
];

/// Commands that show results, and report under `stale` which of these are not up to date.
const WITH_STALE: [&str; 6] =
    ["parameters", "compare", "compare --estimators", "compare --leave-one-out", "discover", "history"];

/// Generates the page.
pub fn page() -> String {
    let items = Items::read(&root().join("crates"));
    let mut out = "<!-- Made from the structures that the commands write; tests/docs writes it again. -->\n\n# JSON of the commands\n\n".to_owned();
    out += "Commands with `--json` write one object to stdout. `version` (in `discover`: `schema`) is raised when a key changes its meaning or goes away; new keys may come at any time. \
        Numbers are SI; a value that is not known is `null`, never zero. `[]` stands for each element of a list, `{}` for each value of a map.\n";
    for (command, krate, name) in COMMANDS {
        let _ = write!(out, "\n## `aloft {command} --json`\n\n| key | type | meaning |\n|---|---|---|\n");
        let mut rows = Vec::new();
        walk(&items, (krate, &Uses::new()), name, "", &mut Vec::new(), &mut rows);
        if WITH_STALE.contains(command) {
            let doc = "Results that are not what the pipeline and the recordings would give now; empty where all are up to date.";
            rows.push(("stale[]".into(), "object".into(), doc.into()));
            walk(&items, ("pipeline", &Uses::new()), "NotCurrent", "stale[].", &mut Vec::new(), &mut rows);
        }
        assert!(!rows.is_empty(), "{krate} has no structure `{name}`: correct COMMANDS in tests/docs/json_contract.rs");
        for (key, kind, doc) in rows {
            let _ = writeln!(out, "| `{key}` | {kind} | {} |", crate::generate::cell(&doc));
        }
    }
    out
}

type Row = (String, String, String);

fn walk(items: &Items, at: (&str, &Uses), name: &str, prefix: &str, above: &mut Vec<String>, out: &mut Vec<Row>) {
    let Some((home, Item::Struct(fields), uses)) = items.get(at.0, at.1, name) else { return };
    let here = (home, uses);
    if above.iter().any(|a| a == name) {
        return;
    }
    above.push(name.to_owned());
    for field in fields {
        let (shape, inner) = peel(&field.kind);
        if field.flatten {
            walk(items, here, &inner, prefix, above, out);
            continue;
        }
        let key = format!("{prefix}{}", field.name);
        match items.get(home, uses, &inner) {
            Some((_, Item::Enum(variants, snake_case), _)) => {
                let plain = variants.len() <= 8;
                let words = variants.iter().map(|(v, _)| if *snake_case { snake(v) } else { v.clone() });
                let words =
                    if plain { words.map(|w| format!("`{w}`")).collect::<Vec<_>>().join(", ") } else { "word".into() };
                out.push((format!("{key}{shape}"), words, field.doc.clone()));
            }
            Some((_, Item::Struct(inner_fields), _)) if !inner_fields.is_empty() => {
                out.push((format!("{key}{shape}"), "object".into(), field.doc.clone()));
                walk(items, here, &inner, &format!("{key}{shape}."), above, out);
            }
            _ => out.push((format!("{key}{shape}"), word(&inner), field.doc.clone())),
        }
    }
    above.pop();
}

/// `Vec<Option<X>>` to (`[]`, `X`).
fn peel(kind: &str) -> (String, String) {
    let kind = kind.trim();
    for (open, shape) in [("Option<", ""), ("Box<", ""), ("Vec<", "[]"), ("BTreeSet<", "[]")] {
        if let Some(inner) = kind.strip_prefix(open).and_then(|k| k.strip_suffix('>')) {
            let (rest, name) = peel(inner);
            return (format!("{shape}{rest}"), name);
        }
    }
    if let Some((_, value)) =
        kind.strip_prefix("BTreeMap<").and_then(|k| k.strip_suffix('>')).and_then(|k| k.split_once(", "))
    {
        let (rest, name) = peel(value);
        return (format!("{{}}{rest}"), name);
    }
    if let Some(inner) = kind.strip_prefix('[').and_then(|k| k.strip_suffix(']')) {
        let (element, _) = inner.rsplit_once("; ").unwrap_or((inner, ""));
        let (rest, name) = peel(element);
        return (format!("[]{rest}"), name);
    }
    let name = kind.rsplit("::").next().unwrap_or(kind);
    (String::new(), name.split('<').next().unwrap_or(name).to_owned())
}

fn word(kind: &str) -> String {
    match kind {
        "f64" | "f32" => "number",
        "usize" | "u32" | "u64" | "i32" | "i64" | "u16" | "u8" => "whole number",
        "bool" => "true or false",
        "String" | "str" | "PathBuf" | "&'static str" => "text",
        "Vector3" => "three numbers",
        "Vector6" => "six numbers",
        "DMatrix" | "DVector" | "Matrix3" | "Rotation3" => "numbers",
        _ => "value",
    }
    .to_owned()
}

#[test]
fn the_page_names_what_the_commands_write() {
    let folder = tempfile::tempdir().unwrap();
    let ws = folder.path().join("ws").display().to_string();
    let demo = root().join("pipelines/demo.yaml").display().to_string();
    let recording = root().join("fixtures/demo/static.c3d").display().to_string();
    aloft(&["run", &demo, "--workspace", &ws]);
    let page = page();
    for (command, _, _) in COMMANDS {
        let words: Vec<&str> = match *command {
            "inspect" => vec!["inspect", &recording, "--json"],
            _ => command.split(' ').chain([demo.as_str(), "--workspace", &ws, "--json"]).collect(),
        };
        let value: serde_json::Value = serde_json::from_str(&aloft(&words)).unwrap();
        let section = page.split(&format!("## `aloft {command} --json`")).nth(1).unwrap();
        let section = section.split("\n## ").next().unwrap();
        let known: BTreeSet<&str> = section
            .lines()
            .filter_map(|l| l.strip_prefix("| `")?.split('`').next())
            .map(|k| k.split(['.', '[', '{']).next().unwrap())
            .collect();
        for key in value.as_object().unwrap().keys() {
            assert!(known.contains(key.as_str()), "aloft {command} --json writes `{key}`, which the page lacks");
        }
        assert!(known.contains("version") || known.contains("schema"), "aloft {command} --json has no version");
    }
}
