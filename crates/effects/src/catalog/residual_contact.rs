//! Flights that begin before the last contact ended, or end after the first began.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "residual_contact",
    title: "contact left over at the edges of flights",
    kind: EffectKind::Artefact,
    acts: ActsIn::Flight,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A toe still touches the floor, or a hand the object, in the first or last frames of what is taken for a flight.

## Equation
A world force at an outermost link's centre of mass that decays linearly over 40 ms from the edge. Coefficients: forces (N) at the start and at the end of flights.

## Identifiability
Only the edges show it, and windows of 0.1 s rather than the usual ones: weak rows hardly see edges at all. With both feet down the load is found, its line of action is not. Shorter flights (larger margins) that change the result are the better test.

## References
Own simulations (`docs/findings/labs.md`).
",
};

const REACH_S: f64 = 0.04;

/// Links that carry no others.
fn targets(scene: &Scene) -> Vec<Target> {
    let links = &scene.model.links;
    (0..links.len()).filter(|i| links.iter().all(|l| l.parent != Some(*i))).map(Target::Link).collect()
}

fn coefficients(scene: &Scene, _: Target) -> Vec<Coefficient> {
    // landings load a foot with several body weights within the reach
    let most = 10.0 * scene.mass_kg * scene.gravity();
    let within = |p: &str, a: &str| Coefficient::within(format!("{p}_{a}"), "N", -most, most);
    ["start_force", "end_force"].iter().flat_map(|p| ["x", "y", "z"].map(|a| within(p, a))).collect()
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    if !f.flight {
        return;
    }
    let index = def::link_of(target);
    let point = f.links[index].point(&f.scene.link_com_m[index]);
    for (first, since) in [(0, f.since_start_s), (3, f.to_end_s)] {
        let share = 1.0 - since / REACH_S;
        if share > 0.0 {
            for k in 0..3 {
                out.force_at(i, first + k, &(def::axis(k) * share), &point);
            }
        }
    }
}
