//! The reader against ezc3d and the Python package c3d: `golden/foreign.json` holds what they saw, made by
//! `tests/peers/c3d_ezc3d.py golden` from the small files here and from recordings beside the workspace.
//!
//! Where a foreign reader is wrong, the deviation is listed here with the reason; an unlisted one fails.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "test code outside a test function")]

mod support;

use std::{collections::BTreeMap, path::PathBuf};

use aloft_c3d::{C3dFile, Point};
use serde_json::Value;
use support::{golden_folder, shared_data};

/// Deviations that are understood: reader, file, part, reason.
const UNDERSTOOD: &[(&str, &str, &str, &str)] = &[
    ("ezc3d", "plate_types.c3d", "plate 1 force 0.0e0, moment", "type 1: it takes force × place for place × force"),
    ("ezc3d", "unsigned_channels.c3d", "analogs", "it takes raw samples as signed though FORMAT is UNSIGNED"),
    ("ezc3d", "16bitanalog.c3d", "points", UNSIGNED_WORD),
    ("python_c3d", "16bitanalog.c3d", "residuals", UNSIGNED_WORD),
    ("python_c3d", "16bitanalog.c3d", "analogs", "it takes the offset −32,768 as signed beside raw samples of 32,768"),
    ("ezc3d", "16bitanalog.c3d", "plate", "ANALOG:UNITS say Nm; it takes N times the point unit"),
    ("ezc3d", "evart.c3d", "", "17 samples a frame by header and length; it takes 1000 / 60"),
    ("python_c3d", "Dance1.c3d", "analogs", SHORT_SECTION),
    ("python_c3d", "golfswing1.c3d", "analogs", SHORT_SECTION),
    ("ezc3d", "000", "points", UNSIGNED_WORD),
    ("ezc3d", "Hybrid", "points", UNSIGNED_WORD),
    ("python_c3d", "000", "residuals", UNSIGNED_WORD),
    ("python_c3d", "Hybrid", "residuals", UNSIGNED_WORD),
    ("ezc3d", "000", "plate", TURNED_DISTANCES),
    ("ezc3d", "Hybrid", "plate", TURNED_DISTANCES),
    ("ezc3d", "kyowadengyo.c3d", "", "POINT:USED is 12, the samples agree with the header's 11; it takes 12"),
    ("python_c3d", "admarche2.c3d", "points", HUGE_WORD),
    ("python_c3d", "marche281.c3d", "points", HUGE_WORD),
    ("python_c3d", "emgwl.c3d", "first_frame", "the header counts from 0; frames here are counted from 1"),
];
const UNSIGNED_WORD: &str =
    "occluded points have the fourth word 65,535 (−1 as 16 bits); it takes them as seen at the origin";
const SHORT_SECTION: &str = "the section is longer than its stated 3 blocks; it stops there and misses GEN_SCALE";
const TURNED_DISTANCES: &str = "type 3 with a positive depth: it turns the sensor distances a and b too";
const HUGE_WORD: &str = "the fourth word is 1.7e38, which no 16 bits hold; it takes these points as not seen";

