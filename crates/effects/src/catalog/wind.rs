//! Air that moves.

use super::quadratic_drag::{centre_starts, centres, drag};
use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::{Columns, EffectFrame, Scene};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "wind",
    title: "steady wind, with quadratic drag",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &["quadratic_drag"],
    by_group: false,
    unbounded: "an area is not negative, and clothing or a parachute make it any size",
    targets: def::body_or_links,
    coefficients,
    nonlinear,
    starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
Air that streams past (a fan, ventilation, an open door) drags the body along: quadratic drag with the velocity of the air taken off.

## Equation
`F_i = -1/2 rho C_dA s_i |v_i - w| (v_i - w)`, w constant in the world. Coefficient: the drag area `C_dA` (m2, positive); nonlinear: `w` (m/s, up to 15 each way). \
With few links each has its own area and centre, as in still air.

## Identifiability
A body that is slow against the wind feels a constant force: then wind is an exact alias of a tilt of gravity and of a constant force. \
It contains quadratic drag in still air. Throws with and against the wind at several speeds separate it.

## References
Hoerner, Fluid-Dynamic Drag (1965); own simulations.
",
};

fn coefficients(scene: &Scene, target: Target) -> Vec<Coefficient> {
    match target {
        Target::EveryLink => {
            scene.model.links.iter().map(|l| Coefficient::positive(format!("drag_area_{}", l.name), "m^2")).collect()
        }
        _ => vec![Coefficient::positive("drag_area", "m^2")],
    }
}

fn nonlinear(scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
    let mut out: Vec<NonlinearParameter> =
        ["x", "y", "z"].iter().map(|a| NonlinearParameter::new(format!("wind_{a}"), "m/s", -15.0, 15.0, 0.3)).collect();
    out.extend(centres(scene, target));
    out
}

fn starts(scene: &Scene, target: Target) -> Vec<Vec<f64>> {
    let mut winds = vec![[0.0; 3]];
    for speed in [1.5, 5.0] {
        for k in 0..8 {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(k)).sin_cos();
            winds.push([speed * cos, speed * sin, 0.0]);
        }
    }
    let centres = &centre_starts(scene, target)[0];
    winds.iter().map(|w| [w.as_slice(), centres.as_slice()].concat()).collect()
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    drag(f, target, &Vector3::new(p[0], p[1], p[2]), &p[3..], out, i);
}
