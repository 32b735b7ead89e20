//! What the recordings themselves contradict: it has to be corrected before a model is judged.
//!
//! An error of the labels, of the static trial, of the frame rate or of the stated mass is in every
//! number of the comparison. A large floor then hides it, or effects imitate it, so it is looked
//! for apart from models and stated first.

use crate::impulse_mass::ImpulseMassView;
use crate::kinematics::KinematicsRow;
use crate::plates_follow::plates_follow;
use crate::unseen::unseen;
use aloft_compare::{Comparison, GroupedBy, TrialComparison, significant};
use aloft_flight::FlightReport;
use aloft_scale::{ScaleReport, ScaleWarning};
use aloft_signal::median;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::{Manifest, WHOLE_STUDY};
use aloft_workspace::workspace::Workspace;
use serde::Serialize;

/// Lower end of the floor's interval in flight, as a share of the weight, above which nothing is
/// judged. Floors of real sessions in the data folder stand at 3 to 10 %, those of labels exchanged
/// in all recordings at 36 to 56 %; the limit was set between them.
const FLOOR_OF_WEIGHT: f64 = 0.15;
/// Deviation of free fall from the stated gravity that effects of the catalogue may cause, as a
/// share; a greater one is corrected before effects are looked for.
const FALL_GROSS: f64 = 0.3;
/// Deviation that counts where no effect was found.
const FALL_DIFFERS: f64 = 0.05;
/// Deviation that counts in single recordings, where the others agree with the stated gravity.
const FALL_OF_ONE: f64 = 0.15;
/// Angle to the stated vertical, degrees, likewise: gross, and where no effect was found.
const LEANS_DEG: [f64; 2] = [20.0, 5.0];
/// Error of a recording in contact over its error in flight, and as a share of the weight, above
/// which its plates do not measure its motion.
const PLATES_TIMES: f64 = 5.0;
const PLATES_OF_WEIGHT: f64 = 0.08;

/// Most recordings that a sentence names.
const NAMED: usize = 4;

/// What to correct first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ToCorrect {
    /// What was found, and what to correct, in one sentence.
    pub words: String,
    /// True if it comes before every question about effects; false if an effect that was found may
    /// be the cause.
    pub first: bool,
    /// True if no error of the comparison can be judged until then.
    pub void: bool,
    /// True if `aloft check` offers the correction.
    pub offered: bool,
}

/// The first contradiction; none if there is none.
pub(crate) fn to_correct(
    session: &SubjectSession,
    ws: &Workspace,
    comparison: &Comparison,
    rows: &[KinematicsRow],
    impulse: Option<&ImpulseMassView>,
    misfit: Option<&str>,
    weight_n: f64,
) -> Result<Option<ToCorrect>, PipelineError> {
    let wrong_mass = || {
        let words = impulse?.wrong.clone()?;
        Some(ToCorrect { words, first: true, void: true, offered: true })
    };
    if let Some(found) = unseen(session, ws)? {
        return Ok(Some(found));
    }
    if let Some(found) = markers(comparison, rows, weight_n) {
        return Ok(Some(found));
    }
    if let Some(found) = of_static(ws)? {
        return Ok(Some(found));
    }
    if let Some(words) = misfit {
        return Ok(Some(ToCorrect { words: words.to_owned(), first: true, void: true, offered: false }));
    }
    if let Some(found) = of_floors(&floors(comparison), weight_n).or_else(|| of_fits(rows)) {
        return Ok(Some(found));
    }
    if let Some(found) = of_falls(&falls(session, ws)?) {
        return Ok(Some(found));
    }
    let follow = plates_follow(ws, &comparison.first.trials, &comparison.first.model)?;
    Ok(follow
        .or_else(wrong_mass)
        // a wrong mass or a gain of all plates makes such an error everywhere, and is said as such
        .or_else(|| plates(&comparison.first.trials, weight_n).filter(|_| impulse.is_none_or(|m| m.doubt.is_none()))))
}

/// Labels of the static trial.
pub(crate) fn of_static(ws: &Workspace) -> Result<Option<ToCorrect>, PipelineError> {
    Ok(static_labels(ws)?.map(|words| ToCorrect {
        words: format!("check the labels of the static trial: {words}"),
        first: true,
        void: false,
        offered: false,
    }))
}

