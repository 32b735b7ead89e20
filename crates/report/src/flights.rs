//! Mean and standard deviation over flights: residual wrench in the air, and joint angles.

use super::series::COMPONENTS;
use super::story::{Story, TrialStory};
use super::wording::count;
use aloft_analysis::wording::model_word;
use aloft_body::State;
use aloft_page::{Band, Block, Figure, Panel, Section, Words};
use std::collections::BTreeMap;
use std::ops::Range;

/// Number of points per flight.
const POINTS: usize = 51;

/// The section; none with fewer than two flights.
pub fn section(story: &Story<'_>) -> Option<Section> {
    let n: usize = story.dynamic().filter_map(TrialStory::n_flights).sum();
    if n < 2 {
        return None;
    }
    let mut blocks: Vec<Block> = Vec::new();
    blocks.extend(residuals(story).map(Block::from));
    blocks.extend(angles(story).map(Block::from));
    (!blocks.is_empty()).then(|| {
        Section::new(
            "over-flights",
            "Over all flights",
            &format!("Mean and one standard deviation over {}, each stretched to its own length.", count(n, "flight")),
            blocks,
        )
    })
}

/// Resamples a range to `POINTS` values by linear interpolation.
fn stretched(values: &[f64], range: &Range<usize>) -> Vec<f64> {
    let (first, span) = (range.start as f64, (range.len() - 1) as f64);
    (0..POINTS)
        .map(|i| {
            let at = first + span * i as f64 / (POINTS - 1) as f64;
            let (low, share) = (at.floor() as usize, at.fract());
            let (Some(a), Some(b)) = (values.get(low), values.get((low + 1).min(range.end - 1))) else {
                return f64::NAN;
            };
            if share == 0.0 { *a } else { a + share * (b - a) }
        })
        .collect()
}

/// Mean and standard deviation at each point, over the curves that have a value there.
fn band(name: &str, curves: &[Vec<f64>], colour: Option<&'static str>) -> Band {
    let x = (0..POINTS).map(|i| 100.0 * i as f64 / (POINTS - 1) as f64).collect();
    let (mut mean, mut sd) = (Vec::new(), Vec::new());
    for i in 0..POINTS {
        let values: Vec<f64> = curves.iter().map(|c| c[i]).filter(|v| v.is_finite()).collect();
        let n = values.len() as f64;
        let m = values.iter().sum::<f64>() / n;
        mean.push(m);
        sd.push((values.iter().map(|v| (v - m).powi(2)).sum::<f64>() / (n - 1.0)).sqrt());
    }
    Band { name: name.to_owned(), x, mean, sd, colour }
}

fn ranges<'b>(t: &'b TrialStory<'_>) -> impl Iterator<Item = Range<usize>> + 'b {
    t.flights.iter().flat_map(|r| r.flights.iter().map(aloft_flight::Flight::frames)).filter(|r| r.len() > 2)
}

/// Residual wrench of the models in flight.
fn residuals(story: &Story<'_>) -> Option<Figure> {
    let collect = |model: &str, key: &str| -> Vec<Vec<f64>> {
        story
            .dynamic()
            .filter_map(|t| Some((t, t.series.as_ref()?.get(&format!("{model}.{key}"))?)))
            .flat_map(|(t, values)| ranges(t).map(|r| stretched(values, &r)).collect::<Vec<_>>())
            .collect()
    };
    let panels: Vec<Panel> = COMPONENTS
        .iter()
        .map(|(key, title, unit)| {
            let bands = [("prior", "c1"), ("identified", "c0")]
                .into_iter()
                .map(|(model, colour)| (model, collect(model, key), colour))
                .filter(|(_, curves, _)| curves.len() > 1)
                .map(|(model, curves, colour)| band(model_word(model), &curves, Some(colour)))
                .collect();
            Panel { title: (*title).to_owned(), y: format!("{unit}, root axes"), bands, ..Panel::default() }
        })
        .collect();
    let words = Words::new(
        "Residual wrench in flight",
        "External wrench required by the recorded motion beyond the modelled effects; zero for a perfect model. A mean away from zero is an error that all \
         flights share; a wide band is noise, or what differs from flight to flight. At the edges the filter mixes flight with contact.",
    );
    panels.iter().any(|p| !p.bands.is_empty()).then(|| Figure::panels(words, "flight, %", 2, &panels, &[]))
}

