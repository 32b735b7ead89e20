//! A plate that reads something when nothing stands on it.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "plate_tare",
    title: "offset of a plate",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "an amplifier may stand at any offset",
    targets: def::plates,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A plate was not zeroed, or has drifted since: a constant wrench is added to what it measures.

## Equation
True wrench = measured wrench + (`F`, `c x F + N`), c the centre of the plate. Coefficients: F (N) and N (N m) in world axes, the negative of what the plate reads unloaded, moments about the centre of its surface.

## Identifiability
Constant in the room, but seen only on the plates: flights are free of it. In a recording with flights the unloaded reading gives it directly.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    let mut out = Coefficient::vector("force", "N");
    out.extend(Coefficient::vector("moment", "N*m"));
    out
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    let Target::Plate(plate) = target else { return };
    let Some(centre) = f.scene.plate_centers_m.get(plate) else { return };
    if f.flight || f.plates.is_empty() {
        return;
    }
    for k in 0..3 {
        out.force_at(i, k, &def::axis(k), centre);
        out.couple(i, 3 + k, &def::axis(k));
    }
}
