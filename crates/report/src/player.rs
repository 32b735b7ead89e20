//! The player of a recording: segments with the error that they could carry, markers, measured and
//! predicted force at one point, effects of the model, and the body without them.

use super::drawn_effects::{self, Drawn};
use super::place_errors::errors_by_place;
use super::story::{Story, TrialStory};
use aloft_body::{LinkInertia, Motion, State, Subject};
use aloft_flight::{Flight, PlateTare, apply_tare};
use aloft_page::{Animation, ArrowOf, Arrows, Figure, PointOn, Segment, Words};
use aloft_regressor::weak_windows::force_scale_n;
use aloft_trial::Trial;
use aloft_workspace::artifact::load_trial;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use nalgebra::{Matrix3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};
use std::ops::Range;

/// Size limit for the animations of all recordings together, bytes of the page.
const ROOM: usize = 2_400_000;
/// Maximum frame rate of an animation, Hz.
const RATE_HZ: f64 = 30.0;
/// For objects with at most this many links, all markers are drawn to show the shape.
const FEW_LINKS: usize = 4;
/// Vertical force below which a centre of pressure is meaningless, N.
const LOADED_N: f64 = 20.0;
/// Longest arrow of a typical force in flight, as a share of the body's reach.
const ARROW_SHARE: f64 = 0.5;

/// The player; none if the motion was not solved, and for the log of a robot.
///
/// # Errors
/// The recording was imported and cannot be read.
pub fn figure(story: &Story<'_>, t: &TrialStory<'_>) -> Result<Option<Figure>, PipelineError> {
    let place = story.ws.place("import", &t.entry.name);
    let (Some(subject), Some(motion)) = (&story.subject, &t.motion) else { return Ok(None) };
    if !is_there(&place.join("trial.json"))? {
        return Ok(None);
    }
    let mut trial = load_trial(&place)?;
    let tares: Option<Vec<PlateTare>> = read_json_if_there(&story.ws.place("flight", &t.entry.name).join("tare.json"))?;
    if let Some(tares) = tares {
        apply_tare(&mut trial, &tares);
    }
    Ok(animation(story, t, subject, motion, &trial))
}

