//! Small files made with the builder, one for each rule of the reader, and access to the recordings
//! of the data folder.

#![allow(dead_code, reason = "each test file uses its part")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "test code outside a test function")]

#[path = "../../../../tests/shared_data.rs"]
mod shared;
#[allow(unused_imports, reason = "each test file uses its part")]
pub use shared::shared_data;

use std::path::{Path, PathBuf};

use aloft_c3d::{
    Analog, ByteOrder, C3dBuilder, C3dFile, FileEvent, Parameter, PlateDescription, PlateWrench, Point, PointKind,
    Storage, Values,
};

/// Folder of committed small files.
pub fn golden_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// All C3D files below a folder, sorted.
pub fn c3d_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(next).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d")) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// A smooth path on a grid of 0.125, which integers and all three float formats represent exactly.
fn path(seed: usize, frames: usize) -> Vec<[f32; 3]> {
    let wave = |k: usize, f: usize| (((f * (k + 3) + 7 * k) % 97) as f32 - 48.0) * 2.125 + seed as f32;
    (0..frames).map(|f| [wave(seed, f), wave(seed + 1, f) * 2.0, 900.0 + wave(seed + 2, f)]).collect()
}

/// Five markers with gaps, residuals, cameras; a computed point; two plates; events; custom
/// parameters.
pub fn laboratory(order: ByteOrder, storage: Storage) -> C3dFile {
    let frames = 24;
    let mut builder = C3dBuilder::new(100.0).stored_as(order, storage, 0.125).analog_rate_hz(300.0).first_frame(11);
    for i in 0..5 {
        let mut xyz = path(i, frames);
        let mut residual: Vec<f32> = (0..frames).map(|f| 0.125 * ((f * 5 + i) % 40) as f32).collect();
        let mut cameras: Vec<u8> = (0..frames).map(|f| ((f * 11 + i * 3) % 128) as u8).collect();
        for f in (i * 3)..(i * 4) {
            (xyz[f], residual[f], cameras[f]) = ([f32::NAN; 3], f32::NAN, 0);
        }
        let label = ["Anna:LASI", "Anna:RASI", "Anna:SACR", "Anna:LKNE", "*17"][i].to_owned();
        let description = format!("marker {i}");
        builder = builder.point(Point { label, description, xyz, residual, cameras, ..Point::default() });
    }
    builder = builder.computed("Anna:LKneeAngles", PointKind::Angle, "deg", path(9, frames));
    let corners_a = [[500.0, 400.0, 0.0], [500.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 400.0, 0.0]];
    let corners_b = [[600.0, 0.0, 1.0], [600.0, 400.0, 1.0], [1100.0, 400.0, 1.0], [1100.0, 0.0, 1.0]];
    for (index, corners) in [corners_a, corners_b].into_iter().enumerate() {
        let channels = (6 * index..6 * index + 6).collect();
        let plate =
            PlateDescription { kind: 2, corners, origin: [1.0, -2.0, -40.0], channels, ..PlateDescription::default() };
        builder = builder.described_plate(plate);
        for (k, name) in ["Fx", "Fy", "Fz", "Mx", "My", "Mz"].into_iter().enumerate() {
            let size = [16.0, 8.0, 64.0, 512.0, 512.0, 128.0][k];
            let offset = if name == "Fz" { -600.0 } else { 0.0 };
            let unit = if k < 3 { "N" } else { "Nmm" };
            let values = (0..3 * frames).map(|s| offset + size * ((s * (k + 2 + index)) % 13) as f64).collect();
            let scale = if k < 3 { 0.125 } else { 8.0 };
            let label = format!("{name}{}", index + 1);
            builder = builder.channel(Analog { label, unit: unit.into(), scale, values, ..Analog::default() });
        }
    }
    let emg = (0..3 * frames).map(|s| 0.03125 * ((s * 29) % 64) as f64 - 0.5).collect();
    builder = builder.channel(Analog {
        label: "EMG1".into(),
        description: "vastus".into(),
        unit: "V".into(),
        scale: 0.03125,
        offset: 12.0,
        values: emg,
    });
    builder
        .event("Foot Strike", "Left", 0.125)
        .full_event(FileEvent {
            label: "Foot Off".into(),
            context: "Right".into(),
            time_s: 61.25,
            subject: "Anna".into(),
            description: "last contact".into(),
        })
        .header_event("LFS", 0.125)
        .header_event("RFO", 0.25)
        .parameter("SUBJECTS", Parameter::texts("NAMES", &["Anna"]).described("who"))
        .parameter("PROCESSING", Parameter::float("BodyMass", 61.5))
        .parameter("PROCESSING", Parameter::new("TABLE", vec![2, 3], Values::Integers(vec![1, -2, 3, -4, 5, -6])))
        .build()
        .unwrap()
}

