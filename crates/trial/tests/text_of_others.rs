//! Text recordings as other programs write them: words for a missing value, names of force columns,
//! clocks that differ, several people.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, not library code")]

use aloft_trial::{ColumnNames, ForceTimes, ImportOptions, PlateNames, Trial, WarningKind};
use std::fmt::Write;

const FRAMES: usize = 100;

/// Markers A and B at 100 Hz, with the given times and one cell of A in frame 51 replaced.
fn trc(rate: &str, time: impl Fn(usize) -> String, cell: &str) -> String {
    let mut out = format!(
        "PathFileType\t4\t(X/Y/Z)\tx.trc\n\
         DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
         {rate}\t{rate}\t{FRAMES}\t2\tmm\t{rate}\t1\t{FRAMES}\n\
         Frame#\tTime\tA\t\t\tB\t\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
    );
    for f in 0..FRAMES {
        let x = if f == 50 { cell.to_owned() } else { format!("{f}.5") };
        let _ = writeln!(out, "{}\t{}\t{x}\t1000\t10\t0.5\t20.5\t30.5", f + 1, time(f));
    }
    out
}

fn plain() -> String {
    trc("100", |f| format!("{:.3}", f as f64 / 100.0), "1.5")
}

/// Two plates at 1000 Hz with the given names of columns and times.
fn mot(name: impl Fn(usize, char, char) -> String, time: impl Fn(usize) -> String) -> String {
    let rows = 10 * FRAMES - 9;
    let mut out = format!("grf\nversion=1\nnRows={rows}\nnColumns=19\ninDegrees=yes\nendheader\ntime");
    for plate in [1, 2] {
        for quantity in ['f', 'p', 'm'] {
            "xyz".chars().for_each(|axis| out.push_str(&format!("\t{}", name(plate, quantity, axis))));
        }
    }
    out.push('\n');
    for r in 0..rows {
        out.push_str(&time(r));
        for plate in 1..=2 {
            let _ = write!(out, "\t1.{plate}\t{}\t-2.5\t0.1\t0\t0.{plate}\t0\t{plate}.25\t0", 300 + r);
        }
        out.push('\n');
    }
    out
}

fn usual(plate: usize, quantity: char, axis: char) -> String {
    let before = if plate == 1 { "" } else { "1_" };
    match quantity {
        'f' => format!("{before}ground_force_v{axis}"),
        'p' => format!("{before}ground_force_p{axis}"),
        _ => format!("{before}ground_torque_{axis}"),
    }
}

fn seconds(r: usize) -> String {
    format!("{:.4}", r as f64 / 1000.0)
}

fn read(trc: &str, mot: &str) -> Trial {
    Trial::from_trc_mot("t", trc, Some(mot), &ImportOptions::default()).unwrap()
}

fn clocks(trial: &Trial) -> Vec<&str> {
    trial.warnings.iter().filter(|w| w.kind == WarningKind::Clock).map(|w| w.message.as_str()).collect()
}

#[test]
fn words_for_a_missing_value_are_missing_points_and_missing_forces() {
    for word in
        ["", "-", "NULL", "None", "N/A", "1.#QNAN", "-1.#IND00", "NaN", "-nan", "#N/A", "null", ".", "--", "1.#INF"]
    {
        let cells = format!("{word}\t{word}\t{word}");
        let text = trc("100", |f| format!("{:.3}", f as f64 / 100.0), "@").replace("@\t1000\t10", &cells);
        let forces = mot(usual, seconds);
        let forces = match word {
            "" => forces,
            word => forces.replace("\t777\t", &format!("\t{word}\t")),
        };
        let trial = read(&text, &forces);
        assert_eq!((trial.markers.position(0, 50), trial.markers.n_frames), (None, FRAMES), "{word}");
        assert!(trial.markers.position(1, 50).is_some() && trial.markers.position(0, 49).is_some());
        let lacking = trial.plates.iter().flat_map(|p| &p.force_n).filter(|f| f.iter().any(|x| x.is_nan())).count();
        assert_eq!(lacking, if word.is_empty() { 0 } else { 2 }, "{word}");
        // one word of the three is a missing point, not a shifted row
        let one = trc("100", |f| format!("{:.3}", f as f64 / 100.0), if word.is_empty() { "NaN" } else { word });
        assert_eq!(read(&one, &mot(usual, seconds)).markers.position(0, 50), None, "{word}");
    }
    let text = trc("100", |f| format!("{:.3}", f as f64 / 100.0), "1.5x");
    let wrong = Trial::from_trc_mot("t", &text, None, &ImportOptions::default()).unwrap_err().to_string();
    assert!(wrong.contains("TRC line 57: found `1.5x`"), "{wrong}");
}

