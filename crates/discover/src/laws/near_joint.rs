//! The other link of a joint at which a force acts.
//!
//! A force through a joint has no moment about it, so that it may act on either of the two links.
//! If the recordings place the point at a joint, the link is therefore not determined.

use super::kinematics::Carrier;
use crate::result::Estimate;
use aloft_body::Model;
use nalgebra::Vector3;

/// Links that share with `carrier` a joint within the 95 % intervals of the point of a force,
/// widened by `slack_m`. Coordinates are in the link's frame, m; one
/// without an interval is not determined.
pub(super) fn other_links(model: &Model, carrier: Carrier, point: &[Estimate], slack_m: f64) -> Vec<Carrier> {
    let (Carrier::Link(own), [_, _, _]) = (carrier, point) else { return Vec::new() };
    let is_at = |joint: &Vector3<f64>| {
        let within =
            |k: usize| point[k].ci95.is_none_or(|[low, high]| (low - slack_m..=high + slack_m).contains(&joint[k]));
        (0..3).all(within) && point.iter().any(|e| e.ci95.is_some())
    };
    let children = model.links.iter().enumerate().filter(|(_, link)| link.parent == Some(own));
    let at_child = children.filter(|(_, link)| is_at(&link.joint.parent_from_joint.translation.vector)).map(|(i, _)| i);
    let parent = model.links.get(own).and_then(|link| link.parent).filter(|_| is_at(&Vector3::zeros()));
    at_child.chain(parent).map(Carrier::Link).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use aloft_body::{JointSpec, LinkSpec, ModelSpec};

    /// A point with an interval of 20 mm on each side.
    fn point(at: [f64; 3]) -> Vec<Estimate> {
        let of = |value: f64| Estimate {
            name: String::new(),
            value,
            se: 0.01,
            ci95: Some([value - 0.02, value + 0.02]),
            freedom: 30.0,
            at_bound: false,
            widening: 1.0,
            unit: "m".to_owned(),
        };
        at.map(of).to_vec()
    }

    /// A trunk and an arm with its joint at a point of the trunk, m.
    pub(in super::super) fn trunk_and_arm(joint_m: [f64; 3]) -> Result<Model, aloft_body::BodyError> {
        Model::from_spec(&trunk_and_arm_spec(joint_m))
    }

    /// The links of [`trunk_and_arm`].
    pub(in super::super) fn trunk_and_arm_spec(joint_m: [f64; 3]) -> ModelSpec {
        let link = |name: &str, parent: Option<&str>, joint, position_m| LinkSpec {
            name: name.to_owned(),
            parent: parent.map(str::to_owned),
            joint,
            position_m,
            rpy_rad: [0.0; 3],
            inertia: None,
        };
        let links = vec![
            link("trunk", None, JointSpec::Free, [0.0; 3]),
            link("arm", Some("trunk"), JointSpec::RevoluteZ, joint_m),
        ];
        ModelSpec::new("two".into(), links)
    }

    #[test]
    fn a_point_at_a_joint_leaves_both_of_its_links_open() -> Result<(), Box<dyn std::error::Error>> {
        let model = trunk_and_arm([0.0, 0.25, 0.02])?;
        let hinge = model.links[1].joint.parent_from_joint.translation.vector;
        let near = |carrier, at: [f64; 3]| other_links(&model, Carrier::Link(carrier), &point(at), 0.0);
        assert_eq!(near(1, [0.01, 0.0, -0.01]), [Carrier::Link(0)]);
        assert_eq!(near(0, hinge.into()), [Carrier::Link(1)]);
        assert!(near(1, [0.0, 0.05, 0.0]).is_empty());
        // 40 mm from the hinge, with an interval of 20 mm
        let off = point([0.0, 0.04, 0.0]);
        assert!(other_links(&model, Carrier::Link(1), &off, 0.0).is_empty());
        assert_eq!(other_links(&model, Carrier::Link(1), &off, 0.025), [Carrier::Link(0)]);
        assert!(other_links(&model, Carrier::Body, &point([0.0; 3]), 0.0).is_empty());
        assert!(other_links(&model, Carrier::Link(1), &[], 0.0).is_empty());
        Ok(())
    }
}