/// Flexion of each joint by link: the angle of a hinge; for other joints the first of the angles
/// about z, x, y (of the child relative to its parent).
fn flexion(story: &Story<'_>, t: &TrialStory<'_>) -> Option<Vec<Vec<f64>>> {
    let (motion, model) = (t.motion.as_ref()?, &story.subject.as_ref()?.model);
    let mut state = State::new(model);
    let mut out = vec![vec![f64::NAN; motion.n_frames()]; model.n_links()];
    for r in ranges(t) {
        for f in r.filter(|f| motion.is_valid(*f)) {
            state.forward_position(model, motion.q(f));
            for (i, link) in model.links.iter().enumerate() {
                let Some(parent) = link.parent else { continue };
                let turn = state.world_from_link[parent].rotation.inverse() * state.world_from_link[i].rotation;
                let m = turn.to_rotation_matrix();
                out[i][f] = (-m[(0, 1)]).atan2(m[(1, 1)]).to_degrees();
            }
        }
    }
    Some(out)
}

fn side(link: &str) -> (&str, &str) {
    match link.rsplit_once('_') {
        Some((stem, "r")) => (stem, "right"),
        Some((stem, "l")) => (stem, "left"),
        _ => (link, ""),
    }
}

/// Joint angles.
fn angles(story: &Story<'_>) -> Option<Figure> {
    let model = &story.subject.as_ref()?.model;
    let mut curves: BTreeMap<usize, Vec<Vec<f64>>> = BTreeMap::new();
    for t in story.dynamic() {
        let Some(all) = flexion(story, t) else { continue };
        for r in ranges(t) {
            for (i, values) in all.iter().enumerate().filter(|(i, _)| model.links[*i].parent.is_some()) {
                curves.entry(i).or_default().push(stretched(values, &r));
            }
        }
    }
    let mut panels: Vec<Panel> = Vec::new();
    for (i, list) in curves.iter().filter(|(_, l)| l.len() > 1) {
        let (stem, side) = side(&model.links[*i].name);
        let title = joint_name(stem);
        let named = if side.is_empty() { "mean ± SD" } else { side };
        let colour = if side == "left" { "c1" } else { "c0" };
        let one = band(named, list, Some(colour));
        match panels.iter_mut().find(|p| p.title == title) {
            Some(p) => p.bands.push(one),
            None => panels.push(Panel { title, y: "°".into(), bands: vec![one], ..Panel::default() }),
        }
    }
    let words = Words::new(
        "Joint angles in flight",
        "Flexion about the link's z axis (positive as the link's axes say; for the knee flexion is negative), zero in the neutral posture. Left and \
         right should be alike in symmetric jumps.",
    );
    let columns = panels.len().clamp(1, 4);
    (!panels.is_empty()).then(|| Figure::panels(words, "flight, %", columns, &panels, &[]))
}

/// Name of the joint that connects a link of the human model to its parent; for other links, the
/// link's own name.
fn joint_name(stem: &str) -> String {
    match stem {
        "torso" => "Lumbar",
        "head" => "Neck",
        "upper_arm" => "Shoulder",
        "forearm" => "Elbow",
        "hand" => "Wrist",
        "thigh" => "Hip",
        "shank" => "Knee",
        "foot" => "Ankle",
        other => return format!("Joint of {}", other.replace('_', " ")),
    }
    .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flights_are_stretched_from_edge_to_edge() {
        let values: Vec<f64> = (0..20).map(f64::from).collect();
        let s = stretched(&values, &(4..15));
        assert_eq!((s[0], s[POINTS - 1]), (4.0, 14.0));
        assert!((s[25] - 9.0).abs() < 1e-12);
    }

    #[test]
    fn bands_are_mean_and_standard_deviation_of_what_is_there() {
        let b = band("b", &[vec![1.0; POINTS], vec![3.0; POINTS], vec![f64::NAN; POINTS]], None);
        assert_eq!(b.mean[7], 2.0);
        assert!((b.sd[7] - 2.0_f64.sqrt()).abs() < 1e-12);
    }
}
