//! A fitted law for users: constants with intervals, place, work, words, and the effect to add.

use super::formula::is_curve;
use super::kinematics::Variable;
use super::law::{Law, PointIs};
use super::near_joint::other_links;
use super::result::{FoundLaw, LawKind};
use super::stated::Step;
use super::wording;
use super::work::work;
use crate::result::Estimate;
use crate::session::Session;
use aloft_effects::{Effect, Target};

/// Distance from a joint within which a force on a person may act on either link, beyond the
/// intervals of its point, which contain neither soft tissue nor errors of joint centres, m.
const NEAR_JOINT_M: f64 = 0.025;

/// Widens the intervals of coefficients and nonlinear parameters.
pub(super) type Widen<'w> = &'w dyn Fn((&mut [Estimate], &mut [Estimate]));

/// A fitted law for users.
pub(super) fn describe(session: &Session<'_>, ids: &mut Vec<String>, found: &Step, widen: Widen<'_>) -> FoundLaw {
    let scene = session.scene;
    let Step { fitted: f, ratio, p, also, of_both } = found;
    let mut law = f.law.clone();
    let carrier = law.carrier.name(scene);
    let stem: String = carrier.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    law.id = (1..)
        .map(|n| if n == 1 { format!("law_{stem}") } else { format!("law_{stem}_{n}") })
        .find(|id| !ids.contains(id))
        .unwrap_or_default();
    ids.push(law.id.clone());
    let k = f.theta.len();
    let of = |i: usize| (f.se.get(i).copied().unwrap_or(f64::NAN), f.freedom.get(i).copied().unwrap_or(f64::NAN));
    let estimate = |name: String, unit: String, value: f64, i: usize, at_bound: bool| {
        let (se, freedom) = of(i);
        Estimate { name, value, se: f64::NAN, ci95: None, freedom: f64::NAN, at_bound, widening: 1.0, unit }
            .with_error(se, freedom)
    };
    let mut coefficients: Vec<Estimate> = law
        .coefficients(scene, Target::Body)
        .into_iter()
        .enumerate()
        .map(|(i, c)| estimate(c.name, c.unit, f.theta[i], i, false))
        .collect();
    let mut nonlinear: Vec<Estimate> = law
        .nonlinear(scene, Target::Body)
        .into_iter()
        .zip(&f.nonlinear)
        .enumerate()
        .map(|(j, (q, value))| {
            let at_bound = (value - q.lower).abs() < 1e-9 || (value - q.upper).abs() < 1e-9;
            estimate(q.name, q.unit, *value, k + j, at_bound)
        })
        .collect();
    widen((&mut coefficients, &mut nonlinear));
    let split = law.point_is.unknowns();
    let kind = if is_curve(&law) { LawKind::Curve } else { LawKind::Formula };
    let work = work(session, f);
    let point = point_of(&law, &f.nonlinear, &nonlinear);
    let slack_m = if session.prior.is_some() { NEAR_JOINT_M } else { 0.0 };
    let at_joint = other_links(&scene.model, law.carrier, &point, slack_m).into_iter().filter(|c| !also.contains(c));
    let also: Vec<String> = also.iter().copied().chain(at_joint).map(|c| c.name(scene)).collect();
    let found_in = if *of_both { "; found in flight and contact together" } else { "" };
    let text = wording::law(scene, &law, &f.nonlinear, &f.theta, work) + &wording::also(&also) + found_in;
    let values: Vec<&Estimate> = coefficients.iter().chain(&nonlinear[split..]).chain(&point).collect();
    let documentation = wording::documentation(&text, &values, *ratio, *p, *of_both);
    let mut effect = law.formula(scene, &f.nonlinear, documentation);
    effect.title = wording::title(scene, &law);
    FoundLaw {
        id: law.id.clone(),
        kind,
        carrier,
        also,
        action: law.action,
        direction: law.direction,
        variables: law
            .factors
            .iter()
            .filter(|f| f.variable != Variable::None)
            .map(|f| f.variable.formula(scene))
            .collect(),
        strength: law.strength(scene),
        point,
        coefficients,
        parameters: nonlinear[split..].to_vec(),
        held_out_ratio: *ratio,
        family_wise_p: *p,
        with_contact: *of_both,
        sized_with_contact: false,
        work,
        text,
        effect,
    }
}

/// Share of a link's axis along the force from which on a point's coordinate on it is not
/// determined.
const ALONG: f64 = 0.9;

/// Coordinates of the point in the link with their intervals; empty where they are given. A point
/// can be moved along its force: the coordinate along it has no interval, and its value is that of
/// the point of the line nearest to the centre of mass.
fn point_of(law: &Law, values: &[f64], fitted: &[Estimate]) -> Vec<Estimate> {
    match law.point_is {
        PointIs::Given => Vec::new(),
        PointIs::Free => fitted[..3].to_vec(),
        PointIs::OnPlane(axes) => {
            let (point, _, _) = law.divided(values);
            let freedom = fitted[0].freedom.min(fitted[1].freedom);
            let along = axes[0].cross(&axes[1]);
            (0..3)
                .map(|k| {
                    let across = (axes[0][k] * fitted[0].se).hypot(axes[1][k] * fitted[1].se);
                    let se = if along[k].abs() > ALONG { f64::NAN } else { across };
                    let name = format!("point_{}", ["x", "y", "z"][k]);
                    Estimate { name, value: point[k], ..fitted[0].clone() }.with_error(se, freedom)
                })
                .collect()
        }
    }
}
