//! Tables and recordings, read back with our own readers (and polars), contain the original
//! markers, forces, angles and events.
#![allow(clippy::unwrap_used, clippy::panic, clippy::expect_used, reason = "tests fail by panicking")]

mod support;

use aloft_body::State;
use aloft_c3d::{ByteOrder, C3dBuilder, C3dFile, Parameter, PointKind, Storage};
use aloft_export::frame::{ground_from_world, to_ground};
use aloft_export::{Convention, FORMATS, Format};
use aloft_trial::{ImportOptions, Table, Trial};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeSet;
use support::{FRAMES, RATE_HZ, bytes, subject, text, trial, written, xml};

#[test]
fn every_format_writes_files_with_places_of_their_own() {
    let s = subject(Convention::Isb);
    let t = trial(&s, &[0, 1, 40]);
    let mut paths = BTreeSet::new();
    for format in FORMATS {
        assert!(format.name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit()), "{}", format.name);
        assert!(!format.title.is_empty() && !format.readers.is_empty());
        let files = written(format.name, &s, &t);
        assert!(!files.is_empty(), "{} writes nothing", format.name);
        for file in files {
            assert!(!file.bytes.is_empty() && !file.what.is_empty(), "{}", file.path);
            assert!(
                !file.path.contains(' ') && !file.path.starts_with('/') && !file.path.contains(".."),
                "{}",
                file.path
            );
            assert!(paths.insert(file.path.clone()), "{} twice", file.path);
            if [".xml", ".osim", ".urdf"].iter().any(|e| file.path.ends_with(e)) {
                xml(std::str::from_utf8(&file.bytes).unwrap());
            }
        }
    }
    assert!(Format::choose(&["TRC".into()]).is_ok());
    let error = Format::choose(&["docx".into()]).unwrap_err().to_string();
    assert!(error.contains("docx") && error.contains("osim"), "{error}");
}

#[test]
fn trc_and_unfiltered_forces_come_back_as_they_went_in() {
    let s = subject(Convention::Model);
    let t = trial(&s, &[]);
    let (trc, mot) = (written("trc", &s, &t), written("forces", &s, &t));
    let options = ImportOptions::default();
    let back = Trial::from_trc_mot(
        "jump01",
        text(&trc, "MarkerData/jump01.trc"),
        Some(text(&mot, "ID/jump01_grf_unfiltered.mot")),
        &options,
    )
    .unwrap();
    assert_eq!(back.markers.labels, t.trial.markers.labels);
    assert_eq!((back.markers.rate_hz, back.markers.n_frames), (RATE_HZ, FRAMES));
    for (a, b) in back.markers.trajectories.iter().flatten().zip(t.trial.markers.trajectories.iter().flatten()) {
        assert!((a - b).norm() < 2e-8 || (a.x.is_nan() && b.x.is_nan()), "{a} {b}");
    }
    assert!(back.markers.trajectories[3][22].x.is_nan());
    for (a, b) in [
        (&back.plates[0].force_n, &t.trial.plates[0].force_n),
        (&back.plates[0].moment_nm, &t.trial.plates[0].moment_nm),
    ] {
        assert_eq!(a.len(), FRAMES);
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).norm() < 2e-3, "{a} {b}");
        }
    }
    let again = Trial::from_trc_mot("jump01", text(&trc, ".trc"), Some(text(&mot, "_grf.mot")), &options).unwrap();
    assert!((again.plates[0].moment_nm[10] - t.trial.plates[0].moment_nm[10]).norm() < 2e-3);
    let loads = xml(text(&mot, "_external_forces.xml"));
    let force = &loads.at("ExternalLoads/objects").children[0];
    assert_eq!(force.child("applied_to_body").text, "foot_l", "the foot over the centre of pressure");
    assert!(text(&mot, "_grf.mot").contains(&format!("{}x", force.child("force_identifier").text)));
    assert_eq!(loads.at("ExternalLoads/datafile").text, "jump01_grf.mot");
}

fn column(table: &Table, name: &str) -> Vec<f64> {
    let at = table.labels.iter().position(|l| l == name).unwrap_or_else(|| panic!("no {name} in {:?}", table.labels));
    table.columns[at].clone()
}

