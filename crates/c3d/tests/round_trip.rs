//! Written files are read back unchanged, and rewriting changes nothing.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "test code outside a test function")]

mod support;

use aloft_c3d::{C3dBuilder, C3dFile, Parameter, Values};
use support::{c3d_files, fixtures, golden_folder, long_file, shared_data};

/// Sizes and rates are written as they were read, which corrects or completes some files.
const CORRECTED: [(&str, &str); 3] = [("POINT", "USED"), ("POINT", "FRAMES"), ("POINT", "RATE")];

/// Everything visible to a reader, as text, so that NaN compares equal.
fn seen(file: &C3dFile) -> String {
    let mut file = file.clone();
    file.warnings.clear();
    // The position of the samples may change.
    file.groups.remove("POINT", "DATA_START");
    file.groups.remove("ROTATION", "DATA_START");
    // Values that contradicted the samples are corrected.
    for (group, name) in CORRECTED {
        file.groups.remove(group, name);
    }
    // Samples are compared as numbers.
    for point in &mut file.points {
        (point.xyz, point.residual, point.cameras) = Default::default();
    }
    file.analogs.iter_mut().for_each(|a| a.values.clear());
    let text = format!("{file:?}");
    text.split(", source: ").next().unwrap_or_default().to_owned()
}

/// Whether all samples are equal; NaN equal NaN.
fn same_samples(a: &C3dFile, b: &C3dFile) -> bool {
    let same = |a: f32, b: f32| a == b || (a.is_nan() && b.is_nan());
    let points = a.points.iter().zip(&b.points).all(|(a, b)| {
        a.xyz.len() == b.xyz.len()
            && a.xyz.as_flattened().iter().zip(b.xyz.as_flattened()).all(|(a, b)| same(*a, *b))
            && a.residual.iter().zip(&b.residual).all(|(a, b)| same(*a, *b))
            && a.cameras == b.cameras
    });
    let analogs = a.analogs.iter().zip(&b.analogs).all(|(a, b)| {
        a.values.len() == b.values.len()
            && a.values.iter().zip(&b.values).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
    });
    points && analogs
}

