//! Checks that dependencies point in one direction, as ARCHITECTURE.md states, and that every crate
//! has its caption there.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Crates from bottom to top: each may use only those listed before it.
const ORDER: [&str; 25] = [
    "c3d",
    "body",
    "signal",
    "trial",
    "scale",
    "filter",
    "ik",
    "flight",
    "effects",
    "regressor",
    "identify",
    "robot",
    "compare",
    "discover",
    "simulate",
    "export",
    "page",
    "workspace",
    "study",
    "pipeline",
    "analysis",
    "report",
    "studio",
    "cli",
    "py",
];

fn workspace() -> cargo_metadata::Metadata {
    cargo_metadata::MetadataCommand::new()
        .manifest_path(Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml"))
        .no_deps()
        .exec()
        .unwrap()
}

fn dependencies() -> BTreeMap<String, Vec<(String, bool)>> {
    workspace()
        .packages
        .iter()
        .map(|p| {
            let uses = p
                .dependencies
                .iter()
                .map(|d| (d.name.clone(), d.kind == cargo_metadata::DependencyKind::Development))
                .collect();
            (p.name.to_string(), uses)
        })
        .collect()
}

#[test]
fn dependencies_point_one_way() {
    let all = dependencies();
    for (name, uses) in &all {
        let Some(own) = name.strip_prefix("aloft-") else { continue };
        let Some(place) = ORDER.iter().position(|o| *o == own) else { continue };
        for (used, for_tests) in uses {
            let Some(other) = used.strip_prefix("aloft-") else { continue };
            let at = ORDER.iter().position(|o| *o == other).unwrap_or_else(|| panic!("{used} is not in the order"));
            assert!(*for_tests || at < place, "{own} must not use {other}");
        }
    }
    for crate_name in ORDER {
        assert!(all.contains_key(&format!("aloft-{crate_name}")), "no crate {crate_name}");
    }
}

#[test]
fn bottom_crates_know_nothing_of_the_others() {
    let all = dependencies();
    for bottom in ["c3d", "body", "signal"] {
        let own: Vec<_> =
            all[&format!("aloft-{bottom}")].iter().filter(|(d, t)| !t && d.starts_with("aloft-")).collect();
        assert!(own.is_empty(), "{bottom} uses {own:?}");
    }
}

#[test]
fn science_reads_no_yaml_and_knows_no_terminal() {
    let all = dependencies();
    for (name, uses) in &all {
        let own = name.trim_start_matches("aloft-");
        for (used, for_tests) in uses {
            if *for_tests {
                continue;
            }
            // `workspace` writes parameters with YAML's data model, which has the numbers that JSON
            // lacks
            let yaml = ["serde_norway", "serde_yaml"].contains(&used.as_str());
            assert!(!yaml || ["workspace", "study", "tests"].contains(&own), "{own} must not use {used}");
            let tables = used.starts_with("polars");
            assert!(!tables || ["export", "workspace", "analysis", "py"].contains(&own), "{own} must not use {used}");
            let terminal = ["clap", "indicatif", "comfy-table"].contains(&used.as_str());
            assert!(!terminal || own == "cli", "{own} must not use {used}");
        }
    }
}

#[test]
fn every_crate_has_its_caption() {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../ARCHITECTURE.md")).unwrap();
    for crate_name in ORDER {
        assert!(text.contains(&format!("| `{crate_name}` |")), "ARCHITECTURE.md has no caption for {crate_name}");
    }
}

/// Rust sources of a folder, with their names.
fn sources(folder: &Path) -> Vec<(String, String)> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            out.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push((path.display().to_string(), std::fs::read_to_string(&path).unwrap()));
        }
    }
    out
}

/// Discovery asks effects for their properties (`About`, `ParameterKind`): its code contains no
/// effect's name and guesses nothing from the names of effects or of their unknowns.
#[test]
fn discovery_knows_no_effect_by_its_name() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let catalogue = sources(&crates.join("effects/src/catalog"));
    let ids: Vec<&str> = catalogue
        .iter()
        .map(|(file, _)| Path::new(file).file_stem().unwrap().to_str().unwrap())
        .filter(|stem| *stem != "mod")
        .collect();
    assert!(ids.len() >= 27 && ids.contains(&"soft_tissue"), "{ids:?}");
    let discover = sources(&crates.join("discover/src"));
    assert!(discover.len() > 15);
    for (file, text) in &discover {
        for (i, code) in text.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with("//")) {
            let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
            let found = code.split(|c| !word(c)).find(|w| ids.contains(w));
            assert!(found.is_none(), "{file}:{} names the effect `{}`", i + 1, found.unwrap_or_default());
        }
        for guess in ["strip_suffix", "strip_prefix", "ends_with", "starts_with", ".contains(\"", ".find(\"", "split("]
        {
            let at = text.lines().position(|l| l.contains(guess));
            assert!(at.is_none(), "{file}:{} takes a name apart (`{guess}`)", at.unwrap_or(0) + 1);
        }
    }
}

