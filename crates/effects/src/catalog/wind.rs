//! Air that moves.

use super::quadratic_drag::drag;
use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw};
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
    targets: def::body,
    coefficients,
    nonlinear,
    starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
Air that streams past (a fan, ventilation, an open door) drags the body along: quadratic drag with the velocity of the air taken off.

## Equation
`F_i = -1/2 rho C_dA s_i |v_i - w| (v_i - w)`, w constant in the world. Coefficient: the drag area `C_dA` (m2, positive); nonlinear: `w` (m/s, up to 15 each way).

## Identifiability
A body that is slow against the wind feels a constant force: then wind is an exact alias of a tilt of gravity and of a constant force. \
It contains quadratic drag in still air. Throws with and against the wind at several speeds separate it.

## References
Hoerner, Fluid-Dynamic Drag (1965); own simulations.
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::positive("drag_area", "m^2")]
}

fn nonlinear(_: &Scene, _: Target) -> Vec<NonlinearParameter> {
    ["x", "y", "z"].iter().map(|a| NonlinearParameter::new(format!("wind_{a}"), "m/s", -15.0, 15.0, 0.3)).collect()
}

fn starts(_: &Scene, _: Target) -> Vec<Vec<f64>> {
    let mut out = vec![vec![0.0; 3]];
    for speed in [1.5, 5.0] {
        for k in 0..8 {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * k as f64).sin_cos();
            out.push(vec![speed * cos, speed * sin, 0.0]);
        }
    }
    out
}

fn law(f: &EffectFrame<'_>, _: Target, p: &[f64], out: &mut Columns, i: usize) {
    drag(f, Target::Body, &Vector3::new(p[0], p[1], p[2]), &[], out, i);
}
