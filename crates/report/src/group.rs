//! The page of a study of several subjects: one row per subject with lights, distributions over the
//! group, and links to the subjects' pages.

use super::place_errors::{self, PlaceError, errors_by_place};
use super::story::Story;
use super::wording::{anchor, card, count, maybe, number, with_half};
use super::{STUDY, group_headline, lights};
use aloft_analysis::compare::{errors_of, mean};
use aloft_compare::Graded;
use aloft_discover::Verdict;
use aloft_page::{
    Block, Card, Cell, Chapter, Columns, Dots, Figure, HeatMap, Light, Line, Page, Section, Table, Words,
};
use aloft_signal::mean_and_deviation;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::limits::SIGMA_RATIO;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A subject or session of the study.
pub struct Member<'a> {
    /// Name in the study.
    pub name: String,
    /// The subject's own study.
    pub session: &'a SubjectSession,
    /// Path of its page, relative to this one; empty if it has none.
    pub link: String,
    /// How many switches of effects its page has, or why it has none.
    pub switches: String,
}

/// A subject without results, and the reason.
pub struct Absent {
    /// Name in the study.
    pub name: String,
    /// Reason.
    pub reason: String,
    /// True if it was excluded on purpose.
    pub on_purpose: bool,
}

/// A recording: name, judgement, marker error (mm), flights, reasons.
pub(super) type TrialLine = (String, Light, Option<f64>, Option<usize>, String);

/// Data of one subject on the group page: figures only, so that hundreds of subjects fit into
/// memory.
pub(super) struct Row {
    pub(super) name: String,
    pub(super) link: String,
    /// Judgement of the model.
    pub(super) light: Light,
    /// Where the model is worse, in flight or in contact: its error over the floor, and in words.
    pub(super) times_floor: Option<f64>,
    pub(super) worst_error: String,
    /// Its grade; none where nothing was compared.
    pub(super) graded: Option<Graded>,
    /// Light and words of the model, as on the first screen of its own page.
    pub(super) word: String,
    /// Switches of its page.
    pub(super) switches: String,
    /// Number of recordings that failed.
    pub(super) lost: usize,
    pub(super) recordings: usize,
    /// Judgement of the recordings, and how many have each.
    pub(super) recorded: Light,
    pub(super) remarks: String,
    pub(super) flights: Option<usize>,
    pub(super) marker_rms_mm: Option<f64>,
    pub(super) fall_percent: Option<f64>,
    pub(super) gap: Option<f64>,
    pub(super) trusted: Option<bool>,
    /// Force and moment error of the identified model and of the prior.
    pub(super) force: [Option<f64>; 2],
    pub(super) moment: [Option<f64>; 2],
    pub(super) verdict: Option<(Verdict, String)>,
    /// Effects of the model.
    pub(super) held: String,
    /// Share of each link in the body mass: identified and prior.
    pub(super) shares: Vec<(String, f64, f64)>,
    /// Mean error of each marker over recordings, mm.
    pub(super) markers: BTreeMap<String, f64>,
    /// Name, judgement, marker error, flights and first remark of each recording.
    pub(super) trials: Vec<TrialLine>,
    /// What is set side by side of two subjects: name and value.
    pub(super) lines: Vec<(String, String)>,
    pub(super) failure: Option<String>,
}

