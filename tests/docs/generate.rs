//! Pages generated from the code: commands, pipeline keys, stages, effects, formats, quality
//! reasons, messages, the JSON contract.

use crate::json_contract;
use crate::source::{self, Item, Items, markdown, module_doc, snake};
use crate::{AGAIN, aloft, docs, root, updating};
use aloft_analysis::unknowns::{self, Examples, unit};
use aloft_compare::{Grade, Reserve, Signal};
use aloft_effects::{ActsIn, EFFECTS, EffectKind, Target};
use aloft_pipeline::graph::{DATED, Need, Scope};
use aloft_pipeline::stages::STAGES;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Pages by their place below `docs/`.
pub type Pages = BTreeMap<String, String>;

fn from(place: &str) -> String {
    format!("<!-- Made from {place}; tests/docs writes it again. -->\n\n")
}

/// Escapes `|` within a cell of a table.
pub fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

/// Every generated page.
pub fn pages() -> Pages {
    let mut pages = Pages::new();
    let schema: serde_json::Value = serde_json::from_str(&aloft(&["schema"])).unwrap();
    pages.insert("reference/commands.md".into(), commands());
    pages.insert("reference/pipeline.md".into(), pipeline(&schema));
    stages(&schema, &mut pages);
    effects(&mut pages);
    formats(&mut pages);
    pages.insert("reference/quality.md".into(), quality());
    pages.insert("reference/grades.md".into(), grades());
    pages.insert("reference/messages.md".into(), messages());
    pages.insert("reference/json.md".into(), json_contract::page());
    pages.insert("findings/README.md".into(), findings());
    let summary = crate::book::summary(&pages);
    pages.insert("SUMMARY.md".into(), summary);
    pages
}

fn commands() -> String {
    let mut out = from("the definitions in crates/cli/src/args.rs and crates/cli/src/args");
    out += "# Commands\n\nWhat `aloft --help` and `aloft COMMAND --help` print. `aloft man` prints the manual page, `aloft completions SHELL` the completions.\n\n";
    let help = |words: &[&str]| aloft(words).trim_end().to_owned();
    let _ = writeln!(out, "```text\n{}\n```\n", help(&["--help"]));
    for command in commands_of(&help(&["--help"])) {
        let text = help(&[&command, "--help"]);
        let _ = writeln!(out, "## `aloft {command}`\n\n```text\n{text}\n```\n");
        for inner in commands_of(&text) {
            let _ = writeln!(
                out,
                "### `aloft {command} {inner}`\n\n```text\n{}\n```\n",
                help(&[&command, &inner, "--help"])
            );
        }
    }
    out
}

fn commands_of(help: &str) -> Vec<String> {
    help.lines()
        .skip_while(|l| *l != "Commands:")
        .skip(1)
        .take_while(|l| !l.is_empty())
        .filter(|l| l.starts_with("  ") && !l[2..].starts_with(' '))
        .filter_map(|l| l.split_whitespace().next())
        .filter(|c| *c != "help")
        .map(str::to_owned)
        .collect()
}

/// The definition behind a property of the schema, and its own description.
fn resolved<'a>(schema: &'a serde_json::Value, property: &'a serde_json::Value) -> Option<&'a serde_json::Value> {
    let reference = property["$ref"]
        .as_str()
        .or_else(|| property["anyOf"].as_array()?.iter().find_map(|x| x["$ref"].as_str()))
        .or_else(|| property["allOf"].as_array()?.iter().find_map(|x| x["$ref"].as_str()))?;
    schema.pointer(reference.trim_start_matches('#'))
}

