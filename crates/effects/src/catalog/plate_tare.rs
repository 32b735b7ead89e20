//! A plate that reads something when nothing stands on it.

use crate::columns::axis;
use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "plate_tare",
    title: "offset of a plate",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Plates,
    separated_by: Separation::KnownWeight,
    shows_unloaded: true,
    unbounded: "amplifier offsets are arbitrary",
    documentation: "\
## Physics
A plate was not zeroed, or has drifted since: a constant wrench is added to what it measures.

## Equation
True wrench = measured wrench + (`F`, `c x F + N`), c the centre of the plate. Coefficients: F (N) and N (N m) in world axes, the negative of what the plate reads unloaded, moments about the centre of its surface.

## Identifiability
Constant in the room, but seen only on the plates: flights are free of it. Where every recording unloads the plates, these readings give it directly, and `discover` does not seek it.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

/// First columns of the force and of the moment.
const FORCE: usize = 0;
const MOMENT: usize = 3;

pub(super) struct PlateTare;

impl Effect for PlateTare {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::plates(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        let mut out = Coefficient::vector_in_world("force", "N", f64::INFINITY);
        out.extend(Coefficient::vector_in_world("moment", "N*m", f64::INFINITY));
        out
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let Target::Plate(plate) = target else { return };
        let Some(centre) = series.scene.plate_centres_m.get(plate) else { return };
        for (i, _) in series.instants().filter(|(_, f)| !f.flight && !f.plates.is_empty()) {
            for k in 0..3 {
                out.force_at(i, FORCE + k, &axis(k), centre);
                out.couple(i, MOMENT + k, &axis(k));
            }
        }
    }
}
