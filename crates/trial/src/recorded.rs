//! Time at which a recording was made, as stated in its own file. File names and file-system times
//! are not used, because copying, exporting and unpacking change them.

use aloft_c3d::C3dFile;
use serde::{Deserialize, Serialize};

/// A time stated in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedAt {
    /// Seconds since 1970-01-01 00:00 on the laboratory's clock (time zones are ignored).
    pub clock_s: f64,
    /// Resolution, s: 1 with seconds, 60 with minutes, 86400 for a date alone.
    pub resolution_s: f64,
    /// Where it is stated, for example `TRIAL:CREATION_DATE`.
    pub place: String,
}

/// Names of parameters or header keys that hold a date, with or without time. Birth dates and
/// software dates are not among them.
const DATES: [&str; 19] = [
    "CREATION_DATE",
    "RECORDING_DATE",
    "RECORD_DATE",
    "DATE_OF_RECORD",
    "DATE_OF_RECORDING",
    "CAPTURE_DATE",
    "ACQUISITION_DATE",
    "TRIAL_DATE",
    "MEASUREMENT_DATE",
    "DATE",
    "DATE_TIME",
    "DATETIME",
    "DATE_AND_TIME",
    "TIMESTAMP",
    "TIME_STAMP",
    "RECORDED",
    "RECORDED_AT",
    "ACQ_TIME",
    "START_DATE",
];
/// Names that hold the time of day for a date in the same group.
const TIMES: [&str; 9] = [
    "CREATION_TIME",
    "RECORDING_TIME",
    "RECORD_TIME",
    "TIME_OF_RECORD",
    "CAPTURE_TIME",
    "ACQUISITION_TIME",
    "TRIAL_TIME",
    "TIME",
    "START_TIME",
];

/// The time of highest resolution among the parameters of a C3D file.
pub(crate) fn of_c3d(file: &C3dFile) -> Option<RecordedAt> {
    let mut best: Option<RecordedAt> = None;
    for group in &file.groups.groups {
        let group_name = group.name.decode();
        let texts: Vec<(String, String)> = group
            .parameters
            .iter()
            .filter_map(|p| Some((p.name.decode(), p.string().or_else(|| p.strings().into_iter().next())?)))
            .collect();
        let found = of_texts(&texts).map(|(name, at)| RecordedAt { place: format!("{group_name}:{name}"), ..at });
        best = finer(best, found);
    }
    best
}

/// The time of highest resolution among `key=value` lines of a text header (MOT, STO) or pairs of a
/// TRC header.
pub(crate) fn of_pairs(pairs: &[(String, String)], place: &str) -> Option<RecordedAt> {
    of_texts(pairs).map(|(name, at)| RecordedAt { place: format!("{place} `{name}`"), ..at })
}

/// Parses a stated time, such as `acq_time` of BIDS.
pub fn recorded_at(text: &str, place: &str) -> Option<RecordedAt> {
    let (date, time) = instant(text);
    let (clock_s, resolution_s) = joined(date?, time);
    Some(RecordedAt { clock_s, resolution_s, place: place.to_owned() })
}

fn finer(a: Option<RecordedAt>, b: Option<RecordedAt>) -> Option<RecordedAt> {
    match (a, b) {
        (Some(a), Some(b)) if b.resolution_s < a.resolution_s => Some(b),
        (None, b) => b,
        (a, _) => a,
    }
}

fn of_texts(texts: &[(String, String)]) -> Option<(String, RecordedAt)> {
    let is = |list: &[&str], name: &str| list.iter().any(|n| n.eq_ignore_ascii_case(name));
    let times: Vec<(f64, f64)> =
        texts.iter().filter(|(name, _)| is(&TIMES, name)).filter_map(|(_, text)| instant(text).1).collect();
    let mut best: Option<(String, RecordedAt)> = None;
    for (name, text) in texts.iter().filter(|(name, _)| is(&DATES, name)) {
        let (Some(date), time) = instant(text) else { continue };
        let (clock_s, resolution_s) = joined(date, time.or(times.first().copied()));
        if best.as_ref().is_none_or(|(_, b)| resolution_s < b.resolution_s) {
            best = Some((name.clone(), RecordedAt { clock_s, resolution_s, place: String::new() }));
        }
    }
    // a parameter called TIME that holds date and time
    if best.is_none() {
        for (name, text) in texts.iter().filter(|(name, _)| is(&TIMES, name)) {
            if let (Some(date), Some(time)) = instant(text) {
                let (clock_s, resolution_s) = joined(date, Some(time));
                return Some((name.clone(), RecordedAt { clock_s, resolution_s, place: String::new() }));
            }
        }
    }
    best
}