fn kind_of(schema: &serde_json::Value, property: &serde_json::Value) -> String {
    if let Some(target) = resolved(schema, property) {
        let words: Vec<&str> = target["oneOf"]
            .as_array()
            .map(|all| all.iter().filter_map(|v| v["const"].as_str()).collect())
            .or_else(|| target["enum"].as_array().map(|all| all.iter().filter_map(|v| v.as_str()).collect()))
            .unwrap_or_default();
        if !words.is_empty() {
            return words.iter().map(|w| format!("`{w}`")).collect::<Vec<_>>().join(", ");
        }
        return "section".to_owned();
    }
    let range = match (property["minimum"].as_f64(), property["maximum"].as_f64()) {
        (Some(low), Some(high)) => format!(", {low} to {high}"),
        _ => String::new(),
    };
    let word = |w: &str| match w {
        "integer" => format!("whole number{range}"),
        "number" => format!("number{range}"),
        "boolean" => "true or false".to_owned(),
        "array" => {
            let inner = kind_of(schema, &property["items"]);
            format!("list of {}", if inner == "section" { "sections".to_owned() } else { inner })
        }
        "object" => format!("map to {}", kind_of(schema, &property["additionalProperties"])),
        other => other.to_owned(),
    };
    match &property["type"] {
        serde_json::Value::String(s) => word(s),
        serde_json::Value::Array(all) => {
            all.iter().filter_map(|v| v.as_str()).filter(|w| *w != "null").map(word).collect::<Vec<_>>().join(" or ")
        }
        _ => "any".to_owned(),
    }
}

/// Rows of a table of a section's keys.
fn keys(schema: &serde_json::Value, section: &serde_json::Value) -> String {
    let mut out = "| key | value | default | meaning |\n|---|---|---|---|\n".to_owned();
    let required: Vec<&str> =
        section["required"].as_array().map(|a| a.iter().filter_map(|v| v.as_str()).collect()).unwrap_or_default();
    for (name, property) in section["properties"].as_object().into_iter().flatten() {
        let kind = kind_of(schema, property);
        let default = match &property["default"] {
            _ if required.contains(&name.as_str()) => "required".to_owned(),
            serde_json::Value::Null => "–".to_owned(),
            _ if kind == "section" => "–".to_owned(),
            value => format!("`{value}`"),
        };
        let meaning = property["description"].as_str().unwrap_or_default();
        let _ = writeln!(out, "| `{name}` | {} | {} | {} |", cell(&kind), cell(&default), cell(meaning));
    }
    out
}

fn pipeline(schema: &serde_json::Value) -> String {
    let mut out = from("the structures in crates/study/src/config");
    out += "# Pipeline files\n\nEvery key that a pipeline (YAML) may have. Unknown keys are errors that point at their line. `aloft schema` prints the JSON schema for editors. \
        Each section belongs to the stage of the same name, so that a changed value makes just that stage, and what follows from it, run again.\n\n## The file\n\n";
    out += &keys(schema, schema);
    for (name, property) in schema["properties"].as_object().unwrap() {
        let Some(section) = resolved(schema, property).filter(|s| s["properties"].is_object()) else { continue };
        let _ = writeln!(out, "\n## `{name}`\n\n{}\n", property["description"].as_str().unwrap_or_default());
        out += &keys(schema, section);
        for (inner, property) in section["properties"].as_object().unwrap() {
            let nested = resolved(schema, property).or_else(|| resolved(schema, &property["items"]));
            if let Some(nested) = nested.filter(|s| s["properties"].is_object()) {
                let _ = writeln!(out, "\n### `{name}.{inner}`\n\n{}", keys(schema, nested));
            }
        }
    }
    out
}

