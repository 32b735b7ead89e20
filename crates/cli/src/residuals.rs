//! The comparison as tables: the distribution of the error, and the part that noise does not
//! explain.

use crate::args::ByArg;
use crate::errors;
use crate::render::{out, significant, table};
use crate::screen::labelled;
use crate::show::three;
use crate::stop::Stop;
use aloft_analysis::compare::ComparisonView;
use aloft_compare::{Group, GroupedBy, SegmentShare};

const ALL: [ByArg; 10] = [
    ByArg::Trial,
    ByArg::Phase,
    ByArg::Flight,
    ByArg::Time,
    ByArg::Axis,
    ByArg::Speed,
    ByArg::Acceleration,
    ByArg::Turning,
    ByArg::Posture,
    ByArg::Segment,
];

/// The comparison in short; with details, all breakdowns, or those requested.
pub fn comparison(view: &ComparisonView, by: &[ByArg], details: bool) -> Result<(), Stop> {
    let c = &view.comparison;
    if by.is_empty() {
        errors::block(view)?;
        let words = view.sentences(details);
        let words = &words[view.errors.len().min(words.len())..];
        if !words.is_empty() {
            out("")?;
            crate::screen::list(words)?;
        }
        trials(view)?;
        if details {
            if let Some(calibration) = &view.calibration {
                crate::show_estimators::calibration(calibration)?;
            }
            if let Some(weighed) = &view.impulse_mass {
                crate::show_estimators::impulse_mass(weighed)?;
            }
            crate::show::frames(view)?;
            let f = &c.first.flight;
            out(labelled(
                "",
                &format!(
                    "residual wrench in flight, RMS on single frames: force {} N, moment {} N·m ({} frames)",
                    three(&f.residual_force_n.rms),
                    three(&f.residual_moment_nm.rms),
                    f.frames
                ),
            ))?;
            out("")?;
        } else {
            out(labelled("", errors::MEANING))?;
            out(labelled(
                "",
                "split the error: --by speed (or phase, flight, time, axis, acceleration, turning, posture, segment); --details: all of them",
            ))?;
        }
    }
    let shown: &[ByArg] = match (by.is_empty(), details) {
        (true, true) => &ALL[1..],
        (true, false) => &[],
        (false, _) => by,
    };
    for what in shown {
        match what {
            ByArg::Trial => {
                trials(view)?;
                groups(view, GroupedBy::Trial)?;
            }
            ByArg::Phase => groups(view, GroupedBy::Phase)?,
            ByArg::Flight => groups(view, GroupedBy::Flight)?,
            ByArg::Time => groups(view, GroupedBy::TimeInFlight)?,
            ByArg::Speed => groups(view, GroupedBy::Speed)?,
            ByArg::Acceleration => groups(view, GroupedBy::Acceleration)?,
            ByArg::Turning => groups(view, GroupedBy::Turning)?,
            ByArg::Posture => groups(view, GroupedBy::Posture)?,
            ByArg::Axis => axes(view)?,
            ByArg::Segment => segments(view)?,
        }
    }
    Ok(())
}

fn percent(share: Option<f64>) -> String {
    share.map_or("–".to_owned(), |s| format!("{:.0} %", 100.0 * s))
}

fn number(v: Option<f64>) -> String {
    v.map_or("–".to_owned(), |x| significant(x, 3))
}

fn trials(view: &ComparisonView) -> Result<(), Stop> {
    let c = &view.comparison;
    let header = ["trial", "role", "flights", "free fall vs g, %", "markers mm", "in flight N", "in contact N"];
    let mut t = table(&header).left(&[1]).optional(&[4, 3]);
    for row in &view.kinematics {
        let errors = c.first.trials.iter().find(|t| t.trial == row.trial);
        let size = |e: &aloft_compare::WindowErrors| (e.windows > 0).then(|| e.size());
        let lost = view.left_out.iter().find(|l| l.trial == row.trial);
        let role = lost.map_or(row.role.to_owned(), |l| l.stage.map_or("left out".into(), |s| format!("{s} failed")));
        t.add_row([
            row.trial.clone(),
            role,
            row.flights.map_or("–".to_owned(), |n| n.to_string()),
            row.gravity_error_percent.map_or("–".to_owned(), |g| format!("{g:+.1}")),
            number(row.marker_rms_mm),
            number(errors.and_then(|e| size(&e.flight_weak))),
            number(errors.and_then(|e| size(&e.contact_weak))),
        ]);
    }
    out(format!("\n{t}\n"))
}

