//! The session check: what the recordings say about themselves before any model is judged. Times,
//! weights, zeros, vertical, labels and markers, each with its interval and what it should be.
//!
//! Everything comes from results of the stages `import`, `ik` and `flight`; nothing is computed
//! from an identified model. A line without an interval is a reading, not a measurement with known
//! error.

mod lines;

pub use lines::{LineStatus, SessionCheck, SessionLine};

use crate::compare::calibration;
use crate::impulse_mass::mass_by_impulse;
use crate::marker_noise::white_noise_mm;
use crate::persons::{persons, several_persons};
use crate::repeated::{repeated, repeated_words};
use crate::to_correct::static_labels;
use aloft_flight::{Coverage, FlightReport, ImpulseMass, PlateDelay, PlateTare, TareSource, Unmeasured};
use aloft_identify::half95;
use aloft_ik::{IkReport, LabelExchange};
use aloft_signal::mean_and_deviation;
use aloft_study::subject_session::{Role, SubjectSession};
use aloft_workspace::artifact::{load_markers, load_trial_without_points};
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::workspace::Workspace;
use serde::de::DeserializeOwned;

/// Mean, standard error of the mean (NaN for one value), number.
fn mean(values: &[f64]) -> Option<(f64, f64, usize)> {
    let (mean, deviation) = mean_and_deviation(values)?;
    Some((mean, deviation / (values.len() as f64).sqrt(), values.len()))
}

fn status(ci95: Option<[f64; 2]>, expected: Option<f64>) -> LineStatus {
    match (ci95, expected) {
        (Some([low, high]), Some(e)) if (low..=high).contains(&e) => LineStatus::Agrees,
        (Some(_), Some(_)) => LineStatus::Differs,
        _ => LineStatus::Reading,
    }
}

/// Results of a session that the check reads.
struct Source<'a> {
    session: &'a SubjectSession,
    ws: Workspace,
}

impl Source<'_> {
    /// True for a result that was made and is no failure.
    fn has(&self, stage: &str, trial: &str) -> Result<bool, PipelineError> {
        Ok(self.ws.manifest_if_there(stage, trial)?.is_some_and(|m| m.is_ok()))
    }
    /// True for an imported recording; logs of robots have none.
    fn has_recording(&self, trial: &str) -> Result<bool, PipelineError> {
        Ok(self.has("import", trial)? && is_there(&self.ws.place("import", trial).join("trial.json"))?)
    }
    /// A file of every dynamic trial that has it.
    fn each<T: DeserializeOwned>(&self, stage: &str, file: &str) -> Result<Vec<(String, T)>, PipelineError> {
        let mut out = Vec::new();
        for t in self.session.included().filter(|t| t.role.is_dynamic()) {
            if self.has(stage, &t.name)?
                && let Some(value) = read_json_if_there(&self.ws.place(stage, &t.name).join(file))?
            {
                out.push((t.name.clone(), value));
            }
        }
        Ok(out)
    }
}

/// Collects the check from the results in the session's workspace.
///
/// # Errors
/// A result is there and cannot be read: its line would be missing without a word.
pub fn session_check(session: &SubjectSession) -> Result<SessionCheck, PipelineError> {
    let source = Source { session, ws: Workspace::open(&session.workspace) };
    let mut lines = Vec::new();
    lines.extend(persons_line(session)?);
    lines.extend(repeated_line(session)?);
    timing(&source, &mut lines)?;
    weights(&source, &mut lines)?;
    tares(&source, &mut lines)?;
    free_fall(&source, &mut lines)?;
    contact(&source, &mut lines)?;
    markers(&source, &mut lines)?;
    lines.extend(joint_centres(&source.ws)?);
    Ok(SessionCheck { lines })
}

