//! Logs: sensors of a known motion give the motion back, and mistakes give one clear line.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_body::Model;
use aloft_robot::{BaseLog, Columns, FuseInput, Imu, RobotLog, RobotModel, SensorNoise, check, fuse};
use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const OFFSET_S: f64 = 0.0123;
const LEVER: [f64; 3] = [0.03, -0.02, 0.05];
const NOISE: SensorNoise = SensorNoise {
    position_m: 3e-4,
    orientation_deg: 0.05,
    dq_rad_s: 0.02,
    torque_nm: 0.1,
    gyro_rad_s: 0.004,
    acc_m_s2: 0.04,
};

fn pose(t: f64) -> (Vector3<f64>, UnitQuaternion<f64>) {
    let p = Vector3::new(0.3 * (1.7 * t).sin(), 0.2 * (1.1 * t).cos(), 1.0 + 0.4 * (2.3 * t).sin());
    let r = UnitQuaternion::from_scaled_axis(Vector3::new(
        0.9 * (1.3 * t).sin(),
        0.6 * (2.1 * t).cos(),
        1.4 * (0.9 * t).sin(),
    ));
    (p, r)
}

fn joints(t: f64) -> [f64; 2] {
    [1.2 * (4.0 * t).sin(), 0.05 + 0.04 * (5.0 * t).cos()]
}

/// Log and base recording of the motion, as CSV.
fn recording(seed: u64) -> (String, String) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |sd: f64| -> f64 { sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng) };
    let h = 1e-4;
    let sensor = |t: f64| {
        let (p, r) = pose(t);
        p + r * Vector3::from(LEVER)
    };
    let step = std::f64::consts::TAU / 16384.0;
    let mut log =
        "time_s,q_shoulder_rad,q_extend_m,dq_shoulder_rad_s,dq_extend_m_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,\
                   acc_x_m_s2,acc_y_m_s2,acc_z_m_s2\n"
            .to_owned();
    for i in 0..3000 {
        let t = i as f64 * 0.002;
        let (_, r) = pose(t);
        let omega =
            (pose(t - h).1.inverse() * pose(t + h).1).scaled_axis() / (2.0 * h) + Vector3::new(0.01, -0.005, 0.008);
        let acceleration = (sensor(t + h) - sensor(t) * 2.0 + sensor(t - h)) / (h * h);
        let force = r.inverse() * (acceleration + Vector3::z() * 9.81) + Vector3::new(0.1, -0.08, 0.02);
        let [a, b] = joints(t);
        let [da, db] = [0, 1].map(|k| (joints(t + h)[k] - joints(t - h)[k]) / (2.0 * h));
        log += &format!(
            "{t:.3},{:.5},{:.6},{:.3},{:.4}",
            (a / step).round() * step,
            b,
            da + noise(0.02),
            db + noise(0.002)
        );
        for k in 0..3 {
            log += &format!(",{:.4}", omega[k] + noise(NOISE.gyro_rad_s));
        }
        for k in 0..3 {
            log += &format!(",{:.3}", force[k] + noise(NOISE.acc_m_s2));
        }
        log.push('\n');
    }
    let mut base = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n".to_owned();
    for i in 0..1180 {
        let t = 0.02 + i as f64 * 0.005;
        let (p, r) = pose(t);
        let sd = NOISE.orientation_deg.to_radians();
        let r = UnitQuaternion::from_scaled_axis(Vector3::new(noise(sd), noise(sd), noise(sd))) * r;
        let p = p + Vector3::new(noise(NOISE.position_m), noise(NOISE.position_m), noise(NOISE.position_m));
        let q = r.quaternion();
        base += &format!(
            "{:.5},{:.5},{:.5},{:.5},{:.6},{:.6},{:.6},{:.6}\n",
            t + OFFSET_S,
            p.x,
            p.y,
            p.z,
            q.w,
            q.i,
            q.j,
            q.k
        );
    }
    (log, base)
}

fn robot() -> RobotModel {
    RobotModel::parse("robot.urdf", include_str!("robot.urdf")).unwrap()
}

