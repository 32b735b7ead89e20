//! One number: every surface of one workspace shows the same held-out error, noise floor and ratio,
//! and the error is the one that the stored windows give.

use crate::support::{expect, folder, json, repo};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Error, floor and ratio of one kind of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Number {
    error: f64,
    floor: f64,
    times: f64,
}

fn number(e: &Value) -> Number {
    let of = |key: &str| e[key].as_f64().unwrap_or_else(|| panic!("no {key} in {e}"));
    Number { error: of("held_out_error"), floor: of("noise_floor"), times: of("times_floor") }
}

/// The entry of a list of errors for a kind of motion.
fn on<'a>(errors: &'a Value, place: &str) -> &'a Value {
    errors.as_array().unwrap().iter().find(|e| e["judged_on"] == place).unwrap_or_else(|| panic!("{place}: {errors}"))
}

/// Three digits, as texts show an error.
fn three(x: f64) -> String {
    aloft_compare::significant(x, 3)
}

/// A line of a text that holds these words, one after the other.
fn shows(text: &str, words: &[&str]) -> bool {
    text.lines().any(|line| {
        let mut rest: Vec<&str> = line.split_whitespace().collect();
        words.iter().flat_map(|w| w.split(' ')).all(|w| match rest.iter().position(|r| *r == w) {
            Some(at) => {
                rest.drain(..=at);
                true
            }
            None => false,
        })
    })
}

/// Root mean square over the windows that the compare stage stored, read here without its code.
fn of_windows(ws: &Path, place: &str, compared: &Value) -> f64 {
    let trials = compared["trials"].as_array().unwrap();
    let held = |t: &Value| t["held_out_flight"] == true;
    let any_held = trials.iter().any(held);
    let (mut sum, mut n) = (0.0, 0);
    for trial in trials {
        let counts = match place {
            "contact" => trial["held_out_contact"] == true,
            _ => !any_held || held(trial),
        };
        if !counts {
            continue;
        }
        let file = ws.join(format!("compare/_study/windows_{}.parquet", trial["trial"].as_str().unwrap()));
        let table = aloft_workspace::table::Table::read(&file).unwrap().into_map();
        for (i, flying) in table["in_flight"].iter().enumerate() {
            if (*flying == 1.0) != (place == "flight") {
                continue;
            }
            let of = |axis: &str, unit: &str| table[&format!("identified.{axis}_{unit}")][i];
            for axis in ["x", "y", "z"] {
                sum += of(&format!("force_{axis}"), "n").powi(2) + (of(&format!("moment_{axis}"), "nm") / 0.1).powi(2);
            }
            n += 1;
        }
    }
    (sum / f64::from(n)).sqrt()
}

/// Grade and colour of an error, as its numbers give them.
fn graded(e: &Value) -> (aloft_compare::Grade, String, String) {
    let interval = e["noise_floor_ci95"].as_array().map(|ci| [0, 1].map(|i| ci[i].as_f64().unwrap()));
    let of_numbers =
        aloft_compare::Grade::of(e["held_out_error"].as_f64().unwrap(), e["noise_floor"].as_f64(), interval);
    let grade: aloft_compare::Grade = serde_json::from_value(e["grade"].clone()).unwrap();
    assert_eq!(grade == of_numbers, e["because"].is_null(), "worse than its numbers without a reason: {e}");
    let of = |key: &str| e[key].as_str().unwrap().to_owned();
    (grade, of("judged"), of("signal"))
}

/// The page says the worst grade first, and the present model's own in the ladder.
fn page_judges(page: &str, errors: &[Value]) {
    let (_, words, signal) = errors.iter().map(graded).max_by_key(|g| g.0).unwrap();
    let headline = page.split("<div class=\"headline ").nth(1).unwrap().split("</div>").next().unwrap();
    let shown = format!("<b class=\"word {signal}\">{words}</b>");
    assert!(headline.starts_with(&format!("{signal}\"")) && headline.contains(&shown), "{shown} for {headline}");
    let rungs = page.split("<li class=\"rung ").skip(1).map(|r| r.split("</li>").next().unwrap());
    let last = rungs.filter(|r| !r.contains("forecast")).last().unwrap();
    let any = errors.iter().map(graded).any(|(_, words, signal)| {
        last.starts_with(&signal) && last.contains(&format!("<b class=\"word {signal}\">{words}</b>"))
    });
    assert!(any, "the ladder ends with {last}");
}