/// One breakdown: error, noise and the part that noise does not explain, on frames and over weak
/// windows.
fn groups(view: &ComparisonView, by: GroupedBy) -> Result<(), Stop> {
    let c = &view.comparison;
    let list: Vec<&Group> = c.first.breakdown.iter().filter(|g| g.by == by).collect();
    if list.is_empty() {
        return out(format!("by {}: only one group\n", by.word()));
    }
    let head = format!("by {}", by.word());
    let header = [
        head.as_str(),
        "windows",
        "error N",
        "floor N",
        "times floor",
        "explainable",
        "frames",
        "on frames N",
        "noise N",
        "on frames N·m",
        "noise N·m",
    ];
    let mut t = table(&header).optional(&[10, 9, 8, 7]);
    for g in list {
        let floor = g.floor(c.noise_floor.as_ref());
        let (on_frames, on_windows) = g.explainable(c.noise_floor.as_ref());
        let finite = |of: Option<f64>| number(of.filter(|x| x.is_finite()));
        let error = (g.windows.windows > 0).then(|| g.windows.size());
        let least = floor.filter(|f| f.windows.windows > 0).map(|f| f.windows.size());
        t.add_row([
            g.name.clone(),
            g.windows.windows.to_string(),
            finite(error),
            finite(least),
            error.zip(least).map_or("–".to_owned(), |(e, f)| significant(e / f, 2)),
            percent(on_windows.or(on_frames)),
            g.errors.frames.to_string(),
            finite(Some(g.errors.force_n.mean_mae())),
            finite(floor.map(|f| f.errors.force_n.mean_mae())),
            finite(Some(g.errors.moment_nm.mean_mae())),
            finite(floor.map(|f| f.errors.moment_nm.mean_mae())),
        ]);
    }
    out(format!("{t}\n"))
}

fn axes(view: &ComparisonView) -> Result<(), Stop> {
    let header = [
        "by axis (frames)",
        "force RMS N",
        "mean",
        "noise",
        "explainable",
        "moment RMS N·m",
        "mean",
        "noise",
        "explainable",
    ];
    let mut t = table(&header);
    for a in &view.comparison.axes {
        let [force, force_mean, force_noise] = a.force_n.map(|x| number(Some(x)));
        let [moment, moment_mean, moment_noise] = a.moment_nm.map(|x| number(Some(x)));
        t.add_row([
            format!("{} {}", a.axes, a.axis),
            force,
            force_mean,
            force_noise,
            percent(a.explainable[0]),
            moment,
            moment_mean,
            moment_noise,
            percent(a.explainable[1]),
        ]);
    }
    out(format!("{t}\n"))
}

fn segments(view: &ComparisonView) -> Result<(), Stop> {
    let first = &view.comparison.first;
    let contact = first.held_out.frames > 0 && !first.segments_in_flight.is_empty();
    let main = if contact { "contact" } else { "flight" };
    let one = |place: &str, list: &[SegmentShare]| {
        let head = format!("by segment, {place}");
        let mut t = table(&[
            head.as_str(),
            "inertia explains",
            "change kg",
            "change of m·c kg·m",
            "drag explains",
            "drag N s²/m²",
        ]);
        for s in list {
            let change = |i: usize| s.inertia_change.get(i).copied().unwrap_or(f64::NAN);
            t.add_row([
                s.link.clone(),
                percent(Some(s.inertia_share)),
                significant(change(0), 2),
                [1, 2, 3].map(|i| significant(change(i), 2)).join(" "),
                percent(Some(s.drag_share)),
                significant(s.drag_coefficient, 2),
            ]);
        }
        out(format!("{t}\n"))
    };
    one(main, &first.segments)?;
    if contact {
        one("flight", &first.segments_in_flight)?;
    }
    out(labelled(
        "",
        "Shares of the mean square error that a change of this link alone would explain; they overlap and do not add up.",
    ))
}
