//! The search for missing effects: verdict, ranking, confusable effects, history of the model,
//! recommended recordings.

use super::STUDY;
use super::candidates;
use super::joints;
use super::ladder;
use super::place_errors::{asked, effects, judged_place};
use super::story::Story;
use super::wording::{card, number};
use aloft_analysis::held_out::HeldOutError;
use aloft_discover::{Discovery, Verdict};
use aloft_page::{Block, Chapter, Light, Section};
use aloft_study::commands::command;

/// The chapter.
pub fn chapter(story: &Story<'_>) -> Chapter {
    let mut sections = Vec::new();
    let last = story.discoveries.len();
    for (i, (revision, d)) in story.discoveries.iter().enumerate() {
        let older = d.made_from != story.looked_at;
        let after = &d.errors_after;
        let d = &d.answer;
        sections.push(answer(story, *revision, d, after, last > 1, older));
        if i + 1 == last || last <= 2 {
            sections.push(candidates::ranking(d, &format!("-{revision}")));
            sections.extend(d.joints.as_ref().map(|j| joints::section(j, &format!("-{revision}"))));
        }
    }
    sections.extend(ladder::section(story));
    if let Some(d) = story.discovery() {
        if !d.advice.is_empty() {
            sections.push(Section::new(
                "next",
                "What to record next",
                "Motions that would distinguish the effects that these recordings cannot, the most useful first.",
                vec![Block::List { items: d.advice.clone() }],
            ));
        }
        let left: Vec<String> = d.warnings.iter().cloned().chain(d.not_tried.iter().map(ToString::to_string)).collect();
        if !left.is_empty() {
            let blocks = vec![Block::List { items: left }];
            sections.push(Section::new("left-out", "Data left out", "", blocks));
        }
    }
    let limits = story.comparison.as_ref().and_then(|v| v.limits.first());
    if let (Some(why), true) = (limits, story.discoveries.is_empty()) {
        let lead = format!("No effect can be told from these recordings: {why}.");
        sections.insert(0, Section::new("missing", "Cannot be told", &lead, Vec::new()));
    } else if story.discoveries.is_empty() {
        sections.insert(
            0,
            Section::new(
                "missing",
                "Not asked yet",
                "`discover` refits the mass parameters together with each physical effect and each measurement artefact, and judges them on recordings that took no part.",
                vec![Block::Commands { lines: ["discover", "report"].map(|w| command(story.session, w, None)).to_vec() }],
            ),
        );
    }
    // a verdict on an earlier model is no signal of the present one
    let passed = story.found.as_ref().is_some_and(|f| f.parameters.gate.passed);
    let of_joints = |d: &Discovery| d.joints.as_ref().map_or(Light::Neutral, |j| verdict_light(j.verdict));
    let light = match asked(story).map_or(Light::Neutral, |d| verdict_light(d.verdict).max(of_joints(d))) {
        // flights that are too few to determine the body show little of what is missing
        Light::Good if !passed => Light::Neutral,
        light => light,
    };
    Chapter {
        id: "discovery".into(),
        title: "What is missing".into(),
        group: STUDY.into(),
        light,
        word: String::new(),
        sections,
    }
}

/// Traffic light of a verdict.
pub fn verdict_light(v: Verdict) -> Light {
    match v {
        Verdict::NothingMissing => Light::Good,
        Verdict::Unexplained => Light::Poor,
        Verdict::Supported | Verdict::OneOf => Light::Fair,
        Verdict::NotDetectable => Light::Neutral,
    }
}

pub fn verdict_word(v: Verdict) -> &'static str {
    match v {
        Verdict::NothingMissing => "nothing missing",
        Verdict::Unexplained => "unexplained",
        Verdict::Supported => "supported",
        Verdict::OneOf => "one of several",
        Verdict::NotDetectable => "not detectable",
    }
}

