//! A wheel whose speed swings.

use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};
use nalgebra::Vector3;
use std::f64::consts::TAU;

const ABOUT: About<'static> = About {
    id: "rotor",
    title: "rotor of changing speed",
    contains: &["flywheel"],
    separated_by: Separation::BothSenses,
    unbounded: "a wheel turns either way, at any rate",
    documentation: "\
## Physics
A motor turns a rotor inside a link faster and slower: beside the flywheel's moment across the angular velocity the reaction to the change of spin acts on the link, even when the link does not turn.

## Equation
`N = -w x (R h) - R dh/dt` with `h = h0 + hs sin(2 pi f t) + hc cos(2 pi f t)`, t since the start of the recording. Coefficients: h0, hs, hc in link axes, N m s; nonlinear: f, 0.2-12 Hz.

## Identifiability
Contains the flywheel. The swing shows as a moment of one frequency in the link's axes; stable over trials only if the rotor starts with the recording.

## References
Hughes, Spacecraft Attitude Dynamics (1986), ch. 3; own simulations.
",
    ..About::PLAIN
};

/// First columns of the constant momentum and of the two parts of its oscillation.
const MOMENTUM: usize = 0;
const SWING_SIN: usize = 3;
const SWING_COS: usize = 6;

pub(super) struct Rotor;

impl Effect for Rotor {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        ["momentum", "swing_sin", "swing_cos"]
            .iter()
            .flat_map(|p| Coefficient::vector_on_link(p, "N*m*s", f64::INFINITY))
            .collect()
    }
    fn nonlinear(&self, _: &Scene, _: Target) -> Vec<NonlinearParameter> {
        vec![NonlinearParameter::new("frequency", "Hz", 0.2, 12.0, 0.02)]
    }
    fn starts(&self, _: &Scene, _: Target) -> Vec<Vec<f64>> {
        // the phase accumulates over the whole recording, so frequencies a twentieth of a hertz
        // apart are already out of phase
        (0..140).map(|k| vec![0.3 + 0.04 * f64::from(k)]).collect()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let frequency_hz = Values::new(nonlinear).scalar();
        let rate = TAU * frequency_hz;
        for (i, f) in series.instants() {
            let link = &f.links[target.link()];
            let (sin, cos) = (rate * f.time_s).sin_cos();
            for k in 0..3 {
                let axis: Vector3<f64> = link.rotation.column(k).into_owned();
                let across = -link.omega.cross(&axis);
                out.couple(i, MOMENTUM + k, &across);
                out.couple(i, SWING_SIN + k, &(across * sin - axis * (rate * cos)));
                out.couple(i, SWING_COS + k, &(across * cos + axis * (rate * sin)));
            }
        }
    }
}
