//! A part of a link's mass that hangs on springs: muscle and fat.

use crate::{
    About, Coefficient, Columns, Effect, LinkFrame, NonlinearParameter, Scene, Separation, Series, Target, Values,
};
use nalgebra::Vector3;
use std::f64::consts::TAU;

const ABOUT: About<'static> = About {
    id: "wobbling_mass",
    title: "wobbling mass",
    separated_by: Separation::Impacts,
    accompanying: &["hanging", "turning"],
    documentation: "\
## Physics
Soft tissue follows the bone late and rings after take-off and landing. A part of the link's mass hangs on a spring and a damper at a point of the link.

## Equation
Offset x of the mass: `x'' = g - a - 2 z w (x' - omega x x) - w2 x`, a the acceleration of the point, omega the angular velocity of the link, w = 2 pi f. Against a rigid link the body feels `-m x''` at the point. \
Coefficients (kg; none larger than the mass of the body): mass `m` (positive), driven through the 0.4 s that lead up to the stretch, or from no offset where none were recorded; `hanging`, which hung at rest in gravity when the stretch began and rings freely from there \
(m for a body let go at rest, more after a take-off); `turning`, the same for an offset at rest in the first frame's field (m for a body that had long been turning). \
Nonlinear: frequency f (2-20 Hz), damping ratio z (0.02-1), the point p within 0.3 m of the link's centre of mass (on a longer link up to its ends). For w far above the motion the first is the quasi-static `-(m/w2) d2(a - g)/dt2`.

## Identifiability
Differentiation blurs the moment of release, so that the mass is found 10-20 % too large. 35-55 % visible at best beside the inertial parameters; filter attenuation and soft-tissue artefact occupy the same frequency band. Rings of 5-15 Hz that decay after impact are characteristic.

## References
Gruber et al., J. Biomech. 31 (1998) 433-444; own simulations.
",
    ..About::PLAIN
};

/// Column indices.
const MASS: usize = 0;
const HANGING: usize = 1;
const TURNING: usize = 2;

pub(super) struct WobblingMass;

impl Effect for WobblingMass {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, scene: &Scene, _: Target) -> Vec<Coefficient> {
        // no more than the body can wobble; what hung before may ring in either sense
        let most = scene.mass_kg;
        vec![
            Coefficient::within("mass", "kg", 0.0, most),
            Coefficient::within("hanging", "kg", -most, most),
            Coefficient::within("turning", "kg", -most, most),
        ]
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        let mut out = vec![
            NonlinearParameter::new("frequency", "Hz", 2.0, 20.0, 0.3),
            NonlinearParameter::new("damping_ratio", "1", 0.02, 1.0, 0.05),
        ];
        out.extend(NonlinearParameter::point_of(scene, target));
        out
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        let point = scene.com_of(target);
        [4.0, 6.0, 8.0, 11.0, 15.0].iter().map(|f| [&[*f, 0.2], point.as_slice()].concat()).collect()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let mut values = Values::new(nonlinear);
        let (frequency_hz, damping_ratio, place_m) = (values.scalar(), values.scalar(), values.vector());
        let (w, zeta) = (TAU * frequency_hz, damping_ratio);
        let link = target.link();
        let g = series.scene.model.gravity_mps2;
        let fall = |links: &[LinkFrame]| g - links[link].point_acceleration(&place_m);
        let omega = |links: &[LinkFrame]| links[link].omega;
        for run in series.runs() {
            let here = series.links(run.start);
            let none = Vector3::zeros();
            let mass = |x| Oscillator { x, v: none, w, zeta };
            // starts at zero offset if nothing is known of the time before, otherwise driven
            // through the frames before the stretch
            let past: Vec<(Vector3<f64>, Vector3<f64>)> =
                series.lead_in(run.start).map(|l| (fall(l), omega(l))).collect();
            let first = (fall(here), omega(here));
            let mut driven = mass(past.first().map_or(none, |oldest| oldest.0 / (w * w)));
            for (i, (field, turn)) in past.iter().enumerate() {
                driven.advance(field, &past.get(i + 1).unwrap_or(&first).0, turn, series.rate_hz);
            }
            // released from equilibrium under gravity, and from equilibrium in the first field
            let (mut hung, mut turned) = (mass(g / (w * w)), mass(first.0 / (w * w)));
            for i in run.clone() {
                let (field, turn) = (fall(series.links(i)), omega(series.links(i)));
                let point = series.links(i)[link].point(&place_m);
                out.force_at(i, MASS, &-driven.acceleration(&field, &turn), &point);
                out.force_at(i, HANGING, &-hung.acceleration(&none, &turn), &point);
                out.force_at(i, TURNING, &-turned.acceleration(&none, &turn), &point);
                if i + 1 < run.end {
                    driven.advance(&field, &fall(series.links(i + 1)), &turn, series.rate_hz);
                    hung.advance(&none, &none, &turn, series.rate_hz);
                    turned.advance(&none, &none, &turn, series.rate_hz);
                }
            }
        }
    }
}

/// A mass on a spring and a damper that rotate with the link: offset and its rate, both in the
/// world.
struct Oscillator {
    x: Vector3<f64>,
    v: Vector3<f64>,
    w: f64,
    zeta: f64,
}

impl Oscillator {
    /// `x''` in a field, with the link rotating at `omega`.
    fn acceleration(&self, field: &Vector3<f64>, omega: &Vector3<f64>) -> Vector3<f64> {
        field - (self.v - omega.cross(&self.x)) * (2.0 * self.zeta * self.w) - self.x * (self.w * self.w)
    }

    /// Advances by one frame, in which the field changes from `here` to `next`.
    fn advance(&mut self, here: &Vector3<f64>, next: &Vector3<f64>, omega: &Vector3<f64>, rate_hz: f64) {
        let steps = 4;
        let h = 1.0 / (rate_hz * f64::from(steps));
        let w2 = self.w * self.w;
        // implicit midpoint, stable for every stiffness
        let gain = 1.0 + h * self.zeta * self.w + 0.25 * h * h * w2;
        for s in 0..steps {
            let field = here + (next - here) * ((f64::from(s) + 0.5) / f64::from(steps));
            let carried = omega.cross(&self.x) * (2.0 * self.zeta * self.w);
            let middle = (self.v + (field + carried - self.x * w2) * (0.5 * h)) / gain;
            self.x += middle * h;
            self.v = middle * 2.0 - self.v;
        }
    }
}
