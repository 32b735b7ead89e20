//! Text recordings (TRC, MOT, STO) truncated at every position and edited at random: the import
//! returns the original data, an error or a warning, and no damage changes the time of a sample.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

use aloft_trial::{ImportOptions, Trial};
use nalgebra::Vector3;

const FRAMES: usize = 80;

/// Small random number generator; a failure names the seed that reproduces it.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

/// Number format.
#[derive(Clone, Copy, Debug)]
enum Style {
    Fixed,
    Shortest,
}

fn print(x: f64, style: Style) -> String {
    match style {
        Style::Fixed => format!("{x:.5}"),
        Style::Shortest => format!("{}", (x * 1e5).round() / 1e5),
    }
}

fn point(m: usize, f: usize) -> [f64; 3] {
    let (m, t) = (m as f64, f as f64 * 0.01);
    [100.0 * m + 50.0 * (3.0 * t + m).sin(), 900.0 + 70.0 * (2.0 * t).cos() + m, 31.0 * m + 40.0 * t]
}

fn trc(style: Style, rate: f64, tab: bool) -> Vec<String> {
    let labels = ["A", "B", "C", "D"];
    let mut lines = vec![
        "PathFileType\t4\t(X/Y/Z)\tx.trc".to_owned(),
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"
            .to_owned(),
        format!("{rate}\t{rate}\t{FRAMES}\t4\tmm\t{rate}\t1\t{FRAMES}"),
        format!("Frame#\tTime\t{}\t\t", labels.join("\t\t\t")),
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3\tX4\tY4\tZ4".to_owned(),
        String::new(),
    ];
    for f in 0..FRAMES {
        let mut cells = vec![format!("{}", f + 1), print(f as f64 / rate, style)];
        for m in 0..labels.len() {
            let seen = !(m == 1 && (20..25).contains(&f) || m == 3 && (40..50).contains(&f));
            cells.extend(point(m, f).iter().map(|x| if seen { print(*x, style) } else { String::new() }));
        }
        lines.push(cells.join("\t") + if tab { "\t" } else { "" });
    }
    lines
}

fn mot(style: Style, rate: f64, classic: bool) -> Vec<String> {
    let head = if classic {
        vec!["name grf".to_owned(), "datacolumns 10".into(), format!("datarows {}", 2 * FRAMES), "range 0 1".into()]
    } else {
        vec!["grf".to_owned(), "version=1".into(), format!("nRows={}", 2 * FRAMES), "nColumns=10".into()]
    };
    let mut lines = [head, vec!["endheader".into()]].concat();
    let labels = ["ground_force_1_v", "ground_force_1_p", "ground_torque_1_"];
    let names: Vec<String> = labels.iter().flat_map(|l| ["x", "y", "z"].map(|a| format!("{l}{a}"))).collect();
    lines.push(format!("time\t{}", names.join("\t")));
    for i in 0..2 * FRAMES {
        let t = i as f64 / rate;
        let row = [t, 3.0 * t, 700.0 + 200.0 * (9.0 * t).sin(), 5.0, 0.1 * t, 0.0, 0.3, 0.0, 1.0 + t, 0.0];
        lines.push(row.map(|x| print(x, style)).join("\t"));
    }
    lines
}

fn text(lines: &[String]) -> String {
    lines.join("\n") + "\n"
}

fn read(trc: &str, mot: Option<&str>) -> Result<Trial, String> {
    Trial::from_trc_mot("t", trc, mot, &ImportOptions::default()).map_err(|e| e.to_string())
}