#[test]
fn angles_of_the_mot_give_the_links_back() {
    for convention in [Convention::Model, Convention::Isb] {
        let s = subject(convention);
        let t = trial(&s, &[0, 1, 30]);
        let files = written("mot", &s, &t);
        let table = Table::from_mot("jump01", text(&files, "IK/jump01_ik.mot")).unwrap();
        assert!(table.header.iter().any(|h| h == "inDegrees=yes"));
        assert_eq!(
            table.columns[0].len(),
            FRAMES - 2,
            "unsolved frames at the ends are left out, those inside are NaN"
        );
        assert!((table.columns[0][0] - 0.02).abs() < 1e-9 && column(&table, "pelvis_tx")[28].is_nan());
        let model = &s.subject.model;
        let motion = t.motion.as_ref().unwrap();
        let mut state = State::new(model);
        for f in [2, 29, 59] {
            state.forward_position(model, motion.q(f));
            for joint in s.coordinates.joints.iter().filter(|j| j.sequence.is_some()) {
                let angle = |k: usize| column(&table, &s.coordinates.list[joint.first + k].name)[f - 2].to_radians();
                let turned = joint.sequence.unwrap().matrix(&[angle(0), angle(1), angle(2)]);
                let own = state.rotation(joint.link);
                let ours: Matrix3<f64> = match model.links[joint.link].parent {
                    None => ground_from_world().into_inner() * own,
                    Some(p) => state.rotation(p).transpose() * own,
                };
                assert!((turned - ours).norm() < 1e-7, "{convention:?} {}", model.links[joint.link].name);
            }
            let root = to_ground(&state.world_from_link[0].translation.vector);
            assert!((column(&table, "pelvis_ty")[f - 2] - root.y).abs() < 1e-7);
        }
        let knee = model.links[model.link_index("shank_l").unwrap()].joint.q_offset;
        let angle = column(&table, "knee_angle_l")[8].to_radians();
        assert!((angle + motion.q(10)[knee]).abs() < 1e-8, "flexion is positive");
        let errors = text(&files, "IK/jump01_marker_errors.csv");
        assert!(errors.starts_with("time [s],rms [m],max [m],M0A [m]") && errors.lines().count() == FRAMES + 1);
        let setup = xml(text(&files, "IK/jump01_ik_setup.xml"));
        assert_eq!(setup.at("InverseKinematicsTool/marker_file").text, "../MarkerData/jump01.trc");
        assert_eq!(setup.at("InverseKinematicsTool/IKTaskSet/objects").children[1].child("weight").text, "2");
    }
}

#[test]
fn rates_are_derivatives_and_forces_do_the_same_work() {
    for convention in [Convention::Model, Convention::Isb] {
        let s = subject(convention);
        let t = trial(&s, &[]);
        let series = t.smooth.as_ref().unwrap();
        let n = series.n;
        let dt = 1.0 / RATE_HZ;
        for f in 2..FRAMES - 2 {
            for k in 0..n {
                let x = |g: usize| series.values[g * n + k];
                let joint = &s.coordinates.joints[s.coordinates.list[k].link];
                let own = [0, 1, 2].map(|i| series.values.get(f * n + joint.first + i).copied().unwrap_or(0.0));
                if joint.sequence.is_some_and(|q| q.regularity(&own) < 0.4) {
                    continue;
                }
                let d = (x(f - 2) - 8.0 * x(f - 1) + 8.0 * x(f + 1) - x(f + 2)) / (12.0 * dt);
                let name = &s.coordinates.list[k].name;
                assert!((d - series.rates[f * n + k]).abs() < 5e-3, "{convention:?} {name} {f}");
                let dd = (-x(f - 2) + 16.0 * x(f - 1) - 30.0 * x(f) + 16.0 * x(f + 1) - x(f + 2)) / (12.0 * dt * dt);
                assert!((dd - series.accelerations[f * n + k]).abs() < 0.5, "{convention:?} {name} {f}");
            }
        }
        // the power of the generalised forces equals that of joint torques and plates, for any
        // coordinates
        let forces = t.forces.as_ref().unwrap();
        let motion = t.filtered.as_ref().unwrap();
        let model = &s.subject.model;
        let mut state = State::new(model);
        let mut tau = vec![0.0; model.nv];
        for f in [5, 20, 45] {
            state.forward_acceleration(model, motion.q(f), motion.v(f), motion.a(f));
            state.inverse_dynamics(model, &s.phi(), &mut tau);
            let mut power: f64 = tau.iter().zip(motion.v(f)).map(|(a, b)| a * b).sum();
            let foot = model.link_index("foot_l").unwrap();
            let w = &t.plates[0].wrench[f];
            let (force, moment) = (Vector3::new(w[0], w[1], w[2]), Vector3::new(w[3], w[4], w[5]));
            let spin = state.rotation(foot)
                * Vector3::new(state.velocity[foot][3], state.velocity[foot][4], state.velocity[foot][5]);
            let origin = state.world_from_link[foot].translation.vector;
            let at_world_origin = state.point_velocity_in_world(foot, &Vector3::zeros()) - spin.cross(&origin);
            power -= force.dot(&at_world_origin) + moment.dot(&spin);
            let ours: f64 = (0..n).map(|k| forces.generalised[f * n + k] * series.rates[f * n + k]).sum();
            assert!((power - ours).abs() < 1e-7 * (1.0 + power.abs()), "{power} {ours}");
        }
        let sto = Table::from_mot("t", text(&written("sto", &s, &t), "ID/jump01_id.sto")).unwrap();
        assert_eq!(sto.labels[1], "pelvis_tilt_moment");
        assert!(
            (column(&sto, "pelvis_ty_force")[5]
                - to_ground(&Vector3::new(forces.residual[5][0], forces.residual[5][1], forces.residual[5][2])).y)
                .abs()
                < 1e-6
        );
    }
}

