//! What was identified, how well it predicts, and which recordings were used.

use super::STUDY;
use super::discovery::verdict_light;
use super::lights;
use super::prediction::model_table;
use super::story::{Story, TrialStory};
use super::wording::{card, maybe, number};
use aloft_analysis::compare::{errors_of, judged_on, mean};
use aloft_analysis::freshness::Freshness;
use aloft_compare::AgainstFloor;
use aloft_discover::{Discovery, Verdict};
use aloft_page::{Block, Card, Cell, Chapter, Light, Section, Table};

/// The first chapter.
pub fn chapter(story: &Story<'_>) -> Chapter {
    let cards = cards(story);
    let light = cards.iter().map(|c| c.light).max().unwrap_or_default();
    let mut result = banner(&story.freshness);
    result.push(Block::Cards { cards });
    result.extend(remarks(story));
    let mut sections = vec![Section::new(
        "result",
        "Result",
        "What was identified from flight, how well it predicts held-out measurements, and how reliable it is.",
        result,
    )];
    if let Some(view) = &story.comparison {
        let mut blocks: Vec<Block> = vec![model_table(view).into()];
        let words = &view.comparison.words;
        blocks.push(Block::List { items: words.iter().take(6).cloned().collect() });
        if words.len() > 6 {
            let rest = vec![Block::List { items: words[6..].to_vec() }];
            blocks.push(Block::Folded { title: "More".into(), blocks: rest });
        }
        sections.push(Section::new("in-short", "Model against measurement, in short", "", blocks));
    }
    sections.push(Section::new(
        "quality",
        "Quality of the recordings",
        "Every recording with its judgement and the reasons for it. In flight the centre of mass should fall with g: how nearly it \
         does, with the masses of the tables, checks cameras, markers and flight edges together.",
        vec![recordings(story).into()],
    ));
    Chapter { id: "overview".into(), title: "Overview".into(), group: STUDY.into(), light, sections }
}

/// The error of the present model against its floor, in flight and in contact.
fn errors(story: &Story<'_>) -> Vec<Card> {
    let Some(view) = &story.comparison else { return Vec::new() };
    let against = &view.comparison.against_floor;
    let of = |a: &AgainstFloor| {
        let title = format!("Error of the model in {}", a.judged_on);
        let own = format!("held out {} N", number(a.held_out_error));
        match (a.times_floor, a.floor) {
            (Some(ratio), Some(floor)) => {
                let note = format!("{own}; a perfect model would leave {} N", number(floor.noise_floor));
                let value = if a.at_floor == Some(true) {
                    "at its floor".to_owned()
                } else {
                    format!("{} × its floor", number(ratio))
                };
                let light = if a.at_floor == Some(true) { Light::Good } else { lights::times_floor(Some(ratio)) };
                card(&title, value, note, light)
            }
            _ => card(&title, own, "its floor is not known", Light::Neutral),
        }
    };
    against.iter().map(of).collect()
}

fn cards(story: &Story<'_>) -> Vec<Card> {
    let (light, note) = lights::recordings(story);
    let used = story.trials.iter().filter(|t| t.entry.excluded.is_none()).count();
    let mut cards = errors(story);
    cards.push(card("Recordings", used.to_string(), note, light));
    let rms: Vec<f64> = story.dynamic().filter_map(|t| t.kinematics.as_ref()?.marker_rms_mm).collect();
    let mean_rms = rms.iter().sum::<f64>() / rms.len() as f64;
    cards.push(card(
        "Marker error, RMS",
        format!("{} mm", number(mean_rms)),
        "mean over recordings; usual limit 20 mm",
        lights::marker_rms(mean_rms),
    ));
    let fall: Vec<f64> = story.dynamic().filter_map(|t| t.kinematics.as_ref()?.gravity_error_percent).collect();
    if !fall.is_empty() {
        let mean_fall = fall.iter().map(|g| g.abs()).sum::<f64>() / fall.len() as f64;
        cards.push(card(
            "Free fall against g",
            format!("{} %", number(mean_fall)),
            "mean size over recordings, masses of the tables",
            lights::free_fall(mean_fall),
        ));
    }
    if let Some(found) = &story.found {
        let p = &found.parameters;
        cards.push(card(
            "Flights",
            p.n_stretches.to_string(),
            format!("{} rows of the regressor", p.n_rows),
            Light::Neutral,
        ));
        cards.push(card(
            "Singular-value gap σ_N−1 / σ_N",
            number(p.sigma.ratio),
            "how clearly the motion shows the parameters; 20 is clear",
            lights::gap(p.sigma.ratio),
        ));
    }
    if let Some(view) = &story.comparison {
        let c = &view.comparison;
        let (force, moment, _, _) = errors_of(&c.first);
        let prior = c.beside.iter().find(|m| m.model == "prior").map(errors_of);
        let note = |p: Option<f64>, unit: &str| {
            let beside = p.map_or(String::new(), |p| format!("; prior {} {unit}", number(p)));
            format!("{}{beside}", judged_on(c))
        };
        let (f, n) = (prior.map(|p| mean(&p.0)), prior.map(|p| mean(&p.1)));
        let own = mean(&force);
        let title = "Force error, frame by frame";
        cards.push(card(title, format!("{} N", number(own)), note(f, "N"), Light::Neutral));
        let own = mean(&moment);
        let title = "Moment error, frame by frame";
        cards.push(card(title, format!("{} N·m", number(own)), note(n, "N·m"), Light::Neutral));
    }
    if let Some(d) = story.discovery() {
        let (value, light) = match d.verdict {
            Verdict::NothingMissing => ("nothing".to_owned(), Light::Good),
            Verdict::Unexplained => ("unexplained".to_owned(), Light::Poor),
            Verdict::Supported => (d.effects.join(", "), Light::Fair),
            Verdict::OneOf => (format!("one of {}", d.effects.len()), Light::Fair),
            Verdict::NotDetectable => ("cannot tell".to_owned(), Light::Neutral),
        };
        let held = story.history.revisions.last().map_or(String::new(), |r| match r.effects.len() {
            0 => "plain model".to_owned(),
            _ => format!("model holds {}", r.effects.join(", ")),
        });
        let added = was_added(story, d);
        let light = if added { Light::Good } else { light };
        cards.push(card(if added { "Was missing, now added" } else { "Missing from the model" }, value, held, light));
    }
    cards
}