fn read(log: &str, base: &str) -> Result<(RobotLog, BaseLog), String> {
    let robot = robot();
    let log = RobotLog::of(&Columns::from_csv("a_robot.csv", log.as_bytes()).map_err(|e| e.to_string())?, &robot);
    let log = log.map_err(|e| e.to_string())?;
    let base = BaseLog::of(&Columns::from_csv("a_base.csv", base.as_bytes()).map_err(|e| e.to_string())?);
    let base = base.map_err(|e| e.to_string())?;
    check(&log, Some(&base), &robot).map_err(|e| e.to_string())?;
    Ok((log, base))
}

#[test]
fn sensors_give_the_motion_back_and_the_clock_offset_with_an_honest_interval() {
    let mut model = Model::from_spec(&robot().spec).unwrap();
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -9.81);
    let imu = Imu { link: None, position_m: LEVER, rpy_rad: [0.0; 3] };
    let (mut inside, mut sum) = (0, [0.0; 3]);
    for seed in 0..40 {
        let (log, base) = recording(seed);
        let (log, base) = read(&log, &base).unwrap();
        let input = FuseInput {
            trial: "a",
            model: &model,
            log: &log,
            base: Some(&base),
            imu: Some(&imu),
            noise: NOISE,
            bridged_s: 0.0,
        };
        let (motion, report) = fuse(&input).unwrap();
        let (offset, sd) = (report.clock_offset_s.unwrap(), report.clock_offset_sd_s.unwrap());
        inside += usize::from((offset - OFFSET_S).abs() < 1.96 * sd);
        assert!((offset - OFFSET_S).abs() < 2e-4 && sd < 8e-5, "{offset} ± {sd}");
        assert!((report.gyro_bias_rad_s.unwrap()[0] - 0.01).abs() < 1e-3, "{:?}", report.gyro_bias_rad_s);
        assert!((report.acc_bias_m_s2.unwrap()[1] + 0.08).abs() < 0.02, "{:?}", report.acc_bias_m_s2);
        assert!(report.orientation_ratio.unwrap() < 1.1 && report.position_ratio.unwrap() < 1.2, "{report:?}");
        let (mut p2, mut r2, mut n) = (0.0, 0.0, 0.0);
        for i in (200..2800).step_by(10) {
            let (p, r) = pose(i as f64 * 0.002);
            let q = motion.q(i);
            p2 += (Vector3::new(q[0], q[1], q[2]) - p).norm_squared() / 3.0;
            let found = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q[6], q[3], q[4], q[5]));
            r2 += (r.inverse() * found).scaled_axis().norm_squared() / 3.0;
            assert!((q[7] - joints(i as f64 * 0.002)[0]).abs() < 2e-4);
            n += 1.0;
        }
        // better than a pose by a factor of three or more
        let (p, r) = ((p2 / n).sqrt(), (r2 / n).sqrt());
        assert!(p < 1e-4 && r < 2.2e-4, "{p} {r}");
        let squares = [p / report.position_sd_m, r / report.orientation_sd_rad, (offset - OFFSET_S) / sd];
        for (sum, z) in sum.iter_mut().zip(squares) {
            *sum += z * z / 40.0;
        }
    }
    // errors of one recording are correlated over a third of a second, so that single recordings
    // scatter
    let [p, r, o] = sum.map(f64::sqrt);
    assert!((0.8..1.25).contains(&p) && (0.8..1.25).contains(&r) && (0.75..1.3).contains(&o), "{p} {r} {o}");
    assert!((34..=40).contains(&inside), "{inside} of 40 intervals hold the offset");
}

