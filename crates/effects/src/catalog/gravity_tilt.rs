//! Gravity that does not point along the room's vertical.

use crate::columns::axis;
use crate::{About, Coefficient, Columns, Effect, EffectKind, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "gravity_tilt",
    title: "gravity tilted (capture volume not level)",
    kind: EffectKind::Artefact,
    class: "steady wind, constant force near the centre of mass",
    separated_by: Separation::TurnedLaboratory,
    shows_in_free_fall: true,
    documentation: "\
## Physics
The calibration frame of the cameras was not level, so gravity has horizontal components in the capture frame: every flight drifts to the same side.

## Equation
`F = M (dg_x, dg_y, 0)` at the centre of mass. Coefficients: `dg_x`, `dg_y` in m/s2; one degree is 0.171 m/s2.

## Identifiability
Visible to 95 % beside the inertial parameters. A steady wind and a constant force near the centre of mass are exact aliases in flight. Plates that are level, or a plumb line, separate them.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct GravityTilt;

impl Effect for GravityTilt {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        Target::body()
    }
    fn coefficients(&self, scene: &Scene, _: Target) -> Vec<Coefficient> {
        // the vertical component belongs to gravity's magnitude
        Coefficient::vector_in_world("dg", "m/s^2", 0.2 * scene.gravity()).into_iter().take(2).collect()
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants() {
            for k in 0..2 {
                out.force_at(i, k, &(axis(k) * f.scene.mass_kg), &f.com);
            }
        }
    }
}
