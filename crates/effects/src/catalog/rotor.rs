//! A wheel whose speed swings.

use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::{Columns, EffectFrame, Scene};
use nalgebra::Vector3;
use std::f64::consts::TAU;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "rotor",
    title: "rotor of changing speed",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &["flywheel"],
    by_group: false,
    unbounded: "a wheel turns either way, at any rate",
    targets: def::links,
    coefficients,
    nonlinear,
    starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A motor turns a rotor inside a link faster and slower: beside the flywheel's moment across the angular velocity the link feels the reaction to the change of spin, even when it does not turn.

## Equation
`N = -w x (R h) - R dh/dt` with `h = h0 + hs sin(2 pi f t) + hc cos(2 pi f t)`, t since the start of the recording. Coefficients: h0, hs, hc in link axes, N m s; nonlinear: f, 0.2-12 Hz.

## Identifiability
Contains the flywheel. The swing shows as a moment of one frequency in the link's axes; stable over trials only if the rotor starts with the recording.

## References
Hughes, Spacecraft Attitude Dynamics (1986), ch. 3; own simulations.
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    ["momentum", "swing_sin", "swing_cos"].iter().flat_map(|p| Coefficient::vector(p, "N*m*s")).collect()
}

fn nonlinear(_: &Scene, _: Target) -> Vec<NonlinearParameter> {
    vec![NonlinearParameter::new("frequency", "Hz", 0.2, 12.0, 0.02)]
}

fn starts(_: &Scene, _: Target) -> Vec<Vec<f64>> {
    // the clock runs through a whole recording, so neighbours a twentieth of a hertz apart are already out of step
    (0..140).map(|k| vec![0.3 + 0.04 * f64::from(k)]).collect()
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    let link = &f.links[def::link_of(target)];
    let rate = TAU * p[0];
    let (sin, cos) = (rate * f.time_s).sin_cos();
    for k in 0..3 {
        let axis: Vector3<f64> = link.rotation.column(k).into_owned();
        let across = -link.omega.cross(&axis);
        out.couple(i, k, &across);
        out.couple(i, 3 + k, &(across * sin - axis * (rate * cos)));
        out.couple(i, 6 + k, &(across * cos + axis * (rate * sin)));
    }
}
