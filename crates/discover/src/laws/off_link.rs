//! Whether the point of a force lies on the link that it is said to act on.
//!
//! A force at a point of the room acts on whichever link is there, and in short flights the links
//! near it move alike. With a free point, a law on the head can act at the shoulder, and describe a
//! force on the upper arm nearly as well as a law on the upper arm does.

use super::atlas::PlaceFrames;
use super::fit::{self, Fitted, STEPS};
use super::kinematics::{Action, Carrier};
use super::law::{Law, PointIs};
use crate::problem::Problem;
use crate::session::Session;
use aloft_effects::Scene;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Laws on another link that leave no more than this multiple of the error are not excluded.
pub(super) const ALSO: f64 = 1.05;

/// Largest distance of a point of a person's link from the lines between its joints, m: half the
/// depth of a chest, which is the largest.
const OFF_M: f64 = 0.12;

/// Largest distance of a point of a limb beyond the centre of a joint at its end, m: the shoulder
/// and the heel extend about as far. Farther out the body there is that of the next link.
const BEYOND_JOINT_M: f64 = 0.05;

/// The law that is stated first of those of a person, best first: the best one, or if its point is
/// not on its link, the best of those that explain as much with a point on theirs.
pub(super) fn on_its_link(scene: &Scene, laws: &[Fitted]) -> Option<usize> {
    let best = laws.first()?;
    let as_good = |l: &&Fitted| l.law.action == best.law.action && l.error() <= ALSO * ALSO * best.error();
    let at = laws.iter().take_while(as_good).position(|l| !is_off(scene, l));
    Some(at.unwrap_or(0))
}

/// The best of `laws`, fitted on each of the links next to its own; none if its point is on its
/// link. The fit starts at the mean place of the point in the other link.
pub(super) fn on_neighbours(session: &Session<'_>, problem: &Problem, laws: &[Fitted]) -> Vec<Fitted> {
    let Some(best) = laws.first().filter(|l| is_off(session.scene, l) && l.law.point_is == PointIs::Free) else {
        return Vec::new();
    };
    let Carrier::Link(own) = best.law.carrier else { return Vec::new() };
    let (point, _, _) = best.law.divided(&best.nonlinear);
    let frames = PlaceFrames::new(session, best.law.carrier, &point);
    let links = &session.scene.model.links;
    let next = |i: &usize| links[*i].parent == Some(own) || links[own].parent == Some(*i);
    let neighbours: Vec<usize> = (0..links.len()).filter(next).collect();
    let on = |link: usize| {
        let places = frames.series.iter().flatten().map(|(frame, at)| {
            let there = &frame.links[link];
            there.rotation.tr_mul(&(at.position - there.origin))
        });
        let (sum, count) = places.fold((Vector3::zeros(), 0.0), |(sum, n), p| (sum + p, n + 1.0));
        let law = Law { carrier: Carrier::Link(link), point: sum / f64::max(count, 1.0), ..best.law.clone() };
        let start = law.point.iter().chain(&best.nonlinear[3..]).copied().collect();
        fit::fit(session, problem, &law, start, STEPS)
    };
    neighbours.into_par_iter().filter_map(on).collect()
}

/// True if the point of a force lies farther from its link than a link is thick, or beyond a joint
/// at its end.
fn is_off(scene: &Scene, f: &Fitted) -> bool {
    let (Carrier::Link(link), Action::Force) = (f.law.carrier, f.law.action) else { return false };
    let (point, _, _) = f.law.divided(&f.nonlinear);
    distance(scene, link, &point) > OFF_M || beyond_joint(scene, link, &point) > BEYOND_JOINT_M
}

/// How far a point (link frame, m) lies beyond the joints at the ends of a limb, along it; negative
/// between them. A limb has one joint to a next link, or none; other links have no ends.
fn beyond_joint(scene: &Scene, link: usize, point: &Vector3<f64>) -> f64 {
    let links = &scene.model.links;
    let mut children = links.iter().filter(|l| l.parent == Some(link));
    let (next, further) = (children.next(), children.next());
    if links[link].parent.is_none() || further.is_some() {
        return f64::NEG_INFINITY;
    }
    let end = next.map(|l| l.joint.parent_from_joint.translation.vector);
    let Some(along) = end.unwrap_or(scene.link_com_m[link]).try_normalize(1e-9) else { return f64::NEG_INFINITY };
    let at = point.dot(&along);
    end.map_or(-at, |end| (at - end.norm()).max(-at))
}