/// Joins days since 1970 and seconds of the day (with their resolution) into one time.
fn joined(day: i64, time: Option<(f64, f64)>) -> (f64, f64) {
    let (seconds, resolution) = time.unwrap_or((0.0, 86_400.0));
    (day as f64 * 86_400.0 + seconds, resolution)
}

/// Date (days since 1970) and time of day (s, resolution s) in a text.
///
/// Dates: `2023-02-01`, `2023/02/01`, `20230201`, `01.02.2023`, `01-Feb-2023`, `Feb 1 2023`; in
/// `03/04/2023` the first number is the day (only differences within a session matter). Times:
/// `14:05`, `14:05:09.25`, `2:05 PM`, `140509` after a compact date.
fn instant(text: &str) -> (Option<i64>, Option<(f64, f64)>) {
    let mut clean: String = text.trim().trim_end_matches(['Z', 'z', '\0']).to_owned();
    // `2023-02-01T00:12:58`: the T between digits
    let chars: Vec<char> = clean.chars().collect();
    clean = chars
        .iter()
        .enumerate()
        .map(|(i, c)| {
            let digit = |k: usize| chars.get(k).is_some_and(char::is_ascii_digit);
            if (*c == 'T' || *c == '_') && i > 0 && digit(i - 1) && digit(i + 1) { ' ' } else { *c }
        })
        .collect();
    let (mut day, mut time) = (None, None);
    let mut loose: Vec<String> = Vec::new();
    for token in clean.split([' ', ',', '\t']).filter(|t| !t.is_empty()) {
        if token.contains(':') {
            time = time.or_else(|| time_of(token));
        } else if token.eq_ignore_ascii_case("pm") || token.eq_ignore_ascii_case("am") {
            let afternoon = token.eq_ignore_ascii_case("pm");
            time = time.map(|(s, r): (f64, f64)| {
                let hour = s.rem_euclid(43_200.0);
                (if afternoon { hour + 43_200.0 } else { hour }, r)
            });
        } else if token.len() == 8 && token.bytes().all(|b| b.is_ascii_digit()) && day.is_none() {
            // none: text in a name that is no date
            let part = |range: std::ops::Range<usize>| token[range].parse::<i64>().ok();
            day = part(0..4).zip(part(4..6)).zip(part(6..8)).and_then(|((y, m), d)| days(y, m, d));
        } else if token.len() == 6 && token.bytes().all(|b| b.is_ascii_digit()) && day.is_some() && time.is_none() {
            time = time_of(&format!("{}:{}:{}", &token[..2], &token[2..4], &token[4..]));
        } else {
            let parts: Vec<&str> = token.split(['-', '/', '.']).filter(|p| !p.is_empty()).collect();
            if parts.len() == 3 && day.is_none() {
                day = date_of(&parts);
            } else {
                loose.push(token.to_owned());
            }
        }
    }
    if day.is_none() && loose.len() >= 3 {
        let words: Vec<&str> = loose
            .iter()
            .map(String::as_str)
            .filter(|w| month(w).is_some() || w.bytes().all(|b| b.is_ascii_digit()))
            .collect();
        day = words.get(..3).and_then(date_of);
    }
    (day, time)
}

/// Parses the three parts of a date.
fn date_of(parts: &[&str]) -> Option<i64> {
    // none: text that is no date
    let number = |p: &str| p.parse::<i64>().ok();
    let year = |p: &str| {
        number(p).filter(|_| p.len() == 2 || p.len() == 4).map(|y| {
            if p.len() > 2 {
                y
            } else if y < 70 {
                2000 + y
            } else {
                1900 + y
            }
        })
    };
    if let Some(at) = parts.iter().position(|p| month(p).is_some()) {
        let month = month(parts[at])?;
        let rest: Vec<&str> = parts.iter().enumerate().filter(|(i, _)| *i != at).map(|(_, p)| *p).collect();
        return if rest[0].len() == 4 {
            days(number(rest[0])?, month, number(rest[1])?)
        } else {
            days(year(rest[1])?, month, number(rest[0])?)
        };
    }
    let [a, b, c] = [number(parts[0])?, number(parts[1])?, number(parts[2])?];
    if parts[0].len() == 4 {
        days(a, b, c)
    } else if b > 12 {
        days(year(parts[2])?, a, b)
    } else {
        days(year(parts[2])?, b, a)
    }
}

