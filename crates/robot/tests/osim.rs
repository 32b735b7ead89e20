//! OpenSim models: what they are read as, and what is refused.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and print what they measured")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::State;
use aloft_robot::osim::OsimModel;
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

fn body(name: &str, mass: f64) -> String {
    format!(
        "<Body name=\"{name}\"><mass>{mass}</mass><mass_center>0 -0.1 0</mass_center><inertia>0.1 0.02 0.1 0 0 0</inertia></Body>"
    )
}

fn frame(name: &str, parent: &str, translation: &str, orientation: &str) -> String {
    format!(
        "<PhysicalOffsetFrame name=\"{name}\"><socket_parent>{parent}</socket_parent><translation>{translation}</translation>\
         <orientation>{orientation}</orientation></PhysicalOffsetFrame>"
    )
}

/// A base that moves freely, a slider with a coupled turn on it, and a hinge whose frames are
/// turned.
fn model(extra: &str) -> String {
    let axis = |name: &str, coordinate: &str, direction: &str, function: &str| {
        format!(
            "<TransformAxis name=\"{name}\"><coordinates>{coordinate}</coordinates><axis>{direction}</axis>{function}</TransformAxis>"
        )
    };
    let linear = "<LinearFunction name=\"function\"><coefficients>1 0</coefficients></LinearFunction>";
    let parabola = "<PolynomialFunction name=\"function\"><coefficients>0.5 0 0.02</coefficients></PolynomialFunction>";
    format!(
        "<?xml version=\"1.0\"?><OpenSimDocument Version=\"40000\"><Model name=\"made\"><BodySet><objects>{}{}{}</objects></BodySet>\
         <JointSet><objects>\
         <FreeJoint name=\"root\"><socket_parent_frame>ground</socket_parent_frame><socket_child_frame>base</socket_child_frame>\
         <coordinates><Coordinate name=\"rx\"/><Coordinate name=\"ry\"/><Coordinate name=\"rz\"/><Coordinate name=\"tx\"/><Coordinate name=\"ty\"/><Coordinate name=\"tz\"/></coordinates></FreeJoint>\
         <CustomJoint name=\"knee\"><socket_parent_frame>f</socket_parent_frame><socket_child_frame>g</socket_child_frame>\
         <coordinates><Coordinate name=\"angle\"/></coordinates><frames>{}{}</frames><SpatialTransform>{}{}{}{}</SpatialTransform></CustomJoint>\
         <PinJoint name=\"ankle\"><socket_parent_frame>f</socket_parent_frame><socket_child_frame>g</socket_child_frame>\
         <coordinates><Coordinate name=\"foot\"><default_value>0.25</default_value></Coordinate></coordinates><frames>{}{}</frames></PinJoint>{extra}\
         </objects></JointSet><MarkerSet><objects><Marker name=\"M\"><socket_parent_frame>/bodyset/foot</socket_parent_frame><location>0.1 0 0</location></Marker></objects></MarkerSet>\
         </Model></OpenSimDocument>",
        body("base", 10.0),
        body("shank", 3.0),
        body("foot", 1.0),
        frame("f", "/bodyset/base", "0 -0.4 0", "0 0 0"),
        frame("g", "/bodyset/shank", "0 0 0", "0 0 0"),
        axis("rotation1", "angle", "0 0 1", linear),
        axis("rotation2", "angle", "1 0 0", parabola),
        axis("translation1", "angle", "1 0 0", parabola),
        axis("translation2", "", "0 1 0", "<Constant name=\"function\"><value>0</value></Constant>"),
        frame("f", "/bodyset/shank", "0 -0.4 0", "0 1.5707963267948966 0"),
        frame("g", "/bodyset/foot", "0 0.05 0", "0 1.5707963267948966 0"),
    )
}