/// Labels that contradict the anatomy in the static trial.
pub(crate) fn static_labels(ws: &Workspace) -> Result<Option<String>, PipelineError> {
    // the report of an object has another form, and an object has no anatomy
    let of_object = |m: Manifest| m.parameters.get("object").is_some_and(|o| !o.is_null());
    if ws.manifest("scale", WHOLE_STUDY)?.is_none_or(of_object) {
        return Ok(None);
    }
    let report: Option<ScaleReport> = read_json_if_there(&ws.place("scale", WHOLE_STUDY).join("report.json"))?;
    let Some(report) = report else { return Ok(None) };
    let wrong = |w: &&ScaleWarning| {
        matches!(
            w,
            ScaleWarning::AnkleBehindHeel { .. }
                | ScaleWarning::BackToFront { .. }
                | ScaleWarning::SidesExchanged { .. }
        )
    };
    let words: Vec<String> = report.warnings.iter().filter(wrong).map(ToString::to_string).collect();
    Ok((!words.is_empty()).then(|| words.join("; ")))
}

/// Marker errors that alone leave a large share of the weight.
fn markers(comparison: &Comparison, rows: &[KinematicsRow], weight_n: f64) -> Option<ToCorrect> {
    let floor = comparison.against_floor.iter().find(|a| a.judged_on == "flight")?.floor?;
    // a floor that is hardly known may be far lower: its least counts
    let least_n = floor.ci95.map_or(floor.noise_floor, |ci| ci[0]);
    if least_n.is_nan() || least_n <= FLOOR_OF_WEIGHT * weight_n {
        return None;
    }
    let (floor_n, share) = (floor.noise_floor, floor.noise_floor / weight_n);
    let mut rms: Vec<(f64, &str)> = rows.iter().filter_map(|r| Some((r.marker_rms_mm?, r.trial.as_str()))).collect();
    rms.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fit = match (rms.first(), rms.last()) {
        (Some((least, _)), Some((most, trial))) => {
            let [low, high] = [least, most].map(|mm| significant(*mm, 2));
            let range = if low == high { format!("{low} mm") } else { format!("{low} to {high} mm") };
            let errors = format!("they fit the model with errors of {range} (root mean square)");
            // one recording that stands out is named
            if *most > 3.0 * least { format!("{errors}, the largest in {trial}") } else { errors }
        }
        _ => "they do not fit the model".to_owned(),
    };
    let words = format!(
        "check the markers first (labels, static trial, units, placement): {fit}, which alone leaves {} N in flight, {:.0} % of the weight",
        significant(floor_n, 3),
        100.0 * share
    );
    Some(ToCorrect { words, first: true, void: true, offered: false })
}

/// Floor in flight as a share of the body's weight from which noise alone makes a large error.
/// Simulated chains with up to 1 mm of marker noise stand below 0.6 %, a person with 3 mm of soft
/// tissue at 1.5 %; 5 mm on a chain of 0.3 m, which moves inertias by more than their intervals, at
/// 9 to 16 %.
pub(crate) const LOUD: f64 = 0.05;

/// Floor of a recording over that of the session's others of the same kind from which it is spoilt:
/// what its own markers leave is then most of the session's floor, and hides as much in all others.
const FLOOR_OF_OTHERS: f64 = 2.0;
/// Fewest others of the same kind.
const FEWEST_OTHERS: usize = 2;

/// The noise floor of each recording, N: what the errors of its own markers and plates leave.
fn floors(comparison: &Comparison) -> Vec<(&str, f64)> {
    let groups = comparison.noise_floor.iter().flat_map(|f| &f.groups);
    let of_trials = groups.filter(|g| g.by == GroupedBy::Trial && g.windows.windows > 0);
    of_trials.map(|g| (g.name.as_str(), g.windows.size())).filter(|(_, n)| *n > 0.0).collect()
}

/// How a recording is left out, as it is written into the pipeline.
fn leave_out(trial: &str) -> String {
    format!("`trials: {{exclude: [{{trial: {}, reason: …}}]}}` leaves it out", aloft_study::quote::yaml(trial))
}

/// Kind of a recording by its name: `jump` of `jump01`, `squat` of `squat_2`.
fn kind(name: &str) -> &str {
    name.trim_end_matches(|c: char| c.is_ascii_digit() || matches!(c, '_' | '-' | ' ' | '.'))
}

