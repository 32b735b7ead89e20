//! Damaged files of every format that is read: a result or an error, never a panic, and no more
//! than seconds.
//!
//! A deterministic fuzzer: seed `n` of a target always makes the same file. An ordinary run tries a
//! few hundred of each; `ALOFT_FUZZ_SECONDS=300` goes on for that time with each, and
//! `ALOFT_FUZZ_TARGET=urdf` takes one of them. What was found is kept below (`hostile`) or as a
//! test beside its reader. For C3D there are targets of libFuzzer in `crates/c3d/fuzz`.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests fail by panicking")]

use aloft_body::{Model, ModelSpec, Phi};
use aloft_effects::{FormulaEffect, Scene};
use aloft_robot::osim::OsimModel;
use aloft_robot::ros::Topics;
use aloft_robot::{BaseLog, Columns, RobotDescription, RobotLog, RobotModel};
use aloft_scale::{Anthropometry, ObjectSpec};
use aloft_simulate::Scenario;
use aloft_study::config::{PipelineConfig, Sections};
use aloft_study::data_set::DataSet;
use aloft_study::subject_session::Overrides;
use aloft_study::{catalog, facts, ranges};
use aloft_trial::{BidsMotion, ImportOptions, MarkerSet, Trial};
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::Manifest;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Longest time that one damaged file may take, on a loaded machine.
const LONGEST: Duration = Duration::from_secs(10);
/// Stack of the threads that read recordings.
const STACK: usize = 2 << 20;
/// Files that an ordinary run tries with each target.
const TRIED: u64 = 300;

/// Reads bytes as one format.
type Read = fn(&[u8]);
/// Name, reader, and the files that are damaged.
type Target = (&'static str, Read, fn() -> Vec<Vec<u8>>);

const TARGETS: [Target; 20] = [
    ("trc", |b| drop(Trial::from_trc_mot("t", &lossy(b), None, &ImportOptions::default())), || texts(&[TRC])),
    ("mot", |b| drop(Trial::contents_of_mot("t", &lossy(b), &ImportOptions::default())), || texts(&[MOT])),
    ("sto", |b| drop(Trial::from_trc_mot("t", TRC, Some(&lossy(b)), &ImportOptions::default())), || texts(&[MOT])),
    ("bids", bids, || texts(&[BIDS])),
    ("urdf", model, || files(&["fixtures/robot/model/nominal.urdf", "crates/robot/tests/robot.urdf"])),
    ("mjcf", model, || files(&["fixtures/robot/model/nominal.xml", "crates/robot/tests/robot.xml"])),
    ("osim", |b| drop(OsimModel::parse("m.osim", &lossy(b))), || files(&["fixtures/osim/body.osim"])),
    (
        "mcap",
        |b| drop(aloft_robot::ros::read("l.mcap", b, &Topics::default())),
        || {
            let of = |name: &str| format!("crates/robot/tests/mcap/{name}.mcap");
            files(&[&of("zstd"), &of("odometry_lz4"), &of("ros1")])
        },
    ),
    ("log", log, || texts(&[LOG])),
    ("pipeline", checked::<PipelineConfig>, || {
        files(&["pipelines/demo.yaml", "pipelines/human.yaml", "pipelines/robot.yaml"])
    }),
    ("overrides", checked::<Sections>, || texts(&["filter: {cutoff_hz: 8.0}\nimport: {aliases: {A: LASI}}\n"])),
    ("subject", subject, || files(&["fixtures/human_twin/subject.yaml"])),
    ("robot", plain::<RobotDescription>, || files(&["fixtures/robot/robot.yaml"])),
    ("scenario", plain::<Scenario>, || configs("scenarios")),
    ("markersets", plain::<MarkerSet>, || configs("markersets")),
    ("objects", plain::<ObjectSpec>, || configs("objects")),
    ("models", links, || configs("models")),
    ("anthropometry", plain::<Anthropometry>, || configs("anthropometry")),
    ("formula", formula, || configs("effects")),
    ("manifest", manifest, || texts(&[MANIFEST])),
];

const TRC: &str = "PathFileType\t4\t(X/Y/Z)\tx.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
100\t100\t3\t2\tmm\t100\t1\t3
Frame#\tTime\tA\t\t\tB\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.00\t1\t2\t3\t4\t5\t6
2\t0.01\t1.1\t2\t3\t4\t5\t6
3\t0.02\t1.2\t2\t3\t4\t5\t6
";
const MOT: &str = "grf
version=1
nRows=3
nColumns=7
inDegrees=no
endheader
time\tground_force_vx\tground_force_vy\tground_force_vz\tground_force_px\tground_force_py\tground_force_pz
0.00\t1\t600\t2\t0.1\t0\t0.2
0.01\t1\t610\t2\t0.1\t0\t0.2
0.02\t1\t605\t2\t0.1\t0\t0.2
";
/// Channels, and after the zero byte their values.
const BIDS: &str = "name\tcomponent\ttype\tunits
A_x\tx\tPOS\tmm
A_y\ty\tPOS\tmm
A_z\tz\tPOS\tmm
\x001\t2\t3
4\tn/a\t6
";
const LOG: &str = "time_s,q_l_shoulder_rad,x_m,y_m,z_m,qw,qx,qy,qz,gyro_x_rad_s
0.000,0.1,0,0,1,1,0,0,0,0
0.002,0.2,0,0,1,1,0,0,0,nan
0.004,0.3,0,0,1,1,0,0,0,
";
const MANIFEST: &str = r#"{"stage": "import", "trial": "jump01", "version": 10, "parameters": {}, "inputs": {"file a": "00"},
"outcome": {"status": "ok"}, "warnings": [], "summary": {}, "output": "", "files": {}, "seconds": 0.1, "program": "0.1.0"}"#;

