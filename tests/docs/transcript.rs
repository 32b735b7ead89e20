//! Transcripts in the pages: each `console` listing is run, in order, in a folder that holds the
//! repository's pipelines and fixtures. The output of the binary must match the page, except for
//! numbers, whose last digits differ between machines.
//!
//! The first word after `console` limits a listing: `console,head=12` shows the first twelve lines
//! and an ellipsis. Besides `aloft`, a listing may only use standard Unix programs: `ls`, `cat`,
//! `head`, `sed`, `cp`.

use crate::{AGAIN, docs, root, updating};
use std::path::Path;
use std::process::Command;

struct Listing {
    /// Lines from the first after the fence to the closing fence (left out).
    begin: usize,
    end: usize,
    head: usize,
}

fn listings(lines: &[&str]) -> Vec<Listing> {
    let mut out = Vec::new();
    let mut i = 0;
    while i < lines.len() {
        if let Some(info) = lines[i].strip_prefix("```console") {
            let head = info.split("head=").nth(1).and_then(|n| n.trim().parse().ok()).unwrap_or(usize::MAX);
            let end = (i + 1..lines.len()).find(|&j| lines[j].starts_with("```")).expect("the listing is closed");
            out.push(Listing { begin: i + 1, end, head });
            i = end;
        }
        i += 1;
    }
    out
}

fn run(command: &str, place: &Path) -> String {
    let bin = Path::new(env!("CARGO_BIN_EXE_aloft")).parent().unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").ok().unwrap_or_default());
    let output = Command::new("sh")
        .args(["-c", &format!("{{ {command}\n}} 2>&1")])
        .current_dir(place)
        .env("PATH", path)
        .env("NO_COLOR", "1")
        .env("COLUMNS", "100")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let text = text.replace(&place.display().to_string(), "~/study");
    text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n")
}

/// The part of a text that must match: its words, in order. Numbers, their signs, spaces and table
/// frames may differ.
fn words(text: &str) -> Vec<String> {
    text.split(|c: char| c.is_whitespace() || "┌┐└┘├┤┬┴┼─│═╞╡╪┆╌|+".contains(c))
        .map(|w| w.trim_matches(|c: char| c.is_ascii_digit() || ".,-–−%±eE…".contains(c)))
        .filter(|w| w.chars().any(char::is_alphabetic) && !w.chars().any(|c| c.is_ascii_digit()))
        .map(str::to_owned)
        .collect()
}

fn folder() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    for part in ["pipelines", "fixtures", "configs"] {
        copy(&root().join(part), &place.path().join(part));
    }
    place
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        // results that a reader of the pages made here are not what the pages begin with
        if entry.file_name() == "workspaces" {
            continue;
        }
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Runs the listings of pages that follow one another in one folder.
fn check(pages: &[&str]) {
    let place = folder();
    let place = place.path().canonicalize().unwrap();
    let mut stale = Vec::new();
    for page in pages {
        let path = docs().join(page);
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let mut out: Vec<String> = Vec::new();
        let mut at = 0;
        let found = listings(&lines);
        assert!(!found.is_empty(), "{page} has no transcript");
        for listing in found {
            out.extend(lines[at..listing.begin].iter().map(|l| (*l).to_owned()));
            let body = &lines[listing.begin..listing.end];
            let mut fresh = String::new();
            for command in body.iter().filter_map(|l| l.strip_prefix("$ ")) {
                let said = run(command.split("  #").next().unwrap(), &place);
                fresh.push_str(&format!("$ {command}\n"));
                for (i, line) in said.lines().enumerate() {
                    if i == listing.head {
                        fresh.push_str("…\n");
                        break;
                    }
                    fresh.push_str(line);
                    fresh.push('\n');
                }
            }
            let shown = body.join("\n");
            if words(&shown) != words(&fresh) {
                let (a, b) = (words(&shown), words(&fresh));
                let i = a.iter().zip(&b).position(|(x, y)| x != y).unwrap_or(a.len().min(b.len()));
                let near = |w: &[String]| w[i.saturating_sub(4).min(w.len())..(i + 6).min(w.len())].join(" ");
                stale.push(format!(
                    "{page}, line {}: shows `{}`, the program says `{}`",
                    listing.begin,
                    near(&a),
                    near(&b)
                ));
            }
            out.extend(fresh.lines().map(str::to_owned));
            at = listing.end;
        }
        out.extend(lines[at..].iter().map(|l| (*l).to_owned()));
        if updating() {
            std::fs::write(&path, out.join("\n") + "\n").unwrap();
        }
    }
    assert!(
        updating() || stale.is_empty(),
        "transcripts that are not what the program says:\n  {}\n{AGAIN}",
        stale.join("\n  ")
    );
}

#[test]
fn the_tutorial_is_what_the_program_says() {
    check(&["tutorial/first-run.md", "tutorial/a-change.md", "tutorial/discovery.md"]);
}

#[test]
fn the_tutorial_of_an_unlisted_law_is_what_the_program_says() {
    check(&["tutorial/unlisted.md"]);
}

#[test]
fn the_tutorial_of_a_person_is_what_the_program_says() {
    check(&["tutorial/your-recordings.md", "tutorial/by-other-programs.md"]);
}

/// True if the words of `part` occur in `whole`, in the same order.
fn are_among(part: &[String], whole: &[String]) -> bool {
    let mut rest = whole.iter();
    part.iter().all(|word| rest.any(|w| w == word))
}

#[test]
fn lines_that_the_readme_shows_are_in_the_tutorial() {
    // the tutorial's transcripts are run; the README shows some of their lines, and for wide tables
    // some columns
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let lines: Vec<&str> = readme.lines().collect();
    let mut tutorial = Vec::new();
    for page in ["first-run", "discovery"] {
        let text = std::fs::read_to_string(docs().join(format!("tutorial/{page}.md"))).unwrap();
        let all: Vec<&str> = text.lines().collect();
        for listing in listings(&all) {
            tutorial.extend(all[listing.begin..listing.end].iter().map(|l| words(l)));
        }
    }
    let mut n = 0;
    for listing in listings(&lines) {
        for (i, line) in lines[listing.begin..listing.end].iter().enumerate() {
            // a comment after the command is not part of the transcript
            let shown = words(line.split("  #").next().unwrap());
            let found = tutorial.iter().any(|whole| are_among(&shown, whole));
            assert!(found, "README.md, line {}: no line of the tutorial says `{line}`", listing.begin + i + 1);
            n += 1;
        }
    }
    assert!(n >= 12, "README.md shows {n} lines of output");
}
