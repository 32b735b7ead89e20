//! What a sent page computes in the browser is what the program computes, to nine digits, for every
//! fixture that has a report.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests fail by panicking")]

use aloft_analysis::discover::{discover, options};
use aloft_analysis::switches::{LeftOut, Switches};
use aloft_page::switches::KERNEL;
use aloft_pipeline::runner::{Selection, Silent, run};
use aloft_study::subject_session::{Overrides, SubjectSession};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Pipelines with the recordings that they are run on.
const FIXTURES: [(&str, &str); 5] = [
    ("demo", "demo"),
    ("demo", "demo_twin"),
    ("demo_human", "human_tethered"),
    ("demo_human", "human_twin"),
    ("robot", "robot"),
];
/// Largest relative difference of a held-out error, of a coefficient beside its largest value in
/// any choice, and of a base parameter beside the largest of its unit.
const TOLERANCE: f64 = 1e-6;

fn repo() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Evaluates the expression `answer` after a script; none without a JavaScript engine.
fn evaluated(script: &str, folder: &Path) -> Option<Value> {
    let file = folder.join("kernel.js");
    std::fs::write(&file, format!("{script}\nconsole.log(JSON.stringify(answer));\n")).unwrap();
    if let Ok(done) = Command::new("node").arg(&file).output() {
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        return Some(serde_json::from_slice(&done.stdout).unwrap());
    }
    let page = folder.join("kernel.html");
    let text = script.replace("</", "<\\/");
    let show = "document.body.textContent = 'answer' + JSON.stringify(answer) + 'end';";
    std::fs::write(&page, format!("<!doctype html><meta charset=utf-8><body><script>{text}\n{show}</script>")).unwrap();
    let dom = shown(&page.display().to_string())?;
    let own = dom.split("answer{").nth(1).and_then(|t| t.split("}end").next()).expect("an answer on the page");
    Some(serde_json::from_str(&format!("{{{}}}", own.replace("&amp;", "&"))).unwrap())
}

/// What a browser shows of a page after its scripts have run; none without Chromium.
fn shown(address: &str) -> Option<String> {
    ["chromium", "chromium-browser", "google-chrome"].into_iter().find_map(|browser| {
        let words = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom"];
        let done = Command::new(browser).args(words).arg(address).output().ok()?;
        Some(String::from_utf8_lossy(&done.stdout).into_owned())
    })
}

/// Choices of switches: none, each, and random ones.
fn choices(keys: &[String]) -> Vec<Vec<String>> {
    let mut out: Vec<Vec<String>> = vec![Vec::new()];
    out.extend(keys.iter().map(|k| vec![k.clone()]));
    let mut state = 0x2545_f491_u64;
    for n in (2..6).flat_map(|n| [n, n, n]) {
        let mut left: Vec<String> = keys.to_vec();
        let picked = (0..n.min(left.len())).map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            left.swap_remove((state >> 33) as usize % left.len())
        });
        out.push(picked.collect());
    }
    out
}

fn by<'a>(list: &'a Value, field: &str, name: &Value) -> Option<&'a Value> {
    list.as_array().unwrap().iter().find(|x| x[field] == *name)
}

