//! What is known of an error without a law: the best entry of the atlas in numbers and words.

use super::atlas::{Atlas, Group, splines};
use super::kinematics::Variable;
use super::off_link::ALSO;
use super::result::Diagnosis;
use super::wording;
use crate::problem::Problem;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use aloft_effects::Scene;

/// Share of the squared error that a product of two variables has to leave to be named before one.
const PRODUCT: f64 = 0.7;

/// The best entry of the atlas in numbers: the simplest of those that are nearly as good.
pub(super) fn diagnose(session: &Session<'_>, problem: &Problem, atlas: &Atlas, p: f64) -> Diagnosis {
    let scene = session.scene;
    // one variable is preferred to a product of two, unless the product leaves much less
    let single = atlas.groups.iter().find(|g| g.is_one_dependence());
    let first = &atlas.groups[0];
    let best = single.filter(|s| first.score.ratio > PRODUCT * s.score.ratio).unwrap_or(first);
    let as_good =
        |g: &&Group| g.is_one_dependence() == best.is_one_dependence() && g.score.ratio <= 1.04 * best.score.ratio;
    let g = atlas
        .groups
        .iter()
        .filter(as_good)
        .min_by(|a, b| a.columns.cmp(&b.columns).then(a.score.ratio.total_cmp(&b.score.ratio)))
        .unwrap_or(best);
    let constant = atlas.groups.iter().find(|o| {
        o.variable == Variable::None
            && o.carrier == g.carrier
            && o.action == g.action
            && o.direction == g.direction
            && o.components == g.components
    });
    let plain: Vec<f64> = problem.folds.iter().map(|f| f.error).collect();
    let dependence_p = (g.variable != Variable::None)
        .then(|| sign_flip_p(&g.score.errors, constant.map_or(&plain, |c| &c.score.errors), 2000, 0x7157));
    let near = |o: &&Group| o.action == g.action && o.score.ratio <= ALSO * ALSO * best.score.ratio;
    let also = g.carrier.others(atlas.groups.iter().filter(near).map(|o| o.carrier));
    let mut out = Diagnosis {
        carrier: g.carrier.name(scene),
        also: also.into_iter().map(|c| c.name(scene)).collect(),
        action: g.action,
        direction: g.direction,
        variable: variable_of(g, scene),
        held_out_ratio: g.score.ratio.sqrt(),
        removes: 1.0 - g.score.ratio.sqrt(),
        family_wise_p: p,
        constant_ratio: constant.map(|c| c.score.ratio.sqrt()),
        dependence_p,
        curve: curve_of(g),
        text: String::new(),
    };
    let variables: Vec<Variable> =
        std::iter::once(g.variable).chain(g.second.map(|s| s.0)).filter(|v| *v != Variable::None).collect();
    out.text = wording::diagnosis(scene, &out, &variables);
    out
}

/// Variable of an entry in formulas, `a*b` for a product.
pub(super) fn variable_of(g: &Group, scene: &Scene) -> String {
    let first = g.variable.formula(scene);
    g.second.map_or(first.clone(), |s| format!("{first}*{}", s.0.formula(scene)))
}

/// Strength over the variable for the component with the largest strength.
fn curve_of(g: &Group) -> Vec<[f64; 2]> {
    const POINTS: usize = 13;
    if g.frequency.is_some() || g.second.is_some() || g.variable == Variable::None || g.variable == Variable::Distance {
        return Vec::new();
    }
    let nb = g.columns / g.components.len().max(1);
    let x: Vec<f64> = (0..POINTS).map(|i| g.range.low + g.range.width() * i as f64 / (POINTS - 1) as f64).collect();
    let basis = splines(&x, g.range);
    let of = |d: usize| -> Vec<f64> {
        basis.chunks_exact(nb).map(|b| b.iter().enumerate().map(|(k, b)| b * g.score.theta[d * nb + k]).sum()).collect()
    };
    let size = |y: &[f64]| y.iter().map(|v| v * v).sum::<f64>();
    let all: Vec<Vec<f64>> = (0..g.components.len()).map(of).collect();
    let Some(largest) = all.into_iter().max_by(|a, b| size(a).total_cmp(&size(b))) else { return Vec::new() };
    x.into_iter().zip(largest).map(|(x, y)| [x, y]).collect()
}
