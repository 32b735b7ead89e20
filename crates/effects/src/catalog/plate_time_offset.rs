//! Plates whose samples come late or early against the cameras.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "plate_time_offset",
    title: "time offset between plates and cameras",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    class: "",
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
The plates' samples are stamped late (or early) against the frames of the cameras: a wrong trigger, a delay of an amplifier's filter. One frame at 100 Hz is 100-200 N at take-off.

## Equation
True wrench = measured wrench + `tau` d(measured)/dt. Coefficient: `tau` (s), positive when plate samples come late; for all plates or one.

## Identifiability
Biphasic residuals in proportion to dF/dt at impacts. Quiet standing shows nothing. A drift of the clock makes it grow over the session.

## References
Own arithmetic (`cargo test -p aloft-effects`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::within("delay", "s", -0.2, 0.2)]
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    if f.flight {
        return;
    }
    for (_, here) in f.plates.iter().enumerate().filter(|(p, _)| def::plate_in(target, *p)) {
        out.add(i, 0, &here.force_rate, &here.moment_rate);
    }
}
