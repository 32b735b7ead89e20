//! Models from YAML and URDF, and the errors for invalid ones.
#![allow(clippy::unwrap_used, clippy::panic)] // functions shared by tests may stop them

mod common;

use aloft_body::{BodyError, JointKind, JointSpec, Model, ModelSpec};
use nalgebra::Vector3;

fn from_yaml(text: &str) -> Result<Model, BodyError> {
    Model::from_spec(&serde_yaml::from_str(text).unwrap())
}

#[test]
fn regress_shipped_models() {
    let human = common::human();
    assert_eq!((human.nq, human.nv, human.n_links()), (51, 40, 15));
    let links: Vec<&str> = human.links.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(
        links,
        [
            "pelvis",
            "torso",
            "head",
            "upper_arm_r",
            "forearm_r",
            "hand_r",
            "upper_arm_l",
            "forearm_l",
            "hand_l",
            "thigh_r",
            "shank_r",
            "foot_r",
            "thigh_l",
            "shank_l",
            "foot_l"
        ]
    );
    let names = human.coordinate_names();
    assert_eq!((names.len(), human.velocity_names().len()), (51, 40));
    assert_eq!((names[0].as_str(), names[3].as_str(), names[6].as_str()), ("pelvis.x", "pelvis.qx", "pelvis.qw"));
    assert!(names.contains(&"shank_r.angle".to_owned()) && names.contains(&"torso.qx".to_owned()));
    assert!(human.velocity_names().contains(&"forearm_l.rate".to_owned()));
    let q = human.neutral();
    assert_eq!(q.iter().sum::<f64>(), 11.0);
    let two = from_yaml(include_str!("../../../configs/models/two_link.yaml")).unwrap();
    assert_eq!((two.nq, two.nv), (8, 7));
    assert_eq!(two.gravity_mps2.z, -9.80665);
}

#[test]
fn regress_joints_as_written() {
    let parse = |text: &str| serde_yaml::from_str::<JointSpec>(text).map_err(|e| e.to_string());
    assert_eq!(parse("free"), Ok(JointSpec::Free));
    assert_eq!(parse("revolute_z"), Ok(JointSpec::RevoluteZ));
    assert_eq!(parse("revolute_x"), Ok(JointSpec::Revolute([1.0, 0.0, 0.0])));
    assert_eq!(parse("{revolute: [0, 1, 0]}"), Ok(JointSpec::Revolute([0.0, 1.0, 0.0])));
    assert_eq!(parse("prismatic: [0, 0.6, 0.8]"), Ok(JointSpec::Prismatic([0.0, 0.6, 0.8])));
    assert!(parse("hinge").unwrap_err().contains("unknown joint `hinge`"), "{:?}", parse("hinge"));
    assert!(parse("{revolute: [1, 0, 0], prismatic: [1, 0, 0]}").is_err());
    assert!(parse("{screw: [1, 0, 0]}").is_err());
    for joint in [JointSpec::Spherical, JointSpec::Fixed, JointSpec::Revolute([0.1, 0.2, 0.3])] {
        let text = serde_yaml::to_string(&joint).unwrap();
        assert_eq!(parse(&text), Ok(joint), "{text}");
        let text = serde_json::to_string(&joint).unwrap();
        assert_eq!(serde_json::from_str::<JointSpec>(&text).unwrap(), joint, "{text}");
    }
}

#[test]
fn regress_impossible_models_are_refused() {
    let refused = |links: &str, why: &str| {
        let error = from_yaml(&format!("name: odd\nlinks: {links}")).unwrap_err().to_string();
        assert!(error.contains("`odd`") && error.contains(why), "{error}");
    };
    refused("[]", "no links");
    refused("[{name: a, joint: spherical}]", "only the root");
    refused("[{name: a, joint: free}, {name: b, joint: fixed}]", "`b` has no parent");
    refused("[{name: a, joint: free}, {name: b, parent: a, joint: free}]", "only the root");
    refused("[{name: a, joint: free}, {name: b, parent: c, joint: fixed}]", "parent `c`");
    refused("[{name: a, joint: free}, {name: a, parent: a, joint: fixed}]", "two links");
    refused("[{name: a, joint: free}, {name: b, parent: a, joint: {revolute: [0, 0, 0]}}]", "no direction");
    refused("[{name: a, joint: free}, {name: b, parent: a, joint: {revolute: [.nan, 0, 0]}}]", "no direction");
    refused("[{name: a, joint: free, position_m: [.inf, 0, 0]}]", "not finite");
    let error = common::human().link_index("tail").unwrap_err().to_string();
    assert!(error.contains("no link `tail`") && error.contains("`pelvis`, `torso`"), "{error}");
    assert_eq!(common::human().link_index("foot_l").unwrap(), 14);
}

const ROBOT: &str = r#"<robot name="arm">
  <link name="world"/>
  <joint name="float" type="floating"><parent link="world"/><child link="base"/></joint>
  <link name="base"><inertial><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.3"/></inertial></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="car"/><origin xyz="0 0 0.5" rpy="0 0 0.3"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <link name="tip"/>
  <joint name="bolt" type="fixed"><parent link="arm"/><child link="tip"/></joint>
  <link name="arm"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="car"/><child link="arm"/><axis xyz="0 1 0"/></joint>
  <link name="car"/>
</robot>"#;

#[test]
fn regress_urdf() {
    let spec = ModelSpec::from_urdf(ROBOT).unwrap();
    let model = Model::from_spec(&spec).unwrap();
    let names: Vec<&str> = model.links.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["base", "car", "arm", "tip"]);
    assert_eq!(model.links[1].joint.kind, JointKind::Prismatic(Vector3::z_axis()));
    assert_eq!(model.links[2].joint.kind, JointKind::Revolute(Vector3::y_axis()));
    assert!((model.links[1].joint.parent_from_joint.rotation.euler_angles().2 - 0.3).abs() < 1e-15);
    let inertias = spec.inertias().unwrap();
    assert_eq!(inertias[0].com_m, Vector3::new(0.1, 0.0, 0.0));
    // The frame of the inertia is rotated by a quarter turn about z: x and y are exchanged.
    let tensor = inertias[0].inertia_com_kgm2;
    assert!((tensor[(0, 0)] - 0.2).abs() < 1e-15 && (tensor[(1, 1)] - 0.1).abs() < 1e-15);
    assert_eq!(inertias[3].mass_kg, 0.0);
}

#[test]
fn regress_odd_urdf_is_refused() {
    let refused = |text: &str, why: &str| {
        let error = ModelSpec::from_urdf(text).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    };
    refused("not xml at all", "URDF");
    refused(&ROBOT.replace("continuous", "planar"), "planar");
    refused(&ROBOT.replace(r#"<link name="car"/>"#, ""), "does not exist");
    refused(&ROBOT.replace(r#"<link name="car"/>"#, r#"<link name="car"/><link name="stray"/>"#), "2 root links");
    let looped = r#"<robot name="r"><link name="w"/><link name="a"/><link name="b"/>
      <joint name="1" type="fixed"><parent link="a"/><child link="b"/></joint>
      <joint name="2" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"#;
    refused(looped, "loop");
}