/// The answer for one revision of the model.
fn answer(
    story: &Story<'_>,
    revision: usize,
    d: &Discovery,
    errors_after: &[HeldOutError],
    several: bool,
    older: bool,
) -> Section {
    let held = story.history.revisions.get(revision).map(|r| r.effects.join(", ")).filter(|e| !e.is_empty());
    let model = held.map_or_else(|| "the plain model".to_owned(), |e| format!("the model with {e}"));
    let present = story.history.revisions.last().map_or(0, |r| r.revision);
    let earlier = revision != present;
    let judged = if earlier { Light::Neutral } else { verdict_light(d.verdict) };
    let mut blocks = vec![Block::remark(judged, d.words.clone())];
    if earlier {
        let now = effects(story);
        let holds = if now.is_empty() { "no effects".to_owned() } else { format!("`{}`", now.join("`, `")) };
        let text = format!(
            "Computed for {model} (revision {revision}). The model is now revision {present} and holds {holds}."
        );
        blocks.insert(0, Block::remark(Light::Neutral, text));
    }
    if older {
        let text = "Not up to date: `discover` used other results than this page. Run it again.";
        blocks.insert(0, Block::remark(Light::Poor, text));
    }
    // the numbers of the motion on which the answer is judged, as the ladder shows them
    let row = story.history.revisions.get(revision);
    let place = judged_place(Some(d), row);
    let at_place = |all: &[HeldOutError]| all.iter().find(|e| Some(&e.judged_on) == place.as_ref()).cloned();
    let before = row.and_then(|r| at_place(&r.errors));
    let error_n = before.as_ref().map_or(d.held_out_error, |e| e.held_out_error);
    let after_n = at_place(errors_after).map_or(d.held_out_error_after, |e| e.held_out_error);
    let floor_n = before.as_ref().and_then(|e| e.noise_floor).unwrap_or(d.noise_floor);
    let share = 100.0 * before.as_ref().and_then(|e| e.held_out_error_of_weight).unwrap_or(d.held_out_error_of_weight);
    let motion = place.as_ref().map_or(String::new(), |p| format!(", in {p}"));
    let mut cards = vec![
        card("Verdict", verdict_word(d.verdict).to_owned(), d.effects.join(", "), judged),
        card(
            "Held-out error",
            format!("{} N", number(error_n)),
            format!("{share:.2} % of the weight{motion}"),
            Light::Neutral,
        ),
    ];
    if !d.found.is_empty() {
        let names: Vec<&str> = d.found.iter().map(|f| f.key.as_str()).collect();
        cards.push(card(
            "With the effects found",
            format!("{} N", number(after_n)),
            format!("with {}", names.join(", ")),
            Light::Neutral,
        ));
    }
    cards.push(card(
        "Noise floor",
        format!("{} N", number(floor_n)),
        "the error of a perfect model on these recordings",
        Light::Neutral,
    ));
    blocks.push(Block::Cards { cards });
    if let Some(e) = &d.evidence {
        blocks.push(Block::text(format!(
            "Judged by one marginal likelihood over flights and contact together. In units of their noise the rows leave {}, and {} with what was \
             found; an effect is named from odds of 20 to 1, which recordings left out one by one have to give, too.",
            number(e.residual_before),
            number(e.residual_after)
        )));
    }
    if d.rounds.len() > 1 {
        let items = d.rounds.iter().enumerate().map(|(i, r)| {
            let with = if r.model.is_empty() { "plain".to_owned() } else { format!("with {}", r.model.join(", ")) };
            format!("Question {} ({with}): {}", i + 1, r.words)
        });
        blocks.push(Block::List { items: items.collect() });
    }
    let title =
        if several || earlier { format!("Revision {revision}: asked of {model}") } else { "The verdict".to_owned() };
    Section::new(
        format!("missing-{revision}"),
        &title,
        "Each effect was refitted together with the mass parameters and judged on recordings that took no part.",
        blocks,
    )
}