/// Plates of the requested types: 1, 3, 4 or 5.
pub fn plate_types(kinds: &[i32]) -> C3dFile {
    let frames = 12;
    let square = |x: f64| [[x + 400.0, 300.0, 0.0], [x + 400.0, 0.0, 0.0], [x, 0.0, 0.0], [x, 300.0, 0.0]];
    let mut builder = C3dBuilder::new(50.0).marker("HEEL", path(1, frames));
    let mut channel = 0;
    for (index, (kind, names)) in [
        (1, vec!["Fx", "Fy", "Fz", "Px", "Py", "Mz"]),
        (3, vec!["Fx12", "Fx34", "Fy14", "Fy23", "Fz1", "Fz2", "Fz3", "Fz4"]),
        (4, vec!["Fx", "Fy", "Fz", "Mx", "My", "Mz"]),
        (5, vec!["S1", "S2", "S3", "S4", "S5", "S6", "S7", "S8"]),
    ]
    .into_iter()
    .filter(|(kind, _)| kinds.contains(kind))
    .enumerate()
    {
        let mut plate = PlateDescription {
            kind,
            corners: square(500.0 * index as f64),
            origin: if kind == 3 { [120.0, 90.0, -48.0] } else { [0.5, -1.0, -36.0] },
            channels: (channel..channel + names.len()).collect(),
            ..PlateDescription::default()
        };
        channel += names.len();
        if kind == 4 {
            plate.calibration = (0..6)
                .map(|r| {
                    (0..6)
                        .map(|c| if r == c { [500.0, 490.0, 1000.0, 150_000.0, 160_000.0, 90_000.0][r] } else { 2.0 })
                        .collect()
                })
                .collect();
        }
        if kind == 5 {
            plate.calibration = (0..6)
                .map(|r| (0..8).map(|c| if r == c { 250.0 } else { 1.0 + r as f64 - c as f64 }).collect())
                .collect();
        }
        builder = builder.described_plate(plate);
        for (k, name) in names.iter().enumerate() {
            let values = (0..frames)
                .map(|f| {
                    let wave = ((f * (k + 3)) % 7) as f64 - 3.0;
                    match (kind, *name) {
                        (4 | 5, "Fz" | "S3") => -0.5 + 0.03125 * wave,
                        (4 | 5, _) => 0.03125 * wave,
                        (_, "Fz" | "Fz1" | "Fz2" | "Fz3" | "Fz4") => -300.0 + 8.0 * wave,
                        _ => 16.0 * wave,
                    }
                })
                .collect();
            let unit = match (kind, *name) {
                (4 | 5, _) => "V",
                (_, "Px" | "Py") => "mm",
                (_, "Mz") => "Nmm",
                _ => "N",
            };
            builder = builder.analog(&format!("{name}_{}", index + 1), unit, values);
        }
    }
    builder.build().unwrap()
}

/// 300 points, more than fit into one list of labels.
pub fn many_labels() -> C3dFile {
    (0..300).fold(C3dBuilder::new(100.0), |b, i| b.marker(&format!("M{i:03}"), path(i, 2))).build().unwrap()
}

/// 16-bit unsigned channels.
pub fn unsigned_channels() -> C3dFile {
    let mut builder = C3dBuilder::new(60.0)
        .stored_as(ByteOrder::Intel, Storage::Integer, 0.125)
        .unsigned_analogs()
        .marker("A", path(0, 10));
    for i in 0..3 {
        let values = (0..20).map(|s| 0.25 * ((s * 3001 + i * 777) % 65_536) as f64 - 8192.0).collect();
        builder = builder.channel(Analog {
            label: format!("CH{i}"),
            unit: "V".into(),
            scale: 0.25,
            offset: 32_768.0,
            values,
            ..Analog::default()
        });
    }
    builder.build().unwrap()
}

/// A standing person of 700 N on a plate, given as the reaction about the world origin.
pub fn from_wrench() -> C3dFile {
    let corners = [[900.0, 700.0, 0.0], [900.0, 200.0, 0.0], [300.0, 200.0, 0.0], [300.0, 700.0, 0.0]];
    let samples = 40;
    let mut wrench = PlateWrench::default();
    for s in 0..samples {
        let force = [4.0 * (s % 5) as f64, -2.0 * (s % 3) as f64, 700.0 + (s % 7) as f64];
        let (x, y) = (0.55 + 0.001 * s as f64, 0.4);
        wrench.force_n.push(force);
        wrench.moment_nm.push([y * force[2], -x * force[2], x * force[1] - y * force[0] + 1.5]);
    }
    C3dBuilder::new(100.0)
        .analog_rate_hz(400.0)
        .marker("HEEL", path(2, 10))
        .plate(corners, [0.0, 0.0, -40.0], wrench)
        .build()
        .unwrap()
}

/// No points.
pub fn channels_only() -> C3dFile {
    let emg = |k: usize| (0..64).map(|s| ((s * k) % 17) as f64).collect();
    C3dBuilder::new(1.0).analog_rate_hz(8.0).analog("E1", "uV", emg(3)).analog("E2", "uV", emg(5)).build().unwrap()
}

/// All small files with their names.
pub fn fixtures() -> Vec<(&'static str, C3dFile)> {
    use {ByteOrder::*, Storage::*};
    vec![
        ("intel_float", laboratory(Intel, Float)),
        ("intel_integer", laboratory(Intel, Integer)),
        ("dec_float", laboratory(Dec, Float)),
        ("dec_integer", laboratory(Dec, Integer)),
        ("mips_float", laboratory(Mips, Float)),
        ("mips_integer", laboratory(Mips, Integer)),
        ("plate_types", plate_types(&[1, 3, 4])),
        ("plate_type_5", plate_types(&[5])),
        ("from_wrench", from_wrench()),
        ("many_labels", many_labels()),
        ("unsigned_channels", unsigned_channels()),
        ("channels_only", channels_only()),
    ]
}

/// 70,000 frames of one point, more than the header can represent.
pub fn long_file() -> C3dFile {
    C3dBuilder::new(100.0)
        .stored_as(ByteOrder::Intel, Storage::Integer, 0.125)
        .marker("A", path(0, 70_000))
        .build()
        .unwrap()
}