/// Distance of a point (link frame, m) from the lines from a link's joint to those of its children;
/// of a last link, from the line through its centre of mass that is twice as long.
fn distance(scene: &Scene, link: usize, point: &Vector3<f64>) -> f64 {
    let children = scene.model.links.iter().filter(|l| l.parent == Some(link));
    let mut ends: Vec<Vector3<f64>> = children.map(|l| l.joint.parent_from_joint.translation.vector).collect();
    if ends.is_empty() {
        ends.push(2.0 * scene.link_com_m[link]);
    }
    let from_line = |end: Vector3<f64>| {
        let share = point.dot(&end) / end.norm_squared().max(1e-12);
        (point - end * share.clamp(0.0, 1.0)).norm()
    };
    ends.into_iter().map(from_line).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laws::kinematics::Direction;
    use crate::laws::law::{Law, PointIs};
    use crate::laws::near_joint::tests::{trunk_and_arm, trunk_and_arm_spec};
    use nalgebra::DVector;

    fn law(carrier: usize, point: [f64; 3], error: f64) -> Fitted {
        let law = Law {
            id: "law".to_owned(),
            carrier: Carrier::Link(carrier),
            action: Action::Force,
            direction: Direction::World,
            components: vec![0, 1, 2],
            factors: Vec::new(),
            point: Vector3::zeros(),
            point_is: PointIs::Free,
            zeros: Vec::new(),
            delayed: false,
        };
        let (theta, none) = (DVector::zeros(3), Vec::new);
        Fitted { law, nonlinear: point.to_vec(), theta, errors: vec![error], se: none(), freedom: none(), unknowns: 6 }
    }

    #[test]
    fn a_point_beyond_a_link_leaves_the_first_place_to_the_link_that_is_there() -> Result<(), Box<dyn std::error::Error>>
    {
        let model = trunk_and_arm([0.0, 0.4, 0.2])?;
        let phi: Vec<_> = vec![aloft_body::Phi::zeros(); 2];
        let mut scene = Scene::new(&model, &phi, &[]);
        scene.link_com_m = vec![Vector3::new(0.0, 0.2, 0.0), Vector3::new(0.0, -0.12, 0.0)];
        assert!((distance(&scene, 0, &Vector3::new(0.0, 0.2, 0.1)) - 0.0).abs() < 1e-12);
        assert!((distance(&scene, 1, &Vector3::new(0.0, -0.34, 0.0)) - 0.1).abs() < 1e-12);
        let off = law(1, [0.0, -0.4, 0.0], 1.0);
        let beside = law(0, [0.0, 0.0, 0.1], 1.05);
        assert_eq!(on_its_link(&scene, &[off.clone(), beside.clone()]), Some(1));
        // not where the other one explains less
        assert_eq!(on_its_link(&scene, &[off.clone(), law(0, [0.0, 0.0, 0.1], 1.2)]), Some(0));
        // nor where the first point is on its link
        assert_eq!(on_its_link(&scene, &[law(1, [0.0, -0.3, 0.05], 1.0), beside]), Some(0));
        assert_eq!(on_its_link(&scene, &[]), None);
        // 60 mm beyond its own joint, towards the trunk
        let past = law(1, [0.0, 0.06, 0.0], 1.0);
        assert_eq!(on_its_link(&scene, &[past, law(0, [0.0, 0.35, 0.15], 1.05)]), Some(1));
        let near = law(1, [0.0, 0.04, 0.0], 1.0);
        assert_eq!(on_its_link(&scene, &[near, law(0, [0.0, 0.35, 0.15], 1.05)]), Some(0));
        Ok(())
    }

    #[test]
    fn a_limb_ends_at_its_joints() -> Result<(), Box<dyn std::error::Error>> {
        // a forearm of 0.24 m with a hand: a point 0.31 m from the elbow belongs to the hand
        let mut spec = trunk_and_arm_spec([0.0, 0.4, 0.2]);
        spec.links.push(aloft_body::LinkSpec {
            name: "hand".to_owned(),
            parent: Some("arm".to_owned()),
            position_m: [0.0, -0.24, 0.0],
            ..spec.links[1].clone()
        });
        let model = aloft_body::Model::from_spec(&spec)?;
        let phi: Vec<_> = vec![aloft_body::Phi::zeros(); 3];
        let mut scene = Scene::new(&model, &phi, &[]);
        scene.link_com_m =
            vec![Vector3::new(0.0, 0.2, 0.0), Vector3::new(0.0, -0.12, 0.0), Vector3::new(0.0, -0.08, 0.0)];
        let beyond = |link: usize, y: f64| beyond_joint(&scene, link, &Vector3::new(0.0, y, 0.0));
        assert!((beyond(1, -0.31) - 0.07).abs() < 1e-12 && (beyond(1, -0.1) + 0.1).abs() < 1e-12);
        assert!((beyond(2, 0.03) - 0.03).abs() < 1e-12 && beyond(2, -0.3) < 0.0);
        assert_eq!(beyond(0, 9.0), f64::NEG_INFINITY);
        assert!(is_off(&scene, &law(1, [0.0, -0.311, 0.034], 1.0)));
        assert!(!is_off(&scene, &law(1, [0.0, -0.28, 0.0], 1.0)));
        Ok(())
    }
}
