//! Model files: what is read, and what is written back.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_body::{BaseParameters, LinkInertia, Model, State};
use aloft_robot::{RobotModel, patch};
use nalgebra::DMatrix;

const URDF: &str = include_str!("robot.urdf");
const MJCF: &str = include_str!("robot.xml");

fn both() -> [(&'static str, RobotModel); 2] {
    [(URDF, RobotModel::parse("robot.urdf", URDF).unwrap()), (MJCF, RobotModel::parse("robot.xml", MJCF).unwrap())]
}

#[test]
fn urdf_and_mjcf_of_one_robot_give_one_model() {
    let [(_, a), (_, b)] = both();
    assert_eq!(a.spec.links.iter().map(|l| l.name.as_str()).collect::<Vec<_>>(), ["base", "arm", "slider"]);
    for (x, y) in a.spec.links.iter().zip(&b.spec.links) {
        assert_eq!((&x.name, &x.parent, x.joint), (&y.name, &y.parent, y.joint));
        let (i, j) = (x.inertia.unwrap(), y.inertia.unwrap());
        assert!((i.to_phi() - j.to_phi()).amax() < 1e-9, "{}: {} {}", x.name, i.to_phi(), j.to_phi());
        for k in 0..3 {
            assert!((x.position_m[k] - y.position_m[k]).abs() < 1e-12 && (x.rpy_rad[k] - y.rpy_rad[k]).abs() < 1e-9);
        }
    }
    // 4.0 and the battery fixed to it
    assert!((a.spec.links[0].inertia.unwrap().mass_kg - 4.5).abs() < 1e-12);
    assert!((a.mass_kg() - 5.8).abs() < 1e-12);
    let (shoulder, other) = (a.joint("shoulder").unwrap(), b.joint("shoulder").unwrap());
    assert_eq!((shoulder.damping, shoulder.friction, shoulder.effort), (0.1, 0.2, Some(10.0)));
    assert_eq!((other.damping, other.friction, other.armature), (0.05, 0.2, 0.01));
    assert!((other.limits.unwrap().1 - 2.0).abs() < 2e-4, "{:?}", other.limits);
    assert!(b.joint("extend").unwrap().prismatic);
    assert_eq!(b.joint("extend").unwrap().damping, 3.0);
}

#[test]
fn a_joint_away_from_the_origin_of_its_body_moves_the_link_frame() {
    let text = MJCF.replace(r#"axis="0 1 0" range"#, r#"axis="0 1 0" pos="0.02 0 0.03" range"#);
    let [_, (_, plain)] = both();
    let moved = RobotModel::parse("robot.xml", &text).unwrap();
    // the same body in the same place: mass, centre of mass and momentum agree at zero angles
    let (a, b) = (Model::from_spec(&plain.spec).unwrap(), Model::from_spec(&moved.spec).unwrap());
    let at = |model: &Model, robot: &RobotModel| {
        let mut state = State::new(model);
        state.forward_position(model, &model.neutral());
        let phi: Vec<_> = robot.spec.links.iter().map(|l| l.inertia.unwrap().to_phi()).collect();
        (state.centre_of_mass(&phi), state.world_from_link[2].translation.vector)
    };
    let ((m, c), slider) = at(&a, &plain);
    let ((n, d), slider_moved) = at(&b, &moved);
    assert!((m - n).abs() < 1e-12 && (c - d).norm() < 1e-12 && (slider - slider_moved).norm() < 1e-12);
    // written back, the file's numbers come out again
    let links: Vec<_> = moved.spec.links.iter().map(|l| (l.name.clone(), l.inertia.unwrap())).collect();
    let again = RobotModel::parse("robot.xml", &patch::patch(&text, &moved, &links, "x").unwrap().text).unwrap();
    for (x, y) in moved.spec.links.iter().zip(&again.spec.links) {
        assert!((x.inertia.unwrap().to_phi() - y.inertia.unwrap().to_phi()).amax() < 1e-10, "{}", x.name);
    }
}

#[test]
fn only_inertials_change_when_inertias_are_written_back() {
    for (text, model) in both() {
        let links: Vec<(String, LinkInertia)> = model
            .spec
            .links
            .iter()
            .map(|l| {
                let i = l.inertia.unwrap();
                let com_m = i.com_m.add_scalar(0.003);
                (
                    l.name.clone(),
                    LinkInertia { mass_kg: 1.1 * i.mass_kg, com_m, inertia_com_kgm2: i.inertia_com_kgm2 * 1.3 },
                )
            })
            .collect();
        let patched = patch::patch(text, &model, &links, "made by a test -- with dashes").unwrap();
        assert_eq!(patched.written, ["base", "arm", "slider"]);
        let again = RobotModel::parse(&model.file, &patched.text).unwrap();
        for ((name, wanted), link) in links.iter().zip(&again.spec.links) {
            let error = (wanted.to_phi() - link.inertia.unwrap().to_phi()).amax();
            assert!(error < 1e-10, "{name} of {}: {error}", model.file);
        }
        // the battery, fixed to the base, keeps its numbers; all else is as it was
        assert_eq!(again.merged.iter().find(|m| m.name == "battery").unwrap().inertia.mass_kg, 0.5);
        let quiet = |t: &str| -> Vec<String> {
            t.lines().filter(|l| !["inertia", "made by"].iter().any(|w| l.contains(w))).map(str::to_owned).collect()
        };
        assert_eq!(quiet(text), quiet(&patched.text));
        assert!(patched.text.contains("made by a test - - with dashes"));
        assert_eq!(again.joints, model.joints);
    }
}

#[test]
fn a_fixed_link_is_reduced_where_the_whole_is_too_light_for_it() {
    let [(text, model), _] = both();
    let light = LinkInertia { mass_kg: 0.4, ..model.spec.links[0].inertia.unwrap() };
    let light = LinkInertia { inertia_com_kgm2: light.inertia_com_kgm2 * 0.05, ..light };
    let patched = patch::patch(text, &model, &[("base".to_owned(), light)], "x").unwrap();
    assert_eq!(patched.remarks.len(), 1, "{:?}", patched.remarks);
    let again = RobotModel::parse("robot.urdf", &patched.text).unwrap();
    let total = again.spec.links[0].inertia.unwrap();
    assert!((total.mass_kg - 0.4).abs() < 1e-9, "{}", total.mass_kg);
    for m in &again.merged {
        assert!(m.inertia.mass_kg < 0.5 && m.inertia.mass_kg >= 0.0);
    }
}

#[test]
fn inertias_of_no_body_are_refused() {
    let [(text, model), _] = both();
    let mut bad = model.spec.links[1].inertia.unwrap();
    bad.inertia_com_kgm2[(0, 0)] = 1.0;
    let error = patch::patch(text, &model, &[("arm".to_owned(), bad)], "x").unwrap_err().to_string();
    assert_eq!(error, "robot.urdf: the inertia for `arm` is not that of any body");
}

#[test]
fn files_that_cannot_be_used_say_where_and_why() {
    let cases = [
        (URDF.replace("</robot>", ""), "not well-formed XML"),
        ("<sdf/>".to_owned(), "its outermost element is `sdf`, expected `robot` (URDF) or `mujoco` (MJCF)"),
        (URDF.replace(r#"<mass value="1.0"/>"#, r#"<mass value="0"/>"#), "link `arm` moves and has a mass of 0 kg"),
        (MJCF.replace(r#"type="slide""#, r#"type="ball""#), "line 21: a joint of type `ball`"),
        (MJCF.replace("<light", "<include file=\"x\"/><light"), "`include` is not understood"),
        (MJCF.replace("mass=\"1.0\"", "mass=\"heavy\""), "line 18: `mass` is `heavy`, expected 1 numbers"),
        (MJCF.replace("<worldbody>", "<default/><default/><worldbody>"), "a second <default> at the top"),
        (MJCF.replace("<worldbody>", "<compiler settotalmass=\"3\"/><worldbody>"), "`settotalmass` of <compiler>"),
        (MJCF.replace("<worldbody>", "<compiler inertiafromgeom=\"true\"/><worldbody>"), "saveinertial=\"true\""),
        // what was no number was no limit
        (MJCF.replace("range=\"-114.6 114.6\"", "range=\"low high\""), "`range` is `low high`, expected 2 numbers"),
        (MJCF.replace("axis=\"0 1 0\"", "axis=\"0 1 0 x\""), "`axis` is `0 1 0 x`, expected 3 numbers"),
    ];
    for (text, expected) in cases {
        let error = RobotModel::parse("robot", &text).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// MuJoCo turns a joint by its coordinate less `ref`: at `ref` the robot stands as it is drawn.
#[test]
fn a_joint_stands_as_drawn_at_its_reference() {
    let with = MJCF.replace("axis=\"0 1 0\"", "axis=\"0 1 0\" ref=\"28.64788975654116\"");
    assert_ne!(with, MJCF);
    let [plain, with] = [MJCF, &with].map(|text| RobotModel::parse("robot.xml", text).unwrap());
    let [drawn, at_reference] = [(&plain, 0.0), (&with, 0.5)].map(|(robot, angle)| {
        let model = Model::from_spec(&robot.spec).unwrap();
        let mut q = model.neutral();
        let joint =
            &model.links.iter().find(|l| robot.joints.iter().any(|j| j.link == l.name && !j.prismatic)).unwrap().joint;
        q[joint.q_offset] = angle;
        let mut state = State::new(&model);
        state.forward_position(&model, &q);
        let phi: Vec<_> = robot.spec.links.iter().map(|l| l.inertia.unwrap().to_phi()).collect();
        state.centre_of_mass(&phi).1
    });
    assert!((drawn - at_reference).norm() < 1e-12, "{drawn} {at_reference}");
}

#[test]
fn base_rows_have_the_rank_of_the_base_parameters() {
    for (_, robot) in both() {
        let model = Model::from_spec(&robot.spec).unwrap();
        let base = BaseParameters::of(&model);
        let mut state = State::new(&model);
        let mut stacked = DMatrix::zeros(6 * 60, 10 * model.n_links());
        let mut rows = DMatrix::zeros(6, 10 * model.n_links());
        for i in 0..60 {
            let wave = |k: usize, s: f64| ((i * 7 + k * 3) as f64 * s + 0.3).sin();
            let mut q = model.neutral();
            let step: Vec<f64> = (0..model.nv).map(|k| wave(k, 0.37)).collect();
            model.integrate(&model.neutral(), &step, &mut q);
            let v: Vec<f64> = (0..model.nv).map(|k| 2.0 * wave(k, 0.71)).collect();
            let a: Vec<f64> = (0..model.nv).map(|k| 5.0 * wave(k, 0.93)).collect();
            state.forward_acceleration(&model, &q, &v, &a);
            state.base_wrench_regressor(&model, &mut rows);
            stacked.view_mut((6 * i, 0), (6, 10 * model.n_links())).copy_from(&rows);
        }
        assert_eq!(stacked.rank(1e-9), base.len());
        assert!((&stacked * &base.to_full * &base.from_full - &stacked).amax() < 1e-9);
    }
}

#[test]
fn validate_base_parameters_of_random_trees_against_pinocchio() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/goldens/robot_trees.json");
    let cases: Vec<serde_json::Value> = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(cases.len(), 22);
    for (i, case) in cases.iter().enumerate() {
        let robot = RobotModel::parse("tree.urdf", case["urdf"].as_str().unwrap()).unwrap();
        let base = BaseParameters::of(&Model::from_spec(&robot.spec).unwrap());
        assert_eq!(base.len() as u64, case["base_rank"].as_u64().unwrap(), "tree {i}: base rows");
        assert_eq!(base.len() as u64, case["torque_rank"].as_u64().unwrap(), "tree {i}: all rows");
    }
}

/// Collision geometry of the two formats gives the same spheres, on links and on what is fixed to
/// them; drawings and meshes none.
#[test]
fn collision_geometry_of_both_formats_is_the_same() {
    let urdf = URDF
        .replace(
            "<visual><geometry><mesh filename=\"package://small/arm.stl\"/></geometry></visual>",
            "<collision><origin xyz=\"0.1 0 0.02\" rpy=\"0.2 0.5 -0.3\"/><geometry><box size=\"0.2 0.06 0.04\"/></geometry></collision>
             <collision><origin xyz=\"0.2 0 0\"/><geometry><mesh filename=\"arm.stl\"/></geometry></collision>",
        )
        .replace(
            "<link name=\"battery\">",
            "<link name=\"battery\"><collision><origin xyz=\"0.03 0 0\"/><geometry><cylinder radius=\"0.03\" length=\"0.1\"/></geometry></collision>",
        );
    let mjcf = MJCF
        .replace(
            "<default class=\"arm\">",
            "<geom type=\"box\"/><default class=\"drawn\"><geom contype=\"0\" conaffinity=\"0\"/></default><default class=\"arm\">",
        )
        // roll, pitch, yaw about fixed axes
        .replace(
            "<geom type=\"mesh\" mesh=\"arm\"/>",
            "<geom type=\"mesh\" mesh=\"arm\"/><geom class=\"drawn\" size=\"1 1 1\"/>
             <geom pos=\"0.1 0 0.02\" euler=\"11.459155902616464 28.64788975654116 -17.188733853924695\" size=\"0.1 0.03 0.02\"/>",
        )
        .replace(
            "mass=\"0.5\" diaginertia=\"0.001 0.001 0.001\"/>",
            "mass=\"0.5\" diaginertia=\"0.001 0.001 0.001\"/><geom type=\"cylinder\" fromto=\"0.03 0 -0.05 0.03 0 0.05\" size=\"0.03\"/>",
        );
    let (a, b) = (RobotModel::parse("robot.urdf", &urdf).unwrap(), RobotModel::parse("robot.xml", &mjcf).unwrap());
    for (robot, other) in [(&a, &b), (&b, &a)] {
        assert_eq!(robot.collision_meshes, ["arm"]);
        for own in &robot.collision {
            let of = &other.collision.iter().find(|c| c.link == own.link).unwrap().spheres;
            assert_eq!(own.spheres.len(), of.len(), "{}", own.link);
            for (x, y) in own.spheres.iter().zip(of) {
                let apart = (0..3).map(|k| (x.0[k] - y.0[k]).abs()).fold((x.1 - y.1).abs(), f64::max);
                assert!(apart < 1e-9, "{}: {x:?} {y:?}", own.link);
            }
        }
    }
    // the battery is part of the base
    let base = a.collision.iter().find(|c| c.link == "base").unwrap();
    assert!(base.spheres.iter().all(|(at, _)| (at[2] + 0.1).abs() < 0.06), "{base:?}");
    let wrong = urdf.replace("0.2 0.06 0.04", "0.2 -0.06 0.04");
    let told = RobotModel::parse("robot.urdf", &wrong).unwrap_err().to_string();
    assert!(told.contains("collision geometry of `arm`"), "{told}");
}
