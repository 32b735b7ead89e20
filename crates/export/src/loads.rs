//! Assigns plates to feet: external loads for programs that require a body, a point of application
//! and a free moment.
//!
//! Plates measure a load, but not which foot applies it. Each stretch in which a plate is loaded is
//! assigned to the foot nearest to its centre of pressure; between stretches the assignment changes
//! halfway. Links whose name begins with `foot` are feet; in a model without feet the loads act on
//! the root. The sum of all loads is the measured wrench for any assignment, so the residual at the
//! root does not depend on it.

use crate::subject::SubjectExport;
use aloft_body::{Motion, State};
use aloft_signal::runs_where;
use nalgebra::{Vector3, Vector6};

/// Vertical force below which a plate has no centre of pressure, N.
pub const LOADED_N: f64 = 20.0;

/// A plate's reaction on the subject at the frames of the motion, filtered like the motion: world
/// force (N) and moment about the world origin (N·m).
#[derive(Debug, Clone, PartialEq)]
pub struct PlateAtFrames {
    /// Name.
    pub name: String,
    /// One wrench per frame; NaN where missing.
    pub wrench: Vec<Vector6<f64>>,
}

/// Load of one plate on one link, over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// Name for columns: the plate's number, and the link if a plate carried several.
    pub label: String,
    /// Name of the plate.
    pub plate: String,
    /// Link that it acts on.
    pub link: usize,
    /// World force (N) and moment about the world origin (N·m); zero where the plate acts on
    /// another link, NaN where missing.
    pub wrench: Vec<Vector6<f64>>,
    /// Point of application, m, world: the centre of pressure on the floor (z = 0) under load, the
    /// origin elsewhere.
    pub point_m: Vec<Vector3<f64>>,
    /// Moment about that point, N·m, world: only vertical under load.
    pub moment_nm: Vec<Vector3<f64>>,
    /// Frames in which the plate carries more than [`LOADED_N`] on this link.
    pub loaded: Vec<bool>,
}

/// Force and moment parts of a wrench.
pub(crate) fn parts(w: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(w[0], w[1], w[2]), Vector3::new(w[3], w[4], w[5]))
}

/// Centre of pressure on the plane z = 0, m.
pub(crate) fn centre_of_pressure(wrench: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(-wrench[4] / wrench[2], wrench[3] / wrench[2], 0.0)
}

fn loaded(w: &Vector6<f64>) -> bool {
    w[2] > LOADED_N
}

/// Links that can stand on plates.
fn feet(subject: &SubjectExport) -> Vec<usize> {
    let links = &subject.subject.model.links;
    let feet: Vec<usize> =
        (0..links.len()).filter(|&i| ["foot", "calcn"].iter().any(|n| links[i].name.starts_with(n))).collect();
    if feet.is_empty() { vec![0] } else { feet }
}

/// Middle of a foot in its own frame: the mean of its markers, or its origin without markers.
fn middle(subject: &SubjectExport, link: usize) -> Vector3<f64> {
    let own: Vec<Vector3<f64>> =
        subject.subject.markers.iter().filter(|m| m.link == link).map(|m| m.position_m).collect();
    if own.is_empty() { Vector3::zeros() } else { own.iter().sum::<Vector3<f64>>() / own.len() as f64 }
}

/// Assigns the plates of a recording to links.
pub fn assign(subject: &SubjectExport, motion: &Motion, plates: &[PlateAtFrames]) -> Vec<Load> {
    let model = &subject.subject.model;
    let candidates = feet(subject);
    let middles: Vec<Vector3<f64>> = candidates.iter().map(|&l| middle(subject, l)).collect();
    let mut state = State::new(model);
    let mut loads = Vec::new();
    for (number, plate) in plates.iter().enumerate() {
        let n = plate.wrench.len();
        let episodes = runs_where(n, |f| loaded(&plate.wrench[f]));
        let owners: Vec<usize> = episodes
            .iter()
            .map(|episode| {
                let mut distance = vec![0.0; candidates.len()];
                for f in episode.clone().filter(|&f| motion.is_valid(f)) {
                    state.forward_position(model, motion.q(f));
                    let (w, cop) = (&plate.wrench[f], centre_of_pressure(&plate.wrench[f]));
                    for (d, (link, middle)) in distance.iter_mut().zip(candidates.iter().zip(&middles)) {
                        let away = state.point_in_world(*link, middle) - cop;
                        *d += w[2] * away.xy().norm();
                    }
                }
                let nearest = (0..distance.len()).min_by(|&a, &b| distance[a].total_cmp(&distance[b]));
                candidates[nearest.unwrap_or(0)]
            })
            .collect();
        let owner_of = |f: usize| {
            let nearest = (0..episodes.len()).min_by_key(|&e| {
                let r = &episodes[e];
                if f < r.start { r.start - f } else { (f + 1).saturating_sub(r.end) }
            });
            nearest.map_or(candidates[0], |e| owners[e])
        };
        let by_frame: Vec<usize> = (0..n).map(owner_of).collect();
        let mut links = by_frame.clone();
        links.sort_unstable();
        links.dedup();
        for &link in &links {
            let label = if links.len() == 1 {
                format!("{}", number + 1)
            } else {
                format!("{}_{}", number + 1, crate::names::label(&model.links[link].name))
            };
            loads.push(load(label, &plate.name, link, &plate.wrench, &by_frame));
        }
    }
    loads
}

fn load(label: String, plate: &str, link: usize, wrench: &[Vector6<f64>], by_frame: &[usize]) -> Load {
    let own: Vec<Vector6<f64>> =
        wrench.iter().zip(by_frame).map(|(w, l)| if *l == link { *w } else { Vector6::zeros() }).collect();
    let point_m: Vec<Vector3<f64>> =
        own.iter().map(|w| if loaded(w) { centre_of_pressure(w) } else { Vector3::zeros() }).collect();
    let moment_nm = own
        .iter()
        .zip(&point_m)
        .map(|(w, p)| {
            let (force, moment) = parts(w);
            let mut about_point = moment - p.cross(&force);
            if loaded(w) {
                // zero by definition of the centre of pressure, except for rounding
                about_point.x = 0.0;
                about_point.y = 0.0;
            }
            about_point
        })
        .collect();
    let loaded = own.iter().map(loaded).collect();
    Load { label, plate: plate.to_owned(), link, wrench: own, point_m, moment_nm, loaded }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_and_free_moment_carry_the_whole_wrench() {
        let w = Vector6::new(12.0, -30.0, 700.0, 80.0, -210.0, 6.0);
        for wrench in [w, Vector6::new(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)] {
            let l = load("1".into(), "FP1", 3, &[wrench], &[3]);
            let (force, moment) = parts(&l.wrench[0]);
            assert!((l.point_m[0].cross(&force) + l.moment_nm[0] - moment).norm() < 1e-12);
        }
        assert_eq!(load("1".into(), "FP1", 2, &[w], &[3]).wrench[0], Vector6::zeros());
    }
}
