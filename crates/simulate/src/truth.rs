//! True values of a simulated laboratory: masses, geometry, hidden effects, flights. Sealed in
//! `truth/`.

use crate::hidden::Hidden;
use crate::object::TrueMarker;
use crate::physics::{Body, TrueMotion};
use crate::scenario::Scenario;
use aloft_body::{BaseParameters, JointKind, LinkInertia, State};
use nalgebra::{DVector, Matrix3, Vector3};
use serde::Serialize;
use std::collections::BTreeMap;

/// Order of [`LinkTruth::phi`].
pub const PHI_ORDER: &str =
    "m mcx mcy mcz Ixx Ixy Iyy Ixz Iyz Izz (inertia about the link-frame origin; pinocchio order)";

/// True values of everything in a simulated laboratory. Serialises to `truth/truth.json`; keys
/// shared with other simulated data sets have the same names and meanings there.
#[derive(Debug, Clone, Serialize)]
pub struct Truth {
    /// Version of the layout of this file.
    pub schema: &'static str,
    /// Name of the scenario.
    pub dataset: String,
    /// Seed.
    pub seed: u64,
    /// Names of the hidden effects joined by `+`, or `none`.
    pub effect: String,
    /// The hidden effects with their values.
    pub hidden: Vec<Hidden>,
    /// True gravity, m/s², world.
    pub true_gravity: [f64; 3],
    /// Gravity as stated by the laboratory, m/s², world.
    pub nominal_gravity: [f64; 3],
    /// True camera rate, Hz.
    pub true_rate_hz: f64,
    /// Camera rate stated in the files, Hz.
    pub header_rate_hz: f64,
    /// Noise of a marker, each axis, m.
    pub noise_sigma_m: f64,
    /// Mass shown by the laboratory's scale, kg.
    pub mass_scale: f64,
    /// Order of `phi`.
    pub phi_order: &'static str,
    /// Definition of the link frames.
    pub frames: String,
    /// Links.
    pub links: Vec<LinkTruth>,
    /// Markers: link and position in its frame (m), as attached.
    pub markers: BTreeMap<String, (String, [f64; 3])>,
    /// Base parameters of the true body.
    pub base: Vec<BaseTruth>,
    /// Recordings.
    pub trials: Vec<TrialTruth>,
    /// Values that exist for one kind of body only.
    #[serde(flatten)]
    pub extra: BTreeMap<String, serde_json::Value>,
}

/// One link.
#[derive(Debug, Clone, Serialize)]
pub struct LinkTruth {
    /// Name.
    pub name: String,
    /// Parent.
    pub parent: Option<String>,
    /// Joint: `free`, `spherical`, `revolute_z` …
    pub joint: String,
    /// Joint position in the parent, m.
    pub offset: [f64; 3],
    /// Joint orientation in the parent at zero, quaternion x y z w.
    pub rotation_xyzw: [f64; 4],
    /// Ten inertial parameters in [`PHI_ORDER`].
    pub phi: [f64; 10],
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub com: [f64; 3],
    /// Inertia about the centre of mass, link axes, kg·m².
    #[serde(rename = "I_com")]
    pub i_com: [[f64; 3]; 3],
}

/// One base parameter.
#[derive(Debug, Clone, Serialize)]
pub struct BaseTruth {
    /// Name used by the identification.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: &'static str,
}

/// One recording.
#[derive(Debug, Clone, Serialize)]
pub struct TrialTruth {
    /// Name.
    pub trial: String,
    /// Kind.
    pub kind: String,
    /// Camera frames.
    pub frames: usize,
    /// Duration on the files' clock, s.
    pub dur: f64,
    /// Start and end of each flight on the files' clock, s.
    pub flights: Vec<[f64; 2]>,
    /// First and last camera frame (0-based, inclusive) of each flight.
    pub flight_frames: Vec<[usize; 2]>,
    /// Style of each flight.
    pub styles: Vec<String>,
    /// Largest residual force in a flight after inertia, gravity and hidden forces are accounted
    /// for, N.
    pub flight_resid: f64,
    /// Number of draws needed to find a feasible motion.
    pub attempts: usize,
    /// Missing stretches: marker, first and last frame.
    pub gaps: Vec<(String, usize, usize)>,
    /// Hidden payloads carried, kg.
    pub payload: Option<f64>,
}

fn rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
}

