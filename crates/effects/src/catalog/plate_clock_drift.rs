//! Plates whose clock runs faster or slower than that of the cameras.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "plate_clock_drift",
    title: "clock drift between plates and cameras",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
Two devices with their own clocks drift apart: the delay between plates and cameras grows with time.

## Equation
True wrench = measured wrench + `rate` t d(measured)/dt, t since the session began (by dates in the files, else by the order and lengths of the recordings; then pauses are not counted and `rate` comes out too large in proportion). Coefficient: `rate` (1); 50e-6 make 3 ms in a minute.

## Identifiability
With one short recording it is a constant delay; it needs impacts at different times of a long recording or session.

## References
Own arithmetic (`cargo test -p aloft-effects`).
",
};

fn targets(scene: &Scene) -> Vec<Target> {
    if scene.n_plates() > 0 { vec![Target::Body] } else { Vec::new() }
}

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::within("rate", "1", -0.05, 0.05)]
}

fn law(f: &EffectFrame<'_>, _: Target, _: &[f64], out: &mut Columns, i: usize) {
    if f.flight {
        return;
    }
    for here in f.plates {
        out.add(i, 0, &(here.force_rate * f.session_time_s), &(here.moment_rate * f.session_time_s));
    }
}
