//! A plate that reads too much or too little.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "plate_gain",
    title: "gain of a plate",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    class: "body mass, where all plates err alike",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets: def::all_or_one_plate,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
An amplifier's gain is off, or sensitivities were typed in wrongly: the plate reads some per cent too much or too little.

## Equation
All plates: true wrench = (1 + `gain`) measured. One plate: each of its six components (world axes, moments about its centre) has its own gain; they are those of the plate's channels where its axes are parallel to the room's. \
Coefficients: relative (0.03 for a plate that reads 3 % too little).

## Identifiability
One gain for all plates is an exact alias of a wrongly stated body mass; a single plate, or a single component, is not. Standing with the weight on each plate in turn separates them.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, target: Target) -> Vec<Coefficient> {
    let within = |n: &str| Coefficient::within(n, "1", -0.5, 0.5);
    match target {
        Target::Plate(_) => {
            ["gain_fx", "gain_fy", "gain_fz", "gain_mx", "gain_my", "gain_mz"].iter().map(|n| within(n)).collect()
        }
        _ => vec![within("gain")],
    }
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    if f.flight {
        return;
    }
    match target {
        Target::Plate(plate) => {
            let (Some(here), Some(centre)) = (f.plates.get(plate), f.scene.plate_centers_m.get(plate)) else { return };
            let about_centre = here.moment_nm - centre.cross(&here.force_n);
            for k in 0..3 {
                out.force_at(i, k, &(def::axis(k) * here.force_n[k]), centre);
                out.couple(i, 3 + k, &(def::axis(k) * about_centre[k]));
            }
        }
        _ => {
            for here in f.plates {
                out.add(i, 0, &here.force_n, &here.moment_nm);
            }
        }
    }
}
