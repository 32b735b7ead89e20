//! A study of several subjects and sessions: one command, one table, and for each failure the
//! command that repeats only it.

use crate::support::{expect, folder, json, lab, repo};
use std::fs;
use std::path::{Path, PathBuf};

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        if entry.file_type().unwrap().is_file() {
            fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
}

/// Two objects, the second recorded on two days. The recordings are the same, so that results can
/// be compared.
fn session(at: &Path) -> PathBuf {
    let lab = lab("fixtures/scenarios/chain_small.yaml", at);
    let session = at.join("study");
    copy(&lab, &session.join("bar_a"));
    copy(&lab, &session.join("bar_b/day1"));
    copy(&lab, &session.join("bar_b/day2"));
    session
}

const PIPELINE: &str = "name: bars
model: two_link
marker_set: two-link-chain
object: two_link_chain
subjects:
  folders: [\"bar_*\"]
  sessions: [\"day*\"]
overrides:
  - {subject: bar_b, session: day2, set: {filter: {cutoff_hz: 8.0}}}
  - {subject: bar_a, trial: throws_02, set: {import: {fill_gaps_s: 0.05}}}
trials:
  static: [\"static*.c3d\"]
  calibration: [\"hinge_calib*.c3d\"]
  identify: [\"throw*.c3d\"]
  validate: []
  exclude: [{trial: throws_03, reason: the hinge was caught}]
";

fn pipeline(at: &Path, text: &str) -> String {
    let file = at.join("study.yaml");
    fs::write(&file, text).unwrap();
    file.display().to_string()
}

fn rows(csv: &str) -> Vec<Vec<String>> {
    csv.lines().map(|l| l.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn one_command_does_all_subjects_and_says_what_failed_and_how_to_repeat_it() {
    let dir = folder();
    let data = session(dir.path());
    fs::write(data.join("bar_b/day1/throws_01.c3d"), b"no recording").unwrap();
    let p = pipeline(dir.path(), PIPELINE);
    let ws = dir.path().join("ws");
    let base = ["--data", &data.display().to_string(), "--workspace", &ws.display().to_string()].map(str::to_owned);
    let base: Vec<&str> = base.iter().map(String::as_str).collect();
    let (out, err) = expect(&[&["run", &p, "--details"], &base[..]].concat(), 1);
    let failed: Vec<&str> = err.lines().filter(|l| l.starts_with("failed: ")).collect();
    assert_eq!(failed.len(), 1, "{err}");
    assert!(failed[0].starts_with("failed: import bar_b day1 throws_01:"), "{err}");
    let again = err.lines().find(|l| l.trim_start().starts_with("again: ")).unwrap();
    assert!(again.contains("--subject bar_b --session day1 --trial throws_01"), "{again}");
    assert!(out.contains("15 trials: ") && out.contains("3 excluded") && out.contains("unreadable_file"), "{out}");

    // the table has one row per trial, and the same values for the same recordings
    let csv = fs::read_to_string(ws.join("summary.csv")).unwrap();
    let table = rows(&csv);
    assert_eq!(table.len(), 16, "{csv}");
    let column = |name: &str| table[0].iter().position(|h| h == name).unwrap();
    let find = |subject: &str, session: &str, trial: &str| {
        table.iter().find(|r| r[0] == subject && r[1] == session && r[2] == trial).unwrap().clone()
    };
    let broken = find("bar_b", "day1", "throws_01");
    assert_eq!((broken[4].as_str(), broken[5].as_str()), ("failed", "unreadable_file"));
    assert_eq!(find("bar_a", "", "throws_03")[5], "excluded");
    let good = find("bar_a", "", "throws_01");
    for name in ["markers", "gaps", "ik_error_mm", "flights", "sigma_ratio", "flight_force_n"] {
        assert!(good[column(name)].parse::<f64>().is_ok(), "{name} of {good:?}");
    }
    assert!(ws.join("summary.parquet").is_file() && ws.join("summary.txt").is_file());

    // the pipeline's settings are inherited: another cut-off only on the second day, another gap
    // limit only in one trial
    let parameters = |place: &str| -> serde_json::Value {
        let text = fs::read_to_string(ws.join(place).join("manifest.json")).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["parameters"].clone()
    };
    assert_eq!(parameters("bar_b/day2/filter/throws_01")["filter"]["cutoff_hz"], 8.0);
    assert_eq!(parameters("bar_a/filter/throws_01")["filter"]["cutoff_hz"], 10.0);
    assert_eq!(parameters("bar_a/import/throws_02")["import"]["fill_gaps_s"], 0.05);
    assert_eq!(parameters("bar_a/import/throws_01")["import"]["fill_gaps_s"], 0.1);

    // after the file was repaired, the command named by the failure repeats exactly that trial
    fs::copy(data.join("bar_a/throws_01.c3d"), data.join("bar_b/day1/throws_01.c3d")).unwrap();
    let words: Vec<String> = again.split("again: aloft ").nth(1).unwrap().split(' ').map(str::to_owned).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let (_, err) = expect(&words, 0);
    assert!(!err.contains("failed"), "{err}");
    let (out, err) = expect(&[&["run", &p, "--details"], &base[..]].concat(), 0);
    assert!(out.contains("0 failed"), "{out}\n{err}");

    // every command accepts all subjects or a selection
    let status = json(&[&["status", &p], &base[..], &["--json"]].concat());
    assert_eq!(status["studies"].as_array().unwrap().len(), 3);
    let compared = json(&[&["compare", &p], &base[..], &["--json", "--subject", "bar_b"]].concat());
    assert_eq!(compared["studies"].as_array().unwrap().len(), 2);
    assert_eq!(compared["studies"][1]["session"], "day2");
    let (shown, _) = expect(&[&["parameters", &p], &base[..], &["--session", "day2"]].concat(), 0);
    assert!(shown.contains("== bar_b day2") && !shown.contains("== bar_a"), "{shown}");
    let (_, err) = expect(&[&["status", &p], &base[..], &["--subject", "nobody"]].concat(), 2);
    assert!(err.contains("bar_a") && err.contains("bar_b day1"), "{err}");

    // a subject gives the same results within the study as on its own
    let alone = dir.path().join("alone");
    let one = PIPELINE.replace("subjects:\n  folders: [\"bar_*\"]\n  sessions: [\"day*\"]\n", "");
    let (a, b) = (one.find("overrides:").unwrap(), one.find("trials:").unwrap());
    let p1 = dir.path().join("one.yaml");
    fs::write(&p1, format!("{}{}", &one[..a], &one[b..])).unwrap();
    let day1 = data.join("bar_b/day1").display().to_string();
    expect(&["run", &p1.display().to_string(), "--data", &day1, "--workspace", &alone.display().to_string()], 0);
    let read = |ws: &Path| fs::read(ws.join("identify/_study/parameters_weak.json")).unwrap();
    assert_eq!(read(&alone), read(&ws.join("bar_b/day1")));
}

#[test]
fn overrides_are_checked_where_they_are_written() {
    let dir = folder();
    let data = session(dir.path()).display().to_string();
    let check = |text: &str| {
        let p = pipeline(dir.path(), text);
        expect(&["check", &p, "--data", &data], 2).1
    };
    let err = check(&PIPELINE.replace("{filter: {cutoff_hz: 8.0}}", "{filter: {cutoff: 8.0}}"));
    assert!(err.contains("line 9") && err.contains("cutoff_hz"), "{err}");
    let err = check(&PIPELINE.replace("set: {import: {fill_gaps_s: 0.05}}", "set: {identify: {bootstrap: 3}}"));
    assert!(err.contains("line 10") && err.contains("single trial"), "{err}");
    let err = check(&PIPELINE.replace("\"bar_*\"", "bar_a, bar_x"));
    assert!(err.contains("bar_x"), "{err}");

    // an error in a file beside the recordings stops only its session
    let p = pipeline(dir.path(), PIPELINE);
    let file = Path::new(&data).join("bar_b/day1/overrides.yaml");
    fs::write(&file, "filter:\n  cutoff: 6.0\n").unwrap();
    let ws = dir.path().join("ws").display().to_string();
    let (out, err) = expect(&["run", &p, "--data", &data, "--workspace", &ws, "--until", "filter", "--details"], 1);
    assert!(
        err.contains("failed: bar_b day1:") && err.contains("line 2") && out.contains("subject_unknown"),
        "{err}\n{out}"
    );
    fs::write(&file, "filter:\n  cutoff_hz: 6.0\n").unwrap();
    expect(&["run", &p, "--data", &data, "--workspace", &ws, "--until", "filter"], 0);
    let manifest = fs::read_to_string(Path::new(&ws).join("bar_b/day1/filter/throws_01/manifest.json")).unwrap();
    assert!(manifest.contains("\"cutoff_hz\": 6.0"), "{manifest}");
}

#[test]
fn a_subject_whose_facts_are_damaged_does_not_stop_the_others() {
    let dir = folder();
    let data = session(dir.path());
    let facts = data.join("bar_a/object.yaml");
    fs::write(&facts, "total_mass_kg: heavy\n").unwrap();
    let p = pipeline(dir.path(), PIPELINE);
    let ws = dir.path().join("ws").display().to_string();
    let words =
        ["run", &p, "--data", &data.display().to_string(), "--workspace", &ws, "--until", "import", "--details"];
    let (out, err) = expect(&words, 1);
    assert!(err.contains("failed: bar_a: ") && err.contains("object.yaml"), "{err}");
    assert!(out.contains("subject_unknown") && out.contains("bar_b day2"), "{out}");
    // without that file the mass of the object's description or of the study's table is taken
    fs::remove_file(&facts).unwrap();
    fs::write(data.join("participants.tsv"), "participant_id\tmass\nbar_a\t0.997\nbar_b\tn/a\nbar_c\t1\n").unwrap();
    expect(&words, 0);
    // the study's table also applies to the folder of a single subject
    let one = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    let alone = dir.path().join("one.yaml");
    fs::write(&alone, one).unwrap();
    expect(&["check", &alone.display().to_string(), "--data", &data.join("bar_a").display().to_string()], 0);
    let (_, err) = expect(&["check", &p, "--data", &data.display().to_string()], 0);
    assert!(err.contains("bar_c") && err.contains("no folder"), "{err}");
}

#[test]
fn init_recognises_the_folders_of_a_study() {
    let dir = folder();
    let data = session(dir.path());
    let file = dir.path().join("made.yaml").display().to_string();
    expect(&["init", &data.display().to_string(), "--out", &file], 0);
    let text = fs::read_to_string(&file).unwrap();
    for part in
        ["folders: [\"bar_a\", \"bar_b\"]", "sessions: [\"day*\"]", "two-link-chain", "lengths in mm; upward: Z"]
    {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
    let (_, err) = expect(&["check", &file], 0);
    assert!(!err.contains("broken"), "{err}");
    let ws = dir.path().join("ws").display().to_string();
    let (out, _) = expect(&["run", &file, "--workspace", &ws, "--details"], 0);
    assert!(out.contains("15 trials: ") && out.contains("0 failed"), "{out}");
}

#[test]
fn the_study_has_a_page_that_leads_to_its_subjects() {
    let dir = folder();
    let data = session(dir.path()).display().to_string();
    let p = pipeline(dir.path(), PIPELINE);
    let ws = dir.path().join("ws");
    let words = [p.as_str(), "--data", &data, "--workspace", &ws.display().to_string()].map(str::to_owned);
    let ask = |command: &str, more: &[&str], code: i32| {
        let all: Vec<&str> =
            std::iter::once(command).chain(words.iter().map(String::as_str)).chain(more.iter().copied()).collect();
        expect(&all, code).0
    };
    ask("run", &["--subject", "bar_b"], 0);
    // the workflow of one subject gives its own verdict
    let file = dir.path().join("bar_b.smk").display().to_string();
    ask("workflow", &["--subject", "bar_b", "--out", &file], 0);
    let text = fs::read_to_string(&file).unwrap();
    let plan: serde_json::Value = serde_json::from_str(&fs::read_to_string(format!("{file}.json")).unwrap()).unwrap();
    assert_eq!(plan["chosen"], serde_json::json!(["--subject", "bar_b"]), "{plan:#}");
    assert!(plan["studies"].as_object().unwrap().keys().all(|k| !k.contains("bar_a")), "{plan:#}");
    assert!(!text.contains("bar_") && plan["verdict"].as_str().unwrap().starts_with("verdict_"), "{text}\n{plan:#}");
    assert!(plan.to_string().contains("compare/_study"), "{plan:#}");
    ask("workflow", &["--subject", "bar_b", "--verdict"], 0);
    ask("workflow", &["--verdict"], 1);
    // a subject that was never run does not prevent the pages of the others
    let pages = ask("report", &[], 1);
    assert_eq!(pages.lines().count(), 3, "{pages}");
    assert!(!ws.join("bar_a/report.html").exists());
    ask("run", &[], 0);
    let pages = ask("report", &[], 0);
    assert_eq!(pages.lines().count(), 4, "{pages}");
    let html = fs::read_to_string(ws.join("report.html")).unwrap().replace("&#x2f;", "/");
    crate::report::check_page(&html, &["overview", "group", "recordings"]);
    for page in ["bar_a/report.html", "bar_b/day1/report.html", "bar_b/day2/report.html"] {
        assert!(html.contains(&format!("href=\"{page}\"")), "no link to {page}");
        crate::report::check_page(&fs::read_to_string(ws.join(page)).unwrap(), &["overview", "methods"]);
    }
    // for one subject only its own page is written; the study's page stays unchanged
    let before = fs::metadata(ws.join("report.html")).unwrap().modified().unwrap();
    assert_eq!(ask("report", &["--subject", "bar_a"], 0).matches("report.html").count(), 1);
    assert_eq!(fs::metadata(ws.join("report.html")).unwrap().modified().unwrap(), before);
}