/// Paths that begin with `crate::`, `super::` or `self::`; those in braces one by one.
fn paths_in(code: &str) -> Vec<String> {
    let part_of_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut out = Vec::new();
    for start in ["crate::", "super::", "self::"] {
        for (at, _) in code.match_indices(start) {
            if code[..at].ends_with(|c: char| part_of_word(c) || c == ':') {
                continue;
            }
            let rest = &code[at..];
            let end = rest.find(|c: char| !part_of_word(c) && c != ':').unwrap_or(rest.len());
            let path = rest[..end].trim_end_matches(':');
            if rest[end..].starts_with('{') && rest[..end].ends_with("::") {
                let list = &rest[end..rest.find(';').unwrap_or(rest.len())];
                let names = list.split(|c: char| !part_of_word(c) && c != ':').filter(|w| !w.is_empty());
                out.extend(names.map(|w| format!("{path}::{}", w.trim_end_matches(':'))));
            } else {
                out.push(path.to_owned());
            }
        }
    }
    out
}

/// Modules of a crate with the modules that each names by `crate::`, `super::` or `self::`.
fn module_uses(src: &Path) -> BTreeMap<Vec<String>, BTreeSet<Vec<String>>> {
    let modules: BTreeMap<Vec<String>, String> = sources(src)
        .into_iter()
        .map(|(file, text)| {
            let relative = Path::new(&file).strip_prefix(src).unwrap().with_extension("");
            let mut path: Vec<String> = relative.iter().map(|p| p.to_str().unwrap().to_owned()).collect();
            if path.last().is_some_and(|l| l == "mod") || path.len() == 1 && ["lib", "main"].contains(&path[0].as_str())
            {
                path.pop();
            }
            // comments and tests inside the file do not count
            let code = text.split("#[cfg(test)]\nmod").next().unwrap();
            (path, code.lines().map(|l| l.split("//").next().unwrap()).collect::<Vec<_>>().join("\n"))
        })
        .collect();
    let mut uses = BTreeMap::new();
    for (own, code) in &modules {
        let named = paths_in(code);
        let mut to = BTreeSet::new();
        for name in named {
            let parts: Vec<&str> = name.split("::").collect();
            let mut full: Vec<String> = if parts[0] == "crate" { Vec::new() } else { own.clone() };
            for part in parts.iter().skip(usize::from(parts[0] == "crate")) {
                match *part {
                    "super" => drop(full.pop()),
                    "self" => {}
                    part => full.push(part.to_owned()),
                }
            }
            // the longest beginning that is a module
            while !full.is_empty() && !modules.contains_key(&full) {
                full.pop();
            }
            if !full.is_empty() && full != *own {
                to.insert(full);
            }
        }
        uses.insert(own.clone(), to);
    }
    uses
}

/// Files that name each other in a circle are read together; more than three are too many.
#[test]
fn no_import_circle_has_more_than_three_files() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut checked = 0;
    for name in ORDER {
        let uses = module_uses(&crates.join(name).join("src"));
        let reached = |from: &Vec<String>| {
            let mut seen: BTreeSet<Vec<String>> = BTreeSet::new();
            let mut open = vec![from.clone()];
            while let Some(next) = open.pop() {
                for to in uses.get(&next).into_iter().flatten() {
                    if seen.insert(to.clone()) {
                        open.push(to.clone());
                    }
                }
            }
            seen
        };
        let reach: BTreeMap<_, _> = uses.keys().map(|m| (m.clone(), reached(m))).collect();
        for module in uses.keys() {
            let circle: Vec<String> = uses
                .keys()
                .filter(|m| reach[module].contains(*m) && reach[*m].contains(module))
                .map(|m| m.join("::"))
                .collect();
            assert!(circle.len() <= 3, "{name}: {circle:?} name each other in a circle");
        }
        checked += uses.values().map(BTreeSet::len).sum::<usize>();
    }
    // the search for names works
    assert!(checked > 500, "{checked} uses");
}

/// Comments have at most 100 columns; tables, code and single long words may have more.
#[test]
fn comments_have_at_most_100_columns() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut comments = 0;
    for folder in ["crates", "tests"] {
        for (file, text) in sources(&root.join(folder)) {
            let mut code = false;
            for (i, line) in text.lines().enumerate() {
                let Some(comment) = line.trim_start().strip_prefix("//") else { continue };
                let comment = comment.trim_start_matches(['/', '!']).trim();
                comments += 1;
                code ^= comment.starts_with("```");
                let long = line.chars().count() > 100 && comment.contains(' ');
                let free = code || comment.starts_with('|') || comment.starts_with('[');
                assert!(!long || free, "{file}:{}: a comment of {} columns", i + 1, line.chars().count());
            }
        }
    }
    assert!(comments > 10_000, "{comments} comments");
}

