//! Markers on soft tissue that swings farther than the bone.

use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "marker_overshoot",
    title: "markers that overshoot the bone",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Kinematics,
    usual_sd: USUAL,
    separated_by: Separation::Impacts,
    documentation: "\
## Physics
Markers ride on skin, fat and clothes. Where the motion changes fast, as after touch-down, they swing farther than the bone under them, and the force computed from the motion is larger than that on the plates.

## Equation
With `x_bone = x_marker + c x_marker''` for all markers, the wrench that the motion shows is, to first order, `W - c W''`, W the measured wrench of all plates. Coefficient: `c` (s2, 0 to 0.002); a tissue that follows the bone like a spring has `c = 1/(2 pi f)2`.

## Identifiability
Only the plates show it. The second derivative of the motion's own forces must not stand in the place of `W''`: in flight it is the second derivative of the residual itself, so that some `c > 0` lowers every residual, whatever caused it, and in contact the noise of the motion does the same. \
A delay of the plates by tau leaves `tau2/2 W''`, of the opposite sign; `filter_attenuation` has the opposite sign, too, and wobbling masses occupy the same frequencies. Overshoot of single links is not told apart. Not for bodies without limbs: markers on rigid objects have no soft tissue.

## References
Pain and Challis, J. Biomech. 39 (2006) 119-124; Leardini et al., Gait & Posture 21 (2005) 212-225; own computation (`docs/findings/real_drop_jump.md`).
",
    ..About::PLAIN
};

/// Largest overshoot, s²: that of a tissue of 3.6 Hz.
const MOST_S2: f64 = 0.002;

/// Standard deviation in ordinary recordings of a person, s²: a tissue of 20 Hz, `1/(2 pi f)²`.
const USUAL: f64 = 6e-5;

pub(super) struct MarkerOvershoot;

impl Effect for MarkerOvershoot {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    /// Bodies with limbs whose motion comes from markers, on plates.
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        let links = &scene.model.links;
        let carried = |i: usize| links.iter().filter(|l| l.parent == Some(i)).count();
        let limbs = (0..links.len()).any(|i| carried(i) > 1);
        if limbs && scene.model.joint_names.is_empty() && scene.n_plates() > 0 { Target::body() } else { Vec::new() }
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::within("overshoot", "s^2", 0.0, MOST_S2)]
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        for run in series.runs().into_iter().filter(|run| !series.frame(run.start).flight) {
            let sum = |of: fn(&crate::PlateFrame) -> Vector3<f64>| -> Vec<Vector3<f64>> {
                let all = run.clone().map(|i| series.frame(i).plates.iter().map(of).sum());
                second_rate(&all.collect::<Vec<_>>(), series.rate_hz)
            };
            let (forces, moments) = (sum(|p| p.force_n), sum(|p| p.moment_nm));
            for (i, (force, moment)) in run.clone().zip(forces.iter().zip(&moments)) {
                out.add(i, 0, &-force, &-moment);
            }
        }
    }
}

/// Second derivative of a sampled vector in a run by local parabolas over ±20 ms (five samples at
/// 100 Hz): it passes 90 % at 8 Hz.
fn second_rate(values: &[Vector3<f64>], rate_hz: f64) -> Vec<Vector3<f64>> {
    const REACH_S: f64 = 0.02;
    let n = values.len();
    if n < 3 {
        return vec![Vector3::zeros(); n];
    }
    let reach = ((REACH_S * rate_hz).round() as usize).clamp(1, (n - 1) / 2);
    let square = |k: usize| (k as f64 - reach as f64).powi(2);
    let mean = (0..=2 * reach).map(square).sum::<f64>() / (2 * reach + 1) as f64;
    let size: f64 = (0..=2 * reach).map(|k| (square(k) - mean).powi(2)).sum();
    let at = |i: usize| {
        let first = i.clamp(reach, n - 1 - reach) - reach;
        let sum: Vector3<f64> = (0..=2 * reach).map(|k| values[first + k] * (square(k) - mean)).sum();
        sum * (2.0 * rate_hz * rate_hz / size)
    };
    (0..n).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_has_its_second_derivative_up_to_the_ends() {
        for (n, rate_hz) in [(3, 100.0), (4, 100.0), (30, 100.0), (200, 1000.0)] {
            let x: Vec<Vector3<f64>> = (0..n).map(|i| Vector3::new(1.0, i as f64, (i * i) as f64)).collect();
            for second in second_rate(&x, rate_hz) {
                assert!((second / (rate_hz * rate_hz) - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-9, "{n} {second:?}");
            }
        }
        assert_eq!(second_rate(&[Vector3::x(); 2], 100.0), [Vector3::zeros(); 2]);
    }
}