/// Recordings whose floor stands out from those of the same kind; where these are loud themselves,
/// the markers of the whole session come first.
fn of_floors(floors: &[(&str, f64)], weight_n: f64) -> Option<ToCorrect> {
    let others = |name: &str| -> Vec<f64> {
        floors.iter().filter(|(n, _)| *n != name && kind(n) == kind(name)).map(|f| f.1).collect()
    };
    let odd: Vec<(&str, f64, f64)> = floors
        .iter()
        .filter_map(|&(name, own)| {
            let mut others = others(name);
            let enough = others.len() >= FEWEST_OTHERS;
            let usual = enough.then(|| median(&mut others))?;
            (own > FLOOR_OF_OTHERS * usual && usual <= LOUD * weight_n).then_some((name, own, usual))
        })
        .collect();
    if odd.is_empty() {
        return None;
    }
    let newtons = |n: f64| significant(n, 3);
    let each = odd.iter().take(NAMED);
    let mut names: Vec<String> = each
        .map(|(name, own, usual)| format!("{name} ({} N, {} N in others like it)", newtons(*own), newtons(*usual)))
        .collect();
    if odd.len() > NAMED {
        names.push(format!("{} more", odd.len() - NAMED));
    }
    let words = format!(
        "check or exclude {}: the errors of its own markers or plates raise the floor of the whole session, which hides what is as \
         large elsewhere (a marker that stands still, jumps or is another one: its chapter of the report shows which and when); {}",
        names.join(", "),
        leave_out(odd[0].0)
    );
    Some(ToCorrect { words, first: true, void: false, offered: false })
}

/// Recordings without enough others of their kind, whose markers fit the model much worse than
/// those of the whole session: their floor cannot be compared, and what raises it looks like noise.
/// Jumps, squats and walks of one real session fit within a quarter of each other.
fn of_fits(rows: &[KinematicsRow]) -> Option<ToCorrect> {
    let fits: Vec<(&str, f64)> = rows.iter().filter_map(|r| Some((r.trial.as_str(), r.marker_rms_mm?))).collect();
    let odd: Vec<(&str, f64, f64)> = fits
        .iter()
        .filter_map(|&(name, own)| {
            let others = || fits.iter().filter(|(n, _)| *n != name);
            let alone = others().filter(|(n, _)| kind(n) == kind(name)).count() < FEWEST_OTHERS;
            let mut all: Vec<f64> = others().map(|f| f.1).collect();
            let usual = (alone && all.len() >= FEWEST_OTHERS).then(|| median(&mut all))?;
            (own > FLOOR_OF_OTHERS * usual).then_some((name, own, usual))
        })
        .collect();
    let (first, ..) = odd.first()?;
    let mm = |x: f64| significant(x, 2);
    let mut names: Vec<String> = odd
        .iter()
        .take(NAMED)
        .map(|(name, own, usual)| format!("{name} (markers fit with {} mm, {} mm in the others)", mm(*own), mm(*usual)))
        .collect();
    if odd.len() > NAMED {
        names.push(format!("{} more", odd.len() - NAMED));
    }
    let words = format!(
        "check or exclude {}: errors of its own markers raise its floor, which then hides what is as large (labels exchanged, a marker \
         that jumps or is another one: its chapter of the report shows which and when); {}",
        names.join(", "),
        leave_out(first)
    );
    Some(ToCorrect { words, first: true, void: false, offered: false })
}

/// Free fall of one recording.
#[derive(Debug, Clone)]
struct Fall {
    trial: String,
    /// Acceleration of the centre of mass over the stated gravity.
    ratio: f64,
    /// Angle to the stated vertical, degrees.
    leans_deg: f64,
    differs: bool,
}

fn falls(session: &SubjectSession, ws: &Workspace) -> Result<Vec<Fall>, PipelineError> {
    let of = |trial: &str, report: FlightReport| {
        let fall = report.free_fall?;
        let (ratio, leans_deg) = (fall.ratio?, fall.tilt_deg?);
        Some(Fall { trial: trial.to_owned(), ratio, leans_deg, differs: fall.differs })
    };
    let mut all = Vec::new();
    for t in session.included() {
        let report: Option<FlightReport> = read_json_if_there(&ws.place("flight", &t.name).join("flights.json"))?;
        all.extend(report.and_then(|r| of(&t.name, r)));
    }
    Ok(all)
}

