//! Something carried on a link in some trials.

use super::constant_force;
use crate::Scene;
use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target};
use aloft_body::Phi;
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "payload",
    title: "payload on a link in a group of trials",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: true,
    unbounded: "negative where the body was weighed with the load",
    targets: def::links,
    coefficients,
    nonlinear: constant_force::nonlinear,
    starts: constant_force::starts,
    wrench: None,
    inertia: Some(inertia),
    documentation: "\
## Physics
A weight, a vest, a bag or a tool rides on a link in some of the trials. Within those trials it is part of the body; between loaded and unloaded trials the inertial parameters differ.

## Equation
Parameters of the link change by `m [1, p, |p|2 1 - p p']` in the trials of one group. Coefficient: mass `m` (kg, relative to the body mass stated). Nonlinear: the place p within 0.3 m of the link's centre of mass.

## Identifiability
Exactly absorbed by the inertial parameters unless there are loaded and unloaded trials; the group is named by the user or found from the trials themselves. Which group carries it follows from the sign only if the body mass was taken unloaded.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::free("mass", "kg")]
}

fn inertia(scene: &Scene, target: Target, p: &[f64]) -> Vec<Vec<Phi>> {
    vec![scene.unit_mass_at(def::link_of(target), &Vector3::new(p[0], p[1], p[2]))]
}
