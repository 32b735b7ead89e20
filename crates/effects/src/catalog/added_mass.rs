//! Inertia without weight: air or water that is carried along.

use super::constant_force;
use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};
use aloft_body::Phi;
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "added_mass",
    title: "added mass (inertia without weight)",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "magnitude of gravity",
    contains: &[],
    by_group: false,
    unbounded: "a mass is not negative; in water, or under a parachute, it exceeds that of the body",
    targets: def::links,
    coefficients,
    nonlinear: constant_force::nonlinear,
    starts: constant_force::starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: Some(inertia),
    documentation: "\
## Physics
A body that accelerates carries surrounding air or water along: inertia that weighs nothing. For limbs in air 0.1-0.5 % of the mass, for a parachute tens of kilograms.

## Equation
`F = -m_a a` at a point of the link, a its acceleration: a point mass whose weight is taken back. Coefficient: `m_a` (kg, positive); nonlinear: the point, within 0.3 m of the link's centre of mass.

## Identifiability
The inertia is absorbed by the inertial parameters; what remains is the missing weight, an upward force at the point: close to a smaller gravity unless the point is far from the centre of mass.

## References
Lamb, Hydrodynamics (1932), ch. 6; own simulations.
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::positive("added_mass", "kg")]
}

fn inertia(scene: &Scene, target: Target, p: &[f64]) -> Vec<Vec<Phi>> {
    vec![scene.unit_mass_at(def::link_of(target), &Vector3::new(p[0], p[1], p[2]))]
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    let point = f.links[def::link_of(target)].point(&Vector3::new(p[0], p[1], p[2]));
    out.force_at(i, 0, &-f.scene.model.gravity_mps2, &point);
}
