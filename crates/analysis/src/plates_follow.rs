//! Recordings whose force plates do not follow the motion, and the recording whose motion they do
//! follow.
//!
//! A missing effect or a wrong mass changes the size of the force, hardly its course in time: its
//! size as measured and as predicted from the motion has a correlation near 1 (0.967 to 0.999 in
//! the real jumps, landings and squats in the data folder). Plates of another recording show
//! another course.

use crate::to_correct::ToCorrect;
use aloft_compare::{TrialComparison, correlation_in_time, significant};
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::table::Table;
use aloft_workspace::workspace::Workspace;
use std::collections::{BTreeMap, HashMap};

/// Correlation below which plates do not follow a motion: far below those of real sessions, because
/// a movement with little change of force has less at a high cutoff (0.68 at 80 Hz).
const FOLLOWS: f64 = 0.6;
/// Correlation above which nobody else's motion is tried.
const FOLLOWS_CLOSELY: f64 = 0.99;
/// Least correlation with another motion.
const FOLLOWS_OTHER: f64 = 0.88;
/// Largest share of what the own motion leaves, 1 − r, that the other one leaves. Among 322 pairs
/// of different recordings of four simulated people and a real one the least was 2.6.
const LEFT_BY_OTHER: f64 = 0.5;
/// Most recordings that a sentence names.
const NAMED: usize = 4;

/// Size of the force in one recording, frame by frame, N; NaN where it does not count.
struct Course {
    predicted: Vec<f64>,
    measured: Vec<f64>,
    rate_hz: f64,
}

impl Course {
    fn read(ws: &Workspace, trial: &str, model: &str) -> Result<Option<Self>, PipelineError> {
        let file = ws.place("compare", WHOLE_STUDY).join(format!("series_{trial}.parquet"));
        let columns = if is_there(&file)? { Some(Table::read(&file)?.into_map()) } else { None };
        Ok(columns.and_then(|c| Self::of(&c, model)))
    }

    fn of(columns: &HashMap<String, Vec<f64>>, model: &str) -> Option<Self> {
        let flying = columns.get("in_flight")?;
        let size = |of: &str| {
            let axes = ["x", "y", "z"].map(|axis| columns.get(&format!("{of}.force_{axis}_n")));
            let [x, y, z] = [axes[0]?, axes[1]?, axes[2]?];
            let at = |f: usize| if flying[f] > 0.0 { f64::NAN } else { x[f].hypot(y[f]).hypot(z[f]) };
            Some((0..flying.len()).map(at).collect::<Vec<f64>>())
        };
        let rate_hz = columns.get("time_s").and_then(|t| Some((t.get(1)? - t[0]).recip()))?;
        Some(Self { predicted: size(model)?, measured: size("measured")?, rate_hz })
    }
}

/// The recordings whose plates follow another motion, or none; nothing if all follow their own.
pub(crate) fn plates_follow(
    ws: &Workspace,
    trials: &[TrialComparison],
    model: &str,
) -> Result<Option<ToCorrect>, PipelineError> {
    let own: Vec<(&str, f64)> = trials.iter().filter_map(|t| Some((t.trial.as_str(), t.plates_correlation?))).collect();
    let doubtful: Vec<(&str, f64)> = own.iter().copied().filter(|(_, r)| *r < FOLLOWS_CLOSELY).collect();
    if doubtful.is_empty() {
        return Ok(None);
    }
    let mut courses: BTreeMap<&str, Course> = BTreeMap::new();
    for t in trials {
        courses.extend(Course::read(ws, &t.trial, model)?.map(|course| (t.trial.as_str(), course)));
    }
    Ok(exchanged(own, &doubtful, &courses))
}

/// What the courses of the recordings say of those whose plates are doubtful.
fn exchanged(own: Vec<(&str, f64)>, doubtful: &[(&str, f64)], courses: &BTreeMap<&str, Course>) -> Option<ToCorrect> {
    let owner = |trial: &str, own: f64| -> Option<(&str, f64)> {
        let Course { measured, rate_hz, .. } = courses.get(trial)?;
        let others = courses.iter().filter(|(name, _)| **name != trial);
        let fits = others.filter_map(|(name, c)| Some((*name, correlation_in_time(&c.predicted, measured, *rate_hz)?)));
        let (name, other) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (other > FOLLOWS_OTHER && 1.0 - other < LEFT_BY_OTHER * (1.0 - own)).then_some((name, other))
    };
    let known: Vec<(&str, f64, &str, f64)> = doubtful
        .iter()
        .filter_map(|(trial, own)| owner(trial, *own).map(|(of, other)| (*trial, *own, of, other)))
        .collect();
    let odd: Vec<(&str, f64)> = own.into_iter().filter(|(_, r)| *r < FOLLOWS).collect();
    let list = |mut all: Vec<String>| {
        let more = all.len().saturating_sub(NAMED);
        all.truncate(NAMED);
        if more > 0 {
            all.push(format!("{more} more"));
        }
        all.join(", ")
    };
    let words = if !known.is_empty() {
        let one = |(trial, own, of, other): &(&str, f64, &str, f64)| {
            let [own, other] = [own, other].map(|r| significant(*r, 3));
            format!("those in {trial} measured the motion of {of} (correlation in time {other}, with its own {own})")
        };
        format!(
            "force plates are exchanged among recordings: {}. Give each recording its own plates, or exclude it",
            list(known.iter().map(one).collect())
        )
    } else {
        let (_, least) = odd.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))?;
        format!(
            "check the force plates in {}: their force does not follow the motion (correlation in time down to {}): plates of another \
             recording, another clock, or contact beside the plates",
            list(odd.iter().map(|o| o.0.to_owned()).collect()),
            significant(least, 2)
        )
    };
    Some(ToCorrect { words, first: !known.is_empty(), void: false, offered: false })
}
