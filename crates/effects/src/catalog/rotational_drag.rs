//! Resistance against turning.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "rotational_drag",
    title: "resistance against turning",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "a resistance is not negative; how large it is depends on the fluid",
    targets: def::body_or_links,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
Air (or a fluid) resists the turning of each link by a moment against its angular velocity; no force comes with it.

## Equation
`N_i = -c w_i`, w_i the angular velocity of link i in the world. Coefficient: `c` in N m s/rad, the same for all links (with few links one a link may be fitted), positive.

## Identifiability
34 % is taken by inertia errors in a human jump, little in a tumbling chain. The moment follows the angular velocity and decays it: long flights with spin show it.

## References
Lamb, Hydrodynamics (1932), s. 334; own simulations.
",
};

fn coefficients(scene: &Scene, target: Target) -> Vec<Coefficient> {
    match target {
        Target::EveryLink => scene
            .model
            .links
            .iter()
            .map(|l| Coefficient::positive(format!("rotational_resistance_{}", l.name), "N*m*s/rad"))
            .collect(),
        _ => vec![Coefficient::positive("rotational_resistance", "N*m*s/rad")],
    }
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    for (link, here) in f.links.iter().enumerate() {
        let column = if target == Target::EveryLink { link } else { 0 };
        out.couple(i, column, &-here.omega);
    }
}