fn of_falls(falls: &[Fall]) -> Option<ToCorrect> {
    let n = falls.len();
    let off = |f: &Fall| (f.ratio - 1.0).abs();
    let middle = |of: &dyn Fn(&Fall) -> f64| median(&mut falls.iter().map(of).collect::<Vec<f64>>());
    if n == 0 {
        return None;
    }
    let (ratio, leans) = (middle(&|f| f.ratio), middle(&|f| f.leans_deg));
    let differ = falls.iter().filter(|f| f.differs).count();
    if 2 * differ > n {
        if leans > LEANS_DEG[1] {
            let words = format!(
                "correct the vertical: in flight the centre of mass falls {leans:.0}° off the stated vertical in {differ} of {n} recordings \
                 (`import: {{up_axis: …}}`; `aloft check` says what gravity, plates and feet show)"
            );
            return Some(ToCorrect { words, first: leans > LEANS_DEG[0], void: false, offered: true });
        }
        if (ratio - 1.0).abs() > FALL_DIFFERS {
            let words = format!(
                "correct the frame rate, the lengths or the stated gravity: in flight the centre of mass falls with {} times the stated gravity \
                 in {differ} of {n} recordings (`aloft check` offers a correction; a steady force on the body would show as well)",
                significant(ratio, 3)
            );
            return Some(ToCorrect { words, first: (ratio - 1.0).abs() > FALL_GROSS, void: false, offered: true });
        }
    }
    // a few recordings among others that agree
    let odd: Vec<&Fall> = falls.iter().filter(|f| f.differs && off(f) > FALL_OF_ONE).collect();
    if odd.is_empty() || 4 * odd.len() > n || (ratio - 1.0).abs() > FALL_DIFFERS {
        return None;
    }
    let names: Vec<String> = odd.iter().map(|f| format!("{} ({} times)", f.trial, significant(f.ratio, 3))).collect();
    let words = format!(
        "correct or exclude {}: the centre of mass does not fall there as in the other recordings ({} times the stated gravity): \
         another frame rate or unit; {}",
        names.join(", "),
        significant(ratio, 3),
        leave_out(&odd[0].trial)
    );
    Some(ToCorrect { words, first: true, void: false, offered: false })
}

/// Recordings in which the model fits the flights and not the plates.
fn plates(trials: &[TrialComparison], weight_n: f64) -> Option<ToCorrect> {
    let flights = |t: &TrialComparison| (t.flight_weak.windows > 0).then(|| t.flight_weak.force_n.norm_rms());
    let contact = |t: &TrialComparison| (t.contact_weak.windows > 0).then(|| t.contact_weak.force_n.norm_rms());
    let mut all: Vec<f64> = trials.iter().filter_map(flights).collect();
    if all.is_empty() {
        return None;
    }
    let usual = median(&mut all);
    let odd: Vec<(&str, f64)> = trials
        .iter()
        .filter_map(|t| {
            let (own, flight) = (contact(t)?, flights(t).unwrap_or(usual));
            (own > PLATES_TIMES * flight && own > PLATES_OF_WEIGHT * weight_n).then_some((t.trial.as_str(), own))
        })
        .collect();
    if let Some(words) = heavier(trials, &odd, weight_n) {
        return Some(ToCorrect { words, first: false, void: false, offered: false });
    }
    let largest = odd.iter().map(|o| o.1).fold(0.0, f64::max);
    let mut names: Vec<String> = odd.iter().take(NAMED).map(|o| o.0.to_owned()).collect();
    if odd.len() > NAMED {
        names.push(format!("{} more", odd.len() - NAMED));
    }
    (!odd.is_empty()).then(|| ToCorrect {
        words: format!(
            "check the force plates in {}: in contact the force is off by up to {} N, {:.0} % of the weight, while flights fit: plates of another \
             recording, a wrong scale, or contact beside the plates",
            names.join(", "),
            significant(largest, 3),
            100.0 * largest / weight_n
        ),
        first: false,
        void: false,
        offered: false,
    })
}

