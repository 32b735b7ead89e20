//! A joint centre in the wrong place.

use crate::displacement::{add_columns, carried};
use crate::{About, Coefficient, Columns, Effect, EffectKind, Family, Scene, Series, Target};
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "joint_centre",
    title: "joint centre displaced",
    kind: EffectKind::Artefact,
    family: Family::Kinematics,
    usual_sd: USUAL,
    class: "inertial parameters",
    documentation: "\
## Physics
A joint centre sits some millimetres from where the model has it: the link and all that it carries are seen displaced by a vector fixed in the parent.

## Equation
The link and all that it carries are seen displaced by `e = R_parent d`; the wrench is that of this displacement. Coefficients: `d` (m) in the parent's axes, from where the joint is to where the model has it.

## Identifiability
Only where the inertial parameters are known. Fitted beside them, 90-99.99 % is absorbed: forces hardly show it, and the coefficient of the little that remains says nothing about d. \
Look for it in marker residuals, functional calibration and the identified parameters against the prior.

## References
Harrington et al., J. Biomech. 40 (2007) 595-602; own simulations.
",
    ..About::PLAIN
};

/// Largest error of a joint centre from landmarks or functional calibration, m (hip regression
/// reaches 30 mm): a larger one is another effect in disguise.
const LARGEST_M: f64 = 0.03;

/// Standard deviation in ordinary recordings of a person, m: errors of predicted and of functional
/// hip centres are 5 to 15 mm (Harrington et al. 2007).
const USUAL: f64 = 0.01;

pub(super) struct JointCentre;

impl Effect for JointCentre {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        (1..scene.model.n_links()).map(Target::Link).collect()
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        Coefficient::vector_on_link("offset", "m", LARGEST_M)
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let links = &series.scene.model.links;
        let moved = target.link();
        let Some(parent) = links.get(moved).and_then(|l| l.parent) else { return };
        let carried = carried(&series.scene.model, moved);
        add_columns(series, out, |f, column, l| {
            if carried[l] { f.links[parent].rotation.column(column).into_owned() } else { Vector3::zeros() }
        });
    }
}
