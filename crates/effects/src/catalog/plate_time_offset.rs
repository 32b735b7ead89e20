//! Plates whose samples come late or early against the cameras.

use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "plate_time_offset",
    title: "time offset between plates and cameras",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Plates,
    separated_by: Separation::KnownWeight,
    documentation: "\
## Physics
The plates' samples are stamped late (or early) against the frames of the cameras: a wrong trigger, a delay of an amplifier's filter. One frame at 100 Hz is 100-200 N at take-off.

## Equation
True wrench = measured wrench + `tau` d(measured)/dt. Coefficient: `tau` (s), positive when plate samples come late; for all plates or one.

## Identifiability
Biphasic residuals in proportion to dF/dt at impacts. Not observable in quiet standing. A drift of the clock makes it grow over the session.

## References
Own arithmetic (`cargo test -p aloft-effects`).
",
    ..About::PLAIN
};

pub(super) struct PlateTimeOffset;

impl Effect for PlateTimeOffset {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::all_or_one_plate(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::within("delay", "s", -0.2, 0.2)]
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants().filter(|(_, f)| !f.flight) {
            for (_, here) in f.plates.iter().enumerate().filter(|(plate, _)| target.includes_plate(*plate)) {
                out.add(i, 0, &here.force_rate, &here.moment_rate);
            }
        }
    }
}
