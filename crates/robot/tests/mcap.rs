//! Logs in MCAP as other programs write them (tests/peers/robot_mcap.py), and what is said about
//! damaged ones.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_robot::ros::{Topics, read};
use aloft_robot::{BaseLog, Columns};
use std::fs;

const HERE: &str = env!("CARGO_MANIFEST_DIR");

fn file(name: &str) -> Vec<u8> {
    fs::read(format!("{HERE}/tests/mcap/{name}")).unwrap()
}

fn fixture(end: &str) -> Columns {
    let bytes = fs::read(format!("{HERE}/../../fixtures/robot/throw_01_{end}")).unwrap();
    Columns::from_csv(end, &bytes).unwrap()
}

/// Error of reading a file, as users see it.
fn problem(bytes: &[u8], topics: &Topics) -> String {
    let error = read("log.mcap", bytes, topics).unwrap_err().to_string();
    assert!(!error.contains('\n'), "{error}");
    error
}

#[test]
fn files_of_other_writers_hold_what_the_csv_holds() {
    let (log, base) = (fixture("robot.csv.gz"), fixture("base.csv"));
    for name in ["zstd.mcap", "odometry_lz4.mcap", "ros1.mcap", "plain.mcap"] {
        let (found, poses) = read(name, &file(name), &Topics::default()).unwrap();
        let rows = found.height();
        assert!(rows == if name == "plain.mcap" { 31 } else { 61 }, "{name}: {rows}");
        let same = |ours: &str, theirs: &str| {
            let (a, b) = (found.get(ours).unwrap(), log.get(theirs).unwrap());
            for i in 0..rows {
                assert!((a[i] - b[i]).abs() < 1e-12, "{name} {ours} row {i}: {} {}", a[i], b[i]);
            }
        };
        for joint in ["l_shoulder", "l_elbow", "r_shoulder", "r_elbow"] {
            same(&format!("position.{joint}"), &format!("q_{joint}_rad"));
            same(&format!("velocity.{joint}"), &format!("dq_{joint}_rad_s"));
            same(&format!("effort.{joint}"), &format!("tau_meas_{joint}_nm"));
        }
        for axis in ["x", "y", "z"] {
            same(&format!("angular_velocity.{axis}"), &format!("gyro_{axis}_rad_s"));
            same(&format!("linear_acceleration.{axis}"), &format!("acc_{axis}_m_s2"));
        }
        let times = found.get("time_s").unwrap();
        let told = log.get("time_s").unwrap();
        for i in 0..rows {
            assert!((times[i] - told[i]).abs() < 1e-9, "{name}: {} {}", times[i], told[i]);
        }
        let (poses, told) = (BaseLog::of(&poses.unwrap()).unwrap(), BaseLog::of(&base).unwrap());
        assert!(poses.time_s.len() >= 5);
        for i in 0..poses.time_s.len() {
            assert!((poses.time_s[i] - told.time_s[i]).abs() < 1e-6, "{name}");
            assert_eq!(poses.position_m[i], told.position_m[i], "{name}");
            assert!(poses.rotation[i].angle_to(&told.rotation[i]) < 1e-9, "{name}");
        }
    }
}

/// A file of channels without messages but for one of four bytes, and without an index.
fn written(channels: &[(&str, &str, &str)]) -> Vec<u8> {
    let text = |s: &str| [&(s.len() as u32).to_le_bytes()[..], s.as_bytes()].concat();
    let record = |op: u8, body: Vec<u8>| [&[op][..], &(body.len() as u64).to_le_bytes(), &body].concat();
    let magic = *b"\x89MCAP0\r\n";
    let mut out = magic.to_vec();
    out.extend(record(1, [text("ros2"), text("test")].concat()));
    for (i, (topic, schema, encoding)) in channels.iter().enumerate() {
        let id = (i as u16 + 1).to_le_bytes();
        out.extend(record(3, [&id[..], &text(schema), &text("ros2msg"), &[0; 4]].concat()));
        out.extend(record(4, [&id[..], &id, &text(topic), &text(encoding), &[0; 4]].concat()));
        out.extend(record(5, [&id[..], &[0; 20], &[0, 1, 0, 0]].concat()));
    }
    out.extend(record(15, vec![0; 4]));
    out.extend(record(2, vec![0; 20]));
    out.extend(magic);
    out
}

#[test]
fn every_fault_is_one_line_that_names_it() {
    const JOINTS: &str = "sensor_msgs/msg/JointState";
    let none = Topics::default();
    let named = Topics { joints: Some("/b".to_owned()), ..Topics::default() };
    let whole = file("zstd.mcap");
    let mut damaged = file("plain.mcap");
    let middle = damaged.len() / 3;
    damaged[middle] ^= 0x40;
    let mut unknown = whole.clone();
    let at = unknown.windows(4).position(|w| w == b"zstd").unwrap();
    unknown[at..at + 4].copy_from_slice(b"snap");
    for (bytes, topics, expected) in [
        (b"time_s,q\n0,1\n".to_vec(), &none, "log.mcap: its first bytes are not those of an MCAP file"),
        (whole[..whole.len() / 2].to_vec(), &none, "the file is cut off after "),
        (whole[..9].to_vec(), &none, "the file is cut off after 0 whole messages"),
        (damaged, &none, "a chunk is damaged (after 0 messages)"),
        (unknown, &none, "a chunk is compressed with `snap`, expected lz4, zstd or none"),
        (written(&[]), &none, "no topic of type sensor_msgs/JointState; found no topics at all"),
        (
            written(&[("/imu", "sensor_msgs/msg/Imu", "cdr")]),
            &none,
            "no topic of type sensor_msgs/JointState; found `/imu` (sensor_msgs/Imu)",
        ),
        (
            written(&[("/a", JOINTS, "cdr"), ("/b", JOINTS, "cdr")]),
            &none,
            "2 topics could be the joints: `/a` (sensor_msgs/JointState), `/b` (sensor_msgs/JointState)",
        ),
        (written(&[("/a", JOINTS, "cdr")]), &named, "no messages of type sensor_msgs/JointState on `/b`; found `/a`"),
        (written(&[("/a", JOINTS, "json")]), &none, "`/a` is encoded as `json`, expected cdr or ros1"),
        (
            written(&[("/a", JOINTS, "cdr"), ("/b", JOINTS, "cdr")]),
            &named,
            "message 1 of 1 on `/b` is not a whole sensor_msgs/JointState in cdr",
        ),
    ] {
        let found = problem(&bytes, topics);
        assert!(found.contains(expected), "expected {expected}: {found}");
    }
}

/// Whatever the bytes are, there is a result or an error.
#[test]
fn no_damage_makes_the_reader_fail_otherwise() {
    for name in ["zstd.mcap", "plain.mcap", "ros1.mcap"] {
        let whole = file(name);
        for i in (8..whole.len()).step_by(37) {
            let mut bytes = whole.clone();
            bytes[i] = bytes[i].wrapping_add(0x81);
            let _ = read("log.mcap", &bytes, &Topics::default());
            // a file that ends within its index has all its messages
            let cut = read("log.mcap", &whole[..i], &Topics::default());
            assert!(cut.is_err() || i > whole.len() / 2, "{name} cut at {i}");
        }
    }
}