/// Compares the import of a damaged file with that of the intact one; an error unless the result is
/// correct or carries a warning. `shift` is the number of samples by which the damaged recording
/// begins later.
fn judge(whole: &Trial, read: &Trial, shift: [usize; 2]) -> Result<(), String> {
    let silent = read.warnings.is_empty();
    let rates_differ = (read.markers.rate_hz / whole.markers.rate_hz - 1.0).abs() > 1e-3;
    let told = read.warnings.iter().any(|w| w.message.contains("the times are used"));
    if rates_differ && !told {
        return Err(format!("rate {} Hz", read.markers.rate_hz));
    }
    if silent && (read.markers.n_frames != whole.markers.n_frames || shift != [0, 0]) {
        return Err(format!("{} frames and no word", read.markers.n_frames));
    }
    let same = |a: &Vector3<f64>, b: &Vector3<f64>| a == b || (a.x.is_nan() && (!silent || b.x.is_nan()));
    for (m, track) in read.markers.trajectories.iter().enumerate() {
        for (f, p) in track.iter().enumerate() {
            let Some(original) = whole.markers.trajectories.get(m).and_then(|t| t.get(f + shift[0])) else {
                return Err(format!("a frame {f} that never was"));
            };
            if !same(p, original) {
                return Err(format!("marker {m}, frame {f}: {p} was {original}"));
            }
        }
    }
    if silent && read.plates.len() != whole.plates.len() {
        return Err("no plate and no word".to_owned());
    }
    for (a, b) in read.plates.iter().zip(&whole.plates) {
        if (a.rate_hz / b.rate_hz - 1.0).abs() > 1e-3 {
            return Err(format!("plate rate {} Hz", a.rate_hz));
        }
        if silent && a.force_n.len() != b.force_n.len() {
            return Err(format!("{} samples of force and no word", a.force_n.len()));
        }
        for (i, f) in a.force_n.iter().enumerate() {
            let at = i + shift[0] * 2;
            let missing = f.x.is_nan() && !silent;
            if !missing && b.force_n.get(at).is_none_or(|g| !same(f, g)) {
                return Err(format!("force at sample {i}"));
            }
        }
    }
    Ok(())
}

#[derive(Default)]
struct Count {
    tried: usize,
    refused: usize,
    warned: usize,
    unharmed: usize,
    failed: Vec<String>,
}

impl Count {
    fn take(&mut self, what: &str, whole: &Trial, result: Result<Trial, String>, shift: [usize; 2]) {
        self.tried += 1;
        match result {
            Err(message) => {
                self.refused += 1;
                if message.contains('\n') || !message.starts_with("t: ") {
                    self.failed.push(format!("{what}: message {message:?}"));
                }
            }
            Ok(trial) => {
                if trial.warnings.is_empty() {
                    self.unharmed += 1;
                } else {
                    self.warned += 1;
                }
                if let Err(wrong) = judge(whole, &trial, shift) {
                    self.failed.push(format!("{what}: {wrong} (warnings {:?})", trial.warnings));
                }
            }
        }
    }

    fn tell(self, name: &str) {
        println!(
            "{name}: {} tried, {} refused, {} with a warning, {} unharmed, {} failed",
            self.tried,
            self.refused,
            self.warned,
            self.unharmed,
            self.failed.len()
        );
        assert!(
            self.failed.is_empty(),
            "{name}: {} failed, the first: {:#?}",
            self.failed.len(),
            &self.failed[..self.failed.len().min(8)]
        );
    }
}

#[test]
fn files_cut_at_any_place_are_told() {
    let mut of_markers = Count::default();
    let mut of_forces = Count::default();
    for style in [Style::Fixed, Style::Shortest] {
        for variant in [false, true] {
            let (t, m) = (text(&trc(style, 100.0, variant)), text(&mot(style, 200.0, variant)));
            let whole = read(&t, Some(&m)).unwrap();
            assert!(whole.warnings.is_empty(), "{:?}", whole.warnings);
            // Every byte for one of them, every third for the others.
            let step = if matches!((style, variant), (Style::Fixed, true)) { 1 } else { 3 };
            for cut in (0..t.len()).step_by(step) {
                of_markers.take(&format!("{style:?} {variant} byte {cut}"), &whole, read(&t[..cut], Some(&m)), [0, 0]);
            }
            for cut in (1..m.len()).step_by(step) {
                of_forces.take(&format!("{style:?} {variant} byte {cut}"), &whole, read(&t, Some(&m[..cut])), [0, 0]);
            }
        }
    }
    of_markers.tell("TRC cut");
    of_forces.tell("MOT cut");
}