#[test]
fn an_old_c3d_keeps_what_it_had_and_gains_what_was_learnt() {
    let s = subject(Convention::Model);
    for (storage, order) in [(Storage::Float, ByteOrder::Intel), (Storage::Integer, ByteOrder::Mips)] {
        let mut t = trial(&s, &[0]);
        let mut builder = C3dBuilder::new(RATE_HZ).first_frame(11).stored_as(order, storage, 0.1);
        builder = builder.marker("*7", vec![[1.0; 3]; FRAMES]);
        for (label, path) in t.trial.markers.labels.iter().zip(&t.trial.markers.trajectories) {
            let points =
                path.iter().map(|p| if p.x.is_nan() { [f32::NAN; 3] } else { [0, 1, 2].map(|k| (p[k] * 1e3) as f32) });
            builder = builder.marker_with_residual(&format!("Subj:{label}"), points.collect(), vec![0.8; FRAMES]);
        }
        builder = builder
            .computed("RShoulderAngles", PointKind::Angle, "deg", vec![[1.0, 2.0, 3.0]; FRAMES])
            .analog("EMG", "V", (0..FRAMES * 2).map(|i| f64::from(i as i32 % 7)).collect())
            .event("Foot Off", "Left", 0.3)
            .parameter("PROCESSING", Parameter::float("Mass", 61.5));
        let source = builder.build().unwrap().to_bytes().unwrap();
        let old = C3dFile::from_bytes(&source).unwrap();
        // the same recording after an import
        t.trial =
            Trial { name: t.name.clone(), ..Trial::from_c3d("jump01", &source, &ImportOptions::default()).unwrap() };
        t.trial.markers.trajectories[3][22] = Vector3::new(0.5, 0.25, 1.0);
        t.source = aloft_export::SourceFile { name: "jump01.c3d".into(), c3d: Some(source) };
        let files = written("c3d", &s, &t);
        let new = C3dFile::from_bytes(bytes(&files, "C3D/jump01.c3d")).unwrap();
        assert!(new.warnings.is_empty(), "{:?}", new.warnings);
        assert_eq!((new.n_frames, new.first_frame, new.point_rate_hz), (FRAMES, 11, RATE_HZ));
        for (i, (a, b)) in old.points.iter().zip(&new.points).enumerate() {
            assert_eq!((&a.label, a.kind), (&b.label, b.kind));
            for f in 0..FRAMES {
                let gap = i == 4 && f == 22;
                let same = a.xyz[f].map(f32::to_bits) == b.xyz[f].map(f32::to_bits)
                    && a.residual[f].to_bits() == b.residual[f].to_bits();
                assert!(same != gap || (a.xyz[f][0].is_nan() && b.xyz[f][0].is_nan()), "{} {f}", a.label);
            }
        }
        assert_eq!((new.points[4].xyz[22], new.points[4].residual[22]), ([500.0, 250.0, 1000.0], 0.0));
        for (a, b) in old.analogs.iter().zip(&new.analogs) {
            assert_eq!((&a.label, &a.unit, &a.values), (&b.label, &b.unit, &b.values));
        }
        assert_eq!(new.groups.get("PROCESSING", "Mass").unwrap().number(), Some(61.5));
        assert_eq!(new.groups.get("ALOFT", "PROGRAM").unwrap().string().as_deref(), Some("aloft test"));
        // joint centres, centre of mass, angles, events
        let motion = t.motion.as_ref().unwrap();
        let mut state = State::new(&s.subject.model);
        state.forward_position(&s.subject.model, motion.q(7));
        let hip = &new.points[new.point_index("LHJC").unwrap()];
        let thigh = s.subject.model.link_index("thigh_l").unwrap();
        for k in 0..3 {
            assert!((f64::from(hip.xyz[7][k]) - state.world_from_link[thigh].translation.vector[k] * 1e3).abs() < 1e-3);
        }
        assert!(hip.xyz[0][0].is_nan(), "missing stays missing");
        assert!(new.point_index("COM").is_some());
        let angles = &new.points[new.point_index("RShoulderAngles_aloft").unwrap()];
        assert_eq!(angles.kind, PointKind::Angle);
        let series = t.solved.as_ref().unwrap();
        let first = s.coordinates.list.iter().position(|c| c.name == "arm_flex_r").unwrap();
        for k in 0..3 {
            assert!((f64::from(angles.xyz[9][k]) - series.values[9 * series.n + first + k].to_degrees()).abs() < 1e-4);
        }
        let events: Vec<(&str, f64)> = new.events.iter().map(|e| (e.label.as_str(), e.time_s)).collect();
        assert_eq!(events.len(), 3);
        assert_eq!(events[0].0, "Foot Off");
        assert!(
            events[1].0 == "Flight Start" && (events[1].1 - 0.35).abs() < 1e-6,
            "frame 1 of the original trial is 0 s"
        );
        assert!(events[2].0 == "Flight End" && (events[2].1 - 0.60).abs() < 1e-6);
    }
}

