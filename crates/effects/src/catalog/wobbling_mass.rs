//! A part of a link's mass that hangs on springs: muscle and fat.

use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::{Columns, LinkFrame, Scene, Series};
use nalgebra::Vector3;
use std::f64::consts::TAU;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "wobbling_mass",
    title: "wobbling mass",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "a mass is not negative; its natural limit, the mass of the link, is itself unknown",
    targets: def::links,
    coefficients,
    nonlinear,
    starts,
    wrench: Some(WrenchLaw::Series(law)),
    inertia: None,
    documentation: "\
## Physics
Soft tissue follows the bone late and rings after take-off and landing. A part of the link's mass hangs on a spring and a damper at the link's centre of mass.

## Equation
Offset x of the mass: `x'' = g - a - 2 z w x' - w2 x`, a the acceleration of the point, w = 2 pi f. Against a rigid link the body feels `-m x''` at the point. \
Coefficient: mass `m` (kg, positive); nonlinear: frequency f (2-20 Hz) and damping ratio z (0.02-1). For w far above the motion this is the quasi-static `-(m/w2) d2(a - g)/dt2`. \
The mass is followed through the stretch from 0.4 s before it, so that it rings on after take-off and landing; it starts there at rest, or in the first frame where nothing before was seen.

## Identifiability
35-55 % visible at best beside the inertial parameters; filter attenuation and soft-tissue artefact live in the same band. Rings of 5-15 Hz that decay after impact are its mark.

## References
Gruber et al., J. Biomech. 31 (1998) 433-444; own simulations.
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::positive("mass", "kg")]
}

fn nonlinear(_: &Scene, _: Target) -> Vec<NonlinearParameter> {
    vec![
        NonlinearParameter::new("frequency", "Hz", 2.0, 20.0, 0.3),
        NonlinearParameter::new("damping_ratio", "1", 0.02, 1.0, 0.05),
    ]
}

fn starts(_: &Scene, _: Target) -> Vec<Vec<f64>> {
    [4.0, 6.0, 8.0, 11.0, 15.0].iter().map(|f| vec![*f, 0.2]).collect()
}

fn law(series: &Series<'_>, target: Target, p: &[f64], out: &mut Columns) {
    let (w, zeta) = (TAU * p[0], p[1]);
    let link = def::link_of(target);
    let com = series.scene.link_com_m[link];
    let g = series.scene.model.gravity_mps2;
    let fall = |links: &[LinkFrame]| g - links[link].point_acceleration(&com);
    for run in series.runs() {
        // from rest in the field of the moment where the past is known farthest back
        let past: Vec<Vector3<f64>> = series.lead_in(run.start).map(fall).collect();
        let first = fall(series.links(run.start));
        let mut mass = Oscillator { x: past.first().unwrap_or(&first) / (w * w), v: Vector3::zeros(), w, zeta };
        for (i, here) in past.iter().enumerate() {
            mass.advance(here, past.get(i + 1).unwrap_or(&first), series.rate_hz);
        }
        for i in run.clone() {
            let here = fall(series.links(i));
            let wobble = here - mass.v * (2.0 * zeta * w) - mass.x * (w * w);
            let point = series.links(i)[link].point(&com);
            out.force_at(i, 0, &-wobble, &point);
            if i + 1 < run.end {
                mass.advance(&here, &fall(series.links(i + 1)), series.rate_hz);
            }
        }
    }
}

/// A damped mass on a spring: offset and its rate.
struct Oscillator {
    x: Vector3<f64>,
    v: Vector3<f64>,
    w: f64,
    zeta: f64,
}

impl Oscillator {
    /// Over one frame in which the driving acceleration goes from `here` to `next`.
    fn advance(&mut self, here: &Vector3<f64>, next: &Vector3<f64>, rate_hz: f64) {
        let steps = 4;
        let h = 1.0 / (rate_hz * f64::from(steps));
        let w2 = self.w * self.w;
        for s in 0..steps {
            // implicit midpoint, stable for every stiffness
            let d = here + (next - here) * ((f64::from(s) + 0.5) / f64::from(steps));
            let gain = 1.0 + h * self.zeta * self.w + 0.25 * h * h * w2;
            let middle = (self.v + (d - self.x * w2) * (0.5 * h)) / gain;
            self.x += middle * h;
            self.v = middle * 2.0 - self.v;
        }
    }
}
