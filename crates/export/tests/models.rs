//! Model files describe our body: read back and posed by the exported coordinates, every link,
//! marker and mass has its position in our model.
#![allow(clippy::unwrap_used, clippy::panic, clippy::expect_used, reason = "tests fail by panicking")]

mod support;

use aloft_body::{JointKind, LinkInertia, Model, ModelSpec, State};
use aloft_export::frame::to_ground;
use aloft_export::{Convention, SubjectExport, TrialExport};
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use std::collections::HashMap;
use support::{Element, bytes, subject, text, trial, written, xml};

fn pose(s: &SubjectExport, t: &TrialExport, f: usize) -> State {
    let model = &s.subject.model;
    let mut state = State::new(model);
    let m = t.filtered.as_ref().unwrap();
    state.forward_acceleration(model, m.q(f), m.v(f), m.a(f));
    state
}

fn vector(numbers: &[f64]) -> Vector3<f64> {
    Vector3::new(numbers[0], numbers[1], numbers[2])
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().map(|w| w.parse().unwrap()).collect()
}

/// Kinematics of an OSIM text: pose of every body in ground, following OpenSim's documentation.
fn osim_poses(model: &Element, values: &HashMap<&str, f64>) -> HashMap<String, Isometry3<f64>> {
    let mut poses = HashMap::from([("/ground".to_owned(), Isometry3::identity())]);
    for joint in &model.at("JointSet/objects").children {
        let frame = |k: usize| {
            let f = &joint.child("frames").children[k];
            let o = f.child("orientation").numbers();
            let r = Rotation3::from_axis_angle(&Vector3::x_axis(), o[0])
                * Rotation3::from_axis_angle(&Vector3::y_axis(), o[1])
                * Rotation3::from_axis_angle(&Vector3::z_axis(), o[2]);
            let t = Translation3::from(vector(&f.child("translation").numbers()));
            (f.child("socket_parent").text.clone(), Isometry3::from_parts(t, UnitQuaternion::from_rotation_matrix(&r)))
        };
        let ((parent, parent_offset), (child, child_offset)) = (frame(0), frame(1));
        let mut moved = Isometry3::identity();
        if joint.name == "CustomJoint" {
            let transform = joint.child("SpatialTransform");
            let value = |axis: &Element| {
                let name = axis.child("coordinates").text.clone();
                if name.is_empty() { 0.0 } else { values[name.as_str()] }
            };
            let mut r = Rotation3::identity();
            let mut t = Vector3::zeros();
            let axes: Vec<Vector3<f64>> =
                transform.children.iter().map(|a| vector(&a.child("axis").numbers())).collect();
            for (k, axis) in transform.children.iter().enumerate() {
                assert!((axes[k].norm() - 1.0).abs() < 1e-12);
                if k < 3 {
                    r *= Rotation3::from_axis_angle(&Unit::new_normalize(axes[k]), value(axis));
                } else {
                    t += axes[k] * value(axis);
                }
            }
            for (a, b) in [(0, 1), (0, 2), (1, 2)] {
                assert!(axes[a].cross(&axes[b]).norm() > 1e-3, "OpenSim refuses collinear axes");
            }
            moved = Isometry3::from_parts(t.into(), UnitQuaternion::from_rotation_matrix(&r));
        }
        let at = poses[&parent] * parent_offset * moved * child_offset.inverse();
        assert!(poses.insert(child, at).is_none());
    }
    poses
}

