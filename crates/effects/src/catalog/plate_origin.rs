//! A plate that lies elsewhere than the file says.

use crate::columns::axis;
use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "plate_origin",
    title: "plate displaced",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Plates,
    separated_by: Separation::KnownWeight,
    documentation: "\
## Physics
The corners of a plate were measured wrongly, or the plate was moved: its wrench is right but acts elsewhere. 5-10 mm make 10-20 N m at 2000 N.

## Equation
True moment = measured moment + `d` x F of the plate. Coefficients: the shift `d` (m, world), from where the file says to where the plate is.

## Identifiability
A moment in proportion to the force, constant over trials. All plates shifted alike look like a shifted centre of mass in contact; flights distinguish them. The vertical part needs shear.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct PlateOrigin;

impl Effect for PlateOrigin {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::plates(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        Coefficient::vector_in_world("shift", "m", 0.5)
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let Target::Plate(plate) = target else { return };
        for (i, f) in series.instants().filter(|(_, f)| !f.flight) {
            let Some(here) = f.plates.get(plate) else { continue };
            for k in 0..3 {
                out.couple(i, k, &axis(k).cross(&here.force_n));
            }
        }
    }
}