/// Damages the rows from `first` on; returns by how many rows the table begins later.
fn edit(lines: &mut Vec<String>, first: usize, columns: usize, random: &mut Random) -> (String, usize) {
    let rows = lines.len() - first;
    let any = |random: &mut Random| first + random.below(rows);
    let cell = |line: &str, at: usize, with: &str| {
        let mut cells: Vec<String> = line.split('\t').map(str::to_owned).collect();
        cells[at] = with.to_owned();
        cells.join("\t")
    };
    let time = columns;
    match random.below(11) {
        0 => {
            let one_in = 2 + random.below(40);
            let mut lost = 0;
            let mut begun = None;
            let kept: Vec<String> = lines
                .drain(first..)
                .enumerate()
                .filter(|(i, _)| {
                    let keep = random.below(one_in) > 0;
                    lost += usize::from(!keep);
                    if keep && begun.is_none() {
                        begun = Some(*i);
                    }
                    keep
                })
                .map(|(_, l)| l)
                .collect();
            lines.extend(kept);
            (format!("{lost} rows deleted"), begun.unwrap_or(0))
        }
        1 => {
            let (from, n) = (any(random), 1 + random.below(25));
            let end = (from + n).min(lines.len());
            lines.drain(from..end);
            (format!("rows {from} to {end} deleted"), if from == first { end - from } else { 0 })
        }
        2 => {
            let at = any(random);
            let line = lines[at].clone();
            lines.insert(at, line);
            (format!("row {at} twice"), 0)
        }
        3 => {
            let (a, b) = (any(random), any(random));
            lines.swap(a, b);
            (format!("rows {a} and {b} exchanged"), 0)
        }
        4 => {
            let times: Vec<String> =
                lines[first..].iter().map(|l| l.split('\t').nth(time).unwrap().to_owned()).collect();
            let turn = 1 + random.below(rows - 1);
            for i in 0..rows {
                lines[first + i] = cell(&lines[first + i], time, &times[(i + turn) % rows]);
            }
            (format!("times turned by {turn}"), 0)
        }
        5 => {
            for i in 0..rows {
                lines[first + i] = cell(&lines[first + i], time, "0.25000");
            }
            ("times constant".to_owned(), 0)
        }
        6 => {
            let at = any(random);
            let mut cells: Vec<&str> = lines[at].split('\t').collect();
            let k = random.below(cells.len());
            cells.remove(k);
            lines[at] = cells.join("\t");
            (format!("cell {k} of row {at} lost"), 0)
        }
        7 => {
            let at = any(random);
            let mut cells: Vec<&str> = lines[at].split('\t').collect();
            let k = random.below(cells.len());
            cells.insert(k, "7.00000");
            lines[at] = cells.join("\t");
            (format!("a cell too many in row {at} at {k}"), 0)
        }
        8 => {
            // Times of a clock that pauses for half a step in the middle or runs at another rate
            // from there on.
            let at = first + rows / 4 + random.below(rows / 2);
            let scale = if random.below(2) == 0 { 1.0 } else { 1.37 };
            let of = |l: &str| l.split('\t').nth(time).unwrap().parse::<f64>().unwrap();
            let (start, step) = (of(&lines[at]), of(&lines[first + 1]) - of(&lines[first]));
            for i in at..lines.len() {
                let later = start + (of(&lines[i]) - start) * scale + if scale == 1.0 { 0.5 * step } else { 0.0 };
                lines[i] = cell(&lines[i], time, &format!("{later:.5}"));
            }
            (format!("uneven clock from row {at}"), 0)
        }
        9 => {
            let at = any(random);
            let k = random.below(time + 1);
            lines[at] = cell(&lines[at], k, ["x", "nan", "1e9", "-3", "", "∞"][random.below(6)]);
            (format!("cell {k} of row {at} replaced"), 0)
        }
        _ => {
            // All rows are unchanged; only the stated counts are wrong.
            ("header".to_owned(), 0)
        }
    }
}