fn month(word: &str) -> Option<i64> {
    const NAMES: [&str; 12] = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
    let start: String = word.to_ascii_lowercase().chars().take(3).collect();
    let at = NAMES.iter().position(|n| *n == start)?;
    word.chars().all(char::is_alphabetic).then_some(at as i64 + 1)
}

/// Days since 1970-01-01 of a Gregorian date; `None` outside 1980 to 2100 or if the day does not
/// exist.
fn days(year: i64, month: i64, day: i64) -> Option<i64> {
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let lengths = [31, if leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    // none: text that is no date
    let length = *lengths.get(usize::try_from(month - 1).ok()?)?;
    if !(1980..=2100).contains(&year) || !(1..=length).contains(&day) {
        return None;
    }
    // Howard Hinnant, "chrono-compatible low-level date algorithms": years begin in March
    let y = if month <= 2 { year - 1 } else { year };
    let of_year = (153 * (month + if month > 2 { -3 } else { 9 }) + 2) / 5 + day - 1;
    let era = y.div_euclid(400);
    let year_of_era = y.rem_euclid(400);
    Some(era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + of_year - 719_468)
}

/// Seconds of the day and their resolution.
fn time_of(token: &str) -> Option<(f64, f64)> {
    // an offset from universal time does not matter within a session
    let bare = token.split(['+', '-']).next()?;
    let lower = bare.to_ascii_lowercase();
    let afternoon = lower.strip_suffix("pm");
    let half = afternoon.or_else(|| lower.strip_suffix("am"));
    // none: text that is no time of day
    let parts: Vec<f64> = half.unwrap_or(&lower).split(':').map(|p| p.parse::<f64>().ok()).collect::<Option<_>>()?;
    let (hour, minute, second) = match parts[..] {
        [h, m] => (h, m, None),
        [h, m, s] => (h, m, Some(s)),
        _ => return None,
    };
    if !(0.0..24.0).contains(&hour)
        || !(0.0..60.0).contains(&minute)
        || second.is_some_and(|s| !(0.0..61.0).contains(&s))
    {
        return None;
    }
    let mut seconds = hour * 3600.0 + minute * 60.0 + second.unwrap_or(0.0);
    if half.is_some() {
        seconds = seconds.rem_euclid(43_200.0) + if afternoon.is_some() { 43_200.0 } else { 0.0 };
    }
    Some((seconds, if second.is_some() { 1.0 } else { 60.0 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validate_dates_and_times_in_many_spellings() {
        // seconds since 1970 by `date -u -d '2023-02-01 14:05:09' +%s`
        let expected = 1_675_260_309.0;
        for text in [
            "2023-02-01 14:05:09",
            "2023-02-01T14:05:09Z",
            "2023-02-01T14:05:09+01:00",
            "2023/02/01 14:05:09",
            "20230201_140509",
            "20230201T140509",
            "01.02.2023 14:05:09",
            "01/02/2023, 02:05:09 PM",
            "01-Feb-2023 14:05:09",
            "Wed Feb 01 14:05:09 2023",
            "  2023-02-01 2:05:09pm\0",
        ] {
            let at = recorded_at(text, "x").unwrap_or_else(|| panic!("{text}"));
            assert_eq!((at.clock_s, at.resolution_s), (expected, 1.0), "{text}");
        }
        assert_eq!(recorded_at("23/07/2003", "x").unwrap().resolution_s, 86_400.0);
        assert_eq!(recorded_at("6/14/03 8:15", "x").unwrap().resolution_s, 60.0);
        for text in ["", "n/a", "1.2.3", "12:00", "31/02/2020", "2023-13-01", "version 8.0.0", "00/00/0000"] {
            assert_eq!(recorded_at(text, "x"), None, "{text}");
        }
    }

    #[test]
    fn every_day_follows_the_one_before() {
        let mut last = days(1979, 12, 31).or_else(|| days(1980, 1, 1).map(|d| d - 1)).unwrap();
        for year in 1980..=2100 {
            for month in 1..=12 {
                for day in 1..=31 {
                    if let Some(d) = days(year, month, day) {
                        assert_eq!(d, last + 1, "{year}-{month}-{day}");
                        last = d;
                    }
                }
            }
        }
        assert_eq!(days(2000, 1, 1), Some(10_957));
    }
}
