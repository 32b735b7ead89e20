//! The search beyond the catalogue in words.

use super::fit::Fitted;
use super::kinematics::{Action, Direction, Variable};
use super::law::{Law, PointIs};
use super::result::{Diagnosis, LawKind, OpenWorld, Work};
use super::stated::ANSWERED;
use super::work::work;
use crate::held_out::HeldOutResult;
use crate::result::{Discovery, Estimate};
use crate::session::Session;
use aloft_effects::Scene;
use aloft_identify::half_of;
use aloft_regressor::{FAIR_TIMES_FLOOR, POOR_TIMES_FLOOR};
use nalgebra::{DVector, Vector3};

/// A direction in words.
fn direction(d: Direction, action: Action) -> &'static str {
    match (d, action) {
        (Direction::World, _) => "in a direction fixed in the world",
        (Direction::Link, _) => "in a direction fixed in the link",
        (Direction::AgainstVelocity, _) => "against the velocity",
        (Direction::AcrossVelocity, _) => "across the velocity",
        (Direction::AcrossVelocityInLink, _) => "across the velocity, about an axis fixed in the link",
        (Direction::AgainstSpin, Action::Couple) => "against the angular velocity",
        (Direction::AgainstSpin, Action::Force) => "along the axis of rotation",
        (Direction::SpinCrossVelocity, _) => "across both velocity and angular velocity",
        (Direction::Towards, _) => "towards a point of the room",
    }
}

/// A variable in words.
pub(crate) fn variable(v: Variable, scene: &Scene) -> String {
    let axis = |k: usize| ["x", "y", "z"][k.min(2)];
    let link = |i: usize| scene.model.links.get(i).map_or("", |l| l.name.as_str());
    match v {
        Variable::None => "nothing".to_owned(),
        Variable::Speed => "the speed of the point".to_owned(),
        Variable::Spin => "the rate of rotation of the link".to_owned(),
        Variable::SinceTakeOff => "the time since take-off".to_owned(),
        Variable::Clock => "the time in the recording".to_owned(),
        Variable::Distance => "the distance from that point".to_owned(),
        Variable::Place(2) => "the height".to_owned(),
        Variable::Place(k) => format!("the place along {} of the room", axis(k)),
        Variable::VelocityInWorld(k) => format!("the velocity along {} of the room", axis(k)),
        Variable::VelocityInLink(k) => format!("the velocity along {} of the link", axis(k)),
        Variable::SpinInWorld(k) => format!("the angular velocity about {} of the room", axis(k)),
        Variable::SpinInLink(k) => format!("the angular velocity about {} of the link", axis(k)),
        Variable::Tilt(k) => format!("the inclination of axis {} of the link", axis(k)),
        Variable::JointRate(i) => format!("the rate of the joint of {}", link(i)),
        Variable::JointAngle(i) => format!("the angle of the joint of {}", link(i)),
    }
}

fn carrier(name: &str) -> String {
    if name == "body" { "the centre of mass".to_owned() } else { format!("`{name}`") }
}

fn action(a: Action) -> &'static str {
    match a {
        Action::Force => "a force",
        Action::Couple => "a couple",
    }
}

/// "a force on `link1`, against the velocity, depending on the speed; it removes 64 % of the
/// error".
pub(crate) fn diagnosis(scene: &Scene, d: &Diagnosis, variables: &[Variable]) -> String {
    let on = match variables {
        [] => "of constant size".to_owned(),
        of => {
            let words: Vec<String> = of.iter().map(|v| variable(*v, scene)).collect();
            format!("depending on {}", words.join(" times "))
        }
    };
    format!(
        "{} on {}, {}, {on}; it removes {:.0} % of the error{}",
        action(d.action),
        carrier(&d.carrier),
        direction(d.direction, d.action),
        100.0 * d.removes,
        also(&d.also)
    )
}

