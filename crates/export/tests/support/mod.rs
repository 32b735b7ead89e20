//! A small body with every kind of joint, moving on known curves, and an XML reader for the tests.
#![allow(dead_code, reason = "each test file uses its part")]

use aloft_body::rotation::quaternion_exp;
use aloft_body::{
    JointKind, JointSpec, LinkInertia, LinkSpec, Model, ModelMarker, ModelSpec, Motion, PersonFacts, Sex, State,
    Subject,
};
use aloft_export::{Convention, Format, InertiaSource, OutFile, PlateAtFrames, SourceFile, SubjectExport, TrialExport};
use aloft_trial::{Event, Markers, Plate, Trial};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

pub const RATE_HZ: f64 = 100.0;
pub const FRAMES: usize = 60;

fn link(name: &str, parent: Option<&str>, joint: JointSpec, position_m: [f64; 3], rpy_rad: [f64; 3]) -> LinkSpec {
    LinkSpec { name: name.into(), parent: parent.map(Into::into), joint, position_m, rpy_rad, inertia: None }
}

pub fn model() -> Model {
    let zero = [0.0; 3];
    let links = vec![
        link("pelvis", None, JointSpec::Free, zero, zero),
        link("torso", Some("pelvis"), JointSpec::Spherical, [-0.05, 0.1, 0.0], zero),
        link("upper_arm_r", Some("torso"), JointSpec::Spherical, [0.0, 0.35, 0.17], [0.02, -0.03, 0.04]),
        link("forearm_r", Some("upper_arm_r"), JointSpec::RevoluteZ, [0.0, -0.3, 0.0], [0.05, 0.1, -0.02]),
        link("hand_r", Some("forearm_r"), JointSpec::Spherical, [0.0, -0.25, 0.01], zero),
        link("upper_arm_l", Some("torso"), JointSpec::Spherical, [0.0, 0.35, -0.17], zero),
        link("thigh_l", Some("pelvis"), JointSpec::Spherical, [0.0, 0.0, -0.09], zero),
        link("shank_l", Some("thigh_l"), JointSpec::RevoluteZ, [0.0, -0.4, 0.0], [-0.02, 0.03, 0.1]),
        link("foot_l", Some("shank_l"), JointSpec::Spherical, [0.0, -0.4, 0.0], zero),
        link("thigh_r", Some("pelvis"), JointSpec::Spherical, [0.0, 0.0, 0.09], zero),
        link("foot_r", Some("thigh_r"), JointSpec::Spherical, [0.0, -0.8, 0.0], zero),
        link("slider", Some("torso"), JointSpec::Prismatic([0.6, 0.8, 0.0]), [0.1, 0.2, 0.0], [0.3, 0.2, 0.1]),
        link("tool", Some("slider"), JointSpec::Fixed, [0.05, 0.0, 0.02], [0.0, 0.4, 0.0]),
    ];
    Model::from_spec(&ModelSpec::new("small".into(), links)).unwrap()
}

pub fn inertias(model: &Model) -> Vec<LinkInertia> {
    (0..model.n_links())
        .map(|i| {
            let x = i as f64;
            let r = UnitQuaternion::from_euler_angles(0.1 * x, 0.2, -0.05 * x).to_rotation_matrix().into_inner();
            let principal = Matrix3::from_diagonal(&Vector3::new(0.02 + 0.001 * x, 0.03, 0.025));
            LinkInertia {
                mass_kg: 1.0 + 0.3 * x,
                com_m: Vector3::new(0.01 * x, -0.1, 0.02 - 0.005 * x),
                inertia_com_kgm2: r * principal * r.transpose(),
            }
        })
        .collect()
}

pub fn subject(convention: Convention) -> SubjectExport {
    let model = model();
    let links = inertias(&model);
    let markers = (0..model.n_links())
        .flat_map(|link| {
            (0..2).map(move |k| ModelMarker {
                label: format!("M{link}{}", ["A", "B"][k]),
                link,
                position_m: Vector3::new(0.05 * k as f64, -0.1, 0.03 - 0.04 * k as f64),
                weight: 1.0 + k as f64,
            })
        })
        .collect();
    let mut static_q = model.neutral();
    static_q[2] = 0.9;
    // a person who faces +X of a Z-up world
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    static_q[3..7].copy_from_slice(upright.coords.as_slice());
    let subject = Subject {
        facts: PersonFacts { name: "P 01".into(), sex: Some(Sex::Female), height_m: Some(1.6), mass_kg: 36.4 },
        markers,
        prior: links.iter().map(|l| LinkInertia { mass_kg: 1.1 * l.mass_kg, ..*l }).collect(),
        prior_sd: Vec::new(),
        static_q,
        provenance: Vec::new(),
        model,
        estimated: None,
        boxes: Vec::new(),
    };
    let source = InertiaSource::Identified {
        rows: "weak".into(),
        remarks: vec!["2 of 9 stay".into()],
        from_table: vec!["hand: mass".into()],
        intervals: "95 % interval from the noise of the recordings".into(),
    };
    SubjectExport::new(subject, links, source, convention, Vec::new(), "aloft test").unwrap()
}

