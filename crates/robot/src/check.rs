//! What a log says about itself: units, exchanged columns, the order of quaternions, the sensors'
//! axes. Each check has evidence within the recording, so that a clear mistake is an error and not
//! a bad result.

use crate::clock::{AT_REST_RAD_S, base_rates, rough_offset};
use crate::log::{BaseLog, RobotLog};
use crate::{RobotError, RobotModel};
use aloft_body::STANDARD_GRAVITY_MPS2;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

const DEGREES: f64 = 180.0 / std::f64::consts::PI;
/// Rows on each side of a difference that stands for a rate.
const REACH: usize = 3;

/// Checks a log and its base recording; returns remarks.
///
/// # Errors
/// [`RobotError::Log`] for columns without numbers, joint columns in degrees, exchanged or reversed
/// columns, a gyroscope in degrees, quaternions in another order or direction than stated, and a
/// base that falls along another axis than z.
pub fn check(log: &RobotLog, base: Option<&BaseLog>, model: &RobotModel) -> Result<Vec<String>, RobotError> {
    let mut remarks = Vec::new();
    missing(log, model, &mut remarks)?;
    units(log, base.or(log.base.as_ref()))?;
    joints(log, model, &mut remarks)?;
    if let Some(base) = base.or(log.base.as_ref()) {
        rotation(log, base)?;
        vertical(log, base)?;
    }
    Ok(remarks)
}

/// Specific force below which the body falls, as a share of gravity: turning adds some at the
/// inertial unit.
const FALLING: f64 = 0.4;
/// Shortest fall that is compared, and what is left off at both ends of each, s.
const SHORTEST_FALL_S: f64 = 0.2;
const ENDS_S: f64 = 0.03;
/// Largest angle between the fall and the world's −z, as a cosine (45°): the base turns about the
/// centre of mass, which bends its way in short flights.
const NOT_DOWN: f64 = 0.7;

/// Direction in which the base falls while the accelerometer reads little: down is −z.
fn vertical(log: &RobotLog, base: &BaseLog) -> Result<(), RobotError> {
    let Some(acc) = &log.acc else { return Ok(()) };
    let offset = if log.base.is_some() { Some(0.0) } else { rough_offset(log, base).map(|r| r.offset_s) };
    let Some(offset) = offset else { return Ok(()) };
    let free = |i: usize| acc.get(i).is_some_and(|a| a.norm() < FALLING * STANDARD_GRAVITY_MPS2);
    let mut falls = Vec::new();
    for run in aloft_signal::runs_where(log.time_s.len(), free) {
        let (from, to) = (log.time_s[run.start], log.time_s[run.end - 1]);
        if to - from >= SHORTEST_FALL_S {
            falls.extend(acceleration(base, from + offset + ENDS_S, to + offset - ENDS_S));
        }
    }
    if falls.is_empty() {
        return Ok(());
    }
    let fall = falls.iter().sum::<Vector3<f64>>() / falls.len() as f64;
    let size = fall.norm() / STANDARD_GRAVITY_MPS2;
    if !(0.6..1.4).contains(&size) || -fall.z > NOT_DOWN * fall.norm() {
        return Ok(());
    }
    let axis = fall.iamax();
    Err(RobotError::log(
        &base.file,
        format!(
            "in {} flights the base accelerates with {:.1} m/s² towards {}{}, expected towards −z: the vertical is not z",
            falls.len(),
            fall.norm(),
            if fall[axis] < 0.0 { '−' } else { '+' },
            ["x", "y", "z"][axis]
        ),
        "exchange the columns of position and rotation so that z points up",
    ))
}

/// Mean acceleration of the base between two times of its clock, by a parabola.
fn acceleration(base: &BaseLog, from_s: f64, to_s: f64) -> Option<Vector3<f64>> {
    const FEWEST: usize = 8;
    let middle = 0.5 * (from_s + to_s);
    let inside: Vec<(f64, Vector3<f64>)> = base
        .time_s
        .iter()
        .zip(&base.position_m)
        .filter(|(t, p)| (from_s..=to_s).contains(*t) && p.iter().all(|x| x.is_finite()))
        .map(|(t, p)| (t - middle, *p))
        .collect();
    if inside.len() < FEWEST {
        return None;
    }
    let mut information = Matrix3::zeros();
    let mut right = Matrix3::zeros();
    for (t, p) in &inside {
        let powers = Vector3::new(1.0, *t, 0.5 * t * t);
        information += powers * powers.transpose();
        right += powers * p.transpose();
    }
    Some((information.try_inverse()? * right).row(2).transpose())
}

