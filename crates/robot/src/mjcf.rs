//! Reads MuJoCo's XML: bodies, hinges, slides and inertials of one tree.
//!
//! Understood: `compiler` (angle, eulerseq), `default` classes and `childclass` for joints, all
//! notations of an orientation, joints away from the origin of their body, several joints in one
//! body if only the last one carries mass. Not understood, with an error: `include`, `attach`,
//! `frame`, `replicate`, ball joints, inertias that MuJoCo would compute from geoms (save the
//! compiled model with `mj_saveLastXML` and `saveinertial` first).

use crate::RobotError;
use crate::collision::{Shape, Solid};
use crate::model::{Raw, RobotJoint, SCALAR};
use crate::xml::parse;
use aloft_body::{JointSpec, LinkInertia, LinkSpec, ModelSpec};
use nalgebra::{Isometry3, Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};
use roxmltree::Node;

struct Reader<'a, 't> {
    file: &'a str,
    document: &'a roxmltree::Document<'t>,
    degrees: bool,
    eulerseq: String,
    links: Vec<LinkSpec>,
    joints: Vec<RobotJoint>,
    moved: Vec<(String, [f64; 3])>,
    shapes: Vec<Shape>,
}

/// What to do with what only MuJoCo's compiler understands.
const COMPILED: &str =
    "add `saveinertial=\"true\"` to <compiler>, save the compiled model with mj_saveLastXML, and use that";

/// Reads MJCF.
pub(crate) fn read(file: &str, text: &str) -> Result<Raw, RobotError> {
    let document = parse(file, text)?;
    let root = document.root_element();
    let compilers = || root.children().filter(|n| n.has_tag_name("compiler"));
    let setting = |name: &str| compilers().filter_map(|c| c.attribute(name)).next_back();
    let mut reader = Reader {
        file,
        document: &document,
        degrees: setting("angle") != Some("radian"),
        eulerseq: setting("eulerseq").unwrap_or("xyz").to_owned(),
        links: Vec::new(),
        joints: Vec::new(),
        moved: Vec::new(),
        shapes: Vec::new(),
    };
    for name in ["include", "attach", "frame", "replicate", "composite", "flexcomp"] {
        if let Some(node) = root.descendants().find(|n| n.has_tag_name(name)) {
            let problem = format!("`{name}` is not understood; {COMPILED}");
            return Err(reader.at(node, problem));
        }
    }
    // what MuJoCo's compiler would change in masses and inertias
    let changes = |c: Node<'_, '_>| {
        let positive =
            |n: &str| c.attribute(n).filter(|t| finite_numbers(t).is_none_or(|x| x.iter().any(|x| *x > 0.0)));
        c.attribute("inertiafromgeom")
            .filter(|t| *t == "true")
            .map(|_| "inertiafromgeom")
            .or_else(|| ["settotalmass", "boundmass", "boundinertia"].into_iter().find(|n| positive(n).is_some()))
    };
    if let Some((compiler, name)) = compilers().find_map(|c| Some((c, changes(c)?))) {
        return Err(reader.at(compiler, format!("`{name}` of <compiler> changes masses or inertias; {COMPILED}")));
    }
    if let Some(second) = root.children().filter(|n| n.has_tag_name("default")).nth(1) {
        return Err(reader.at(second, format!("a second <default> at the top is not understood; {COMPILED}")));
    }
    let tops: Vec<Node<'_, '_>> = root
        .children()
        .filter(|n| n.has_tag_name("worldbody"))
        .flat_map(|w| w.children().filter(|n| n.has_tag_name("body")))
        .collect();
    let [top] = tops.as_slice() else {
        let names: Vec<&str> = tops.iter().filter_map(|b| b.attribute("name")).collect();
        let problem = format!("{} bodies in the world ({}), expected one robot", tops.len(), names.join(", "));
        return Err(RobotError::model(file, problem));
    };
    let name = root.attribute("model").unwrap_or("robot").to_owned();
    let class = top.parent().and_then(|w| w.attribute("childclass")).map(str::to_owned);
    reader.body(*top, None, class.as_deref(), Vector3::zeros())?;
    let Reader { links, joints, moved, shapes, .. } = reader;
    Ok(Raw { spec: ModelSpec::new(name, links), joints, moved, shapes })
}

