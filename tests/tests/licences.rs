//! Licences and origins of dependencies: those that `deny.toml` allows, from crates.io alone; and
//! `THIRD-PARTY-NOTICES`, which `aloft licenses` prints, holds the notices of everything linked
//! into the program. `ALOFT_UPDATE_DOCS=1 cargo test --release -p aloft-tests --test licences`
//! writes it again.
//!
//! The packages are taken as cargo unpacked them; nothing is fetched where they are all there.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests fail by panicking")]

use cargo_metadata::{CrateType, DependencyKind, Metadata, MetadataCommand, Package, TargetKind};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every package of the lock file, for all platforms; none where cargo cannot get at them.
fn metadata() -> Option<Metadata> {
    let with = |options: &[&str]| {
        let options = options.iter().map(|o| (*o).to_owned()).collect::<Vec<_>>();
        MetadataCommand::new().manifest_path(root().join("Cargo.toml")).other_options(options).exec().ok()
    };
    let found = with(&["--locked", "--offline"]).or_else(|| with(&["--locked"]));
    if found.is_none() {
        println!(
            "skipped: `cargo metadata` needs packages of other platforms, which are not here and cannot be fetched"
        );
    }
    found
}

/// Licences that `deny.toml` allows.
fn allowed() -> BTreeSet<String> {
    let text = fs::read_to_string(root().join("deny.toml")).unwrap();
    let list = text.split("[licenses]").nth(1).unwrap().split("allow = [").nth(1).unwrap();
    let list = list.split("\n]").next().unwrap();
    list.lines().filter_map(|l| l.trim().strip_prefix('"')?.split('"').next().map(str::to_owned)).collect()
}

/// Whether an SPDX expression can be met with the allowed licences. `/` is an old form of `OR`.
fn can_be_met(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let text = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = text.split_whitespace().collect();
    let mut at = 0;
    either(&words, &mut at, allowed) && at == words.len()
}

fn either(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let mut met = both(words, at, allowed);
    while words.get(*at) == Some(&"OR") {
        *at += 1;
        met |= both(words, at, allowed);
    }
    met
}

fn both(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let mut met = one(words, at, allowed);
    while words.get(*at) == Some(&"AND") {
        *at += 1;
        met &= one(words, at, allowed);
    }
    met
}

fn one(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let Some(word) = words.get(*at) else { return false };
    *at += 1;
    if *word == "(" {
        let met = either(words, at, allowed);
        *at += 1;
        return met;
    }
    let mut name = (*word).to_owned();
    if words.get(*at) == Some(&"WITH") {
        let _ = write!(name, " WITH {}", words.get(*at + 1).unwrap_or(&""));
        *at += 2;
    }
    allowed.contains(&name)
}

#[test]
fn expressions_of_licences_are_understood() {
    let allowed: BTreeSet<String> = ["MIT", "Apache-2.0 WITH LLVM-exception", "Zlib"].map(str::to_owned).into();
    for (expression, met) in [
        ("MIT", true),
        ("GPL-3.0", false),
        ("MIT OR GPL-3.0", true),
        ("MIT/GPL-3.0", true),
        ("MIT AND GPL-3.0", false),
        ("(MIT OR GPL-3.0) AND Zlib", true),
        ("(GPL-2.0 AND MIT) OR BSD", false),
        ("Apache-2.0 WITH LLVM-exception", true),
        ("Apache-2.0", false),
        ("", false),
        ("MIT MIT", false),
    ] {
        assert_eq!(can_be_met(expression, &allowed), met, "{expression}");
    }
}

#[test]
fn licences_are_allowed_and_packages_come_from_crates_io() {
    let allowed = allowed();
    assert!(allowed.contains("MIT") && allowed.len() > 3, "{allowed:?}");
    let Some(metadata) = metadata() else { return };
    for package in &metadata.packages {
        let licence = package.license.as_deref().unwrap_or_default();
        assert!(can_be_met(licence, &allowed), "{} {}: licence `{licence}`", package.name, package.version);
        match &package.source {
            Some(source) => assert_eq!(
                source.repr, "registry+https://github.com/rust-lang/crates.io-index",
                "{} {}",
                package.name, package.version
            ),
            None => assert!(package.manifest_path.starts_with(&metadata.workspace_root), "{}", package.name),
        }
    }
}

