//! Explanations of a free acceleration that differs from the stated gravity.
//!
//! Motion determines only `g T² / L`: a wrong frame rate, a wrong unit of length, body-weight
//! support and a different gravity change the measured acceleration in the same way. The
//! explanations are therefore candidates. Two facts outside the flights distinguish some of them:
//! stature against the extent of the markers (lengths), and the weight on the plates at rest
//! (support, gravity).

use serde::{Deserialize, Serialize};

/// Kind of an explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The frame rate of the cameras differs from the stated one.
    FrameRate,
    /// Lengths are in another unit or scaled.
    LengthUnit,
    /// A constant vertical force: body-weight support, buoyancy, a rope.
    VerticalForce,
    /// Gravity differs from the stated one.
    Gravity,
    /// The vertical of the recording differs from that of gravity.
    Vertical,
    /// A constant horizontal force: wind, a rope.
    HorizontalForce,
}

impl Cause {
    /// Short description.
    pub fn describe(self) -> &'static str {
        match self {
            Self::FrameRate => "another frame rate",
            Self::LengthUnit => "another unit of length",
            Self::VerticalForce => "support or load",
            Self::Gravity => "another gravity",
            Self::Vertical => "another vertical",
            Self::HorizontalForce => "a sideways force",
        }
    }
}

/// One explanation that fits the measured acceleration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Kind.
    pub cause: Cause,
    /// The value required to explain the acceleration, in words with units.
    pub words: String,
    /// The required value: Hz, factor on lengths, N per N of body weight, m/s², degrees, N per N of
    /// body weight.
    pub value: f64,
    /// True if the value is a common one (a common frame rate, unit of length, or gravity of a
    /// celestial body).
    pub usual: bool,
    /// Other evidence in the recording for (true) or against (false) this explanation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Evidence>,
}

/// Other evidence in the recording for or against an explanation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// True if it supports the explanation.
    pub supports: bool,
    /// Description.
    pub words: String,
}

/// Facts outside the flights that are relevant to the explanations.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Clues {
    /// Vertical force of all plates while the body is at rest, over mass times stated gravity.
    pub rest_share: Option<f64>,
    /// Vertical extent of the markers over the stature.
    pub extent_share: Option<f64>,
    /// Body mass, kg; 0 where unknown.
    pub mass_kg: f64,
}

/// Common camera rates, Hz.
const RATES_HZ: [f64; 23] = [
    24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 125.0, 128.0, 150.0, 180.0, 200.0, 240.0, 250.0, 256.0, 300.0, 360.0,
    400.0, 480.0, 500.0, 512.0, 1000.0, 1024.0,
];
/// Common ratios of two clocks: binary against decimal thousands.
const CLOCKS: [(f64, &str); 2] = [(1.024, "1024 for 1000"), (1.0 / 1.024, "1000 for 1024")];
/// Factors by which lengths can be too long, with the cause of each.
const UNITS: [(f64, &str); 14] = [
    (10.0, "millimetres stated as centimetres"),
    (0.1, "centimetres stated as millimetres"),
    (100.0, "centimetres stated as metres"),
    (0.01, "metres stated as centimetres"),
    (1000.0, "millimetres stated as metres"),
    (0.001, "metres stated as millimetres"),
    (2.54, "centimetres stated as inches"),
    (1.0 / 2.54, "inches stated as centimetres"),
    (25.4, "millimetres stated as inches"),
    (1.0 / 25.4, "inches stated as millimetres"),
    (39.370_079, "inches stated as metres"),
    (0.0254, "metres stated as inches"),
    (3.280_84, "feet stated as metres"),
    (0.3048, "metres stated as feet"),
];
/// Gravity that recordings state or simulate, m/s².
const PLACES: [(f64, &str); 3] = [(9.81, "the Earth"), (1.62, "the Moon"), (3.71, "Mars")];
/// Range of marker extent over stature that is consistent with correct lengths: markers end below
/// the crown, arms may be raised, knees bent.
const EXTENT: [f64; 2] = [0.8, 1.3];
/// Tolerance of the comparison between weight on the plates and body weight, as a fraction.
const WEIGHT: f64 = 0.07;

