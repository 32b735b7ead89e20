//! Describes in words where a model has its largest errors.

use crate::RecordingOffset;
use crate::breakdown::{Group, GroupedBy};
use crate::comparison::{AgainstFloor, BesideWords, ModelComparison, WorstPlace};
use crate::judgement::significant;
use crate::noise_floor::NoiseFloor;

/// Ratio from which a difference between groups is reported.
const REMARKABLE: f64 = 1.5;
/// Fewest frames of a group that is reported.
const FEWEST_FRAMES: usize = 20;
/// Fewest windows of a group for its window error to be used.
const FEWEST_WINDOWS: usize = 4;
/// Share of the error from which a link is named.
const LARGE_SHARE: f64 = 0.3;
const AXES: [&str; 3] = ["x", "y", "z"];

/// Word for a kind of place in which an error can stand out.
fn word_of(by: GroupedBy) -> Option<&'static str> {
    match by {
        GroupedBy::Phase => Some("phase"),
        GroupedBy::Flight => Some("flight"),
        GroupedBy::TimeInFlight => Some("part of the flight"),
        _ => None,
    }
}

/// Places whose error stands out from the median of their kind.
pub(crate) fn worst_places(model: &ModelComparison) -> Vec<WorstPlace> {
    let contact = model.held_out.frames > 0;
    let trials: Vec<(&str, f64)> = model
        .trials
        .iter()
        .filter_map(|t| {
            let (frames, windows) = if contact { (&t.contact, &t.contact_weak) } else { (&t.flight, &t.flight_weak) };
            let counts = !contact || t.held_out_contact;
            let enough = windows.windows >= FEWEST_WINDOWS;
            (counts && frames.frames >= FEWEST_FRAMES)
                .then(|| (t.trial.as_str(), if enough { windows.size() } else { frames.size() }))
        })
        .collect();
    let place = |what: &str, found: Option<(&str, f64)>| {
        found.map(|(name, times_median)| WorstPlace { what: what.to_owned(), name: name.to_owned(), times_median })
    };
    let mut out: Vec<WorstPlace> = place("trial", stands_out(&trials)).into_iter().collect();
    for by in [GroupedBy::Flight, GroupedBy::Phase, GroupedBy::TimeInFlight] {
        // sizes over windows and over frames cannot be compared
        let of_windows = of(&model.breakdown, by).all(|g| g.windows.windows >= FEWEST_WINDOWS);
        let sizes: Vec<(&str, f64)> = of(&model.breakdown, by)
            .map(|g| (g.name.as_str(), if of_windows { g.windows.size() } else { g.errors.size() }))
            .collect();
        out.extend(word_of(by).and_then(|what| place(what, stands_out(&sizes))));
    }
    out
}

/// Error of the last group of a quantity over that of the first, the same number on every surface:
/// over windows where every group has enough of them, else over frames. None without two groups.
pub fn growth(breakdown: &[Group], by: GroupedBy) -> Option<f64> {
    let groups = || of(breakdown, by);
    // sizes over windows and over frames cannot be compared
    let of_windows = groups().all(|g| g.windows.windows >= FEWEST_WINDOWS);
    let size = |g: &Group| if of_windows { g.windows.size() } else { g.errors.size() };
    let (first, last) = (size(groups().next()?), size(groups().last()?));
    (groups().count() > 1 && first > 0.0).then_some(last / first)
}

/// Sentences on one model, the most useful first. `against` are its errors in flight and in
/// held-out contact.
///
/// Every error is the held-out error over weak windows; single frames, whose error is mostly that
/// of second derivatives, are used only where no window fits.
pub(crate) fn describe(model: &ModelComparison, floor: Option<&NoiseFloor>, against: &[AgainstFloor]) -> Vec<String> {
    let mut out = Vec::new();
    let contact = model.held_out.frames > 0;
    let (windows, frames) =
        if contact { (&model.held_out_weak, &model.held_out) } else { (&model.flight_weak, &model.flight_wrench) };
    let place = if contact { "held-out contact" } else { "flight" };
    if frames.frames == 0 && against.is_empty() {
        return vec!["No frame can be compared: no flight, and no contact that is measured as a whole.".to_owned()];
    }
    for a in against {
        out.push(format!(
            "In {} the held-out error is {} N: {}.",
            if a.judged_on == "contact" { "held-out contact" } else { "flight" },
            figures(a.held_out_error),
            a.ratio_in_words()
        ));
    }
    if windows.windows == 0 {
        out.push(format!(
            "In {place} no run of frames is as long as a window; on single frames the mean error is {}.",
            pair(frames.force_n.mean_mae(), frames.moment_nm.mean_mae())
        ));
    }
    out.extend(offsets(model));
    let (force, moment, axes) = if windows.windows > 0 {
        (&windows.force_n, &windows.moment_nm, "world")
    } else {
        (&frames.force_n, &frames.moment_nm, "root")
    };
    let (axis, value) = worst(&force.rmse);
    let (turn, turning) = worst(&moment.rmse);
    out.push(format!(
        "Largest along {axes} {}: force {} N root mean square, mean {} N; about {axes} {}: moment {} N·m, mean {} N·m.",
        AXES[axis],
        figures(value),
        figures(force.bias[axis]),
        AXES[turn],
        figures(turning),
        figures(moment.bias[turn])
    ));
    // of an error at its floor only noise could be described
    let judged_here = against.iter().find(|a| (a.judged_on == "contact") == contact);
    let noise = judged_here.is_some_and(|a| a.at_floor == Some(true));
    if noise {
        out.push(format!("The error in {place} is not above its noise floor; its distribution is noise."));
    }
    for place in worst_places(model).into_iter().filter(|_| !noise) {
        let group = model.breakdown.iter().find(|g| word_of(g.by) == Some(place.what.as_str()) && g.name == place.name);
        let (on_frames, on_windows) = group.map_or((None, None), |g| g.explainable(floor));
        let share = on_windows.or(on_frames);
        out.push(format!(
            "Worst {}: {}, {:.1} times the median of them{}.",
            place.what,
            place.name,
            place.times_median,
            share.map_or(String::new(), |s| format!(
                "; {:.0} % of its mean square error is more than noise explains",
                100.0 * s
            ))
        ));
    }
    for (by, what) in [
        (GroupedBy::Speed, "speed of the centre of mass"),
        (GroupedBy::Acceleration, "acceleration of the centre of mass"),
        (GroupedBy::Turning, "turning of the root"),
        (GroupedBy::Posture, "spread of the body about its centre of mass"),
    ] {
        match growth(&model.breakdown, by).filter(|_| !noise) {
            Some(times) if times > REMARKABLE => {
                out.push(format!(
                    "The error grows with the {what}: {times:.1} times from the lowest quarter to the highest."
                ));
            }
            Some(times) if times * REMARKABLE < 1.0 => {
                let fall = 1.0 / times;
                out.push(format!(
                    "The error falls with the {what}: {fall:.1} times from the highest quarter to the lowest."
                ));
            }
            _ => {}
        }
    }
    if let Some(segment) = model.segments.first().filter(|s| !noise && s.inertia_share > LARGE_SHARE) {
        out.push(format!(
            "An error of the mass or inertia of {} alone would explain {:.0} % of the mean square error; a missing force can look the same.",
            segment.link,
            100.0 * segment.inertia_share
        ));
    }
    out
}

