//! Describes in words where a model has its largest errors.

use crate::breakdown::{Group, GroupedBy};
use crate::comparison::ModelComparison;
use crate::noise_floor::{NoiseFloor, explainable};

/// Ratio from which a difference between groups is reported.
const REMARKABLE: f64 = 1.5;
/// Fewest frames of a group that is reported.
const FEWEST_FRAMES: usize = 20;
/// Fewest windows of a group for its window error to be used.
const FEWEST_WINDOWS: usize = 4;
/// Share of the error from which a link is named.
const LARGE_SHARE: f64 = 0.3;
const AXES: [&str; 3] = ["x", "y", "z"];

/// Sentences on one model, the most useful first. `beside` are the other models.
pub(crate) fn describe(model: &ModelComparison, beside: &[ModelComparison], floor: Option<&NoiseFloor>) -> Vec<String> {
    let mut out = Vec::new();
    let contact = model.held_out.frames > 0;
    let (windows, frames) =
        if contact { (&model.held_out_weak, &model.held_out) } else { (&model.flight_weak, &model.flight_wrench) };
    let place = if contact { "held-out contact" } else { "flight" };
    if frames.frames == 0 {
        return vec!["No frame can be compared: no flight, and no contact that is measured as a whole.".to_owned()];
    }
    out.push(format!(
        "In {place} the mean error is {} on single frames{}.",
        pair(frames.force_n.mean_mae(), frames.moment_nm.mean_mae()),
        if windows.windows > 0 {
            format!(" and {} over weak windows", pair(windows.force_n.mean_mae(), windows.moment_nm.mean_mae()))
        } else {
            String::new()
        }
    ));
    out.extend(offsets(model));
    if let Some(floor) = floor {
        let (on_frames, on_windows) =
            if contact { (&floor.contact, &floor.contact_weak) } else { (&floor.flight, &floor.flight_weak) };
        if on_frames.frames > 0 {
            let share = explainable(frames.size(), on_frames.size());
            out.push(format!(
                "A perfect model would leave {} on frames; {:.0} % of the mean square error there is explainable.",
                pair(on_frames.force_n.mean_mae(), on_frames.moment_nm.mean_mae()),
                100.0 * share
            ));
        }
        if on_windows.windows > 0 && windows.windows > 0 {
            let share = explainable(windows.size(), on_windows.size());
            out.push(format!(
                "Over windows a perfect model would leave {}; {:.0} % of the mean square error there is explainable.",
                pair(on_windows.force_n.mean_mae(), on_windows.moment_nm.mean_mae()),
                100.0 * share
            ));
        }
    }
    let (axis, value) = worst(&frames.force_n.rmse);
    let (turn, moment) = worst(&frames.moment_nm.rmse);
    out.push(format!(
        "Worst axes of the root: force {} ({} N root mean square, mean {} N), moment {} ({} N·m, mean {} N·m).",
        AXES[axis],
        figures(value),
        figures(frames.force_n.bias[axis]),
        AXES[turn],
        figures(moment),
        figures(frames.moment_nm.bias[turn])
    ));
    let trials: Vec<(&str, f64)> = model
        .trials
        .iter()
        .map(|t| (t.trial.as_str(), if contact { &t.contact } else { &t.flight }))
        .filter(|(_, e)| e.frames >= FEWEST_FRAMES)
        .map(|(name, e)| (name, e.size()))
        .collect();
    if let Some((name, ratio)) = stands_out(&trials) {
        out.push(format!("Worst trial: {name}, {ratio:.1} times the median trial."));
    }
    for (by, what) in
        [(GroupedBy::Phase, "phase"), (GroupedBy::Flight, "flight"), (GroupedBy::TimeInFlight, "part of the flight")]
    {
        let groups: Vec<(&str, f64)> = of(&model.breakdown, by).map(|g| (g.name.as_str(), size(g))).collect();
        if let Some((name, ratio)) = stands_out(&groups) {
            let group = model.breakdown.iter().find(|g| g.by == by && g.name == name);
            let (on_frames, on_windows) = group.map_or((None, None), |g| g.explainable(floor));
            let share = on_windows.or(on_frames);
            out.push(format!(
                "Worst {what}: {name}, {ratio:.1} times the median of them{}.",
                share
                    .map_or(String::new(), |s| format!("; {:.0} % of its mean square error is explainable", 100.0 * s))
            ));
        }
    }
    for (by, what) in [
        (GroupedBy::Speed, "speed of the centre of mass"),
        (GroupedBy::Acceleration, "acceleration of the centre of mass"),
        (GroupedBy::Turning, "turning of the root"),
        (GroupedBy::Posture, "spread of the body about its centre of mass"),
    ] {
        let sizes: Vec<f64> = of(&model.breakdown, by).map(size).collect();
        if let (Some(first), Some(last)) = (sizes.first(), sizes.last()) {
            if last > &(REMARKABLE * first) {
                out.push(format!(
                    "The error grows with the {what}: {:.1} times from the lowest quarter to the highest.",
                    last / first
                ));
            } else if first > &(REMARKABLE * last) {
                out.push(format!(
                    "The error falls with the {what}: {:.1} times from the highest quarter to the lowest.",
                    first / last
                ));
            }
        }
    }
    if let Some(segment) = model.segments.first().filter(|s| s.inertia_share > LARGE_SHARE) {
        out.push(format!(
            "A change of {} alone would explain {:.0} % of the mean square error.",
            segment.link,
            100.0 * segment.inertia_share
        ));
    }
    for other in beside {
        let theirs = if contact { &other.held_out } else { &other.flight_wrench };
        let weak = if contact { &other.held_out_weak } else { &other.flight_weak };
        out.push(format!(
            "`{}` beside it: {} on frames{}.",
            other.model,
            pair(theirs.force_n.mean_mae(), theirs.moment_nm.mean_mae()),
            if weak.windows > 0 {
                format!(", {} over windows", pair(weak.force_n.mean_mae(), weak.moment_nm.mean_mae()))
            } else {
                String::new()
            }
        ));
    }
    out
}

/// Offsets subtracted from recordings whose plates were never unloaded, and the error with them.
fn offsets(model: &ModelComparison) -> Vec<String> {
    let mut out = Vec::new();
    for t in model.trials.iter().filter(|t| t.untared && t.contact.frames > 0) {
        out.push(match &t.offset {
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
            "As measured, with such constants, the mean error in held-out contact is {} on single frames{}.",
            pair(frames.force_n.mean_mae(), frames.moment_nm.mean_mae()),
            if windows.windows > 0 {
                format!(" and {} over weak windows", pair(windows.force_n.mean_mae(), windows.moment_nm.mean_mae()))
            } else {
                String::new()
            }
        ));
    }
    out
}

fn signed(values: &[f64; 3]) -> String {
    values.map(|x| format!("{}{}", if x < 0.0 { "" } else { "+" }, figures(x))).join(", ")
}

/// Two decimals, or more if the first two are zeros: errors of small objects are small numbers.
fn figures(x: f64) -> String {
    let size = x.abs();
    if !(1e-9..0.1).contains(&size) {
        return format!("{x:.2}");
    }
    let decimals = (1.0 - size.log10().floor()) as usize;
    format!("{x:.decimals$}")
}

fn pair(force_n: f64, moment_nm: f64) -> String {
    format!("{} N and {} N·m", figures(force_n), figures(moment_nm))
}

/// Error over windows if there are enough: on frames the noise of second derivatives masks the
/// model.
fn size(g: &Group) -> f64 {
    if g.windows.windows >= FEWEST_WINDOWS { g.windows.size() } else { g.errors.size() }
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
