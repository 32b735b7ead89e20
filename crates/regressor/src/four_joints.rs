//! A body for tests with the four kinds of joints that move.

use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec};

/// Free root with a spherical joint and, after it, a hinge; a slide on the root.
pub(crate) fn four_joints() -> Model {
    let link = |name: &str, parent: Option<&str>, joint| LinkSpec {
        name: name.into(),
        parent: parent.map(Into::into),
        joint,
        position_m: [0.1, 0.2, -0.1],
        rpy_rad: [0.3, 0.0, -0.2],
        inertia: None,
    };
    let links = vec![
        link("a", None, JointSpec::Free),
        link("b", Some("a"), JointSpec::Spherical),
        link("c", Some("b"), JointSpec::Revolute([0.6, 0.0, 0.8])),
        link("d", Some("a"), JointSpec::Prismatic([0.0, 1.0, 0.0])),
    ];
    Model::from_spec(&ModelSpec::new("four joints".into(), links)).unwrap()
}
