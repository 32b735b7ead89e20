//! Rules required by real files, one by one, on files patched by hand.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "test code outside a test function")]

mod support;

use aloft_c3d::{ByteOrder, C3dBuilder, C3dFile, Parameter, PointKind, Storage, Values, WarningKind};
use support::{laboratory, many_labels};

fn laboratory_bytes() -> Vec<u8> {
    laboratory(ByteOrder::Intel, Storage::Float).to_bytes().unwrap()
}

/// Byte at which the samples start.
fn samples(bytes: &[u8]) -> usize {
    512 * (usize::from(u16::from_le_bytes([bytes[16], bytes[17]])) - 1)
}

/// Replaces the first occurrence after the first occurrence of `after`.
fn patch(bytes: &mut [u8], after: &[u8], from: &[u8], to: &[u8]) {
    let find = |start: usize, what: &[u8]| start + bytes[start..].windows(what.len()).position(|w| w == what).unwrap();
    let at = find(find(512, after), from);
    bytes[at..at + to.len()].copy_from_slice(to);
}

fn warned(file: &C3dFile, kind: WarningKind, words: &str) -> bool {
    file.warnings.iter().any(|w| w.kind == kind && w.message.contains(words))
}

#[test]
fn regress_fourth_word() {
    for storage in [Storage::Float, Storage::Integer] {
        let made =
            C3dBuilder::new(100.0).stored_as(ByteOrder::Intel, storage, 0.052).marker("A", vec![[5.2, 0.0, -5.2]; 8]);
        let bytes = made.build().unwrap().to_bytes().unwrap();
        let read = |word: f32| {
            let mut bytes = bytes.clone();
            let start = samples(&bytes);
            match storage {
                Storage::Float => bytes[start + 12..start + 16].copy_from_slice(&word.to_le_bytes()),
                Storage::Integer => bytes[start + 6..start + 8].copy_from_slice(&(word as i32 as i16).to_le_bytes()),
            }
            let file = C3dFile::from_bytes(&bytes).unwrap();
            let point = &file.points[0];
            (point.xyz[0][0], point.residual[0], point.cameras[0])
        };
        // low byte times scale; high byte is the camera mask
        let (x, residual, cameras) = read(f32::from(0x7f23_i16));
        assert!((x - 5.2).abs() < 1e-5 && (residual - 1.82).abs() < 1e-5);
        assert_eq!(cameras, 0x7f);
        let (x, residual, cameras) = read(0.0);
        assert!(x > 0.0 && residual == 0.0 && cameras == 0);
        for unseen in [-1.0, 65_535.0, -32_768.0] {
            let (x, residual, cameras) = read(unseen);
            assert!(x.is_nan() && residual.is_nan() && cameras == 0, "{storage:?} {unseen}");
        }
        if storage == Storage::Float {
            assert!(read(f32::NAN).0.is_nan());
            assert!(read(-0.5).0.is_nan());
            // Of values outside 16 bits only the sign is used.
            assert_eq!(read(1.7e38), (5.2, 0.0, 0));
            assert!(read(-1.7e38).0.is_nan());
        }
    }
}

#[test]
fn regress_missing_parameters_fall_back() {
    let whole = C3dFile::from_bytes(&laboratory_bytes()).unwrap();
    let mut bytes = laboratory_bytes();
    patch(&mut bytes, b"POINT", b"\x04\x01RATE", b"\x04\x01RXTE");
    patch(&mut bytes, b"POINT", b"\x05\x01UNITS", b"\x05\x01XNITS");
    patch(&mut bytes, b"EVENT_CONTEXT", b"CONTEXTS", b"XONTEXTS");
    let file = C3dFile::from_bytes(&bytes).unwrap();
    assert_eq!(file.point_rate_hz, 100.0);
    assert_eq!(file.point_unit, "mm");
    assert!(warned(&file, WarningKind::Missing, "POINT:RATE") && warned(&file, WarningKind::Missing, "POINT:UNITS"));
    assert_eq!(file.events.len(), 2);
    assert_eq!(file.events[1].context, "");
    assert_eq!(file.events[1].time_s, whole.events[1].time_s);
}