/// Packages of others that are linked into the program or the Python package, on any platform:
/// not those that only run while it is built.
fn linked(metadata: &Metadata) -> Vec<&Package> {
    let resolve = metadata.resolve.as_ref().unwrap();
    let nodes: BTreeMap<_, _> = resolve.nodes.iter().map(|n| (&n.id, n)).collect();
    let packages: BTreeMap<_, _> = metadata.packages.iter().map(|p| (&p.id, p)).collect();
    let is_macro = |p: &Package| {
        p.targets
            .iter()
            .any(|t| t.kind.contains(&TargetKind::ProcMacro) || t.crate_types.contains(&CrateType::ProcMacro))
    };
    let mut open: Vec<_> = metadata
        .packages
        .iter()
        .filter(|p| ["aloft-cli", "aloft-py"].contains(&p.name.as_str()))
        .map(|p| &p.id)
        .collect();
    let mut seen = BTreeSet::new();
    while let Some(id) = open.pop() {
        if !seen.insert(id) {
            continue;
        }
        let normal = |d: &&cargo_metadata::NodeDep| d.dep_kinds.iter().any(|k| k.kind == DependencyKind::Normal);
        open.extend(nodes[id].deps.iter().filter(normal).map(|d| &d.pkg).filter(|id| !is_macro(packages[id])));
    }
    let mut out: Vec<&Package> = seen.into_iter().map(|id| packages[id]).filter(|p| p.source.is_some()).collect();
    out.sort_by(|a, b| (&a.name, &a.version).cmp(&(&b.name, &b.version)));
    out
}

/// Texts of a package's licence: of those to choose from the MIT licence, else all; and notices.
fn texts(package: &Package) -> Vec<String> {
    let folder = package.manifest_path.parent().unwrap();
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let begins = |name: &String, words: &[&str]| words.iter().any(|w| name.to_uppercase().starts_with(w));
    let free_to_choose = !package.license.as_deref().unwrap_or_default().contains("AND");
    let mit: Vec<&String> = names.iter().filter(|n| begins(n, &["LICENSE-MIT", "LICENSE_MIT"])).collect();
    let chosen: Vec<&String> = match (free_to_choose, mit.as_slice()) {
        (true, [mit, ..]) => names.iter().filter(|n| n == mit || begins(n, &["NOTICE"])).collect(),
        _ => names.iter().filter(|n| begins(n, &["LICENSE", "LICENCE", "COPYING", "NOTICE"])).collect(),
    };
    let read = |name: &&String| {
        let bytes = fs::read(folder.join(name)).ok().unwrap_or_default();
        let text = String::from_utf8_lossy(&bytes).replace('\r', "");
        text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n").trim().to_owned()
    };
    chosen.iter().map(read).filter(|t| !t.is_empty()).collect()
}

fn notices(metadata: &Metadata) -> String {
    let packages = linked(metadata);
    let mut out = format!(
        "Third-party notices of Aloft\n\n\
         The program and the Python package contain {} libraries of others, on some platforms fewer. Each\n\
         stands here with its licence, as its package states it; the texts of the licences follow.\n\n",
        packages.len()
    );
    let mut by_text: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut without: Vec<String> = Vec::new();
    for p in &packages {
        let name = format!("{} {}", p.name, p.version);
        let licence = p.license.as_deref().unwrap_or("no statement");
        let _ = writeln!(out, "{name}: {licence}");
        let texts = texts(p);
        if texts.is_empty() {
            let by = if p.authors.is_empty() { "its authors".to_owned() } else { p.authors.join(", ") };
            without.push(format!("{name}: {licence}, by {by}"));
        }
        texts.into_iter().for_each(|t| by_text.entry(t).or_default().push(name.clone()));
    }
    if !without.is_empty() {
        let _ = write!(out, "\nThe packages of these hold no text of their licence:\n\n{}\n", without.join("\n"));
    }
    let mut texts: Vec<(Vec<String>, String)> = by_text.into_iter().map(|(text, names)| (names, text)).collect();
    texts.sort();
    for (names, text) in texts {
        let _ = write!(out, "\n{}\n{}\n\n{text}\n", "-".repeat(100), names.join(", "));
    }
    out
}

#[test]
fn the_notices_are_those_of_what_is_linked() {
    let Some(metadata) = metadata() else { return };
    let (path, made) = (root().join("THIRD-PARTY-NOTICES"), notices(&metadata));
    if std::env::var_os("ALOFT_UPDATE_DOCS").is_some() {
        fs::write(&path, &made).unwrap();
    }
    let stored = fs::read_to_string(&path).ok().unwrap_or_default();
    let differs = stored.lines().zip(made.lines()).find(|(a, b)| a != b);
    assert!(
        stored == made,
        "THIRD-PARTY-NOTICES is not that of Cargo.lock ({differs:?}): ALOFT_UPDATE_DOCS=1 cargo test --release -p aloft-tests --test licences"
    );
}