/// Reads all surfaces of a workspace and compares them; returns the numbers by kind of motion.
fn agree(words: &[&str], ws: &Path) -> Vec<(String, Number)> {
    let ask = |command: &[&str]| json(&[command, words, &["--json"]].concat());
    let tell = |command: &[&str]| {
        let (out, err) = expect(&[command, words].concat(), 0);
        format!("{out}\n{err}")
    };
    let compared = ask(&["compare"]);
    let ladder = ask(&["history"]);
    let found = ask(&["discover"]);
    let summary: Value =
        serde_json::from_str(&fs::read_to_string(ws.join("compare/_study/manifest.json")).unwrap()).unwrap();
    let texts = [tell(&["run"]), tell(&["compare"]), tell(&["discover"]), tell(&["history"])];
    let (_, _) = expect(&[&["report"], words].concat(), 0);
    let page = fs::read_to_string(ws.join("report.html")).unwrap();
    let to = ws.parent().unwrap().join(format!("{}_out", ws.file_name().unwrap().to_string_lossy()));
    expect(&[&["export"], words, &["--to", &to.display().to_string()]].concat(), 0);
    let methods = fs::read_to_string(to.join("methods.txt")).unwrap();
    let last = ladder["revisions"].as_array().unwrap().last().unwrap();
    let mut out = Vec::new();
    for e in compared["errors"].as_array().unwrap() {
        let place = e["judged_on"].as_str().unwrap();
        let one = number(e);
        assert!((one.times - one.error / one.floor).abs() < 1e-12, "{e}");
        // every JSON
        let against = on(&compared["against_floor"], place);
        assert_eq!(against["held_out_error"].as_f64(), Some(one.error), "compare");
        assert_eq!(against["floor"]["noise_floor"].as_f64(), Some(one.floor), "compare");
        assert_eq!(against["times_floor"].as_f64(), Some(one.times), "compare");
        assert_eq!(number(on(&last["errors"], place)), one, "history");
        assert_eq!(last[place]["error_n"].as_f64(), Some(one.error), "history");
        assert_eq!(last[place]["noise_n"].as_f64(), Some(one.floor), "history");
        assert_eq!(number(on(&found["errors"], place)), one, "discover");
        assert_eq!(summary["summary"][format!("held_out_error_{place}_n")].as_f64(), Some(one.error), "manifest");
        if last["judged_on"] == format!("held-out {place}") {
            assert_eq!(number(last), one, "history");
        }
        if found["rounds"][0]["judged_on"] == place {
            let of = |key: &str| found[key].as_f64().unwrap();
            assert!((of("held_out_error") / one.error - 1.0).abs() < 1e-9, "discover");
            assert_eq!(of("noise_floor"), one.floor, "discover");
        }
        // one grade of one number
        let (_, judged, _) = graded(e);
        for (errors, command) in [(&last["errors"], "history"), (&found["errors"], "discover")] {
            let own = on(errors, place);
            for key in ["grade", "because", "judged", "signal"] {
                assert_eq!(own[key], e[key], "{command}");
            }
        }
        assert!(methods.contains(&format!("): {judged}.")), "{judged}: {methods}");
        // computed from the rows
        let own = of_windows(ws, place, &compared);
        assert!((own / one.error - 1.0).abs() < 1e-9, "{place}: {own} from the windows, {} said", one.error);
        // every text
        let times = aloft_compare::significant(one.times, 2);
        for (text, command) in texts.iter().zip(["run", "compare", "discover", "history"]) {
            assert!(
                shows(text, &[&three(one.error), &three(one.floor), &times, &judged]),
                "`{command}` does not show {one:?} in {place}:\n{text}"
            );
        }
        let methods_say = format!("In held-out {place} the error");
        assert!(
            methods.contains(&methods_say) && methods.contains(&format!("was {} N", three(one.error))),
            "{methods}"
        );
        assert!(methods.contains(&format!("floor of {} N", three(one.floor))), "{methods}");
        // the page has its own digits
        let near = |x: f64| {
            [x, x * 0.995, x * 1.005].iter().any(|x| {
                page.contains(&three(*x))
                    || page.contains(&format!("{x:.2}"))
                    || page.contains(&format!("{x:.1}"))
                    || page.contains(&format!("{x:.4}"))
            })
        };
        assert!(near(one.error) && near(one.floor), "the page does not show {one:?}");
        out.push((place.to_owned(), one));
    }
    page_judges(&page, compared["errors"].as_array().unwrap());
    // what was taken off the plates stands in the paragraph for a paper
    let hidden = texts[0].lines().find_map(|l| l.strip_prefix("hidden      ")?.split(' ').next());
    if let Some(hidden) = hidden {
        assert!(
            methods.contains(&format!("contact was {hidden} N.")) && methods.contains("never unloaded"),
            "{methods}"
        );
    }
    let readme = fs::read_to_string(to.join("README.md")).unwrap();
    let rows: Vec<&str> =
        readme.lines().skip_while(|l| !l.starts_with("| link |")).skip(2).take_while(|l| l.starts_with('|')).collect();
    assert!(rows.iter().all(|r| r.contains(" ± ") || r.ends_with("| from tables |")) && !rows.is_empty(), "{rows:#?}");
    out
}