fn persons_line(session: &SubjectSession) -> Result<Option<SessionLine>, PipelineError> {
    let persons = persons(session)?;
    Ok(several_persons(&persons).map(|words| SessionLine {
        id: "persons",
        what: "persons named in the files".to_owned(),
        value: persons.len() as f64,
        unit: "persons",
        ci95: None,
        expected: Some(1.0),
        n: persons.iter().map(|p| p.trials.len()).sum(),
        status: LineStatus::Differs,
        words,
    }))
}

/// Joint centres that motion and landmarks put at different places; none if they agree.
fn joint_centres(ws: &Workspace) -> Result<Option<SessionLine>, PipelineError> {
    let Some(found) = calibration(ws)? else { return Ok(None) };
    let joints = &found.report.joints;
    Ok(found.report.contradiction.map(|words| SessionLine {
        id: "joint_centres",
        what: "joint centre farthest from its landmarks".to_owned(),
        value: joints.iter().map(|j| 1e3 * j.moved_m).fold(0.0, f64::max),
        unit: "mm",
        ci95: None,
        expected: Some(0.0),
        n: joints.len(),
        status: LineStatus::Differs,
        words,
    }))
}

fn repeated_line(session: &SubjectSession) -> Result<Option<SessionLine>, PipelineError> {
    let pairs = repeated(session)?;
    let line = |words| SessionLine {
        id: "repeated",
        what: "recordings that repeat another one".to_owned(),
        value: pairs.len() as f64,
        unit: "recordings",
        ci95: None,
        expected: Some(0.0),
        n: pairs.len(),
        status: LineStatus::Differs,
        words,
    };
    Ok(repeated_words(&pairs).map(line))
}

fn timing(source: &Source<'_>, lines: &mut Vec<SessionLine>) -> Result<(), PipelineError> {
    let delays: Vec<PlateDelay> =
        source.each::<Vec<PlateDelay>>("flight", "plate_delay.json")?.into_iter().flat_map(|d| d.1).collect();
    let values: Vec<f64> = delays.iter().map(|d| 1e3 * d.delay_s).collect();
    let Some((value, se, n)) = mean(&values) else { return Ok(()) };
    let common = 1e3 * delays.iter().map(|d| d.posture_s).sum::<f64>() / n as f64;
    let own = 1e3 * delays.iter().map(|d| d.scatter_s.powi(2)).sum::<f64>().sqrt() / n as f64;
    let scatter = if n > 1 { half95(se, (n - 1) as f64) } else { half95(own, f64::INFINITY) };
    let half = scatter.zip(half95(common, f64::INFINITY)).map(|(s, c)| s.hypot(c));
    let ci95 = half.map(|h| [value - h, value + h]);
    let status = status(ci95, Some(0.0));
    let spread = scatter.filter(|_| n > 1).map_or(String::new(), |s| format!("; contact to contact ± {s:.1} ms"));
    let words = if status == LineStatus::Differs {
        format!(
            "plates are {} by the time at which the flights before and after a contact cross{spread}; \
             `corrections: {{plate_delay_s: …}}` moves them, or the effect `plate_time_offset` is added to the model",
            if value > 0.0 { "late" } else { "early" }
        )
    } else {
        format!("from the time at which the flights before and after a contact cross{spread}")
    };
    let what = "plates against cameras in time".to_owned();
    lines.push(SessionLine { id: "plate_delay", what, value, unit: "ms", ci95, expected: Some(0.0), n, status, words });
    Ok(())
}

/// Share of the body mass by which a reading without an interval has to be off to differ.
const FAR: f64 = 0.1;

