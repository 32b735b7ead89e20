//! Remarks of the same kind as one line, with the recordings that they concern.

use aloft_trial::{QualityReason, Severity, Warning};
use aloft_workspace::qc::QcReason;
use serde::Serialize;
use std::collections::BTreeMap;

/// One remark on one recording, with what is needed to find others of its kind.
#[derive(Debug, Clone)]
pub(crate) enum Remark {
    /// Of the quality table.
    Quality(QualityReason),
    /// Of the reader.
    Import(Warning),
    /// Labels that the marker set does not know.
    UnknownLabels(Vec<String>),
    /// The recording cannot be used: the problem, with the file's path, and what to do.
    Broken { problem: String, path: String, hint: Option<String> },
    /// Anything else.
    Other(String),
}

impl std::fmt::Display for Remark {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Quality(reason) => reason.fmt(f),
            Self::Import(warning) => warning.fmt(f),
            Self::UnknownLabels(labels) => {
                write!(f, "labels that the set does not know: {}", aloft_pipeline::recording::abridged(labels))
            }
            Self::Broken { problem, hint: Some(hint), .. } => write!(f, "{problem}; hint: {hint}"),
            Self::Broken { problem, .. } | Self::Other(problem) => f.write_str(problem),
        }
    }
}

/// Remarks of one kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What was found, in words.
    pub text: String,
    /// Recordings that it concerns, in the order of the study.
    pub trials: Vec<String>,
    /// True if these recordings cannot be used.
    pub broken: bool,
}

/// Names that are shown of a long list.
const NAMED: usize = 5;
/// Recordings that are shown of many.
const TRIALS: usize = 3;

/// The first names of a list, and how many there are.
fn few(names: &[String]) -> String {
    let shown = names.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > NAMED { format!("{shown} … ({} in all)", names.len()) } else { shown }
}

impl Finding {
    /// The finding and its recordings, of `all` there are.
    pub fn sentence(&self, all: usize) -> String {
        let whose = match self.trials.as_slice() {
            [one] => one.clone(),
            many if many.len() == all => format!("all {all} trials"),
            many => {
                let more = if many.len() > TRIALS { " …" } else { "" };
                let shown = many.iter().take(TRIALS).cloned().collect::<Vec<_>>().join(", ");
                format!("{} of {all} trials: {shown}{more}", many.len())
            }
        };
        format!("{} ({whose})", self.text)
    }
}

/// A text without its numbers: texts that differ in numbers alone are of one kind.
fn template(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '0'..='9' if out.ends_with('#') => {}
            '0'..='9' => out.push('#'),
            c => out.push(c),
        }
    }
    // a fraction is one number
    out.replace("#.#", "#")
}

fn key(remark: &Remark) -> String {
    match remark {
        Remark::Quality(reason) => format!("quality {}", QcReason::from(reason).code()),
        Remark::Import(warning) => format!("import {}", template(&warning.message)),
        Remark::UnknownLabels(_) => "unknown labels".to_owned(),
        Remark::Broken { problem, path, .. } => format!("broken {}", template(&problem.replace(path.as_str(), ""))),
        Remark::Other(text) => format!("other {}", template(text)),
    }
}

/// Names without repetition, in the order of their first appearance.
fn once(names: impl Iterator<Item = String>) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for name in names {
        if !out.contains(&name) {
            out.push(name);
        }
    }
    out
}

/// One text for remarks of one kind.
fn text(remarks: &[&Remark]) -> String {
    let own = |pick: fn(&QualityReason) -> Option<String>| {
        once(remarks.iter().filter_map(|r| if let Remark::Quality(q) = r { pick(q) } else { None }))
    };
    let marker = |q: &QualityReason| match q {
        QualityReason::MissingMarker { marker }
        | QualityReason::LongGap { marker, .. }
        | QualityReason::Spikes { marker, .. }
        | QualityReason::NoisyMarker { marker, .. } => Some(marker.clone()),
        QualityReason::LabelSwap { marker, with, .. } => Some(format!("{marker} and {with}")),
        _ => None,
    };
    let plate = |q: &QualityReason| match q {
        QualityReason::PlateSaturated { plate, .. } | QualityReason::PlateIncomplete { plate, .. } => {
            Some(plate.clone())
        }
        _ => None,
    };
    let n = remarks.len();
    match remarks.first() {
        Some(Remark::Quality(first)) if n > 1 => {
            let (markers, plates) = (own(marker), own(plate));
            match first {
                QualityReason::MissingMarker { .. } => format!("markers missing: {}", few(&markers)),
                QualityReason::LongGap { .. } => {
                    let of = if markers.len() == 1 { "marker" } else { "markers" };
                    format!("{n} gaps too long to fill in {} {of}: {}", markers.len(), few(&markers))
                }
                QualityReason::Spikes { .. } => format!("spikes in markers {}", few(&markers)),
                QualityReason::LabelSwap { .. } => {
                    format!("labels exchanged in {n} stretches: {}", few(&markers))
                }
                QualityReason::NoisyMarker { .. } => format!("noisy markers: {}", few(&markers)),
                QualityReason::PlateSaturated { .. } => {
                    format!("plates at their extreme value: {}", few(&plates))
                }
                QualityReason::PlateIncomplete { .. } => format!("plates that lack samples: {}", few(&plates)),
                QualityReason::ColumnsNotUsed { .. } => {
                    let columns = once(remarks.iter().flat_map(|r| match r {
                        Remark::Quality(QualityReason::ColumnsNotUsed { columns }) => columns.clone(),
                        _ => Vec::new(),
                    }));
                    QualityReason::ColumnsNotUsed { columns }.to_string()
                }
                other => other.to_string(),
            }
        }
        Some(Remark::UnknownLabels(_)) => {
            let all = once(remarks.iter().flat_map(|r| match r {
                Remark::UnknownLabels(labels) => labels.clone(),
                _ => Vec::new(),
            }));
            format!("labels that the set does not know: {}", few(&all))
        }
        Some(first) => {
            let words = first.to_string();
            let same = remarks.iter().all(|r| r.to_string() == words);
            if same { words } else { format!("{words}; the like in the others") }
        }
        None => String::new(),
    }
}