impl Reader<'_, '_> {
    fn at(&self, node: Node<'_, '_>, problem: String) -> RobotError {
        let line = self.document.text_pos_at(node.range().start).row;
        RobotError::Model { file: self.file.to_owned(), line: Some(line), problem }
    }

    fn numbers(&self, node: Node<'_, '_>, name: &str, count: usize) -> Result<Option<Vec<f64>>, RobotError> {
        let Some(text) = node.attribute(name) else { return Ok(None) };
        match finite_numbers(text).filter(|f| f.len() == count) {
            Some(found) => Ok(Some(found)),
            None => Err(self.at(node, format!("`{name}` is `{text}`, expected {count} numbers"))),
        }
    }

    fn vector(&self, node: Node<'_, '_>, name: &str) -> Result<Option<Vector3<f64>>, RobotError> {
        Ok(self.numbers(node, name, 3)?.map(|v| Vector3::new(v[0], v[1], v[2])))
    }

    fn angle(&self, value: f64) -> f64 {
        if self.degrees { value.to_radians() } else { value }
    }

    /// Orientation of a body or inertial frame in its parent.
    fn orientation(&self, node: Node<'_, '_>) -> Result<UnitQuaternion<f64>, RobotError> {
        let axes = |x: Vector3<f64>, y: Vector3<f64>| {
            let y = y - x * (x.dot(&y) / x.norm_squared());
            let (x, y) = (x.normalize(), y.normalize());
            UnitQuaternion::from_matrix(&Matrix3::from_columns(&[x, y, x.cross(&y)]))
        };
        if let Some(q) = self.numbers(node, "quat", 4)? {
            let q = nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]);
            if q.norm() < 1e-9 {
                return Err(self.at(node, "`quat` has no length".to_owned()));
            }
            return Ok(UnitQuaternion::new_normalize(q));
        }
        if let Some(a) = self.numbers(node, "axisangle", 4)? {
            let axis = Unit::try_new(Vector3::new(a[0], a[1], a[2]), 1e-12)
                .ok_or_else(|| self.at(node, "the axis of `axisangle` has no direction".to_owned()))?;
            return Ok(UnitQuaternion::from_axis_angle(&axis, self.angle(a[3])));
        }
        if let Some(a) = self.numbers(node, "xyaxes", 6)? {
            return Ok(axes(Vector3::new(a[0], a[1], a[2]), Vector3::new(a[3], a[4], a[5])));
        }
        if let Some(z) = self.vector(node, "zaxis")? {
            return UnitQuaternion::rotation_between(&Vector3::z(), &z)
                .or(Some(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)))
                .ok_or_else(|| self.at(node, "`zaxis` has no direction".to_owned()));
        }
        if let Some(angles) = self.numbers(node, "euler", 3)? {
            let mut q = UnitQuaternion::identity();
            for (letter, angle) in self.eulerseq.chars().zip(angles) {
                let axis = match letter.to_ascii_lowercase() {
                    'x' => Vector3::x_axis(),
                    'y' => Vector3::y_axis(),
                    _ => Vector3::z_axis(),
                };
                let turn = UnitQuaternion::from_axis_angle(&axis, self.angle(angle));
                // lower case: about the axes that move along, upper case: about fixed ones
                q = if letter.is_lowercase() { q * turn } else { turn * q };
            }
            return Ok(q);
        }
        Ok(UnitQuaternion::identity())
    }

    /// An attribute of a joint: its own, or that of its default class and the classes above.
    fn joint_attribute<'n>(&'n self, joint: Node<'n, 'n>, class: Option<&str>, name: &str) -> Option<&'n str> {
        self.attribute("joint", joint, class, name)
    }

    /// The same of any element with default classes.
    fn attribute<'n>(&'n self, element: &str, joint: Node<'n, 'n>, class: Option<&str>, name: &str) -> Option<&'n str> {
        if let Some(own) = joint.attribute(name) {
            return Some(own);
        }
        let defaults = self.document.root_element().children().find(|n| n.has_tag_name("default"))?;
        let wanted = joint.attribute("class").or(class);
        let start = match wanted {
            None => defaults,
            Some(wanted) => defaults
                .descendants()
                .find(|n| n.has_tag_name("default") && n.attribute("class") == Some(wanted))
                .unwrap_or(defaults),
        };
        start
            .ancestors()
            .filter(|n| n.has_tag_name("default"))
            .find_map(|d| d.children().find(|n| n.has_tag_name(element)).and_then(|j| j.attribute(name)))
    }

    /// `up` is the origin of the parent's link frame in the frame of the parent's body.
    fn body(
        &mut self,
        body: Node<'_, '_>,
        parent: Option<&str>,
        class: Option<&str>,
        up: Vector3<f64>,
    ) -> Result<(), RobotError> {
        let own_class = body.attribute("childclass").or(class);
        let name = body.attribute("name").map_or_else(|| format!("body{}", self.links.len()), str::to_owned);
        let moving: Vec<Node<'_, '_>> =
            body.children().filter(|n| n.has_tag_name("joint") || n.has_tag_name("freejoint")).collect();
        let inertia = self.inertia(body, own_class)?;
        let pose = Isometry3::from_parts(self.vector(body, "pos")?.unwrap_or_default().into(), self.orientation(body)?);
        let link = |name: &str, parent: Option<&str>, joint: JointSpec, pose: &Isometry3<f64>, inertia| {
            let (roll, pitch, yaw) = pose.rotation.euler_angles();
            LinkSpec {
                name: name.to_owned(),
                parent: parent.map(str::to_owned),
                joint,
                position_m: pose.translation.vector.into(),
                rpy_rad: [roll, pitch, yaw],
                inertia: Some(inertia),
            }
        };
        let is_free = |j: &Node<'_, '_>| {
            j.has_tag_name("freejoint") || self.joint_attribute(*j, own_class, "type") == Some("free")
        };
        let Some(parent) = parent else {
            if let Some(joint) = moving.iter().find(|j| !is_free(j)) {
                return Err(
                    self.at(*joint, format!("the robot's first body `{name}` has a joint; expected a free one"))
                );
            }
            self.links.push(link(&name, None, JointSpec::Free, &Isometry3::identity(), inertia));
            self.collision(body, &name, own_class, Vector3::zeros())?;
            return self.children(body, &name, own_class, Vector3::zeros());
        };
        let mut above = parent.to_owned();
        let mut here = Isometry3::from_parts((pose.translation.vector - up).into(), pose.rotation);
        let mut moved = Vector3::zeros();
        if moving.is_empty() {
            self.links.push(link(&name, Some(&above), JointSpec::Fixed, &here, inertia));
        }
        for (i, joint) in moving.iter().enumerate() {
            let attribute = |n: &str| self.joint_attribute(*joint, own_class, n);
            let vector = |n: &str, default: Vector3<f64>| -> Result<Vector3<f64>, RobotError> {
                let Some(text) = attribute(n) else { return Ok(default) };
                match finite_numbers(text).as_deref() {
                    Some([x, y, z]) => Ok(Vector3::new(*x, *y, *z)),
                    _ => Err(self.at(*joint, format!("`{n}` is `{text}`, expected 3 numbers"))),
                }
            };
            let number = |n: &str| -> Result<Option<f64>, RobotError> {
                let first = |t: &str| finite_numbers(t)?.first().copied();
                let Some(text) = attribute(n) else { return Ok(None) };
                first(text).map(Some).ok_or_else(|| self.at(*joint, format!("`{n}` is `{text}`, expected a number")))
            };
            let axis: [f64; 3] = vector("axis", Vector3::z())?.into();
            let (prismatic, kind) = match attribute("type").unwrap_or("hinge") {
                "hinge" => (false, JointSpec::Revolute(axis)),
                "slide" => (true, JointSpec::Prismatic(axis)),
                other => return Err(self.at(*joint, format!("a joint of type `{other}`: {SCALAR}"))),
            };
            let joint_name = joint.attribute("name").map_or_else(|| format!("{name}_joint{i}"), str::to_owned);
            let at = if prismatic { moved } else { vector("pos", Vector3::zeros())? };
            let anchor = at - moved;
            let last = i + 1 == moving.len();
            let own = if last { name.clone() } else { format!("{name}/{joint_name}") };
            // the drawing shows the joint at its reference
            let reference = number("ref")?.map_or(0.0, |x| if prismatic { x } else { self.angle(x) });
            let along = Unit::try_new(Vector3::from(axis), 1e-12)
                .ok_or_else(|| self.at(*joint, "the axis has no direction".to_owned()))?;
            let back_to_zero = if prismatic {
                Isometry3::from_parts((along.into_inner() * -reference).into(), UnitQuaternion::identity())
            } else {
                Isometry3::from_parts(Vector3::zeros().into(), UnitQuaternion::from_axis_angle(&along, -reference))
            };
            let placed = here * Isometry3::translation(anchor.x, anchor.y, anchor.z) * back_to_zero;
            moved = at;
            let back = Isometry3::translation(-moved.x, -moved.y, -moved.z);
            let massless = LinkInertia { mass_kg: 0.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::zeros() };
            let carried = if last { inertia.transformed(&back) } else { massless };
            let pair = |n: &str| -> Result<Option<(f64, f64)>, RobotError> {
                let Some(text) = attribute(n) else { return Ok(None) };
                match finite_numbers(text).as_deref() {
                    Some([low, high]) => Ok(Some((*low, *high))),
                    _ => Err(self.at(*joint, format!("`{n}` is `{text}`, expected 2 numbers"))),
                }
            };
            let range = pair("range")?;
            let turn = |x: f64| if prismatic { x } else { self.angle(x) };
            let limits = range.filter(|(a, b)| b > a && attribute("limited") != Some("false"));
            let effort = pair("actuatorfrcrange")?.map(|(_, most)| most);
            let description = RobotJoint {
                name: joint_name,
                link: own.clone(),
                prismatic,
                limits: limits.map(|(a, b)| (turn(a), turn(b))),
                effort,
                rate: None,
                damping: number("damping")?.unwrap_or(0.0),
                friction: number("frictionloss")?.unwrap_or(0.0),
                armature: number("armature")?.unwrap_or(0.0),
            };
            self.links.push(link(&own, Some(&above), kind, &placed, carried));
            self.joints.push(description);
            above = own;
            here = Isometry3::identity();
        }
        if moved != Vector3::zeros() {
            self.moved.push((name.clone(), moved.into()));
        }
        self.collision(body, &name, own_class, moved)?;
        self.children(body, &name, own_class, moved)
    }

    /// Collision geometry of a body; geoms that collide with nothing are drawings. `moved` is the
    /// origin of the link's frame in the frame of the body.
    fn collision(
        &mut self,
        body: Node<'_, '_>,
        link: &str,
        class: Option<&str>,
        moved: Vector3<f64>,
    ) -> Result<(), RobotError> {
        let mut found = Vec::new();
        for geom in body.children().filter(|n| n.has_tag_name("geom")) {
            let attribute = |n: &str| self.attribute("geom", geom, class, n);
            let list = |n: &str| -> Result<Option<Vec<f64>>, RobotError> {
                let Some(text) = attribute(n) else { return Ok(None) };
                finite_numbers(text)
                    .map(Some)
                    .ok_or_else(|| self.at(geom, format!("`{n}` is `{text}`, expected numbers")))
            };
            if attribute("contype") == Some("0") && attribute("conaffinity") == Some("0") {
                continue;
            }
            let size = list("size")?.unwrap_or_default();
            let short = |count: usize| self.at(geom, format!("`size` has {} numbers, expected {count}", size.len()));
            let of = |i: usize| size.get(i).copied().ok_or_else(|| short(i + 1));
            let three = || Ok(Vector3::new(of(0)?, of(1)?, of(2)?));
            let mut pose = Isometry3::from_parts(
                list("pos")?
                    .filter(|p| p.len() == 3)
                    .map_or(Vector3::zeros(), |p| Vector3::new(p[0], p[1], p[2]))
                    .into(),
                self.orientation(geom)?,
            );
            let mut half = None;
            if let Some(ends) = list("fromto")?.filter(|f| f.len() == 6) {
                let (a, b) = (Vector3::new(ends[0], ends[1], ends[2]), Vector3::new(ends[3], ends[4], ends[5]));
                let turn = UnitQuaternion::rotation_between(&Vector3::z(), &(b - a))
                    .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
                pose = Isometry3::from_parts(((a + b) * 0.5).into(), turn);
                half = Some(0.5 * (b - a).norm());
            }
            let along = || half.map_or_else(|| of(1), Ok);
            let solid = match attribute("type").unwrap_or("sphere") {
                "sphere" => Some(Solid::Sphere(of(0)?)),
                "capsule" => Some(Solid::Capsule(of(0)?, along()?)),
                "cylinder" => Some(Solid::Cylinder(of(0)?, along()?)),
                "box" => Some(Solid::Box(three()?)),
                "ellipsoid" => Some(Solid::Ellipsoid(three()?)),
                _ => None,
            };
            if let Some(bad) = solid.filter(|s| !s.is_sound()) {
                return Err(self.at(geom, format!("collision geometry {bad:?}, expected sizes of zero or more")));
            }
            pose.translation.vector -= moved;
            found.push(Shape { link: link.to_owned(), pose, solid });
        }
        self.shapes.extend(found);
        Ok(())
    }

    fn children(
        &mut self,
        body: Node<'_, '_>,
        name: &str,
        class: Option<&str>,
        moved: Vector3<f64>,
    ) -> Result<(), RobotError> {
        for child in body.children().filter(|n| n.has_tag_name("body")) {
            self.body(child, Some(name), class, moved)?;
        }
        Ok(())
    }

    /// Inertia of a body in its own frame.
    fn inertia(&self, body: Node<'_, '_>, class: Option<&str>) -> Result<LinkInertia, RobotError> {
        let Some(node) = body.children().find(|n| n.has_tag_name("inertial")) else {
            let weighs = |geom: Node<'_, '_>| {
                let is_zero =
                    |n: &str| self.attribute("geom", geom, class, n).is_some_and(|t| t.trim().parse() == Ok(0.0));
                geom.has_tag_name("geom") && !is_zero("mass") && !is_zero("density")
            };
            if body.children().any(weighs) {
                let problem = format!(
                    "body `{}` has no `inertial`, so MuJoCo computes it from geoms; {COMPILED}",
                    body.attribute("name").unwrap_or("?")
                );
                return Err(self.at(body, problem));
            }
            return Ok(LinkInertia { mass_kg: 0.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::zeros() });
        };
        let mass_kg =
            self.numbers(node, "mass", 1)?.ok_or_else(|| self.at(node, "`inertial` has no `mass`".to_owned()))?[0];
        let com_m = self.vector(node, "pos")?.unwrap_or_default();
        let rotation: Rotation3<f64> = self.orientation(node)?.to_rotation_matrix();
        let own = if let Some(i) = self.numbers(node, "fullinertia", 6)? {
            Matrix3::new(i[0], i[3], i[4], i[3], i[1], i[5], i[4], i[5], i[2])
        } else if let Some(d) = self.vector(node, "diaginertia")? {
            Matrix3::from_diagonal(&d)
        } else {
            return Err(self.at(node, "`inertial` has neither `fullinertia` nor `diaginertia`".to_owned()));
        };
        let r = rotation.into_inner();
        Ok(LinkInertia { mass_kg, com_m, inertia_com_kgm2: r * own * r.transpose() })
    }
}

/// Finite numbers between spaces; none if something else stands there.
fn finite_numbers(text: &str) -> Option<Vec<f64>> {
    // none: the caller names the attribute
    text.split_whitespace().map(|w| w.parse::<f64>().ok().filter(|x| x.is_finite())).collect()
}
