//! The results as a readable table.

use crate::{Line, MULTIPLES};
use std::collections::BTreeSet;
use std::fmt::Write;

fn effect_of(line: &Line) -> &str {
    line.key.split('[').next().unwrap_or_default()
}

fn percent(n: usize, of: usize) -> String {
    if of == 0 { "–".to_owned() } else { format!("{n}/{of} ({:.0} %)", 100.0 * n as f64 / of as f64) }
}

pub fn markdown(lines: &[Line]) -> String {
    let mut out = String::new();
    let w = &mut out;
    let kinds: BTreeSet<&str> = lines.iter().map(|l| l.kind.as_str()).collect();
    writeln!(w, "| laboratories | size / detectable | labs | right name | right class | and a second name | missed | wrong name |").unwrap();
    writeln!(w, "|---|---|---|---|---|---|---|---|").unwrap();
    let row = |w: &mut String, name: &str, size: &str, of: &[&Line]| {
        let n = |word: &str| percent(of.iter().filter(|l| l.outcome == word).count(), of.len());
        writeln!(
            w,
            "| {name} | {size} | {} | {} | {} | {} | {} | {} |",
            of.len(),
            n("hit"),
            n("class"),
            n("hit and more"),
            n("missed"),
            n("wrong")
        )
        .unwrap();
    };
    let hidden: Vec<&Line> = lines.iter().filter(|l| !l.key.is_empty()).collect();
    for kind in &kinds {
        for m in MULTIPLES {
            let of: Vec<&Line> = hidden.iter().copied().filter(|l| l.kind == *kind && l.multiple == m).collect();
            row(w, kind, &m.to_string(), &of);
        }
    }
    for m in MULTIPLES {
        let of: Vec<&Line> = hidden.iter().copied().filter(|l| l.multiple == m).collect();
        row(w, "all", &m.to_string(), &of);
    }
    row(w, "all", "all", &hidden);
    writeln!(w).unwrap();
    for kind in &kinds {
        let twins: Vec<&Line> = lines.iter().filter(|l| l.key.is_empty() && l.kind == *kind).collect();
        let alarms = twins.iter().filter(|l| l.outcome == "false alarm").count();
        writeln!(w, "False alarms on twins with nothing hidden, {kind}: {}.", percent(alarms, twins.len())).unwrap();
    }
    let named: Vec<&Line> =
        hidden.iter().copied().filter(|l| matches!(l.outcome.as_str(), "hit" | "class" | "hit and more")).collect();
    let near = named.iter().filter(|l| l.after <= 1.05 * l.twin).count();
    writeln!(w, "Held-out error after adding at most 5 % above the twin's: {}.", percent(near, named.len())).unwrap();
    for kind in &kinds {
        let of: Vec<&&Line> = named.iter().filter(|l| l.kind == *kind).collect();
        let near = of.iter().filter(|l| l.after <= 1.05 * l.twin).count();
        let all: Vec<_> = of.iter().flat_map(|l| &l.coefficients).collect();
        let within = all.iter().filter(|(_, truth, value, se)| (value - truth).abs() <= 2.0 * se).count();
        writeln!(w, "Of these {kind}: {}; coefficients {}.", percent(near, of.len()), percent(within, all.len()))
            .unwrap();
    }
    let all: Vec<&(String, f64, f64, f64)> = named.iter().flat_map(|l| &l.coefficients).collect();
    let within = all.iter().filter(|(_, truth, value, se)| (value - truth).abs() <= 2.0 * se).count();
    writeln!(w, "Coefficients within two standard errors of the truth: {}.", percent(within, all.len())).unwrap();
    writeln!(
        w,
        "\n| hidden | labs | right name | right class | and a second name | missed | wrong name | wrong names given |"
    )
    .unwrap();
    writeln!(w, "|---|---|---|---|---|---|---|---|").unwrap();
    for kind in &kinds {
        let effects: BTreeSet<&str> = hidden.iter().filter(|l| l.kind == *kind).map(|l| effect_of(l)).collect();
        for effect in effects {
            let of: Vec<&Line> = hidden.iter().copied().filter(|l| l.kind == *kind && effect_of(l) == effect).collect();
            let n = |word: &str| of.iter().filter(|l| l.outcome == word).count();
            let wrong: BTreeSet<String> =
                of.iter().filter(|l| l.outcome == "wrong").map(|l| l.effects.join(" or ")).collect();
            writeln!(
                w,
                "| {kind}: `{effect}` | {} | {} | {} | {} | {} | {} | {} |",
                of.len(),
                n("hit"),
                n("class"),
                n("hit and more"),
                n("missed"),
                n("wrong"),
                wrong.into_iter().collect::<Vec<_>>().join("; ")
            )
            .unwrap();
        }
    }
    out
}
