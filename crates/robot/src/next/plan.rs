//! Flights to record next, with the standard errors that they are expected to leave.

use crate::RobotModel;
use crate::next::extent::Extents;
use crate::next::limits::JointLimits;
use crate::next::search::{FrameErrors, PlanOptions, Robot, Space, Tried};
use crate::next::wave::Wave;
use aloft_body::{BaseParameters, Model, Phi};
use aloft_identify::{Design, IdentifyError};
use aloft_regressor::{Factor, WeakOptions};
use serde::{Deserialize, Serialize};

/// What a plan starts from.
#[derive(Debug, Clone)]
pub struct PlanInput<'a> {
    /// The robot.
    pub robot: &'a RobotModel,
    /// Its tree.
    pub model: &'a Model,
    /// Base parameters.
    pub base: &'a BaseParameters,
    /// Parameters with which rows are formed: the prior's, 10 a link.
    pub prior: &'a [Phi],
    /// Parameters with which the planned flights are computed: the identified ones.
    pub phi: &'a [Phi],
    /// Information before any flight.
    pub before: Design,
    /// Rows of the recorded flights, with names that a user knows.
    pub recorded: &'a [(String, Factor)],
    /// Options of weak rows.
    pub weak: WeakOptions,
    /// Errors of a frame in the recordings' flights; none for fixed weights.
    pub noise: Option<FrameErrors<'a>>,
    /// Rate of the log, Hz.
    pub rate_hz: f64,
    /// Posture of the joints at the beginning and the end of every flight.
    pub hold: &'a [f64],
    /// Limits of the joints.
    pub limits: &'a [JointLimits],
    /// Where links are.
    pub extents: &'a Extents,
    /// Units of the base parameters.
    pub units: &'a [String],
}

/// One flight to record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedFlight {
    /// File with the joints' trajectories.
    pub file: String,
    /// Duration, s.
    pub duration_s: f64,
    /// Velocity of the centre of mass at release, upwards, m/s.
    pub speed_up_m_s: f64,
    /// Turn of the base at release, in its own axes, rad/s.
    pub turn_rad_s: [f64; 3],
    /// Fastest joint and its rate, rad/s or m/s.
    pub fastest: (String, f64),
    /// Joint that comes nearest to its largest torque, and the share of the limit that it uses.
    pub effort: Option<(String, f64)>,
    /// Parameters that this flight improves most: name, expected standard error before and after
    /// it.
    pub shows: Vec<(String, f64, f64)>,
    /// The joints' trajectories.
    pub wave: Wave,
}

/// Expected standard errors of a parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    /// Base parameter.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// After the recordings.
    pub now: f64,
    /// After the best recorded flight was repeated as often as flights are planned.
    pub repeated: f64,
    /// After the planned flights.
    pub then: f64,
}

/// A plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextFlights {
    /// The flights, in the order of planning.
    pub flights: Vec<PlannedFlight>,
    /// Every parameter but the mass; first the worst quarter (least known, measured by the prior's
    /// spread), in each part those that gain most first.
    pub parameters: Vec<Expected>,
    /// Number of parameters in the worst quarter.
    pub worst: usize,
    /// The recorded flight whose repetition would help most.
    pub repeated: String,
    /// Share of the prior's variance that is left: after the recordings, after the repetition,
    /// after the plan.
    pub left: [f64; 3],
    /// Remarks: limits that are not stated.
    pub notes: Vec<String>,
}

