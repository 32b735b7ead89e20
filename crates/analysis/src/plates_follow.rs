//! Recordings whose force plates do not follow the motion, and the recording whose motion they do
//! follow.
//!
//! A missing effect or a wrong mass changes the size of the force, hardly its course in time: its
//! size as measured and as predicted from the motion has a correlation near 1 (0.89 to 0.997 in the
//! real sessions of landings in the data folder). Plates of another recording show another course.

use crate::to_correct::ToCorrect;
use aloft_compare::{TrialComparison, correlation_in_time, significant};
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::table::Table;
use aloft_workspace::workspace::Workspace;
use std::collections::BTreeMap;

/// Correlation below which plates do not follow a motion. Chosen between those of real sessions
/// (0.89 and more) and those of one recording's plates with another one's motion (0.9 at most in two
/// of 90 pairs, usually below 0.7).
const FOLLOWS: f64 = 0.8;
/// Correlation from which they follow another motion, and how much more than their own.
const FOLLOWS_OTHER: [f64; 2] = [0.88, 0.15];
/// Most recordings that a sentence names.
const NAMED: usize = 4;

/// Size of the force in one recording, frame by frame, N; NaN where it does not count.
struct Course {
    predicted: Vec<f64>,
    measured: Vec<f64>,
}

impl Course {
    fn read(ws: &Workspace, trial: &str, model: &str) -> Option<Self> {
        let file = ws.place("compare", WHOLE_STUDY).join(format!("series_{trial}.parquet"));
        let columns = Table::read(&file).ok()?.into_map();
        let flying = columns.get("in_flight")?;
        let size = |of: &str| {
            let axes = ["x", "y", "z"].map(|axis| columns.get(&format!("{of}.force_{axis}_n")));
            let [x, y, z] = [axes[0]?, axes[1]?, axes[2]?];
            let at = |f: usize| if flying[f] > 0.0 { f64::NAN } else { x[f].hypot(y[f]).hypot(z[f]) };
            Some((0..flying.len()).map(at).collect::<Vec<f64>>())
        };
        Some(Self { predicted: size(model)?, measured: size("measured")? })
    }
}

/// The recordings whose plates do not follow their motion; none if all do.
pub(crate) fn plates_follow(ws: &Workspace, trials: &[TrialComparison], model: &str) -> Option<ToCorrect> {
    let odd: Vec<(&str, f64)> = trials
        .iter()
        .filter_map(|t| Some((t.trial.as_str(), t.plates_correlation.filter(|r| *r < FOLLOWS)?)))
        .collect();
    let (_, least) = odd.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let courses: BTreeMap<&str, Course> =
        trials.iter().filter_map(|t| Some((t.trial.as_str(), Course::read(ws, &t.trial, model)?))).collect();
    let owner = |trial: &str, own: f64| -> Option<(&str, f64)> {
        let measured = &courses.get(trial)?.measured;
        let others = courses.iter().filter(|(name, _)| **name != trial);
        let fits = others.filter_map(|(name, c)| Some((*name, correlation_in_time(&c.predicted, measured)?)));
        fits.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, r)| *r > FOLLOWS_OTHER[0].max(own + FOLLOWS_OTHER[1]))
    };
    let known: Vec<(&str, &str, f64)> =
        odd.iter().filter_map(|(trial, own)| owner(trial, *own).map(|(of, r)| (*trial, of, r))).collect();
    let list = |mut all: Vec<String>| {
        let more = all.len().saturating_sub(NAMED);
        all.truncate(NAMED);
        if more > 0 {
            all.push(format!("{more} more"));
        }
        all.join(", ")
    };
    let words = if known.is_empty() {
        format!(
            "check the force plates in {}: their force does not follow the motion (correlation in time down to {}): plates of another \
             recording, another clock, or contact beside the plates",
            list(odd.iter().map(|o| o.0.to_owned()).collect()),
            significant(least, 2)
        )
    } else {
        format!(
            "force plates are exchanged among recordings: {}. Give each recording its own plates, or exclude it",
            list(
                known
                    .iter()
                    .map(|(trial, of, r)| format!(
                        "those in {trial} measured the motion of {of} (correlation in time {}, with {trial} {})",
                        significant(*r, 2),
                        significant(odd.iter().find(|o| o.0 == *trial).map_or(f64::NAN, |o| o.1), 2)
                    ))
                    .collect()
            )
        )
    };
    Some(ToCorrect { words, first: !known.is_empty(), void: false })
}