/// The player with a recording whose plates are tared; none without a frame to show.
fn animation(
    story: &Story<'_>,
    t: &TrialStory<'_>,
    subject: &Subject,
    motion: &Motion,
    trial: &Trial,
) -> Option<Figure> {
    let flights: &[Flight] = t.flights.as_ref().map_or(&[], |r| &r.flights);
    let corners = |p: &aloft_trial::Plate| p.corners_m.iter().map(|c| <[f64; 3]>::from(*c)).collect::<Vec<_>>();
    let plates: Vec<Vec<[f64; 3]>> = trial.plates.iter().map(corners).filter(|c| c.len() == 4).collect();
    let centre = |c: &Vec<[f64; 3]>| c.iter().map(|p| Vector3::from(*p)).sum::<Vector3<f64>>() / c.len() as f64;
    let centres: Vec<Vector3<f64>> = plates.iter().map(centre).collect();
    let drawn = drawn_effects::drawn(story, subject, motion, flights, &centres);
    let with_forces = story.session.effects.iter().any(|e| !e.is_of_joints());
    let ghost =
        with_forces.then(|| drawn_effects::ghost(&drawn.total_n, flights, subject.facts.mass_kg, motion.rate_hz));
    let (range, step) = window(story, t, subject, motion, &drawn);
    let frames: Vec<usize> = range.clone().step_by(step).filter(|f| motion.is_valid(*f)).collect();
    if frames.is_empty() {
        return None;
    }
    let mut a = Animation {
        recording: t.entry.name.clone(),
        segments: segments(story, subject),
        ends: ends(subject),
        markers: subject
            .markers
            .iter()
            .map(|m| PointOn { name: m.label.clone(), segment: m.link, at_m: m.position_m.into() })
            .collect(),
        masses: drawn.masses.clone(),
        unplaced: drawn.unplaced.clone(),
        plates_complete: !trial.plates.is_empty(),
        plates,
        ..Animation::default()
    };
    let phi = story
        .found
        .as_ref()
        .filter(|f| f.parameters.links.len() == subject.model.n_links())
        .map_or_else(|| subject.prior_phi(), |f| f.parameters.links.iter().map(|l| l.inertia().to_phi()).collect());
    let columns: Vec<Option<usize>> = subject.markers.iter().map(|m| trial.markers.index(&m.label)).collect();
    let forces = Forces::of(story, t);
    let (mut measured, mut predicted) = (Vec::new(), Vec::new());
    let mut state = State::new(&subject.model);
    for &f in &frames {
        state.forward_position(&subject.model, motion.q(f));
        a.times_s.push(f as f64 / motion.rate_hz);
        a.in_flight.push(flights.iter().any(|x| x.frames().contains(&f)));
        a.origins.push(state.world_from_link.iter().map(|w| w.translation.vector.into()).collect());
        let turn = |w: &nalgebra::Isometry3<f64>| {
            let q = w.rotation;
            [q.i, q.j, q.k, q.w]
        };
        a.turns.push(state.world_from_link.iter().map(turn).collect());
        let seen = |i: &Option<usize>| i.and_then(|i| trial.markers.position(i, f)).map_or([f64::NAN; 3], Into::into);
        a.measured.push(columns.iter().map(seen).collect());
        let com = state.centre_of_mass(&phi).1;
        a.com_m.push(com.into());
        a.ghost_m.extend(ghost.iter().map(|g| <[f64; 3]>::from(g[f])));
        // both forces at one point: the centre of pressure, or the centre of mass where nothing
        // presses
        let turned = &state.world_from_link[0].rotation;
        let at = pressure(trial, f as f64 / motion.rate_hz).unwrap_or(com);
        let arrow =
            |force: Option<Vector3<f64>>| force.map_or([[f64::NAN; 3]; 2], |v| [at.into(), (turned * v).into()]);
        let own = forces.measured(f, turned).filter(|v| v.norm() > 1e-9);
        measured.push(vec![arrow(own)]);
        predicted.push(vec![arrow(forces.predicted(f))]);
    }
    a.first = first(story, &frames, flights, &measured, &predicted, &drawn);
    a.newtons_per_m = scales(story, subject, &a, &predicted, &drawn, &frames);
    let some = |list: &[Vec<[[f64; 3]; 2]>]| list.iter().flatten().any(|x| x[1][0].is_finite());
    if a.plates_complete && some(&measured) {
        a.arrows.push(Arrows { name: "measured".into(), of: ArrowOf::Measured, frames: measured, ..Arrows::default() });
    }
    let has_model = some(&predicted);
    if has_model {
        a.arrows.push(Arrows { name: "model".into(), of: ArrowOf::Predicted, frames: predicted, ..Arrows::default() });
    }
    for kind in drawn.arrows {
        let own: Vec<_> = frames.iter().map(|f| kind.frames[*f].clone()).collect();
        a.arrows.push(Arrows { frames: own, ..kind });
    }
    let caption = caption(&a, motion, range.len(), step, has_model, with_forces);
    Some(Figure::animation(Words::new(&format!("{}: motion and forces", t.entry.name), &caption), &a))
}

fn caption(a: &Animation, motion: &Motion, shown: usize, step: usize, has_model: bool, effects: bool) -> String {
    let mut text =
        format!("{:.1} s of {:.1} s", shown as f64 / motion.rate_hz, motion.n_frames() as f64 / motion.rate_hz);
    if step > 1 {
        text.push_str(&format!(" at {:.0} frames a second", motion.rate_hz / step as f64));
    }
    text.push('.');
    if has_model {
        text.push_str(match (a.plates_complete, effects) {
            (true, _) => {
                " On the plates both arrows should agree, in flight the model's should be short. Single frames err much more than the windows of \
                 the numbers above, because their accelerations are noisy."
            }
            (false, effects) => match effects {
                false => " In flight the model's arrow should be short. Single frames err much more than the windows of the numbers above.",
                true => {
                    " In flight the model's arrow, what remains beside the effects, should be short. Single frames err much more than the \
                     windows of the numbers above."
                }
            },
        });
    }
    text
}

