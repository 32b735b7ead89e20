//! The error of a model beside its floor, as every command shows it.

use crate::render::{out, significant};
use crate::screen::{Cell, Grid, labelled, paint, table};
use crate::stop::Stop;
use aloft_analysis::compare::{ComparisonView, LeftOut};
use aloft_analysis::held_out::HeldOutError;
use aloft_compare::Signal;

/// `–` for a missing number.
pub fn figure(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |v| significant(v, 3))
}

/// The grade in its words and its colour: `at the floor`, `fair`, `poor`.
pub fn judgement(e: &HeldOutError) -> Cell {
    Cell::judged(e.judged.clone(), e.signal)
}

/// One row for each kind of motion.
pub fn grid(errors: &[HeldOutError]) -> Grid {
    let header =
        ["held out", "error N", "force N", "moment N·m", "floor N", "floor 95 %", "times floor", "tables N", "judged"];
    let mut t = table(&header).left(&[8]).optional(&[5, 7, 2, 3]);
    for e in errors {
        let interval = e
            .noise_floor_ci95
            .map_or("–".to_owned(), |[a, b]| format!("{} to {}", significant(a, 3), significant(b, 3)));
        t.add_row([
            format!("in {}", e.judged_on).into(),
            figure(Some(e.held_out_error)).into(),
            figure(e.held_out_force_n).into(),
            figure(e.held_out_moment_nm).into(),
            figure(e.noise_floor).into(),
            interval.into(),
            e.times_floor.map_or("–".to_owned(), |t| significant(t, 2)).into(),
            figure(e.tables_error).into(),
            judgement(e),
        ]);
    }
    t
}

/// What the columns of [`grid`] mean.
pub const MEANING: &str = "error: root mean square over held-out weak windows of √(force² + (moment / 0.1 m)²), so that 1 N·m counts as 10 N; floor: error of a perfect model on these recordings; tables: error of the body from tables";

/// Subject and what was identified, two lines.
pub fn identified(view: &ComparisonView) -> [String; 2] {
    let p = &view.parameters;
    if let Some(why) = &p.nothing {
        let subject = format!("{}, {} kg", short(&view.subject), significant(p.mass_kg, 3));
        return [
            labelled("subject     ", &subject),
            labelled("identified  ", &why.replacen("nothing is identified", "nothing", 1)),
        ];
    }
    let plural = |n: usize, word: &str| format!("{n} {word}{}", if n == 1 { "" } else { "s" });
    let subject = labelled(
        "subject     ",
        &format!(
            "{}, {} kg; {} in {}",
            short(&view.subject),
            significant(p.mass_kg, 3),
            p.identified_from,
            plural(p.trials, "trial")
        ),
    );
    let tables = p.in_all - p.from_motion - p.from_scale;
    let scale = if p.from_scale > 0 { format!(", {} from the stated mass", p.from_scale) } else { String::new() };
    let rest = if tables > 0 { format!("{scale}, {tables} from tables") } else { scale };
    let gate = match (p.gate_passed, p.held_by_prior, p.hidden_by_error) {
        (true, ..) if p.reservation.is_some() => "something missing",
        (true, ..) => "gate passed",
        _ if p.misfit.is_some() => "gate not passed: joints or markers are not where the model has them",
        (false, true, _) => "gate not passed: the stated weight of the prior holds the body at the tables",
        (false, false, true) => "gate not passed: the error is too large to determine the body",
        (false, false, false) => "gate not passed: too little motion to determine the body",
    };
    let words = format!("{} of {} parameters from motion{rest}; {gate}", p.from_motion, p.in_all);
    let signal = if p.gate_passed && p.reservation.is_none() { Signal::Good } else { Signal::Poor };
    let identified = labelled("identified  ", &words).replacen(gate, &paint(gate, signal), 1);
    [subject, identified]
}

/// Lever with which moments count in an error, m, and how many times the force they are to be most
/// of it.
const LEVER_M: f64 = 0.1;
const MOSTLY: f64 = 2.0;

/// An error that is mostly a moment, in one line: in newtons it reads as a force.
fn in_the_moment(view: &ComparisonView) -> Option<String> {
    let place = if view.comparison.first.held_out_weak.windows > 0 { "contact" } else { "flight" };
    let e = view.errors.iter().find(|e| e.judged_on == place && e.at_floor != Some(true))?;
    let (force_n, moment_nm) = e.held_out_force_n.zip(e.held_out_moment_nm)?;
    (moment_nm > MOSTLY * LEVER_M * force_n).then(|| {
        let (moment, force) = (significant(moment_nm, 3), significant(force_n, 3));
        crate::screen::one_line("where       ", &format!("mostly in the moment: {moment} N·m, beside {force} N"))
    })
}