/// The remarks of all recordings by kind: what cannot be used first, then by number of recordings.
pub(crate) fn findings<'a>(rows: impl Iterator<Item = (&'a str, &'a [Remark])>) -> Vec<Finding> {
    let mut kinds: BTreeMap<String, (usize, Vec<&str>, Vec<&Remark>)> = BTreeMap::new();
    for (trial, remarks) in rows {
        for remark in remarks {
            let next = kinds.len();
            let (_, trials, of_kind) = kinds.entry(key(remark)).or_insert_with(|| (next, Vec::new(), Vec::new()));
            if trials.last() != Some(&trial) {
                trials.push(trial);
            }
            of_kind.push(remark);
        }
    }
    let mut kinds: Vec<_> = kinds.into_values().collect();
    let broken = |of: &[&Remark]| {
        of.iter().any(|r| match r {
            Remark::Broken { .. } => true,
            Remark::Quality(reason) => reason.severity() == Severity::Unusable,
            _ => false,
        })
    };
    kinds.sort_by_key(|(first, trials, of)| (!broken(of), std::cmp::Reverse(trials.len()), *first));
    let finding = |(_, trials, of): (usize, Vec<&str>, Vec<&Remark>)| Finding {
        text: text(&of),
        trials: trials.into_iter().map(str::to_owned).collect(),
        broken: broken(&of),
    };
    kinds.into_iter().map(finding).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_trial::WarningKind;

    fn gap(marker: &str, first_frame: usize) -> Remark {
        Remark::Quality(QualityReason::LongGap { marker: marker.into(), first_frame, last_frame: first_frame + 40 })
    }
    fn told(message: &str) -> Remark {
        Remark::Import(Warning::new(WarningKind::Plates, message))
    }

    #[test]
    fn remarks_of_one_kind_are_one_line_with_their_recordings() {
        let walk: Vec<Remark> = (0..60).map(|k| gap(["LASI", "RASI", "SACR"][k % 3], 50 * k)).collect();
        let jump = [gap("LASI", 3), told("plate 1: ZERO 1 to 10 is not used"), told("vertical by gravity")];
        let other = [told("plate 2: ZERO 3 to 12 is not used"), told("vertical by gravity")];
        let broken = [Remark::Broken {
            problem: "lab/x.c3d: the file is empty".into(),
            path: "lab/x.c3d".into(),
            hint: Some("leave it out".into()),
        }];
        let rows = [("walk", &walk[..]), ("jump", &jump), ("hop", &other), ("x", &broken)];
        let found: Vec<String> = findings(rows.into_iter()).iter().map(|f| f.sentence(4)).collect();
        assert_eq!(
            found,
            [
                "lab/x.c3d: the file is empty; hint: leave it out (x)",
                "61 gaps too long to fill in 3 markers: LASI, RASI, SACR (2 of 4 trials: walk, jump)",
                "plate 1: ZERO 1 to 10 is not used; the like in the others (2 of 4 trials: jump, hop)",
                "vertical by gravity (2 of 4 trials: jump, hop)",
            ]
        );
    }

    #[test]
    fn a_single_remark_is_told_as_it_is_and_nothing_is_lost() {
        let one = [gap("LASI", 9)];
        let found = findings([("jump", &one[..])].into_iter());
        assert_eq!(found[0].sentence(3), "marker `LASI` is missing in frames 10 to 50 (jump)");
        assert_eq!(template("1.25 s, 0.5 s"), template("10 s, 33.7 s"));
        let rows = [("a", &one[..]), ("b", &one), ("c", &one)];
        assert_eq!(
            findings(rows.into_iter())[0].sentence(3),
            "3 gaps too long to fill in 1 marker: LASI (all 3 trials)"
        );
    }
}