fn stages(schema: &serde_json::Value, pages: &mut Pages) {
    let mut index = from("the slice STAGES in crates/pipeline/src/stages/mod.rs");
    index += "# Stages\n\nEach stage runs again when a recording, a parameter that it sees, or its code changed.\n\n| stage | runs | reads | gives |\n|---|---|---|---|\n";
    let session = demo_study();
    let folder = root().join("crates/pipeline/src/stages");
    for stage in STAGES {
        let runs = match stage.scope {
            Scope::Session => "once a study".to_owned(),
            Scope::Trial(roles) => {
                format!("once a trial: {}", roles.iter().map(|r| r.word()).collect::<Vec<_>>().join(", "))
            }
        };
        let _ = writeln!(index, "| [`{0}`]({0}.md) | {runs} | {1} | {2} |", stage.name, stage.reads, stage.gives);
        let file = folder.join(format!("{}.rs", stage.name));
        let mut page = from(&format!("crates/pipeline/src/stages/{}.rs", stage.name));
        let _ = writeln!(page, "# Stage `{}`\n\n{}\n", stage.name, module_doc(&file, 3));
        let _ =
            writeln!(page, "Runs {runs}. Version {} of its results.\n\n## Reads\n\n{}.\n", stage.version, stage.reads);
        for need in stage.needs {
            let words = match need {
                Need::Recording => "the recording's files".to_owned(),
                Need::Same(s) => format!("[`{s}`]({s}.md) of the same trial"),
                Need::Once(s) => format!("[`{s}`]({s}.md) of the study"),
                Need::Times => {
                    format!("when in the session the trial was recorded ([`{DATED}`]({DATED}.md) of every trial)")
                }
                Need::Every(s, roles) | Need::Merged(s, roles) | Need::EveryOrStaticFrames(s, roles) => {
                    let roles: Vec<&str> = roles.iter().map(|r| r.word()).collect();
                    format!("[`{s}`]({s}.md) of every trial that came through ({})", roles.join(", "))
                }
            };
            let _ = writeln!(page, "- {words}");
        }
        let _ = writeln!(
            page,
            "\n## Gives\n\n{}.\n\nIn `WORKSPACE/{}/TRIAL/` (`_study` for the whole study), with `manifest.json`: inputs and their hashes, parameters, version, outcome, warnings.\n",
            stage.gives, stage.name
        );
        page += "## Parameters\n\n";
        let trial = stage.tasks(&session).into_iter().flatten().next();
        let seen = (stage.parameters)(&session, trial);
        let names: Vec<String> =
            seen.as_object().map(|o| o.keys().map(|k| format!("`{k}`")).collect()).unwrap_or_default();
        let _ = writeln!(page, "A change of one of these makes the stage run again: {}.\n", names.join(", "));
        if let Some(section) = schema["properties"]
            .get(stage.name)
            .and_then(|p| resolved(schema, p))
            .filter(|s| s["properties"].is_object())
        {
            let _ = writeln!(
                page,
                "Under `{}` in the [pipeline](../pipeline.md):\n\n{}",
                stage.name,
                keys(schema, section)
            );
        }
        pages.insert(format!("reference/stages/{}.md", stage.name), page.trim_end().to_owned() + "\n");
    }
    pages.insert("reference/stages/README.md".into(), index);
}

fn demo_study() -> aloft_study::subject_session::SubjectSession {
    let overrides = aloft_study::subject_session::Overrides {
        workspace: Some(root().join("no-such-workspace")),
        ..aloft_study::subject_session::Overrides::default()
    };
    aloft_study::subject_session::SubjectSession::open(&root().join("pipelines/demo.yaml"), &overrides).unwrap()
}

fn effects(pages: &mut Pages) {
    let mut index = from("the slice EFFECTS in crates/effects/src/catalog/mod.rs");
    index += "# Effects\n\nWhat a model may be missing. `aloft effect list` and `aloft effect show NAME` print the same; formulas of your own stand in `configs/effects/`.\n\n| effect | what | kind | acts | coefficients |\n|---|---|---|---|---|\n";
    let examples = Examples::built_in().unwrap();
    for effect in EFFECTS.iter().copied() {
        let kind = match effect.kind() {
            EffectKind::Physics => "physics",
            EffectKind::Artefact => "artefact",
        };
        let acts = match effect.acts() {
            ActsIn::Both => "in flight and contact",
            ActsIn::Flight => "in flight",
            ActsIn::Contact => "in contact",
            ActsIn::Joints => "in a robot's joints",
        };
        let scene = if effect.acts().in_joints() { &examples.robot } else { &examples.person };
        let targets = effect.targets(scene);
        let first = targets.first().copied().unwrap_or(Target::Body);
        let names: Vec<String> =
            effect.coefficients(scene, first).iter().map(|c| format!("`{}` {}", c.name, unit(&c.unit))).collect();
        let _ = writeln!(
            index,
            "| [`{0}`]({0}.md) | {1} | {kind} | {acts} | {2} |",
            effect.id(),
            effect.title(),
            names.join(", ")
        );
        let mut page = from(&format!("crates/effects/src/catalog/{}.rs", effect.id()));
        let _ = writeln!(page, "# `{}`: {}\n\n{} that acts {acts}.", effect.id(), effect.title(), capital(kind));
        if !effect.about().class.is_empty() {
            let _ = writeln!(
                page,
                "Recordings of one kind cannot tell it from others of the class *{}*.",
                effect.about().class
            );
        }
        if !effect.about().contains.is_empty() {
            let inner: Vec<String> = effect.about().contains.iter().map(|c| format!("[`{c}`]({c}.md)")).collect();
            let _ = writeln!(page, "It contains {}, so it counts only where it does better.", inner.join(", "));
        }
        if effect.about().by_group {
            page += "It shows only as a difference between groups of trials.\n";
        }
        let lines: Vec<&str> = effect.about().documentation.trim().lines().collect();
        let _ = writeln!(page, "\n{}\n", markdown(&lines, 1));
        page += &unknowns::table(effect, &examples);
        pages.insert(format!("reference/effects/{}.md", effect.id()), page);
    }
    pages.insert("reference/effects/README.md".into(), index);
}