/// Errors of the other models where the first is judged, a sentence for each.
pub(crate) fn describe_beside(beside: &[ModelComparison], against: &[AgainstFloor]) -> Vec<BesideWords> {
    let sentence = |other: &ModelComparison| {
        let of = |a: &AgainstFloor| {
            let errors = if a.judged_on == "contact" { &other.held_out_weak } else { &other.flight_weak };
            (errors.windows > 0).then(|| format!("{} N in {}", figures(errors.size()), a.judged_on))
        };
        let errors: Vec<String> = against.iter().filter_map(of).collect();
        let name = if other.model == "prior" { "tables" } else { &other.model };
        let words = format!("For comparison, `{name}`: {}.", errors.join(", "));
        (!errors.is_empty()).then(|| BesideWords { model: other.model.clone(), words })
    };
    beside.iter().filter_map(sentence).collect()
}

/// Offsets subtracted from recordings whose plates were never unloaded, and the error with them.
fn offsets(model: &ModelComparison) -> Vec<String> {
    let mut out = Vec::new();
    for t in model.trials.iter().filter(|t| t.untared && t.contact.frames > 0) {
        out.push(match &t.offset {
            Some(RecordingOffset { beyond: Some(beyond), force_n, moment_nm, .. }) => format!(
                "The plates of {} were never unloaded, so their zero is not known. A constant of ({}) N and ({}) N·m (about the world origin) \
                 was taken off, as much as the plates' zeros in the other recordings allow; another ({}) N and ({}) N·m remain and count as \
                 error of the model `{}`.",
                t.trial,
                signed(force_n),
                signed(moment_nm),
                signed(&[beyond[0], beyond[1], beyond[2]]),
                signed(&[beyond[3], beyond[4], beyond[5]]),
                model.model
            ),
            Some(o) => format!(
                "The plates of {} were never unloaded: a constant wrench of ({}) N and ({}) N·m about the world origin was taken off \
                 (every model has its own, this is that of `{}`); it would hide a constant error of the model of the same size.",
                t.trial,
                signed(&o.force_n),
                signed(&o.moment_nm),
                model.model
            ),
            None => format!(
                "The plates of {} were never unloaded, and no constant could be taken off: their offset counts as error of the model.",
                t.trial
            ),
        });
    }
    if model.trials.iter().any(|t| t.held_out_contact && t.offset.is_some()) {
        let (frames, windows) = (&model.held_out_as_measured, &model.held_out_weak_as_measured);
        out.push(format!(
            "As measured, with such constants, the held-out error in contact is {}.",
            if windows.windows > 0 {
                format!("{} N", figures(windows.size()))
            } else {
                format!("{} on single frames", pair(frames.force_n.mean_mae(), frames.moment_nm.mean_mae()))
            }
        ));
    }
    out
}

fn signed(values: &[f64; 3]) -> String {
    values.map(|x| format!("{}{}", if x < 0.0 { "" } else { "+" }, figures(x))).join(", ")
}

fn figures(x: f64) -> String {
    significant(x, 3)
}

fn pair(force_n: f64, moment_nm: f64) -> String {
    format!("{} N and {} N·m", figures(force_n), figures(moment_nm))
}

fn of(groups: &[Group], by: GroupedBy) -> impl Iterator<Item = &Group> {
    groups.iter().filter(move |g| g.by == by && g.errors.frames >= FEWEST_FRAMES)
}

fn worst(values: &[f64; 3]) -> (usize, f64) {
    let i = (0..3).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    (i, values[i])
}

/// The largest, if it stands out from the median of at least two.
fn stands_out<'a>(sizes: &[(&'a str, f64)]) -> Option<(&'a str, f64)> {
    let mut values: Vec<f64> = sizes.iter().map(|s| s.1).collect();
    if values.len() < 2 {
        return None;
    }
    let median = aloft_signal::median(&mut values);
    let (name, largest) = sizes.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (*largest > REMARKABLE * median && median > 0.0).then_some((name, largest / median))
}