#[test]
fn files_edited_at_random_are_told() {
    let (mut of_markers, mut of_forces) = (Count::default(), Count::default());
    for seed in 0..6000 {
        let mut random = Random(seed * 7919 + 13);
        let style = [Style::Fixed, Style::Shortest][random.below(2)];
        let variant = random.below(2) == 0;
        let (mut t, mut m) = (trc(style, 100.0, variant), mot(style, 200.0, variant));
        let whole = read(&text(&t), Some(&text(&m))).unwrap();
        if seed % 2 == 0 {
            let (mut what, shift) = edit(&mut t, 6, 1, &mut random);
            if what == "header" {
                let mut cells: Vec<String> = t[2].split('\t').map(str::to_owned).collect();
                let k = [0, 2, 3][random.below(3)];
                cells[k] = ["1", "7", "-4", "x", "", "nan", "inf", "3e38", "1000", "0"][random.below(10)].to_owned();
                what = format!("header cell {k} is {}", cells[k]);
                t[2] = cells.join("\t");
            }
            of_markers.take(&format!("seed {seed}, {what}"), &whole, read(&text(&t), Some(&text(&m))), [shift, 0]);
        } else {
            let (mut what, _) = edit(&mut m, 6, 0, &mut random);
            if what == "header" {
                let k = if variant { [1, 2][random.below(2)] } else { [2, 3][random.below(2)] };
                let cut = m[k].find(['=', ' ']).unwrap();
                let value = ["1", "7", "-4", "x", "", "nan", "1000", "0"][random.below(8)];
                m[k] = format!("{}{value}", &m[k][..=cut]);
                what = format!("header line {k} is {}", m[k]);
            }
            of_forces.take(&format!("seed {seed}, {what}"), &whole, read(&text(&t), Some(&text(&m))), [0, 0]);
        }
    }
    of_markers.tell("TRC edited");
    of_forces.tell("MOT edited");
}

#[test]
fn regress_missing_rows_do_not_move_the_force_in_time() {
    // 18 of 160 rows lost: the rate came out as 178 instead of 200 Hz
    let (t, mut m) = (text(&trc(Style::Fixed, 100.0, false)), mot(Style::Fixed, 200.0, false));
    let whole = read(&t, Some(&text(&m))).unwrap();
    for i in (0..18).rev() {
        m.remove(8 + 8 * i);
    }
    let cut = read(&t, Some(&text(&m))).unwrap();
    assert_eq!(cut.plates[0].rate_hz, 200.0);
    let peak = |trial: &Trial| {
        let z = |i: &usize| trial.plates[0].force_n[*i].z;
        (0..trial.plates[0].force_n.len()).filter(|i| z(i).is_finite()).max_by(|a, b| z(a).total_cmp(&z(b))).unwrap()
    };
    assert!(peak(&whole).abs_diff(peak(&cut)) <= 1, "{} {}", peak(&whole), peak(&cut));
    assert!(cut.warnings.iter().any(|w| w.message.contains("18 frames are not in the file")), "{:?}", cut.warnings);
}

#[test]
fn regress_a_truncated_file_states_what_it_holds() {
    let (t, m) = (trc(Style::Fixed, 100.0, false), mot(Style::Fixed, 200.0, false));
    let cut = read(&text(&t[..t.len() - 30]), Some(&text(&m[..m.len() - 7]))).unwrap();
    assert_eq!(cut.truncated(), Some((FRAMES - 30, FRAMES)));
    assert_eq!(cut.forces_truncated(), Some((2 * FRAMES - 7, 2 * FRAMES)));
    let whole = read(&text(&t), Some(&text(&m))).unwrap();
    assert_eq!((whole.truncated(), whole.forces_truncated()), (None, None));
}
