//! Flights that begin before the last contact ended, or end after the first began.

use crate::columns::axis;
use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Series, Target};

const ABOUT: About<'static> = About {
    id: "residual_contact",
    title: "contact left over at the edges of flights",
    kind: EffectKind::Artefact,
    acts: ActsIn::Flight,
    family: Family::Kinematics,
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
    ..About::PLAIN
};

/// Time over which the load decays from the edge of a flight, s.
const REACH_S: f64 = 0.04;
/// First columns of the forces at the two edges.
const START: usize = 0;
const END: usize = 3;

pub(super) struct ResidualContact;

impl Effect for ResidualContact {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    /// Links without children.
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        let links = &scene.model.links;
        (0..links.len()).filter(|i| links.iter().all(|l| l.parent != Some(*i))).map(Target::Link).collect()
    }
    fn coefficients(&self, scene: &Scene, _: Target) -> Vec<Coefficient> {
        // landings load a foot with several body weights within this time
        let most = 10.0 * scene.mass_kg * scene.gravity();
        let mut out = Coefficient::vector_in_world("start_force", "N", most);
        out.extend(Coefficient::vector_in_world("end_force", "N", most));
        out
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let link = target.link();
        for (i, f) in series.instants().filter(|(_, f)| f.flight) {
            let point = f.links[link].point(&f.scene.link_com_m[link]);
            for (first, from_edge_s) in [(START, f.since_start_s), (END, f.to_end_s)] {
                let share = 1.0 - from_edge_s / REACH_S;
                if share > 0.0 {
                    for k in 0..3 {
                        out.force_at(i, first + k, &(axis(k) * share), &point);
                    }
                }
            }
        }
    }
}
