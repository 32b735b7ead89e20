//! The effects as switches on the page: what the panel shows, and the numbers from which a page
//! that is sent computes the model with any choice of them.

use crate::place_errors::judged_place;
use crate::story::Story;
use aloft_analysis::discover::latest;
use aloft_analysis::effect::{Asked, history};
use aloft_analysis::freshness::freshness;
use aloft_analysis::switch_kernel::{KernelWindows, SwitchKernel};
use aloft_analysis::switches::{Switch, Switches};
use aloft_compare::{Floor, Grade, Reserve};
use aloft_discover::Verdict;
use aloft_identify::RotatedRows;
use aloft_page::pack;
use aloft_page::switches::Sent;
use aloft_study::commands::command;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use nalgebra::DMatrix;
use serde_json::{Map, Value, json};

/// Most numbers that a page carries for its switches, at about five characters each.
const MOST_NUMBERS: usize = 260_000;

/// What the panel shows before a switch is flipped: subject, model and its revisions, the switches,
/// and what the last discovery said about each.
///
/// # Errors
/// Results that are damaged.
pub fn panel_state(session: &SubjectSession, switches: &[Switch]) -> Result<Value, PipelineError> {
    let session = session.refreshed()?;
    let fresh = freshness(&session)?;
    let history = history(&session)?;
    let place = judged_place(latest(&session)?.as_ref(), history.revisions.last());
    let rungs: Vec<Value> = history
        .revisions
        .iter()
        .map(|r| {
            json!({
                "revision": r.revision, "action": r.action, "effects": r.effects, "errors": r.errors,
                "judged_on": r.judged_on, "void": r.void,
            })
        })
        .collect();
    Ok(json!({
        "subject": session.facts.person.name,
        "model": session.effects.iter().map(|e| &e.key).collect::<Vec<_>>(),
        "current": fresh.is_current(),
        "stale": fresh.describe(),
        "revisions": rungs,
        "place": place,
        "grades": grades(),
        "reserves": Reserve::ALL.iter().map(|r| (key(r), json!(r.words()))).collect::<Map<_, _>>(),
        "switches": switches,
        "preparing": false,
        "problem": null,
        "asked": asked(&session)?,
    }))
}

/// Words and colour of every grade, by its name in JSON.
fn grades() -> Map<String, Value> {
    Grade::ALL.iter().map(|g| (key(g), json!({"words": g.word(), "signal": g.signal()}))).collect()
}

/// The name of a variant in JSON.
fn key(variant: &impl serde::Serialize) -> String {
    json!(variant).as_str().map(str::to_owned).unwrap_or_default()
}

/// What the last discovery said; null if nothing was asked.
fn asked(session: &SubjectSession) -> Result<Value, PipelineError> {
    let asked = Asked::read(session)?;
    let Some(d) = &asked.found else { return Ok(Value::Null) };
    let about = d.candidates.iter().map(|c| {
        json!({
            "key": c.key, "held_out_ratio": finite(c.held_out_ratio), "ci95": c.ci95.map(finite),
            "believed": c.believed, "judged_on": c.judged_on,
        })
    });
    // sizes and intervals stand beside the switches
    let words = match d.verdict {
        Verdict::Supported | Verdict::OneOf => format!("{}.", aloft_analysis::verdict::sentence(d)),
        _ => d.words.clone(),
    };
    // asked of another model or of other results: its words are not about this one
    let present = latest(session)?.is_some();
    let words =
        if present { words } else { format!("`discover` was asked before the model or its results changed: {words}") };
    // what removes a part of the error and is not shown to be the cause is not found
    let sure = present && d.verdict != Verdict::Unexplained;
    let found: Vec<&String> = d.found.iter().filter(|_| sure).map(|f| &f.key).collect();
    Ok(json!({
        "verdict": d.verdict, "words": words, "effects": d.effects,
        "found": found,
        "candidates": about.collect::<Vec<_>>(),
        "of_present_results": asked.is_of(session)?,
    }))
}

fn finite(x: f64) -> Option<f64> {
    Some(x).filter(|x| x.is_finite())
}

/// The switches of a page that is sent.
#[derive(Default)]
pub(crate) struct Offered {
    /// The panel; none if the page has no switches.
    pub panel: Option<Sent>,
    /// Why there are none, for the page's last lines, where they could be expected: not before a
    /// discovery, nor where results are not up to date.
    pub without: Option<String>,
    /// How many there are, or why there are none, in a few words for the page of several subjects.
    pub brief: String,
}

