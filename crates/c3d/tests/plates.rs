//! Plates as calibrated wrenches: compared with simulated truth and with the wrench used to create
//! a file; and the repairs.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "test code outside a test function")]

mod support;

use aloft_c3d::{C3dBuilder, C3dError, C3dFile, PlateDescription, PlateWrench};
use support::{golden_folder, laboratory, plate_types, shared_data};

/// Plate z downwards, as in most laboratories.
const CORNERS: [[f64; 3]; 4] = [[900.0, 700.0, 0.0], [900.0, 200.0, 0.0], [300.0, 200.0, 0.0], [300.0, 700.0, 0.0]];

fn close(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
    (0..3).all(|k| (a[k] - b[k]).abs() <= tolerance)
}

/// 700 N wandering over the plate, with shear and a free moment; unloaded in the first 20 samples.
fn standing(samples: usize) -> PlateWrench {
    let mut wrench = PlateWrench::default();
    for s in 0..samples {
        let load = if s < 20 { 0.0 } else { 1.0 };
        let force = [load * 5.0 * (s % 5) as f64, -load * 3.0 * (s % 3) as f64, load * (700.0 + (s % 7) as f64)];
        let (x, y) = (0.45 + 0.001 * (s % 90) as f64, 0.5);
        wrench.force_n.push(force);
        wrench.moment_nm.push([y * force[2], -x * force[2], x * force[1] - y * force[0] + 1.5 * load]);
    }
    wrench
}

fn builder() -> C3dBuilder {
    C3dBuilder::new(100.0).analog_rate_hz(1000.0).marker("HEEL", vec![[500.0, 450.0, 30.0]; 20])
}

fn assert_wrench(file: &C3dFile, expected: &PlateWrench, tolerance: f64) -> Vec<String> {
    let found = file.plate_wrench(0).unwrap();
    assert_eq!(found.force_n.len(), expected.force_n.len());
    for i in 0..expected.force_n.len() {
        assert!(close(found.force_n[i], expected.force_n[i], tolerance), "force {i}: {:?}", found.force_n[i]);
        assert!(close(found.moment_nm[i], expected.moment_nm[i], tolerance), "moment {i}: {:?}", found.moment_nm[i]);
    }
    found.warnings.into_iter().map(|w| w.message).collect()
}

#[test]
fn a_wrench_survives_channels_and_file() {
    let wrench = standing(200);
    for corners in [CORNERS, [CORNERS[2], CORNERS[3], CORNERS[0], CORNERS[1]], CORNERS.map(|c| [c[2], c[0], c[1]])] {
        for unit in ["mm", "m"] {
            let size = if unit == "m" { 1e-3 } else { 1.0 };
            // The third set of corners is for a world with y up, rotated with its wrench.
            let turned = corners[0][0] == 0.0;
            let turn = |v: &[f64; 3]| if turned { [v[2], v[0], v[1]] } else { *v };
            let wrench = PlateWrench {
                force_n: wrench.force_n.iter().map(turn).collect(),
                moment_nm: wrench.moment_nm.iter().map(turn).collect(),
                warnings: Vec::new(),
            };
            let corners = corners.map(|c| c.map(|x| x * size));
            let file =
                builder().point_unit(unit).plate(corners, [0.0, 0.0, -40.0 * size], wrench.clone()).build().unwrap();
            let read = C3dFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
            let warnings = assert_wrench(&read, &wrench, 2e-4);
            assert!(warnings.is_empty(), "{warnings:?}");
        }
    }
}

#[test]
fn regress_load_on_the_plate_becomes_reaction_on_the_subject() {
    let wrench = standing(200);
    let mut file = builder().plate(CORNERS, [0.0, 0.0, -40.0], wrench.clone()).build().unwrap();
    file.analogs.iter_mut().for_each(|a| a.values.iter_mut().for_each(|v| *v = -*v));
    let warnings = assert_wrench(&file, &wrench, 1e-9);
    assert!(warnings.len() == 1 && warnings[0].contains("reaction on the subject"), "{warnings:?}");
}

#[test]
fn regress_a_thousandfold_moment_is_repaired() {
    let wrench = standing(200);
    for factor in [1e3, 1e-3] {
        let mut file = builder().plate(CORNERS, [0.0, 0.0, -40.0], wrench.clone()).build().unwrap();
        for analog in &mut file.analogs[3..] {
            analog.values.iter_mut().for_each(|v| *v *= factor);
        }
        let warnings = assert_wrench(&file, &wrench, 1e-9);
        assert!(warnings.len() == 1 && warnings[0].contains("centre of pressure"), "{warnings:?}");
    }
}