#[test]
fn validate_the_page_computes_what_the_program_computes() {
    for (pipeline, data) in FIXTURES {
        let folder = tempfile::tempdir().unwrap();
        let overrides = Overrides {
            workspace: Some(folder.path().join("ws")),
            data: Some(repo().join("fixtures").join(data)),
            ..Overrides::default()
        };
        let config = repo().join("pipelines").join(format!("{pipeline}.yaml"));
        let session = SubjectSession::open(&config, &overrides).unwrap();
        run(&session, &Selection::default(), &Silent).unwrap();
        discover(&session, &options(Vec::new(), Vec::new(), false, None), &|_| {}).unwrap();
        let numbers = aloft_report::switch_numbers(&session).unwrap().expect("switches on the page");
        let switches = Switches::prepare(&session, &[], &|_, _| {}).unwrap();
        let keys: Vec<String> = numbers["kernel"]["switches"]
            .as_array()
            .unwrap()
            .iter()
            .map(|s| s["key"].as_str().unwrap().to_owned())
            .collect();
        assert!(keys.len() > 5, "{data}: {keys:?}");
        let choices = choices(&keys);
        let script = format!(
            "{KERNEL}\nconst open = Kernel.open({}), started = performance.now();\n\
             const models = {}.map((on) => Kernel.model(open, on));\n\
             const answer = {{ models, milliseconds: (performance.now() - started) / models.length }};",
            numbers["kernel"],
            json!(choices)
        );
        let Some(answer) = evaluated(&script, folder.path()) else {
            println!("skipped: neither node nor Chromium is installed");
            return;
        };
        let (mut held_by_the_page, mut without_number) = (0, None);
        let mut worst = [(0.0, String::new()), (0.0, String::new()), (0.0, String::new())];
        let mut note = |kind: usize, a: &Value, b: &Value, scale: f64, words: String| {
            let by = (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() / scale;
            if by.is_nan() || by > worst[kind].0 {
                worst[kind] = (by, words);
            }
        };
        // a coefficient that is about zero beside another effect has no digits of its own
        let mut largest: HashMap<String, f64> = HashMap::new();
        for model in answer["models"].as_array().unwrap() {
            for c in model["model"]["coefficients"].as_array().into_iter().flatten() {
                let most = largest.entry(c[0].as_str().unwrap().to_owned()).or_insert(f64::MIN_POSITIVE);
                *most = most.max(c[1].as_f64().unwrap().abs());
            }
        }
        for (on, own) in choices.iter().zip(answer["models"].as_array().unwrap()) {
            let words = on.join(" + ");
            // of models that use contact otherwise, or in the metric of their rows' noise, a page
            // holds some, as the program computes them
            let only_known = numbers["kernel"]["only_known"] == true;
            if only_known || switches.changes_contact(on).unwrap() {
                let Some(held) = own["model"].as_object() else {
                    let why = own["because"].as_str().unwrap();
                    assert!(
                        why.contains(if only_known { "aloft studio" } else { "contact" }),
                        "{data}: {words}: {why}"
                    );
                    without_number.get_or_insert(on.join(","));
                    continue;
                };
                held_by_the_page += 1;
                let right = json!(switches.model(on, &LeftOut::default()).unwrap());
                assert_eq!(held["errors"], right["errors"], "{data}: {words}");
                continue;
            }
            let expected = match switches.model(on, &LeftOut::default()) {
                Ok(model) => json!(model),
                Err(refused) => {
                    assert_eq!(own["because"], refused.to_string(), "{data}: {words}");
                    continue;
                }
            };
            let own = &own["model"];
            assert_eq!(own["effects"], expected["effects"]);
            assert!(!own["errors"].as_array().unwrap().is_empty());
            for e in own["errors"].as_array().unwrap() {
                let right = by(&expected["errors"], "judged_on", &e["judged_on"]).unwrap();
                let scale = right["held_out_error"].as_f64().unwrap();
                note(0, &e["held_out_error"], &right["held_out_error"], scale, words.clone());
                for same in ["windows", "grade", "because", "at_floor", "noise_floor", "noise_floor_ci95"] {
                    assert_eq!(e[same], right[same], "{data}: {words}: {same}");
                }
            }
            for t in own["trials"].as_array().unwrap() {
                let right = by(&expected["trials"], "trial", &t["trial"]).unwrap();
                if let Some(scale) = right["flight"].as_f64() {
                    note(0, &t["flight"], &right["flight"], scale, words.clone());
                }
            }
            for (own, right) in
                own["coefficients"].as_array().unwrap().iter().zip(expected["coefficients"].as_array().unwrap())
            {
                assert_eq!(own[0], right[0]);
                let scale = largest[right[0].as_str().unwrap()];
                note(1, &own[1], &right[1], scale, format!("{words}: {}", own[0]));
            }
            for own in own["base"].as_array().unwrap() {
                let all = expected["base"].as_array().unwrap();
                let right = all.iter().find(|b| b[0] == own[0]).unwrap();
                let unit = all.iter().filter(|b| b[2] == own[2]).map(|b| b[1].as_f64().unwrap().abs());
                note(2, &own[1], &right[1], unit.fold(0.0, f64::max), format!("{words}: {}", own[0]));
            }
        }
        assert_eq!(
            held_by_the_page > 0,
            numbers["kernel"]["known"].as_array().is_some_and(|k| !k.is_empty()),
            "{data}"
        );
        println!(
            "{pipeline} on {data}: {} choices ({held_by_the_page} held), {} switches; largest differences: errors {:.1e}, coefficients {:.1e} ({}), \
             parameters {:.1e}; {:.0} ms a choice; {} bytes",
            choices.len(),
            keys.len(),
            worst[0].0,
            worst[1].0,
            worst[1].1,
            worst[2].0,
            answer["milliseconds"].as_f64().unwrap(),
            numbers.to_string().len()
        );
        for (by, words) in &worst {
            assert!(*by < TOLERANCE, "{data}: {by:.1e} at {words}");
        }
        if let Some(on) = without_number {
            no_number_is_shown(&session, &on);
        }
    }
}

/// A choice for which the page has no number shows none, and why; not the number of another choice.
#[allow(clippy::print_stdout, reason = "a skipped test says so")]
fn no_number_is_shown(session: &SubjectSession, on: &str) {
    let page = aloft_report::write(session, None).unwrap();
    let value = |address: &str| -> Option<String> {
        let dom = shown(address)?;
        let part = |id: &str| dom.split(&format!("id=\"studio-{id}\"")).nth(1).and_then(|t| t.split('<').next());
        let text = |id: &str| part(id).and_then(|t| t.split('>').nth(1)).unwrap_or_default().trim().to_owned();
        Some(format!("{} | {}", text("value"), text("which")))
    };
    let plain = format!("file://{}", page.display());
    let Some(present) = value(&plain) else {
        println!("skipped: Chromium is not installed");
        return;
    };
    assert!(present.contains(" N |"), "{present}");
    let chosen = value(&format!("{plain}?on={on}")).unwrap();
    let why = chosen.contains("contact") || chosen.contains("this page holds the model");
    assert!(chosen.starts_with("– |") && why, "{on}: {chosen}");
}
