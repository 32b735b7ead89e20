//! Gravity that does not point along the room's vertical.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "gravity_tilt",
    title: "gravity leans (capture volume not level)",
    kind: EffectKind::Artefact,
    acts: ActsIn::Both,
    class: "steady wind, constant force near the centre of mass",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets: def::body,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
The calibration frame of the cameras was not level, so gravity has horizontal components in the capture frame: every flight drifts to the same side.

## Equation
`F = M (dg_x, dg_y, 0)` at the centre of mass. Coefficients: `dg_x`, `dg_y` in m/s2; one degree is 0.171 m/s2.

## Identifiability
Visible to 95 % beside the inertial parameters. A steady wind and a constant force near the centre of mass are exact aliases in flight. Plates that are level, or a plumb line, separate them.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(scene: &Scene, _: Target) -> Vec<Coefficient> {
    let g = 0.2 * scene.gravity();
    ["dg_x", "dg_y"].iter().map(|n| Coefficient::within(*n, "m/s^2", -g, g)).collect()
}

fn law(f: &EffectFrame<'_>, _: Target, _: &[f64], out: &mut Columns, i: usize) {
    for k in 0..2 {
        out.force_at(i, k, &(def::axis(k) * f.scene.mass_kg), &f.com);
    }
}
