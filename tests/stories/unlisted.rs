//! Laws that no catalogue lists, hidden in thrown chains.

use crate::support::discovered;
use serde_json::Value;

/// Constants of the one law of an answer: value and 95 % interval.
struct Law(Value);

impl Law {
    fn of(found: &Value) -> Self {
        assert_eq!(found["verdict"], "unexplained", "{}", found["words"]);
        let laws = found["open"]["laws"].as_array().unwrap();
        assert_eq!(laws.len(), 1, "{}", found["words"]);
        Self(laws[0].clone())
    }
    fn constant(&self, name: &str) -> (f64, [f64; 2]) {
        let all = ["coefficients", "parameters"].map(|list| self.0[list].as_array().unwrap());
        let it = all.into_iter().flatten().find(|c| c["name"] == name).unwrap_or_else(|| panic!("{}", self.0));
        (it["value"].as_f64().unwrap(), [0, 1].map(|i| it["ci95"][i].as_f64().unwrap()))
    }
}

/// The hinge turns over several times, so that a free curve over all turns is too coarse for a
/// couple that repeats: no law was found at eight times the floor.
#[test]
fn a_couple_that_repeats_with_the_turns_of_a_hinge_is_found() {
    let found = discovered("chain_turning_hinge", "chain", &[]);
    let law = Law::of(&found);
    assert_eq!((&law.0["action"], &law.0["variables"][0]), (&"couple".into(), &"q_link1".into()), "{}", law.0);
    let (k, [low, high]) = law.constant("k");
    assert!((low..high).contains(&2.2631) && high - low < 0.03, "{k}: {low} to {high}");
    let error = found["open"]["times_floor_after"].as_f64().unwrap();
    assert!(error < 1.2, "{error}");
    assert!(law.0["text"].as_str().unwrap().contains("as the sine of the angle"), "{}", law.0["text"]);
}

/// A force that fades with the distance from a point was named a tether whose anchor is nine metres
/// away: a line of such length has an almost constant direction and any strength.
#[test]
fn a_tether_from_far_away_does_not_stand_in_for_a_field() {
    let found = discovered("chain_fading_field", "chain", &[]);
    let law = Law::of(&found);
    assert_eq!((&law.0["direction"], &law.0["carrier"]), (&"towards".into(), &"link0".into()), "{}", law.0);
    for (name, truth) in [("anchor_x", 0.357), ("anchor_y", 0.093), ("anchor_z", 0.804)] {
        let (value, [low, high]) = law.constant(name);
        assert!((low..high).contains(&truth), "{name} {value}: {low} to {high}");
    }
}