#[test]
fn a_recording_that_was_no_c3d_becomes_one() {
    let s = subject(Convention::Model);
    let t = trial(&s, &[]);
    let files = written("c3d", &s, &t);
    let back = Trial::from_c3d("jump01", bytes(&files, ".c3d"), &ImportOptions::default()).unwrap();
    let ours = &t.trial.markers;
    let at = back.markers.index("M4A").unwrap();
    assert!((back.markers.trajectories[at][5] - ours.trajectories[ours.index("M4A").unwrap()][5]).norm() < 1e-6);
    assert_eq!(back.markers.first_frame, 11);
    assert!(back.computed.iter().any(|c| c.label == "GroundReactionForce1" && (c.values[3].z - 400.0).abs() < 1e-3));
    assert!(back.events.iter().any(|e| e.label == "Foot Off" && (e.time_s - 0.25).abs() < 1e-6));
    assert!(back.events.iter().any(|e| e.label == "Flight Start" && (e.time_s - 0.25).abs() < 1e-6));
}

#[test]
fn parquet_and_csv_hold_the_same_series() {
    let s = subject(Convention::Model);
    let t = trial(&s, &[0]);
    let parquet = written("parquet", &s, &t);
    let frame = aloft_export::parquet::read(bytes(&parquet, ".parquet").to_vec()).unwrap();
    let names: Vec<&str> = frame.columns().iter().map(|c| c.name().as_str()).collect();
    assert_eq!(
        names,
        ["subject", "trial", "frame", "time_s", "in_flight", "quantity", "name", "axis", "unit", "value"]
    );
    let csv = written("csv", &s, &t);
    let mut lines = text(&csv, ".csv").lines();
    let headings: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<&str>> = lines.map(|l| l.split(',').collect()).collect();
    assert_eq!((headings[0], headings[1], headings[2]), ("frame", "time [s]", "in_flight"));
    assert_eq!(rows.len(), FRAMES);
    assert_eq!(frame.height(), FRAMES * (headings.len() - 3));
    assert_eq!((rows[24][2], rows[25][2], rows[49][2], rows[50][2]), ("0", "1", "1", "0"));
    let text_of = |name: &str| frame.column(name).unwrap().str().unwrap().clone();
    let (quantity, name, axis, unit) = (text_of("quantity"), text_of("name"), text_of("axis"), text_of("unit"));
    let value = frame.column("value").unwrap().f64().unwrap().clone();
    for (c, heading) in headings.iter().enumerate().skip(3) {
        let at = (c - 3) * FRAMES;
        let words = [quantity.get(at), name.get(at), axis.get(at)];
        let words: Vec<&str> = words.into_iter().flatten().filter(|w| !w.is_empty()).collect();
        assert_eq!(*heading, format!("{} [{}]", words.join(" "), unit.get(at).unwrap()));
        for (f, row) in rows.iter().enumerate() {
            let long = value.get(at + f).unwrap();
            match row[c].parse::<f64>() {
                Ok(wide) => assert!((wide - long).abs() < 1e-6, "{heading} {f}"),
                Err(_) => assert!(row[c].is_empty() && long.is_nan(), "{heading} {f}: {}", row[c]),
            }
        }
    }
    assert!(headings.contains(&"marker M0A x [m]") && headings.contains(&"coordinate hip_flexion_l [deg]"));
}