/// Texts that once were too much for a reader, or could be, given to every target.
fn hostile() -> Vec<Vec<u8>> {
    let nested = |open: &str, n: usize, close: &str| format!("{}{}", open.repeat(n), close.repeat(n));
    let within = |begin: &str, inside: String, end: &str| format!("{begin}{inside}{end}");
    let entity = "x".repeat(40_000);
    let reference = "&a;".repeat(40_000);
    let alias = |i: i32| if i == 0 { "*a".to_owned() } else { format!("*b{}", i - 1) };
    let aliases: String = (0..20).map(|i| format!("b{i}: &b{i} [{}]\n", vec![alias(i); 9].join(", "))).collect();
    let mut out: Vec<Vec<u8>> = [
        format!("<!DOCTYPE r [<!ENTITY a \"{entity}\">]><robot name=\"{reference}\"/>"),
        within("<robot name=\"r\">", nested("<link name=\"a\">", 20_000, "</link>"), "</robot>"),
        within("<robot name=\"r\">", nested("<link name=\"a\">", 248, "</link>"), "</robot>"),
        within("<mujoco><worldbody>", nested("<body>", 247, "</body>"), "</worldbody></mujoco>"),
        within("<OpenSimDocument Version=\"40000\"><Model>", nested("<a>", 247, "</a>"), "</Model></OpenSimDocument>"),
        "[".repeat(100_000),
        "{a: ".repeat(50_000),
        "- ".repeat(100_000),
        "? ".repeat(100_000),
        "{\"a\":".repeat(50_000),
        "(".repeat(50_000),
        format!("{}: [}}", "k".repeat(70_000)),
        format!("name: [{}", "a ".repeat(40_000)),
        format!("a: &a [x, x, x, x, x, x, x, x]\n{aliases}"),
        "!!binary x: !<tag> &a *a".to_owned(),
        "\u{feff}\u{0}\u{85}\u{2028}".to_owned(),
    ]
    .into_iter()
    .map(String::into_bytes)
    .collect();
    out.push(Vec::new());
    out
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn texts(all: &[&str]) -> Vec<Vec<u8>> {
    all.iter().map(|t| t.as_bytes().to_vec()).collect()
}

fn files(paths: &[&str]) -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    paths.iter().map(|p| std::fs::read(root.join(p)).unwrap()).collect()
}

