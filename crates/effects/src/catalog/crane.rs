//! A line of constant tension over a pulley: body-weight support.

use super::tether::anchors;
use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};

const ABOUT: About<'static> = About {
    id: "crane",
    other_ids: &["body_weight_support"],
    title: "body-weight support of constant tension (rope over a pulley)",
    becomes: &["constant_force"],
    separated_by: Separation::OtherPlaces,
    unbounded: "a rope pulls and never pushes; its tension follows from the counterweight",
    documentation: "\
## Physics
A harness hangs on a rope that a counterweight or a motor keeps at constant tension; the rope runs over a pulley in the room.

## Equation
`F = T u`, u the direction from the point of the link to the pulley. Coefficient: tension `T` (N, positive). Nonlinear: pulley (m), attachment within 0.3 m of the link's centre of mass (on a longer link up to its ends).

## Identifiability
A distant pulley makes it a constant force (overhead: close to a change of gravity's magnitude). Moving sideways under the pulley turns the force and separates them.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct Crane;

impl Effect for Crane {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::positive("tension", "N")]
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        let mut out = NonlinearParameter::point_in_world("pulley", &scene.volume_centre_m, 8.0);
        out.extend(NonlinearParameter::point_of(scene, target));
        out
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        let attachment = scene.com_of(target);
        anchors(scene).iter().map(|pulley| [pulley.as_slice(), attachment.as_slice()].concat()).collect()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let mut values = Values::new(nonlinear);
        let (pulley_m, attachment_m) = (values.vector(), values.vector());
        for (i, f) in series.instants() {
            let at = f.links[target.link()].point(&attachment_m);
            let line = pulley_m - at;
            out.force_at(i, 0, &(line / line.norm().max(1e-9)), &at);
        }
    }
}
