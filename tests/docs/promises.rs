//! The page of promises names the test that keeps each of them; these tests exist.

use crate::root;
use std::fs;

/// Names in code marks that look like tests.
fn named(text: &str) -> Vec<&str> {
    let is_test = |w: &&str| {
        w.matches('_').count() >= 3 && w.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
    };
    text.split('`').skip(1).step_by(2).filter(is_test).collect()
}

/// Every function marked as a test, with the line before it.
fn tests() -> Vec<String> {
    let mut out = Vec::new();
    for folder in ["crates", "tests"] {
        for entry in walkdir::WalkDir::new(root().join(folder)).into_iter().flatten() {
            if entry.path().extension().is_none_or(|e| e != "rs") {
                continue;
            }
            let text = fs::read_to_string(entry.path()).unwrap();
            let mut marked = false;
            for line in text.lines().map(str::trim) {
                marked |= line == "#[test]";
                if let Some(name) = line.strip_prefix("fn ").and_then(|l| l.split('(').next()).filter(|_| marked) {
                    out.push(name.to_owned());
                    marked = false;
                }
            }
        }
    }
    out
}

#[test]
fn every_promise_names_a_test_that_exists() {
    let page = fs::read_to_string(root().join("docs/promises.md")).unwrap();
    let tests = tests();
    for name in named(&page) {
        assert!(tests.iter().any(|t| t == name), "docs/promises.md names the test `{name}`, which does not exist");
    }
    // a list item is a promise, and so is a section without a list
    for section in page.split("\n## ").skip(1) {
        let (title, body) = section.split_once('\n').unwrap();
        let items: Vec<&str> = body.split("\n- ").skip(1).collect();
        let promises = if items.is_empty() { vec![body] } else { items };
        for promise in promises {
            assert!(!named(promise).is_empty(), "no test is named in `{title}`: {promise}");
        }
    }
}
