//! A robot's model file as a kinematic tree with named joints.
//!
//! Links that are fixed to their parents are merged with them: no motion can tell them apart. What
//! was merged is kept, so that identified inertias can be written back ([`crate::patch`]).

use crate::collision::{LinkSpheres, Shape, Solid, link_boxes, link_spheres};
use crate::{RobotError, mjcf};
use aloft_body::{JointSpec, LinkBox, LinkInertia, LinkSpec, Model, ModelSpec};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Format of a model file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Unified Robot Description Format.
    Urdf,
    /// MuJoCo's XML.
    Mjcf,
}

impl Format {
    /// The format of a text, judged by its outermost element.
    ///
    /// # Errors
    /// [`RobotError::Model`] for text that is not XML, or neither of the two.
    pub fn of(file: &str, text: &str) -> Result<Self, RobotError> {
        let document = crate::xml::parse(file, text)?;
        match document.root_element().tag_name().name() {
            "robot" => Ok(Self::Urdf),
            "mujoco" => Ok(Self::Mjcf),
            other => Err(RobotError::model(
                file,
                format!("its outermost element is `{other}`, expected `robot` (URDF) or `mujoco` (MJCF)"),
            )),
        }
    }
}

/// A joint that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotJoint {
    /// Name in the model file and in logs.
    pub name: String,
    /// Link that it carries.
    pub link: String,
    /// True for a translation.
    pub prismatic: bool,
    /// Limits of the coordinate, rad or m.
    pub limits: Option<(f64, f64)>,
    /// Largest torque or force, N·m or N.
    pub effort: Option<f64>,
    /// Largest rate, rad/s or m/s.
    pub rate: Option<f64>,
    /// Viscous friction, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// Coulomb friction, N·m or N.
    pub friction: f64,
    /// Reflected inertia, kg·m² or kg.
    pub armature: f64,
}

/// A link of the file that is fixed to another one and counted as part of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Merged {
    /// Its name in the file.
    pub name: String,
    /// The link of the model that it is part of.
    pub into: String,
    /// Its inertia, in the frame of that link.
    pub inertia: LinkInertia,
}

/// A robot's model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotModel {
    /// File, for messages.
    pub file: String,
    /// Format of the file.
    pub format: Format,
    /// Links that move against each other, with their inertias; the root is free.
    pub spec: ModelSpec,
    /// Joints in the order of the links that they carry.
    pub joints: Vec<RobotJoint>,
    /// Links merged with others.
    pub merged: Vec<Merged>,
    /// What was changed in the file's inertias.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// Where the origin of a link's frame is in the frame of the body in the file, m, for links
    /// where these differ (MJCF joints that are not at the origin of their body).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moved: Vec<(String, [f64; 3])>,
    /// Spheres about the collision geometry of links that have some.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub collision: Vec<LinkSpheres>,
    /// The box about all collision geometry of each link that has some and no mesh.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<(String, LinkBox)>,
    /// Links with collision meshes, which are not read.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub collision_meshes: Vec<String>,
}

impl RobotModel {
    /// Reads URDF or MJCF. Meshes, sites, sensors and actuators are ignored.
    ///
    /// # Errors
    /// [`RobotError::Model`] for text that is neither, for joints that logs cannot describe
    /// (planar, ball, floating inside the tree), and for a link that moves and has no inertia.
    pub fn parse(file: &str, text: &str) -> Result<Self, RobotError> {
        let format = Format::of(file, text)?;
        let mut raw = match format {
            Format::Urdf => from_urdf(file, text)?,
            Format::Mjcf => mjcf::read(file, text)?,
        };
        let remarks = crate::possible::inertias(file, &mut raw.spec)?;
        let mut model = raw.merge_fixed(file, format);
        model.remarks = remarks;
        model.joints.sort_by_key(|j| model.spec.links.iter().position(|l| l.name == j.link));
        for link in &model.spec.links {
            let Some(inertia) = &link.inertia else { continue };
            if !(inertia.mass_kg > 0.0 && inertia.inertia_com_kgm2.iter().all(|x| x.is_finite())) {
                let (name, mass_kg) = (&link.name, inertia.mass_kg);
                let problem = match link.parent {
                    None => format!(
                        "the root `{name}` has a mass of {mass_kg} kg: it counts as the free base of a body in flight, and needs a mass (the mount of an arm has none)"
                    ),
                    Some(_) if name.contains('/') => format!(
                        "`{name}` is what lies between two joints of one body, and has no mass: bodies with several joints are not understood yet"
                    ),
                    Some(_) => format!(
                        "link `{name}` moves and has a mass of {mass_kg} kg; a link that moves needs an inertia to start from: give it one, or make its joint fixed"
                    ),
                };
                return Err(RobotError::model(file, problem));
            }
        }
        Model::from_spec(&model.spec).map_err(|e| RobotError::model(file, e.to_string()))?;
        Ok(model)
    }

    /// A joint by name.
    pub fn joint(&self, name: &str) -> Option<&RobotJoint> {
        self.joints.iter().find(|j| j.name == name)
    }

    /// Mass of all links, kg.
    pub fn mass_kg(&self) -> f64 {
        self.spec.links.iter().filter_map(|l| l.inertia).map(|i| i.mass_kg).sum()
    }
}

/// A model before fixed links are merged.
pub(crate) struct Raw {
    pub spec: ModelSpec,
    pub joints: Vec<RobotJoint>,
    pub moved: Vec<(String, [f64; 3])>,
    pub shapes: Vec<Shape>,
}