#[test]
fn regress_contradictions_go_to_what_the_length_holds() {
    let whole = C3dFile::from_bytes(&laboratory_bytes()).unwrap();
    // ANALOG:USED is 0, the header is right.
    let mut bytes = laboratory_bytes();
    let used = [b"\x04\x02USED".as_slice(), &[7, 0]].concat();
    let at = bytes.windows(used.len()).position(|w| w == used).unwrap();
    bytes[at + used.len() + 2..at + used.len() + 4].copy_from_slice(&[0, 0]);
    let file = C3dFile::from_bytes(&bytes).unwrap();
    assert_eq!(file.analogs.len(), 13);
    assert!(warned(&file, WarningKind::Contradiction, "ANALOG:USED is 0"));
    assert_eq!(file.analogs[12].values, whole.analogs[12].values);
    // Header without channels, the parameters are right.
    let mut bytes = laboratory_bytes();
    bytes[4..6].copy_from_slice(&[0, 0]);
    let file = C3dFile::from_bytes(&bytes).unwrap();
    assert_eq!((file.analogs.len(), file.samples_per_frame(), file.n_frames), (13, 3, 24));
    // Header with a wrong last frame.
    let mut bytes = laboratory_bytes();
    bytes[8..10].copy_from_slice(&500_u16.to_le_bytes());
    let file = C3dFile::from_bytes(&bytes).unwrap();
    assert_eq!(file.n_frames, 24);
    assert!(warned(&file, WarningKind::Contradiction, "frames 11 to 500"));
    // Scale in the header rounded differently.
    let mut bytes = laboratory(ByteOrder::Intel, Storage::Integer).to_bytes().unwrap();
    bytes[12..16].copy_from_slice(&0.125_000_1_f32.to_le_bytes());
    let file = C3dFile::from_bytes(&bytes).unwrap();
    assert_eq!(file.points[0].xyz, whole.points[0].xyz);
    assert!(warned(&file, WarningKind::Contradiction, "scale"));
    // The header alone places the samples beyond the end of the file.
    let mut bytes = laboratory_bytes();
    bytes[16..18].copy_from_slice(&[255, 255]);
    let file = C3dFile::from_bytes(&bytes).unwrap();
    assert_eq!(file.points[0].xyz.len(), 24);
    assert!(warned(&file, WarningKind::Contradiction, "samples start"));
}

#[test]
fn regress_lists_longer_than_255() {
    let file = C3dFile::from_bytes(&many_labels().to_bytes().unwrap()).unwrap();
    assert_eq!(file.points.len(), 300);
    assert_eq!(file.points[299].label, "M299");
    assert_eq!(file.groups.get("POINT", "LABELS").unwrap().strings().len(), 255);
    assert_eq!(file.groups.get("POINT", "LABELS2").unwrap().strings().len(), 45);
}

#[test]
fn regress_scalars_in_unusual_types() {
    let mut file = C3dFile::from_bytes(&laboratory_bytes()).unwrap();
    let offsets: Vec<f64> = file.analogs.iter().map(|a| a.offset).collect();
    file.groups.set("FORCE_PLATFORM", Parameter::new("USED", vec![], Values::Bytes(vec![2])));
    file.groups.set("ANALOG", Parameter::floats("OFFSET", offsets.iter().map(|o| *o as f32).collect()));
    file.groups.set("POINT", Parameter::new("USED", vec![1], Values::Floats(vec![6.0])));
    let again = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    assert_eq!(again.warnings, vec![]);
    assert_eq!(again.plates, file.plates);
    assert_eq!(again.analogs[12].values, file.analogs[12].values);
    file.groups
        .set("ANALOG", Parameter::new("OFFSET", vec![13], Values::Bytes(offsets.iter().map(|o| *o as u8).collect())));
    let again = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    assert_eq!(again.analogs[12].values, file.analogs[12].values);
}

#[test]
fn regress_unsigned_offsets_are_inferred() {
    // Float file of raw 16-bit counts, offset 32,768 stored as −32,768, without a statement that
    // they are unsigned.
    let mut bytes = support::unsigned_channels().to_bytes().unwrap();
    let whole = C3dFile::from_bytes(&bytes).unwrap();
    assert!(whole.analog_unsigned);
    patch(&mut bytes, b"ANALOG", b"FORMAT", b"FXRMAT");
    let inferred = C3dFile::from_bytes(&bytes).unwrap();
    assert!(inferred.analog_unsigned);
    assert_eq!(inferred.analogs[0].offset, 32_768.0);
    assert_eq!(inferred.analogs[0].values, whole.analogs[0].values);
    let mut as_floats = inferred.clone();
    as_floats.storage = Storage::Float;
    let floats = C3dFile::from_bytes(&as_floats.to_bytes().unwrap()).unwrap();
    assert_eq!(floats.analogs[0].values, whole.analogs[0].values);
}

#[test]
fn regress_computed_points_are_kept_apart() {
    let file = C3dFile::from_bytes(&laboratory_bytes()).unwrap();
    let kinds: Vec<PointKind> = file.points.iter().map(|p| p.kind).collect();
    assert_eq!(kinds[5], PointKind::Angle);
    assert_eq!(file.points[5].unit, "deg");
    assert_eq!(file.markers().count(), 5);
    // Some software also writes the list without the subject's prefix.
    let mut other = file.clone();
    other.groups.set("POINT", Parameter::texts("ANGLES", &["LKneeAngles"]));
    let again = C3dFile::from_bytes(&other.to_bytes().unwrap()).unwrap();
    assert_eq!(again.points[5].kind, PointKind::Angle);
    assert_eq!(again.groups.get("POINT", "ANGLES").unwrap().strings(), ["LKneeAngles"]);
}