/// Units of the accelerometer and of the base's position.
fn units(log: &RobotLog, base: Option<&BaseLog>) -> Result<(), RobotError> {
    if let (Some(acc), Some(base)) = (&log.acc, base) {
        // large values of both, which need no common clock
        let (own, by_poses) = (middle_norm(acc.iter()), middle_norm(specific_forces(base).iter()));
        let ratio = own / by_poses * STANDARD_GRAVITY_MPS2;
        if (ratio - 1.0).abs() < 0.35 {
            return Err(RobotError::log(
                &log.file,
                format!(
                    "the accelerometer reads {own:.2} where the poses of {} and gravity give {by_poses:.1} m/s²: in g, expected m/s²",
                    base.file
                ),
                "multiply its columns by 9.81",
            ));
        }
    }
    if let Some(base) = base {
        let spans = (0..3).map(|k| spread(&base.position_m.iter().map(|p| p[k]).collect::<Vec<_>>()));
        let span = spans.filter(|s| s.is_finite()).fold(0.0, f64::max);
        if span > LARGEST_SPAN_M {
            return Err(RobotError::log(
                &base.file,
                format!(
                    "its positions span {span:.0}, expected at most {LARGEST_SPAN_M} m in one recording: millimetres?"
                ),
                "convert the columns to m",
            ));
        }
    }
    Ok(())
}

/// Specific force by second differences of the base's position over [`APART_S`], gravity along the
/// world's z axis; m/s².
fn specific_forces(base: &BaseLog) -> Vec<Vector3<f64>> {
    let (t, p) = (&base.time_s, &base.position_m);
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    let reach = (APART_S / aloft_signal::median(&mut steps)).ceil().max(1.0) as usize;
    (reach..p.len().saturating_sub(reach))
        .map(|i| {
            let (h, k) = (t[i] - t[i - reach], t[i + reach] - t[i]);
            let change = (p[i + reach] - p[i]) / k - (p[i] - p[i - reach]) / h;
            change * (2.0 / (h + k)) + Vector3::z() * STANDARD_GRAVITY_MPS2
        })
        .collect()
}

/// Time between the positions of a second difference, s.
const APART_S: f64 = 0.03;

/// Largest span of a base's position in one recording, m.
const LARGEST_SPAN_M: f64 = 500.0;

/// Share of missing values from which a joint is named.
const OFTEN_MISSING: f64 = 0.1;

/// Joints without values: a frame needs all of them.
fn missing(log: &RobotLog, model: &RobotModel, remarks: &mut Vec<String>) -> Result<(), RobotError> {
    for (joint, q) in model.joints.iter().zip(&log.q) {
        let name = &joint.name;
        let gone = q.iter().filter(|x| !x.is_finite()).count();
        if gone == q.len() {
            return Err(RobotError::log(
                &log.file,
                format!("the column of the joint `{name}` holds no number in {gone} rows"),
                "check the export of the log; a joint that does not move has its constant angle in every row",
            ));
        }
        if gone as f64 > OFTEN_MISSING * q.len() as f64 {
            remarks.push(format!(
                "the joint `{name}` is missing in {gone} of {} rows: frames in longer gaps are left out",
                q.len()
            ));
        }
    }
    for (what, series) in [("gyroscope", &log.gyro), ("accelerometer", &log.acc)] {
        if let Some(series) = series
            && series.iter().all(|v| !v.norm().is_finite())
        {
            return Err(RobotError::log(
                &log.file,
                format!("the columns of the {what} hold no number"),
                "check the export of the log, or leave the columns out",
            ));
        }
    }
    Ok(())
}

