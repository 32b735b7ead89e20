//! What was identified, how well it predicts, and which recordings were used.

use super::headline::headline;
use super::place_errors::{self, errors_by_place};
use super::prediction::model_table;
use super::story::{Story, TrialStory};
use super::wording::{at_words, card, maybe, number};
use super::{STUDY, ladder, lights, player, residuals, series, session};
use aloft_analysis::freshness::Freshness;
use aloft_page::{Block, Card, Cell, Chapter, Light, Section, Table};
use aloft_workspace::error::PipelineError;

/// What people wrote about the study, one paragraph for each empty line.
fn notes(story: &Story<'_>) -> Option<Section> {
    let paragraphs = story.notes.split("\n\n").map(str::trim).filter(|p| !p.is_empty());
    let blocks: Vec<Block> = paragraphs.map(Block::text).collect();
    (!blocks.is_empty()).then(|| Section::new("notes", "Notes", "Kept with the results.", blocks))
}

/// The first chapter: the headline with the ladder and the player, what remains, then the quality
/// of the recordings.
///
/// # Errors
/// A recording that was imported cannot be read.
pub fn chapter(story: &Story<'_>) -> Result<Chapter, PipelineError> {
    let mut left: Vec<Block> = vec![headline(story).into()];
    left.extend(ladder::picture(story).map(Block::from));
    let place = errors_by_place(story).first().map(|s| s.place.clone());
    let view = story.comparison.as_ref();
    left.extend(view.zip(place).and_then(|(v, place)| residuals::remains(&v.comparison, &place)).map(Block::from));
    let example = example(story);
    let player = example.map_or(Ok(None), |t| player::figure(story, t))?;
    let mut first = banner(&story.freshness);
    match player {
        Some(figure) => first.push(Block::Beside { left, right: vec![figure.into()] }),
        None => first.extend(left),
    }
    let mut sections = vec![Section::new("result", "", "", first)];
    let curves: Vec<Block> = example.and_then(|t| series::wrench(story, t)).into_iter().map(Block::from).collect();
    if !curves.is_empty() {
        let lead = "The recording of the player above. Each recording has its curves in its own chapter.";
        sections.push(Section::new("curves", "Measured and predicted", lead, curves));
    }
    sections.extend(notes(story));
    sections.extend(session::section(story));
    let mut details = vec![Block::Cards { cards: cards(story) }];
    details.extend(remarks(story));
    if let Some(view) = view {
        details.push(model_table(view).into());
        let words = view.sentences(true);
        details.push(Block::Folded {
            title: "Where the model fails, in sentences".into(),
            blocks: vec![Block::List { items: words }],
        });
    }
    sections.push(Section::new("details", "What it rests on", "", details));
    sections.push(Section::new(
        "quality",
        "Quality of the recordings",
        "Every recording with its judgement and the reasons for it. In flight the centre of mass should fall with g: how nearly it \
         does, with the masses of the tables, checks cameras, markers and flight edges together.",
        vec![recordings(story).into()],
    ));
    let (light, word) = place_errors::standing(story);
    let group = STUDY.into();
    Ok(Chapter { id: "overview".into(), title: "Overview".into(), group, light, word, sections })
}

/// The recording shown on the first screen: the one on which the model errs most where it is
/// judged, of those that can be played.
fn example<'s, 'a>(story: &'s Story<'a>) -> Option<&'s TrialStory<'a>> {
    let place = errors_by_place(story).first().map_or_else(|| "flight".to_owned(), |s| s.place.clone());
    let error = |t: &TrialStory<'_>| {
        let own = story.comparison.as_ref()?.comparison.first.trials.iter().find(|c| c.trial == t.entry.name)?;
        let (errors, held) = if place == "flight" {
            (&own.flight_weak, own.held_out_flight)
        } else {
            (&own.contact_weak, own.held_out_contact)
        };
        (held && errors.windows > 0).then(|| errors.size()).filter(|e| e.is_finite())
    };
    let played = || story.dynamic().filter(|t| t.motion.is_some());
    let worst = played().filter_map(|t| Some((error(t)?, t))).max_by(|a, b| a.0.total_cmp(&b.0));
    worst.map(|w| w.1).or_else(|| played().next())
}