/// Motion on known curves with exact velocities and accelerations.
pub fn motion(subject: &SubjectExport, missing: &[usize]) -> Motion {
    let model = &subject.subject.model;
    let mut m = Motion {
        trial: "jump01".into(),
        rate_hz: RATE_HZ,
        nq: model.nq,
        nv: model.nv,
        marker_labels: subject.subject.markers.iter().map(|m| m.label.clone()).collect(),
        ..Motion::default()
    };
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    for f in 0..FRAMES {
        let t = f as f64 / RATE_HZ;
        let (mut q, mut v, mut a) = (model.neutral(), vec![0.0; model.nv], vec![0.0; model.nv]);
        for (i, link) in model.links.iter().enumerate() {
            let x = i as f64;
            let axis = Vector3::new((1.3 * x).sin(), 0.4 + 0.1 * x, (0.7 * x).cos()).normalize();
            let (w, p) = (3.0 + 0.2 * x, 0.3 * x);
            let (s, ds, dds) = (0.8 * (w * t + p).sin(), 0.8 * w * (w * t + p).cos(), -0.8 * w * w * (w * t + p).sin());
            let joint = &link.joint;
            let (iq, iv) = (joint.q_offset, joint.v_offset);
            let turn = quaternion_exp(&(axis * s));
            match joint.kind {
                JointKind::Free => {
                    let r = upright * turn;
                    let place = Vector3::new(0.2 + t, 0.1 * (2.0 * t).sin(), 0.9 + 0.5 * t - 4.0 * t * t);
                    let speed = Vector3::new(1.0, 0.2 * (2.0 * t).cos(), 0.5 - 8.0 * t);
                    let rate = Vector3::new(0.0, -0.4 * (2.0 * t).sin(), -8.0);
                    let lin = r.inverse() * speed;
                    q[iq..iq + 3].copy_from_slice(place.as_slice());
                    q[iq + 3..iq + 7].copy_from_slice(r.coords.as_slice());
                    v[iv..iv + 3].copy_from_slice(lin.as_slice());
                    v[iv + 3..iv + 6].copy_from_slice((axis * ds).as_slice());
                    let dlin = r.inverse() * rate - (axis * ds).cross(&lin);
                    a[iv..iv + 3].copy_from_slice(dlin.as_slice());
                    a[iv + 3..iv + 6].copy_from_slice((axis * dds).as_slice());
                }
                JointKind::Spherical => {
                    q[iq..iq + 4].copy_from_slice(turn.coords.as_slice());
                    v[iv..iv + 3].copy_from_slice((axis * ds).as_slice());
                    a[iv..iv + 3].copy_from_slice((axis * dds).as_slice());
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => {
                    let size = if matches!(joint.kind, JointKind::Prismatic(_)) { 0.1 } else { 1.0 };
                    (q[iq], v[iv], a[iv]) = (size * s, size * ds, size * dds);
                }
                JointKind::Fixed => {}
            }
        }
        if missing.contains(&f) {
            q.fill(f64::NAN);
            v.fill(f64::NAN);
            a.fill(f64::NAN);
        }
        m.q.extend(q);
        m.v.extend(v);
        m.a.extend(a);
        m.residual_m.extend((0..m.marker_labels.len()).map(|k| 1e-3 * (1.0 + k as f64)));
    }
    m
}

/// A recording of that motion: markers of the model (one gap), one plate under the left foot.
pub fn trial(subject: &SubjectExport, missing: &[usize]) -> TrialExport {
    let motion = motion(subject, missing);
    let model = &subject.subject.model;
    let mut state = State::new(model);
    let mut trajectories = vec![vec![Vector3::repeat(f64::NAN); FRAMES]; subject.subject.markers.len()];
    for f in (0..FRAMES).filter(|&f| motion.is_valid(f)) {
        state.forward_position(model, motion.q(f));
        for (path, m) in trajectories.iter_mut().zip(&subject.subject.markers) {
            path[f] = state.point_in_world(m.link, &m.position_m);
        }
    }
    trajectories[3][20..25].fill(Vector3::repeat(f64::NAN));
    let foot = model.link_index("foot_l").unwrap();
    let wrench = |f: usize| {
        let load = if f < 25 { 400.0 } else { 0.5 };
        let at = if motion.is_valid(f) { motion_point(model, &motion, f, foot) } else { Vector3::zeros() };
        let force = Vector3::new(10.0, -5.0, load);
        let moment = Vector3::new(at.x, at.y, 0.0).cross(&force) + Vector3::new(0.0, 0.0, 2.0);
        Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
    };
    let wrenches: Vec<Vector6<f64>> = (0..FRAMES).map(wrench).collect();
    let part = |first: usize| wrenches.iter().map(|w| Vector3::new(w[first], w[first + 1], w[first + 2])).collect();
    let plate =
        Plate { name: "FP1".into(), rate_hz: RATE_HZ, corners_m: Vec::new(), force_n: part(0), moment_nm: part(3) };
    let mut out = TrialExport {
        name: "jump01".into(),
        role: "identify".into(),
        trial: Trial {
            name: "jump01".into(),
            markers: Markers {
                rate_hz: RATE_HZ,
                first_frame: 11,
                n_frames: FRAMES,
                labels: subject.subject.markers.iter().map(|m| m.label.clone()).collect(),
                trajectories,
            },
            plates: vec![plate],
            events: vec![Event { label: "Foot Off".into(), context: "Left".into(), time_s: 0.25 }],
            ..Trial::default()
        },
        motion: Some(motion.clone()),
        filtered: Some(motion),
        flights: std::iter::once(25..50).collect(),
        plates: vec![PlateAtFrames { name: "FP1".into(), wrench: wrenches }],
        source: SourceFile { name: "jump01.trc".into(), c3d: None },
        file_coordinates: None,
        solved: None,
        smooth: None,
        forces: None,
    };
    out.prepare(subject).unwrap();
    out
}

fn motion_point(model: &Model, motion: &Motion, f: usize, link: usize) -> Vector3<f64> {
    let mut state = State::new(model);
    state.forward_position(model, motion.q(f));
    state.world_from_link[link].translation.vector
}

/// All files of one format.
pub fn written(name: &str, subject: &SubjectExport, trial: &TrialExport) -> Vec<OutFile> {
    let format = Format::choose(&[name.to_owned()]).unwrap()[0];
    let mut out = Vec::new();
    if let Some(write) = format.subject {
        out.extend(write(subject).unwrap());
    }
    if let Some(write) = format.trial {
        out.extend(write(subject, trial).unwrap());
    }
    out
}

pub fn bytes<'a>(files: &'a [OutFile], suffix: &str) -> &'a [u8] {
    let names: Vec<&str> = files.iter().map(|f| f.path.as_str()).collect();
    &files.iter().find(|f| f.path.ends_with(suffix)).unwrap_or_else(|| panic!("no {suffix} among {names:?}")).bytes
}