/// Columns of the comparison of one recording.
struct Forces<'s> {
    columns: Option<&'s std::collections::HashMap<String, Vec<f64>>>,
    offset: Vector3<f64>,
}

impl<'s> Forces<'s> {
    fn of(story: &'s Story<'_>, t: &'s TrialStory<'_>) -> Self {
        let offset = story.comparison.as_ref().and_then(|v| {
            let own = v.comparison.first.trials.iter().find(|c| c.trial == t.entry.name && c.untared)?;
            Some(Vector3::from(own.offset.as_ref()?.force_n))
        });
        Self { columns: t.series.as_ref(), offset: offset.unwrap_or_default() }
    }
    fn at(&self, kind: &str, f: usize) -> Option<Vector3<f64>> {
        let axis = |a: &str| self.columns?.get(&format!("{kind}.force_{a}_n"))?.get(f).copied();
        let v = Vector3::new(axis("x")?, axis("y")?, axis("z")?);
        v.iter().all(|x| x.is_finite()).then_some(v)
    }
    /// Root axes, N.
    fn predicted(&self, f: usize) -> Option<Vector3<f64>> {
        self.at("identified", f)
    }
    /// Root axes, N, without the constant of plates that were never unloaded.
    fn measured(&self, f: usize, turned: &UnitQuaternion<f64>) -> Option<Vector3<f64>> {
        Some(self.at("measured", f)? - turned.inverse() * self.offset)
    }
}

/// Centre of pressure of all plates together at the height of the plates, m; none where they are
/// not loaded.
fn pressure(trial: &Trial, time_s: f64) -> Option<Vector3<f64>> {
    let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
    let (mut height, mut weight) = (0.0, 0.0);
    for p in &trial.plates {
        let i = (time_s * p.rate_hz).round() as usize;
        let (own, about) = (p.force_n.get(i)?, p.moment_nm.get(i)?);
        if own.z > LOADED_N {
            let z = p.corners_m.iter().map(|c| c.z).sum::<f64>() / p.corners_m.len().max(1) as f64;
            (height, weight) = (height + z * own.z, weight + own.z);
            force += own;
            moment += about;
        }
    }
    (force.z > LOADED_N).then(|| {
        let z: f64 = height / weight;
        Vector3::new((z * force.x - moment.y) / force.z, (moment.x + z * force.y) / force.z, z)
    })
}

/// Segments as ellipsoids of their prior inertia, with the error that each could carry.
fn segments(story: &Story<'_>, subject: &Subject) -> Vec<Segment> {
    let heat = heat(story);
    let reach: f64 = subject.markers.iter().map(|m| m.position_m.norm()).fold(0.05, f64::max);
    subject
        .model
        .links
        .iter()
        .zip(&subject.prior)
        .enumerate()
        .map(|(i, (link, inertia))| {
            // small bones of OpenSim's models have the inertia of something much larger
            let most = extent(subject, i).map_or(1.5 * reach, |own| own.min(1.5 * reach));
            let (turn, radii_m) = ellipsoid(inertia, reach, most);
            Segment {
                name: link.name.clone(),
                parent: link.parent,
                centre_m: inertia.com_m.into(),
                turn: [turn.i, turn.j, turn.k, turn.w],
                radii_m: radii_m.into(),
                heat: heat.iter().find(|h| h.0 == link.name).map(|h| h.1),
            }
        })
        .collect()
}

/// How far joints to further links, markers and the centre of mass are from a link's origin, m;
/// none for a last link without markers, whose size nothing tells.
fn extent(subject: &Subject, link: usize) -> Option<f64> {
    let joints = subject
        .model
        .links
        .iter()
        .filter(|l| l.parent == Some(link))
        .map(|l| l.joint.parent_from_joint.translation.vector.norm());
    let markers = subject.markers.iter().filter(|m| m.link == link).map(|m| m.position_m.norm());
    let far = joints.chain(markers).filter(|d| d.is_finite()).fold(0.0, f64::max);
    (far > 0.0).then(|| far.max(subject.prior[link].com_m.norm()))
}