#[test]
fn accelerations_off_between_samples_widen_the_stated_deviations() {
    // the acceleration acts up to 0.5 ms before or after it is sampled, as where drives hold their
    // forces from step to step: an error that is neither white nor a constant delay
    let mut model = Model::from_spec(&robot().spec).unwrap();
    model.gravity_mps2 = Vector3::zeros();
    let (mut sum, dt, fine) = (0.0, 0.002, 8);
    for seed in 0..12 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let n = 3000;
        let phase = Vector3::new(normal(), normal(), normal());
        let (mut p, mut v) = (Vector3::<f64>::zeros(), phase.map(|a| -12.0 / 19.0 * a.cos()));
        let (mut acc, mut truth) = (Vec::new(), Vec::new());
        for i in 0..n * fine {
            let t = i as f64 * dt / fine as f64;
            let at = |t: f64| phase.map(|a| 12.0 * (19.0 * t + a).sin());
            if i % fine == 0 {
                acc.push(at(t) + Vector3::new(normal(), normal(), normal()) * NOISE.acc_m_s2);
                truth.push(p);
            }
            let h = dt / fine as f64;
            let force = at(t + 0.5 * h + 5e-4 * (7.0 * t).sin());
            p += v * h + force * (0.5 * h * h);
            v += force * h;
        }
        let time_s: Vec<f64> = (0..n).map(|i| i as f64 * dt).collect();
        let gyro = (0..n).map(|_| Vector3::new(normal(), normal(), normal()) * NOISE.gyro_rad_s).collect();
        let q = vec![(0..n).map(|i| 1e-4 * f64::from(i as u32 % 7)).collect(); 2];
        let sd = NOISE.orientation_deg.to_radians();
        let rows: Vec<usize> = (0..n - 3).step_by(3).collect();
        let base = BaseLog {
            file: "base".to_owned(),
            time_s: rows.iter().map(|i| time_s[*i]).collect(),
            position_m: rows
                .iter()
                .map(|i| truth[*i] + Vector3::new(normal(), normal(), normal()) * NOISE.position_m)
                .collect(),
            rotation: rows
                .iter()
                .map(|_| UnitQuaternion::from_scaled_axis(Vector3::new(normal(), normal(), normal()) * sd))
                .collect(),
        };
        let log = RobotLog {
            file: "log".to_owned(),
            time_s,
            q,
            gyro: Some(gyro),
            acc: Some(acc),
            base: Some(base),
            ..RobotLog::default()
        };
        let imu = Imu { link: None, position_m: [0.0; 3], rpy_rad: [0.0; 3] };
        let input = FuseInput {
            trial: "a",
            model: &model,
            log: &log,
            base: None,
            imu: Some(&imu),
            noise: NOISE,
            bridged_s: 0.0,
        };
        let (motion, report) = fuse(&input).unwrap();
        assert!(report.position_ratio.unwrap() < 1.1, "{:?}", report.position_ratio);
        for i in (200..n - 200).step_by(10) {
            let q = motion.q(i);
            let z = (Vector3::new(q[0], q[1], q[2]) - truth[i]) / motion.q_sd[i * motion.nv];
            sum += z.norm_squared() / 3.0 / 260.0 / 12.0;
        }
    }
    let ratio = sum.sqrt();
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
}