fn capital(word: &str) -> String {
    let mut chars = word.chars();
    chars.next().map(|c| c.to_uppercase().chain(chars).collect()).unwrap_or_default()
}

fn formats(pages: &mut Pages) {
    let mut index = from("the documentation of the modules that read and write");
    index += "# Formats\n\n| format | direction | what |\n|---|---|---|\n";
    let reading = [
        ("c3d", "C3D", "crates/c3d/src/lib.rs"),
        ("trc", "TRC", "crates/trial/src/trc.rs"),
        ("mot", "MOT and STO", "crates/trial/src/mot.rs"),
        ("urdf", "URDF", "crates/body/src/urdf.rs"),
    ];
    for (name, title, file) in reading {
        let doc = module_doc(&root().join(file), 2);
        let first = doc.lines().next().unwrap_or_default();
        let _ = writeln!(index, "| [{title}](reading-{name}.md) | read | {} |", cell(first));
        pages.insert(
            format!("reference/formats/reading-{name}.md"),
            format!("{}# Reading {title}\n\n{doc}\n", from(file)),
        );
    }
    let writing = root().join("crates/export/src/formats");
    for path in source::rust_files(&writing) {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        if name == "mod" {
            continue;
        }
        let relative = path.strip_prefix(root()).unwrap().display().to_string();
        let doc = module_doc(&path, 2);
        let first = doc.lines().next().unwrap_or_default();
        let _ = writeln!(index, "| [{name}](writing-{name}.md) | written | {} |", cell(first));
        pages.insert(
            format!("reference/formats/writing-{name}.md"),
            format!("{}# Writing `{name}`\n\n{doc}\n", from(&relative)),
        );
    }
    pages.insert("reference/formats/README.md".into(), index);
}

/// Lists of reasons shown in tables, each with its file and enum.
const REASONS: &[(&str, &str, &str, &str)] = &[
    (
        "Recording",
        "reasons for which `import` warns or refuses a trial (`quality.json`)",
        "crates/trial/src/quality.rs",
        "QualityReason",
    ),
    ("Scaling", "warnings of `scale` (`report.json`)", "crates/scale/src/report.rs", "ScaleWarning"),
    (
        "Flights",
        "why a stretch that looked like a flight was not taken (`flights.json`)",
        "crates/flight/src/flight.rs",
        "RejectionReason",
    ),
    ("C3D", "what was odd in a C3D file (`aloft inspect`)", "crates/c3d/src/error.rs", "WarningKind"),
];

fn quality() -> String {
    let mut out = from("the closed lists of reasons in the code");
    out += "# Quality reasons\n\nWhat tables, `--json` and reports say about a recording, from closed lists. A reason never stops other trials. What to do about each: [How to record](../recording.md) and [Troubleshooting](../troubleshooting.md).\n";
    out += "\n## Summary\n\nReasons in the table that ends a run (`aloft summary`, `summary.csv`). `failed`: there is no result; `warning`: results may suffer; `ok`: good to know.\n\n| reason | weight | meaning | what to do |\n|---|---|---|---|\n";
    for r in aloft_workspace::qc::QcReason::ALL {
        let _ =
            writeln!(out, "| `{}` | {} | {} | {} |", r.code(), r.level().word(), cell(r.meaning()), cell(r.advice()));
    }
    let crates = Items::read(&root().join("crates"));
    for (title, what, file, name) in REASONS {
        let in_crate = file.split('/').nth(1).unwrap();
        let Some((_, Item::Enum(variants, _), _)) = crates.get(in_crate, &source::Uses::new(), name) else {
            panic!("{file} has no list `{name}`: correct REASONS in tests/docs/generate.rs")
        };
        let text = std::fs::read_to_string(root().join(file)).unwrap();
        let _ = write!(out, "\n## {title}\n\n{}.\n\n| reason | meaning | words |\n|---|---|---|\n", capital(what));
        for (variant, doc) in variants {
            let _ = writeln!(out, "| `{}` | {} | {} |", snake(variant), cell(doc), cell(&words_of(&text, variant)));
        }
    }
    out
}

