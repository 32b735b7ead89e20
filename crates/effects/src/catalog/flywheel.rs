//! A wheel that spins at constant speed inside a link.

use crate::{About, Coefficient, Columns, Effect, Scene, Separation, Series, Target};

const ABOUT: About<'static> = About {
    id: "flywheel",
    title: "flywheel of constant momentum",
    separated_by: Separation::BothSenses,
    unbounded: "a wheel turns either way, at any rate",
    documentation: "\
## Physics
A wheel spins at constant speed about an axis fixed in a link. Turning the link turns its momentum, and the reaction acts on the link: a moment across the angular velocity that does no work.

## Equation
`N = -w x (R h)`, R and w rotation and angular velocity of the link. Coefficients: the momentum `h` in link axes, N m s.

## Identifiability
30-55 % is taken by errors of products of inertia. It is linear in w and changes sign with it: turning in both senses about several axes separates it. Links that turn alike cannot be told apart.

## References
Hughes, Spacecraft Attitude Dynamics (1986), ch. 3; own simulations.
",
    ..About::PLAIN
};

pub(super) struct Flywheel;

impl Effect for Flywheel {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        Coefficient::vector_on_link("momentum", "N*m*s", f64::INFINITY)
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants() {
            let link = &f.links[target.link()];
            for k in 0..3 {
                out.couple(i, k, &-link.omega.cross(&link.rotation.column(k).into_owned()));
            }
        }
    }
}