fn close(a: f64, b: f64, size: f64) -> bool {
    (a - b).abs() <= 2e-6 * size.max(a.abs()).max(b.abs()) + 1e-7
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

fn same(a: f64, b: f64, size: f64) -> bool {
    (a.is_nan() && b.is_nan()) || close(a, b, size)
}

/// `{sum, abs, at}` of a series against values.
fn series_agrees(summary: &Value, values: &[f64]) -> bool {
    let finite = || values.iter().filter(|v| v.is_finite());
    let size: f64 = finite().map(|v| v.abs()).sum();
    // the summary's own size too: an unsigned offset moves both sums
    let at = summary["at"].as_array().map(Vec::as_slice).unwrap_or_default();
    close(number(&summary["sum"]), finite().sum(), size)
        && close(number(&summary["abs"]), size, size)
        && at.iter().all(|pair| {
            let mine = pair[0].as_u64().and_then(|i| values.get(i as usize)).copied();
            mine.is_some_and(|mine| same(number(&pair[1]), mine, 0.0))
        })
}

fn point_agrees(summary: &Value, point: &Point) -> bool {
    let valid: Vec<&[f32; 3]> = point
        .xyz
        .iter()
        .zip(&point.residual)
        .filter(|(x, r)| !r.is_nan() && x.iter().all(|v| v.is_finite()))
        .map(|(x, _)| x)
        .collect();
    let sums_agree = (0..3).all(|k| {
        let sum: f64 = valid.iter().map(|x| f64::from(x[k])).sum();
        let size: f64 = valid.iter().map(|x| f64::from(x[k].abs())).sum();
        close(number(&summary["sum"][k]), sum, size)
    });
    let at = summary["at"].as_array().map(Vec::as_slice).unwrap_or_default();
    summary["valid"].as_u64() == Some(valid.len() as u64)
        && sums_agree
        && at.iter().all(|place| {
            let frame = place[0].as_u64().unwrap_or(u64::MAX) as usize;
            let mine = point.xyz.get(frame).copied().unwrap_or([f32::INFINITY; 3]);
            (0..3).all(|k| same(number(&place[k + 1]), f64::from(mine[k]), 0.0))
        })
}

/// The parts in which a file differs from what `reader` saw.
fn deviations(file: &C3dFile, seen: &Value) -> Vec<String> {
    let mut out = Vec::new();
    let mut check = |part: &str, agrees: bool| {
        if !agrees {
            out.push(part.to_owned());
        }
    };
    let given = |key: &str| seen.get(key).is_some_and(|v| !v.is_null() && !v.is_string());
    if given("frames") {
        check("frames", seen["frames"].as_u64() == Some(file.n_frames as u64));
    }
    if given("first_frame") {
        check("first_frame", seen["first_frame"].as_u64() == Some(u64::from(file.first_frame)));
    }
    if given("point_rate_hz") {
        check("point_rate_hz", close(number(&seen["point_rate_hz"]), file.point_rate_hz, 0.0));
    }
    let list = |key: &str| seen[key].as_array().cloned().unwrap_or_default();
    for (key, mine) in [
        ("labels", file.points.iter().map(|p| p.label.as_str()).collect::<Vec<_>>()),
        ("analog_labels", file.analogs.iter().map(|a| a.label.as_str()).collect()),
    ] {
        if given(key) {
            let theirs = list(key);
            check(key, theirs.len() <= mine.len() && theirs.iter().zip(&mine).all(|(a, b)| a.as_str() == Some(b)));
        }
    }
    if given("points") {
        let points = list("points");
        check("number of points", points.len() == file.points.len());
        let differing = points
            .iter()
            .zip(&file.points)
            .filter(|(summary, point)| summary.get("at").is_some() && !point_agrees(summary, point))
            .count();
        check("points", differing == 0);
        let residuals_differ = points.iter().zip(&file.points).any(|(summary, point)| {
            let sum: f64 = point.residual.iter().filter(|r| !r.is_nan()).map(|r| f64::from(*r)).sum();
            summary.get("residual_sum").is_some_and(|theirs| !close(number(theirs), sum, sum))
        });
        check("residuals", !residuals_differ);
    }
    if given("analogs") {
        let analogs = list("analogs");
        check("number of channels", analogs.len() == file.analogs.len());
        let differing: Vec<&str> = analogs
            .iter()
            .zip(&file.analogs)
            .filter(|(summary, analog)| !series_agrees(summary, &analog.values))
            .map(|(_, analog)| analog.label.as_str())
            .collect();
        if !differing.is_empty() {
            out.push(format!("analogs {}", differing.join(" ")));
        }
    }
    let mut check = |part: &str, agrees: bool| {
        if !agrees {
            out.push(part.to_owned());
        }
    };
    if given("event_times_s") {
        let theirs = list("event_times_s");
        let mine = file.events.len();
        check(
            "events",
            theirs.len() >= mine && theirs.iter().zip(&file.events).all(|(a, b)| close(number(a), b.time_s, 0.0)),
        );
    }
    if given("plates") {
        for (i, plate) in list("plates").iter().enumerate() {
            if let Some(problem) = plate_deviation(file, i, plate) {
                out.push(format!("plate {} {problem}", i + 1));
            }
        }
    }
    out
}

/// ezc3d gives moments about the mean of the corners, in force unit times position unit, and leaves the sign as it is.
fn plate_deviation(file: &C3dFile, index: usize, theirs: &Value) -> Option<String> {
    let wrench = match file.plate_wrench(index) {
        Ok(wrench) => wrench,
        Err(problem) => return Some(format!("not calibrated: {problem}")),
    };
    let metres = file.metres_per_point_unit().unwrap_or(1e-3);
    let frame = file.plates[index].frame()?;
    let center = frame.center * metres;
    let about_center: Vec<[f64; 3]> = wrench
        .force_n
        .iter()
        .zip(&wrench.moment_nm)
        .map(|(f, m)| {
            let (f, m) = (nalgebra::Vector3::from(*f), nalgebra::Vector3::from(*m));
            (m - center.cross(&f)).into()
        })
        .collect();
    // pairs of theirs and mine, relative to the largest of each quantity
    let mut pairs: [Vec<(f64, f64)>; 2] = Default::default();
    for (quantity, (key, mine, unit)) in
        [("force", &wrench.force_n, 1.0), ("moment", &about_center, metres)].into_iter().enumerate()
    {
        let size = mine.iter().flatten().filter(|v| v.is_finite()).fold(1e-9, |m: f64, v| m.max(v.abs()));
        for k in 0..3 {
            for place in theirs[key][k]["at"].as_array().into_iter().flatten() {
                let sample = place[0].as_u64().unwrap_or(0) as usize;
                let mine = mine.get(sample).map_or(f64::NAN, |v| v[k]);
                pairs[quantity].push((number(&place[1]) * unit / size, mine / size));
            }
        }
    }
    let sign = pairs.iter().flatten().map(|(a, b)| a * b).sum::<f64>().signum();
    let worst = pairs.map(|list| list.iter().fold(0.0, |m: f64, (a, b)| m.max((sign * a - b).abs())));
    // corners that are not quite a rectangle: they take one edge as x, here the mean of both
    let [force, moment] = worst;
    (force > 5e-3 || moment > 1e-2 || force.is_nan() || moment.is_nan()).then(|| {
        format!(
            "force {force:.1e}, moment {moment:.1e} of the largest; {:?}",
            wrench.warnings.iter().map(|w| &w.message).collect::<Vec<_>>()
        )
    })
}

#[test]
fn validate_against_foreign_readers() {
    let golden: Value = serde_json::from_slice(&std::fs::read(golden_folder().join("foreign.json")).unwrap()).unwrap();
    let shared = shared_data("");
    let mut unexplained = Vec::new();
    let mut counts: BTreeMap<(String, bool), usize> = BTreeMap::new();
    for (name, readers) in golden["files"].as_object().unwrap() {
        let folders = [
            Some(golden_folder()),
            shared.as_ref().map(|s| s.join("c3d_samples")),
            shared.as_ref().map(|s| s.join("real_landing")),
        ];
        let Some(path) = folders.into_iter().flatten().map(|f: PathBuf| f.join(name)).find(|p| p.is_file()) else {
            continue;
        };
        let mut file = C3dFile::from_bytes(&std::fs::read(&path).unwrap()).unwrap_or_else(|e| panic!("{name}: {e}"));
        // ezc3d takes no baseline off
        file.plates.iter_mut().for_each(|p| p.zero_frames = [0, 0]);
        for (reader, seen) in readers.as_object().unwrap() {
            if seen.get("error").is_some() {
                *counts.entry((format!("{reader} cannot read"), true)).or_default() += 1;
                continue;
            }
            let found = deviations(&file, seen);
            *counts.entry((reader.clone(), found.is_empty())).or_default() += 1;
            for part in found {
                let known =
                    UNDERSTOOD.iter().find(|(r, f, p, _)| r == reader && name.contains(f) && part.starts_with(p));
                match known {
                    Some((.., reason)) => println!("{reader}: {name}: {part}: {reason}"),
                    None => unexplained.push(format!("{reader}: {name}: {part}")),
                }
            }
        }
    }
    println!("{counts:?}");
    assert!(unexplained.is_empty(), "{}", unexplained.join("\n"));
}