/// The uniform ellipsoid with an inertia: its axes and semi-axes, m. Semi-axes that no body has are
/// limited to `most`; `reach` is the size of the whole.
fn ellipsoid(inertia: &LinkInertia, reach: f64, most: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
    let own = SymmetricEigen::new(inertia.inertia_com_kgm2);
    let mut axes: Matrix3<f64> = own.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.column_mut(2).neg_mut();
    }
    let i = own.eigenvalues;
    // a² = 5 / (2 m) (I_b + I_c − I_a)
    let radius = |k: usize| (2.5 / inertia.mass_kg.max(1e-9) * (i.sum() - 2.0 * i[k])).max(0.0).sqrt();
    let most = (0..3).map(radius).fold(0.0, f64::max).min(most).max(0.1 * reach);
    let radii = Vector3::from_fn(|k, _| radius(k).clamp(0.12 * most, most));
    (UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)), radii)
}

/// Link and the error that a change of its parameters could carry, in multiples of the noise floor;
/// empty if the floor is not known.
fn heat(story: &Story<'_>) -> Vec<(String, f64)> {
    let all = errors_by_place(story);
    let (Some(first), Some(view)) = (all.first(), &story.comparison) else { return Vec::new() };
    let (Some(ratio), c) = (first.ratio, &view.comparison.first) else { return Vec::new() };
    // at the floor nothing is left that a segment could carry
    let ratio = if first.at_floor { ratio.min(1.0) } else { ratio };
    let shares =
        if first.place == "flight" && !c.segments_in_flight.is_empty() { &c.segments_in_flight } else { &c.segments };
    shares
        .iter()
        .filter(|s| s.inertia_share.is_finite())
        .map(|s| (s.link.clone(), ratio * s.inertia_share.max(s.drag_share).max(0.0).sqrt()))
        .collect()
}

/// The frame shown first: where most acts in the middle part of a flight if the model is judged in
/// flight, else the largest measured force.
fn first(
    story: &Story<'_>,
    frames: &[usize],
    flights: &[Flight],
    measured: &[Vec<[[f64; 3]; 2]>],
    predicted: &[Vec<[[f64; 3]; 2]>],
    drawn: &Drawn,
) -> usize {
    let in_flight = errors_by_place(story).first().is_none_or(|s| s.place == "flight");
    let size = |a: &[[f64; 3]; 2]| Some(Vector3::from(a[1]).norm()).filter(|v| v.is_finite()).unwrap_or(0.0);
    let pressed = |i: &usize| measured[*i].first().map_or(0.0, size);
    let most = |of: &dyn Fn(&usize) -> f64, among: &dyn Fn(&usize) -> bool| {
        (0..frames.len()).filter(among).max_by(|a, b| of(a).total_cmp(&of(b)))
    };
    // near take-off and landing the filter mixes in contact
    let inner = |i: &usize| {
        flights.iter().any(|f| {
            let edge = (f.end - f.start) * 3 / 10;
            (f.start + edge..f.end - edge).contains(&frames[*i])
        })
    };
    let effects = |i: &usize| -> f64 { drawn.arrows.iter().flat_map(|k| &k.frames[frames[*i]]).map(size).sum() };
    let acting = |i: &usize| if drawn.arrows.is_empty() { predicted[*i].first().map_or(0.0, size) } else { effects(i) };
    let on_plates = most(&pressed, &|i| pressed(i) > LOADED_N);
    let in_air = most(&acting, &inner);
    let chosen = if in_flight { in_air.or(on_plates) } else { on_plates.or(in_air) };
    chosen.unwrap_or(frames.len() / 2)
}