pub fn text<'a>(files: &'a [OutFile], suffix: &str) -> &'a str {
    std::str::from_utf8(bytes(files, suffix)).unwrap()
}

/// An XML element.
#[derive(Debug, Default, Clone)]
pub struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    pub text: String,
    pub children: Vec<Element>,
}

impl Element {
    pub fn get(&self, attribute: &str) -> &str {
        self.attributes.iter().find(|(k, _)| k == attribute).map_or("", |(_, v)| v)
    }
    pub fn child(&self, name: &str) -> &Element {
        self.children.iter().find(|c| c.name == name).unwrap_or_else(|| panic!("{} has no {name}", self.name))
    }
    pub fn at(&self, path: &str) -> &Element {
        path.split('/').fold(self, |e, name| e.child(name))
    }
    pub fn all<'a>(&'a self, name: &str, out: &mut Vec<&'a Element>) {
        for child in &self.children {
            if child.name == name {
                out.push(child);
            }
            child.all(name, out);
        }
    }
    pub fn numbers(&self) -> Vec<f64> {
        self.text.split_whitespace().map(|w| w.parse().unwrap()).collect()
    }
}

/// Reads the XML written by the exporters; panics if it is not well-formed.
pub fn xml(source: &str) -> Element {
    let mut stack = vec![Element::default()];
    let mut rest = source.strip_prefix("<?xml version=\"1.0\" encoding=\"UTF-8\"?>").expect("a declaration");
    while let Some(at) = rest.find('<') {
        let content = rest[..at].trim();
        assert!(!content.contains('>'), "a stray > in {content}");
        stack.last_mut().unwrap().text.push_str(content);
        rest = &rest[at..];
        if let Some(comment) = rest.strip_prefix("<!--") {
            let end = comment.find("--").expect("the end of a comment");
            assert!(comment[end..].starts_with("-->"), "`--` inside a comment");
            rest = &comment[end + 3..];
            continue;
        }
        let end = rest.find('>').expect("the end of a tag");
        let tag = &rest[1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            let done = stack.pop().unwrap();
            assert_eq!(done.name, name, "tags cross");
            stack.last_mut().expect("one root").children.push(done);
            continue;
        }
        let (tag, empty) = tag.strip_suffix('/').map_or((tag, false), |t| (t, true));
        let (name, attributes) = tag.split_once(' ').unwrap_or((tag, ""));
        let mut element = Element { name: name.to_owned(), ..Element::default() };
        let mut left = attributes.trim();
        while let Some((key, value)) = left.split_once("=\"") {
            let (value, after) = value.split_once('"').expect("a closed attribute");
            assert!(!element.attributes.iter().any(|(k, _)| k == key), "{key} twice in {name}");
            element.attributes.push((key.to_owned(), value.to_owned()));
            left = after.trim();
        }
        assert!(left.is_empty(), "left in {name}: {left}");
        if empty {
            stack.last_mut().unwrap().children.push(element);
        } else {
            stack.push(element);
        }
    }
    assert!(rest.trim().is_empty());
    assert_eq!(stack.len(), 1, "unclosed: {:?}", stack.last().map(|e| e.name.clone()));
    let document = stack.pop().unwrap();
    assert_eq!(document.children.len(), 1, "one root element");
    document.children.into_iter().next().unwrap()
}