fn weights(source: &Source<'_>, lines: &mut Vec<SessionLine>) -> Result<(), PipelineError> {
    let facts = &source.session.facts;
    let stated = facts.person.mass_kg;
    let g = facts.gravity_mps2;
    let masses: Vec<f64> = source
        .each::<Vec<ImpulseMass>>("flight", "impulse_mass.json")?
        .into_iter()
        .flat_map(|m| m.1)
        .map(|m| m.mass_kg)
        .collect();
    let by_impulse = mass_by_impulse(&masses);
    if let Some((value, half, n)) = by_impulse {
        let ci95 = half.map(|h| [value - h, value + h]);
        let status = status(ci95, Some(stated));
        let words = if status == LineStatus::Differs {
            format!(
                "the stated mass is {:.1} kg: either it or the gain of all plates ({:+.1} %) is off; standing on them with a \
                 known weight tells which",
                stated,
                100.0 * (value / stated - 1.0)
            )
        } else {
            "plates from flight to flight, against the stated mass".to_owned()
        };
        let what = "mass from the impulse between flights".to_owned();
        lines.push(SessionLine {
            id: "impulse_mass",
            what,
            value,
            unit: "kg",
            ci95,
            expected: Some(stated),
            n,
            status,
            words,
        });
    }
    let statics = source.session.included().filter(|t| t.role == Role::Static);
    for t in statics {
        if !source.has_recording(&t.name)? {
            continue;
        }
        let trial = load_trial_without_points(&source.ws.place("import", &t.name))?;
        if trial.plates.is_empty() {
            continue;
        }
        let of = |p: &aloft_trial::Plate| {
            let z: Vec<f64> = p.force_n.iter().map(|f| f.z).filter(|z| z.is_finite()).collect();
            z.iter().sum::<f64>() / z.len().max(1) as f64
        };
        let load_n: f64 = trial.plates.iter().map(of).sum();
        if load_n < 100.0 {
            continue;
        }
        let value = load_n / g;
        let expected = by_impulse.map_or(stated, |(mass, ..)| mass);
        // the impulse knows its own error; the zero of the static plates is not known
        let ci95 = by_impulse.and_then(|(_, half, _)| half).map(|h| [value - h, value + h]);
        // without an interval only what no zero of a plate explains differs
        let far = ci95.is_none() && (value / expected - 1.0).abs() > FAR;
        let status = if far { LineStatus::Differs } else { status(ci95, Some(expected)) };
        let by = if by_impulse.is_some() { "the impulse between flights" } else { "the stated mass" };
        let off = load_n - expected * g;
        let words = format!(
            "static plates carry {:.0} N {} than {by}{}",
            off.abs(),
            if off < 0.0 { "less" } else { "more" },
            match status {
                LineStatus::Differs if far => {
                    ": a part of the body beside them, a plate that was not recorded, or another body mass"
                }
                LineStatus::Differs => {
                    ": an offset of plates that are never unloaded there, or a part of the body beside them"
                }
                _ => "",
            }
        );
        let against = if by_impulse.is_some() { ", against the impulse" } else { "" };
        let what = format!("mass from standing still{against} ({})", t.name);
        lines.push(SessionLine {
            id: "static_mass",
            what,
            value,
            unit: "kg",
            ci95,
            expected: Some(expected),
            n: 1,
            status,
            words,
        });
    }
    Ok(())
}