/// Plans flights. None if no flight keeps the limits.
///
/// # Errors
/// As [`Design::add`] and [`Design::left`].
pub fn plan(input: &PlanInput<'_>, options: PlanOptions) -> Result<Option<NextFlights>, IdentifyError> {
    let mut known = input.before.clone();
    let prior_sd = known.sd()?;
    for (_, factor) in input.recorded {
        known.add(factor, 1.0)?;
    }
    let now = (known.sd()?, known.left()?);
    let mut best: Option<(usize, f64)> = None;
    for (i, (_, factor)) in input.recorded.iter().enumerate() {
        let left = known.left_with(factor, options.flights as f64)?;
        if best.is_none_or(|b| left < b.1) {
            best = Some((i, left));
        }
    }
    let Some((repeated, repeated_left)) = best else { return Ok(None) };
    let mut again = known.clone();
    again.add(&input.recorded[repeated].1, options.flights as f64)?;
    let again = again.sd()?;
    let robot = Robot {
        robot: input.robot,
        model: input.model,
        base: input.base,
        prior: input.prior,
        phi: input.phi,
        weak: input.weak,
        noise: input.noise,
        rate_hz: input.rate_hz,
    };
    let hold: Vec<f64> = input.hold.iter().zip(input.limits).map(|(h, l)| h.clamp(l.low, l.high)).collect();
    let space = Space { hold: &hold, limits: input.limits, extents: input.extents, options };
    let mut flights = Vec::new();
    for number in 0..options.flights {
        let Some(tried) = space.search(&robot, &known, number as u64 + 1)? else { return Ok(None) };
        let motion = robot.motion(&tried.wave, &tried.turn, input.rate_hz, 2);
        let factor = robot.rows(&motion).map_err(|e| IdentifyError::Numeric(e.to_string()))?;
        let before = known.sd()?;
        known.add(&factor, 1.0)?;
        let after = known.sd()?;
        let mut order: Vec<usize> = (1..after.len()).collect();
        // what the parameter gains, in the units of the prior
        let gain = |i: usize| (before[i] - after[i]) / prior_sd[i];
        order.sort_by(|&a, &b| gain(b).total_cmp(&gain(a)));
        let shows = order.iter().take(5).map(|&i| (name(input, i), before[i], after[i])).collect();
        flights.push(described(input, &tried, number, shows));
    }
    let then = (known.sd()?, known.left()?);
    let mut order: Vec<usize> = (1..now.0.len()).collect();
    // the worst quarter first, each part in the order of what it gains
    order.sort_by(|&a, &b| (now.0[b] / prior_sd[b]).total_cmp(&(now.0[a] / prior_sd[a])));
    let worst = order.len().div_ceil(4);
    let gain = |i: usize| now.0[i] / then.0[i];
    order[..worst].sort_by(|&a, &b| gain(b).total_cmp(&gain(a)));
    order[worst..].sort_by(|&a, &b| gain(b).total_cmp(&gain(a)));
    let parameters = order
        .into_iter()
        .map(|i| Expected {
            name: name(input, i),
            unit: input.units.get(i).cloned().unwrap_or_default(),
            now: now.0[i],
            repeated: again[i],
            then: then.0[i],
        })
        .collect();
    let plan = NextFlights {
        flights,
        parameters,
        repeated: input.recorded[repeated].0.clone(),
        left: [now.1, repeated_left, then.1],
        worst,
        notes: Vec::new(),
    };
    Ok(Some(plan))
}

fn name(input: &PlanInput<'_>, i: usize) -> String {
    input.base.parameters[i].name.clone()
}

fn described(input: &PlanInput<'_>, tried: &Tried, number: usize, shows: Vec<(String, f64, f64)>) -> PlannedFlight {
    let joint = |j: usize| input.robot.joints[j].name.clone();
    let fastest = (0..input.robot.joints.len())
        .map(|j| (j, fastest_rate(&tried.wave, j)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or((String::new(), 0.0), |(j, rate)| (joint(j), rate));
    PlannedFlight {
        file: format!("flight_{}.csv", number + 1),
        duration_s: tried.wave.duration_s,
        speed_up_m_s: 0.5 * input.model.gravity_mps2.norm() * tried.wave.duration_s,
        turn_rad_s: tried.turn.into(),
        fastest,
        effort: tried.effort.map(|(j, share)| (joint(j), share)),
        shows,
        wave: tried.wave.clone(),
    }
}

fn fastest_rate(wave: &Wave, joint: usize) -> f64 {
    (0..=200).map(|i| wave.at(wave.duration_s * f64::from(i) / 200.0).1[joint].abs()).fold(0.0, f64::max)
}

impl Wave {
    /// The trajectories as CSV: `time_s` from release, and a column for each joint named as in
    /// logs.
    pub fn csv(&self, robot: &RobotModel, rate_hz: f64) -> String {
        let unit = |prismatic: bool| if prismatic { "m" } else { "rad" };
        let names: Vec<String> = robot.joints.iter().map(|j| format!("q_{}_{}", j.name, unit(j.prismatic))).collect();
        let mut out = format!("time_s,{}\n", names.join(","));
        for i in 0..=(self.duration_s * rate_hz).round() as usize {
            let t = i as f64 / rate_hz;
            let q: Vec<String> = self.at(t).0.iter().map(|q| format!("{q:.6}")).collect();
            out += &format!("{t:.6},{}\n", q.join(","));
        }
        out
    }
}