/// A law in words, with its direction.
pub(crate) fn law(scene: &Scene, law: &Law, nonlinear: &[f64], theta: &DVector<f64>, work: Work) -> String {
    let (point, anchor, parts) = law.divided(nonlinear);
    let strength: Vec<String> = law
        .factors
        .iter()
        .zip(law.parameters_of(&parts))
        .map(|(f, p)| {
            let v = f.variable;
            f.shape.describe(&variable(v, scene), v.unit_in_words(scene), p, v.is_signed())
        })
        .collect();
    let name = law.carrier.name(scene);
    let mut text = format!("{} on {}", action(law.action), carrier(&name));
    if law.point_is != PointIs::Given {
        text.push_str(&format!(" at {}", vector(&point)));
    }
    text.push_str(&format!(", {}", direction(law.direction, law.action)));
    if law.components.len() == 3 && law.terms() == 1 {
        let v = Vector3::new(theta[0], theta[1], theta[2]);
        if v.norm() > 0.0 {
            text.push_str(&format!(" {}", vector(&(v / v.norm()))));
        }
    }
    if law.direction == Direction::Towards {
        text.push_str(&format!(" {}", vector(&anchor)));
    }
    text.push_str(&format!(", {}", strength.join(" and, as a second factor, ")));
    if let Some(delay) = law.delay(nonlinear) {
        text.push_str(&format!("; it follows the motion {:.0} ms late", 1000.0 * delay));
    }
    if work.share < 0.02 {
        text.push_str("; it does no work");
    } else if work.taken > 0.98 {
        text.push_str("; it only brakes");
    } else if work.taken < 0.02 {
        text.push_str("; it only drives");
    }
    text
}

/// A fitted law in words.
pub(super) fn fitted(session: &Session<'_>, f: &Fitted) -> String {
    law(session.scene, &f.law, &f.nonlinear, &f.theta, work(session, f))
}

/// A law of a round while the search goes on; `ratio` is the share that it leaves of the error
/// before the round, `further` if laws of rounds before it are in the model.
pub(super) fn law_so_far(session: &Session<'_>, f: &Fitted, ratio: f64, further: bool) -> String {
    let text = fitted(session, f);
    let left = 100.0 * ratio;
    if further {
        format!("a further law leaves {left:.0} % of the error in flight that remained: {text}")
    } else {
        format!("a law beyond the catalogue leaves {left:.0} % of the error in flight without it: {text}")
    }
}

/// Other links that are not excluded; their number where they are many, as for a couple, which
/// turns the whole body wherever it acts.
pub(crate) fn also(names: &[String]) -> String {
    match names {
        [] => String::new(),
        names if names.len() > MOST_NAMED => {
            format!("; any of {} other links may be its place", names.len())
        }
        names => {
            let list: Vec<String> = names.iter().map(|n| carrier(n)).collect();
            format!("; {} is not excluded as its place", list.join(" or "))
        }
    }
}

fn vector(v: &Vector3<f64>) -> String {
    format!("({:.3}, {:.3}, {:.3})", v.x, v.y, v.z)
}

/// A short title: "force on `link1` with the speed of the point".
pub(crate) fn title(scene: &Scene, law: &Law) -> String {
    let what = action(law.action).trim_start_matches("a ");
    let on = law.carrier.name(scene);
    let with: Vec<String> =
        law.factors.iter().filter(|f| f.variable != Variable::None).map(|f| variable(f.variable, scene)).collect();
    let with = if with.is_empty() { String::new() } else { format!(" with {}", with.join(" and ")) };
    format!("{what} on {on}{with} (found by search)")
}

/// An estimate with its interval, to two digits of its half-width.
fn estimate(e: &Estimate) -> String {
    match half_of(e.ci95) {
        Some(half) if half.is_finite() && half > 0.0 => {
            let digits = crate::wording::decimals(half);
            format!("{} = {:.digits$} ± {half:.digits$} {} (95 %)", e.name, e.value, e.unit)
        }
        _ => format!("{} = {:.4e} {}", e.name, e.value, e.unit),
    }
}

/// Documentation of the law as an effect.
pub(crate) fn documentation(text: &str, values: &[&Estimate], ratio: f64, p: f64, with_contact: bool) -> String {
    let of = if with_contact {
        "recordings the best entry at the places chosen by flights"
    } else {
        "flights the best entry of the search"
    };
    let values: Vec<String> = values.iter().map(|e| estimate(e)).collect();
    format!(
        "## Physics\nFound by `aloft discover`, not derived: {text}.\n\
         ## Equation\nAs in the formulas. On the recordings where it was found: {}.\n\
         ## Identifiability\nHeld-out error fell to {:.1} % with it; with random signs of the {of} does as well with a probability of about {p:.3}; its intervals do not contain \
         the choice of the law. \
         A law fitted to some motions need not hold for others: rank it again on new recordings, at other places, speeds and headings.\n\
         ## References\nNone: this law comes from recordings.\n",
        values.join("; "),
        100.0 * ratio
    )
}

/// Largest number of other links that are named.
const MOST_NAMED: usize = 3;

