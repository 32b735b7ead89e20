//! Data that is constant over the frames: the tree, its markers, the soft priors.

use crate::ranges::Limit;
use crate::tree::{NONE, Pose, Tree};
use crate::{IkError, IkOptions};
use aloft_body::{JointKind, Subject, rigid};
use nalgebra::{Matrix3, Vector3};

/// Minimum number of common markers for tracking a trial.
pub(crate) const FEWEST_MARKERS: usize = 3;

/// A tracked marker.
#[derive(Debug, Clone)]
pub(crate) struct Tracked {
    pub label: String,
    pub link: usize,
    /// In the link frame, m.
    pub position: Vector3<f64>,
    /// 1/σ², 1/m².
    pub weight: f64,
    /// Distance at which the influence of the marker is limited, m.
    pub huber: f64,
}

/// A hinge whose flexion side is known.
#[derive(Debug, Clone)]
pub(crate) struct Hinge {
    pub link: usize,
    pub parent: usize,
    /// The link at the far end, if it has a spherical joint.
    pub end: usize,
    pub axis: Vector3<f64>,
    pub q_index: usize,
    pub v_index: usize,
    /// From the parent's origin to the hinge, in the parent's frame, m.
    pub to_hinge: Vector3<f64>,
    /// From the hinge to the far end, in the hinge's link frame, m.
    pub to_end: Vector3<f64>,
    /// Angle at which the two ends are farthest apart, rad.
    pub straight: f64,
    /// Squared distance of the two ends is `reach + 2 swing cos(angle − straight)`, m².
    pub reach: f64,
    pub swing: f64,
    /// +1 or −1: flexion is `sense · (angle − straight) > 0`.
    pub sense: f64,
    /// True if the markers cannot distinguish the flexed from the overextended side.
    pub watched: bool,
}

impl Hinge {
    /// Flexion from straight, rad, in (−π, π].
    pub fn flexion(&self, angle: f64) -> f64 {
        let x = self.sense * (angle - self.straight);
        x - std::f64::consts::TAU * (x / std::f64::consts::TAU).round()
    }
}

/// All constant data.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub tree: Tree,
    pub markers: Vec<Tracked>,
    pub rest_q: Vec<f64>,
    pub rest_pose: Pose,
    pub rest_weight: f64,
    pub hinges: Vec<Hinge>,
    /// Ranges of spherical joints.
    pub limits: Vec<Limit>,
    pub limit_weight: f64,
    pub overextension: f64,
    pub flexion_limit: f64,
    pub locked: Vec<bool>,
    pub any_locked: bool,
    /// Links whose joint has a locked coordinate.
    pub locked_link: Vec<bool>,
    pub max_iterations: usize,
    /// Square of the step, in standard deviations, below which a minimisation stops.
    pub tolerance: f64,
    /// Whether standard deviations of the coordinates are computed.
    pub deviations: bool,
}