#[test]
fn names_of_force_columns_change_nothing() {
    let whole = read(&plain(), &mot(usual, seconds));
    assert_eq!((whole.plates.len(), whole.unused_columns.len()), (2, 0));
    let side = |plate: usize| ["r", "l"][plate - 1];
    let of = |q: char, words: [&'static str; 3]| words[['f', 'p', 'm'].iter().position(|w| *w == q).unwrap()];
    let force = ["force", "force", "torque"];
    type Named<'a> = &'a dyn Fn(usize, char, char) -> String;
    let families: [(&str, Named<'_>); 7] = [
        ("MOtoNMS", &|k, q, a| format!("ground_{}{k}_{}{a}", of(q, force), of(q, ["v", "p", ""]))),
        ("AddBiomechanics", &|k, q, a| format!("ground_force_calcn_{}_{}{a}", side(k), of(q, ["v", "p", "m"]))),
        ("vectors", &|k, q, a| format!("ground_{}_calcn_{}_{}{a}", of(q, force), side(k), of(q, ["v", "p", "v"]))),
        ("the C3D adapter of OpenSim", &|k, q, a| format!("{q}{k}_{a}")),
        ("channels", &|k, q, a| format!("{}{a}{k}", of(q, ["F", "COP", "M"]))),
        ("plates", &|k, q, a| format!("FP{k}_{}{a}", of(q, ["v", "p", "t"]))),
        ("sides", &|k, q, a| format!("grf_{}_{}{a}", side(k), of(q, ["v", "p", "torque_"]))),
    ];
    for (program, name) in families {
        let trial = read(&plain(), &mot(name, seconds));
        assert_eq!((trial.plates.len(), &trial.unused_columns), (2, &Vec::new()), "{program}");
        for (a, b) in whole.plates.iter().zip(&trial.plates) {
            assert_eq!((&a.force_n, &a.moment_nm), (&b.force_n, &b.moment_nm), "{program}");
        }
    }
    // what belongs to no plate is listed, not dropped in silence
    let odd = |k: usize, q: char, a: char| if q == 'm' { format!("spin{k}_{a}") } else { usual(k, q, a) };
    let trial = read(&plain(), &mot(odd, seconds));
    assert_eq!((trial.plates.len(), trial.unused_columns.len(), trial.unused_columns[0].as_str()), (2, 6, "spin1_x"));
    let names = |k: usize| PlateNames {
        force: ColumnNames::Before(usual(k, 'f', '@').replace('@', "")),
        point: Some(ColumnNames::Before(usual(k, 'p', '@').replace('@', ""))),
        moment: Some(ColumnNames::Each(["x", "y", "z"].map(|a| Some(format!("spin{k}_{a}"))))),
    };
    let forces = [("FP1".to_owned(), names(1)), ("FP2".to_owned(), names(2))].into_iter().collect();
    let stated = ImportOptions { forces, ..ImportOptions::default() };
    let trial = Trial::from_trc_mot("t", &plain(), Some(&mot(odd, seconds)), &stated).unwrap();
    assert_eq!(trial.plates[1].moment_nm, whole.plates[1].moment_nm);
    assert!(trial.unused_columns.is_empty());
}

#[test]
fn clocks_that_differ_are_told_and_the_times_count() {
    let whole = read(&plain(), &mot(usual, seconds));
    assert!(clocks(&whole).is_empty(), "{:?}", whole.warnings);
    let from = |start: f64| trc("100", move |f| format!("{:.3}", start + f as f64 / 100.0), "1.5");
    let late = |start: f64| mot(usual, move |r| format!("{:.4}", start + r as f64 / 1000.0));
    // no common time and the same length
    for trial in [read(&from(12.345), &mot(usual, seconds)), read(&plain(), &late(12.345))] {
        assert_eq!(trial.plates, whole.plates);
        assert!(clocks(&trial)[0].contains("12.345 to 13.335 s") && clocks(&trial)[0].contains("starting together"));
    }
    let both = read(&from(12.345), &late(12.345));
    assert_eq!((both.plates, clocks(&read(&from(12.345), &late(12.345))).len()), (whole.plates.clone(), 0));
    // part of the time in common: the times count
    let part = read(&plain(), &late(0.5));
    assert!(clocks(&part)[0].contains("0.500 s of the markers have no forces"), "{:?}", part.warnings);
    assert!(part.plates[0].force_n[499].x.is_nan() && part.plates[0].force_n[500] == whole.plates[0].force_n[0]);
    let together = ImportOptions { force_times: ForceTimes::FromFirstFrame, ..ImportOptions::default() };
    let stated = Trial::from_trc_mot("t", &plain(), Some(&late(0.5)), &together).unwrap();
    assert_eq!((&stated.plates, clocks(&stated).len()), (&whole.plates, 0));
    // no common time and another length
    let short: String =
        late(12.0).lines().take(500).map(|l| format!("{l}\n")).collect::<String>().replace("nRows=991", "nRows=493");
    let refused = Trial::from_trc_mot("t", &plain(), Some(&short), &ImportOptions::default()).unwrap_err().to_string();
    assert!(refused.contains("forces from 12.000 to 12.492 s and markers from 0.000 to 0.990 s"), "{refused}");
    // another unit
    for trial in [
        read(&plain(), &mot(usual, |r| r.to_string())),
        read(&trc("100", |f| (10 * f).to_string(), "1.5"), &mot(usual, seconds)),
    ] {
        assert_eq!((trial.markers.rate_hz, &trial.plates), (100.0, &whole.plates));
        assert!(clocks(&trial)[0].contains("milliseconds"), "{:?}", trial.warnings);
    }
    // a stated rate that the times contradict, by 1 ms a second, or none
    let slow = read(&trc("100", |f| format!("{:.6}", f as f64 / 99.9), "1.5"), &mot(usual, seconds));
    assert!((slow.markers.rate_hz - 99.9).abs() < 1e-3, "{}", slow.markers.rate_hz);
    assert!(clocks(&slow)[0].contains("states 100 Hz, but its times run at 99.900 Hz (1.000 ms a second)"));
    for rate in ["", "0", "NaN"] {
        let trial = read(&trc(rate, |f| format!("{:.3}", f as f64 / 100.0), "1.5"), &mot(usual, seconds));
        assert_eq!((trial.markers.rate_hz, clocks(&trial).len(), &trial.plates), (100.0, 1, &whole.plates), "{rate}");
    }
    // times that are no clock
    for time in [|_: usize| "0.000".to_owned(), |f: usize| format!("{:.3}", (200 - f) as f64 / 100.0)] {
        let refused = Trial::from_trc_mot("t", &trc("100", time, "1.5"), None, &ImportOptions::default()).unwrap_err();
        assert!(refused.to_string().contains("TRC line 8: found the time"), "{refused}");
    }
}

#[test]
fn regress_values_separated_by_several_tabs_are_read_with_a_warning() {
    let text =
        plain().replace("100\t100\t100\t2\tmm\t100\t1\t100\n", "100\t\t100\t\t100\t\t2\t\tmm\t\t100\t\t1\t\t100\n");
    let (trial, whole) = (read(&text, &mot(usual, seconds)), read(&plain(), &mot(usual, seconds)));
    assert_eq!((&trial.markers, &trial.plates), (&whole.markers, &whole.plates));
    assert!(trial.warnings[0].message.contains("not below their names"), "{:?}", trial.warnings);
}

#[test]
fn of_several_people_one_is_chosen_by_name_or_the_recording_is_refused() {
    let names = ["LASI", "RASI", "LPSI", "RPSI", "LKNE", "RKNE", "LANK", "RANK", "LHEE", "RHEE"];
    for mark in [":", "_"] {
        let mut head = "Frame#\tTime".to_owned();
        let mut row = |f: usize| {
            let mut out = format!("{}\t{:.3}", f + 1, f as f64 / 100.0);
            (0..2 * names.len()).for_each(|m| out.push_str(&format!("\t{m}.5\t{f}.5\t900.5")));
            out
        };
        for person in ["Ben", "Anna"] {
            names.iter().for_each(|n| head.push_str(&format!("\t{person}{mark}{n}\t\t")));
        }
        let rows: Vec<String> = (0..20).map(&mut row).collect();
        let text = format!(
            "PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n100\t20\t20\tmm\n{head}\n\t\tX1\n\n{}\n",
            rows.join("\n")
        );
        let called =
            |name: &str| ImportOptions { people: vec!["S01".to_owned(), name.to_owned()], ..ImportOptions::default() };
        let trial = Trial::from_trc_mot("t", &text, None, &called("anna")).unwrap();
        assert_eq!(
            (trial.person.as_deref(), &trial.markers.labels),
            (Some("Anna"), &names.map(str::to_owned).to_vec())
        );
        assert!((trial.markers.position(0, 3).unwrap().x - 0.0105).abs() < 1e-12);
        assert!(trial.warnings.iter().any(|w| w.kind == WarningKind::People && w.message.contains("those of Anna")));
        let refused = Trial::from_trc_mot("t", &text, None, &called("Cleo")).unwrap_err().to_string();
        assert!(refused.contains("markers of several people (Anna, Ben)"), "{refused}");
        let seen = Trial::contents_of_trc_mot("t", &text, None, &called("Cleo")).unwrap();
        assert_eq!(
            (seen.people, seen.markers.labels[0].clone()),
            (vec!["Anna".to_owned(), "Ben".to_owned()], format!("Ben{mark}LASI"))
        );
    }
}
