//! Curves of one recording, thinned to a resolution suitable for the screen.

use super::place_errors::errors_by_place;
use super::story::{Story, TrialStory};
use aloft_analysis::wording::model_word;
use aloft_body::State;
use aloft_page::{Chart, Figure, Focus, Panel, Series, Shade, Words};
use nalgebra::Vector3;

/// Column, title and unit of the six components, root axes.
pub const COMPONENTS: [(&str, &str, &str); 6] = [
    ("force_x_n", "Force x", "N"),
    ("force_y_n", "Force y", "N"),
    ("force_z_n", "Force z", "N"),
    ("moment_x_nm", "Moment x", "N·m"),
    ("moment_y_nm", "Moment y", "N·m"),
    ("moment_z_nm", "Moment z", "N·m"),
];

/// Size limit for the curves of all recordings together, bytes of the page.
const ROOM: usize = 2_000_000;

/// Number of points per curve, chosen so that all recordings fit into the page.
pub fn points_for(n_trials: usize) -> usize {
    // 18 curves per recording, 16/3 bytes per point
    (ROOM / (n_trials.max(1) * 18 * 16 / 3)).clamp(120, 800)
}

/// Takes every k-th value so that about `points` remain. The curves are low-pass filtered far below
/// the thinned rate.
pub fn thin(values: &[f64], points: usize) -> Vec<f64> {
    values.iter().step_by(values.len().div_ceil(points.max(1)).max(1)).copied().collect()
}

/// Flights as time intervals, from a mask over frames.
pub fn shades(time: &[f64], in_flight: &[f64]) -> Vec<Shade> {
    let mut out = Vec::new();
    let mut start = None;
    for i in 0..=time.len().min(in_flight.len()) {
        let on = i < time.len() && in_flight.get(i).is_some_and(|f| *f > 0.5);
        match (start, on) {
            (None, true) => start = Some(time[i]),
            (Some(s), false) => {
                out.push(Shade { from: s, to: time[i - 1] });
                start = None;
            }
            _ => {}
        }
    }
    out
}

/// Reading of a recording's plates at rest, in root axes about the root origin,
/// `[component][frame]`; none if the plates were tared.
fn offset(story: &Story<'_>, t: &TrialStory<'_>) -> Option<[Vec<f64>; 6]> {
    let trials = &story.comparison.as_ref()?.comparison.first.trials;
    let offset = trials.iter().find(|c| c.trial == t.entry.name && c.untared)?.offset.as_ref()?;
    let (motion, model) = (t.motion.as_ref()?, &story.subject.as_ref()?.model);
    let (force, moment) = (Vector3::from(offset.force_n), Vector3::from(offset.moment_nm));
    let mut state = State::new(model);
    let mut out: [Vec<f64>; 6] = Default::default();
    for f in 0..motion.n_frames() {
        let (mut own_force, mut own_moment) = (Vector3::repeat(f64::NAN), Vector3::repeat(f64::NAN));
        if motion.is_valid(f) {
            state.forward_position(model, motion.q(f));
            let root = &state.world_from_link[0];
            own_force = root.rotation.inverse() * force;
            own_moment = root.rotation.inverse() * (moment - root.translation.vector.cross(&force));
        }
        for k in 0..3 {
            out[k].push(own_force[k]);
            out[k + 3].push(own_moment[k]);
        }
    }
    Some(out)
}

/// Measured and predicted wrench of a recording: six components, flights shaded.
pub fn wrench(story: &Story<'_>, t: &TrialStory<'_>) -> Option<Figure> {
    let points = points_for(story.n_dynamic());
    let offset = offset(story, t);
    let columns = t.series.as_ref()?;
    let (time, in_flight) = (columns.get("time_s")?, columns.get("in_flight")?);
    let x = thin(time, points);
    let has_plates =
        columns.get("measured.force_z_n").is_some_and(|v| v.iter().any(|f| f.is_finite() && f.abs() > 1e-9));
    let styles = [("prior", "c1"), ("identified", "c0"), ("measured", "ink")];
    let panels: Vec<Panel> = COMPONENTS
        .iter()
        .enumerate()
        .map(|(k, (key, title, unit))| {
            let series = styles
                .iter()
                .filter_map(|(model, colour)| {
                    let values = columns.get(&format!("{model}.{key}"))?;
                    let mut y = thin(values, points);
                    if let (Some(offset), true) = (&offset, *model == "measured") {
                        y.iter_mut().zip(thin(&offset[k], points)).for_each(|(y, o)| *y -= o);
                    }
                    let line = Series::line(model_word(model), x.clone(), y).coloured(colour);
                    Some(if *model == "prior" { line.dashed() } else { line })
                })
                .collect();
            Panel { title: (*title).to_owned(), y: format!("{unit}, root axes"), series, ..Panel::default() }
        })
        .collect();
    let caption = if has_plates {
        "External wrench on the root, root axes, about the root's origin. Where the lines of model and measurement coincide, the model explains \
         the forces; in flight (shaded) both are zero for a perfect model."
    } else {
        "External wrench that the model needs for the motion, root axes, about the root's origin. In flight (shaded) it is zero for a \
         perfect model; outside, unmeasured hand or ground contact acts."
    };
    let taken = if offset.is_some() {
        " The plates were never unloaded: the constant wrench that they read at rest, as the model finds it, is taken off."
    } else {
        ""
    };
    let caption = &format!("{caption}{taken}");
    let title = format!("{}: measured and predicted wrench", t.entry.name);
    let judged_in_flight = errors_by_place(story).first().is_none_or(|s| s.place == "flight");
    let shades = shades(time, in_flight);
    let chart = Chart {
        x: "time, s",
        columns: 2,
        panels: &panels,
        shades: &shades,
        recording: &t.entry.name,
        // without plates nothing outside flights can be compared
        focus: if !shades.is_empty() && (judged_in_flight || !has_plates) { Focus::Flight } else { Focus::All },
    };
    Some(Figure::chart(Words::new(&title, caption), &chart))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flights_are_found_at_both_ends() {
        let time = [0.0, 0.1, 0.2, 0.3, 0.4];
        let s = shades(&time, &[1.0, 1.0, 0.0, 0.0, 1.0]);
        assert_eq!(s, vec![Shade { from: 0.0, to: 0.1 }, Shade { from: 0.4, to: 0.4 }]);
    }

    #[test]
    fn twenty_recordings_share_the_room() {
        let points = points_for(20);
        assert!(points * 20 * 18 * 16 / 3 <= ROOM && points > 500, "{points}");
        assert_eq!(thin(&(0..1999).map(f64::from).collect::<Vec<_>>(), 800).len(), 667);
    }
}
