//! A plate that lies elsewhere than the file says.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "plate_origin",
    title: "plate displaced",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets: def::plates,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
The corners of a plate were measured wrongly, or the plate was moved: its wrench is right but acts elsewhere. 5-10 mm make 10-20 N m at 2000 N.

## Equation
True moment = measured moment + `d` x F of the plate. Coefficients: the shift `d` (m, world), from where the file says to where the plate is.

## Identifiability
A moment in proportion to the force, constant over trials. All plates shifted alike look like a shifted centre of mass in contact; flights break the tie. The vertical part needs shear.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    ["x", "y", "z"].iter().map(|a| Coefficient::within(format!("shift_{a}"), "m", -0.5, 0.5)).collect()
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    let Target::Plate(plate) = target else { return };
    let Some(here) = f.plates.get(plate) else { return };
    if f.flight {
        return;
    }
    for k in 0..3 {
        out.couple(i, k, &def::axis(k).cross(&here.force_n));
    }
}