/// Explanations of a ratio between measured and stated free acceleration, with its 95 % interval;
/// common values first.
pub(crate) fn of_ratio(ratio: f64, ci95: [f64; 2], stated_mps2: f64, rate_hz: f64, clues: &Clues) -> Vec<Explanation> {
    let inside = |x: f64| (ci95[0]..=ci95[1]).contains(&x);
    let mut out = Vec::new();
    let lengths_right = clues.extent_share.filter(|_| !(EXTENT[0]..EXTENT[1]).contains(&ratio)).map(|share| {
        let right = (EXTENT[0]..EXTENT[1]).contains(&share);
        (right, format!("markers reach over {:.0} % of the stature", 100.0 * share))
    });
    let full_weight = clues.rest_share.map(|share| {
        let words = format!("at rest the plates carry {:.0} % of body weight", 100.0 * share);
        ((share - 1.0).abs() < WEIGHT, (share - ratio).abs() < WEIGHT, words)
    });

    let true_rates = [rate_hz / ci95[1].sqrt(), rate_hz / ci95[0].max(1e-12).sqrt()];
    let own = rate_hz / ratio.sqrt();
    let near = RATES_HZ
        .iter()
        .copied()
        .filter(|r| (true_rates[0]..=true_rates[1]).contains(r) && (r / rate_hz - 1.0).abs() > 0.005)
        .min_by(|a, b| (a - own).abs().total_cmp(&(b - own).abs()));
    let clock = CLOCKS.iter().find(|(factor, _)| inside(factor.powi(-2)));
    let (value, name) = match (near, clock) {
        (Some(r), _) => (r, String::new()),
        (None, Some((factor, name))) => (rate_hz * factor, format!(", {name}")),
        (None, None) => (own, String::new()),
    };
    // Without support or a different gravity, only time or lengths remain.
    let evidence = match (&lengths_right, &full_weight) {
        (Some((false, words)), _) => Some(Evidence { supports: false, words: words.clone() }),
        (Some((true, words)), Some((true, _, more))) => {
            Some(Evidence { supports: true, words: format!("{words}, and {more}") })
        }
        _ => None,
    };
    if (10.0..=20_000.0).contains(&own) {
        out.push(Explanation {
            cause: Cause::FrameRate,
            words: format!(
                "frame rate of {} Hz in place of the stated {} Hz ({} to {} Hz fit{name})",
                number(value, 4),
                number(rate_hz, 4),
                number(true_rates[0], 4),
                number(true_rates[1], 4)
            ),
            value,
            usual: near.is_some() || clock.is_some(),
            evidence,
        });
    }

    let unit =
        UNITS.iter().filter(|(f, _)| inside(*f)).min_by(|a, b| (a.0 - ratio).abs().total_cmp(&(b.0 - ratio).abs()));
    let (factor, name) = unit.map_or((ratio, "wand or unit".to_owned()), |(f, name)| (*f, (*name).to_owned()));
    let words = if (0.5..2.0).contains(&ratio) {
        let (size, word) = if ratio < 1.0 { (1.0 - ratio, "short") } else { (ratio - 1.0, "long") };
        format!("lengths {:.1} % too {word} ({name})", 100.0 * size)
    } else if ratio < 1.0 {
        format!("lengths {} times too short ({name})", number(1.0 / factor, 3))
    } else {
        format!("lengths {} times too long ({name})", number(factor, 3))
    };
    let evidence = lengths_right.map(|(right, words)| Evidence { supports: !right, words });
    out.push(Explanation { cause: Cause::LengthUnit, words, value: factor, usual: unit.is_some(), evidence });

    let weight = |supports: bool, words: &str| Evidence { supports, words: words.to_owned() };
    let by_weight = full_weight.as_ref().and_then(|(full, part, words)| match (full, part) {
        (true, false) => Some(weight(false, words)),
        (false, true) => Some(weight(true, words)),
        _ => None,
    });
    let share = 1.0 - ratio;
    let newtons = share.abs() * clues.mass_kg * stated_mps2;
    let force = if clues.mass_kg > 0.0 { format!(", {} N", number(newtons, 3)) } else { String::new() };
    let (what, size) =
        if share > 0.0 { ("body-weight support or buoyancy", share) } else { ("steady downward force", -share) };
    if size < 1.5 {
        out.push(Explanation {
            cause: Cause::VerticalForce,
            words: format!("{what} of {:.0} % of body weight{force}", 100.0 * size),
            value: share,
            usual: false,
            evidence: by_weight.clone(),
        });
    }

    let measured = [ci95[0] * stated_mps2, ci95[1] * stated_mps2];
    let place = PLACES.iter().find(|(g, _)| (measured[0]..=measured[1]).contains(g));
    if ratio < 3.0 {
        out.push(Explanation {
            cause: Cause::Gravity,
            words: match place {
                Some((g, name)) => {
                    format!("gravity of {g:.2} m/s² ({name}) in place of the stated {} m/s²", number(stated_mps2, 3))
                }
                None => format!(
                    "gravity of {} m/s² in place of the stated {} m/s²",
                    number(ratio * stated_mps2, 3),
                    number(stated_mps2, 3)
                ),
            },
            value: place.map_or(ratio * stated_mps2, |p| p.0),
            usual: place.is_some(),
            evidence: by_weight,
        });
    }
    // First supported explanations, then common values, then the rest; contradicted ones come last.
    let rank = |e: &Explanation| {
        let told = e.evidence.as_ref().map(|e| e.supports);
        (told == Some(false), told != Some(true), !e.usual)
    };
    out.sort_by_key(rank);
    out
}