/// The text that `Display` writes for a variant, where it is a plain `write!`.
fn words_of(text: &str, variant: &str) -> String {
    let display = text.find("Display for").map_or("", |i| &text[i..]);
    let start =
        [format!("Self::{variant} "), format!("Self::{variant}{{")].iter().find_map(|k| display.find(k.as_str()));
    let Some(arm) = start.map(|i| &display[i..]) else { return String::new() };
    let end = arm[6..].find("Self::").map_or(arm.len(), |i| i + 6);
    let arm = &arm[..end];
    let Some(open) = arm.find("write!").and_then(|w| arm[w..].find('"').map(|q| w + q + 1)) else {
        return arm.find("=> \"").and_then(|a| arm[a + 4..].split('"').next()).unwrap_or_default().to_owned();
    };
    let close = arm[open..].find("\"").map_or(arm.len(), |i| open + i);
    // placeholders without their formats
    let mut out = String::new();
    let mut rest = &arm[open..close];
    while let Some(colon) = rest.find(":.").filter(|i| rest[..*i].rfind('{') > rest[..*i].rfind('}')) {
        out.push_str(&rest[..colon]);
        rest = rest[colon..].find('}').map_or("", |i| &rest[colon + i..]);
    }
    (out + rest).replace("{}", "{…}")
}

fn grades() -> String {
    let mut out = from("crates/compare/src/grade.rs");
    out += "# Grades\n\nA held-out error is graded by its ratio to the [noise floor](../mathematics/estimation.md#the-noise-floor), never by newtons. Every command, the report, the studio, exports and `--json` (`grade`, `judged`) \
        show the same grade of the same error, and the same colour.\n\n| grade | `--json` | colour | when | what to do |\n|---|---|---|---|---|\n";
    let name = |variant: &dyn Fn() -> serde_json::Value| variant().as_str().unwrap().to_owned();
    for g in Grade::ALL {
        let colour = match g.signal() {
            Signal::Unknown => "none",
            Signal::Good => "green",
            Signal::Fair => "yellow",
            Signal::Poor => "red",
        };
        let key = name(&|| serde_json::json!(g));
        let _ = writeln!(out, "| {} | `{key}` | {colour} | {} | {} |", g.word(), g.meaning(), g.advice());
    }
    out += "\nThe floor of single recordings has no interval; their errors are *good*, *fair* or *poor* by the ratio. Few recordings make the interval wide: *at the floor* then says little.\n\n\
        A grade can be worse than the ratio. The reason follows the word after a colon (`because` in `--json`):\n\n| reason | `--json` | meaning |\n|---|---|---|\n";
    for r in Reserve::ALL {
        let key = name(&|| serde_json::json!(r));
        let _ = writeln!(out, "| {} | `{key}` | {} |", r.words(), r.meaning());
    }
    out
}

fn messages() -> String {
    let mut out = from("the error types of all crates");
    out += "# Messages\n\nEvery error that the crates can give, with placeholders in braces. A message of a failed trial stands on one line: `failed: STAGE TRIAL: message`, then a hint and the command that repeats just that. What to do in common cases: [Troubleshooting](../troubleshooting.md).\n";
    let crates = root().join("crates");
    let mut names: Vec<String> =
        std::fs::read_dir(&crates).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    for name in names {
        for file in source::rust_files(&crates.join(&name).join("src")) {
            let text = std::fs::read_to_string(&file).unwrap();
            for (list, messages) in source::messages(&text) {
                let _ = write!(out, "\n## {name}: `{list}`\n\n| message | meaning |\n|---|---|\n");
                for m in messages {
                    let hint = m.help.map_or(String::new(), |h| format!(" Hint: {h}."));
                    let _ =
                        writeln!(out, "| `{}` | {}{} |", cell(&m.text).replace('`', "'"), cell(&m.doc), cell(&hint));
                }
            }
        }
    }
    out
}