#[test]
fn bad_logs_give_one_clear_line() {
    let (log, base) = recording(1);
    read(&log, &base).unwrap();
    // every field of a column multiplied or moved
    let edit = |text: &str, f: &dyn Fn(usize, &mut Vec<String>)| -> String {
        let rows = text.lines().enumerate().map(|(i, l)| {
            let mut fields: Vec<String> = l.split(',').map(str::to_owned).collect();
            f(i, &mut fields);
            fields.join(",")
        });
        rows.collect::<Vec<_>>().join("\n") + "\n"
    };
    let times = |factor: f64, columns: &'static [usize]| {
        move |i: usize, f: &mut Vec<String>| {
            for c in columns.iter().filter(|_| i > 0) {
                f[*c] = format!("{:.5}", f[*c].parse::<f64>().unwrap() * factor);
            }
        }
    };
    let degrees = 180.0 / std::f64::consts::PI;
    let cases: Vec<(String, String, &str)> = vec![
        (
            log.replacen("q_shoulder_rad", "q_schulter_rad", 1),
            base.clone(),
            "no column for the joint `shoulder`, expected `q_shoulder_rad`",
        ),
        (
            edit(&log, &|i, f| {
                if i > 0 {
                    f.swap(1, 2)
                }
            }),
            base.clone(),
            "look exchanged",
        ),
        (edit(&log, &times(degrees, &[1])), base.clone(), "is logged in degrees, expected radians"),
        (edit(&log, &times(degrees, &[3])), base.clone(), "57.3 times the change of its position: degrees for radians"),
        (edit(&log, &times(-1.0, &[3])), base.clone(), "opposite sign"),
        (edit(&log, &times(degrees, &[5, 6, 7])), base.clone(), "the gyroscope turns 56.6 times"),
        (
            edit(&log, &|i, f| {
                if i == 1500 {
                    f[0] = "0.5".to_owned()
                }
            }),
            base.clone(),
            "line 1501: `time_s` goes from",
        ),
        (
            edit(&log, &|i, f| {
                if i > 0 {
                    f[2] = "NaN".to_owned()
                }
            }),
            base.clone(),
            "the column of the joint `extend` holds no number in 3000 rows",
        ),
        (
            edit(&log, &|i, f| {
                if i > 0 {
                    f[8..11].fill(String::new())
                }
            }),
            base.clone(),
            "the columns of the accelerometer hold no number",
        ),
        (
            edit(&log, &|i, f| {
                let q: f64 = f[1].parse().unwrap_or(0.0);
                if i > 0 && q > 0.5 {
                    f[1] = (q - std::f64::consts::TAU).to_string()
                }
            }),
            base.clone(),
            "the position of the joint `shoulder` jumps from 0.4",
        ),
        (
            edit(&log, &|i, f| {
                if i == 31 {
                    f[0] = "0.058".to_owned()
                }
            }),
            base.clone(),
            "line 32: `time_s` is 0.058 once more",
        ),
        (log.replace("0.400,", "0.400,x"), base.clone(), "line 202: column `q_shoulder_rad` holds"),
        (
            log.clone(),
            edit(&base, &|i, f| {
                if i > 0 {
                    f[4..8].rotate_left(1)
                }
            }),
            "hold x, y, z, w, not w, x, y, z",
        ),
        (log.clone(), edit(&base, &times(-1.0, &[5, 6, 7])), "turn from world to base"),
        (log.clone(), edit(&base, &times(2.0, &[4, 5, 6, 7])), "line 2: the quaternion has length 2.000"),
        (log.clone(), base.replacen("qw", "w", 1), "no column `qw`"),
        (log.clone(), base.lines().rev().collect::<Vec<_>>().join("\n"), "a_base.csv, line"),
    ];
    for (log, base, expected) in cases {
        let error = read(&log, &base).unwrap_err();
        assert!(error.contains(expected) && !error.contains('\n'), "expected {expected}: {error}");
    }
}

#[test]
fn gaps_leave_frames_out_and_say_so() {
    let (log, base) = recording(2);
    let cut: String =
        log.lines().enumerate().filter(|(i, _)| !(900..960).contains(i)).map(|(_, l)| format!("{l}\n")).collect();
    let (log, base) = read(&cut, &base).unwrap();
    let model = Model::from_spec(&robot().spec).unwrap();
    let imu = Imu { link: None, position_m: LEVER, rpy_rad: [0.0; 3] };
    let input = FuseInput {
        trial: "a",
        model: &model,
        log: &log,
        base: Some(&base),
        imu: Some(&imu),
        noise: NOISE,
        bridged_s: 0.0,
    };
    let (motion, report) = fuse(&input).unwrap();
    assert_eq!(motion.n_frames(), 3000);
    assert!((58..=62).contains(&report.inner_missing_frames), "{}", report.inner_missing_frames);
    assert!(
        report.warnings[0].contains("1 gaps in the log, the longest of 0.122 s at 1.796 s"),
        "{:?}",
        report.warnings
    );
    assert!(!motion.is_valid(920) && motion.is_valid(890) && motion.is_valid(970));
}