fn joints(log: &RobotLog, model: &RobotModel, remarks: &mut Vec<String>) -> Result<(), RobotError> {
    let by_position: Vec<Vec<f64>> = log.q.iter().map(|q| difference(q, &log.time_s)).collect();
    let moves = |r: &[f64]| {
        let n = r.iter().filter(|x| x.is_finite()).count().max(1) as f64;
        (r.iter().filter(|x| x.is_finite()).map(|x| x * x).sum::<f64>() / n).sqrt() > 0.1
    };
    for (i, joint) in model.joints.iter().enumerate() {
        let name = &joint.name;
        let largest = log.q[i].iter().filter(|x| x.is_finite()).fold(0.0, |a: f64, x| a.max(x.abs()));
        if let (false, Some((low, high))) = (joint.prismatic, joint.limits) {
            let size = low.abs().max(high.abs());
            if largest > 10.0 * size && largest / DEGREES < 1.5 * size {
                return Err(degrees(
                    log,
                    name,
                    format!("its column reaches {largest:.1}, its limits are {low} to {high} rad"),
                ));
            }
            let beyond = log.q[i].iter().filter(|x| **x > high + 0.05 || **x < low - 0.05).count();
            if beyond > 0 {
                remarks.push(format!(
                    "the joint `{name}` is beyond its limits ({low} to {high} rad) in {beyond} of {} rows",
                    log.q[i].len()
                ));
            }
        }
        if !joint.prismatic
            && let Some(row) = wraps(&log.q[i], &log.time_s)
        {
            let (before, after, at) = (log.q[i][row - 1], log.q[i][row], log.time_s[row]);
            return Err(RobotError::log(
                &log.file,
                format!(
                    "the position of the joint `{name}` jumps from {before:.3} to {after:.3} rad at {at:.3} s: \
                     the column starts again after a whole turn"
                ),
                "let it run on (`numpy.unwrap`)",
            ));
        }
        if log.dq[i].is_empty() {
            continue;
        }
        if !moves(&by_position[i]) {
            let fastest = log.dq[i].iter().filter(|x| x.is_finite()).fold(0.0, |a: f64, x| a.max(x.abs()));
            let spread = spread(&log.q[i]);
            if moves(&log.dq[i]) && spread < STUCK * fastest {
                return Err(RobotError::log(
                    &log.file,
                    format!(
                        "the position of the joint `{name}` stays within {spread:.1e} while its rate reaches {fastest:.1} per second: \
                         expected a position that follows"
                    ),
                    "the encoder is stuck, or the column holds something else; leave the recording out",
                ));
            }
            continue;
        }
        let (r, slope) = agreement(&by_position[i], &log.dq[i]);
        if r > 0.8 && (slope * DEGREES - 1.0).abs() < 0.2 {
            return Err(degrees(
                log,
                name,
                "its rate column is 57.3 times smaller than the change of its position".to_owned(),
            ));
        }
        if r > 0.8 && (slope / DEGREES - 1.0).abs() < 0.2 {
            return Err(RobotError::log(
                &log.file,
                format!("the rate of the joint `{name}` is 57.3 times the change of its position: degrees for radians"),
                format!("convert the column, or name it `dq_{name}_deg_s`"),
            ));
        }
        if r < -0.8 {
            return Err(RobotError::log(
                &log.file,
                format!("the rate of the joint `{name}` has the opposite sign of the change of its position"),
                "turn the sign of one of the two columns, that which contradicts the axis in the model",
            ));
        }
        if r < 0.5 {
            let better = (0..model.joints.len())
                .filter(|&k| k != i && !log.dq[k].is_empty())
                .map(|k| (agreement(&by_position[i], &log.dq[k]).0, k))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            return Err(match better {
                Some((other, k)) if other > 0.8 => RobotError::log(
                    &log.file,
                    format!(
                        "the columns of `{name}` and `{}` look exchanged: the position of the first follows the rate \
                         of the second (correlation {other:.2}, its own {r:.2})",
                        model.joints[k].name
                    ),
                    "correct the names of the columns",
                ),
                _ => RobotError::log(
                    &log.file,
                    format!("the rate of the joint `{name}` does not follow its position (correlation {r:.2})"),
                    "correct the names of the columns, or leave the rates out of the log",
                ),
            });
        }
    }
    Ok(())
}

/// First row that differs by a whole turn from the one before, faster than any joint turns.
fn wraps(q: &[f64], time_s: &[f64]) -> Option<usize> {
    let turn = |k: &usize| {
        let (jump, step_s) = ((q[*k] - q[*k - 1]).abs(), time_s[*k] - time_s[*k - 1]);
        (jump - std::f64::consts::TAU).abs() < 1.0 && jump > FASTEST_RAD_S * step_s
    };
    (1..q.len().min(time_s.len())).find(turn)
}

/// Rate that no joint reaches, rad/s.
const FASTEST_RAD_S: f64 = 200.0;

/// Range of a position, s times the largest rate, below which it does not follow that rate.
const STUCK: f64 = 0.01;

/// Largest less smallest known value.
fn spread(x: &[f64]) -> f64 {
    let known = || x.iter().filter(|v| v.is_finite());
    known().fold(f64::NEG_INFINITY, |a, v| a.max(*v)) - known().fold(f64::INFINITY, |a, v| a.min(*v))
}

fn degrees(log: &RobotLog, joint: &str, evidence: String) -> RobotError {
    RobotError::log(
        &log.file,
        format!("the joint `{joint}` is logged in degrees, expected radians: {evidence}"),
        format!("convert the columns, or name them `q_{joint}_deg`"),
    )
}

/// Rate by differences over a few rows; NaN at the ends and in gaps.
fn difference(values: &[f64], times: &[f64]) -> Vec<f64> {
    let n = values.len();
    (0..n)
        .map(|i| {
            if i < REACH || i + REACH >= n {
                return f64::NAN;
            }
            (values[i + REACH] - values[i - REACH]) / (times[i + REACH] - times[i - REACH])
        })
        .collect()
}

