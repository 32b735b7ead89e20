//! The comparison as tables: the distribution of the error, and the part that noise does not
//! explain.

use crate::args::ByArg;
use crate::render::{out, significant, table};
use crate::show::{brief, three};
use crate::stop::Stop;
use aloft_analysis::compare::ComparisonView;
use aloft_compare::{Group, GroupedBy, SegmentShare};
use comfy_table::CellAlignment;

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

/// The whole comparison, or the requested breakdowns.
pub fn comparison(view: &ComparisonView, by: &[ByArg]) -> Result<(), Stop> {
    let c = &view.comparison;
    if by.is_empty() {
        brief(view)?;
        trials(view)?;
        if let Some(calibration) = &view.calibration {
            crate::show_estimators::calibration(calibration)?;
        }
        if let Some(weighed) = &view.impulse_mass {
            crate::show_estimators::impulse_mass(weighed)?;
        }
        let f = &c.first.flight;
        out(format!(
            "residual wrench in flight, RMS: force {} N, moment {} N·m ({} frames)\n",
            three(&f.residual_force_n.rms),
            three(&f.residual_moment_nm.rms),
            f.frames
        ))?;
        for line in &c.words {
            out(line)?;
        }
        out("")?;
    }
    for what in if by.is_empty() { &ALL[1..] } else { by } {
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
    let header = ["trial", "role", "marker RMS mm", "flights", "fall vs g %", "contact N", "N·m", "flight N", "N·m"];
    let mut t = table(&header);
    for row in &view.kinematics {
        let errors = c.first.trials.iter().find(|t| t.trial == row.trial);
        t.add_row([
            row.trial.clone(),
            row.role.to_owned(),
            number(row.marker_rms_mm),
            row.flights.map_or("–".to_owned(), |n| n.to_string()),
            number(row.gravity_error_percent),
            number(errors.map(|e| e.contact.force_n.mean_mae())),
            number(errors.map(|e| e.contact.moment_nm.mean_mae())),
            number(errors.map(|e| e.flight.force_n.mean_mae())),
            number(errors.map(|e| e.flight.moment_nm.mean_mae())),
        ]);
    }
    out(format!("\n{t}"))
}

/// One breakdown: error, noise and the part that noise does not explain, on frames and over weak
/// windows.
fn groups(view: &ComparisonView, by: GroupedBy) -> Result<(), Stop> {
    let c = &view.comparison;
    let list: Vec<&Group> = c.first.breakdown.iter().filter(|g| g.by == by).collect();
    if list.is_empty() {
        return out(format!("by {}: nothing to tell apart\n", by.word()));
    }
    let head = format!("by {}", by.word());
    let header = [
        head.as_str(),
        "frames",
        "force N",
        "noise",
        "moment N·m",
        "noise",
        "explainable",
        "windows",
        "force N",
        "noise",
        "moment N·m",
        "noise",
        "explainable",
    ];
    let mut t = table(&header);
    for g in list {
        let floor = g.floor(c.noise_floor.as_ref());
        let (on_frames, on_windows) = g.explainable(c.noise_floor.as_ref());
        let mae = |of: Option<f64>| number(of.filter(|x| x.is_finite()));
        t.add_row([
            g.name.clone(),
            g.errors.frames.to_string(),
            mae(Some(g.errors.force_n.mean_mae())),
            mae(floor.map(|f| f.errors.force_n.mean_mae())),
            mae(Some(g.errors.moment_nm.mean_mae())),
            mae(floor.map(|f| f.errors.moment_nm.mean_mae())),
            percent(on_frames),
            g.windows.windows.to_string(),
            mae(Some(g.windows.force_n.mean_mae())),
            mae(floor.map(|f| f.windows.force_n.mean_mae())),
            mae(Some(g.windows.moment_nm.mean_mae())),
            mae(floor.map(|f| f.windows.moment_nm.mean_mae())),
            percent(on_windows),
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
        if let Some(column) = t.column_mut(0) {
            column.set_cell_alignment(CellAlignment::Left);
        }
        out(format!("{t}\n"))
    };
    one(main, &first.segments)?;
    if contact {
        one("flight", &first.segments_in_flight)?;
    }
    out(
        "Shares of the mean square error that a change of this link alone would explain; they overlap and do not add up.\n",
    )
}
