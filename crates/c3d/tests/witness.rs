//! Comparison with an independent Rust reader, the crate c3d-rs, on the files that it can read:
//! Intel order only, and without a panic.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "test code outside a test function")]

mod support;

use std::{
    io::Cursor,
    panic::{AssertUnwindSafe, catch_unwind},
};

use aloft_c3d::{ByteOrder, C3dFile, Storage};
use support::{c3d_files, fixtures, shared_data};

/// Per frame: points as x, y, z, fourth; analog numbers.
type Frames = Vec<(Vec<[f32; 5]>, Vec<f32>)>;

/// Result of the other reader; `None` if it panics, fails or stops early.
fn witnessed(bytes: &[u8]) -> Option<Frames> {
    let read = || {
        let file = c3d_rs::C3dAdapter::new(Cursor::new(bytes.to_vec())).ok()?.construct().ok()?;
        let frames: Frames = file
            .reader()
            .ok()?
            .map(|(_, points, analogs)| (points.values, analogs.map(|a| a.values).unwrap_or_default()))
            .collect();
        Some(frames)
    };
    catch_unwind(AssertUnwindSafe(read)).ok().flatten()
}

/// Compares both results; returns (points compared, analog numbers compared).
fn compare(name: &str, file: &C3dFile, frames: &Frames) -> (usize, usize) {
    let (mut points, mut analogs) = (0, 0);
    // It scales only the first sample of each frame, so only files with one sample per frame can be
    // compared.
    let analogs_comparable = file.samples_per_frame() == 1 && !file.analog_unsigned;
    for (f, (theirs, numbers)) in frames.iter().take(file.n_frames).enumerate() {
        for (i, value) in theirs.iter().enumerate().take(file.points.len()) {
            let point = &file.points[i];
            // It multiplies the fourth word of integer files by the scale, and treats 65,535 in
            // float files as a visible point.
            let seen = !point.residual[f].is_nan();
            if seen && value[3] >= 0.0 {
                assert_eq!(point.xyz[f], [value[0], value[1], value[2]], "{name}: point {i}, frame {f}");
                points += 1;
            } else if file.storage == Storage::Float {
                let unsigned_word = point.xyz[f][0].is_nan() && value[..3] == [0.0; 3];
                assert!(value[3] < 0.0 || unsigned_word, "{name}: point {i}, frame {f}: {value:?}");
            }
        }
        if analogs_comparable {
            for (analog, theirs) in file.analogs.iter().zip(numbers) {
                let mine = analog.values[f];
                let size = mine
                    .abs()
                    .max(analog.scale.abs() * file.analog_general_scale.abs() * analog.offset.abs())
                    .max(1e-6);
                assert!(
                    (mine - f64::from(*theirs)).abs() <= 1e-5 * size,
                    "{name}: {}, frame {f}: {mine} {theirs}",
                    analog.label
                );
                analogs += 1;
            }
        }
    }
    (points, analogs)
}

#[test]
fn validate_against_c3d_rs() {
    let mut files: Vec<(String, Vec<u8>)> =
        fixtures().into_iter().map(|(name, file)| (name.to_owned(), file.to_bytes().unwrap())).collect();
    if let Some(folder) = shared_data("") {
        files.extend(c3d_files(&folder).iter().map(|p| (p.display().to_string(), std::fs::read(p).unwrap())));
    }
    // Suppress the output of its panics.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    // It supports no other byte order, and prints what it finds.
    let intel = |bytes: &[u8]| C3dFile::from_bytes(bytes).is_ok_and(|f| f.byte_order == ByteOrder::Intel);
    let seen: Vec<Option<Frames>> =
        files.iter().map(|(_, bytes)| intel(bytes).then(|| witnessed(bytes)).flatten()).collect();
    std::panic::set_hook(hook);

    let (mut compared, mut points, mut analogs) = (0, 0, 0);
    for ((name, bytes), frames) in files.iter().zip(seen) {
        let file = C3dFile::from_bytes(bytes).unwrap();
        let Some(frames) = frames.filter(|f| f.len() >= file.n_frames) else { continue };
        let (p, a) = compare(name, &file, &frames);
        compared += 1;
        points += p;
        analogs += a;
    }
    println!("{compared} of {} files compared: {points} points and {analogs} analog numbers equal", files.len());
    assert!(compared >= 5);
}