/// Explanations of a free acceleration tilted from the vertical, degrees.
pub(crate) fn of_tilt(tilt_deg: f64, toward: &str, ratio: f64) -> Vec<Explanation> {
    if tilt_deg > 45.0 {
        return vec![Explanation {
            cause: Cause::Vertical,
            words: format!("the body falls towards {toward}: another axis is vertical (`import: {{up_axis: …}}`)"),
            value: tilt_deg,
            usual: true,
            evidence: None,
        }];
    }
    let side = ratio * tilt_deg.to_radians().sin();
    vec![
        Explanation {
            cause: Cause::Vertical,
            words: format!("frame of the cameras not level by {tilt_deg:.1}° (falls towards {toward})"),
            value: tilt_deg,
            usual: false,
            evidence: None,
        },
        Explanation {
            cause: Cause::HorizontalForce,
            words: format!("steady sideways force of {:.1} % of body weight (wind, rope)", 100.0 * side),
            value: side,
            usual: false,
            evidence: None,
        },
    ]
}

/// A number with this many significant digits, without trailing zeros.
pub(crate) fn number(x: f64, digits: i32) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let decimals = (digits - 1 - x.abs().log10().floor() as i32).max(0) as usize;
    let text = format!("{x:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(ratio: f64, clues: &Clues) -> Explanation {
        of_ratio(ratio, [ratio * 0.98, ratio * 1.02], 9.81, 200.0, clues).remove(0)
    }

    #[test]
    fn usual_values_are_named() {
        for (stated, real) in [(200.0, 240.0), (100.0, 120.0), (250.0, 200.0), (100.0, 50.0), (120.0, 100.0_f64)] {
            let ratio = (stated / real).powi(2);
            let all = of_ratio(ratio, [ratio * 0.99, ratio * 1.01], 9.81, stated, &Clues::default());
            let rate = all.iter().find(|e| e.cause == Cause::FrameRate).unwrap();
            assert!(rate.usual && (rate.value - real).abs() < 1e-9, "{rate:?}");
        }
        for (factor, name) in UNITS {
            let all = of_ratio(factor, [factor * 0.98, factor * 1.02], 9.81, 200.0, &Clues::default());
            let unit = all.iter().find(|e| e.cause == Cause::LengthUnit).unwrap();
            assert!(unit.usual && unit.words.contains(name), "{unit:?}");
        }
        let clock = first(1.024_f64.powi(-2), &Clues::default());
        assert!(clock.cause == Cause::FrameRate && clock.words.contains("1024"), "{clock:?}");
    }

    #[test]
    fn gravity_is_not_guessed_to_be_that_of_a_planet_on_which_nobody_records() {
        let all = of_ratio(0.907, [0.901, 0.913], 9.81, 210.0, &Clues::default());
        let gravity = all.iter().find(|e| e.cause == Cause::Gravity).unwrap();
        assert!(!gravity.usual && gravity.words.contains("gravity of 8.9 m/s²"), "{gravity:?}");
    }

    #[test]
    fn stature_and_weight_tell_time_lengths_and_support_apart() {
        let body = |extent, rest| Clues { extent_share: Some(extent), rest_share: Some(rest), mass_kg: 70.0 };
        let ratio = (200.0_f64 / 240.0).powi(2);
        assert_eq!(first(ratio, &body(0.95, 1.0)).cause, Cause::FrameRate);
        assert_eq!(first(ratio, &body(0.66, 1.0)).cause, Cause::LengthUnit);
        let support = first(0.7, &body(0.95, 0.7));
        assert!(matches!(support.cause, Cause::VerticalForce | Cause::Gravity), "{support:?}");
    }
}
