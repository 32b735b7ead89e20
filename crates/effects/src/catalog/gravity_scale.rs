//! Gravity of another magnitude, or clock or ruler of another scale.

use crate::{About, Coefficient, Columns, Effect, EffectKind, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "gravity_scale",
    title: "magnitude of gravity, frame rate or length scale",
    kind: EffectKind::Artefact,
    class: "frame rate, length scale, buoyancy",
    separated_by: Separation::KnownFall,
    shows_in_free_fall: true,
    documentation: "\
## Physics
The free fall in the recordings is not the stated gravity: another latitude, a wrong frame rate in the header, a wand of another length, buoyancy.

## Equation
`F = s M g` at the centre of mass. Coefficient: `s`, the relative excess of gravity; a frame rate that is truly higher by x than stated shows as s = -2 x, \
lengths stated too long by y as s = +y.

## Identifiability
Visible to 91-99 % beside the inertial parameters. Magnitude of gravity, frame rate, length scale and buoyancy are exact aliases in flight: motion fixes only g T2 / L. \
Plate weight, a calibrated wand, a clock pulse or a dropped ball separate them. Added mass is close to it.

## References
Own arithmetic and simulations (`cargo test -p aloft-effects`, `docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct GravityScale;

impl Effect for GravityScale {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        Target::body()
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::within("gravity_excess", "1", -0.6, 0.6)]
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants() {
            out.force_at(i, 0, &(f.scene.model.gravity_mps2 * f.scene.mass_kg), &f.com);
        }
    }
}
