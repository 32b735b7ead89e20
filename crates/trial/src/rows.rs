//! Rows of text recordings (TRC, MOT, STO): assigns rows to samples and finds missing ones.
//!
//! Text files are easily cut, sorted or edited, but each row states its own time. The time column,
//! the frame numbers, the stated rate and the stated number of rows are therefore checked against
//! each other. A missing row is a missing sample; it never changes the rate.

use crate::missing::is_missing;
use crate::{TrialError, Warning, WarningKind};

/// Range of plausible sampling rates, Hz.
pub(crate) const RATES_HZ: std::ops::RangeInclusive<f64> = 1e-3..=1e6;

/// Tolerance of a time as a fraction of a step, in addition to the rounding of the column.
const JITTER: f64 = 0.3;

/// Relative difference between the stated rate and that of the time column up to which frame
/// numbers tell which rows are missing, and times in another unit are recognised.
const RATE_TOLERANCE: f64 = 0.005;

/// Relative difference of two rates that no recording can tell: the quartz of a camera is that
/// accurate.
const QUARTZ: f64 = 5e-5;

/// Units in which programs write times by mistake, s.
pub(crate) const TIME_UNITS_S: [(f64, &str); 3] =
    [(1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds")];

/// Time information of one row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stamp {
    /// Line in the file, counted from 1.
    pub line: usize,
    /// Time, s.
    pub time_s: f64,
    /// Decimals with which the time is printed.
    pub decimals: i32,
    /// Frame number, if the format has one.
    pub number: Option<i64>,
}

/// Assignment of rows to samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Clock {
    /// Sampling rate, Hz; NaN for a single row of a file that states none.
    pub rate_hz: f64,
    /// Sample of each row, ascending from 0.
    pub places: Vec<usize>,
    /// Number of samples, including missing ones.
    pub n: usize,
    /// Time of the first row, s.
    pub start_s: f64,
}

impl Clock {
    /// Time of the last sample, s.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.n.saturating_sub(1) as f64 / self.rate_hz
    }

    /// The same clock, whose times were in another unit.
    pub fn in_unit(self, unit_s: f64) -> Self {
        Self { rate_hz: self.rate_hz / unit_s, start_s: self.start_s * unit_s, ..self }
    }
}

/// Source of the rows, for messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Source<'a> {
    pub trial: &'a str,
    pub format: &'static str,
}

impl Source<'_> {
    pub fn wrong(&self, line: usize, found: impl Into<String>, expected: impl Into<String>) -> TrialError {
        TrialError::Text {
            trial: self.trial.to_owned(),
            format: self.format,
            line,
            found: found.into(),
            expected: expected.into(),
        }
    }
}

/// Decimals of a number as it is printed: 3 of `0.010`, −2 of `1e2`.
pub(crate) fn decimals(cell: &str) -> i32 {
    let (mantissa, exponent) = cell.split_once(['e', 'E']).unwrap_or((cell, "0"));
    let behind = mantissa.split_once('.').map_or(0, |(_, d)| d.len());
    behind as i32 - exponent.parse::<i32>().unwrap_or(0)
}

/// Assigns rows to samples. The times count: a stated rate that differs from theirs, and a unit
/// that is not the second, are warned of.
///
/// # Errors
/// Times or frame numbers that do not increase, a time step that is not a multiple of the others,
/// or too many missing rows; the error names the line.
pub(crate) fn clock(
    of: Source<'_>,
    rows: &[Stamp],
    stated_hz: Option<f64>,
    warnings: &mut Vec<Warning>,
) -> Result<Clock, TrialError> {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return Ok(Clock { rate_hz: stated_hz.unwrap_or(f64::NAN), places: Vec::new(), n: 0, start_s: 0.0 });
    };
    if let Some((unit_s, unit)) = other_unit(rows, stated_hz) {
        let by = |t: f64| t * unit_s;
        warnings.push(Warning::new(
            WarningKind::Clock,
            format!(
                "{} times from {} to {} fit the stated {} Hz as {unit}, not as seconds: read as {unit}",
                of.format,
                first.time_s,
                last.time_s,
                stated_hz.unwrap_or(f64::NAN)
            ),
        ));
        let more = (-unit_s.log10()).round() as i32;
        let rows: Vec<Stamp> =
            rows.iter().map(|r| Stamp { time_s: by(r.time_s), decimals: r.decimals + more, ..*r }).collect();
        return clock(of, &rows, stated_hz, warnings);
    }
    let rounding = 10_f64.powi(-rows.iter().map(|r| r.decimals).max().unwrap_or(0).clamp(-9, 15));
    // With too few digits for the rate, times repeat: then frame numbers and the stated rate are
    // used.
    let coarse = stated_hz.is_some_and(|hz| rounding * hz > 0.9) && first.number.is_some();
    in_order(of, rows, coarse)?;
    if rows.len() == 1 {
        return Ok(Clock { rate_hz: stated_hz.unwrap_or(f64::NAN), places: vec![0], n: 1, start_s: first.time_s });
    }
    let by_number = stated_hz.and_then(|rate_hz| by_number(rows, rate_hz, rounding));
    let numbered = by_number.is_some();
    let places = by_number.map_or_else(|| by_time(of, rows, rounding), Ok)?;
    let rate_hz = rate_of(of, rows, &places, stated_hz, rounding, warnings);
    let odd = (1..rows.len()).filter(|_| !numbered).find(|&i| {
        let step = rows[i].number.zip(rows[i - 1].number).map(|(a, b)| a - b);
        step.is_some_and(|s| s != (places[i] - places[i - 1]) as i64)
    });
    if let Some(odd) = odd {
        warnings.push(Warning::new(
            WarningKind::Clock,
            format!(
                "{} line {}: frame {} follows frame {}, but its time does not fit; the times are used",
                of.format,
                rows[odd].line,
                rows[odd].number.unwrap_or_default(),
                rows[odd - 1].number.unwrap_or_default()
            ),
        ));
    }
    fill(of, rows, places, rate_hz, warnings)
}