/// Where the error is largest, in one line; none of an error at its floor, where this is chance.
pub fn worst(view: &ComparisonView) -> Option<String> {
    if view.errors.iter().all(|e| e.at_floor == Some(true)) {
        return None;
    }
    let c = &view.comparison;
    let place = c
        .worst
        .first()
        .map(|w| format!("{} {}: {} times the median {}", w.what, w.name, significant(w.times_median, 2), w.what));
    let (label, text) = if let Some(place) = place {
        ("worst       ", place)
    } else {
        // no place stands out: name the moment where it is most of the error, else the axis
        if let Some(line) = in_the_moment(view) {
            return Some(line);
        }
        let errors = if c.first.held_out_weak.windows > 0 { &c.first.held_out_weak } else { &c.first.flight_weak };
        let axis = (0..3).max_by(|&a, &b| errors.force_n.rmse[a].total_cmp(&errors.force_n.rmse[b]))?;
        let value = errors.force_n.rmse.get(axis).filter(|v| v.is_finite())?;
        let axis = ["x", "y", "z"][axis];
        let text = format!("largest along world {axis}: {} N; no trial or flight stands out", significant(*value, 3));
        ("where       ", text)
    };
    Some(crate::screen::one_line(label, &text))
}

/// What the recordings contradict; `first` where it comes before every question about effects.
fn contradicted(view: &ComparisonView) -> Option<String> {
    let c = view.to_correct.as_ref()?;
    Some(labelled(if c.first || c.void { "first       " } else { "check       " }, &c.words))
}

/// The body mass that the plates show, where it is not the stated one.
fn weighed(view: &ComparisonView) -> Option<String> {
    let mass = view.impulse_mass.as_ref().filter(|m| m.doubt.is_some() && m.wrong.is_none())?;
    let text = format!(
        "{} kg by the impulse between flights, {} kg stated ({:+.1} %)",
        significant(mass.mass_kg, 3),
        significant(mass.stated_kg, 3),
        100.0 * (mass.mass_kg / mass.stated_kg - 1.0)
    );
    Some(crate::screen::one_line("mass        ", &text))
}

/// The error in contact as measured, where constants taken off recordings whose plates were never
/// unloaded hide more than the noise floor: an error of the model of that size would not show.
fn constant(view: &ComparisonView) -> Option<String> {
    let floor_n = view.errors.iter().find(|e| e.judged_on == "contact")?.noise_floor?;
    let first = &view.comparison.first;
    let (shown, measured) = (first.held_out_weak.size(), first.held_out_weak_as_measured.size());
    let hidden = (measured * measured - shown * shown).max(0.0).sqrt();
    (hidden > floor_n && measured > MUCH * shown).then(|| {
        let text = format!(
            "{} N in contact as measured: constants of plates never unloaded were subtracted",
            significant(measured, 3)
        );
        crate::screen::one_line("hidden      ", &text)
    })
}

/// Ratio of the errors with and without constants from which both are shown.
const MUCH: f64 = 1.2;

/// Trials that are not in the errors, as one line.
pub fn left_out(list: &[LeftOut]) -> Option<String> {
    let names: Vec<String> = list
        .iter()
        .map(|l| l.stage.map_or_else(|| l.trial.clone(), |stage| format!("{} ({stage} failed)", l.trial)))
        .collect();
    (!names.is_empty())
        .then(|| crate::screen::one_line("without     ", &format!("{}: excluded from these errors", names.join(", "))))
}

/// A name short enough for a line: up to the first comma or bracket.
pub fn short(name: &str) -> String {
    let name = aloft_study::quote::visible(name);
    let head = name.split([',', '(', ';']).next().unwrap_or(&name).trim().to_owned();
    crate::screen::cut(&head, 40)
}

/// Prints subject, identification, errors and where they are largest.
pub fn block(view: &ComparisonView) -> Result<(), Stop> {
    identified(view).iter().try_for_each(out)?;
    if let Some(line) = left_out(&view.left_out) {
        out(line)?;
    }
    for line in &view.limits {
        out(labelled("note        ", line))?;
    }
    if view.errors.is_empty() {
        out(labelled("error       ", &format!("nothing to compare: {}", nothing_because(view))))?;
    } else {
        out(grid(&view.errors))?;
    }
    if !view.limits.is_empty() {
        return contradicted(view).iter().try_for_each(out);
    }
    // a wrong mass or gain, and what to record, come before the place of the largest error; three
    // lines of all of them, so that a run ends with twelve
    let first = [contradicted(view), weighed(view), to_do(view).filter(|_| !waits(view))];
    let place = if first.iter().all(Option::is_none) { worst(view) } else { in_the_moment(view) };
    first.into_iter().chain([place, constant(view)]).flatten().take(3).try_for_each(out)
}

/// True if something has to be corrected first: to ask or to record more would not help before.
fn waits(view: &ComparisonView) -> bool {
    view.to_correct.as_ref().is_some_and(|c| c.void || c.first)
}

/// Why there is no error: the failure of all recordings, or none that is long enough.
fn nothing_because(view: &ComparisonView) -> String {
    let failed: Vec<(&str, &LeftOut)> = view.left_out.iter().filter_map(|l| Some((l.stage?, l))).collect();
    let rest = view.comparison.first.trials.iter().any(|t| !failed.iter().any(|(_, l)| l.trial == t.trial));
    match failed.first() {
        Some((stage, first)) if !rest && failed.iter().all(|(other, _)| other == stage) => {
            format!("the stage `{stage}` failed in every recording: {}", first.because)
        }
        Some(_) if !rest => "every recording failed".to_owned(),
        _ => "no flight or held-out contact is as long as a window".to_owned(),
    }
}

/// What to do about a gate that did not pass.
fn to_do(view: &ComparisonView) -> Option<String> {
    let text = view.parameters.to_do.as_ref()?;
    Some(labelled("to do       ", &format!("{text}; all: aloft parameters")))
}