/// The switches of a page that is sent.
pub(crate) fn sent(story: &Story<'_>) -> Offered {
    let none = |brief: &str| Offered { brief: format!("none: {brief}"), ..Offered::default() };
    if !story.freshness.is_current() {
        return none("results are not up to date");
    }
    if story.discoveries.is_empty() {
        return none("`discover` was not run");
    }
    let without = |why: &str, brief: &str| {
        let text = format!("this page has no switches, because {why}; `aloft studio` has them");
        Offered { without: Some(text), ..none(brief) }
    };
    match numbers(story.session) {
        Ok(Some(n)) => {
            let count = |list: &str| n["kernel"][list].as_array().map_or(0, Vec::len);
            let (own, more) = (count("switches"), count("left_out"));
            let brief = if more == 0 { format!("all {own}") } else { format!("{own} of {}", own + more) };
            Offered { panel: Some(Sent::new(&n)), without: None, brief }
        }
        Ok(None) => without(
            "the rows of these recordings are too many for a page, or the parameters are no least squares",
            "too many rows for a page, or parameters that are no least squares",
        ),
        Err(e) => without(&e.to_string(), &e.to_string()),
    }
}

/// Everything that the panel of a sent page needs.
///
/// # Errors
/// Results that are missing or damaged.
pub fn numbers(session: &SubjectSession) -> Result<Option<Value>, PipelineError> {
    let session = session.refreshed()?;
    let switches = Switches::prepare(&session, &[], &|_, _| {})?;
    if switches.switches().is_empty() {
        return Ok(None);
    }
    let Some(kernel) = switches.kernel(MOST_NUMBERS)? else { return Ok(None) };
    Ok(Some(json!({
        "state": panel_state(&session, &kernel.switches)?,
        "commands": {"add": command(&session, "effect add", None), "remove": command(&session, "effect remove", None)},
        "kernel": packed(&kernel),
    })))
}

fn packed(k: &SwitchKernel) -> Value {
    let floor = |f: &Option<Floor>| f.map(|f| json!({"noise_floor": f.noise_floor, "ci95": f.ci95}));
    let windows = |w: &Option<KernelWindows>| {
        w.as_ref().map(|w| {
            let triangle = w.rows.nrows() == w.rows.ncols() && 6 * w.windows > w.rows.ncols();
            json!({"windows": w.windows, "rows": matrix(&w.rows, triangle, 4)})
        })
    };
    let trials = k.trials.iter().map(|t| {
        json!({
            "name": t.name, "without": t.without.as_ref().map(|r| rows(r, false, 4)), "flight": windows(&t.flight),
            "contact": windows(&t.contact),
        })
    });
    json!({
        "switches": k.switches, "columns": k.columns, "with_contact": k.with_contact,
        "always_contact": k.always_contact, "only_known": k.only_known, "contact": k.contact, "known": k.known, "left_out": k.left_out,
        "present": k.present, "base": k.base, "all": rows(&k.all, !k.base.is_empty(), 5),
        "trials": trials.collect::<Vec<_>>(), "flight_floor": floor(&k.flight_floor),
        "contact_floor": floor(&k.contact_floor), "weight_n": k.weight_n, "best": k.best,
        "limits": Grade::LIMITS, "grades": Grade::ALL,
    })
}

/// Coefficients of effects that do almost the same follow from small differences: the rows that
/// give them take a byte more.
fn rows(r: &RotatedRows, parameters: bool, bytes: usize) -> Value {
    json!({
        "n_rows": r.n_rows, "singular": r.singular, "top": matrix(&r.top, false, bytes), "bottom": matrix(&r.bottom, true, bytes),
        "mean": parameters.then(|| r.mean.as_slice()), "spread": parameters.then(|| matrix(&r.spread, false, 4)),
        "longest": r.longest, "saturated": r.saturated, "prior_weight": r.prior_weight,
    })
}

fn matrix(m: &DMatrix<f64>, upper: bool, bytes: usize) -> Value {
    pack::matrix(pack::Shape { rows: m.nrows(), columns: m.ncols(), upper, bytes }, |i, j| m[(i, j)])
}