fn tares(source: &Source<'_>, lines: &mut Vec<SessionLine>) -> Result<(), PipelineError> {
    let all: Vec<(String, Vec<PlateTare>)> = source.each("flight", "tare.json")?;
    let mut names: Vec<String> = Vec::new();
    for t in all.iter().flat_map(|(_, tares)| tares) {
        if !names.contains(&t.plate) {
            names.push(t.plate.clone());
        }
    }
    for name in names {
        let of =
            || all.iter().flat_map(|(trial, t)| t.iter().map(move |t| (trial, t))).filter(|(_, t)| t.plate == name);
        let known: Vec<f64> = of()
            .filter(|(_, t)| t.source != TareSource::None)
            .map(|(_, t)| t.force_n.iter().map(|f| f.z).sum::<f64>() / t.force_n.len().max(1) as f64)
            .collect();
        let unknown: Vec<&str> = of().filter(|(_, t)| t.source == TareSource::None).map(|(n, _)| n.as_str()).collect();
        let what = format!("zero of plate {name}");
        let never = if unknown.is_empty() {
            String::new()
        } else {
            format!("; never unloaded in {}, where it is not known", unknown.join(", "))
        };
        let Some((value, _, n)) = mean(&known) else {
            let words =
                format!("never unloaded in any recording{}", if unknown.is_empty() { "" } else { ": not known" });
            lines.push(SessionLine {
                id: "plate_zero",
                what,
                value: f64::NAN,
                unit: "N",
                ci95: None,
                expected: Some(0.0),
                n: 0,
                status: LineStatus::Reading,
                words,
            });
            continue;
        };
        let (low, high) = known.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |r, x| (r.0.min(*x), r.1.max(*x)));
        let noise = of().map(|(_, t)| t.noise_n / (t.samples.max(1) as f64).sqrt()).fold(0.0, f64::max);
        let ci95 = half95(noise, f64::INFINITY).map(|h| [low - h, high + h]);
        let exact = known.iter().all(|k| *k == 0.0);
        let words = if exact {
            format!("exactly zero: set to zero by an earlier program{never}")
        } else {
            let range = if n == 1 { format!("{low:+.1} N") } else { format!("{low:+.1} to {high:+.1} N") };
            format!("taken off in {n} recording{} ({range}){never}", if n == 1 { "" } else { "s" })
        };
        let status = if value.abs() > 2.0 { LineStatus::Differs } else { LineStatus::Agrees };
        lines.push(SessionLine {
            id: "plate_zero",
            what,
            value,
            unit: "N",
            ci95,
            expected: Some(0.0),
            n,
            status,
            words,
        });
    }
    Ok(())
}

fn free_fall(source: &Source<'_>, lines: &mut Vec<SessionLine>) -> Result<(), PipelineError> {
    let reports: Vec<(String, FlightReport)> = source.each("flight", "flights.json")?;
    let falls: Vec<_> = reports.into_iter().filter_map(|(_, r)| r.free_fall).collect();
    let ratios: Vec<f64> = falls.iter().filter_map(|f| f.ratio).collect();
    let Some((value, se, n)) = mean(&ratios) else { return Ok(()) };
    // one percent is common to all flights of a person (masses of a table, soft tissue)
    let common = if source.session.object.is_some() { 0.003 } else { 0.01 };
    let half = half95(se, n.saturating_sub(1) as f64).filter(|h| h.is_finite()).unwrap_or(0.0);
    let half = half.hypot(half95(common, f64::INFINITY).unwrap_or(0.0));
    let ci95 = Some([value - half, value + half]);
    let state = status(ci95, Some(1.0));
    let words = if state == LineStatus::Differs {
        "free fall over stated gravity: a frame rate (½ of the difference), a length, or a steady support; see `aloft explain`"
    } else {
        "free fall over stated gravity: rate²·length is consistent"
    };
    lines.push(SessionLine {
        id: "free_fall",
        what: "free fall (frame rate and length)".to_owned(),
        value,
        unit: "g",
        ci95,
        expected: Some(1.0),
        n,
        status: state,
        words: words.to_owned(),
    });
    let flights: f64 = falls.iter().map(|f| f.flights as f64).sum();
    let sums = falls
        .iter()
        .fold([0.0; 3], |s, f| [0, 1, 2].map(|i: usize| s[i] + f.acceleration_mps2[i] * f.flights as f64 / flights));
    let tilt = sums[0].hypot(sums[1]).atan2(-sums[2]).to_degrees();
    let halves: Vec<f64> = falls.iter().filter_map(|f| f.tilt_half95_deg).collect();
    if let Some((mean_half, ..)) = mean(&halves) {
        // the bias of a person's centre of mass repeats from flight to flight
        let ci95 = [(tilt - mean_half).max(0.0), tilt + mean_half];
        let state = status(Some(ci95), Some(0.0));
        lines.push(SessionLine {
            id: "vertical",
            what: "vertical against gravity".to_owned(),
            value: tilt,
            unit: "°",
            ci95: Some(ci95),
            expected: Some(0.0),
            n,
            status: state,
            words: "angle between the stated vertical and the mean fall".to_owned(),
        });
    }
    Ok(())
}