/// True if the model now contains what an earlier answer named.
fn was_added(story: &Story<'_>, d: &Discovery) -> bool {
    let holds = |effects: &[String], id: &String| effects.iter().any(|key| key.split('[').next() == Some(id));
    let last = story.history.revisions.last();
    last.is_some_and(|r| match d.verdict {
        Verdict::OneOf => d.effects.iter().any(|e| holds(&r.effects, e)),
        _ => !d.effects.is_empty() && d.effects.iter().all(|e| holds(&r.effects, e)),
    })
}

/// States which results on this page differ from what the pipeline and the recordings would give
/// now.
pub fn banner(freshness: &Freshness) -> Vec<Block> {
    if freshness.is_current() {
        return Vec::new();
    }
    let text = format!(
        "Not up to date when this page was written. {}. `aloft run` and `aloft report` again bring it up to date.",
        freshness.describe().join("; ")
    );
    vec![Block::remark(Light::Poor, text)]
}

fn remarks(story: &Story<'_>) -> Vec<Block> {
    let mut blocks = Vec::new();
    for (stage, f) in &story.failures {
        let hint = f.hint.as_ref().map_or(String::new(), |h| format!(" Hint: {h}."));
        blocks.push(Block::remark(Light::Poor, format!("{stage} failed: {}.{hint}", f.problem.trim_end_matches('.'))));
    }
    if let Some(found) = &story.found {
        let gate = &found.parameters.gate;
        if gate.passed && gate.reasons.is_empty() {
            let text = "Motion determines only certain combinations of the mass parameters, the base parameters. Every value has its 95 % interval.";
            blocks.push(Block::remark(Light::Good, text));
        }
        let light = if gate.passed { Light::Fair } else { Light::Poor };
        blocks.extend(gate.reasons.iter().map(|r| Block::remark(light, r.clone())));
        if !gate.advice.is_empty() {
            blocks.push(Block::text("What to record next, to see more of the parameters:"));
            blocks.push(Block::List { items: gate.advice.iter().take(4).cloned().collect() });
        }
    }
    if let Some(d) = story.discovery() {
        blocks.push(if was_added(story, d) {
            let now = story.history.revisions.last().map_or(String::new(), |r| r.effects.join(", "));
            Block::remark(Light::Neutral, format!("The model now holds {now}, which the last `discover` found to be missing; ask it again for what remains."))
        } else {
            let text = format!("Asked what the model is missing, `discover` answers: {}.", d.words.trim_end_matches('.'));
            Block::remark(verdict_light(d.verdict), text)
        });
    } else if story.comparison.as_ref().is_some_and(|v| {
        v.comparison
            .against_floor
            .iter()
            .any(|a| lights::times_floor(a.times_floor) > Light::Good && a.at_floor != Some(true))
    }) {
        let text = "The error is above its floor: `aloft discover` looks for the effect that the model is missing.";
        blocks.push(Block::remark(Light::Fair, text));
    }
    blocks
}

/// Every recording with its judgement and the reasons.
fn recordings(story: &Story<'_>) -> Table {
    let rows = story.trials.iter().map(row).collect();
    Table::new(
        "Recordings",
        "Click a name to open the recording's chapter.",
        &[
            "recording",
            "judgement",
            "part",
            "length, s",
            "gaps filled",
            "missing, %",
            "marker RMS, mm",
            "flights",
            "fall against g, %",
            "reasons",
        ],
        rows,
    )
}

fn row(t: &TrialStory<'_>) -> Vec<Cell> {
    let light = lights::trial(t);
    let remarks = lights::remarks(t);
    let reasons = match (&t.entry.excluded, &t.import) {
        (Some(reason), _) => format!("excluded: {reason}"),
        (None, None) => "not run".to_owned(),
        _ => {
            let mut shown: Vec<String> = remarks.iter().take(2).map(|r| r.1.chars().take(160).collect()).collect();
            if remarks.len() > 2 {
                shown.push(format!("{} more", remarks.len() - 2));
            }
            shown.join("; ")
        }
    };
    let has_chapter = t.entry.role.is_dynamic() || !t.failures.is_empty();
    let name = Cell::from(t.entry.name.clone());
    let k = t.kinematics.as_ref();
    vec![
        if has_chapter { name.to(format!("#{}", t.anchor())) } else { name },
        Cell::light(light, ""),
        t.entry.role.word().into(),
        t.duration_s().map_or("–".into(), |s| format!("{s:.1}").into()),
        t.noted("filled_gaps").map_or("–".into(), |n| format!("{n:.0}").into()),
        t.missing_percent().map_or("–".into(), |p| format!("{p:.1}").into()),
        maybe(k.and_then(|k| k.marker_rms_mm)).into(),
        t.n_flights().map_or("–".into(), |n| n.to_string().into()),
        k.and_then(|k| k.gravity_error_percent).map_or("–".into(), |g| format!("{g:+.2}").into()),
        reasons.into(),
    ]
}