fn findings() -> String {
    let mut out = from("the files in docs/findings");
    out += "# Findings\n\nWhat was measured with the program, each with the commands that give it again.\n\n";
    let mut any = false;
    for (file, title) in crate::book::findings() {
        let _ = writeln!(out, "- [{title}]({file})");
        any = true;
    }
    if !any {
        out += "None yet.\n";
    }
    out
}

#[test]
fn generated_pages_are_those_of_the_code() {
    let pages = pages();
    let folder = docs();
    let mut stale: Vec<String> = Vec::new();
    // pages for items that no longer exist
    for part in ["reference/stages", "reference/effects", "reference/formats"] {
        for entry in std::fs::read_dir(folder.join(part)).into_iter().flatten() {
            let path = entry.unwrap().path();
            let name = format!("{part}/{}", path.file_name().unwrap().to_string_lossy());
            if !pages.contains_key(&name) {
                if updating() {
                    std::fs::remove_file(&path).unwrap();
                } else {
                    stale.push(format!("{name} describes something that is gone"));
                }
            }
        }
    }
    for (name, text) in &pages {
        let path = folder.join(name);
        let found = std::fs::read_to_string(&path).ok().unwrap_or_default();
        if found == *text {
            continue;
        }
        if updating() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
        } else {
            let line = found.lines().zip(text.lines()).position(|(a, b)| a != b).unwrap_or(0);
            stale.push(format!("{name}, line {}", line + 1));
        }
    }
    assert!(stale.is_empty(), "stale pages in docs/:\n  {}\n{AGAIN}", stale.join("\n  "));
}

/// The table of what formulas may name.
fn quantities_table() -> String {
    let mut out = "| quantity | unit | meaning |\n|---|---|---|\n".to_owned();
    for g in aloft_effects::quantities() {
        let names: Vec<String> = g.each().map(|name| format!("`{name}`")).collect();
        out += &format!("| {} | {} | {} |\n", names.join(" "), g.unit, g.meaning);
    }
    out + "| `q_<link>` `qd_<link>` | rad, rad/s (m, m/s) | coordinate and rate of a hinge (slide) |\n"
}

#[test]
fn the_book_lists_the_quantities_of_formulas() {
    let (path, table) = (docs().join("effects.md"), quantities_table());
    let page = std::fs::read_to_string(&path).unwrap();
    if updating() {
        let start = page.find("| quantity |").unwrap();
        let end = start + page[start..].find("\n\n").unwrap() + 1;
        std::fs::write(&path, [&page[..start], &table, &page[end..]].concat()).unwrap();
    } else {
        assert!(page.contains(&table), "{} has another table of quantities; {AGAIN}", path.display());
    }
}

#[test]
fn every_stage_effect_and_format_has_its_page() {
    let pages = pages();
    for stage in STAGES {
        let page = &pages[&format!("reference/stages/{}.md", stage.name)];
        for heading in ["## Reads", "## Gives", "## Parameters"] {
            assert!(page.contains(heading), "{} lacks {heading}", stage.name);
        }
    }
    for effect in EFFECTS {
        let page = &pages[&format!("reference/effects/{}.md", effect.id())];
        for heading in ["## Physics", "## Equation", "## Identifiability", "## References", "## Coefficients"] {
            assert!(page.contains(heading), "{} lacks {heading}", effect.id());
        }
        assert!(page.contains("linearly |"), "{} has no coefficient", effect.id());
    }
    assert!(pages["reference/pipeline.md"].contains("| `cutoff_hz` |"));
    assert!(pages["reference/messages.md"].matches("\n| `").count() > 50);
    assert!(pages["reference/quality.md"].contains("`missing_marker`"));
    assert!(pages["reference/grades.md"].contains("| fair | `fair` | yellow |"));
}