fn contact(source: &Source<'_>, lines: &mut Vec<SessionLine>) -> Result<(), PipelineError> {
    let all: Vec<(String, Coverage)> = source.each("flight", "coverage.json")?;
    let with: Vec<&Coverage> = all.iter().map(|c| &c.1).filter(|c| c.complete_s() + c.lost_s() > 0.0).collect();
    if with.is_empty() {
        return Ok(());
    }
    let (kept, lost): (f64, f64) = with.iter().fold((0.0, 0.0), |s, c| (s.0 + c.complete_s(), s.1 + c.lost_s()));
    let why: Vec<String> =
        [Unmeasured::NoReading, Unmeasured::FootBeside, Unmeasured::LoadMissing, Unmeasured::LoadExcess]
            .into_iter()
            .map(|r| (r, with.iter().map(|c| c.left_out_s(r)).sum::<f64>()))
            .filter(|(_, s)| *s > 0.0)
            .map(|(r, s)| format!("{} {s:.2} s", r.describe()))
            .collect();
    let words = if why.is_empty() {
        format!("{kept:.1} s in contact, all of it measured")
    } else {
        format!("of {:.1} s under load; left out: {}", kept + lost, why.join("; "))
    };
    lines.push(SessionLine {
        id: "contact_measured",
        what: "contact that the plates measure completely".to_owned(),
        value: 100.0 * kept / (kept + lost),
        unit: "%",
        ci95: None,
        expected: None,
        n: with.len(),
        status: LineStatus::Reading,
        words,
    });
    Ok(())
}

fn markers(source: &Source<'_>, lines: &mut Vec<SessionLine>) -> Result<(), PipelineError> {
    let exchanges: Vec<(String, Vec<LabelExchange>)> = source.each("ik", "labels.json")?;
    let reports: Vec<(String, IkReport)> = source.each("ik", "report.json")?;
    if reports.is_empty() {
        return Ok(());
    }
    let n: usize = exchanges.iter().map(|e| e.1.len()).sum();
    let words = if n == 0 {
        "labels are on the same markers as in the static trial".to_owned()
    } else {
        let of = |(trial, list): &(String, Vec<LabelExchange>)| {
            let pairs: Vec<String> =
                list.iter().flat_map(|e| &e.labels).filter(|(a, b)| a < b).map(|(a, b)| format!("{a}/{b}")).collect();
            format!("{trial}: {}", pairs.join(", "))
        };
        format!("exchanged back: {}", exchanges.iter().map(of).collect::<Vec<_>>().join("; "))
    };
    let in_static = static_labels(&source.ws)?;
    let words = [in_static.clone(), Some(words).filter(|_| n > 0 || in_static.is_none())];
    let words = words.into_iter().flatten().collect::<Vec<_>>().join("; ");
    let agrees = n == 0 && in_static.is_none();
    lines.push(SessionLine {
        id: "labels",
        what: "labels against the static trial".to_owned(),
        value: n as f64,
        unit: "exchanges",
        ci95: None,
        expected: Some(0.0),
        n: reports.len(),
        status: if agrees { LineStatus::Agrees } else { LineStatus::Differs },
        words,
    });
    let mut noise: Vec<f64> = Vec::new();
    for t in source.session.included().filter(|t| t.role.is_dynamic()) {
        if source.has_recording(&t.name)? {
            noise.extend(white_noise_mm(&load_markers(&source.ws.place("import", &t.name))?.markers));
        }
    }
    if let Some((value, se, n)) = mean(&noise) {
        let half = half95(se, n.saturating_sub(1) as f64).filter(|h| h.is_finite());
        lines.push(SessionLine {
            id: "marker_noise",
            what: "noise of a marker, one axis".to_owned(),
            value,
            unit: "mm",
            ci95: half.map(|h| [(value - h).max(0.0), value + h]),
            expected: None,
            n,
            status: LineStatus::Reading,
            words: "white part, from fourth differences; a lower bound where trajectories were smoothed".to_owned(),
        });
    }
    let rms: Vec<f64> = reports.iter().map(|r| 1e3 * r.1.rms_m).filter(|x| x.is_finite()).collect();
    if let Some((value, se, n)) = mean(&rms) {
        let half = half95(se, n.saturating_sub(1) as f64).filter(|h| h.is_finite());
        let mut worst: Vec<(&str, f64)> =
            reports.iter().flat_map(|r| r.1.worst(3)).map(|m| (m.label.as_str(), 1e3 * m.rms_m)).collect();
        worst.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut seen: Vec<&str> = Vec::new();
        worst.retain(|(label, _)| {
            let first = !seen.contains(label);
            seen.push(label);
            first
        });
        let worst: Vec<String> = worst.iter().take(3).map(|(label, mm)| format!("{label} {mm:.0} mm")).collect();
        lines.push(SessionLine {
            id: "soft_tissue",
            what: "markers off the rigid segments (soft tissue)".to_owned(),
            value,
            unit: "mm",
            ci95: half.map(|h| [(value - h).max(0.0), value + h]),
            expected: None,
            n,
            status: LineStatus::Reading,
            words: format!("worst: {}", worst.join(", ")),
        });
    }
    Ok(())
}