fn configs(kind: &str) -> Vec<Vec<u8>> {
    let text = |name: &String| catalog::find(kind, name, Path::new("")).unwrap().text.into_bytes();
    catalog::names(kind).iter().map(text).collect()
}

fn bids(bytes: &[u8]) {
    let text = lossy(bytes);
    let (channels, motion) = text.split_once('\0').unwrap_or((&text, "1\t2\t3\n"));
    let source = BidsMotion { motion, channels, rate_hz: Some(100.0), duration_s: None, spatial_axes: None };
    drop(Trial::from_bids_motion("t", &source, &ImportOptions::default()));
}

fn model(bytes: &[u8]) {
    let text = lossy(bytes);
    drop(RobotModel::parse("m", &text));
    if let Ok(spec) = ModelSpec::from_urdf(&text) {
        drop(Model::from_spec(&spec));
    }
}

fn log(bytes: &[u8]) {
    static ROBOT: OnceLock<RobotModel> = OnceLock::new();
    let urdf = || lossy(&files(&["fixtures/robot/model/nominal.urdf"])[0]);
    let robot = ROBOT.get_or_init(|| RobotModel::parse("m", &urdf()).unwrap());
    if let Ok(columns) = Columns::from_csv("l.csv", bytes) {
        drop(RobotLog::of(&columns, robot));
        drop(BaseLog::of(&columns));
    }
}

/// What a user would see of an error.
fn shown<T>(result: Result<T, PipelineError>) {
    if let Err(e) = result {
        assert!(!format!("{:?}", miette::Report::new(e)).is_empty());
    }
}

fn plain<T: serde::de::DeserializeOwned>(bytes: &[u8]) {
    shown(ranges::parse_yaml::<T>("f.yaml", &lossy(bytes)));
}

fn checked<T: serde::de::DeserializeOwned + schemars::JsonSchema + 'static>(bytes: &[u8]) {
    shown(ranges::parse::<T>("f.yaml", &lossy(bytes)));
}

fn links(bytes: &[u8]) {
    match ranges::parse_yaml::<ModelSpec>("f.yaml", &lossy(bytes)) {
        Ok(spec) => drop(Model::from_spec(&spec)),
        Err(e) => shown::<()>(Err(e)),
    }
}

fn in_file<T>(name: &str, bytes: &[u8], read: impl FnOnce(PathBuf) -> T) -> T {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join(name), bytes).unwrap();
    read(dir.path().join(name))
}

fn subject(bytes: &[u8]) {
    in_file("subject.yaml", bytes, |path| {
        // opening a study takes a hundred times as long as reading its facts: where they cannot be
        // read, one study in eight shows the error
        let stated = facts::stated_name(path.parent().unwrap_or(&path));
        if stated.is_none() && !bytes.len().is_multiple_of(8) {
            return;
        }
        std::fs::write(path.with_file_name("static.c3d"), "").unwrap();
        let pipeline = path.with_file_name("p.yaml");
        std::fs::write(&pipeline, "name: t\ndata: .\nmodel: human34\nmarker_set: plug-in-gait-35\n").unwrap();
        shown(DataSet::open(&pipeline, &Overrides::default()));
    });
}

fn formula(bytes: &[u8]) {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    let scene = SCENE.get_or_init(|| {
        let spec: ModelSpec = catalog::load("models", "human34", Path::new("")).unwrap();
        let model = Model::from_spec(&spec).unwrap();
        Scene::new(&model, &vec![Phi::zeros(); model.links.len()], &[])
    });
    if let Ok(effect) = ranges::parse::<FormulaEffect>("f.yaml", &lossy(bytes)) {
        drop(effect.compile(scene));
    }
}

fn manifest(bytes: &[u8]) {
    drop(serde_json::from_slice::<Manifest>(bytes));
    in_file("manifest.json", bytes, |path| drop(aloft_workspace::seal::read::<Manifest>(&path)));
}

/// Small random number generator; a failure names the seed that reproduces it.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

