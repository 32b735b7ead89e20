//! The demonstration as a BIDS-Motion dataset gives the same results as from C3D.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_c3d::C3dFile;
use aloft_pipeline::runner::{Selection, Silent, run_all};
use aloft_study::data_set::DataSet;
use aloft_study::subject_session::Overrides;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The markers of a C3D file, written out as BIDS-Motion.
fn as_bids(c3d: &Path, folder: &Path, name: &str) {
    let file = C3dFile::from_bytes(&fs::read(c3d).unwrap()).unwrap();
    let mut channels = "name\tcomponent\ttype\ttracked_point\tunits\n".to_owned();
    for m in file.markers() {
        for axis in ["x", "y", "z"] {
            channels += &format!("{}_{axis}\t{axis}\tPOS\t{}\tmm\n", m.label, m.label);
        }
    }
    let mut motion = String::new();
    for f in 0..file.n_frames {
        let cells: Vec<String> = file
            .markers()
            .flat_map(|m| m.xyz[f])
            .map(|x| if x.is_nan() { "n/a".to_owned() } else { f64::from(x).to_string() })
            .collect();
        motion += &(cells.join("\t") + "\n");
    }
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join(format!("{name}_motion.tsv")), motion).unwrap();
    fs::write(folder.join(format!("{name}_channels.tsv")), channels).unwrap();
    let frame = r#"{"reference_frame": {"Levels": {"global": {"SpatialAxes": "ALS"}}}}"#;
    fs::write(folder.join(format!("{name}_channels.json")), frame).unwrap();
    let meta = format!("{{\"SamplingFrequency\": {}, \"TaskName\": \"throw\"}}", file.point_rate_hz);
    fs::write(folder.join(format!("{name}_motion.json")), meta).unwrap();
}

fn base(workspace: &Path) -> Vec<(String, f64)> {
    let text = fs::read_to_string(workspace.join("identify/_study/parameters_weak.json")).unwrap();
    let all: serde_json::Value = serde_json::from_str(&text).unwrap();
    let base = all["base"].as_array().unwrap();
    base.iter().map(|b| (b["name"].as_str().unwrap().to_owned(), b["value"].as_f64().unwrap())).collect()
}

#[test]
fn a_bids_dataset_gives_what_its_c3d_files_give() {
    let dir = tempfile::tempdir().unwrap();
    let demo = root().join("fixtures/demo");
    let data = dir.path().join("dataset");
    let motion = data.join("sub-01/ses-01/motion");
    for (stem, task) in [
        ("static", "static"),
        ("hinge_calib", "calib"),
        ("throws_01", "throw_run-01"),
        ("throws_02", "throw_run-02"),
        ("throws_03", "throw_run-03"),
    ] {
        let name = format!("sub-01_ses-01_task-{task}_tracksys-mocap");
        as_bids(&demo.join(format!("{stem}.c3d")), &motion, &name);
    }
    fs::write(data.join("participants.tsv"), "participant_id\tmass\nsub-01\t0.997\n").unwrap();
    // results of other programs inside the dataset are not recordings
    as_bids(&demo.join("static.c3d"), &data.join("derivatives/other/sub-01"), "sub-01_task-static_desc-clean");
    let bids = dir.path().join("bids.yaml");
    let text = "name: bids\nmodel: two_link\nmarker_set: two-link-chain\nobject: two_link_chain\n\
        subject: {gravity_mps2: 9.80665}\n\
        trials:\n  static: [\"**/*task-static*\"]\n  calibration: [\"**/*task-calib*\"]\n  identify: [\"**/*task-throw*\"]\n  validate: []\n";
    fs::write(&bids, text).unwrap();
    let c3d = dir.path().join("c3d.yaml");
    let same = text
        .replace("**/*task-static*", "static.c3d")
        .replace("**/*task-calib*", "hinge_calib.c3d")
        .replace("**/*task-throw*", "throws_*.c3d")
        .replace("subject: {", "subject: {mass_kg: 0.997, ");
    fs::write(&c3d, same).unwrap();
    let run = |pipeline: &Path, data: &Path, ws: &Path| {
        let overrides =
            Overrides { data: Some(data.to_path_buf()), workspace: Some(ws.to_path_buf()), ..Overrides::default() };
        let set = DataSet::open(pipeline, &overrides).unwrap();
        let done = run_all(&set, &Selection::default(), &Silent).unwrap();
        assert!(!done.has_trouble(), "{:#?}", done.runs);
        set
    };
    let ws = dir.path().join("ws");
    let set = run(&bids, &data, &ws);
    assert_eq!(set.members.len(), 1);
    assert_eq!(set.members[0].id.to_string(), "sub-01 ses-01");
    assert_eq!(set.members[0].trials.len(), 5);
    let other = dir.path().join("ws_c3d");
    run(&c3d, &demo, &other);
    for ((name, a), (_, b)) in base(&ws.join("sub-01/ses-01")).iter().zip(base(&other)) {
        assert!((a - b).abs() < 1e-9 * b.abs().max(1e-3), "{name}: {a} from BIDS, {b} from C3D");
    }
    // a recording with another channel table counts as another recording
    let channels = motion.join("sub-01_ses-01_task-throw_run-02_tracksys-mocap_channels.tsv");
    let text = fs::read_to_string(&channels).unwrap();
    fs::write(&channels, text.replace("\tmm\n", "\tmm \n")).unwrap();
    let status = aloft_analysis::standing::status(&set.members[0]).unwrap();
    let stale: Vec<&str> = status.rows.iter().filter(|r| r.cells[0] == "stale").map(|r| r.trial.as_str()).collect();
    assert_eq!(stale, ["sub-01_ses-01_task-throw_run-02_tracksys-mocap"]);
}