#[test]
fn validate_osim_poses_masses_and_markers() {
    for convention in [Convention::Model, Convention::Isb] {
        let s = subject(convention);
        let t = trial(&s, &[]);
        let files = written("osim", &s, &t);
        let document = xml(text(&files, "Models/P_01.osim"));
        let model = document.child("Model");
        assert_eq!(numbers(&model.child("gravity").text)[1], -9.80665);
        let series = t.solved.as_ref().unwrap();
        for f in [0, 17, 59] {
            let state = pose(&s, &t, f);
            let values: HashMap<&str, f64> =
                (0..series.n).map(|k| (s.coordinates.list[k].name.as_str(), series.values[f * series.n + k])).collect();
            let poses = osim_poses(model, &values);
            for (marker, m) in model.at("MarkerSet/objects").children.iter().zip(&s.subject.markers) {
                let at = poses[&marker.child("socket_parent_frame").text];
                let p = at * nalgebra::Point3::from(vector(&marker.child("location").numbers()));
                let ours = to_ground(&state.point_in_world(m.link, &m.position_m));
                assert!((p.coords - ours).norm() < 1e-9, "{convention:?} {}: {p} {ours}", m.label);
            }
            let (mut mass, mut moment) = (0.0, Vector3::zeros());
            for body in &model.at("BodySet/objects").children {
                let m = body.child("mass").numbers()[0];
                let at = poses[&format!("/bodyset/{}", body.get("name"))];
                moment += (at * nalgebra::Point3::from(vector(&body.child("mass_center").numbers()))).coords * m;
                mass += m;
            }
            let (ours_mass, ours) = state.centre_of_mass(&s.phi());
            assert!((mass - ours_mass).abs() < 1e-12);
            assert!((moment / mass - to_ground(&ours)).norm() < 1e-9);
        }
        for (link, inertia) in s.subject.model.links.iter().zip(&s.links) {
            let bodies = &model.at("BodySet/objects").children;
            let body = bodies.iter().find(|b| b.get("name") == link.name).unwrap();
            let i = body.child("inertia").numbers();
            let tensor = Matrix3::new(i[0], i[3], i[4], i[3], i[1], i[5], i[4], i[5], i[2]);
            assert!((tensor - inertia.inertia_com_kgm2).norm() < 1e-15);
        }
        let prior = xml(text(&files, "P_01_prior.osim"));
        let mass = prior.child("Model").at("BodySet/objects").children[0].child("mass").numbers()[0];
        assert!((mass - 1.1).abs() < 1e-12);
    }
}

#[test]
fn coordinates_that_were_held_are_locked() {
    let mut s = subject(Convention::Model);
    let t = trial(&s, &[]);
    let at = |name: &str| {
        let model = &s.subject.model;
        model.links[model.link_index(name).unwrap()].joint.v_offset
    };
    let (hand, torso) = (at("hand_r"), at("torso"));
    s.locked = vec![hand, hand + 2, torso, torso + 1, torso + 2];
    let files = written("osim", &s, &t);
    let document = xml(text(&files, "Models/P_01.osim"));
    let mut coordinates = Vec::new();
    document.all("Coordinate", &mut coordinates);
    let locked: Vec<&str> =
        coordinates.iter().filter(|c| c.child("locked").text == "true").map(|c| c.get("name")).collect();
    assert_eq!(locked, ["lumbar_extension", "lumbar_bending", "lumbar_rotation", "wrist_flex_r", "wrist_dev_r"]);
}

#[test]
fn validate_urdf_through_our_own_reader() {
    for convention in [Convention::Model, Convention::Isb] {
        let s = subject(convention);
        let t = trial(&s, &[]);
        let files = written("urdf", &s, &t);
        xml(text(&files, ".urdf"));
        let spec = ModelSpec::from_urdf(text(&files, ".urdf")).unwrap();
        let phi: Vec<_> = spec.inertias().unwrap().iter().map(LinkInertia::to_phi).collect();
        let model = Model::from_spec(&spec).unwrap();
        assert_eq!(model.nv, s.subject.model.nv, "three hinges for each ball");
        let series = t.smooth.as_ref().unwrap();
        let motion = t.filtered.as_ref().unwrap();
        for f in [3, 30] {
            let mut ours = pose(&s, &t, f);
            let (mut q, mut v, mut a) = (model.neutral(), vec![0.0; model.nv], vec![0.0; model.nv]);
            q[..7].copy_from_slice(&motion.q(f)[..7]);
            v[..6].copy_from_slice(&motion.v(f)[..6]);
            a[..6].copy_from_slice(&motion.a(f)[..6]);
            // the reader names links; each moving link belongs to one coordinate
            let document = xml(text(&files, ".urdf"));
            for joint in document.children.iter().filter(|c| c.name == "joint" && c.get("type") != "fixed") {
                let k = s.coordinates.list.iter().position(|c| c.name == joint.get("name")).unwrap();
                let link = &model.links[model.link_index(joint.child("child").get("link")).unwrap()];
                q[link.joint.q_offset] = series.values[f * series.n + k];
                v[link.joint.v_offset] = series.rates[f * series.n + k];
                a[link.joint.v_offset] = series.accelerations[f * series.n + k];
            }
            let mut theirs = State::new(&model);
            theirs.forward_acceleration(&model, &q, &v, &a);
            for (i, link) in s.subject.model.links.iter().enumerate() {
                let j = model.link_index(&link.name).unwrap();
                let difference = ours.world_from_link[i].inverse() * theirs.world_from_link[j];
                assert!(difference.translation.vector.norm() + difference.rotation.angle() < 1e-7, "{}", link.name);
            }
            let (mut tau, mut their_tau) = (vec![0.0; motion.nv], vec![0.0; model.nv]);
            ours.inverse_dynamics(&s.subject.model, &s.phi(), &mut tau);
            theirs.inverse_dynamics(&model, &phi, &mut their_tau);
            for k in 0..6 {
                assert!((tau[k] - their_tau[k]).abs() < 1e-6, "base wrench {k}: {} {}", tau[k], their_tau[k]);
            }
        }
    }
}

