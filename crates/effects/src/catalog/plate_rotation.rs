//! A plate whose axes are turned.

use crate::columns::axis;
use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "plate_rotation",
    title: "plate turned",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Plates,
    separated_by: Separation::KnownWeight,
    documentation: "\
## Physics
The axes of a plate are turned against those of the cameras: one degree makes 35 N of false shear at 2000 N.

## Equation
True wrench = measured wrench turned by the small rotation vector `a` about the centre of the plate. Coefficients: `a` (rad, world).

## Identifiability
Shear in proportion to the vertical force. A tilt of gravity looks alike on all plates together; in flight only the tilt is seen.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct PlateRotation;

impl Effect for PlateRotation {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::plates(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        Coefficient::vector_in_world("turn", "rad", 0.5)
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let Target::Plate(plate) = target else { return };
        for (i, f) in series.instants().filter(|(_, f)| !f.flight) {
            let (Some(here), Some(centre)) = (f.plates.get(plate), f.scene.plate_centres_m.get(plate)) else {
                continue;
            };
            let about_centre = here.moment_nm - centre.cross(&here.force_n);
            for k in 0..3 {
                out.force_at(i, k, &axis(k).cross(&here.force_n), centre);
                out.couple(i, k, &axis(k).cross(&about_centre));
            }
        }
    }
}
