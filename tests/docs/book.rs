//! Checks of the whole book: every page is in the summary, every link has a target, every finding
//! is listed.

use crate::generate::Pages;
use crate::{docs, root};
use std::path::{Path, PathBuf};

fn pages_below(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && path.file_name().is_some_and(|n| n != "book") {
            pages_below(&path, out);
        } else if path.extension().is_some_and(|e| e == "md") {
            out.push(path);
        }
    }
    out.sort();
}

/// Files in `docs/findings` with their titles, sorted by name.
pub fn findings() -> Vec<(String, String)> {
    let mut out: Vec<(String, String)> = std::fs::read_dir(docs().join("findings"))
        .into_iter()
        .flatten()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "md") && p.file_stem().is_some_and(|s| s != "README"))
        .map(|p| {
            let text = std::fs::read_to_string(&p).unwrap();
            let title = text.lines().find_map(|l| l.strip_prefix("# ")).map(str::to_owned);
            let name = p.file_name().unwrap().to_string_lossy().into_owned();
            let title = title.unwrap_or_else(|| p.file_stem().unwrap().to_string_lossy().replace('-', " "));
            (name, title)
        })
        .collect();
    out.sort();
    out
}

/// Links `[…](target)` of a page outside listings, with their lines.
fn links(text: &str) -> Vec<(usize, String)> {
    let mut out = Vec::new();
    let mut listing = false;
    for (i, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            listing = !listing;
        }
        if listing {
            continue;
        }
        // inline code contains no links
        let plain: String = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
        let mut rest = plain.as_str();
        while let Some(at) = rest.find("](") {
            let target = &rest[at + 2..];
            let end = target.find(')').unwrap_or(target.len());
            out.push((i + 1, target[..end].to_owned()));
            rest = &target[end..];
        }
    }
    out
}

/// Anchor of a heading as mdBook and GitHub make it.
fn anchor(heading: &str) -> String {
    heading
        .trim()
        .to_lowercase()
        .chars()
        .filter_map(|c| match c {
            ' ' => Some('-'),
            c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
            _ => None,
        })
        .collect()
}

/// The summary: the template beside this file with the pages that are made from the code, and the
/// findings.
pub fn summary(generated: &Pages) -> String {
    let below = |part: &str| -> String {
        let folder = format!("reference/{part}/");
        let pages = generated.iter().filter(|(name, _)| name.starts_with(&folder) && !name.ends_with("README.md"));
        pages
            .map(|(name, text)| {
                let title = text.lines().find_map(|l| l.strip_prefix("# ")).unwrap_or(name);
                format!("  - [{}]({name})\n", title.strip_prefix("Stage ").unwrap_or(title).replace('`', ""))
            })
            .collect()
    };
    let findings: String = findings().iter().map(|(file, title)| format!("  - [{title}](findings/{file})\n")).collect();
    include_str!("summary.txt")
        .replace("{stages}", &below("stages"))
        .replace("{effects}", &below("effects"))
        .replace("{formats}", &below("formats"))
        .replace("{findings}", &findings)
}

#[test]
fn the_summary_lists_every_page_once() {
    let summary = summary(&crate::generate::pages());
    let linked: Vec<String> = links(&summary).into_iter().map(|(_, t)| t).collect();
    let mut pages = Vec::new();
    pages_below(&docs(), &mut pages);
    for page in pages {
        let name = page.strip_prefix(docs()).unwrap().to_string_lossy().replace('\\', "/");
        let hint = "add it to tests/docs/summary.txt";
        assert!(name == "SUMMARY.md" || linked.contains(&name), "docs/{name} is not in SUMMARY.md; {hint}");
    }
    let mut sorted = linked.clone();
    sorted.sort();
    sorted.dedup();
    assert_eq!(sorted.len(), linked.len(), "a page stands twice in SUMMARY.md");
}

#[test]
fn links_lead_to_pages_and_headings() {
    let mut pages = Vec::new();
    pages_below(&docs(), &mut pages);
    for page in ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "benches/README.md"] {
        pages.push(root().join(page));
    }
    let mut broken = Vec::new();
    let mut count = 0;
    for page in &pages {
        let text = std::fs::read_to_string(page).unwrap();
        for (line, target) in links(&text) {
            if target.starts_with("http") || target.starts_with("mailto:") {
                continue;
            }
            count += 1;
            let (file, fragment) = target.split_once('#').unwrap_or((&target, ""));
            let place = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let at = format!("{}:{line}: {target}", page.strip_prefix(root()).unwrap().display());
            if !place.exists() {
                broken.push(at);
                continue;
            }
            if !fragment.is_empty() {
                let there = std::fs::read_to_string(&place).ok().unwrap_or_default();
                let found =
                    there.lines().filter(|l| l.starts_with('#')).any(|l| anchor(l.trim_start_matches('#')) == fragment);
                if !found {
                    broken.push(at);
                }
            }
        }
    }
    assert!(broken.is_empty(), "links that lead nowhere:\n  {}", broken.join("\n  "));
    assert!(count > 100, "only {count} links were looked at");
}

#[test]
fn the_readme_is_short_and_links_the_book() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let lines = readme.lines().count();
    assert!(lines <= 120, "README.md has {lines} lines; measurements and details belong into docs/");
    for page in ["docs/introduction.md", "docs/tutorial/first-run.md", "docs/recording.md", "docs/findings/accuracy.md"]
    {
        assert!(readme.contains(page), "README.md does not link {page}");
    }
}

#[test]
fn pictures_are_small_and_shown() {
    let mut pages = Vec::new();
    pages_below(&docs(), &mut pages);
    pages.push(root().join("README.md"));
    let text: String = pages.iter().map(|p| std::fs::read_to_string(p).unwrap()).collect();
    let mut n = 0;
    for entry in std::fs::read_dir(docs().join("pictures")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "svg" || e == "png" || e == "webp") {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            assert!(path.metadata().unwrap().len() < 150_000, "docs/pictures/{name} is larger than 150 kB");
            assert!(text.contains(&format!("pictures/{name})")), "no page shows docs/pictures/{name}");
            n += 1;
        }
    }
    assert!(n > 0);
}

#[test]
fn quoted_messages_exist() {
    // the headings of the troubleshooting page quote messages; every fixed part of a quotation must
    // occur in the code
    let text = std::fs::read_to_string(docs().join("troubleshooting.md")).unwrap();
    let mut sources = String::new();
    for file in crate::source::rust_files(&root().join("crates")) {
        sources.push_str(&std::fs::read_to_string(file).unwrap());
    }
    let plain: String = sources.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut n = 0;
    for heading in text.lines().filter_map(|l| l.strip_prefix("## `")) {
        let quoted = heading.trim_end().trim_end_matches('`');
        for part in quoted.split('…').map(str::trim).filter(|p| p.len() > 4) {
            assert!(plain.contains(part), "docs/troubleshooting.md quotes `{part}`, which no source says");
            n += 1;
        }
    }
    assert!(n >= 15, "{n} messages quoted");
}
