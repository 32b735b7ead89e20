//! What force plates say of effects and laws that were found in flight.

use crate::support::{self, names};
use serde_json::Value;

fn discovered(scenario: &str, more: &[&str]) -> Value {
    support::discovered(scenario, "human", more)
}

/// Flights of a person show several forces of nearly constant direction as one class.
#[test]
fn contact_tells_apart_what_flights_cannot() {
    let found = discovered("human_tether", &["--closed"]);
    assert_eq!(
        (&found["verdict"], names(&found["effects"])),
        (&"supported".into(), vec!["tether"]),
        "{}",
        found["words"]
    );
}

/// In flight an added mass describes the pull of a crane overhead, too, and is simpler: the crane
/// was left out in its favour, then the plates ruled the added mass out, and a change of gravity
/// was all that remained.
#[test]
fn what_the_plates_rule_out_leaves_nothing_else_out() {
    let found = discovered("human_crane", &["--closed"]);
    let named = names(&found["effects"]);
    assert!(named.contains(&"crane") && !named.contains(&"added_mass"), "{}", found["words"]);
    let crane = found["candidates"].as_array().unwrap().iter().find(|c| c["effect"] == "crane").unwrap();
    let tension = crane["coefficients"][0]["ci95"].as_array().unwrap();
    let [low, high] = [0, 1].map(|i| tension[i].as_f64().unwrap());
    assert!((low..high).contains(&13.49) && low > 10.0, "{crane}");
}

/// Flights hardly tell gravity from a crane, which has seven unknowns; flights and contact together
/// do.
#[test]
fn the_simplest_effect_that_explains_both_is_described() {
    let found = discovered("human_gravity", &["--closed"]);
    assert_eq!(found["groups"].as_array().unwrap().len(), 1, "{}", found["words"]);
    assert_eq!(names(&found["effects"])[0], "gravity_scale", "{}", found["words"]);
    let [only] = &found["found"].as_array().unwrap()[..] else { panic!("{}", found["words"]) };
    let excess = only["coefficients"][0]["ci95"].as_array().unwrap();
    let [low, high] = [0, 1].map(|i| excess[i].as_f64().unwrap());
    assert!((low..high).contains(&0.025_618) && high - low < 0.004, "{low} to {high}");
}

/// A force that flights show always and contact does not is not a constant force.
#[test]
fn a_force_that_contact_contradicts_is_not_named() {
    let found = discovered("human_crouch_switch", &["--closed"]);
    assert_eq!(found["verdict"], "unexplained", "{}", found["words"]);
    assert!(names(&found["effects"]).is_empty());
}

/// The constants of plates that are never unloaded counted as evidence: the gain was −1.9 ± 0.8 %
/// and not named.
#[test]
fn recordings_whose_plates_are_never_unloaded_do_not_hide_a_wrong_mass() {
    let found = discovered("human_stated_mass", &["--closed"]);
    assert_eq!(found["verdict"], "one_of", "{}", found["words"]);
    let named = names(&found["effects"]);
    assert!(named.contains(&"plate_gain") && named.contains(&"body_mass") && named.len() <= 3, "{named:?}");
    let candidates = found["candidates"].as_array().unwrap();
    let mass = candidates.iter().find(|c| c["effect"] == "body_mass").unwrap();
    assert!(mass["held_out_ratio"].as_f64().unwrap() < 0.2, "{mass}");
    let kg = mass["coefficients"][0]["value"].as_f64().unwrap();
    assert!((kg - 1.967).abs() < 0.15, "{kg}");
}

/// Error over floor in contact: `errors` now, `errors_after` with what was found.
fn in_contact(found: &Value, list: &str) -> f64 {
    let of = found[list].as_array().unwrap().iter().find(|e| e["judged_on"] == "contact").unwrap();
    of["held_out_error"].as_f64().unwrap() / of["noise_floor"].as_f64().unwrap()
}

/// A resistance in one posture: flights show that a hand is held back, contact on what it depends.
#[test]
fn a_law_that_flights_alone_do_not_show_is_found_with_contact() {
    let found = discovered("human_bent_arm_drag", &[]);
    let law = &found["open"]["laws"][0];
    assert_eq!(
        (&law["carrier"], &law["direction"], names(&law["variables"]), &law["with_contact"]),
        (&"hand_l".into(), &"against_velocity".into(), vec!["speed", "q_forearm_l"], &true.into()),
        "{}",
        found["words"]
    );
    assert!(law["text"].as_str().unwrap().contains("found in flight and contact together"), "{}", law["text"]);
    let after = found["errors_after"].as_array().unwrap();
    assert!(after.iter().all(|e| e["at_floor"] == true), "{after:?}");
}

/// A rotor leaves 1.3 times the floor, within its interval. The law leaves less, in contact, too.
#[test]
#[ignore = "open: the rotor is named (docs/mathematics/discovery.md, where it is wrong)"]
fn a_law_takes_the_place_of_an_effect_within_a_wide_floor_and_holds_in_contact() {
    let found = discovered("human_clock_couple", &[]);
    assert_eq!(found["verdict"], "unexplained", "{}", found["words"]);
    assert_eq!(found["candidates"][0]["effect"], "rotor", "the test has lost its case");
    let law = &found["open"]["laws"][0];
    assert_eq!(
        (&law["action"], &law["direction"], names(&law["variables"])),
        (&"couple".into(), &"world".into(), vec!["t"])
    );
    assert_eq!(law["effect"]["acts"], "both");
    let contact = ["errors", "errors_after"].map(|list| in_contact(&found, list));
    assert!(contact[0] > 4.0 && contact[1] < 1.5, "{contact:?}");
}

/// Flights are fitted to their floor by a thrust. On flights and contact together a law that
/// follows the elbow leaves less, so that the thrust is not named, and the answer says why.
#[test]
fn a_law_that_does_better_on_all_rows_takes_the_place_of_an_effect_at_the_floor() {
    let found = discovered("human_elbow_force", &[]);
    assert_eq!((&found["verdict"], names(&found["effects"])), (&"unexplained".into(), vec![]), "{}", found["words"]);
    let law = &found["open"]["laws"][0];
    assert_eq!((&law["carrier"], names(&law["variables"])), (&"forearm_r".into(), vec!["q_forearm_r"]));
}

/// What acts has the form that its law says.
#[test]
fn an_effect_that_acts_has_the_form_of_its_law() {
    let found = discovered("human_crane", &[]);
    assert!(names(&found["effects"]).contains(&"crane"), "{}", found["words"]);
    assert!(found["misfit"].is_null(), "{}", found["misfit"]);
}