/// Correlation of two series, and the slope of the second on the first, where both are known.
fn agreement(x: &[f64], y: &[f64]) -> (f64, f64) {
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (a, b) in x.iter().zip(y).filter(|(a, b)| a.is_finite() && b.is_finite()) {
        xx += a * a;
        yy += b * b;
        xy += a * b;
    }
    if xx == 0.0 || yy == 0.0 { (0.0, 0.0) } else { (xy / (xx * yy).sqrt(), xy / xx) }
}

/// Compares the base's rotation with the gyroscope, also for other readings of the quaternion.
fn rotation(log: &RobotLog, base: &BaseLog) -> Result<(), RobotError> {
    let Some(gyro) = &log.gyro else { return Ok(()) };
    let offset = if log.base.is_some() { Some(0.0) } else { rough_offset(log, base).map(|r| r.offset_s) };
    let fastest = gyro.iter().map(Vector3::norm).filter(|n| n.is_finite()).fold(0.0, f64::max);
    let turned = base_rates(base, 2);
    let fastest_base = turned.iter().map(|w| w.1.norm()).fold(0.0, f64::max);
    if fastest < AT_REST_RAD_S || fastest_base < AT_REST_RAD_S {
        return Ok(());
    }
    let ratio = middle_norm(gyro.iter()) / middle_norm(turned.iter().map(|w| &w.1));
    if (ratio / DEGREES - 1.0).abs() < 0.3 {
        return Err(RobotError::log(
            &log.file,
            format!("the gyroscope turns {ratio:.1} times as fast as the base of {}: degrees for radians", base.file),
            "convert the gyroscope's columns to rad/s",
        ));
    }
    let Some(offset) = offset else {
        return Err(RobotError::log(
            &base.file,
            format!("the speed of rotation follows that of the gyroscope of {} at no offset of the clocks", log.file),
            "check that both files are of the same recording",
        ));
    };
    let as_read = misfit(log, gyro, &turned, offset);
    if as_read < 0.35 {
        return Ok(());
    }
    let other = |f: &dyn Fn(&Quaternion<f64>) -> Quaternion<f64>| {
        let rotation = base.rotation.iter().map(|q| UnitQuaternion::new_normalize(f(q))).collect();
        misfit(log, gyro, &base_rates(&BaseLog { rotation, ..base.clone() }, 2), offset)
    };
    // columns called w x y z that hold x y z w
    let scalar_last = other(&|q| Quaternion::new(q.k, q.w, q.i, q.j));
    let scalar_first = other(&|q| Quaternion::new(q.i, q.j, q.k, q.w));
    let inverse = other(&|q| q.conjugate());
    let candidates = [
        (scalar_last, "its quaternion columns hold x, y, z, w, not w, x, y, z as their names say"),
        (scalar_first, "its quaternion columns are shifted: qx holds w"),
        (inverse, "its quaternions turn from world to base, expected from base to world"),
    ];
    let best = candidates.iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let words = match best {
        Some((error, words)) if *error < 0.35 => format!(
            "{words}: read so, the rotation misses the gyroscope by {:.0} %, as named by {:.0} %",
            error * 100.0,
            as_read * 100.0
        ),
        _ => format!(
            "its rotation contradicts the gyroscope of {}: they differ by {:.0} % of the angular velocity",
            log.file,
            as_read * 100.0
        ),
    };
    Err(RobotError::log(&base.file, words, "correct the order of the columns, or the axes of the gyroscope"))
}

fn middle_norm<'v>(values: impl Iterator<Item = &'v Vector3<f64>>) -> f64 {
    let mut norms: Vec<f64> = values.map(Vector3::norm).filter(|n| n.is_finite()).collect();
    norms.sort_by(f64::total_cmp);
    norms.get(norms.len() * 9 / 10).copied().unwrap_or(f64::NAN)
}

/// Root mean square difference of gyroscope and base's rotation, relative to the gyroscope's.
fn misfit(log: &RobotLog, gyro: &[Vector3<f64>], turned: &[(f64, Vector3<f64>)], offset: f64) -> f64 {
    let (mut difference, mut size) = (0.0, 0.0);
    let mut steps: Vec<f64> = log.time_s.windows(2).map(|w| w[1] - w[0]).collect();
    let usual = aloft_signal::median(&mut steps);
    for (t, rate) in turned {
        let at = log.time_s.partition_point(|x| *x < t - offset);
        // in a gap of the log the next sample is of another instant
        let near = log.time_s.get(at).is_some_and(|next| next - (t - offset) <= 1.5 * usual);
        if !near {
            continue;
        }
        let Some(g) = gyro.get(at).filter(|g| g.norm().is_finite() && at > 0) else { continue };
        difference += (rate - g).norm_squared();
        size += g.norm_squared();
    }
    if size == 0.0 { f64::NAN } else { (difference / size).sqrt() }
}