#[test]
fn regress_baseline_only_where_it_is_one() {
    let wrench = standing(200);
    let mut file = builder().plate(CORNERS, [0.0, 0.0, -40.0], wrench.clone()).build().unwrap();
    for (k, analog) in file.analogs.iter_mut().enumerate() {
        analog.values.iter_mut().for_each(|v| *v += 3.0 * k as f64 - 7.0);
    }
    file.plates[0].zero_frames = [1, 2];
    assert!(assert_wrench(&file, &wrench, 1e-9).is_empty());
    // Outside the recording, or on a loaded plate: not subtracted, with a warning.
    for (range, words) in [([0, 10], "not in frames"), ([5, 40], "not in frames"), ([15, 18], "loaded")] {
        file.plates[0].zero_frames = range;
        let found = file.plate_wrench(0).unwrap();
        assert!(found.warnings.iter().any(|w| w.message.contains(words)), "{range:?}: {:?}", found.warnings);
        assert!(!close(found.force_n[50], wrench.force_n[50], 1.0));
    }
    for none in [[0, 0], [1, 0]] {
        file.plates[0].zero_frames = none;
        assert!(file.plate_wrench(0).unwrap().warnings.is_empty());
    }
}

#[test]
fn regress_an_origin_above_the_surface_is_turned() {
    let wrench = standing(200);
    let mut file = builder().plate(CORNERS, [1.0, 2.0, -40.0], wrench.clone()).build().unwrap();
    file.plates[0].origin = [-1.0, -2.0, 40.0];
    let warnings = assert_wrench(&file, &wrench, 1e-9);
    assert!(warnings.len() == 1 && warnings[0].contains("ORIGIN"), "{warnings:?}");
}

/// Types 1, 3 and 4 computed from one wrench by hand, with plate axes x = −world y … as given by
/// the corners.
#[test]
fn types_against_hand_made_channels() {
    let wrench = standing(200);
    let reference = builder().plate(CORNERS, [0.0, 0.0, -40.0], wrench.clone()).build().unwrap();
    let frame = reference.plates[0].frame().unwrap();
    let plate_from_world = frame.world_from_plate.transpose();
    let vector = |v: [f64; 3]| nalgebra::Vector3::from(v);
    // Force and moment about the centre of the surface, in plate axes.
    let at_centre: Vec<_> = wrench
        .force_n
        .iter()
        .zip(&wrench.moment_nm)
        .map(|(f, m)| {
            let moment = vector(*m) - (frame.centre * 1e-3).cross(&vector(*f));
            (plate_from_world * vector(*f), plate_from_world * moment)
        })
        .collect();
    let channels = |of: &dyn Fn(usize, usize) -> f64, n: usize| -> Vec<Vec<f64>> {
        (0..n).map(|k| (0..at_centre.len()).map(|i| of(i, k)).collect()).collect()
    };
    // Type 1: centre of pressure and free moment.
    let one = channels(
        &|i, k| {
            let (f, m) = at_centre[i];
            let place = if f.z == 0.0 { [0.0; 2] } else { [-m.y / f.z, m.x / f.z] };
            match k {
                0..=2 => f[k],
                3 | 4 => 1e3 * place[k - 3],
                _ => 1e3 * (m.z - (place[0] * f.y - place[1] * f.x)),
            }
        },
        6,
    );
    // Type 3: four posts at (±a, ±b), sensors at 48 mm depth; the moments about the surface are
    // distributed over the posts.
    let (a, b, depth) = (0.25, 0.2, -0.048);
    let three = channels(
        &|i, k| {
            let (f, m) = at_centre[i];
            let (mx, my) = (m.x - f.y * depth, m.y + f.x * depth);
            let posts = |sx: f64, sy: f64| 0.25 * (f.z + sy * mx / b - sx * my / a);
            // mz = b (x34 - x12) + a (y14 - y23)
            let (dx, dy) = (m.z / (2.0 * b), m.z / (2.0 * a));
            match k {
                0 => 0.5 * (f.x - dx),
                1 => 0.5 * (f.x + dx),
                2 => 0.5 * (f.y + dy),
                3 => 0.5 * (f.y - dy),
                4 => posts(1.0, 1.0),
                5 => posts(-1.0, 1.0),
                6 => posts(-1.0, -1.0),
                _ => posts(1.0, -1.0),
            }
        },
        8,
    );
    for (kind, values, units, origin) in [
        (1, one, vec!["N", "N", "N", "mm", "mm", "Nmm"], [0.0, 0.0, -40.0]),
        (3, three, vec!["N"; 8], [250.0, 200.0, -48.0]),
    ] {
        let mut built = builder();
        for (k, (values, unit)) in values.into_iter().zip(units).enumerate() {
            built = built.analog(&format!("C{k}"), unit, values);
        }
        let channels = (0..if kind == 3 { 8 } else { 6 }).collect();
        let plate = PlateDescription { kind, corners: CORNERS, origin, channels, ..PlateDescription::default() };
        let warnings = assert_wrench(&built.described_plate(plate).build().unwrap(), &wrench, 1e-9);
        assert!(warnings.is_empty(), "type {kind}: {warnings:?}");
    }
    // Types 4 and 5: volts multiplied by a matrix.
    for kind in [4, 5] {
        let inputs = if kind == 4 { 6 } else { 8 };
        let gains = [500.0, 480.0, 900.0, 150_000.0, 140_000.0, 80_000.0];
        let calibration: Vec<Vec<f64>> =
            (0..6).map(|r| (0..inputs).map(|c| if r == c { gains[r] } else { 0.0 }).collect()).collect();
        let mut file = reference.clone();
        for (k, analog) in file.analogs.iter_mut().enumerate() {
            analog.values.iter_mut().for_each(|v| *v /= gains[k]);
            analog.unit = "V".into();
        }
        let spare = file.analogs[0].clone();
        file.analogs.extend([spare.clone(), spare]);
        file.plates[0].kind = kind;
        file.plates[0].channels = (0..inputs).collect();
        file.plates[0].calibration = calibration;
        let warnings = assert_wrench(&file, &wrench, 1e-9);
        assert!(warnings.iter().all(|w| w.contains("unit of the moments")), "{warnings:?}");
    }
}