#[test]
fn regress_labels_doubled_and_cut() {
    let path = || vec![[1.0, 2.0, 3.0]; 4];
    let mut builder = C3dBuilder::new(100.0);
    for (label, description) in [("RKNE", "R.Knee"), ("RKNE", "R.Knee.Medial"), ("RANK", "R.Ankle"), ("RTOE", "R.Toe")]
    {
        let point = aloft_c3d::Point {
            label: label.into(),
            description: description.into(),
            xyz: path(),
            ..Default::default()
        };
        builder = builder.point(point);
    }
    let file = C3dFile::from_bytes(&builder.build().unwrap().to_bytes().unwrap()).unwrap();
    assert!(warned(&file, WarningKind::Labels, "more than once: RKNE"));
    assert!(warned(&file, WarningKind::Labels, "DESCRIPTIONS holds the full names"));
    assert_eq!(file.points[1].description, "R.Knee.Medial");
}

#[test]
fn regress_unknown_processor_is_guessed() {
    let mut bytes = laboratory_bytes();
    bytes[512 + 3] = 1;
    let file = C3dFile::from_bytes(&bytes).unwrap();
    assert_eq!(file.byte_order, ByteOrder::Intel);
    assert!(warned(&file, WarningKind::Contradiction, "processor 1"));
}

#[test]
fn validate_every_recording_is_read() {
    let Some(folder) = support::shared_data("") else { return };
    let files = support::c3d_files(&folder);
    let mut failed = Vec::new();
    for path in &files {
        match C3dFile::from_bytes(&std::fs::read(path).unwrap()) {
            Ok(file) => {
                let truncated = file.warnings.iter().any(|w| matches!(w.kind, WarningKind::Truncated { .. }));
                assert!(file.n_frames > 0 && !truncated, "{}", path.display());
            }
            Err(problem) => failed.push(format!("{}: {problem}", path.display())),
        }
    }
    println!("{} of {} read", files.len() - failed.len(), files.len());
    assert!(failed.is_empty(), "{failed:?}");
}

/// A markerless recording: only poses of segments.
fn poses(rate_hz: f64, n: usize) -> aloft_c3d::SegmentPoses {
    let segment = |k: usize| aloft_c3d::SegmentTrack {
        label: format!("segment_{k}_4X4"),
        matrix: (0..n).map(|f| std::array::from_fn(|i| (100 * k + i) as f32 + 0.25 * f as f32)).collect(),
        reliability: (0..n).map(|f| if f == 3 { -1.0 } else { 0.5 }).collect(),
    };
    aloft_c3d::SegmentPoses { rate_hz, segments: (0..3).map(segment).collect() }
}

#[test]
fn poses_of_segments_are_read_as_they_were_written() {
    for order in [ByteOrder::Intel, ByteOrder::Mips, ByteOrder::Dec] {
        let alone = C3dBuilder::new(85.0).stored_as(order, Storage::Float, 1.0).poses(poses(85.0, 340));
        let bytes = alone.build().unwrap().to_bytes().unwrap();
        let file = C3dFile::from_bytes(&bytes).unwrap();
        assert_eq!((file.n_frames, file.points.len(), file.poses.n_frames()), (340, 0, 340));
        assert_eq!(file.poses, poses(85.0, 340), "{order:?}");
        assert!(file.warnings.is_empty(), "{:?}", file.warnings);
        assert_eq!(C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap().poses, file.poses);

        // beside markers, at twice their rate
        let beside = C3dBuilder::new(50.0)
            .stored_as(order, Storage::Float, 1.0)
            .marker("A", vec![[1.0, 2.0, 3.0]; 100])
            .poses(poses(100.0, 200));
        let file = C3dFile::from_bytes(&beside.build().unwrap().to_bytes().unwrap()).unwrap();
        assert_eq!((file.n_frames, file.points[0].xyz[99]), (100, [1.0, 2.0, 3.0]));
        assert_eq!(file.poses, poses(100.0, 200), "{order:?}");

        // cut at any place: the frames that are there
        for cut in [bytes.len() - 600, bytes.len() / 2, bytes.len() / 3] {
            let file = C3dFile::from_bytes(&bytes[..cut]).unwrap();
            let truncated = file.warnings.iter().any(|w| matches!(w.kind, WarningKind::Truncated { stated: 340, .. }));
            assert!(truncated && file.poses.n_frames() < 340, "{:?}", file.warnings);
            let n = file.poses.n_frames();
            assert_eq!(file.poses.segments[2].matrix[..n], poses(85.0, 340).segments[2].matrix[..n]);
        }
    }
}

#[test]
fn poses_that_do_not_fit_are_not_written() {
    let built = C3dBuilder::new(50.0).marker("A", vec![[1.0; 3]; 10]).poses(poses(50.0, 12)).build();
    assert!(built.is_err_and(|e| e.to_string().contains("ROTATION")));
}
