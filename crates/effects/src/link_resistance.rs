//! Resistance on the links: what drag laws share. One coefficient serves all links, or each link
//! has its own, and then also a centre of its own.

use crate::{Coefficient, Columns, EffectFrame, NonlinearParameter, Scene, Target, Values};
use nalgebra::Vector3;

/// A coefficient that is not negative: `name` for all links, or `name_LINK` for each.
pub(crate) fn one_or_each(scene: &Scene, target: Target, name: &str, unit: &str) -> Vec<Coefficient> {
    let of = |l: &aloft_body::Link| Coefficient::positive(format!("{name}_{}", l.name), unit);
    match target {
        Target::EveryLink => scene.model.links.iter().map(of).collect(),
        _ => vec![Coefficient::positive(name, unit)],
    }
}

/// Centres of the links' areas as unknowns, where each link has its own.
pub(crate) fn centres(scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
    if !matches!(target, Target::EveryLink | Target::Shape) {
        return Vec::new();
    }
    let of = |(link, com): (&aloft_body::Link, &Vector3<f64>)| {
        NonlinearParameter::point_on_link(&format!("centre_{}", link.name), com, 0.3)
    };
    scene.model.links.iter().zip(&scene.link_com_m).flat_map(of).collect()
}

/// Starting values of the centres: the links' centres of mass.
pub(crate) fn centre_starts(scene: &Scene, target: Target) -> Vec<f64> {
    match target {
        Target::EveryLink | Target::Shape => scene.link_com_m.iter().flat_map(|c| [c.x, c.y, c.z]).collect(),
        _ => Vec::new(),
    }
}

/// Centres of the links' areas in their frames, m: the given ones, or the centres of mass.
pub(crate) fn centres_of(scene: &Scene, given: &[f64]) -> Vec<Vector3<f64>> {
    let mut values = Values::new(given);
    let enough = given.len() == 3 * scene.link_com_m.len();
    scene.link_com_m.iter().map(|com| if enough { values.vector() } else { *com }).collect()
}

/// Forces at the links' centres at instant `i`: `law` gives the force for a coefficient of one from
/// the velocity of a centre (m/s, world axes). One column for all links, each with its share of the
/// area, or one per link.
pub(crate) fn resist(
    f: &EffectFrame<'_>,
    target: Target,
    centres_m: &[Vector3<f64>],
    law: impl Fn(Vector3<f64>) -> Vector3<f64>,
    out: &mut Columns,
    i: usize,
) {
    for (link, (here, centre)) in f.links.iter().zip(centres_m).enumerate() {
        let unit = law(here.point_velocity(centre));
        match target {
            Target::EveryLink => out.force_at(i, link, &unit, &here.point(centre)),
            _ => out.force_at(i, 0, &(unit * f.scene.area_share[link]), &here.point(centre)),
        }
    }
}