#[test]
fn regress_what_cannot_be_calibrated_says_so() {
    let mut file = plate_types(&[3]);
    assert!(matches!(file.plate_wrench(1), Err(C3dError::NoPlate { index: 1, count: 1 })));
    file.plates[0].channels.pop();
    assert!(
        matches!(file.plate_wrench(0), Err(C3dError::Plate { index: 0, problem }) if problem.contains("8 channels"))
    );
    let mut file = laboratory(Default::default(), Default::default());
    file.plates[0].kind = 7;
    assert!(matches!(file.plate_wrench(0), Err(C3dError::Plate { problem, .. }) if problem.contains("type 7")));
    file.plates[1].corners = [[1.0; 3]; 4];
    assert!(matches!(file.plate_wrench(1), Err(C3dError::Plate { problem, .. }) if problem.contains("span no plate")));
}

/// Plates of `subject_a` against the simulator's wrench: 1 N of noise on each of 6 force channels,
/// and drift.
#[test]
fn validate_against_simulated_truth() {
    let Some(folder) = shared_data("") else { return };
    let truth: serde_json::Value =
        serde_json::from_slice(&std::fs::read(golden_folder().join("plate_truth.json")).unwrap()).unwrap();
    for (trial, samples) in truth.as_object().unwrap() {
        let bytes = std::fs::read(folder.join("subject_a").join(format!("{trial}.c3d"))).unwrap();
        let file = C3dFile::from_bytes(&bytes).unwrap();
        let plates: Vec<PlateWrench> = (0..2).map(|i| file.plate_wrench(i).unwrap()).collect();
        assert!(plates.iter().all(|p| p.warnings.is_empty()));
        let mut squares = [0.0; 6];
        let samples = samples.as_array().unwrap();
        for sample in samples {
            let i = sample[0].as_u64().unwrap() as usize;
            for k in 0..6 {
                let of = |p: &PlateWrench| if k < 3 { p.force_n[i][k] } else { p.moment_nm[i][k - 3] };
                let error = plates.iter().map(of).sum::<f64>() - sample[k + 1].as_f64().unwrap();
                squares[k] += error * error;
            }
        }
        let rms = squares.map(|s| (s / samples.len() as f64).sqrt());
        println!("{trial}: rms against truth {rms:.2?} (N, N·m)");
        assert!(rms[..3].iter().all(|e| *e < 4.0) && rms[3..].iter().all(|e| *e < 2.0), "{trial}: {rms:?}");
    }
}

/// Every calibrated plate of the recordings pushes up, with the centre of pressure on the plate
/// while loaded.
#[test]
fn validate_recorded_plates_push_up_and_inside() {
    let Some(folder) = shared_data("") else { return };
    let (mut calibrated, mut refused, mut loaded_plates) = (0, 0, 0);
    for path in support::c3d_files(&folder) {
        let file = C3dFile::from_bytes(&std::fs::read(&path).unwrap()).unwrap();
        for index in 0..file.plates.len() {
            let wrench = match file.plate_wrench(index) {
                Ok(wrench) => wrench,
                Err(problem) => {
                    println!("{}: {problem}", path.display());
                    refused += 1;
                    continue;
                }
            };
            calibrated += 1;
            let frame = file.plates[index].frame().unwrap();
            let metres = file.metres_per_point_unit().unwrap();
            let largest = wrench.force_n.iter().map(|f| f[2].abs()).fold(0.0, f64::max);
            if largest < 150.0 {
                continue;
            }
            let (mut loaded, mut inside, mut up) = (0, 0, 0.0);
            for (force, moment) in wrench.force_n.iter().zip(&wrench.moment_nm) {
                if force[2].abs() < 0.4 * largest {
                    continue;
                }
                up += force[2];
                let height = frame.centre.z * metres;
                let place = nalgebra::Vector3::new(
                    (height * force[0] - moment[1]) / force[2],
                    (moment[0] + height * force[1]) / force[2],
                    height,
                );
                let local = frame.world_from_plate.transpose() * (place - frame.centre * metres);
                loaded += 1;
                let within = |k: usize| local[k].abs() < 1.05 * frame.half_size[k] * metres;
                inside += usize::from(within(0) && within(1));
            }
            loaded_plates += 1;
            assert!(up > 0.0, "{} plate {}", path.display(), index + 1);
            assert!(inside * 100 >= loaded * 95, "{} plate {}: {inside} of {loaded}", path.display(), index + 1);
        }
    }
    println!("{calibrated} plates calibrated, {loaded_plates} of them loaded, {refused} refused");
}