/// Frame numbers and times must grow.
fn in_order(of: Source<'_>, rows: &[Stamp], coarse: bool) -> Result<(), TrialError> {
    for pair in rows.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        if let (Some(before), Some(number)) = (a.number, b.number)
            && number <= before
        {
            return Err(of.wrong(
                b.line,
                format!("frame {number}"),
                format!("a frame number above {before}, that of line {}", a.line),
            ));
        }
        if b.time_s < a.time_s || (b.time_s == a.time_s && !coarse) {
            return Err(of.wrong(
                b.line,
                format!("the time {} s", b.time_s),
                format!("a time after {} s, that of line {}", a.time_s, a.line),
            ));
        }
    }
    Ok(())
}

/// A unit with which the times fit the stated rate and the frame numbers, where seconds do not.
fn other_unit(rows: &[Stamp], stated_hz: Option<f64>) -> Option<(f64, &'static str)> {
    let (first, last, stated_hz) = (rows.first()?, rows.last()?, stated_hz?);
    let stated_s = (last.number? - first.number?) as f64 / stated_hz;
    let ratio = (last.time_s - first.time_s) / stated_s;
    TIME_UNITS_S.into_iter().find(|(unit_s, _)| (ratio * unit_s - 1.0).abs() <= RATE_TOLERANCE)
}

/// The rate of the times, Hz; the stated one, or else a whole number, where the times cannot tell
/// it from theirs: they have few digits, and jitter.
fn rate_of(
    of: Source<'_>,
    rows: &[Stamp],
    places: &[usize],
    stated_hz: Option<f64>,
    rounding: f64,
    warnings: &mut Vec<Warning>,
) -> f64 {
    let start_s = rows[0].time_s;
    let steps = places.last().copied().unwrap_or(1).max(1) as f64;
    let length_s = rows[rows.len() - 1].time_s - start_s;
    let step_s = length_s / steps;
    let off = |(r, k): (&Stamp, &usize)| (r.time_s - start_s - *k as f64 * step_s).abs();
    let spread_s = rows.iter().zip(places).map(off).fold(0.0, f64::max);
    let unsure_s = (rounding + spread_s).max(QUARTZ * length_s);
    let agrees = |hz: f64| hz > 0.0 && (steps / hz - length_s).abs() <= unsure_s;
    let whole = (steps / length_s).round();
    let measured_hz = if agrees(whole) { whole } else { steps / length_s };
    match stated_hz {
        Some(stated) if agrees(stated) => stated,
        Some(stated) => {
            let drift_ms = 1e3 * (measured_hz / stated - 1.0).abs();
            warnings.push(Warning::new(
                WarningKind::Clock,
                format!(
                    "{} states {stated} Hz, but its times run at {measured_hz:.3} Hz ({drift_ms:.3} ms a second); \
                     the times are used",
                    of.format
                ),
            ));
            measured_hz
        }
        None => measured_hz,
    }
}