/// How much of the error laws describe, with the limits at which it is graded; the grade itself
/// stands in the table of errors.
fn lead(o: &OpenWorld) -> String {
    let law = "a law outside the catalogue describes";
    let left = |times: f64| format!("of the error; {times:.1} times its floor remain");
    match (o.times_floor_after, o.at_floor_after) {
        _ if !o.complete => "part of the error follows a law outside the catalogue".to_owned(),
        (Some(times), _) if times >= POOR_TIMES_FLOOR => format!("{law} a part {}", left(times)),
        (Some(times), None) if times < FAIR_TIMES_FLOOR => format!("{law} the error down to its floor"),
        (None, _) | (_, Some(true)) => format!("{law} the error down to its floor"),
        (Some(times), _) => format!("{law} most {}", left(times)),
    }
}

impl OpenWorld {
    /// Laws that leave no more than the floor as computed by all stages are the answer, whatever
    /// the rows of the search say.
    pub(crate) fn judged_by_stages(&mut self, after: &HeldOutResult) {
        let at_floor = after.reached_by(after.held_out_error) || after.times_floor() <= ANSWERED;
        self.complete |= at_floor && !self.laws.is_empty();
        self.words = answer(self);
    }
}

impl Discovery {
    /// States what laws beyond the catalogue leave in flight as computed by all stages: errors and
    /// words follow it. Nothing changes without laws that are the answer.
    pub fn restate_laws(&mut self, after: &HeldOutResult) {
        let Some(open) = self.open.as_mut().filter(|o| o.complete && !o.laws.is_empty()) else { return };
        open.held_out_error_after = after.held_out_error;
        open.times_floor_after = Some(after.times_floor()).filter(|t| t.is_finite());
        open.at_floor_after = after.noise_floor_ci95.map(|_| after.reached_by(after.held_out_error));
        let words = answer(open);
        self.words = self.words.replace(&open.words, &words);
        open.words = words;
    }
}

/// The result of the search.
pub(crate) fn answer(o: &OpenWorld) -> String {
    let stopped = o.stopped_after_s.map_or(String::new(), |s| {
        format!("; the search was stopped when its budget of {s} s was used up: more time may find more")
    });
    let found = match (&o.laws[..], &o.diagnosis) {
        ([], None) => format!(
            "beyond the catalogue: none of {} combinations of place, direction and variable describes the error better than chance",
            o.entries
        ),
        ([], Some(d)) => {
            format!("beyond the catalogue: no law describes the error down to its floor; nearest is {}", d.text)
        }
        (laws, _) => {
            let each: Vec<String> = laws
                .iter()
                .map(|l| match l.kind {
                    LawKind::Formula => format!("`{}`: {}", l.id, l.text),
                    LawKind::Curve => format!("`{}` (no simple expression fits: a curve): {}", l.id, l.text),
                })
                .collect();
            // the words before are on flights
            let contact = o.times_floor_in_contact.filter(|t| *t >= POOR_TIMES_FLOOR);
            let contact = contact.map_or(String::new(), |t| format!("; in contact {t:.1} times the floor remain"));
            format!("{}: {}{contact}", lead(o), each.join("; and "))
        }
    };
    found + &stopped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(times: Option<f64>, at_floor: Option<bool>) -> OpenWorld {
        OpenWorld {
            model: Vec::new(),
            entries: 10,
            clusters: 20,
            by_chance: 0.9,
            diagnosis: None,
            atlas: Vec::new(),
            laws: Vec::new(),
            next: None,
            complete: true,
            times_floor_after: times,
            at_floor_after: at_floor,
            held_out_error_after: 1.0,
            times_floor_in_contact: None,
            stopped_after_s: None,
            words: String::new(),
        }
    }

    #[test]
    fn the_words_on_a_law_follow_the_judgement_of_what_it_leaves() {
        for (times, at_floor, words) in [
            (1.2, Some(true), "the error down to its floor"),
            (1.2, None, "the error down to its floor"),
            (1.2, Some(false), "most of the error; 1.2 times its floor remain"),
            (2.1, Some(true), "the error down to its floor"),
            (2.1, Some(false), "most of the error; 2.1 times its floor remain"),
            (3.6, Some(false), "a part of the error; 3.6 times its floor remain"),
            (3.6, Some(true), "a part of the error; 3.6 times its floor remain"),
        ] {
            assert_eq!(lead(&open(Some(times), at_floor)), format!("a law outside the catalogue describes {words}"));
        }
        let part = OpenWorld { complete: false, ..open(Some(1.2), Some(true)) };
        assert_eq!(lead(&part), "part of the error follows a law outside the catalogue");
    }
}