/// Builds the page.
///
/// # Errors
/// None of the subjects has results.
pub fn page(title: &str, members: &[Member<'_>], absent: &[Absent]) -> Result<Page, PipelineError> {
    let rows: Vec<Row> = members.par_iter().map(row).collect();
    if rows.iter().all(|r| r.failure.is_some()) {
        return Err(PipelineError::request_hint("no subject of the study has results", "run `aloft run` first"));
    }
    let next = members.first().map_or(String::new(), |m| aloft_study::commands::for_all(m.session, "discover"));
    let mut chapters = vec![overview(&rows, absent, &next)];
    chapters.push(distributions(&rows));
    let columns = rows.iter().map(|r| (r.name.as_str(), r.lines.as_slice()));
    chapters.extend(super::pair::section(columns).map(|section| Chapter {
        id: "pair".into(),
        title: "Two subjects".into(),
        group: STUDY.into(),
        light: Light::Neutral,
        word: String::new(),
        sections: vec![section],
    }));
    chapters.push(recordings(&rows));
    let n: usize = rows.iter().map(|r| r.recordings).sum();
    Ok(Page {
        title: format!("{title}: mass properties from flight"),
        subtitle: format!(
            "{} · {} · one page a subject, linked below",
            count(rows.len(), "subject"),
            count(n, "recording")
        ),
        chapters,
        footer: vec![format!("aloft {}", env!("CARGO_PKG_VERSION"))],
    })
}

fn row(m: &Member<'_>) -> Row {
    let mut out = Row {
        name: m.name.clone(),
        link: m.link.clone(),
        light: Light::Poor,
        times_floor: None,
        worst_error: String::new(),
        graded: None,
        word: "no results".to_owned(),
        switches: m.switches.clone(),
        lost: 0,
        recorded: Light::Poor,
        recordings: m.session.included().count(),
        remarks: String::new(),
        flights: None,
        marker_rms_mm: None,
        fall_percent: None,
        gap: None,
        trusted: None,
        force: [None; 2],
        moment: [None; 2],
        verdict: None,
        held: String::new(),
        shares: Vec::new(),
        markers: BTreeMap::new(),
        trials: Vec::new(),
        lines: Vec::new(),
        failure: None,
    };
    let made = aloft_pipeline::made::as_made(m.session);
    let story = made.as_ref().map_err(ToString::to_string);
    let story = match story.and_then(|made| Story::read(made, m.session).map_err(|e| e.to_string())) {
        Ok(story) => story,
        Err(e) => {
            out.failure = Some(e);
            out.link.clear();
            return out;
        }
    };
    (out.recorded, out.remarks) = lights::recordings(&story);
    (out.light, out.word) = place_errors::standing(&story);
    out.lost = story.trials.iter().filter(|t| !t.failures.is_empty()).count();
    // the worse of flight and contact, as the table of `run` has it
    let errors = errors_by_place(&story);
    let worse = |a: &&PlaceError, b: &&PlaceError| {
        a.graded.grade.cmp(&b.graded.grade).then(a.ratio.unwrap_or(0.0).total_cmp(&b.ratio.unwrap_or(0.0)))
    };
    if let Some(worst) = errors.iter().max_by(worse) {
        out.times_floor = worst.ratio;
        out.worst_error = format!("{} in {}", worst.times_floor(), worst.place);
        out.graded = Some(worst.graded);
    }
    if !story.freshness.is_current() {
        out.remarks = format!("not up to date ({}); {}", story.freshness.describe().join("; "), out.remarks);
    }
    let average = |v: Vec<f64>| (!v.is_empty()).then(|| v.iter().sum::<f64>() / v.len() as f64);
    out.marker_rms_mm = average(story.dynamic().filter_map(|t| t.kinematics.as_ref()?.marker_rms_mm).collect());
    let fall = story.dynamic().filter_map(|t| t.kinematics.as_ref()?.gravity_error_percent.map(f64::abs));
    out.fall_percent = average(fall.collect());
    if let Some(found) = &story.found {
        let p = &found.parameters;
        out.flights = Some(p.n_flights());
        out.gap = Some(p.sigma.ratio);
        out.trusted = Some(p.gate.passed);
        out.shares = p
            .links
            .iter()
            .map(|l| (l.name.clone(), 100.0 * l.mass_kg / p.mass_kg, 100.0 * l.prior.mass_kg / p.mass_kg))
            .collect();
    }
    if let Some(view) = &story.comparison {
        let c = &view.comparison;
        let own = errors_of(&c.first);
        let prior = c.beside.iter().find(|m| m.model == "prior").map(errors_of);
        out.force = [Some(mean(&own.0)), prior.map(|p| mean(&p.0))];
        out.moment = [Some(mean(&own.1)), prior.map(|p| mean(&p.1))];
    }
    out.verdict = place_errors::asked(&story).map(|d| match d.verdict {
        Verdict::OneOf => (d.verdict, aloft_analysis::verdict::groups(d)),
        _ => (d.verdict, d.effects.join(", ")),
    });
    out.lines = super::pair::lines(&story);
    out.held = place_errors::effects(&story).join(", ");
    for t in story.dynamic() {
        let Some(motion) = &t.motion else { continue };
        let n = motion.marker_labels.len();
        for (i, label) in motion.marker_labels.iter().enumerate() {
            let own: Vec<f64> =
                motion.residual_m.iter().skip(i).step_by(n).filter(|r| r.is_finite()).copied().collect();
            if !own.is_empty() {
                let rms = 1e3 * (own.iter().map(|r| r * r).sum::<f64>() / own.len() as f64).sqrt();
                // accumulates the sum; divided by the number of recordings at the end
                *out.markers.entry(label.clone()).or_default() += rms;
            }
        }
    }
    let solved = story.dynamic().filter(|t| t.motion.is_some()).count().max(1) as f64;
    out.markers.values_mut().for_each(|v| *v /= solved);
    out.trials = story
        .trials
        .iter()
        .map(|t| {
            let first = lights::remarks(t).into_iter().next().map_or(String::new(), |r| r.1);
            let remark = t.entry.excluded.as_ref().map_or(first, |e| format!("excluded: {e}"));
            (
                t.entry.name.clone(),
                lights::trial(t),
                t.kinematics.as_ref().and_then(|k| k.marker_rms_mm),
                t.n_flights(),
                remark,
            )
        })
        .collect();
    out
}

/// `mean ± SD` of the values that exist.
fn mean_sd(values: impl Iterator<Item = Option<f64>>) -> String {
    let values: Vec<f64> = values.flatten().filter(|v| v.is_finite()).collect();
    match values.len() {
        0 => "–".to_owned(),
        1 => number(values[0]),
        _ => {
            let (m, sd) = mean_and_deviation(&values).unwrap_or((f64::NAN, f64::NAN));
            with_half(m, sd)
        }
    }
}

/// Light of all rows together, and how many models have each grade, or why they have none.
fn together(rows: &[Row]) -> (Light, String) {
    let of = |l: Light| rows.iter().filter(|r| r.light == l).count();
    let all = match (of(Light::Good), of(Light::Fair), of(Light::Poor)) {
        (0, 0, 0) => Light::Neutral,
        (_, 0, 0) => Light::Good,
        (_, _, poor) if 2 * poor > rows.len() => Light::Poor,
        _ => Light::Fair,
    };
    let mut words: BTreeMap<(Light, &str), usize> = BTreeMap::new();
    for r in rows {
        *words.entry((r.light, &r.word)).or_default() += 1;
    }
    let each: Vec<String> = words.iter().map(|((_, word), n)| format!("{n} {word}")).collect();
    (all, each.join(", "))
}

fn overview(rows: &[Row], absent: &[Absent], next: &str) -> Chapter {
    let (light, counted) = together(rows);
    let trusted = rows.iter().filter(|r| r.trusted == Some(true)).count();
    let flights: usize = rows.iter().filter_map(|r| r.flights).sum();
    let cards = vec![
        Card { word: counted.clone(), ..card("Subjects", rows.len().to_string(), "", light) },
        card(
            "Determined by their motion",
            format!("{trusted} of {}", rows.len()),
            "subjects whose parameters pass the gate",
            Light::Neutral,
        ),
        card("Flights", flights.to_string(), "over all subjects", Light::Neutral),
        card(
            "Marker error, RMS",
            format!("{} mm", mean_sd(rows.iter().map(|r| r.marker_rms_mm))),
            "mean ± SD over subjects",
            Light::Neutral,
        ),
        card(
            "Force error, frame by frame",
            format!("{} N", mean_sd(rows.iter().map(|r| r.force[0]))),
            format!("tables {} N", mean_sd(rows.iter().map(|r| r.force[1]))),
            Light::Neutral,
        ),
        card(
            "Moment error, frame by frame",
            format!("{} N·m", mean_sd(rows.iter().map(|r| r.moment[0]))),
            format!("tables {} N·m", mean_sd(rows.iter().map(|r| r.moment[1]))),
            Light::Neutral,
        ),
    ];
    let mut first: Vec<Block> = vec![group_headline::headline(rows, (light, &counted), next).into()];
    first.extend(group_headline::floors(rows).map(Block::from));
    let mut blocks = vec![subjects(rows).into(), Block::text(switches(rows)), Block::Cards { cards }];
    let failed = rows.iter().filter_map(|r| Some((r.name.clone(), r.failure.clone()?)));
    let lost: Vec<(String, String, bool)> = failed
        .map(|(n, f)| (n, f, false))
        .chain(absent.iter().map(|a| (a.name.clone(), a.reason.clone(), a.on_purpose)))
        .collect();
    for (name, reason, on_purpose) in lost {
        let light = if on_purpose { Light::Neutral } else { Light::Poor };
        let what = if on_purpose { "left out" } else { "no results" };
        blocks.push(Block::remark(light, format!("{name}: {what}: {reason}")));
    }
    let sections = vec![
        Section::new("result", "", "", first),
        Section::new("subjects", "Subjects", "Click a name to open the subject's page.", blocks),
    ];
    Chapter { id: "overview".into(), title: "Overview".into(), group: STUDY.into(), light, word: counted, sections }
}

/// How many switches of effects the subjects' pages have, or why they have none.
fn switches(rows: &[Row]) -> String {
    let mut by_words: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for r in rows {
        by_words.entry(&r.switches).or_default().push(&r.name);
    }
    let all: Vec<String> = by_words.iter().map(|(words, who)| format!("{words} ({})", who.join(", "))).collect();
    format!("Switches of effects in the subjects' pages: {}.", all.join("; "))
}

/// The model's error with its grade, or why there is none.
fn model(r: &Row) -> Cell {
    let gate = if r.trusted == Some(false) { "; too few flights to determine the body" } else { "" };
    Cell::judged(r.light, r.word.clone(), format!("{}{gate}", r.worst_error))
}

fn subjects(rows: &[Row]) -> Table {
    let verdict = |r: &Row| match &r.verdict {
        None if r.held.is_empty() => "not asked".to_owned(),
        None => format!("added: {}", r.held),
        Some((Verdict::NothingMissing, _)) => "nothing".to_owned(),
        Some((Verdict::Unexplained, _)) => "unexplained".to_owned(),
        Some((Verdict::NotDetectable, _)) => "cannot tell".to_owned(),
        Some((Verdict::Supported | Verdict::OneOf, e)) => e.clone(),
    };
    let of_prior = |v: &[Option<f64>; 2]| match v {
        [Some(own), Some(prior)] if *prior > 0.0 => format!("{:.0}", 100.0 * own / prior),
        _ => "–".to_owned(),
    };
    let cells = |r: &Row| -> Vec<Cell> {
        vec![
            Cell::from(r.name.clone()).to(r.link.clone()),
            model(r),
            verdict(r).into(),
            Cell::light(r.recorded, r.remarks.clone()),
            r.recordings.to_string().into(),
            r.flights.map_or("–".into(), |n| n.to_string().into()),
            maybe(r.marker_rms_mm).into(),
            maybe(r.fall_percent).into(),
            maybe(r.gap).into(),
            maybe(r.force[0]).into(),
            of_prior(&r.force).into(),
            maybe(r.moment[0]).into(),
            of_prior(&r.moment).into(),
        ]
    };
    Table::new(
        "Subjects",
        "The model is judged by its held-out error in multiples of the noise floor, in flight or in contact, where it is worse. Marker error and free fall are means over recordings; force and moment \
         errors are mean absolute errors frame by frame on held-out motion, also as a share of what the tables leave.",
        &[
            "subject",
            "model",
            "missing",
            "recordings judged",
            "recordings",
            "flights",
            "marker RMS, mm",
            "fall against g, %",
            "σ_N−1 / σ_N",
            "force error, N",
            "of tables', %",
            "moment error, N·m",
            "of tables', %",
        ],
        rows.iter().map(cells).collect(),
    )
}

fn distributions(rows: &[Row]) -> Chapter {
    let names: Vec<String> = rows.iter().map(|r| r.name.clone()).collect();
    let values =
        |get: &dyn Fn(&Row) -> Option<f64>| rows.iter().map(|r| get(r).unwrap_or(f64::NAN)).collect::<Vec<f64>>();
    let both = |title: &str, unit: &str, get: &dyn Fn(&Row) -> [Option<f64>; 2]| {
        let kinds = [Dots::new("identified", values(&|r| get(r)[0])), Dots::new("tables", values(&|r| get(r)[1]))];
        let words =
            Words::new(title, "Each subject's identified model beside the tables, on held-out motion. Left is better.");
        Block::from(Figure::dots(words, unit, &names, &kinds, &[]))
    };
    let mut sections = vec![Section::new(
        "errors",
        "Prediction",
        "Error reduction by subject",
        vec![
            both("Force error by subject", "mean absolute error, N", &|r| r.force),
            both("Moment error by subject", "mean absolute error, N·m", &|r| r.moment),
        ],
    )];
    let meaning = format!(
        "How clearly each subject's motion determines the parameters: {} is clear, below {} they are not determined.",
        SIGMA_RATIO[1], SIGMA_RATIO[0]
    );
    let gap = Words::new("Singular-value gap by subject", &meaning);
    let lines = SIGMA_RATIO.map(|at| Line { at, upright: true, label: number(at) });
    let figure = Figure::dots(gap, "σ_N−1 / σ_N", &names, &[Dots::new("", values(&|r| r.gap))], &lines);
    sections.push(Section::new("gaps", "Excitation", "", vec![figure.into()]));
    sections.extend(segments(rows));
    sections.extend(markers(rows));
    sections.extend(effects(rows));
    Chapter {
        id: "group".into(),
        title: "Over the group".into(),
        group: STUDY.into(),
        light: Light::Neutral,
        word: String::new(),
        sections,
    }
}

/// Share of each link in the body mass: mean and standard deviation over subjects.
fn segments(rows: &[Row]) -> Option<Section> {
    let mut names: Vec<&str> = Vec::new();
    for (name, _, _) in rows.iter().flat_map(|r| &r.shares) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    if names.is_empty() {
        return None;
    }
    let over = |which: usize| -> (Vec<f64>, Vec<f64>) {
        let of = |name: &str| {
            let all = rows.iter().flat_map(|r| &r.shares).filter(|s| s.0 == name);
            let values: Vec<f64> = all.map(|s| if which == 0 { s.1 } else { s.2 }).collect();
            mean_and_deviation(&values).unwrap_or((f64::NAN, f64::NAN))
        };
        names.iter().map(|n| of(n)).unzip()
    };
    let ((own, own_sd), (prior, prior_sd)) = (over(0), over(1));
    let kinds = [
        Dots::with_half("identified, mean ± SD", own, &own_sd),
        Dots::with_half("tables, mean ± SD", prior, &prior_sd),
    ];
    let labels: Vec<String> = names.iter().map(|n| n.replace('_', " ")).collect();
    let words = Words::new(
        "Mass of each segment as a share of the body",
        "Over subjects. A group that lies to one side of the tables differs from the people whom they describe.",
    );
    let figure = Figure::dots(words, "share of the body mass, %", &labels, &kinds, &[]);
    Some(Section::new("segment-masses", "Segments", "", vec![figure.into()]))
}

/// Marker error by subject.
fn markers(rows: &[Row]) -> Option<Section> {
    let mut worst: BTreeMap<&str, f64> = BTreeMap::new();
    for (label, mm) in rows.iter().flat_map(|r| &r.markers) {
        let entry = worst.entry(label).or_insert(0.0);
        *entry = entry.max(*mm);
    }
    if worst.is_empty() {
        return None;
    }
    let mut labels: Vec<&str> = worst.keys().copied().collect();
    labels.sort_by(|a, b| worst[b].total_cmp(&worst[a]));
    let map = HeatMap {
        x_title: "subject".into(),
        x: Columns::Names(rows.iter().map(|r| r.name.clone()).collect()),
        y: labels.iter().map(|l| (*l).to_owned()).collect(),
        z: labels
            .iter()
            .map(|l| rows.iter().map(|r| r.markers.get(*l).copied().unwrap_or(f64::NAN)).collect())
            .collect(),
        unit: "RMS, mm".into(),
        step: 0.01,
        ..HeatMap::default()
    };
    let words = Words::new(
        "Distance of each marker from the model",
        "Mean over recordings of the root mean square, the worst marker on top. A dark row is a marker that is misplaced on most subjects; a dark column, a \
         session in which something went wrong.",
    );
    Some(Section::new("group-markers", "Markers", "", vec![Figure::heat_map(words, &map).into()]))
}

/// Effects that were named, and the subjects they were named for.
fn effects(rows: &[Row]) -> Option<Section> {
    let mut named: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for r in rows {
        let Some((verdict, effects)) = &r.verdict else { continue };
        let key = match verdict {
            Verdict::NothingMissing => "nothing missing".to_owned(),
            Verdict::Unexplained => "unexplained".to_owned(),
            Verdict::NotDetectable => "cannot tell".to_owned(),
            Verdict::Supported | Verdict::OneOf => effects.clone(),
        };
        named.entry(key).or_default().push(r.name.clone());
    }
    let table = |named: BTreeMap<String, Vec<String>>| {
        let rows = named.into_iter().map(|(k, who)| vec![k, who.len().to_string(), who.join(", ")]).collect();
        Table::new(
            "Answers of discover",
            "An effect found for all subjects points to the laboratory; one found for a single subject points to the subject or the session.",
            &["answer", "subjects", "who"],
            rows,
        )
    };
    (!named.is_empty()).then(|| Section::new("group-effects", "What is missing", "", vec![table(named).into()]))
}

/// Every recording of every subject.
fn recordings(rows: &[Row]) -> Chapter {
    let sections = rows
        .iter()
        .filter(|r| !r.trials.is_empty())
        .map(|r| {
            let cells = r
                .trials
                .iter()
                .map(|(name, light, rms, flights, remark)| {
                    vec![
                        Cell::from(name.clone()),
                        Cell::light(*light, ""),
                        maybe(*rms).into(),
                        flights.map_or("–".into(), |n| n.to_string().into()),
                        Cell::from(remark.clone()),
                    ]
                })
                .collect();
            let table = Table::new(
                &r.name,
                "",
                &["recording", "judgement", "marker RMS, mm", "flights", "first remark"],
                cells,
            );
            Section::new(anchor("subject", &r.name), &r.name, "", vec![table.into()])
        })
        .collect();
    Chapter {
        id: "recordings".into(),
        title: "All recordings".into(),
        group: STUDY.into(),
        light: Light::Neutral,
        word: String::new(),
        sections,
    }
}