/// Samples from frame numbers, if the times agree with them at the stated rate.
fn by_number(rows: &[Stamp], rate_hz: f64, rounding: f64) -> Option<Vec<usize>> {
    let first = rows.first()?;
    let start = first.number?;
    let places: Vec<usize> =
        // none: frame numbers that run backwards; then the times alone count
        rows.iter().map(|r| usize::try_from(r.number?.checked_sub(start)?).ok()).collect::<Option<_>>()?;
    let (steps, last) = (*places.last()? as f64, rows.last()?);
    let length_s = last.time_s - first.time_s;
    let stated_s = steps / rate_hz;
    if (length_s - stated_s).abs() > RATE_TOLERANCE * stated_s + 2.0 * rounding {
        return None;
    }
    let scale =
        if length_s > 0.0 && !rounding_dominates(rounding, length_s) { length_s / steps } else { 1.0 / rate_hz };
    let fits = |(r, k): (&Stamp, &usize)| {
        (r.time_s - first.time_s - *k as f64 * scale).abs() <= JITTER / rate_hz + 1.5 * rounding
    };
    rows.iter().zip(&places).all(fits).then_some(places)
}

fn rounding_dominates(rounding: f64, length_s: f64) -> bool {
    rounding > RATE_TOLERANCE * length_s
}

/// Samples from times alone: every step is a whole multiple of the typical one.
fn by_time(of: Source<'_>, rows: &[Stamp], rounding: f64) -> Result<Vec<usize>, TrialError> {
    let steps_s: Vec<f64> = rows.windows(2).map(|p| p[1].time_s - p[0].time_s).collect();
    let median_s = aloft_signal::median(&mut steps_s.clone());
    // The mean of single steps is more accurate than one rounded step.
    let single: Vec<f64> = steps_s.iter().copied().filter(|d| (0.5..1.5).contains(&(d / median_s))).collect();
    let step_s = if single.is_empty() { median_s } else { single.iter().sum::<f64>() / single.len() as f64 };
    let uneven = |i: usize| {
        of.wrong(
            rows[i].line,
            format!("a step of {:.6} s to the time {} s", rows[i].time_s - rows[i - 1].time_s, rows[i].time_s),
            format!("even steps of {step_s:.6} s, or whole multiples where rows are missing"),
        )
    };
    let mut places = vec![0];
    for (i, d) in steps_s.iter().enumerate() {
        let k = (d / step_s).round().max(1.0);
        if k.is_nan() || k >= 1e9 || (d - k * step_s).abs() > JITTER * step_s + 2.0 * rounding {
            return Err(uneven(i + 1));
        }
        places.push(places[i] + k as usize);
    }
    // If the rate changes within the recording, small deviations of the steps accumulate.
    let (start, n) = (rows[0].time_s, places[places.len() - 1] as f64);
    let mean_s = (rows[rows.len() - 1].time_s - start) / n;
    let off = |i: usize| (rows[i].time_s - start - places[i] as f64 * mean_s).abs();
    let worst = (1..rows.len()).max_by(|&a, &b| off(a).total_cmp(&off(b)));
    match worst {
        Some(i) if off(i) > (JITTER + 0.2) * mean_s + 2.0 * rounding => Err(uneven(i)),
        _ => Ok(places),
    }
}

/// Reports missing rows; an error if there are too many.
fn fill(
    of: Source<'_>,
    rows: &[Stamp],
    places: Vec<usize>,
    rate_hz: f64,
    warnings: &mut Vec<Warning>,
) -> Result<Clock, TrialError> {
    if !RATES_HZ.contains(&rate_hz) {
        return Err(TrialError::Rate { trial: of.trial.to_owned(), place: of.format, found: rate_hz });
    }
    let n = places.last().map_or(0, |p| p + 1);
    let missing = n - rows.len();
    if missing > 0 {
        let gap = (1..rows.len()).find(|&i| places[i] > places[i - 1] + 1).unwrap_or(0);
        let (a, b) = (rows[gap.saturating_sub(1)], rows[gap]);
        let place = format!("between the lines {} and {} ({} s to {} s)", a.line, b.line, a.time_s, b.time_s);
        if missing > 10.max(rows.len() / 3) {
            return Err(of.wrong(
                b.line,
                format!("{missing} of {n} rows missing, the first {place}"),
                "a row for each frame; export the recording again",
            ));
        }
        warnings.push(Warning::new(
            WarningKind::Rows,
            format!("{}: {missing} frames are not in the file, the first {place}; they are kept as missing", of.format),
        ));
    }
    Ok(Clock { rate_hz, places, n, start_s: rows.first().map_or(0.0, |r| r.time_s) })
}

/// State of the last line of a text without a final line break.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// Its last number is as long as those above it.
    Whole,
    /// Its last number is shorter than those above it, which are all alike.
    Cut,
    /// Numbers differ in length from row to row: undecidable.
    Doubtful,
}