impl LinkTruth {
    /// All links of a body.
    pub fn of(body: &Body) -> Vec<Self> {
        let model = &body.model;
        model
            .links
            .iter()
            .zip(&body.phi)
            .map(|(link, phi)| {
                let inertia = LinkInertia::from_phi(phi);
                let pose = link.joint.parent_from_joint;
                let joint = match link.joint.kind {
                    JointKind::Free => "free".to_owned(),
                    JointKind::Spherical => "spherical".to_owned(),
                    JointKind::Revolute(axis) if axis.into_inner() == Vector3::z() => "revolute_z".to_owned(),
                    JointKind::Revolute(axis) => format!("revolute {:?}", axis.as_slice()),
                    JointKind::Prismatic(axis) => format!("prismatic {:?}", axis.as_slice()),
                    JointKind::Fixed => "fixed".to_owned(),
                };
                let quaternion = pose.rotation.coords;
                Self {
                    name: link.name.clone(),
                    parent: link.parent.map(|p| model.links[p].name.clone()),
                    joint,
                    offset: pose.translation.vector.into(),
                    rotation_xyzw: [quaternion.x, quaternion.y, quaternion.z, quaternion.w],
                    phi: [0, 1, 2, 3, 4, 9, 5, 8, 7, 6].map(|i| phi[i]),
                    mass: phi[0],
                    com: inertia.com_m.into(),
                    i_com: rows(&inertia.inertia_com_kgm2),
                }
            })
            .collect()
    }
}

/// Recordings by name, in the layout of other simulated chains: frames and flights (first and last
/// frame), and gaps.
pub fn recordings(trials: &[TrialTruth]) -> BTreeMap<String, serde_json::Value> {
    let thrown = trials.iter().filter(|t| t.kind == "throws");
    let recordings: BTreeMap<&str, serde_json::Value> = thrown
        .map(|t| {
            let seconds: f64 = t.flights.iter().map(|[a, b]| b - a).sum();
            let value =
                serde_json::json!({"frames": t.frames, "flight_intervals": t.flight_frames, "flight_s": seconds});
            (t.trial.as_str(), value)
        })
        .collect();
    let gaps: BTreeMap<&str, &[(String, usize, usize)]> =
        trials.iter().map(|t| (t.trial.as_str(), t.gaps.as_slice())).collect();
    let mut out = BTreeMap::new();
    out.insert("recordings".to_owned(), serde_json::json!(recordings));
    out.insert("gaps".to_owned(), serde_json::json!(gaps));
    out
}

/// Base parameters of a body.
pub fn base(body: &Body) -> Vec<BaseTruth> {
    let base = BaseParameters::of(&body.model);
    let full = DVector::from_iterator(10 * body.phi.len(), body.phi.iter().flat_map(|p| p.iter().copied()));
    let values = &base.from_full * full;
    base.parameters
        .iter()
        .zip(values.iter())
        .map(|(p, value)| BaseTruth { name: p.name.clone(), value: *value, unit: p.unit })
        .collect()
}

/// Markers by label.
pub fn markers(body: &Body, markers: &[TrueMarker]) -> BTreeMap<String, (String, [f64; 3])> {
    let name = |link: usize| body.model.links[link].name.clone();
    markers.iter().map(|m| (m.label.clone(), (name(m.link), m.position_m.into()))).collect()
}