impl SessionLine {
    /// Digits behind the point that the value deserves: one beyond the first digit of its half
    /// interval, three digits of a reading, none of a count, and no more than the unit can mean.
    pub(crate) fn digits(&self) -> usize {
        let most = match self.unit {
            "exchanges" => 0.0,
            "N" | "kg" | "%" | "°" => 2.0,
            _ => 4.0,
        };
        let half = self.ci95.map_or(self.value.abs() * 0.05, |[low, high]| 0.5 * (high - low));
        if half.is_finite() && half > 0.0 {
            (1.0 - half.log10()).ceil().clamp(0.0, most) as usize
        } else {
            1.min(most as usize)
        }
    }

    /// A number of this line with its digits; a dash where it is missing.
    pub fn number(&self, x: f64) -> String {
        if !x.is_finite() {
            return "–".to_owned();
        }
        let digits = self.digits();
        let text = format!("{x:.digits$}");
        // a zero has no sign
        if text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.')) {
            text.trim_start_matches('-').to_owned()
        } else {
            text
        }
    }

    /// The value with its unit.
    pub fn value_words(&self) -> String {
        let unit = if self.unit == "exchanges" && self.value == 1.0 { "exchange" } else { self.unit };
        format!("{} {unit}", self.number(self.value))
    }

    /// The 95 % interval: `5.1 to 8.9`; a dash where there is none.
    pub fn interval_words(&self) -> String {
        self.ci95.map_or("–".to_owned(), |[low, high]| format!("{} to {}", self.number(low), self.number(high)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(value: f64, unit: &'static str, ci95: Option<[f64; 2]>) -> SessionLine {
        let (what, words) = (String::new(), String::new());
        SessionLine { id: "x", what, value, unit, ci95, expected: None, n: 1, status: LineStatus::Reading, words }
    }

    #[test]
    fn numbers_have_the_digits_that_they_deserve() {
        for (value, unit, ci95, text) in [
            (7.0321, "ms", Some([5.14, 8.93]), "7.0 ms"),
            (63.08, "kg", Some([62.04, 64.12]), "63.1 kg"),
            (-1.3e-5, "N", Some([-0.0005, 0.0005]), "0.00 N"),
            (1.0, "exchanges", None, "1 exchange"),
            (0.0, "exchanges", None, "0 exchanges"),
            (86.974, "%", None, "87.0 %"),
            (3.396, "mm", None, "3.40 mm"),
            (f64::NAN, "N", None, "– N"),
        ] {
            assert_eq!(line(value, unit, ci95).value_words(), text);
        }
        assert_eq!(line(0.25, "°", Some([0.0, 1.853])).interval_words(), "0.00 to 1.85");
    }
}
