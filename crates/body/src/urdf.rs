//! Reads robots described in URDF into a [`ModelSpec`], as an alternative to YAML.

use crate::{BodyError, JointSpec, LinkInertia, LinkSpec, ModelSpec};
use nalgebra::{Matrix3, Rotation3, Vector3};
use urdf_rs::{JointType, Robot};

impl ModelSpec {
    /// Reads URDF text. The root becomes free; links keep their frames and inertias (a link without
    /// an `inertial` element has zero inertia). Joints: revolute and continuous (limits are not
    /// used), prismatic, fixed, spherical, and floating from a massless root link, which is then
    /// removed. A joint that mimics another becomes independent.
    ///
    /// # Errors
    /// Text that is not URDF, planar joints, floating joints elsewhere, a tree without a root, with
    /// two roots or with a loop.
    pub fn from_urdf(text: &str) -> Result<Self, BodyError> {
        let wrong = |problem: String| BodyError::Spec { model: "URDF".to_owned(), problem };
        crate::check_xml(text).map_err(wrong)?;
        let robot = urdf_rs::read_from_string(text).map_err(|error| wrong(error.to_string()))?;
        from_robot(&robot)
    }
}

fn from_robot(robot: &Robot) -> Result<ModelSpec, BodyError> {
    let problem = |problem: String| BodyError::Spec { model: robot.name.clone(), problem };
    for joint in &robot.joints {
        for end in [&joint.parent.link, &joint.child.link] {
            if !robot.links.iter().any(|link| link.name == *end) {
                return Err(problem(format!("joint `{}` names the link `{end}`, which does not exist", joint.name)));
            }
        }
    }
    let is_child = |name: &str| robot.joints.iter().any(|joint| joint.child.link == name);
    let roots: Vec<&str> = robot.links.iter().map(|link| link.name.as_str()).filter(|name| !is_child(name)).collect();
    let [root] = roots.as_slice() else {
        return Err(problem(format!("it has {} root links, and needs one: {}", roots.len(), roots.join(", "))));
    };
    let mut root = *root;
    let below: Vec<_> = robot.joints.iter().filter(|joint| joint.parent.link == root).collect();
    if let [joint] = below.as_slice()
        && joint.joint_type == JointType::Floating
        && inertia_of(robot, root).mass_kg == 0.0
    {
        root = &joint.child.link;
    }

    let mut links = vec![LinkSpec {
        name: root.to_owned(),
        parent: None,
        joint: JointSpec::Free,
        position_m: [0.0; 3],
        rpy_rad: [0.0; 3],
        inertia: Some(inertia_of(robot, root)),
    }];
    let mut next = 0;
    while next < links.len() {
        let parent = links[next].name.clone();
        for joint in robot.joints.iter().filter(|joint| joint.parent.link == parent) {
            let name = joint.child.link.clone();
            if links.iter().any(|link| link.name == name) {
                return Err(problem(format!("link `{name}` has two joints that carry it")));
            }
            let kind = match joint.joint_type {
                JointType::Revolute | JointType::Continuous => JointSpec::Revolute(*joint.axis.xyz),
                JointType::Prismatic => JointSpec::Prismatic(*joint.axis.xyz),
                JointType::Fixed => JointSpec::Fixed,
                JointType::Spherical => JointSpec::Spherical,
                JointType::Floating | JointType::Planar => {
                    return Err(problem(format!(
                        "joint `{}` is floating or planar, which only the massless root's joint may be (floating)",
                        joint.name
                    )));
                }
            };
            links.push(LinkSpec {
                inertia: Some(inertia_of(robot, &name)),
                name,
                parent: Some(parent.clone()),
                joint: kind,
                position_m: *joint.origin.xyz,
                rpy_rad: *joint.origin.rpy,
            });
        }
        next += 1;
    }
    // A loop has no root, so its links are never reached.
    let dropped = usize::from(links[0].name != *roots[0]);
    if links.len() + dropped != robot.links.len() {
        return Err(problem("some links form a loop or hang on nothing".to_owned()));
    }
    Ok(ModelSpec::new(robot.name.clone(), links))
}

fn inertia_of(robot: &Robot, name: &str) -> LinkInertia {
    let inertial = robot.links.iter().find(|link| link.name == name).map(|link| &link.inertial);
    let Some(inertial) = inertial else {
        return LinkInertia { mass_kg: 0.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::zeros() };
    };
    let [roll, pitch, yaw] = *inertial.origin.rpy;
    let r = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
    let i = &inertial.inertia;
    let tensor = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    LinkInertia {
        mass_kg: inertial.mass.value,
        com_m: Vector3::from(*inertial.origin.xyz),
        inertia_com_kgm2: r * tensor * r.transpose(),
    }
}
