//! Animated skeleton of a recording: measured and model markers, plate forces, and the external
//! force that the identified model requires.

use super::story::{Story, TrialStory};
use aloft_body::{Motion, State, Subject};
use aloft_flight::{PlateTare, apply_tare};
use aloft_page::{Animation, Arrows, Figure, Words};
use aloft_regressor::weak_windows::force_scale_n;
use aloft_trial::Trial;
use aloft_workspace::artifact::load_trial;
use aloft_workspace::json::read_json;
use nalgebra::Vector3;
use std::ops::Range;

/// Size limit for the animations of all recordings together, bytes of the page.
const ROOM: usize = 2_400_000;
/// Maximum frame rate of an animation, Hz.
const RATE_HZ: f64 = 30.0;
/// For objects with at most this many links, all markers are drawn to show the shape.
const FEW_LINKS: usize = 4;
/// Vertical force below which a plate's centre of pressure is meaningless, N.
const LOADED_N: f64 = 20.0;

/// The animation; none if the motion was not solved.
pub fn figure(story: &Story<'_>, t: &TrialStory<'_>) -> Option<Figure> {
    let (subject, motion) = (story.subject.as_ref()?, t.motion.as_ref()?);
    let mut trial = load_trial(&story.ws.place("import", &t.entry.name)).ok()?;
    if let Ok(tares) = read_json::<Vec<PlateTare>>(&story.ws.place("flight", &t.entry.name).join("tare.json")) {
        apply_tare(&mut trial, &tares);
    }
    let (range, step) = window(story, t, subject, motion);
    let weight = force_scale_n(subject.facts.mass_kg, story.session.facts.gravity_mps2);
    let mut a = Animation {
        bones: bones(subject),
        joint_names: joint_names(subject),
        labels: subject.markers.iter().map(|m| m.label.clone()).collect(),
        newtons_per_m: round_number(2.0 * weight),
        plates: trial.plates.iter().map(|p| p.corners_m.iter().map(|c| <[f64; 3]>::from(*c)).collect()).collect(),
        ..Animation::default()
    };
    let flights: Vec<Range<usize>> =
        t.flights.iter().flat_map(|r| &r.flights).map(aloft_flight::Flight::frames).collect();
    let asked = asked_force(t);
    let phi = subject.prior_phi();
    let (mut measured_force, mut model_force) = (Vec::new(), Vec::new());
    let mut state = State::new(&subject.model);
    let tips = tips(subject);
    let columns: Vec<Option<usize>> = subject.markers.iter().map(|m| trial.markers.index(&m.label)).collect();
    for f in range.clone().step_by(step).filter(|f| motion.is_valid(*f)) {
        state.forward_position(&subject.model, motion.q(f));
        a.times_s.push(f as f64 / motion.rate_hz);
        a.in_flight.push(flights.iter().any(|r| r.contains(&f)));
        let mut joints: Vec<[f64; 3]> = state.world_from_link.iter().map(|w| w.translation.vector.into()).collect();
        joints.extend(tips.iter().map(|(link, tip)| <[f64; 3]>::from(state.point_in_world(*link, tip))));
        a.joints.push(joints);
        a.modelled.push(subject.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m).into()).collect());
        let seen = |i: &Option<usize>| i.and_then(|i| trial.markers.position(i, f)).map_or([f64::NAN; 3], Into::into);
        a.measured.push(columns.iter().map(seen).collect());
        measured_force.push(plate_arrows(&trial, f as f64 / motion.rate_hz, a.newtons_per_m));
        let com = state.center_of_mass(&phi).1;
        let force = asked
            .as_ref()
            .and_then(|c| c.get(f))
            .map_or(Vector3::repeat(f64::NAN), |v| state.world_from_link[0].rotation * v);
        model_force.push(vec![[com.into(), (com + force / a.newtons_per_m).into()]]);
    }
    if a.times_s.is_empty() {
        return None;
    }
    // show first the middle of a flight, the most informative frame
    let from = range.start;
    a.first = flights
        .iter()
        .map(|r| (r.start + r.end) / 2)
        .find(|f| range.contains(f))
        .map_or(0, |f| (f - from) / step)
        .min(a.times_s.len() - 1);
    if !trial.plates.is_empty() {
        a.arrows.push(Arrows { name: "plate force, measured".into(), frames: measured_force });
    }
    if asked.is_some() {
        a.arrows.push(Arrows { name: "force that the identified body needs".into(), frames: model_force });
    }
    let shown = range.len() as f64 / motion.rate_hz;
    let arrows = match (trial.plates.is_empty(), asked.is_some()) {
        (false, true) => "; both kinds of arrow should agree on the ground and vanish in flight",
        (true, true) => "; the arrow should vanish in flight",
        _ => "",
    };
    let caption = format!(
        "{shown:.1} s of {:.1} s at {:.0} frames a second. Lines between filled and open markers are the model's error{arrows}.",
        motion.n_frames() as f64 / motion.rate_hz,
        motion.rate_hz / step as f64
    );
    Some(Figure::animation(Words::new(&format!("{}: markers, model and forces", t.entry.name), &caption), &a))
}

