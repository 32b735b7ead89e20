//! Markers that slide with the skin as a joint turns.

use crate::displacement::add_columns;
use crate::unknown::AXES;
use crate::{About, Coefficient, Columns, Effect, EffectFrame, EffectKind, Family, Scene, Separation, Series, Target};
use aloft_body::JointKind;
use nalgebra::{Quaternion, Vector3};

const ABOUT: About<'static> = About {
    id: "soft_tissue",
    title: "soft-tissue artefact, linear in joint angles",
    kind: EffectKind::Artefact,
    family: Family::Kinematics,
    separated_by: Separation::Impacts,
    usual_sd: USUAL,
    documentation: "\
## Physics
Skin and muscle move over the bone as a joint turns, and the markers with them: the link is seen displaced by an amount that follows the joint's angles. Thigh and shank: 10-20 mm.

## Equation
All markers of the link slide by `e = R B a`, a the rotation vector of its joint (rad; one angle for a hinge), B constant, R from link to world axes. The wrench is that of a link whose mass is displaced by e (first order). \
Coefficients: the entries of `B` in m/rad, `slide_x_a3` for the slide along the link's x axis with the third component of the rotation vector.

## Identifiability
Repeats from trial to trial like a force does, at the frequency of the motion itself. The marker residuals' pattern against joint angles is the better evidence; wobbling mass and joint-centre errors are close.

## References
Leardini et al., Gait & Posture 21 (2005) 212-225; Camomilla et al., J. Biomech. 62 (2017).
",
    ..About::PLAIN
};

/// Standard deviation of the slide in ordinary recordings, m/rad: 10 to 20 mm on thigh and shank
/// over the range of a joint in locomotion and jumps, 1 to 1.5 rad (Leardini et al. 2005).
const USUAL: f64 = 0.01;

/// Largest plausible slide, m/rad.
const MOST: f64 = 0.2;

pub(super) struct SoftTissue;

impl Effect for SoftTissue {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    /// Links with a hinge or a ball joint.
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        (1..scene.model.n_links())
            .filter(|i| matches!(scene.model.links[*i].joint.kind, JointKind::Spherical | JointKind::Revolute(_)))
            .map(Target::Link)
            .collect()
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let n = n_angles(scene, target);
        if n == 1 {
            return Coefficient::vector_on_link("slide", "m/rad", MOST);
        }
        // entries of a matrix have no direction
        let entry = |axis: &str, a: usize| Coefficient::within(format!("slide_{axis}_a{a}"), "m/rad", -MOST, MOST);
        AXES.iter().flat_map(|axis| (1..=n).map(move |a| entry(axis, a))).collect()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let link = target.link();
        let n = n_angles(series.scene, target);
        add_columns(series, out, |f, column, l| {
            if l != link {
                return Vector3::zeros();
            }
            f.links[l].rotation.column(column / n) * angle(f, link, column % n)
        });
    }
}

/// Angles on which the slide depends: three of a ball joint, one of a hinge.
fn n_angles(scene: &Scene, target: Target) -> usize {
    match scene.model.links.get(target.link()).map(|l| l.joint.kind) {
        Some(JointKind::Spherical) => 3,
        _ => 1,
    }
}

/// Angle (or component of the rotation vector) of a link's joint.
fn angle(f: &EffectFrame<'_>, link: usize, k: usize) -> f64 {
    let joint = &f.scene.model.links[link].joint;
    let at = joint.q_offset;
    match joint.kind {
        JointKind::Spherical => {
            let q = Quaternion::new(f.q[at + 3], f.q[at], f.q[at + 1], f.q[at + 2]);
            let near = if q.w < 0.0 { -q } else { q };
            aloft_body::rotation::quaternion_log(&near)[k]
        }
        _ => f.q[at],
    }
}
