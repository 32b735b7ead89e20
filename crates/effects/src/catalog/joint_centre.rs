//! A joint centre in the wrong place.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::displacement::add_columns;
use crate::{Columns, Scene, Series};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "joint_centre",
    title: "joint centre displaced",
    kind: EffectKind::Artefact,
    acts: ActsIn::Both,
    class: "inertial parameters",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Series(law)),
    inertia: None,
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
};

fn targets(scene: &Scene) -> Vec<Target> {
    (1..scene.model.n_links()).map(Target::Link).collect()
}

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    ["x", "y", "z"].iter().map(|a| Coefficient::within(format!("offset_{a}"), "m", -0.1, 0.1)).collect()
}

fn law(series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
    let links = &series.scene.model.links;
    let moved = def::link_of(target);
    let Some(parent) = links.get(moved).and_then(|l| l.parent) else { return };
    let carried: Vec<bool> = (0..links.len())
        .map(|i| {
            let mut at = Some(i);
            while let Some(k) = at {
                if k == moved {
                    return true;
                }
                at = links[k].parent;
            }
            false
        })
        .collect();
    add_columns(series, out, |f, column, l| {
        if carried[l] { f.links[parent].rotation.column(column).into_owned() } else { Vector3::zeros() }
    });
}
