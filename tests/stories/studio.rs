//! The live page, through the real binary and a socket: what the switches show is what the other
//! commands say, and what is kept is what `effect add` writes.

use crate::support::{expect, folder, json, repo};
use serde_json::{Value, json as value};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A server, ended when it is dropped.
struct Studio {
    process: Child,
    host: String,
    token: String,
}

impl Drop for Studio {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Studio {
    fn start(words: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_aloft"))
            .arg("studio")
            .args(words)
            .arg("--no-open")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut address = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut address).unwrap();
        let (host, token) = address.trim().strip_prefix("http://").unwrap().split_once("/?token=").unwrap();
        Self { process, host: host.to_owned(), token: token.to_owned() }
    }

    /// Status and body of an answer.
    fn raw(&self, method: &str, path: &str, headers: &str, body: &str) -> (u16, String) {
        let mut socket = TcpStream::connect(&self.host).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let length = body.len();
        write!(
            socket,
            "{method} {path} HTTP/1.1\r\n{headers}Connection: close\r\nContent-Length: {length}\r\n\r\n{body}"
        )
        .unwrap();
        let mut bytes = Vec::new();
        socket.read_to_end(&mut bytes).unwrap();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
    }

    fn own(&self) -> String {
        format!("Host: {}\r\nX-Aloft-Token: {}\r\n", self.host, self.token)
    }

    fn get(&self, path: &str) -> Value {
        let (status, body) = self.raw("GET", path, &self.own(), "");
        assert_eq!(status, 200, "{path}: {body}");
        serde_json::from_str(&body).unwrap()
    }

    fn post(&self, path: &str, body: &Value) -> Value {
        let (status, text) = self.raw("POST", path, &self.own(), &body.to_string());
        assert_eq!(status, 200, "{path} {body}: {text}");
        serde_json::from_str(&text).unwrap()
    }

