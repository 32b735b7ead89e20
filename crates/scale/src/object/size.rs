//! A rough inertial prior from the size of each link.

use super::links::Links;
use crate::prior::make_consistent;
use aloft_body::subject::PriorSd;
use aloft_body::{LinkInertia, Model, ModelMarker};
use nalgebra::{Matrix3, Vector3};

/// Minimum half-thickness of a link for its prior, m.
const THICKNESS_M: f64 = 0.01;

/// Uniform ellipsoids around markers and joints: rough, but sufficient to find flights.
pub(super) fn size_prior(
    links: &Links<'_>,
    model: &Model,
    markers: &[ModelMarker],
) -> (Vec<LinkInertia>, Vec<PriorSd>) {
    let n = model.n_links();
    let mut shapes = Vec::with_capacity(n);
    for l in 0..n {
        let mut points: Vec<Vector3<f64>> = markers.iter().filter(|m| m.link == l).map(|m| m.position_m).collect();
        if links.parents[l].is_some() {
            points.push(Vector3::zeros());
        }
        for (c, p) in links.parents.iter().enumerate() {
            if *p == Some(l) {
                points.push(model.links[c].joint.parent_from_joint.translation.vector);
            }
        }
        let count = points.len() as f64;
        let centre = points.iter().sum::<Vector3<f64>>() / count;
        let scatter = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum::<Matrix3<f64>>() / count;
        let thick = scatter + Matrix3::identity() * THICKNESS_M.powi(2);
        shapes.push((centre, thick, thick.determinant().max(0.0).sqrt()));
    }
    let stated: f64 = links.spec.links.iter().filter_map(|l| l.mass_fraction).sum();
    let open: f64 =
        shapes.iter().zip(&links.spec.links).filter(|(_, l)| l.mass_fraction.is_none()).map(|(s, _)| s.2).sum();
    let total = links.spec.total_mass_kg;
    let mut prior: Vec<LinkInertia> = shapes
        .iter()
        .zip(&links.spec.links)
        .map(|((centre, scatter, volume), link)| {
            let share = link.mass_fraction.unwrap_or_else(|| (1.0 - stated).max(0.0) * volume / open.max(1e-30));
            let mass_kg = (share * total).max(1e-6 * total);
            // Markers are on the surface: the second moment of a solid is about half of theirs.
            let second = scatter * (0.5 * mass_kg);
            let mut inertia = LinkInertia {
                mass_kg,
                com_m: *centre,
                inertia_com_kgm2: Matrix3::identity() * second.trace() - second,
            };
            make_consistent(&mut inertia, 1e-3);
            inertia
        })
        .collect();
    let sum: f64 = prior.iter().map(|p| p.mass_kg).sum();
    for p in &mut prior {
        p.mass_kg *= total / sum;
        p.inertia_com_kgm2 *= total / sum;
    }
    let sd = shapes
        .iter()
        .map(|(_, scatter, _)| PriorSd {
            mass_rel: 0.5,
            com_m: scatter.trace().sqrt() / 2.0,
            radius_rel: 0.5,
            together: PriorSd::DESCRIBED,
        })
        .collect();
    (prior, sd)
}