fn cards(story: &Story<'_>) -> Vec<Card> {
    let (light, note) = lights::recordings(story);
    // a signal only where something is wrong: good recordings say nothing about the model
    let quiet = |l: Light| if l == Light::Good { Light::Neutral } else { l };
    let used = story.trials.iter().filter(|t| t.entry.excluded.is_none()).count();
    let mut cards = vec![card("Recordings", used.to_string(), note, quiet(light))];
    let rms: Vec<f64> = story.dynamic().filter_map(|t| t.kinematics.as_ref()?.marker_rms_mm).collect();
    let mean_rms = rms.iter().sum::<f64>() / rms.len() as f64;
    cards.push(card(
        "Marker error, RMS",
        format!("{} mm", number(mean_rms)),
        format!("mean over recordings; {}", lights::usual_limit()),
        quiet(lights::marker_rms(mean_rms)),
    ));
    let fall: Vec<f64> = story.dynamic().filter_map(|t| t.kinematics.as_ref()?.gravity_error_percent).collect();
    if !fall.is_empty() {
        let mean_fall = fall.iter().map(|g| g.abs()).sum::<f64>() / fall.len() as f64;
        cards.push(card(
            "Free fall against g",
            format!("{} %", number(mean_fall)),
            "mean size over recordings, masses of the tables",
            quiet(lights::free_fall(mean_fall)),
        ));
    }
    if let Some(found) = &story.found {
        let p = &found.parameters;
        cards.push(card(
            "Flights",
            p.n_flights().to_string(),
            format!("{} rows of the regressor", p.n_rows),
            Light::Neutral,
        ));
        let before = story.history.revisions.iter().rev().nth(1).and_then(|r| r.sigma_ratio);
        let was = before.map_or(String::new(), |b| format!("; {} in the revision before", number(b)));
        cards.push(card(
            "Singular-value gap σ_N−1 / σ_N",
            number(p.sigma.ratio),
            format!("how clearly the motion shows the parameters; 20 is clear{was}"),
            quiet(lights::gap(p.sigma.ratio)),
        ));
    }
    cards
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
    let lost: Vec<&str> =
        story.trials.iter().filter(|t| !t.failures.is_empty()).map(|t| t.entry.name.as_str()).collect();
    if !lost.is_empty() {
        let text = format!(
            "Failed, and in none of these numbers: {}. The error, the gap and the intervals rest on the other recordings.",
            lost.join(", ")
        );
        blocks.push(Block::remark(Light::Poor, text));
    }
    if let Some(found) = &story.found {
        let gate = &found.parameters.gate;
        if gate.passed && gate.reasons.is_empty() {
            let text = "Motion determines only certain combinations of the mass parameters, the base parameters. Every value has its 95 % interval.";
            blocks.push(Block::remark(Light::Neutral, text));
        }
        let light = if gate.passed { Light::Fair } else { Light::Poor };
        blocks.extend(gate.reasons.iter().map(|r| Block::remark(light, r.clone())));
        if !gate.advice.is_empty() {
            let advice = gate.advice.iter().take(4).cloned().collect();
            let title = "What to record next, to see more of the parameters".to_owned();
            blocks.push(Block::Folded { title, blocks: vec![Block::List { items: advice }] });
        }
    }
    blocks
}

/// Every recording with its judgement and the reasons.
fn recordings(story: &Story<'_>) -> Table {
    let rows = story.trials.iter().map(row).collect();
    Table::new(
        "Recordings",
        "Judgement, name and reasons. Click a name to open the recording's chapter.",
        &["recording", "part", "length, s", "missing, %", "marker RMS, mm", "flights", "fall against g, %"],
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
            let mut shown: Vec<String> = remarks.iter().take(2).map(|r| at_words(&r.1, 160)).collect();
            if remarks.len() > 2 {
                shown.push(format!("{} more", remarks.len() - 2));
            }
            shown.join("; ")
        }
    };
    let has_chapter = t.entry.role.is_dynamic() || !t.failures.is_empty();
    let name = Cell::light(light, t.entry.name.clone()).with_note(reasons);
    let k = t.kinematics.as_ref();
    vec![
        if has_chapter { name.to(format!("#{}", t.anchor())) } else { name },
        t.entry.role.word().into(),
        t.duration_s().map_or("–".into(), |s| format!("{s:.1}").into()),
        t.missing_percent().map_or("–".into(), |p| format!("{p:.1}").into()),
        maybe(k.and_then(|k| k.marker_rms_mm)).into(),
        t.n_flights().map_or("–".into(), |n| n.to_string().into()),
        k.and_then(|k| k.gravity_error_percent).map_or("–".into(), |g| format!("{g:+.2}").into()),
    ]
}