#[test]
fn bids_tables_and_their_descriptions_agree() {
    let s = subject(Convention::Isb);
    let t = trial(&s, &[]);
    let files = written("bids", &s, &t);
    let base = "BIDS/sub-P01/motion/sub-P01_task-jump_tracksys-optical_run-01_desc-aloft";
    let motion: Vec<Vec<&str>> =
        text(&files, &format!("{base}_motion.tsv")).lines().map(|l| l.split('\t').collect()).collect();
    let channels: Vec<Vec<&str>> =
        text(&files, &format!("{base}_channels.tsv")).lines().map(|l| l.split('\t').collect()).collect();
    assert_eq!(channels[0], ["name", "component", "type", "tracked_point", "units", "reference_frame"]);
    assert_eq!(motion.len(), FRAMES);
    assert!(motion.iter().all(|row| row.len() == channels.len() - 1));
    let marker = channels.iter().position(|c| c[0] == "marker_M1B_x").unwrap();
    assert_eq!(motion[22][marker - 1], "n/a", "missing is n/a");
    let names: BTreeSet<&str> = channels[1..].iter().map(|c| c[0]).collect();
    assert_eq!(names.len(), channels.len() - 1, "names are unique");
    let types = ["POS", "ORNT", "JNTANG", "MISC"];
    let about: serde_json::Value = serde_json::from_str(text(&files, &format!("{base}_motion.json"))).unwrap();
    assert_eq!(about["SamplingFrequency"], 100.0);
    assert_eq!(about["TaskName"], "jump");
    for kind in types {
        let n = channels[1..].iter().filter(|c| c[2] == kind).count();
        assert!(n > 0);
        assert_eq!(about[format!("{kind}ChannelCount")], n);
    }
    let events = text(&files, &format!("{base}_events.tsv"));
    assert!(events.contains("0.25\t0.25\tflight") && events.contains("Left Foot Off"), "{events}");
    assert!(text(&files, "participants.tsv").contains("sub-P01\tF\t1.6\t36.4"));
    serde_json::from_str::<serde_json::Value>(text(&files, "dataset_description.json")).unwrap();
}

#[test]
fn recordings_of_any_names_share_no_file() {
    let s = subject(Convention::Isb);
    let mut t = trial(&s, &[]);
    let pieces = [
        "a", "A_", "1", "_1", "01", " ", "_", ".", "-", "z", "Z", "'", "/", "\\", "con", "ü", "a_ik", "a_grf", "\n",
        "%20",
    ];
    let pairs = pieces.iter().flat_map(|a| pieces.iter().map(move |b| format!("{a}{b}")));
    let names: BTreeSet<String> = pieces.iter().map(|p| (*p).to_owned()).chain(pairs).collect();
    let mut seen: std::collections::BTreeMap<String, String> = std::collections::BTreeMap::new();
    // formats that name files in different ways
    for name in &names {
        t.name.clone_from(name);
        for format in ["trc", "forces", "bids"] {
            let write = Format::choose(&[format.to_owned()]).unwrap()[0].trial.unwrap();
            for file in write(&s, &t).unwrap() {
                assert!(!file.path.contains([' ', '\\', ':', '*', '?', '"', '<', '>', '|', '\n']), "{}", file.path);
                assert!(
                    file.path.split('/').all(|part| !part.is_empty() && part != "." && part != ".."),
                    "{}",
                    file.path
                );
                if let Some(other) = seen.insert(file.path.to_lowercase(), name.clone()) {
                    assert_eq!(other.to_lowercase(), name.to_lowercase(), "{}", file.path);
                }
            }
        }
    }
    // two subjects of a study whose names differ by characters that BIDS drops
    let mut of = |subject: &str, session: Option<&str>| {
        let mut s = s.clone();
        s.of_study = [Some(subject.to_owned()), session.map(str::to_owned)];
        t.name = "jump01".to_owned();
        let files = Format::choose(&["bids".to_owned()]).unwrap()[0].trial.unwrap()(&s, &t).unwrap();
        files[0].path.clone()
    };
    assert_eq!(of("sub-01", None), "BIDS/sub-01/motion/sub-01_task-jump_tracksys-optical_run-01_desc-aloft_motion.tsv");
    assert!(of("sub-01", Some("ses-1")).starts_with("BIDS/sub-01/ses-1/motion/sub-01_ses-1_task-jump_"));
    assert_ne!(of("s_1", None), of("s1", None));
    assert_ne!(of("s1", Some("a_b")), of("s1", Some("a.b")));
}