fn assert_rewrites(name: &str, bytes: &[u8]) -> C3dFile {
    let first = C3dFile::from_bytes(bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
    let written = first.to_bytes().unwrap_or_else(|e| panic!("{name}: {e}"));
    let second = C3dFile::from_bytes(&written).unwrap_or_else(|e| panic!("{name}, re-written: {e}"));
    assert!(seen(&first) == seen(&second), "{name}: a re-write changes what is read");
    assert!(same_samples(&first, &second), "{name}: a re-write changes samples");
    assert!(second.to_bytes().unwrap() == written, "{name}: a second re-write changes bytes");
    first
}

#[test]
fn fixtures_survive() {
    for (name, file) in fixtures() {
        let bytes = file.to_bytes().unwrap();
        let read = assert_rewrites(name, &bytes);
        assert_eq!(read.warnings, vec![], "{name}");
        assert_eq!(read.n_frames, file.n_frames, "{name}");
        assert_eq!(read.first_frame, file.first_frame, "{name}");
        assert_eq!(read.events, file.events, "{name}");
        assert_eq!(read.header_events, file.header_events, "{name}");
        assert_eq!(read.plates, file.plates, "{name}");
        assert_eq!(format!("{:?}", read.points), format!("{:?}", file.points), "{name}");
        assert_eq!(read.analogs.len(), file.analogs.len(), "{name}");
        for (a, b) in read.analogs.iter().zip(&file.analogs) {
            assert_eq!((&a.label, &a.unit, &a.description), (&b.label, &b.unit, &b.description), "{name}");
            assert_eq!((a.scale, a.offset), (b.scale, b.offset), "{name}: {}", a.label);
            if name != "from_wrench" {
                assert_eq!(a.values, b.values, "{name}: {}", a.label);
            }
        }
    }
}

#[test]
fn regress_fixtures_are_what_the_builder_makes() {
    let update = std::env::var_os("ALOFT_UPDATE_GOLDEN").is_some();
    for (name, file) in fixtures() {
        let bytes = file.to_bytes().unwrap();
        // The same files are the seeds for fuzzing.
        for folder in [golden_folder(), golden_folder().join("../../fuzz/seeds")] {
            let path = folder.join(format!("{name}.c3d"));
            if update {
                std::fs::write(&path, &bytes).unwrap();
            }
            assert!(std::fs::read(&path).unwrap() == bytes, "{name}.c3d differs: ALOFT_UPDATE_GOLDEN=1 writes it anew");
        }
    }
}

#[test]
fn regress_more_frames_than_the_header_counts() {
    let file = long_file();
    let bytes = file.to_bytes().unwrap();
    let read = assert_rewrites("long", &bytes);
    assert_eq!(read.n_frames, 70_000);
    assert_eq!(read.points[0].xyz, file.points[0].xyz);
    assert_eq!(read.warnings, vec![]);
    // Only the header has overflowed: the parameters are right.
    let mut wrapped = bytes.clone();
    wrapped[8..10].copy_from_slice(&(70_000_u32 as u16).to_le_bytes());
    assert_eq!(C3dFile::from_bytes(&wrapped).unwrap().n_frames, 70_000);
}

#[test]
fn regress_a_file_late_in_a_long_trial() {
    let file = C3dBuilder::new(100.0).first_frame(80_001).marker("A", vec![[1.0, 2.0, 3.0]; 50]).build().unwrap();
    let read = assert_rewrites("late", &file.to_bytes().unwrap());
    assert_eq!((read.first_frame, read.n_frames), (80_001, 50));
}

#[test]
fn recordings_survive() {
    let Some(folder) = shared_data("") else { return };
    for path in c3d_files(&folder) {
        let bytes = std::fs::read(&path).unwrap();
        let read = C3dFile::from_bytes(&bytes).unwrap();
        if !read.poses.segments.is_empty() {
            let again = C3dFile::from_bytes(&read.to_bytes().unwrap()).unwrap();
            assert_eq!(again.n_frames, read.n_frames);
            let bits = |f: &C3dFile| -> Vec<u32> {
                let all = f.poses.segments.iter().flat_map(|s| s.matrix.iter().flatten().chain(&s.reliability));
                all.map(|x| x.to_bits()).collect()
            };
            assert!(bits(&again) == bits(&read) && again.poses.rate_hz == read.poses.rate_hz, "{}", path.display());
            println!("{}: {} segments, {} frames of poses", path.display(), read.poses.segments.len(), read.n_frames);
        }
        let first = assert_rewrites(&path.display().to_string(), &bytes);
        // Samples bit by bit, at any position in the second file.
        let written = first.to_bytes().unwrap();
        let place = |b: &[u8]| 512 * (usize::from(first.byte_order.u16([b[16], b[17]])) - 1);
        let words = 4 * first.points.len() + first.analogs.len() * first.samples_per_frame();
        let size = words * first.storage.word_bytes() * first.n_frames;
        let (old, new) = (place(&bytes), place(&written));
        assert!(bytes[old..old + size] == written[new..new + size], "{}: samples changed", path.display());
    }
}

#[test]
fn regress_changes_are_written_and_the_rest_is_kept() {
    let mut file = support::laboratory(Default::default(), Default::default());
    file = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    file.points[1].xyz[3] = [1.0, 2.0, 3.0];
    file.points[1].residual[3] = 0.25;
    file.points[2].label = "NEW".into();
    file.analogs[12].values[5] = 7.0;
    file.events.pop();
    file.groups.set("PROCESSING", Parameter::new("BYTES", vec![3], Values::Bytes(vec![1, 2, 3])));
    let read = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    assert!(seen(&read).contains("NEW"));
    assert_eq!(read.points[1].xyz[3], [1.0, 2.0, 3.0]);
    assert_eq!(read.points[1].residual[3], 0.25);
    assert_eq!(read.analogs[12].values[5], 7.0);
    assert_eq!(read.events.len(), 1);
    assert_eq!(read.groups.get("PROCESSING", "BodyMass").unwrap().number(), Some(61.5));
    assert_eq!(read.groups.get("PROCESSING", "TABLE").unwrap().numbers(), [1.0, -2.0, 3.0, -4.0, 5.0, -6.0]);
    assert_eq!(read.groups.get("processing", "bytes").unwrap().numbers(), [1.0, 2.0, 3.0]);
    // Fewer frames and points: the source no longer matches and everything is encoded anew.
    file.n_frames = 20;
    file.points.pop();
    for point in &mut file.points {
        point.xyz.truncate(20);
        point.residual.truncate(20);
        point.cameras.truncate(20);
    }
    file.analogs.iter_mut().for_each(|a| a.values.truncate(60));
    let cut = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    assert_eq!((cut.n_frames, cut.points.len()), (20, 5));
    assert_eq!(format!("{:?}", cut.points), format!("{:?}", file.points));
}

#[test]
fn any_order_and_storage_into_any_other() {
    use aloft_c3d::{ByteOrder::*, Storage::*};
    let reference = support::laboratory(Intel, Float);
    for from in [(Intel, Float), (Dec, Integer), (Mips, Float), (Dec, Float)] {
        for to in [(Intel, Float), (Dec, Float), (Mips, Integer), (Intel, Integer)] {
            let bytes = support::laboratory(from.0, from.1).to_bytes().unwrap();
            let mut file = C3dFile::from_bytes(&bytes).unwrap();
            (file.byte_order, file.storage) = to;
            let read = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
            assert_eq!((read.byte_order, read.storage), to);
            assert_eq!(format!("{:?}", read.points), format!("{:?}", reference.points), "{from:?} to {to:?}");
            assert_eq!(format!("{:?}", read.analogs), format!("{:?}", reference.analogs), "{from:?} to {to:?}");
            assert_eq!(format!("{:?}", read.plates), format!("{:?}", reference.plates), "{from:?} to {to:?}");
        }
    }
}

#[test]
fn regress_what_does_not_fit_is_refused() {
    use aloft_c3d::{ByteOrder, C3dError, Storage};
    let far =
        C3dBuilder::new(100.0).stored_as(ByteOrder::Intel, Storage::Integer, 0.01).marker("A", vec![[1e4, 0.0, 0.0]]);
    assert!(matches!(far.build().unwrap().to_bytes(), Err(C3dError::Write { item, .. }) if item.contains("point A")));
    let uneven = C3dBuilder::new(100.0).marker("A", vec![[0.0; 3]; 3]).marker("B", vec![[0.0; 3]; 2]).build();
    assert!(matches!(uneven, Err(C3dError::Write { item, .. }) if item == "point B"));
    let odd_rate = C3dBuilder::new(100.0).analog_rate_hz(150.0).marker("A", vec![[0.0; 3]; 3]).build();
    assert!(matches!(odd_rate, Err(C3dError::Write { item, .. }) if item == "analog rate"));
    let long_label = C3dBuilder::new(100.0).marker(&"x".repeat(300), vec![[0.0; 3]]).build();
    assert!(matches!(long_label, Err(C3dError::Write { .. })));
}

/// Found by fuzzing: values that do not equal themselves and incomplete groups must not cause a
/// group to be rewritten.
#[test]
fn regress_odd_plates_and_events_are_kept() {
    let mut file = support::laboratory(Default::default(), Default::default());
    file.plates[1].corners[2][0] = f64::NAN;
    file.plates[0].channels.truncate(2);
    file.header_events[1].time_s = f32::NAN;
    file.header_events[0].label = "x\u{e9}".into();
    let first = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    assert_eq!(first.plates[0].channels, [0, 1]);
    assert_eq!(first.header_events[0].label, file.header_events[0].label);
    let second = assert_rewrites("odd plates", &first.to_bytes().unwrap());
    assert_eq!(second.plates[0].channels, [0, 1]);
    assert_eq!(format!("{:?}", second.groups), format!("{:?}", first.groups));
}
