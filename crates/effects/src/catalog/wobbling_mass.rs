//! A part of a link's mass that hangs on springs: muscle and fat.

use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::{Columns, Scene, Series};
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
Each stretch starts with the offset at rest in the field of the moment; in flight its free ringing from the stretch before is carried on where frames are contiguous.

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
    for run in series.runs() {
        let drive = |i: usize| g - series.links(i)[link].point_acceleration(&com);
        // hangs at rest in the first frame's field; in flight that field is nearly none
        let mut x: Vector3<f64> = drive(run.start) / (w * w);
        let mut v = Vector3::<f64>::zeros();
        let steps = 4;
        let h = 1.0 / (series.rate_hz * steps as f64);
        for i in run.clone() {
            let here = drive(i);
            let wobble = here - v * (2.0 * zeta * w) - x * (w * w);
            let point = series.links(i)[link].point(&com);
            out.force_at(i, 0, &-wobble, &point);
            if i + 1 < run.end {
                let next = drive(i + 1);
                for s in 0..steps {
                    // implicit midpoint, stable for every stiffness
                    let d = here + (next - here) * ((s as f64 + 0.5) / steps as f64);
                    let gain = 1.0 + h * zeta * w + 0.25 * h * h * w * w;
                    let middle = (v + (d - x * (w * w)) * (0.5 * h)) / gain;
                    x += middle * h;
                    v = middle * 2.0 - v;
                }
            }
        }
    }
}
