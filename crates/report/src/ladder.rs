//! The revisions of the model and the error that each of them left.

use super::drawn_effects::units;
use super::headline::floor_words;
use super::lights::times;
use super::place_errors::{PlaceError, asked, errors_by_place};
use super::story::Story;
use super::sureness::after_all;
use super::wording::{maybe, number, plus_minus, unit};
use aloft_analysis::compare::JudgedOn;
use aloft_analysis::held_out::HeldOutError;
use aloft_analysis::history::HistoryRow;
use aloft_compare::{Grade, Signal};
use aloft_page::{Block, Cell, Figure, Ladder, Light, Panel, Rung, Section, Series, Table, Words};
use aloft_study::revision::Judged;
use std::collections::HashMap;

/// Most coefficients shown beside an effect.
const COEFFICIENTS: usize = 2;

/// The ladder as a picture on the first screen: the revisions of the model, and what `discover`
/// promises for the effects that it found; none where nothing was compared.
pub fn picture(story: &Story<'_>) -> Option<Ladder> {
    let all = errors_by_place(story);
    let first = all.first()?;
    let units = units(story);
    let mut rungs: Vec<Rung> = Vec::new();
    let rows = &story.history.revisions;
    for (i, r) in rows.iter().enumerate() {
        let last = i + 1 == rows.len();
        // the present revision is what the comparison shows, the others are as they were recorded
        let recorded = r.errors.iter().find(|e| e.judged_on == first.place).map(PlaceError::of);
        let judged = if last { Some(first.clone()) } else { recorded };
        let light = judged.as_ref().map_or(Light::Neutral, PlaceError::light);
        rungs.push(Rung {
            name: name(r, i.checked_sub(1).map(|k| &rows[k])),
            size: size(r, i.checked_sub(1).map(|k| &rows[k]), &units),
            error: judged.as_ref().map_or(f64::NAN, |j| j.error_n),
            words: judged.as_ref().map_or_else(|| "not run".to_owned(), |j| error_text(j.error_n, j.ratio)),
            judged: match (&r.void, &judged) {
                (Some(_), _) => "void".to_owned(),
                (None, Some(j)) if j.ratio.is_some() => j.graded.words(),
                _ => String::new(),
            },
            light: if r.void.is_some() { Light::Poor } else { light },
            forecast: false,
        });
    }
    rungs.extend(promised(story, first));
    Some(Ladder {
        title: format!("Error in {}", first.place),
        caption: String::new(),
        floor: first.floor_n,
        floor_interval: first.interval_n,
        floor_words: floor_words(first),
        rungs,
    })
}

fn error_text(error: f64, ratio: Option<f64>) -> String {
    if !error.is_finite() {
        return "not run".to_owned();
    }
    format!("{} N{}", number(error), ratio.map_or(String::new(), |r| format!(" · {} ×", times(r))))
}

/// What a revision changes.
fn name(r: &HistoryRow, before: Option<&HistoryRow>) -> String {
    let Some(before) = before else {
        return if r.effects.is_empty() { "no effects".to_owned() } else { format!("`{}`", r.effects.join("`, `")) };
    };
    let added = r.effects.iter().filter(|e| !before.effects.contains(e)).map(|e| format!("+ `{e}`"));
    let removed = before.effects.iter().filter(|e| !r.effects.contains(e)).map(|e| format!("− `{e}`"));
    let parts: Vec<String> = added.chain(removed).collect();
    if parts.is_empty() { r.action.clone() } else { parts.join(" ") }
}

/// Coefficients of what a revision adds.
fn size(r: &HistoryRow, before: Option<&HistoryRow>, units: &HashMap<String, String>) -> String {
    let new =
        |key: &str| r.effects.iter().any(|e| e == key) && before.is_none_or(|b| !b.effects.iter().any(|e| e == key));
    let own = r.coefficients.iter().filter_map(|c| {
        let (key, name) = c.name.rsplit_once('.')?;
        let unit = units.get(&c.name).map_or(String::new(), |u| unit(u));
        new(key).then(|| format!("{} {} {unit}", name.replace('_', " "), plus_minus(c.value, c.ci95)))
    });
    own.take(COEFFICIENTS).map(|t| t.trim_end().to_owned()).collect::<Vec<_>>().join(", ")
}

/// What `discover` promises for the effects that it found, or for laws that replace them.
fn promised(story: &Story<'_>, first: &PlaceError) -> Option<Rung> {
    let d = asked(story)?;
    let laws = d.open.iter().flat_map(|o| &o.laws).map(|l| (l.id.as_str(), &l.coefficients));
    let parts: Vec<(&str, &Vec<aloft_discover::Estimate>)> =
        d.found.iter().map(|f| (f.key.as_str(), &f.coefficients)).chain(laws).collect();
    if parts.is_empty() {
        return None;
    }
    let (error, ratio) = after_all(story, first)?;
    let keys: Vec<&str> = parts.iter().map(|p| p.0).collect();
    let of = |c: &aloft_discover::Estimate| {
        format!("{} {} {}", c.name.replace('_', " "), plus_minus(c.value, c.ci95), unit(&c.unit))
    };
    let sizes: Vec<String> =
        parts.iter().flat_map(|p| p.1.iter().take(COEFFICIENTS)).map(|c| of(c).trim_end().to_owned()).collect();
    Some(Rung {
        name: format!("+ `{}`?", keys.join("` + `")),
        size: sizes.join(", "),
        error,
        words: format!("{}, forecast{}", error_text(error, ratio), forecast_grade(story, first, error)),
        judged: String::new(),
        light: Light::Neutral,
        forecast: true,
    })
}