#[test]
fn coupled_joints_and_turned_frames_are_where_opensim_has_them() {
    let osim = OsimModel::parse("made.osim", &model("")).unwrap();
    assert_eq!(osim.mass_kg(), 14.0);
    let names: Vec<&str> = osim.coordinates.iter().map(|c| c.0.as_str()).collect();
    assert_eq!(names, ["angle", "foot", "rx", "ry", "rz", "tx", "ty", "tz"]);
    assert!(osim.coordinates.iter().all(|(c, angle)| *angle != c.starts_with('t')));
    let a = 0.6;
    let values: BTreeMap<String, f64> =
        [("tx", 1.0), ("ty", 2.0), ("rz", 0.3), ("angle", a)].map(|(k, v)| (k.to_owned(), v)).into();
    let q = osim.posture(&values, &UnitQuaternion::identity());
    let mut state = State::new(&osim.model);
    state.forward_position(&osim.model, &q);
    let found = state.point_in_world(osim.markers[0].link, &osim.markers[0].position_m);
    // the same by hand, joint by joint
    let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
    let slide = 0.5 * a * a + 0.02;
    let pin = about(Vector3::y(), FRAC_PI_2);
    let in_pin = pin.inverse() * (Vector3::new(0.1, 0.0, 0.0) - Vector3::new(0.0, 0.05, 0.0));
    let in_shank = Vector3::new(0.0, -0.4, 0.0) + pin * (about(Vector3::z(), 0.25) * in_pin);
    let in_base = Vector3::new(slide, -0.4, 0.0) + about(Vector3::z(), a) * (about(Vector3::x(), slide) * in_shank);
    let by_hand = Vector3::new(1.0, 2.0, 0.0) + about(Vector3::z(), 0.3) * in_base;
    assert!((found - by_hand).norm() < 1e-12, "{found:?} {by_hand:?}");
    // the centre of mass of the foot is 0.1 m below its origin, 0.15 m below the pin
    let foot = osim.inertias_of("foot").unwrap();
    assert!((foot.com_m - pin.inverse() * Vector3::new(0.0, -0.15, 0.0)).norm() < 1e-12);
}

#[test]
fn what_is_not_supported_is_refused_by_name() {
    let extra = "<EllipsoidJoint name=\"scapula\"/><CustomJoint name=\"odd\"><SpatialTransform><TransformAxis name=\"rotation1\">\
                 <coordinates>x</coordinates><axis>1 0 0</axis><GCVSpline/></TransformAxis></SpatialTransform></CustomJoint>";
    let refused = OsimModel::parse("made.osim", &model(extra)).unwrap_err().to_string();
    assert!(refused.contains("`scapula` of the kind EllipsoidJoint"), "{refused}");
    assert!(refused.contains("GCVSpline in the joint `odd`"), "{refused}");
    // a number that is none was taken for the one that stands where nothing is stated
    let word = model("").replace("<default_value>0.25", "<default_value>a quarter");
    let refused = OsimModel::parse("made.osim", &word).unwrap_err().to_string();
    assert!(refused.contains("`default_value` of `foot`, which is `a quarter`"), "{refused}");
    let old = model("").replace("40000", "30000");
    assert!(OsimModel::parse("old.osim", &old).unwrap_err().to_string().contains("30000"));
    assert!(OsimModel::parse("x.osim", "<robot/>").unwrap_err().to_string().contains("OpenSimDocument"));
}

#[test]
fn validate_published_models_are_read_whole() {
    for name in ["final", "unscaled_generic", "optimized_scale_and_markers", "unscaled_but_with_optimized_markers"] {
        let Some(path) = shared_data::shared_data(&format!("real_labs/opencap_unfiltered/Models/{name}.osim")) else {
            return;
        };
        let osim = OsimModel::parse(name, &std::fs::read_to_string(path).unwrap()).unwrap();
        println!("{name}: {} links, {:.2} kg, {} markers", osim.model.n_links(), osim.mass_kg(), osim.markers.len());
        assert_eq!(osim.markers.len(), 49);
        assert_eq!(osim.inertias.iter().filter(|i| i.mass_kg > 0.0).count(), 22);
        assert_eq!(osim.coordinates.len(), 33);
    }
}