/// Frames to show, and the step between them: the whole recording if it fits, else the part around
/// its flights.
fn window(story: &Story<'_>, t: &TrialStory<'_>, subject: &Subject, motion: &Motion) -> (Range<usize>, usize) {
    let points = subject.model.n_links() + 6 + 2 * subject.markers.len() + 6;
    let frames = (ROOM / story.n_dynamic() / (points * 8)).clamp(48, 420);
    let n = motion.n_frames();
    let step = ((motion.rate_hz / RATE_HZ).round() as usize).max(1);
    if n <= frames * step {
        return (0..n, step);
    }
    let lead = (0.6 * motion.rate_hz) as usize;
    let all = t.flights.iter().flat_map(|r| &r.flights);
    let about = all.clone().map(|f| f.start).min().zip(all.map(|f| f.end).max());
    let (start, end) = about.map_or((0, n), |(a, b)| (a.saturating_sub(lead), (b + lead).min(n)));
    // lower the frame rate rather than cut the motion shorter
    let step = step.max((end - start).div_ceil(frames).min(2 * step));
    (start..end.min(start + frames * step), step)
}

/// External force required by the identified model, frame by frame, root axes.
fn asked_force(t: &TrialStory<'_>) -> Option<Vec<Vector3<f64>>> {
    let columns = t.series.as_ref()?;
    let axis = |a: &str| columns.get(&format!("identified.force_{a}_n"));
    let (x, y, z) = (axis("x")?, axis("y")?, axis("z")?);
    Some((0..x.len()).map(|f| Vector3::new(x[f], y[f], z[f])).collect())
}

/// One arrow per plate, at its centre of pressure on the floor.
fn plate_arrows(trial: &Trial, time_s: f64, newtons_per_m: f64) -> Vec<[[f64; 3]; 2]> {
    let none = [[f64::NAN; 3]; 2];
    let arrow = |p: &aloft_trial::Plate| {
        let i = (time_s * p.rate_hz).round() as usize;
        let (force, moment) = (p.force_n.get(i)?, p.moment_nm.get(i)?);
        let at = Vector3::new(-moment.y / force.z, moment.x / force.z, 0.0);
        (force.z > LOADED_N).then(|| [at.into(), (at + force / newtons_per_m).into()])
    };
    trial.plates.iter().map(|p| arrow(p).unwrap_or(none)).collect()
}

/// The nearest value of the form 1, 2 or 5 times a power of ten.
fn round_number(x: f64) -> f64 {
    let power = 10f64.powf(x.max(1e-9).log10().floor());
    let lead = x / power;
    power
        * if lead < 1.5 {
            1.0
        } else if lead < 3.5 {
            2.0
        } else if lead < 7.5 {
            5.0
        } else {
            10.0
        }
}

/// Ends of links that carry no other link: the marker farthest out. For objects with few links
/// every marker, so that they have a visible shape.
fn tips(subject: &Subject) -> Vec<(usize, Vector3<f64>)> {
    if subject.model.n_links() <= FEW_LINKS {
        return subject.markers.iter().map(|m| (m.link, m.position_m)).collect();
    }
    (0..subject.model.n_links())
        .filter(|i| !subject.model.links.iter().any(|l| l.parent == Some(*i)))
        .filter_map(|i| {
            let own = subject.markers.iter().filter(|m| m.link == i).map(|m| m.position_m);
            Some((i, own.max_by(|a, b| a.norm().total_cmp(&b.norm()))?))
        })
        .collect()
}

/// Origins of the links, followed by the ends from [`tips`].
fn joint_names(subject: &Subject) -> Vec<String> {
    let links = &subject.model.links;
    let ends =
        tips(subject).into_iter().enumerate().map(|(k, (link, _))| format!("end {} on {}", k + 1, links[link].name));
    links.iter().map(|l| format!("origin of {}", l.name)).chain(ends).collect()
}

fn bones(subject: &Subject) -> Vec<(usize, usize)> {
    let n = subject.model.n_links();
    let links = subject.model.links.iter().enumerate();
    let mut out: Vec<(usize, usize)> = links.filter_map(|(i, l)| l.parent.map(|p| (p, i))).collect();
    out.extend(tips(subject).iter().enumerate().map(|(k, (link, _))| (*link, n + k)));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrows_have_round_scales() {
        for (x, y) in [(1178.0, 1000.0), (34.0, 20.0), (0.6, 0.5), (8.0, 10.0)] {
            assert!((round_number(x) - y).abs() < 1e-9, "{x}");
        }
    }
}