/// Share of the error in contact that a constant along the vertical makes up where the error is
/// mostly of that kind: more than half of the mean square, so that what varies is the lesser part.
const MOSTLY: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// What the plates say of the stated mass, where the error of most recordings is mostly one
/// constant along the vertical: the same everywhere, it is no error of single recordings.
fn heavier(trials: &[TrialComparison], odd: &[(&str, f64)], weight_n: f64) -> Option<String> {
    let measured: Vec<&TrialComparison> = trials.iter().filter(|t| t.contact_weak.windows > 0).collect();
    // predicted less measured: above zero where the body is lighter than stated
    let shares: Vec<f64> = measured
        .iter()
        .filter(|t| odd.iter().any(|(name, _)| *name == t.trial) && !t.untared)
        .filter(|t| t.contact_weak.force_n.bias[2].abs() > MOSTLY * t.contact_weak.force_n.norm_rms())
        .map(|t| t.contact_weak.force_n.bias[2] / weight_n)
        .collect();
    let one_way = shares.iter().all(|s| *s > 0.0) || shares.iter().all(|s| *s < 0.0);
    if shares.len() < 2 || !one_way || 2 * shares.len() <= measured.iter().filter(|t| !t.untared).count() {
        return None;
    }
    let share = median(&mut shares.clone());
    Some(format!(
        "check the stated mass and the scale of the force plates: in {} of {} recordings the plates carry {:.0} % {} than the stated weight, \
         while flights fit (a load that the body carries would show as well)",
        shares.len(),
        measured.len(),
        100.0 * share.abs(),
        if share > 0.0 { "less" } else { "more" }
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_compare::{AxisErrors, WindowErrors, WrenchErrors};

    fn fall(trial: &str, ratio: f64, leans_deg: f64) -> Fall {
        let differs = (ratio - 1.0).abs() > 0.02 || leans_deg > 1.0;
        Fall { trial: trial.to_owned(), ratio, leans_deg, differs }
    }

    /// A recording whose flights are off by 6 N, and whose contact is off by a constant along the
    /// vertical and by something that varies, N.
    fn on_plates(name: &str, bias_n: f64, varies_n: f64) -> TrialComparison {
        let axes = |bias: f64, rmse: f64| AxisErrors {
            mae: [0.0, 0.0, rmse],
            rmse: [0.0, 0.0, rmse],
            bias: [0.0, 0.0, bias],
            max: [0.0, 0.0, rmse],
        };
        let none = axes(0.0, 0.0);
        let frames =
            WrenchErrors { frames: 100, force_n: none, moment_nm: none, force_world_n: none, moment_world_nm: none };
        let weak = |force_n: AxisErrors| WindowErrors { windows: 20, force_n, moment_nm: none };
        let contact = weak(axes(bias_n, bias_n.hypot(varies_n)));
        TrialComparison {
            trial: name.to_owned(),
            held_out_contact: true,
            held_out_flight: false,
            flights: 2,
            untared: false,
            offset: None,
            contact: frames.clone(),
            flight: frames.clone(),
            contact_weak: contact.clone(),
            contact_as_measured: frames,
            contact_weak_as_measured: contact,
            flight_weak: weak(axes(0.0, 6.0)),
            plates_correlation: Some(0.999),
        }
    }

    /// A body of 70 kg that is stated as 80: the predicted force is too large by the same amount
    /// everywhere. The plates are not blamed, and a plate of another scale in one recording is.
    #[test]
    fn a_wrong_mass_is_told_from_a_wrong_plate() {
        let weight_n = 80.0 * 9.81;
        let lighter: Vec<TrialComparison> =
            ["a", "b", "c"].map(|name| on_plates(name, 98.1, 20.0)).into_iter().collect();
        let told = |trials: &[TrialComparison]| plates(trials, weight_n).map(|c| c.words);
        let words = told(&lighter).unwrap();
        assert!(
            words.starts_with(
                "check the stated mass and the scale of the force plates: in 3 of 3 recordings the plates carry 12 % less than the stated weight"
            ),
            "{words}"
        );
        let heavier: Vec<TrialComparison> =
            ["a", "b", "c"].map(|name| on_plates(name, -98.1, 20.0)).into_iter().collect();
        assert!(told(&heavier).unwrap().contains("carry 12 % more than the stated weight"));

        let single = [on_plates("a", 98.1, 20.0), on_plates("b", 1.0, 5.0), on_plates("c", -2.0, 5.0)];
        assert!(
            told(&single).unwrap().starts_with("check the force plates in a: in contact the force is off by up to")
        );
        let both_ways = [on_plates("a", 98.1, 20.0), on_plates("b", -98.1, 20.0), on_plates("c", 98.1, 20.0)];
        assert!(told(&both_ways).unwrap().starts_with("check the force plates in a, b, c"));
        let varies = ["a", "b", "c"].map(|name| on_plates(name, 40.0, 98.1));
        assert!(told(&varies).unwrap().starts_with("check the force plates in a, b, c"));
        assert_eq!(told(&["a", "b", "c"].map(|name| on_plates(name, 10.0, 10.0))), None);
    }

    #[test]
    fn a_recording_whose_floor_stands_out_from_others_like_it_is_named() {
        let jumps = [("jump01", 190.0), ("jump02", 10.9), ("jump03", 12.0), ("jump04", 9.8)];
        let found = of_floors(&jumps, 700.0).unwrap();
        assert!(
            found.first && found.words.starts_with("check or exclude jump01 (190 N, 10.9 N in others like it)"),
            "{}",
            found.words
        );
        // a kind of its own, too few of a kind, and what differs by less
        assert_eq!(of_floors(&[("jump01", 10.0), ("jump02", 11.0), ("walk01", 40.0), ("walk02", 44.0)], 700.0), None);
        assert_eq!(of_floors(&[("jump01", 40.0), ("jump02", 11.0)], 700.0), None);
        assert_eq!(of_floors(&[("jump01", 19.0), ("jump02", 10.0), ("jump03", 11.0)], 700.0), None);
        // every recording is loud
        assert_eq!(of_floors(&jumps, 100.0), None);
    }

    #[test]
    fn a_recording_without_others_like_it_is_compared_by_its_markers() {
        let row = |(trial, mm): (&str, f64)| KinematicsRow {
            trial: trial.to_owned(),
            role: "validate",
            marker_rms_mm: Some(mm),
            flights: None,
            gravity_error_percent: None,
        };
        let told = |fits: &[(&str, f64)]| of_fits(&fits.iter().copied().map(row).collect::<Vec<_>>()).map(|c| c.words);
        let jumps = [("jump01", 1.2), ("jump02", 1.1), ("jump03", 1.3)];
        let with = |one: (&'static str, f64)| [&jumps[..], &[one]].concat();
        let words = told(&with(("exercise01", 17.5))).unwrap();
        assert!(
            words.starts_with("check or exclude exercise01 (markers fit with 18 mm, 1.2 mm in the others)"),
            "{words}"
        );
        assert_eq!(told(&with(("exercise01", 2.3))), None);
        // its floor is compared with those of others like it
        assert_eq!(told(&with(("jump04", 17.5))), None);
        assert_eq!(told(&[("exercise01", 17.5), ("jump01", 1.2)]), None);
    }

    #[test]
    fn one_recording_with_another_rate_is_named_and_does_not_hide_in_the_mean() {
        let mut falls: Vec<Fall> = (1..=6).map(|i| fall(&format!("jump0{i}"), 1.0, 0.2)).collect();
        assert_eq!(of_falls(&falls), None);
        falls[1] = fall("jump02", 1.56, 0.3);
        let found = of_falls(&falls).unwrap();
        assert!(found.first && found.words.contains("jump02 (1.56 times)"), "{}", found.words);
        // an effect that acts in half of the recordings is no error of a header
        falls[3] = fall("jump04", 1.56, 0.3);
        falls[4] = fall("jump05", 1.56, 0.3);
        assert_eq!(of_falls(&falls), None);
    }

    #[test]
    fn what_effects_may_cause_waits_for_the_question_which_is_missing() {
        let all = |ratio: f64, leans: f64| (0..5).map(|i| fall(&i.to_string(), ratio, leans)).collect::<Vec<_>>();
        let rate = of_falls(&all(1.44, 0.3)).unwrap();
        assert!(
            rate.first && rate.words.contains("falls with 1.44 times the stated gravity in 5 of 5"),
            "{}",
            rate.words
        );
        assert!(!of_falls(&all(0.81, 0.3)).unwrap().first);
        assert_eq!(of_falls(&all(1.03, 0.3)), None);
        let up = of_falls(&all(1.0, 90.0)).unwrap();
        assert!(up.first && up.words.contains("90° off the stated vertical"), "{}", up.words);
        assert!(!of_falls(&all(1.0, 8.0)).unwrap().first);
    }
}
