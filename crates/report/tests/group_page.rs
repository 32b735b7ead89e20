//! The page of a study of several subjects, on the demonstration's recordings.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_pipeline::runner::{Selection, Silent, run};
use aloft_report::{Absent, Member, write_group};
use aloft_study::subject_session::{Overrides, SubjectSession};
use std::path::Path;

fn demo(workspace: &Path) -> SubjectSession {
    let pipeline = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/demo.yaml");
    SubjectSession::open(&pipeline, &Overrides { workspace: Some(workspace.to_path_buf()), ..Overrides::default() })
        .unwrap()
}

#[test]
fn a_group_has_a_row_a_subject_and_says_who_is_absent() {
    let folder = tempfile::tempdir().unwrap();
    let (first, never_run) = (demo(&folder.path().join("s01")), demo(&folder.path().join("s02")));
    run(&first, &Selection::default(), &Silent).unwrap();
    let member = |name: &str, session, link: &str| Member {
        name: name.to_owned(),
        session,
        link: link.to_owned(),
        switches: String::new(),
    };
    let members = [
        member("s01", &first, "s01/report.html"),
        member("s01 <again>", &first, "s01/report.html"),
        member("s02", &never_run, "s02/report.html"),
    ];
    let absent = [Absent { name: "s03".into(), reason: "fell ill".into(), on_purpose: true }];
    let page = write_group("throws", &members, &absent, &folder.path().join("report.html")).unwrap();
    let html = std::fs::read_to_string(page).unwrap().replace("&#x2f;", "/");
    assert!(html.contains("<a href=\"s01/report.html\">s01</a>") && html.contains("s01 &lt;again&gt;"));
    assert!(!html.contains("s02/report.html"), "a link to a page that is not there");
    assert!(html.contains("s02: no results: nothing was run") && html.contains("s03: left out: fell ill"));
    for told in [
        "Force error by subject",
        "Singular-value gap by subject",
        "Mass of each segment as a share of the body",
        "throws_03",
    ] {
        assert!(html.contains(told), "the page does not tell of: {told}");
    }
    assert!(html.contains("<dd class=\"value\">36</dd>"), "18 flights each");
    let nobody = [member("s02", &never_run, "")];
    assert!(write_group("throws", &nobody, &[], &folder.path().join("none.html")).is_err());
}
