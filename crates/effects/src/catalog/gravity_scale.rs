//! Gravity of another magnitude, or clock or ruler of another scale.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "gravity_scale",
    title: "magnitude of gravity, frame rate or length scale",
    kind: EffectKind::Artefact,
    acts: ActsIn::Both,
    class: "frame rate, length scale, buoyancy",
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
The free fall in the recordings is not the stated gravity: another latitude, a wrong frame rate in the header, a wand of another length, buoyancy.

## Equation
`F = s M g` at the centre of mass. Coefficient: `s`, the relative excess of gravity; a frame rate that is truly higher by x than stated shows as s = -2 x, \
lengths stated too long by y as s = +y.

## Identifiability
Visible to 91-99 % beside the inertial parameters. Magnitude of gravity, frame rate, length scale and buoyancy are exact aliases in flight: motion fixes only g T2 / L. \
Plate weight, a calibrated wand, a clock pulse or a dropped ball separate them. Added mass is close to it.

## References
Own arithmetic and simulations (`cargo test -p aloft-effects`, `docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::within("gravity_excess", "1", -0.6, 0.6)]
}

fn law(f: &EffectFrame<'_>, _: Target, _: &[f64], out: &mut Columns, i: usize) {
    out.force_at(i, 0, &(f.scene.model.gravity_mps2 * f.scene.mass_kg), &f.com);
}