/// Words that mean something in one of the formats.
const WORDS: [&str; 36] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e309",
    "-1e-320",
    "99999999999999999999",
    "18446744073709551615",
    "-9223372036854775808",
    "[",
    "]",
    "{",
    "}",
    ": ",
    "- ",
    "\n",
    "\t",
    "\"",
    "'",
    "<",
    ">",
    "/>",
    "&a;",
    "<!--",
    "]]>",
    "\0",
    "\u{1b}[31m",
    "\u{202e}",
    "*a",
    "&a ",
    "!!float ",
    "~",
    "(",
    ")",
    "^",
    "e",
];

/// A file with some damage.
fn damaged(seeds: &[Vec<u8>], number: u64) -> Vec<u8> {
    let mut random = Random(number.wrapping_mul(7919).wrapping_add(13));
    let mut out = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(6) {
        let at = random.below(out.len() + 1);
        let end = (at + 1 + random.below(40)).min(out.len());
        match random.below(9) {
            0 if at < out.len() => out[at] ^= 1 << random.below(8),
            1 if at < out.len() => out[at] = random.below(256) as u8,
            2 => drop(out.drain(at..end)),
            3 => {
                let part = out[at..end].to_vec();
                let to = random.below(out.len() + 1);
                drop(out.splice(to..to, part));
            }
            4 => out.truncate(at),
            5 => {
                let part = out[at..end].repeat(1 + random.below(50));
                drop(out.splice(at..at, part));
            }
            6 => {
                let other = &seeds[random.below(seeds.len())];
                let from = random.below(other.len());
                let part = other[from..(from + 200).min(other.len())].to_vec();
                drop(out.splice(at..end, part));
            }
            _ => {
                let word = WORDS[random.below(WORDS.len())].bytes();
                let replaced = if random.below(2) == 0 { at..at } else { at..end };
                drop(out.splice(replaced, word));
            }
        }
    }
    out
}

/// Reads one file; what is wrong with that, if anything.
fn attempt(read: Read, bytes: &[u8]) -> Option<String> {
    let started = Instant::now();
    let panicked = catch_unwind(|| read(bytes)).is_err();
    let took = started.elapsed();
    let word = if panicked { "panicked" } else { "ended" };
    (panicked || took > LONGEST).then(|| format!("{word} after {:.1} s", took.as_secs_f64()))
}

/// Tries files with one target; how many, and what was found.
fn fuzz(target: Target, seconds: Option<u64>) -> (u64, Vec<String>) {
    let (name, read, seeds) = target;
    let seeds = seeds();
    let mut found = Vec::new();
    for (i, bytes) in seeds.iter().chain(&hostile()).enumerate() {
        found.extend(attempt(read, bytes).map(|what| format!("{name}, text {i}: {what}")));
    }
    let end = seconds.map(|s| Instant::now() + Duration::from_secs(s));
    let mut number = 0;
    while end.map_or(number < TRIED, |end| Instant::now() < end) && found.len() < 5 {
        found.extend(attempt(read, &damaged(&seeds, number)).map(|what| format!("{name}, seed {number}: {what}")));
        number += 1;
    }
    (number, found)
}

#[test]
fn damaged_files_give_a_result_or_an_error() {
    let seconds = std::env::var("ALOFT_FUZZ_SECONDS").ok().and_then(|s| s.parse().ok());
    let only = std::env::var("ALOFT_FUZZ_TARGET").ok();
    let mut all = Vec::new();
    let wanted: Vec<Target> = TARGETS.into_iter().filter(|t| only.as_ref().is_none_or(|o| o == t.0)).collect();
    assert!(!wanted.is_empty(), "no target `{}`", only.unwrap_or_default());
    for target in wanted {
        let work = std::thread::Builder::new().stack_size(STACK).spawn(move || fuzz(target, seconds)).unwrap();
        let (tried, found) = work.join().unwrap();
        println!("{}: {tried} damaged files, {} findings", target.0, found.len());
        all.extend(found);
    }
    assert!(all.is_empty(), "{all:#?}");
}