/// The grade of a forecast error, after a colon; nothing without a floor.
fn forecast_grade(story: &Story<'_>, first: &PlaceError, error_n: f64) -> String {
    // what the stages computed has its grade; the estimate of the ranking has that of its number
    let computed = story.discoveries.last().map_or(&[][..], |(_, kept)| &kept.errors_after[..]);
    let graded = computed
        .iter()
        .find(|e| e.judged_on == first.place)
        .map_or_else(|| Grade::of(error_n, first.floor_n, first.interval_n).plain(), HeldOutError::graded);
    if graded.grade == Grade::NotJudged { String::new() } else { format!(": {}", graded.words()) }
}

/// The section; none if the model was never changed.
pub fn section(story: &Story<'_>) -> Option<Section> {
    let rungs = &story.history.revisions;
    if rungs.len() < 2 {
        return None;
    }
    let x: Vec<f64> = (0..rungs.len()).map(|i| i as f64).collect();
    let of = |get: &dyn Fn(&HistoryRow) -> Option<f64>| {
        rungs.iter().map(|r| get(r).unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    let judged_on = rungs.iter().rev().find_map(|r| r.judged_on);
    let judged = judged_on.map_or("held-out motion", JudgedOn::describe);
    let ticks: Vec<String> = rungs
        .iter()
        .map(|r| if r.revision == 0 { "0: plain".to_owned() } else { format!("{}: {}", r.revision, r.action) })
        .collect();
    let place = |title: &str, get: &dyn Fn(&HistoryRow) -> Option<Judged>| Panel {
        title: title.to_owned(),
        y: "error, N".into(),
        ticks: ticks.clone(),
        series: vec![
            Series::line("held-out error", x.clone(), of(&|r| get(r).map(|j| j.error_n))).with_points().coloured("c0"),
            Series::line("noise floor", x.clone(), of(&|r| get(r).and_then(|j| j.noise_n))).dashed().coloured("dim"),
        ],
        from_zero: true,
        ..Panel::default()
    };
    let panels: Vec<Panel> = [place("In flight", &|r| r.flight), place("In held-out contact", &|r| r.contact)]
        .into_iter()
        .filter(|p| p.series[0].y.iter().any(|v| v.is_finite()))
        .collect();
    let words = Words::new(
        "Held-out error by model revision",
        "Held-out error over weak windows (moments over a lever of 0.1 m) of each revision of the model, and the error of a perfect model on these recordings (the noise floor).",
    );
    let figure = Figure::panels(words, "revision of the model", panels.len(), &panels, &[]);
    let any_void = rungs.iter().any(|r| r.void.is_some());
    let mut header =
        vec!["revision", "effects", "error, N", "floor, N", "σ_N−1 / σ_N", "coefficients", "largest change"];
    if any_void {
        header.push("remark");
    }
    let table = Table::new(
        "Revisions",
        "Coefficients with 95 % intervals, and the base parameter that changed most against the revision before.",
        &header,
        rungs.iter().map(|r| row(r, any_void)).collect(),
    );
    let lead = format!(
        "Each revision of the model and the error that it left on {judged}. A revision that increases marker error is void."
    );
    let mut blocks: Vec<Block> = vec![figure.into(), table.into()];
    // compare the first and the last revision on the same motion: that on which the last was judged
    let in_flight = judged_on == Some(JudgedOn::Flight);
    let on = |r: &HistoryRow| if in_flight { r.flight } else { r.contact };
    if let (Some(first), Some(last)) = (rungs.first().and_then(on), rungs.last())
        && let Some((first, now, floor)) = on(last).and_then(|j| Some((first.error_n, j.error_n, j.noise_n?)))
    {
        let place = if in_flight { "flight" } else { "contact" };
        let graded = last.errors.iter().find(|e| e.judged_on == place).map(HeldOutError::graded);
        let (signal, words) = match (&last.void, graded) {
            (Some(_), _) => (Signal::Poor, "void".to_owned()),
            (None, Some(g)) => (g.signal(), g.words()),
            (None, None) => (Signal::Unknown, Grade::NotJudged.word().to_owned()),
        };
        let text =
            format!("From {} N to {} N; a perfect model would leave {} N.", number(first), number(now), number(floor));
        blocks.insert(0, Block::judged(super::lights::of(signal), words, text));
    }
    for caution in rungs.last().iter().flat_map(|r| &r.cautions) {
        let text = format!("Of the last revision: {caution}.");
        blocks.push(Block::remark(Light::Fair, text));
    }
    Some(Section::new("ladder", "The ladder", &lead, blocks))
}

fn row(r: &HistoryRow, with_remark: bool) -> Vec<Cell> {
    let coefficients: Vec<String> = r
        .coefficients
        .iter()
        .map(|c| format!("{} {} {}", c.name, plus_minus(c.value, c.ci95), unit(&c.unit)).trim_end().to_owned())
        .collect();
    let mut cells: Vec<Cell> = vec![
        format!("{} ({})", r.revision, r.action).into(),
        if r.effects.is_empty() { "none".into() } else { r.effects.join(", ").into() },
        maybe(r.held_out_error).into(),
        maybe(r.noise_floor).into(),
        maybe(r.sigma_ratio).into(),
        coefficients.join("; ").into(),
        r.largest_change.as_ref().map_or("–".into(), |(name, by)| format!("{name} by {}", number(*by)).into()),
    ];
    if with_remark {
        cells.push(r.void.clone().unwrap_or_default().into());
    }
    cells
}
