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

/// A file of channels with one message of four bytes each, and without an index.
fn written(channels: &[(&str, &str, &str)]) -> Vec<u8> {
    let all: Vec<Written> = channels.iter().map(|c| (c.0, c.1, c.2, vec![(0, vec![0, 1, 0, 0])])).collect();
    with_messages(&all)
}

/// Topic, type, encoding, and messages: time of logging, ns, and bytes.
type Written<'a> = (&'a str, &'a str, &'a str, Vec<(u64, Vec<u8>)>);

fn with_messages(channels: &[Written]) -> Vec<u8> {
    let text = |s: &str| [&(s.len() as u32).to_le_bytes()[..], s.as_bytes()].concat();
    let record = |op: u8, body: Vec<u8>| [&[op][..], &(body.len() as u64).to_le_bytes(), &body].concat();
    let magic = *b"\x89MCAP0\r\n";
    let mut out = magic.to_vec();
    out.extend(record(1, [text("ros2"), text("test")].concat()));
    for (i, (topic, schema, encoding, messages)) in channels.iter().enumerate() {
        let id = (i as u16 + 1).to_le_bytes();
        out.extend(record(3, [&id[..], &text(schema), &text("ros2msg"), &[0; 4]].concat()));
        out.extend(record(4, [&id[..], &id, &text(topic), &text(encoding), &[0; 4]].concat()));
        for (time, bytes) in messages {
            out.extend(record(5, [&id[..], &[0; 4], &time.to_le_bytes(), &[0; 8], bytes].concat()));
        }
    }
    out.extend(record(15, vec![0; 4]));
    out.extend(record(2, vec![0; 20]));
    out.extend(magic);
    out
}

/// A message in the encoding of ROS 2.
#[derive(Default)]
struct Cdr(Vec<u8>);

impl Cdr {
    fn put(mut self, bytes: &[u8]) -> Self {
        self.0.resize(self.0.len().next_multiple_of(bytes.len()), 0);
        self.0.extend(bytes);
        self
    }
    fn integer(self, n: u32) -> Self {
        self.put(&n.to_le_bytes())
    }
    fn text(self, s: &str) -> Self {
        let mut own = self.integer(s.len() as u32 + 1);
        own.0.extend(s.bytes().chain([0]));
        own
    }
    fn floats(self, x: &[f64]) -> Self {
        x.iter().fold(self, |m, x| m.put(&x.to_le_bytes()))
    }
    fn header(self, time_ns: u64) -> Self {
        self.integer((time_ns / 1_000_000_000) as u32).integer((time_ns % 1_000_000_000) as u32).text("sole")
    }
    fn done(self) -> Vec<u8> {
        [vec![0, 1, 0, 0], self.0].concat()
    }
}

/// Contact comes from the topics that the description names: flags hold until the next one, forces
/// for a few of their intervals; other topics of the same types are not read.
#[test]
fn contact_comes_from_the_topics_that_are_named() {
    const MS: u64 = 1_000_000;
    let joints = (0..100).map(|i: u64| {
        let lists = |m: Cdr| m.integer(1).floats(&[0.01 * i as f64]).integer(0).integer(0);
        (i * 10 * MS, lists(Cdr::default().header(i * 10 * MS).integer(1).text("knee")).done())
    });
    let flags = [(205, 1), (505, 0)].map(|(ms, on)| (ms * MS, Cdr::default().put(&[on]).done()));
    let forces = (0..50).filter(|i| !(20..30).contains(i)).map(|i: u64| {
        let wrench = Cdr::default().header(i * 20 * MS).floats(&[3.0, 0.0, -4.0, 0.0, 0.0, 0.0]);
        (0, wrench.done())
    });
    let touching = [(0, 0), (300, 2)].map(|(ms, n)| (0, Cdr::default().header(ms * MS).integer(n).done()));
    let channels: Vec<Written> = vec![
        ("/joint_states", "sensor_msgs/msg/JointState", "cdr", joints.collect()),
        ("/left", "std_msgs/msg/Bool", "cdr", flags.to_vec()),
        ("/lights", "std_msgs/msg/Bool", "cdr", flags.to_vec()),
        ("/right", "geometry_msgs/msg/WrenchStamped", "cdr", forces.collect()),
        ("/hand", "gazebo_msgs/msg/ContactsState", "cdr", touching.to_vec()),
    ];
    let topic = |(link, topic): (&str, &str)| (link.to_owned(), topic.to_owned());
    let contact = [("l_foot", "/left"), ("r_foot", "/right"), ("hand", "/hand")].map(topic).into();
    let bytes = with_messages(&channels);
    let (log, _) = read("log.mcap", &bytes, &Topics { contact, ..Topics::default() }).unwrap();
    let column = |name: &str| log.get(name).unwrap();
    assert_eq!(column("time_s").len(), 100);
    for i in 0..100 {
        let ms = 10 * i;
        let left = if ms < 205 { f64::NAN } else { f64::from(u8::from(ms < 505)) };
        assert_eq!(column("contact_l_foot")[i].to_bits(), left.to_bits(), "{ms} ms");
        // silent from 380 to 600 ms: held for two and a half intervals of 20 ms
        let right = if (440..600).contains(&ms) { f64::NAN } else { 5.0 };
        assert_eq!(column("force_z_r_foot_n")[i].to_bits(), right.to_bits(), "{ms} ms");
        assert_eq!(column("contact_hand")[i], f64::from(u8::from(ms >= 300)), "{ms} ms");
    }
    let wrong = Topics { contact: [topic(("l_foot", "/joint_states"))].into(), ..Topics::default() };
    let found = problem(&bytes, &wrong);
    assert!(
        found.contains("no messages of type std_msgs/Bool, geometry_msgs/WrenchStamped, gazebo_msgs/ContactsState on `/joint_states`"),
        "{found}"
    );
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
