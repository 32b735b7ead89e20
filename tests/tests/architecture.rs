//! Checks that dependencies point in one direction, as ARCHITECTURE.md states, and that every crate
//! has its caption there.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use std::collections::BTreeMap;
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