/// Follows the loop on a laboratory: all surfaces agree before and after an effect was added, and
/// the discovery promised what the ladder shows.
fn follow(pipeline: &str, key: &str) {
    let dir = folder();
    let ws = dir.path().join("ws");
    let folder = ws.display().to_string();
    let p = repo(pipeline);
    let words = [p.as_str(), "--workspace", &folder];
    expect(&[&["run"], &words[..]].concat(), 0);
    let before = agree(&words, &ws);
    let found = json(&[&["discover"], &words[..], &["--json"]].concat());
    assert_eq!(found["found"][0]["key"], key);
    expect(&["effect", "add", &p, key, "--workspace", &folder], 0);
    let after = agree(&words, &ws);
    assert_eq!(before.len(), after.len());
    for ((place, old), (_, new)) in before.iter().zip(&after) {
        let promised = number(on(&found["errors_after"], place));
        assert!(new.error < old.error, "{place}: the error does not fall");
        assert!((promised.error / new.error - 1.0).abs() < 0.02, "{place}: {promised:?} promised, {new:?} reached");
    }
    let flight = |all: &[(String, Number)]| all.iter().find(|n| n.0 == "flight").unwrap().1;
    assert!(flight(&after).error < 0.6 * flight(&before).error);
    let said = found["held_out_error_after"].as_f64().unwrap();
    assert!((said / flight(&after).error - 1.0).abs() < 0.02, "{said} promised, {:?} reached", flight(&after));
}

/// A wrong effect makes nothing better; whatever it does, all surfaces say the same of it.
#[test]
fn every_surface_grades_a_model_with_a_wrong_effect_alike() {
    let dir = folder();
    let ws = dir.path().join("ws");
    let folder = ws.display().to_string();
    let p = dir.path().join("twin.yaml").display().to_string();
    let text = fs::read_to_string(repo("pipelines/demo.yaml")).unwrap();
    fs::write(&p, text.replace("../fixtures/demo", &repo("fixtures/demo_twin"))).unwrap();
    let words = [p.as_str(), "--workspace", &folder];
    expect(&[&["run"], &words[..]].concat(), 0);
    expect(&["effect", "add", &p, "linear_drag[links]", "--workspace", &folder], 0);
    agree(&words, &ws);
}

#[test]
fn every_surface_shows_one_error_of_an_object() {
    follow("pipelines/demo.yaml", "quadratic_drag[links]");
}

#[test]
fn every_surface_shows_one_error_of_a_person() {
    follow("pipelines/demo_human.yaml", "tether[pelvis]");
}
