//! A model that cannot be computed gives an error, not the errors of the model before it.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use aloft_analysis::promise::{Changes, tried};
use aloft_effects::FormulaEffect;
use aloft_pipeline::runner::{Selection, Silent, run_all};
use aloft_study::data_set::DataSet;
use aloft_study::effects::OwnEffect;
use aloft_study::revision::ModelEffect;
use aloft_study::subject_session::Overrides;
use std::path::Path;

#[test]
fn a_model_that_cannot_be_computed_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let pipeline = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/demo.yaml");
    let overrides = Overrides { workspace: Some(dir.path().join("ws")), ..Overrides::default() };
    let set = DataSet::open(&pipeline, &overrides).unwrap();
    let done = run_all(&set, &Selection::default(), &Silent).unwrap();
    assert!(!done.has_trouble(), "{:#?}", done.runs);
    let mut session = set.members.into_iter().next().unwrap();
    let of = |formula: &str| -> FormulaEffect {
        let law = [formula, "0", "0"];
        let coefficients = serde_json::json!([{"name": "c", "unit": "N"}]);
        let own =
            serde_json::json!({"id": "own", "point": {"link": "link0"}, "force": law, "coefficients": coefficients});
        serde_json::from_value(own).unwrap()
    };
    let model = || vec![ModelEffect { key: "own".to_owned(), ..ModelEffect::default() }];
    session.own_effects = vec![OwnEffect::described(&of("c")).unwrap()];
    let good = tried(&session, model(), &Changes::default(), &Silent).unwrap();
    assert_eq!(good.effects, ["own"]);
    assert!(good.errors.iter().any(|e| e.held_out_error.is_finite()));
    session.own_effects = vec![OwnEffect::described(&of("c * nobody")).unwrap()];
    let told = tried(&session, model(), &Changes::default(), &Silent).unwrap_err().to_string();
    assert!(told.contains("could not be computed") && told.contains("nobody"), "{told}");
}