/// Changes on disk go through `aloft_workspace::disk`, so that tests can make each of them fail.
#[test]
fn only_the_workspace_crate_changes_files() {
    const CHANGES: [&str; 14] = [
        "fs::write(",
        "fs::rename(",
        "fs::create_dir",
        "fs::remove_",
        "fs::copy(",
        "fs::hard_link(",
        "fs::set_permissions(",
        "File::create",
        "File::options",
        "OpenOptions",
        "DirBuilder",
        "tempdir_in(",
        "from_path(",
        "tempfile::Builder",
    ];
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut read = 0;
    for name in ORDER.iter().filter(|n| **n != "workspace") {
        for (file, text) in sources(&root.join(name).join("src")) {
            // tests in a file stand at its end
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            read += 1;
            for (i, line) in code.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with("//")) {
                let found = CHANGES.iter().find(|c| line.contains(**c));
                assert!(found.is_none(), "{file}:{}: `{}` outside the crate workspace", i + 1, found.unwrap_or(&""));
            }
        }
    }
    assert!(read > 300, "{read} files");
}

/// Crates whose functions end in numbers: there even text that is no number is settled.
const SCIENCE: [&str; 10] =
    ["trial", "scale", "filter", "ik", "flight", "effects", "regressor", "identify", "compare", "robot"];

/// Ways to go on after an error without it. `unwrap_or_default` and `map_or` of a `Result` are
/// refused by Clippy (`clippy.toml`), because they look like those of an `Option`.
const DROPS: [&str; 8] = [
    ".ok()",
    "Result::ok",
    "let Ok(",
    "Err(_)",
    ".is_ok_and(",
    ".unwrap_or_else(|_|",
    ".map_or_else(|_|",
    ".or_else(|_|",
];

/// Forms that ask whether a text or a number has a form; a lock has no error but that of another
/// thread's panic.
const QUESTIONS: [&str; 9] = [
    "parse",
    "try_from(",
    "try_into()",
    "strip_prefix(",
    "env::var(",
    ".lock()",
    "from_utf8",
    "canonicalize()",
    "binary_search",
];

/// Lines above an error that is dropped within which its reason stands.
const NEAR: usize = 4;

/// The lines of a source at which an error is dropped without a reason.
fn dropped_errors(text: &str, science: bool) -> Vec<usize> {
    // tests in a file stand at its end
    let code = text.split("#[cfg(test)]\nmod").next().unwrap_or_default();
    let lines: Vec<&str> = code.lines().collect();
    let reasoned = |i: usize| lines[i.saturating_sub(NEAR)..=i].iter().any(|l| l.contains("// none: "));
    let asks = |i: usize| {
        let continues = lines[i].trim_start().starts_with('.');
        let first = if continues { i.saturating_sub(1) } else { i };
        lines[first..=i].iter().any(|l| QUESTIONS.iter().any(|q| l.contains(q)))
    };
    let drops = |i: &usize| {
        let code = lines[*i].trim_start();
        !code.starts_with("//") && DROPS.iter().any(|d| code.contains(d))
    };
    (0..lines.len()).filter(drops).filter(|i| !reasoned(*i) && (science || !asks(*i))).map(|i| i + 1).collect()
}

/// No error is lost on the way to a number: each place that goes on without one says why nothing is
/// lost (`// none: …`). Anything else fails the answer, or is named in it.
#[test]
fn every_dropped_error_has_its_reason() {
    let with = |line: &str| format!("fn f() {{\n{line}\n}}\n");
    for lost in ["let x = read(path).ok()?;", "if let Ok(x) = read(path) {}", "match x { Err(_) => 0.0 }"] {
        assert_eq!(dropped_errors(&with(lost), false), [2], "{lost}");
        assert!(dropped_errors(&with(&format!("// none: read again\n{lost}")), false).is_empty());
    }
    let asked = with("let x: Option<f64> = word.parse().ok();");
    assert!(dropped_errors(&asked, false).is_empty());
    assert_eq!(dropped_errors(&asked, true), [2]);

    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut read = 0;
    let mut lost = Vec::new();
    for name in ORDER {
        for (file, text) in sources(&crates.join(name).join("src")) {
            let relative = Path::new(&file).strip_prefix(&crates).unwrap();
            if relative.iter().any(|part| part == "tests" || part.to_string_lossy().ends_with("tests.rs")) {
                continue;
            }
            read += 1;
            let at = dropped_errors(&text, SCIENCE.contains(&name)).into_iter();
            lost.extend(at.map(|line| format!("{}:{line}", relative.display())));
        }
    }
    assert!(read > 500, "{read} files");
    assert!(lost.is_empty(), "errors are dropped without a reason (`// none: …` above the line): {lost:#?}");
}