/// Poses of an MJCF text for one `qpos`, following MuJoCo's documentation.
fn mjcf_walk(
    body: &Element,
    parent: Isometry3<f64>,
    qpos: &mut impl Iterator<Item = f64>,
    out: &mut Vec<(String, Isometry3<f64>)>,
) {
    let three = |e: &Element, key: &str| Translation3::from(vector(&numbers(e.get(key))));
    let quaternion = |q: &[f64]| UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]));
    let mut at = parent * Isometry3::from_parts(three(body, "pos"), quaternion(&numbers(body.get("quat"))));
    for joint in &body.children {
        let mut take = |n: usize| (0..n).map(|_| qpos.next().unwrap()).collect::<Vec<f64>>();
        match (joint.name.as_str(), joint.get("type")) {
            ("freejoint", _) => {
                let q = take(7);
                at = Isometry3::from_parts(Translation3::new(q[0], q[1], q[2]), quaternion(&q[3..]));
            }
            ("joint", "ball") => at *= quaternion(&take(4)),
            ("joint", "hinge") => {
                let axis = Unit::new_normalize(vector(&numbers(joint.get("axis"))));
                at *= UnitQuaternion::from_axis_angle(&axis, take(1)[0]);
            }
            ("joint", "slide") => at *= Translation3::from(vector(&numbers(joint.get("axis"))) * take(1)[0]),
            _ => {}
        }
    }
    out.push((body.get("name").to_owned(), at));
    for child in body.children.iter().filter(|c| c.name == "body") {
        mjcf_walk(child, at, qpos, out);
    }
}

#[test]
fn validate_mjcf_poses_and_inertias() {
    let s = subject(Convention::Model);
    let t = trial(&s, &[]);
    let files = written("mjcf", &s, &t);
    let document = xml(text(&files, "Models/P_01.xml"));
    let root = document.at("worldbody/body");
    // the keyframe is the static posture
    let mut poses = Vec::new();
    let qpos = numbers(document.at("keyframe/key").get("qpos"));
    assert_eq!(qpos.len(), s.subject.model.nq);
    mjcf_walk(root, Isometry3::identity(), &mut qpos.into_iter(), &mut poses);
    let mut state = State::new(&s.subject.model);
    state.forward_position(&s.subject.model, &s.subject.static_q);
    assert_eq!(poses.len(), s.subject.model.n_links());
    for (name, at) in &poses {
        let i = s.subject.model.link_index(name).unwrap();
        let difference = state.world_from_link[i].inverse() * at;
        assert!(difference.translation.vector.norm() + difference.rotation.angle() < 1e-7, "{name}");
    }
    // a moved posture, in the order of the nested bodies
    let motion = t.filtered.as_ref().unwrap();
    let q = motion.q(33);
    let mut moved = Vec::new();
    for (name, _) in &poses {
        let joint = &s.subject.model.links[s.subject.model.link_index(name).unwrap()].joint;
        let at = joint.q_offset;
        match joint.kind {
            JointKind::Free => moved.extend([q[at], q[at + 1], q[at + 2], q[at + 6], q[at + 3], q[at + 4], q[at + 5]]),
            JointKind::Spherical => moved.extend([q[at + 3], q[at], q[at + 1], q[at + 2]]),
            JointKind::Fixed => {}
            _ => moved.push(q[at]),
        }
    }
    let state = pose(&s, &t, 33);
    let mut poses = Vec::new();
    mjcf_walk(root, Isometry3::identity(), &mut moved.into_iter(), &mut poses);
    for (name, at) in &poses {
        let i = s.subject.model.link_index(name).unwrap();
        let difference = state.world_from_link[i].inverse() * at;
        assert!(difference.translation.vector.norm() + difference.rotation.angle() < 1e-7, "{name}");
    }
    let mut inertials = Vec::new();
    document.all("inertial", &mut inertials);
    let mass: f64 = inertials.iter().map(|i| numbers(i.get("mass"))[0]).sum();
    assert!((mass - s.links.iter().map(|l| l.mass_kg).sum::<f64>()).abs() < 1e-12);
    let i = numbers(root.child("inertial").get("fullinertia"));
    let tensor = Matrix3::new(i[0], i[3], i[4], i[3], i[1], i[5], i[4], i[5], i[2]);
    assert!((tensor - s.links[0].inertia_com_kgm2).norm() < 1e-15);
    assert!(!bytes(&files, ".xml").is_empty());
}