    /// The state once nothing is being prepared or done.
    fn settled(&self) -> Value {
        let started = Instant::now();
        loop {
            let state = self.get("/api/state");
            if state["preparing"] == false && state["busy"].as_array().unwrap().is_empty() {
                return state;
            }
            assert!(started.elapsed() < Duration::from_secs(120), "{state}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Events from now on.
    fn listen(&self) -> impl Iterator<Item = (String, Value)> + use<> {
        let mut socket = TcpStream::connect(&self.host).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
        write!(socket, "GET /api/events?token={} HTTP/1.1\r\nHost: {}\r\n\r\n", self.token, self.host).unwrap();
        let mut lines = BufReader::new(socket).lines().map_while(Result::ok);
        // the answer has begun when its head has ended
        lines.by_ref().find(|l| l.is_empty());
        let mut name = String::new();
        lines.filter_map(move |line| {
            if let Some(event) = line.strip_prefix("event: ") {
                event.clone_into(&mut name);
            }
            line.strip_prefix("data: ").map(|data| (name.clone(), serde_json::from_str(data).unwrap()))
        })
    }
}

fn flight(errors: &Value) -> f64 {
    let of = errors.as_array().unwrap().iter().find(|e| e["judged_on"] == "flight").unwrap();
    of["held_out_error"].as_f64().unwrap()
}

fn near(a: f64, b: f64, share: f64) {
    assert!((a - b).abs() <= share * b.abs(), "{a} against {b}");
}

#[test]
fn switches_show_what_the_commands_say() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let demo = repo("pipelines/demo.yaml");
    let with = ["--workspace", ws.as_str()];
    let command = |words: &[&str]| json(&[words, &with, &["--json"]].concat());
    expect(&["run", &demo, "--workspace", &ws], 0);
    let found = command(&["discover", &demo]);
    let start = command(&["compare", &demo]);
    let studio = Studio::start(&[&demo, "--workspace", &ws]);

    // the page is the report with the panel; it needs the token
    let (status, page) = studio.raw("GET", "/", &studio.own(), "");
    assert!(status == 200 && page.contains("id=\"studio\"") && page.contains("id=\"overview\""));
    assert_eq!(studio.raw("GET", "/", &format!("Host: {}\r\n", studio.host), "").0, 403);
    let foreign = format!("{}Origin: http://evil.example\r\n", studio.own());
    assert_eq!(studio.raw("GET", "/", &foreign, "").0, 403);
    assert_eq!(studio.raw("GET", "/../../Cargo.toml", &studio.own(), "").0, 404);

    let state = studio.settled();
    let keys: Vec<&str> = state["switches"].as_array().unwrap().iter().map(|s| s["key"].as_str().unwrap()).collect();
    let drag = found["found"][0]["key"].as_str().unwrap();
    assert!(keys.contains(&drag) && keys.len() > 5, "{keys:?}");

    // nothing on: the present model
    let plain = studio.post("/api/model", &value!({"effects": []}));
    near(flight(&plain["model"]["errors"]), flight(&start["errors"]), 1e-6);
    // drag on: the number that `discover` promises
    let on = studio.post("/api/model", &value!({"effects": [drag]}));
    let quick = flight(&on["model"]["errors"]);
    near(quick, flight(&found["errors_after"]), 0.02);
    near(quick, found["held_out_error_after"].as_f64().unwrap(), 0.02);
    assert!(quick < 0.5 * flight(&plain["model"]["errors"]));
    // the forces follow
    let forces = |effects: Value| {
        let found = studio.post("/api/series", &value!({"trial": "throws_01", "effects": effects}));
        found["predicted"][2].as_array().unwrap().iter().filter_map(Value::as_f64).collect::<Vec<_>>()
    };
    let (without, with_drag) = (forces(value!([])), forces(value!([drag])));
    assert!(without.len() == with_drag.len() && without.iter().zip(&with_drag).any(|(a, b)| (a - b).abs() > 1e-4));
    // a recording left out
    let fewer = studio.post("/api/model", &value!({"effects": [], "left_out": {"trials": ["throws_01"]}}));
    assert!(
        fewer["model"]["trials"].as_array().unwrap().iter().any(|t| t["trial"] == "throws_01" && t["left_out"] == true)
    );
    // what cannot be
    for body in [value!({"effects": ["nothing"]}), value!({"effects": 3}), value!({})] {
        assert!(studio.raw("POST", "/api/model", &studio.own(), &body.to_string()).0 >= 400, "{body}");
    }

    // the exact number is computed beside the workspace, which stays as it is
    let mut events = studio.listen();
    let before = std::fs::read(dir.path().join("ws/model.json")).ok();
    studio.post("/api/job", &value!({"job": "exact", "ticket": 7, "effects": [drag]}));
    let (_, exact) = events.find(|(name, _)| name == "exact").unwrap();
    assert_eq!(exact["ticket"], 7);
    near(quick, flight(&exact["model"]["errors"]), 0.02);
    assert!(exact["model"]["coefficients"][0]["ci95"][1].is_number());
    assert_eq!(before, std::fs::read(dir.path().join("ws/model.json")).ok());
    // a setting is tried the same way
    let changes = value!({"settings": {"filter.cutoff_hz": 7.0}, "left_out": ["throws_02"]});
    studio.post("/api/job", &value!({"job": "exact", "ticket": 8, "effects": [], "changes": changes}));
    let (_, tried) = events.find(|(name, _)| name == "exact").unwrap();
    assert_eq!(
        tried["model"]["trials"].as_u64().unwrap() + 1,
        plain["model"]["trials"].as_array().unwrap().len() as u64
    );
    let wrong = value!({"settings": {"filter.cutoff_hz": -1.0}});
    studio.post("/api/job", &value!({"job": "exact", "ticket": 9, "effects": [], "changes": wrong}));
    let (_, refused) = events.find(|(name, _)| name == "problem").unwrap();
    assert!(refused["problem"].as_str().unwrap().contains("cutoff_hz"), "{refused}");

    // keep: the revision that `effect add` writes
    studio.post("/api/job", &value!({"job": "keep", "effects": [drag]}));
    events.find(|(name, _)| name == "changed").unwrap();
    let ladder = command(&["history", &demo]);
    assert_eq!(ladder["revisions"][1]["effects"], value!([drag]));
    near(quick, ladder["revisions"][1]["held_out_error"].as_f64().unwrap(), 0.02);
    let state = studio.settled();
    assert_eq!(state["model"], value!([drag]));
    assert!(state["switches"][0]["in_model"] == true && state["switches"][0]["key"] == drag);
    drop(studio);

    // a new server finds what was kept; undo takes it back
    let studio = Studio::start(&[&demo, "--workspace", &ws]);
    assert_eq!(studio.settled()["model"], value!([drag]));
    let off = studio.post("/api/model", &value!({"effects": []}));
    near(flight(&off["model"]["errors"]), flight(&start["errors"]), 1e-6);
    let mut events = studio.listen();
    studio.post("/api/job", &value!({"job": "undo"}));
    events.find(|(name, _)| name == "changed").unwrap();
    let ladder = command(&["history", &demo]);
    assert_eq!(ladder["revisions"][2]["effects"], value!([]));
    near(ladder["revisions"][2]["held_out_error"].as_f64().unwrap(), flight(&start["errors"]), 1e-9);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no copy is left behind");
}

#[test]
fn two_subjects_of_a_study_stand_side_by_side_as_in_its_report() {
    let dir = folder();
    let data = dir.path().join("data");
    for (subject, from) in [("bar_a", "fixtures/demo"), ("bar_b", "fixtures/demo_twin")] {
        std::fs::create_dir_all(data.join(subject)).unwrap();
        for file in std::fs::read_dir(repo(from)).unwrap().map(|f| f.unwrap().path()) {
            if file.is_file() {
                std::fs::copy(&file, data.join(subject).join(file.file_name().unwrap())).unwrap();
            }
        }
    }
    let file = dir.path().join("study.yaml");
    let text = "name: bars\nmodel: two_link\nmarker_set: two-link-chain\nobject: two_link_chain\n\
                subjects: {folders: [\"bar_*\"]}\n\
                trials: {static: [\"static.c3d\"], calibration: [\"hinge_calib.c3d\"], identify: [\"throws_*.c3d\"], validate: []}\n\
                filter: {order: 3, cutoff_hz: 10.0}\n";
    std::fs::write(&file, text).unwrap();
    let ws = dir.path().join("ws");
    let words = [file.to_str().unwrap(), "--data", data.to_str().unwrap(), "--workspace", ws.to_str().unwrap()];
    expect(&[&["run"], &words[..]].concat(), 0);
    expect(&[&["discover"], &words[..], &["--subject", "bar_a"]].concat(), 0);
    expect(&[&["report"], &words[..]].concat(), 0);
    let page = std::fs::read_to_string(ws.join("report.html")).unwrap();
    // a study of several opens the first subject, a chosen one is opened
    for (chosen, opened) in [(&[][..], "bar_a"), (&["--subject", "bar_b"][..], "bar_b")] {
        let studio = Studio::start(&[&words[..], chosen].concat());
        let state = studio.settled();
        assert_eq!((&state["session"], &state["several_subjects"]), (&value!(opened), &value!(true)));
        let found = studio.get("/api/subjects");
        assert_eq!(found["without"], value!([]), "{found}");
        let html = found["html"].as_str().unwrap().trim();
        assert!(html.contains("bar_a") && html.contains("bar_b") && html.contains("held-out error in flight"));
        assert!(page.contains(html), "the table is that of the report");
    }
    // the page over all subjects says which pages have switches, and judges as the commands do
    assert!(
        page.contains("none: <code>discover</code> was not run") && page.contains("all 1") || page.contains("all 2")
    );
    for subject in ["bar_a", "bar_b"] {
        let compared = json(&[&["compare"], &words[..], &["--subject", subject, "--json"]].concat());
        let (out, _) = expect(&[&["compare"], &words[..], &["--subject", subject]].concat(), 0);
        let error = &compared["studies"][0]["result"]["errors"][0];
        let word = error["judged"].as_str().unwrap();
        assert!(out.contains(word), "{out}");
        let (_, row) = page.split_once(&format!("<a href=\"{subject}&#x2f;report.html\">")).unwrap();
        let (row, _) = row.split_once("</tr>").unwrap();
        assert!(row.contains(&format!(">{word}</b>")), "`{word}` is not said of {subject}: {row}");
    }

    // a study of one subject has nothing to compare with
    let one = dir.path().join("one");
    let demo = repo("pipelines/demo.yaml");
    expect(&["run", &demo, "--workspace", one.to_str().unwrap()], 0);
    let studio = Studio::start(&[&demo, "--workspace", one.to_str().unwrap()]);
    assert_eq!(studio.settled()["several_subjects"], false);
    assert_eq!(studio.get("/api/subjects")["html"], Value::Null);
}
