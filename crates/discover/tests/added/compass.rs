//! A magnet in a link, turned by the magnetic field of the room: an effect as a new contributor
//! would add it, in one file.

use aloft_effects::{About, Coefficient, Columns, Effect, Scene, Separation, Series, Target};
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "compass",
    title: "magnet in the field of the room",
    separated_by: Separation::TurnedLaboratory,
    told_from: &[("flywheel", "the same motion with the magnet taken out")],
    unbounded: "the magnetic moment is unknown",
    documentation: "\
## Physics
A magnet along the z axis of a link turns into the direction of a uniform field, as the needle of a compass does; no force comes with it.

## Equation
`N = (R z) x b`, b the field times the moment of the magnet. Coefficients: `b` in world axes, N m.

## Identifiability
A moment that follows the orientation of the link, not its angular velocity. Its direction stays in the room.

## References
Jackson, Classical Electrodynamics (1999), s. 5.7.
",
    ..About::PLAIN
};

/// The effect.
pub struct Compass;

impl Effect for Compass {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        Coefficient::vector_in_world("torque", "N*m", f64::INFINITY)
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants() {
            let needle: Vector3<f64> = f.links[target.link()].rotation.column(2).into_owned();
            for k in 0..3 {
                out.couple(i, k, &needle.cross(&Vector3::ith(k, 1.0)));
            }
        }
    }
}
