//! The playable skeleton.

use crate::artifact::{load_motion, load_trial};
use crate::error::PipelineError;
use crate::study::Study;
use crate::workspace::{WHOLE_STUDY, Workspace, read_json};
use aloft_body::{State, Subject};
use aloft_report::{Animation, Figure};

/// About four seconds of the liveliest trial: around its first flight where there is one.
pub fn skeleton(study: &Study, ws: &Workspace) -> Result<Option<Figure>, PipelineError> {
    let subject: Subject = read_json(&ws.place("calibrate", WHOLE_STUDY).join("subject.json"))?;
    let model = &subject.model;
    let candidates =
        study.included().filter(|t| t.role.is_dynamic() && ws.manifest("ik", &t.name).is_some_and(|m| m.is_ok()));
    let mut best: Option<(&str, usize)> = None;
    for t in candidates {
        let first = read_json::<aloft_flight::FlightReport>(&ws.place("flight", &t.name).join("flights.json"))
            .ok()
            .and_then(|r| r.flights.first().map(|f| f.start));
        if let Some(start) = first {
            best = Some((t.name.as_str(), start));
            break;
        }
        best = best.or(Some((t.name.as_str(), 0)));
    }
    let Some((name, start)) = best else { return Ok(None) };
    let motion = load_motion(&ws.place("ik", name))?;
    let trial = load_trial(&ws.place("import", name))?;
    let rate = motion.rate_hz;
    let from = start.saturating_sub((0.8 * rate) as usize);
    let to = (from + (2.4 * rate) as usize).min(motion.n_frames());
    let step = ((rate / 30.0).round() as usize).max(1);
    let mut a = Animation {
        times_s: Vec::new(),
        bones: bones(&subject),
        joints: Vec::new(),
        measured: Vec::new(),
        modelled: Vec::new(),
        forces: Vec::new(),
    };
    let mut state = State::new(model);
    for f in (from..to).step_by(step).filter(|f| motion.is_valid(*f)) {
        state.forward_position(model, motion.q(f));
        a.times_s.push(f as f64 / rate);
        let mut joints: Vec<[f64; 3]> = state.world_from_link.iter().map(|w| w.translation.vector.into()).collect();
        joints.extend(tips(&subject).iter().map(|(link, tip)| <[f64; 3]>::from(state.point_in_world(*link, tip))));
        a.joints.push(joints);
        a.modelled.push(subject.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m).into()).collect());
        a.measured.push(
            subject
                .markers
                .iter()
                .map(|m| {
                    trial
                        .markers
                        .index(&m.label)
                        .and_then(|i| trial.markers.position(i, f))
                        .map_or([f64::NAN; 3], |p| p.into())
                })
                .collect(),
        );
        a.forces.push(
            trial
                .plates
                .iter()
                .filter_map(|p| {
                    let i = (f as f64 / rate * p.rate_hz).round() as usize;
                    let (force, moment) = (p.force_n.get(i)?, p.moment_nm.get(i)?);
                    // centre of pressure on the floor, z = 0; below 20 N there is none
                    (force.z > 20.0).then(|| {
                        let at = [-moment.y / force.z, moment.x / force.z, 0.0];
                        [at, [at[0] + force.x / 1000.0, at[1] + force.y / 1000.0, force.z / 1000.0]]
                    })
                })
                .collect(),
        );
    }
    Ok((!a.times_s.is_empty()).then(|| {
        Figure::animation(
            &format!("{name}: model, markers and plate forces (1 m for 1000 N); drag to turn, Play to run"),
            &a,
        )
    }))
}

/// Ends of links that carry no other link: the mean of their markers.
pub fn tips(subject: &Subject) -> Vec<(usize, nalgebra::Vector3<f64>)> {
    (0..subject.model.n_links())
        .filter(|i| !subject.model.links.iter().any(|l| l.parent == Some(*i)))
        .filter_map(|i| {
            let own: Vec<_> = subject.markers.iter().filter(|m| m.link == i).map(|m| m.position_m).collect();
            let far = own.into_iter().max_by(|a, b| a.norm().total_cmp(&b.norm()))?;
            Some((i, far))
        })
        .collect()
}

pub fn bones(subject: &Subject) -> Vec<(usize, usize)> {
    let n = subject.model.n_links();
    let mut out: Vec<(usize, usize)> =
        subject.model.links.iter().enumerate().filter_map(|(i, l)| l.parent.map(|p| (p, i))).collect();
    out.extend(tips(subject).iter().enumerate().map(|(k, (link, _))| (*link, n + k)));
    out
}
