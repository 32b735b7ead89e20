//! Resistance in proportion to the speed.

use super::quadratic_drag::{centre, centre_starts, centres};
use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "linear_drag",
    title: "resistance, linear in speed",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "a resistance is not negative; how large it is depends on the fluid or the brake",
    targets: def::body_or_links,
    coefficients,
    nonlinear: centres,
    starts: centre_starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A viscous surrounding, a dragged cable or a brake resists in proportion to the velocity of each link. It always takes energy from the body.

## Equation
`F_i = -c s_i v_i` at the centre of mass of link i, s_i the link's share of the mean area. Coefficient: `c` in N s/m, positive; with few links one a link may be fitted, \
each at a centre of its own (nonlinear).

## Identifiability
Visible to 92-99 % beside the inertial parameters. Quadratic drag looks alike (cosine 0.97-0.98): only a range of speeds of 3:1 or more separates them.

## References
Batchelor, An Introduction to Fluid Dynamics (1967), s. 4.9; own simulations.
",
};

fn coefficients(scene: &Scene, target: Target) -> Vec<Coefficient> {
    match target {
        Target::EveryLink => {
            scene.model.links.iter().map(|l| Coefficient::positive(format!("resistance_{}", l.name), "N*s/m")).collect()
        }
        _ => vec![Coefficient::positive("resistance", "N*s/m")],
    }
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    for (link, here) in f.links.iter().enumerate() {
        let centre = centre(f, link, p);
        let unit = -here.point_velocity(&centre);
        match target {
            Target::EveryLink => out.force_at(i, link, &unit, &here.point(&centre)),
            _ => out.force_at(i, 0, &(unit * f.scene.area_share[link]), &here.point(&centre)),
        }
    }
}
