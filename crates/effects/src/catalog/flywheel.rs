//! A wheel that spins at constant speed inside a link.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "flywheel",
    title: "flywheel of constant momentum",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "a wheel turns either way, at any rate",
    targets: def::links,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A wheel spins at constant speed about an axis fixed in a link. Turning the link turns its momentum, and the link feels the reaction: a moment across the angular velocity that does no work.

## Equation
`N = -w x (R h)`, R and w rotation and angular velocity of the link. Coefficients: the momentum `h` in link axes, N m s.

## Identifiability
30-55 % is taken by errors of products of inertia. It is linear in w and changes sign with it: turning in both senses about several axes separates it. Links that turn alike cannot be told apart.

## References
Hughes, Spacecraft Attitude Dynamics (1986), ch. 3; own simulations.
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    Coefficient::vector("momentum", "N*m*s")
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    let link = &f.links[def::link_of(target)];
    for k in 0..3 {
        out.couple(i, k, &-link.omega.cross(&link.rotation.column(k).into_owned()));
    }
}