/// How a format is read again.
enum Again {
    /// As a recording, in metres.
    Recording(Box<Trial>),
    /// As a model of this mass, kg.
    Model(f64),
    /// It holds results, which are no input.
    Results,
}

fn again(format: &str, files: &[aloft_export::OutFile]) -> Again {
    let options = ImportOptions::default();
    let bytes_of = |end: &str| files.iter().find(|f| f.path.ends_with(end)).map(|f| f.bytes.as_slice());
    let mass = |spec: &aloft_body::ModelSpec| spec.inertias().unwrap().iter().map(|i| i.mass_kg).sum();
    match format {
        "trc" => Again::Recording(Box::new(Trial::from_trc_mot("t", text(files, ".trc"), None, &options).unwrap())),
        "c3d" => Again::Recording(Box::new(Trial::from_c3d("t", bytes_of(".c3d").unwrap(), &options).unwrap())),
        "bids" => {
            let about: serde_json::Value = serde_json::from_str(text(files, "_motion.json")).unwrap();
            let source = aloft_trial::BidsMotion {
                motion: text(files, "_motion.tsv"),
                channels: text(files, "_channels.tsv"),
                rate_hz: about["SamplingFrequency"].as_f64(),
                duration_s: about["RecordingDuration"].as_f64(),
                spatial_axes: None,
            };
            Again::Recording(Box::new(Trial::from_bids_motion("t", &source, &options).unwrap()))
        }
        "forces" => {
            // read beside markers: see `trc_and_unfiltered_forces_come_back_as_they_went_in`
            let forces = Trial::contents_of_mot("t", text(files, "_grf.mot"), &options).unwrap();
            assert!(!forces.plates.is_empty());
            Again::Results
        }
        "urdf" => Again::Model(mass(&aloft_body::ModelSpec::from_urdf(text(files, ".urdf")).unwrap())),
        "mjcf" => {
            // our reader is for robots, whose logs have no ball joints: it says so
            let problem = aloft_robot::RobotModel::parse("m.xml", text(files, "Models/P_01.xml")).unwrap_err();
            assert!(problem.to_string().contains("ball"), "{problem}");
            Again::Results
        }
        "osim" => {
            // a pipeline takes models of people, which have no slides: it says so
            let model = aloft_robot::osim::OsimModel::parse("m.osim", text(files, "Models/P_01.osim")).unwrap();
            let problem = aloft_robot::osim::RigidTree::of(&model, None).unwrap_err();
            assert!(problem.to_string().contains("slides without turning"), "{problem}");
            Again::Results
        }
        "mot" | "sto" | "parquet" | "csv" => Again::Results,
        other => panic!("say here how an export in the format `{other}` is read again, or that it is not"),
    }
}

#[test]
fn regress_every_format_that_is_written_and_read_comes_back() {
    let s = subject(Convention::Model);
    let t = trial(&s, &[]);
    for format in FORMATS {
        match again(format.name, &written(format.name, &s, &t)) {
            Again::Recording(back) => {
                assert_eq!((back.markers.rate_hz, back.markers.n_frames), (RATE_HZ, FRAMES), "{}", format.name);
                assert_eq!(back.warnings, [], "{}", format.name);
                for (label, path) in t.trial.markers.labels.iter().zip(&t.trial.markers.trajectories) {
                    let i = back.markers.index(label).unwrap_or_else(|| panic!("{}: {label}", format.name));
                    for (a, b) in back.markers.trajectories[i].iter().zip(path) {
                        assert!((a - b).norm() < 1e-6 || (a.x.is_nan() && b.x.is_nan()), "{}: {a} {b}", format.name);
                    }
                }
            }
            Again::Model(mass_kg) => {
                let exported: f64 = s.links.iter().map(|l| l.mass_kg).sum();
                assert!((mass_kg / exported - 1.0).abs() < 1e-6, "{}: {mass_kg} {exported}", format.name);
            }
            Again::Results => {}
        }
    }
}