/// Compares the last number of an unterminated file with those above it in the same column.
pub(crate) fn ending<'a>(last: &str, above: impl Iterator<Item = &'a str>) -> Ending {
    if is_missing(last) {
        // a dash or a dot may be the beginning of a number, `na` that of `nan`
        return if last.len() > 2 { Ending::Whole } else { Ending::Doubtful };
    }
    let own = decimals(last);
    // none: how a column is printed shows in its numbers
    let mut of_column = above.filter(|c| c.parse::<f64>().is_ok_and(f64::is_finite)).map(decimals);
    match of_column.next() {
        Some(d) if d > 0 && of_column.all(|o| o == d) => {
            if own == d {
                Ending::Whole
            } else {
                Ending::Cut
            }
        }
        _ => Ending::Doubtful,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn stamps(times: &[f64], decimals: i32, numbers: Option<&[i64]>) -> Vec<Stamp> {
        times
            .iter()
            .enumerate()
            .map(|(i, t)| {
                let unit = 10_f64.powi(decimals);
                Stamp { line: i + 6, time_s: (t * unit).round() / unit, decimals, number: numbers.map(|n| n[i]) }
            })
            .collect()
    }

    const OF: Source<'static> = Source { trial: "t", format: "TRC" };

    #[test]
    fn missing_rows_never_change_the_rate() {
        for (rate, digits) in
            [(100.0, 2), (100.0, 3), (120.0, 3), (240.0, 3), (300.0, 3), (1000.0, 3), (59.94, 4), (200.0, 8)]
        {
            for numbered in [true, false] {
                for seed in 1..40_u64 {
                    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
                    let mut random = move |n: u64| {
                        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                        (state >> 33) % n
                    };
                    let one_in = 4 + random(30);
                    let kept: Vec<i64> = (0..300).filter(|i| *i == 0 || *i == 299 || random(one_in) > 0).collect();
                    let times: Vec<f64> = kept.iter().map(|i| 0.5 + *i as f64 / rate).collect();
                    let rows = stamps(&times, digits, numbered.then_some(&kept[..]));
                    let mut warnings = Vec::new();
                    let clock = clock(OF, &rows, numbered.then_some(rate), &mut warnings).unwrap();
                    assert!((clock.rate_hz / rate - 1.0).abs() < 3e-3, "{rate} {digits} {numbered}: {}", clock.rate_hz);
                    assert_eq!(
                        clock.places.iter().map(|p| *p as i64).collect::<Vec<_>>(),
                        kept,
                        "{rate} {digits} {seed}"
                    );
                    assert_eq!(warnings.len(), usize::from(kept.len() < 300));
                }
            }
        }
    }

    #[test]
    fn times_that_are_no_clock_are_refused_at_their_line() {
        let even: Vec<f64> = (0..200).map(|i| f64::from(i) / 100.0).collect();
        let say = |times: &[f64]| clock(OF, &stamps(times, 4, None), None, &mut Vec::new()).unwrap_err().to_string();
        let mut swapped = even.clone();
        swapped.swap(50, 51);
        assert!(
            say(&swapped).contains("line 57: found the time 0.5 s, expected a time after 0.51 s"),
            "{}",
            say(&swapped)
        );
        assert!(say(&vec![0.3; 100]).contains("line 7"));
        let mut late = even.clone();
        late[80..].iter_mut().for_each(|t| *t += 0.005);
        assert!(say(&late).contains("line 86"), "{}", say(&late));
        let two_rates: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.01 - f64::from((i - 100).max(0)) * 0.001).collect();
        assert!(say(&two_rates).contains("even steps"));
        let most_missing: Vec<f64> = (0..60).map(|i| f64::from(i + 30 * (i / 2)) / 100.0).collect();
        assert!(say(&most_missing).contains("rows missing"), "{}", say(&most_missing));
    }

    #[test]
    fn unit_a_coarse_time_column_is_helped_by_frame_numbers() {
        let numbers: Vec<i64> = (1..=500).collect();
        let times: Vec<f64> = numbers.iter().map(|i| (*i - 1) as f64 / 250.0).collect();
        let mut warnings = Vec::new();
        let clock = clock(OF, &stamps(&times, 2, Some(&numbers)), Some(250.0), &mut warnings).unwrap();
        assert_eq!((clock.rate_hz, clock.n), (250.0, 500));
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn unit_a_cut_number_is_told_by_its_length() {
        let above = ["1.250", "1.375", "NaN", "1.500"];
        assert_eq!(ending("1.625", above.iter().copied()), Ending::Whole);
        assert_eq!(ending("1.6", above.iter().copied()), Ending::Cut);
        assert_eq!(ending("1.6", ["1.25", "1.5"].iter().copied()), Ending::Doubtful);
        assert_eq!(ending("16", ["125", "137"].iter().copied()), Ending::Doubtful);
    }
}