/// Keys used only for the two-link chain: both links by name, the hinge, its recordings.
pub(crate) fn chain_extra(
    body: &Body,
    labels: &[TrueMarker],
    damping: f64,
    friction: f64,
) -> BTreeMap<String, serde_json::Value> {
    let mut out = BTreeMap::new();
    for (link, truth) in LinkTruth::of(body).iter().enumerate() {
        let phi = &body.phi[link];
        let origin = Matrix3::new(phi[4], phi[9], phi[8], phi[9], phi[5], phi[7], phi[8], phi[7], phi[6]);
        let value = serde_json::json!({
            "phi": truth.phi, "mass": truth.mass, "mc": [phi[1], phi[2], phi[3]], "I_origin": rows(&origin),
        });
        out.insert(truth.name.clone(), value);
        let places: Vec<[f64; 3]> = labels.iter().filter(|m| m.link == link).map(|m| m.position_m.into()).collect();
        out.insert(format!("markers_{}_m", truth.name), serde_json::json!(places));
    }
    let pose = body.model.links[1].joint.parent_from_joint;
    let rotation = pose.rotation.to_rotation_matrix();
    let axis = rotation * Vector3::z();
    out.insert(
        "hinge".to_owned(),
        serde_json::json!({
            "p_link0": pose.translation.vector.as_slice(),
            "R_link0_link1_q0": rows(rotation.matrix()),
            "axis_link0": axis.as_slice(),
            "damping": damping,
            "frictionloss": friction,
        }),
    );
    // the same values under the names and in the order of the paper's two-link table
    const NAMES: [(&str, &str); 17] = [
        ("M", "M"),
        ("MCx", "MCx"),
        ("MCy", "MCy"),
        ("MCz", "MCz"),
        ("Jxx", "Jxx"),
        ("Jxy", "Jxy"),
        ("Jyy", "Jyy"),
        ("Jxz", "Jzx"),
        ("Jyz", "Jyz"),
        ("Jzz", "Jzz"),
        ("mc1x", "link1.mcx"),
        ("mc1y", "link1.mcy"),
        ("I1xx-I1yy", "link1.Ixx-Iyy"),
        ("I1xy", "link1.Ixy"),
        ("I1xz", "link1.Izx"),
        ("I1yz", "link1.Iyz"),
        ("I1zz", "link1.Izz"),
    ];
    let base = base(body);
    let value = |name: &str| base.iter().find(|b| b.name == name).map(|b| b.value);
    out.insert("base_names".to_owned(), serde_json::json!(NAMES.map(|n| n.0)));
    out.insert("base_params".to_owned(), serde_json::json!(NAMES.map(|n| value(n.1))));
    let columns = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 14, 15, 17, 18, 19];
    out.insert("base_cols_of_20".to_owned(), serde_json::json!(columns));
    out.insert("labels".to_owned(), serde_json::json!(labels.iter().map(|m| m.label.clone()).collect::<Vec<_>>()));
    out
}

/// The true motion of a trial at the camera frames as a numpy archive: `t_frame`, `q`, `v`, `a`
/// (conventions of `aloft-body`), `com`, `contact_wrench` and `effect_wrench` (on the body about
/// the world origin, force then moment), `flight_intervals`.
pub fn trajectories(scenario: &Scenario, body: &Body, motion: &TrueMotion, ticks_per_frame: usize) -> Vec<u8> {
    use crate::npz::{Array, Npz};
    let frames = motion.n_ticks() / ticks_per_frame;
    let ticks: Vec<usize> = (0..frames).map(|f| f * ticks_per_frame).collect();
    let mut state = State::new(&body.model);
    let mut com = Vec::with_capacity(3 * frames);
    for tick in &ticks {
        state.forward_position(&body.model, motion.q(*tick));
        com.extend_from_slice(state.centre_of_mass(&body.phi).1.as_slice());
    }
    let gather = |f: &dyn Fn(usize) -> Vec<f64>| ticks.iter().flat_map(|t| f(*t)).collect::<Vec<f64>>();
    let wrench = |w: &crate::physics::Wrench| [w.force_n.as_slice(), w.moment_nm.as_slice()].concat();
    let narrow = |v: Vec<f64>| Array::F4(v.into_iter().map(|x| x as f32).collect());
    let mut npz = Npz::default();
    let rate = scenario.capture.point_rate_hz;
    npz.add("t_frame", &[frames], &Array::F8((0..frames).map(|f| f as f64 / rate).collect()));
    npz.add("q", &[frames, motion.nq], &Array::F8(gather(&|t| motion.q(t).to_vec())));
    npz.add("v", &[frames, motion.nv], &narrow(gather(&|t| motion.v(t).to_vec())));
    npz.add("a", &[frames, motion.nv], &narrow(gather(&|t| motion.a(t).to_vec())));
    npz.add("com", &[frames, 3], &narrow(com));
    npz.add("contact_wrench", &[frames, 6], &narrow(gather(&|t| wrench(&motion.contact[t]))));
    npz.add("effect_wrench", &[frames, 6], &narrow(gather(&|t| wrench(&motion.effects[t]))));
    let flights = flight_frames(motion, ticks_per_frame);
    let flat: Vec<i64> = flights.iter().flatten().map(|f| *f as i64).collect();
    npz.add("flight_intervals", &[flights.len(), 2], &Array::I8(flat));
    npz.finish()
}

/// First and last camera frame inside each flight.
pub fn flight_frames(motion: &TrueMotion, ticks_per_frame: usize) -> Vec<[usize; 2]> {
    motion.flights.iter().map(|[a, b]| [a.div_ceil(ticks_per_frame), b / ticks_per_frame]).collect()
}
