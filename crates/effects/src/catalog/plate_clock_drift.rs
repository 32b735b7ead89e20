//! Plates whose clock runs faster or slower than that of the cameras.

use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "plate_clock_drift",
    title: "clock drift between plates and cameras",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Plates,
    separated_by: Separation::KnownWeight,
    uses_session_time: true,
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
    ..About::PLAIN
};

pub(super) struct PlateClockDrift;

impl Effect for PlateClockDrift {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::body_on_plates(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::within("rate", "1", -0.05, 0.05)]
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants().filter(|(_, f)| !f.flight) {
            for here in f.plates {
                out.add(i, 0, &(here.force_rate * f.session_time_s), &(here.moment_rate * f.session_time_s));
            }
        }
    }
}
