//! A filter that took acceleration away.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::displacement::rate;
use crate::{Columns, Scene, Series};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "filter_attenuation",
    title: "attenuation by a filter",
    kind: EffectKind::Artefact,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    targets: def::body,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Series(law)),
    inertia: None,
    documentation: "\
## Physics
Recordings that were smoothed (in the laboratory's software or by too low a cut-off) show accelerations that are too small, the more so the faster they change.

## Equation
To first order `a = a_s - k d2(a_s)/dt2`: the inertial wrench W of the model lacks `k d2W/dt2`. Coefficient: `k` (s2, positive), about 1/(2 pi f_c)2 an order of the filter.

## Identifiability
A parabola passes every zero-phase filter unchanged: forces in flight hardly show it, moments do. Wobbling mass and soft-tissue artefact live in the same band (46 % in common). A sweep of the cut-off is the better test.

## References
Winter, Biomechanics and Motor Control of Human Movement (2009), ch. 3; own simulations.
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::positive("lag_squared", "s^2")]
}

fn law(series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
    let scene = series.scene;
    let n_links = scene.model.n_links();
    for run in series.runs() {
        // momentum about a fixed point near the body; two derivatives more than its rate
        let Some(origin) = run.clone().next().map(|i| series.frame(i).com) else { continue };
        let (mut linear, mut angular) = (Vec::with_capacity(run.len()), Vec::with_capacity(run.len()));
        for i in run.clone() {
            let (mut p, mut h) = (Vector3::zeros(), Vector3::zeros());
            for (link, phi) in series.links(i).iter().zip(&scene.phi).take(n_links) {
                let inertia = aloft_body::inertia::inertia_about_origin(phi);
                let mc = link.rotation * aloft_body::inertia::first_moment(phi);
                let arm = link.origin - origin;
                let momentum = link.velocity * phi[0] + link.omega.cross(&mc);
                p += momentum;
                h += arm.cross(&momentum)
                    + mc.cross(&link.velocity)
                    + link.rotation * (inertia * (link.rotation.transpose() * link.omega));
            }
            linear.push(p);
            angular.push(h);
        }
        let third = |x: &[Vector3<f64>]| {
            let hz = series.rate_hz;
            rate(&rate(&rate(x, hz), hz), hz)
        };
        let (force, moment) = (third(&linear), third(&angular));
        for (i, at) in run.enumerate() {
            out.add(at, 0, &force[i], &(moment[i] + origin.cross(&force[i])));
        }
    }
}
