//! A filter that took acceleration away.

use crate::displacement::{add_columns, add_turns};
use crate::{About, Coefficient, Columns, Effect, EffectFrame, EffectKind, Family, Scene, Separation, Series, Target};
use aloft_body::JointKind;
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "filter_attenuation",
    title: "attenuation by a filter",
    kind: EffectKind::Artefact,
    family: Family::Kinematics,
    usual_sd: USUAL,
    separated_by: Separation::Impacts,
    unbounded: "a filter takes acceleration away and adds none; how much follows from its cut-off, which is unknown",
    documentation: "\
## Physics
Recordings that were smoothed before (in the laboratory's software, or with too low a cut-off) show accelerations that are too small, the more so the faster they change.

## Equation
To first order a smoothed place is `x_s = x + k x''`, k half the variance of the filter's window in time: `T2/24` for a mean over T, `s2/2` for a Gaussian of standard deviation s. \
Links are seen turned by `k alpha`, as far as their joints let them, and the whole centre of mass is seen displaced by `k a`; the wrench is that of this displacement and turn. \
Coefficient: `k` (s2, positive). A Butterworth filter errs by `(f/f_c)4` instead: there k is the value that fits best over the band of the motion, well below `1/(2 pi f_c)2`.

## Identifiability
On plates it shows as a part of the load in proportion to its second derivative. In the air it hardly shows: a parabola passes every zero-phase filter unchanged, and of the moments little remains \
beside the inertial parameters. Wobbling mass and soft-tissue artefact occupy the same frequency band (46 % in common). A sweep of the cut-off is the better test.

## References
Winter, Biomechanics and Motor Control of Human Movement (2009), ch. 3; own simulations.
",
    ..About::PLAIN
};

/// Standard deviation in ordinary recordings, s²: a low-pass filter of 16 Hz, `1/(2 pi f_c)²`.
const USUAL: f64 = 1e-4;

pub(super) struct FilterAttenuation;

impl Effect for FilterAttenuation {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        Target::body()
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::positive("lag_squared", "s^2")]
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        let n = series.scene.model.n_links();
        // for every frame: apparent rotations of the links and apparent displacements of their
        // centres of mass, per unit
        let mut turns = Vec::with_capacity(series.len() * n);
        let mut shifts = Vec::with_capacity(series.len() * n);
        for i in 0..series.len() {
            apparent_displacements(&series.frame(i), &mut turns, &mut shifts);
        }
        let at = |f: &EffectFrame<'_>, link: usize| series.index_of(f.frame).map(|i| i * n + link);
        let of = |all: &[Vector3<f64>], f: &EffectFrame<'_>, link| at(f, link).map_or_else(Vector3::zeros, |k| all[k]);
        add_columns(series, out, |f, _, link| of(&shifts, f, link));
        add_turns(series, 0, out, |f, link| of(&turns, f, link));
    }
}

/// Rotations proportional to the angular acceleration, as far as the joints permit; displacements
/// of a skeleton with constant lengths, whose total centre of mass moves in proportion to its
/// acceleration.
fn apparent_displacements(f: &EffectFrame<'_>, turns: &mut Vec<Vector3<f64>>, shifts: &mut Vec<Vector3<f64>>) {
    let scene = f.scene;
    let first = turns.len();
    let mut origins: Vec<Vector3<f64>> = Vec::with_capacity(f.links.len());
    let mut mean = Vector3::zeros();
    for (link, here) in scene.model.links.iter().zip(f.links) {
        let (mut turn, mut origin) = (here.alpha, Vector3::zeros());
        if let Some(parent) = link.parent {
            let carried = turns[first + parent];
            let free = here.alpha - carried;
            turn = carried
                + match link.joint.kind {
                    JointKind::Free | JointKind::Spherical => free,
                    JointKind::Revolute(axis) => {
                        let axis = here.rotation * axis.into_inner();
                        axis * axis.dot(&free)
                    }
                    _ => Vector3::zeros(),
                };
            origin = origins[parent] + carried.cross(&(here.origin - f.links[parent].origin));
        }
        let i = origins.len();
        let shift = origin + turn.cross(&(here.rotation * scene.link_com_m[i]));
        mean += shift * (scene.phi[i][0] / scene.mass_kg);
        origins.push(origin);
        turns.push(turn);
        shifts.push(shift);
    }
    for shift in &mut shifts[first..] {
        *shift += f.com_acceleration - mean;
    }
}
