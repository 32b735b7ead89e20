//! A plate whose axes are turned.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "plate_rotation",
    title: "plate turned",
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
The axes of a plate are turned against those of the cameras: one degree makes 35 N of false shear at 2000 N.

## Equation
True wrench = measured wrench turned by the small rotation vector `a` about the centre of the plate. Coefficients: `a` (rad, world).

## Identifiability
Shear in proportion to the vertical force. A tilt of gravity looks alike on all plates together; in flight only the tilt is seen.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    ["x", "y", "z"].iter().map(|a| Coefficient::within(format!("turn_{a}"), "rad", -0.5, 0.5)).collect()
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    let Target::Plate(plate) = target else { return };
    let (Some(here), Some(centre)) = (f.plates.get(plate), f.scene.plate_centers_m.get(plate)) else { return };
    if f.flight {
        return;
    }
    let about_centre = here.moment_nm - centre.cross(&here.force_n);
    for k in 0..3 {
        out.force_at(i, k, &def::axis(k).cross(&here.force_n), centre);
        out.couple(i, k, &def::axis(k).cross(&about_centre));
    }
}