/// Newtons for a metre of arrow: on the ground twice the weight, in flight so that what acts there
/// can be seen.
fn scales(
    story: &Story<'_>,
    subject: &Subject,
    a: &Animation,
    predicted: &[Vec<[[f64; 3]; 2]>],
    drawn: &Drawn,
    frames: &[usize],
) -> [f64; 2] {
    let ground = round_number(2.0 * force_scale_n(subject.facts.mass_kg, story.session.facts.gravity_mps2));
    let largest = |list: &[[[f64; 3]; 2]]| {
        list.iter().map(|x| Vector3::from(x[1]).norm()).filter(|v| v.is_finite()).reduce(f64::max)
    };
    let effects: Vec<&Arrows> = drawn.arrows.iter().filter(|k| k.of == ArrowOf::Effect).collect();
    let mut sizes: Vec<f64> = Vec::new();
    for (i, &f) in frames.iter().enumerate().filter(|(i, _)| a.in_flight[*i]) {
        // effects set the scale where there are any: what the model leaves beside them is smaller
        if effects.is_empty() {
            sizes.extend(largest(&predicted[i]));
        }
        sizes.extend(effects.iter().filter_map(|k| largest(&k.frames[f])));
    }
    sizes.retain(|v| v.is_finite());
    sizes.sort_by(f64::total_cmp);
    let Some(typical) = sizes.get(sizes.len() * 3 / 4).filter(|v| **v > 0.0) else { return [ground; 2] };
    let low = a
        .origins
        .iter()
        .zip(&a.com_m)
        .flat_map(|(o, c)| o.iter().map(move |p| (Vector3::from(*p) - Vector3::from(*c)).norm()));
    let reach = low.filter(|v| v.is_finite()).fold(0.1, f64::max);
    [ground, round_number(typical / (ARROW_SHARE * reach)).min(ground)]
}

/// Frames to show, and the step between them: the whole recording if it fits, else the part around
/// its flights.
fn window(
    story: &Story<'_>,
    t: &TrialStory<'_>,
    subject: &Subject,
    motion: &Motion,
    drawn: &Drawn,
) -> (Range<usize>, usize) {
    let effects: usize = drawn.arrows.iter().map(|k| 12 * k.frames.first().map_or(0, Vec::len)).sum();
    let bytes = 4 * (14 * subject.model.n_links() + 6 * subject.markers.len() + 42 + effects) / 3;
    let frames = (ROOM / story.n_dynamic() / bytes.max(1)).clamp(48, 420);
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
fn ends(subject: &Subject) -> Vec<PointOn> {
    let links = &subject.model.links;
    let end = |link: usize, name: String, at: Vector3<f64>| PointOn { name, segment: link, at_m: at.into() };
    if subject.model.n_links() <= FEW_LINKS {
        return subject.markers.iter().map(|m| end(m.link, m.label.clone(), m.position_m)).collect();
    }
    (0..subject.model.n_links())
        .filter(|i| !links.iter().any(|l| l.parent == Some(*i)))
        .filter_map(|i| {
            let own = subject.markers.iter().filter(|m| m.link == i).map(|m| m.position_m);
            let tip = own.max_by(|a, b| a.norm().total_cmp(&b.norm()))?;
            Some(end(i, format!("end of {}", links[i].name), tip))
        })
        .collect()
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

    #[test]
    fn an_ellipsoid_has_its_own_inertia() {
        let (m, r) = (3.0, Vector3::new(0.1, 0.2, 0.3));
        let inertia = LinkInertia {
            mass_kg: m,
            com_m: Vector3::zeros(),
            inertia_com_kgm2: Matrix3::from_diagonal(&Vector3::from_fn(|k, _| {
                0.2 * m * (r.norm_squared() - r[k] * r[k])
            })),
        };
        let (turn, mut radii) = ellipsoid(&inertia, 1.0, 1.5);
        radii.as_mut_slice().sort_by(f64::total_cmp);
        assert!((radii - r).norm() < 1e-9 && (turn.norm() - 1.0).abs() < 1e-12, "{radii}");
    }
}