fn placement(link: &LinkSpec) -> Isometry3<f64> {
    let [roll, pitch, yaw] = link.rpy_rad;
    Isometry3::from_parts(Vector3::from(link.position_m).into(), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn sum(a: &LinkInertia, b: &LinkInertia) -> LinkInertia {
    if a.mass_kg + b.mass_kg == 0.0 {
        // two links without mass: only their inertias, if any, add up
        return LinkInertia { inertia_com_kgm2: a.inertia_com_kgm2 + b.inertia_com_kgm2, ..*a };
    }
    LinkInertia::from_phi(&(a.to_phi() + b.to_phi()))
}

impl Raw {
    fn merge_fixed(self, file: &str, format: Format) -> RobotModel {
        let mut links: Vec<LinkSpec> = Vec::new();
        // for every link of the file: the kept link that it belongs to, and its pose there
        let mut home: Vec<(String, String, Isometry3<f64>)> = Vec::new();
        let mut merged = Vec::new();
        for mut link in self.spec.links {
            let own = link.name.clone();
            let above = link.parent.as_ref().and_then(|p| home.iter().find(|h| h.0 == *p)).cloned();
            let Some((_, kept, pose)) = above else {
                home.push((own.clone(), own, Isometry3::identity()));
                links.push(link);
                continue;
            };
            let here = pose * placement(&link);
            if link.joint != JointSpec::Fixed {
                // untouched where the parent was kept: composing would only add rounding
                if pose != Isometry3::identity() {
                    link.position_m = here.translation.vector.into();
                    let (roll, pitch, yaw) = here.rotation.euler_angles();
                    link.rpy_rad = [roll, pitch, yaw];
                }
                link.parent = Some(kept);
                home.push((own.clone(), own, Isometry3::identity()));
                links.push(link);
                continue;
            }
            if let (Some(inertia), Some(into)) = (link.inertia, links.iter_mut().find(|l| l.name == kept)) {
                let inertia = inertia.transformed(&here);
                into.inertia = Some(into.inertia.map_or(inertia, |i| sum(&i, &inertia)));
                merged.push(Merged { name: own.clone(), into: kept.clone(), inertia });
            }
            home.push((own, kept, here));
        }
        let spec = ModelSpec::new(self.spec.name, links);
        let (collision, collision_meshes) = link_spheres(&self.shapes, &home);
        let boxes = link_boxes(&self.shapes, &home);
        let (file, joints, moved) = (file.to_owned(), self.joints, self.moved);
        RobotModel {
            file,
            format,
            spec,
            joints,
            merged,
            remarks: Vec::new(),
            moved,
            collision,
            boxes,
            collision_meshes,
        }
    }
}

fn from_urdf(file: &str, text: &str) -> Result<Raw, RobotError> {
    let text = &crate::urdf::plain(file, text)?;
    let strip = |e: aloft_body::BodyError| RobotError::model(file, e.to_string());
    let spec = ModelSpec::from_urdf(text).map_err(strip)?;
    let robot = urdf_rs::read_from_string(text).map_err(|e| RobotError::model(file, e.to_string()))?;
    let mut joints = Vec::new();
    for link in &spec.links {
        let prismatic = match link.joint {
            JointSpec::Revolute(_) => false,
            JointSpec::Prismatic(_) => true,
            JointSpec::Spherical => {
                return Err(RobotError::model(file, format!("the joint of `{}` is spherical: {SCALAR}", link.name)));
            }
            _ => continue,
        };
        let Some(joint) = robot.joints.iter().find(|j| j.child.link == link.name) else { continue };
        let limited = joint.joint_type != urdf_rs::JointType::Continuous && joint.limit.upper > joint.limit.lower;
        joints.push(RobotJoint {
            name: joint.name.clone(),
            link: link.name.clone(),
            prismatic,
            limits: limited.then_some((joint.limit.lower, joint.limit.upper)),
            effort: (joint.limit.effort > 0.0).then_some(joint.limit.effort),
            rate: (joint.limit.velocity > 0.0).then_some(joint.limit.velocity),
            damping: joint.dynamics.as_ref().map_or(0.0, |d| d.damping),
            friction: joint.dynamics.as_ref().map_or(0.0, |d| d.friction),
            armature: 0.0,
        });
    }
    let mut shapes = Vec::new();
    for link in &robot.links {
        for collision in &link.collision {
            let (at, turn) = (collision.origin.xyz.0, collision.origin.rpy.0);
            let pose = Isometry3::from_parts(
                Vector3::from(at).into(),
                UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]),
            );
            let solid = match &collision.geometry {
                urdf_rs::Geometry::Box { size } => Some(Solid::Box(Vector3::from(size.0) * 0.5)),
                urdf_rs::Geometry::Cylinder { radius, length } => Some(Solid::Cylinder(*radius, 0.5 * length)),
                urdf_rs::Geometry::Capsule { radius, length } => Some(Solid::Capsule(*radius, 0.5 * length)),
                urdf_rs::Geometry::Sphere { radius } => Some(Solid::Sphere(*radius)),
                urdf_rs::Geometry::Mesh { .. } => None,
            };
            if let Some(bad) = solid.filter(|s| !s.is_sound()) {
                let problem = format!("collision geometry of `{}`: {bad:?}, expected sizes of zero or more", link.name);
                return Err(RobotError::model(file, problem));
            }
            shapes.push(Shape { link: link.name.clone(), pose, solid });
        }
    }
    Ok(Raw { spec, joints, moved: Vec::new(), shapes })
}

/// Why a joint with several coordinates cannot be used.
pub(crate) const SCALAR: &str = "logs hold one number a joint, so expected hinges, slides and fixed joints";