impl Problem {
    /// Prepares a subject; markers without weight are omitted.
    pub fn new(subject: &Subject, options: &IkOptions) -> Result<Self, IkError> {
        options.check()?;
        let model = &subject.model;
        let mismatch = |what: &'static str, expected: String, found: String| IkError::Mismatch {
            subject: subject.facts.name.clone(),
            what,
            expected,
            found,
        };
        if subject.static_q.len() != model.nq || subject.static_q.iter().any(|x| !x.is_finite()) {
            let found = format!("{} values", subject.static_q.len());
            return Err(mismatch("static posture", format!("{} finite values", model.nq), found));
        }
        if model.links.first().is_none_or(|root| root.parent.is_some()) {
            return Err(mismatch("links", "a root first".to_owned(), format!("{} links", model.links.len())));
        }
        let tree = Tree::new(model);
        let mut markers = Vec::new();
        for marker in &subject.markers {
            if marker.link >= tree.links.len() {
                let found = format!("`{}` on link {}", marker.label, marker.link);
                return Err(mismatch("marker", format!("a link below {}", tree.links.len()), found));
            }
            let usable = marker.position_m.iter().all(|x| x.is_finite());
            if marker.weight > 0.0 && marker.weight.is_finite() && usable {
                let weight = marker.weight / (options.marker_sd_m * options.marker_sd_m);
                markers.push(Tracked {
                    label: marker.label.clone(),
                    link: marker.link,
                    position: marker.position_m,
                    weight,
                    huber: options.huber_m.unwrap_or(f64::INFINITY),
                });
            }
        }
        let mut locked = vec![false; tree.nv];
        let mut locked_link = vec![false; tree.links.len()];
        for &i in &options.locked {
            if i >= tree.nv {
                return Err(mismatch("locked coordinate", format!("below {}", tree.nv), i.to_string()));
            }
            locked[i] = true;
            locked_link[tree.column_link[i]] = true;
        }
        let mut rest_q = subject.static_q.clone();
        model.normalize(&mut rest_q);
        let mut rest_pose = tree.pose();
        tree.forward(&rest_q, &mut rest_pose);
        let hinges = find_hinges(&tree, &markers, options);
        let limits = tree
            .links
            .iter()
            .enumerate()
            .filter(|(_, link)| link.kind == JointKind::Spherical)
            .filter_map(|(i, link)| {
                options.ranges.get(&link.name).map(|range| Limit::new(i, link.q_offset, link.v_offset, range))
            })
            .collect();
        Ok(Self {
            any_locked: locked.iter().any(|l| *l),
            locked,
            locked_link,
            markers,
            rest_q,
            rest_pose,
            rest_weight: 1.0 / (options.posture_sd_rad * options.posture_sd_rad),
            hinges,
            limits,
            limit_weight: 1.0 / (options.limit_sd_rad * options.limit_sd_rad),
            overextension: options.overextension_rad,
            flexion_limit: options.flexion_limit_rad,
            max_iterations: options.max_iterations,
            tolerance: options.tolerance_sd * options.tolerance_sd,
            deviations: true,
            tree,
        })
    }
}

/// Hinges with a known flexion side, with the geometry of the triangle formed by the hinge and its
/// two ends.
fn find_hinges(tree: &Tree, markers: &[Tracked], options: &IkOptions) -> Vec<Hinge> {
    let count = |link: usize| markers.iter().filter(|m| m.link == link).count();
    let mut hinges = Vec::new();
    for (index, link) in tree.links.iter().enumerate() {
        let JointKind::Revolute(axis) = link.kind else { continue };
        let Some(&sense) = options.flexion.get(&link.name) else { continue };
        if link.parent == NONE {
            continue;
        }
        let axis = axis.into_inner();
        let end = tree.links.iter().position(|l| l.parent == index).unwrap_or(NONE);
        let farthest =
            markers.iter().filter(|m| m.link == index).map(|m| m.position).max_by(|a, b| a.norm().total_cmp(&b.norm()));
        let Some(to_end) = (if end == NONE { farthest } else { Some(tree.links[end].translation) }) else { continue };
        let arm = link.rotation.transpose() * link.translation;
        let flat = |v: &Vector3<f64>| v - axis * axis.dot(v);
        let (arm_flat, end_flat) = (flat(&arm), flat(&to_end));
        let (a, b) = (arm_flat.dot(&end_flat), arm_flat.dot(&axis.cross(&end_flat)));
        let swing = a.hypot(b);
        if swing < 1e-6 {
            continue;
        }
        let jointed = end != NONE && tree.links[end].kind == JointKind::Spherical;
        let above = tree.links[link.parent].kind == JointKind::Spherical;
        hinges.push(Hinge {
            link: index,
            parent: link.parent,
            end: if jointed { end } else { NONE },
            axis,
            q_index: link.q_offset,
            v_index: link.v_offset,
            to_hinge: link.translation,
            to_end,
            straight: b.atan2(a),
            reach: arm.norm_squared() + to_end.norm_squared() + 2.0 * axis.dot(&arm) * axis.dot(&to_end),
            swing,
            sense: sense.signum(),
            watched: jointed && above && (count(link.parent) < 2 || count(link.parent) + count(index) < 3),
        });
    }
    hinges
}

/// [`rigid::best_rotation`] with the tolerance of starting postures, for which the iteration can
/// end earlier.
pub(crate) fn best_rotation(b: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    rigid::best_rotation(b, 1e-14).map(|(rotation, _)| rotation)
}
