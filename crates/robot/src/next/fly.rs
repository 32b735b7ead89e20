//! Free flight of a robot whose joints follow given trajectories: the base follows from zero
//! external wrench, which means a centre of mass that falls and an angular momentum that stays.

use aloft_body::inertia::{first_moment, inertia_about_origin};
use aloft_body::{JointKind, Model, Motion, Phi, State};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// State of the base when the robot is let go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Release {
    /// Centre of mass in the world, m.
    pub centre_m: Vector3<f64>,
    /// Its velocity, world, m/s.
    pub speed_m_s: Vector3<f64>,
    /// Orientation of the base in the world.
    pub rotation: UnitQuaternion<f64>,
    /// Angular velocity of the base in its own axes, rad/s.
    pub turn_rad_s: Vector3<f64>,
}

/// What the joints' motion means for the whole body with the base's origin at rest at the world's
/// origin.
struct Whole {
    mass: f64,
    centre: Vector3<f64>,
    /// Momentum, and angular momentum about the centre of mass.
    linear: Vector3<f64>,
    angular: Vector3<f64>,
    /// Inertia about the centre of mass.
    inertia: Matrix3<f64>,
}

struct Body<'a> {
    model: &'a Model,
    phi: &'a [Phi],
    state: State,
    q: Vec<f64>,
    v: Vec<f64>,
    /// Places of the joints in `q` and `v`.
    joints: Vec<(usize, usize)>,
}

impl Body<'_> {
    fn whole(&mut self, rotation: &UnitQuaternion<f64>, joints: &(Vec<f64>, Vec<f64>)) -> Whole {
        self.q[..3].fill(0.0);
        self.q[3..7].copy_from_slice(rotation.coords.as_slice());
        self.v[..6].fill(0.0);
        for (k, (iq, iv)) in self.joints.iter().enumerate() {
            self.q[*iq] = joints.0[k];
            self.v[*iv] = joints.1[k];
        }
        self.state.forward_velocity(self.model, &self.q, &self.v);
        let (mass, centre) = self.state.centre_of_mass(self.phi);
        let mut out =
            Whole { mass, centre, linear: Vector3::zeros(), angular: Vector3::zeros(), inertia: Matrix3::zeros() };
        for (i, phi) in self.phi.iter().enumerate() {
            let pose = &self.state.world_from_link[i];
            let r = self.state.rotation(i);
            let twist = &self.state.velocity[i];
            let (v, w): (Vector3<f64>, Vector3<f64>) =
                (twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
            let (mc, own) = (first_moment(phi), inertia_about_origin(phi));
            let away = pose.translation.vector - centre;
            let linear = r * (v * phi[0] + w.cross(&mc));
            out.linear += linear;
            out.angular += r * (mc.cross(&v) + own * w) + away.cross(&linear);
            let s = r * mc;
            let cross = away * s.transpose();
            out.inertia +=
                r * own * r.transpose() + Matrix3::identity() * (2.0 * away.dot(&s)) - cross - cross.transpose()
                    + (Matrix3::identity() * away.norm_squared() - away * away.transpose()) * phi[0];
        }
        // momentum of the joints' motion alone moves the centre of mass; about that centre it
        // counts without it
        out
    }
}

/// Flies for `frames` frames at `rate_hz`, each of them in `substeps` steps of the midpoint rule;
/// coordinates and velocities. `joints` gives coordinates and rates of the joints with one
/// coordinate, in the order of the model.
///
/// Equation: `ω = I_c⁻¹ (L − L_joints)` about the centre of mass, with the angular momentum L at
/// release.
///
/// # Panics
/// If `phi` has another length than the model has links, or `joints` gives too few values.
pub fn fly(
    model: &Model,
    phi: &[Phi],
    release: &Release,
    joints: &dyn Fn(f64) -> (Vec<f64>, Vec<f64>),
    frames: usize,
    rate_hz: f64,
    substeps: usize,
) -> Motion {
    let one = |k: &JointKind| matches!(k, JointKind::Revolute(_) | JointKind::Prismatic(_));
    let mut body = Body {
        model,
        phi,
        state: State::new(model),
        q: model.neutral(),
        v: vec![0.0; model.nv],
        joints: model
            .links
            .iter()
            .filter(|l| one(&l.joint.kind))
            .map(|l| (l.joint.q_offset, l.joint.v_offset))
            .collect(),
    };
    let start = body.whole(&release.rotation, &joints(0.0));
    let kept = start.angular + start.inertia * (release.rotation * release.turn_rad_s);
    let turn = |whole: &Whole| {
        whole.inertia.try_inverse().map_or_else(Vector3::zeros, |inverse| inverse * (kept - whole.angular))
    };
    let mut rotation = release.rotation;
    let substeps = substeps.max(1);
    let h = 1.0 / (rate_hz * substeps as f64);
    let mut out = Motion {
        trial: "flight".to_owned(),
        rate_hz,
        nq: model.nq,
        nv: model.nv,
        q: Vec::with_capacity(frames * model.nq),
        v: Vec::with_capacity(frames * model.nv),
        ..Motion::default()
    };
    for frame in 0..frames {
        let t = frame as f64 / rate_hz;
        let whole = body.whole(&rotation, &joints(t));
        let omega = turn(&whole);
        let centre = release.centre_m + release.speed_m_s * t + model.gravity_mps2 * (0.5 * t * t);
        let speed = release.speed_m_s + model.gravity_mps2 * t;
        let base_speed = speed - omega.cross(&whole.centre) - whole.linear / whole.mass;
        let back = rotation.inverse();
        body.q[..3].copy_from_slice((centre - whole.centre).as_slice());
        body.v[..3].copy_from_slice((back * base_speed).as_slice());
        body.v[3..6].copy_from_slice((back * omega).as_slice());
        out.q.extend_from_slice(&body.q);
        out.v.extend_from_slice(&body.v);
        for sub in 0..substeps {
            let at = t + sub as f64 * h;
            let first = if sub == 0 { omega } else { turn(&body.whole(&rotation, &joints(at))) };
            let half = UnitQuaternion::from_scaled_axis(first * (0.5 * h)) * rotation;
            let middle = turn(&body.whole(&half, &joints(at + 0.5 * h)));
            rotation = UnitQuaternion::from_scaled_axis(middle * h) * rotation;
        }
        rotation.renormalize();
    }
    out
}
