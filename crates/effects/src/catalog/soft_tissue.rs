//! Markers that slide with the skin as a joint turns.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::displacement::add_columns;
use crate::{Columns, EffectFrame, Scene, Series};
use aloft_body::JointKind;
use nalgebra::{Quaternion, Vector3};

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "soft_tissue",
    title: "soft-tissue artefact, linear in joint angles",
    kind: EffectKind::Artefact,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Series(law)),
    inertia: None,
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
};

fn targets(scene: &Scene) -> Vec<Target> {
    (1..scene.model.n_links())
        .filter(|i| matches!(scene.model.links[*i].joint.kind, JointKind::Spherical | JointKind::Revolute(_)))
        .map(Target::Link)
        .collect()
}

fn n_angles(scene: &Scene, target: Target) -> usize {
    match scene.model.links.get(def::link_of(target)).map(|l| l.joint.kind) {
        Some(JointKind::Spherical) => 3,
        _ => 1,
    }
}

fn coefficients(scene: &Scene, target: Target) -> Vec<Coefficient> {
    let n = n_angles(scene, target);
    let mut out = Vec::new();
    for axis in ["x", "y", "z"] {
        for angle in 0..n {
            let name = if n == 1 { format!("slide_{axis}") } else { format!("slide_{axis}_a{}", angle + 1) };
            out.push(Coefficient::within(name, "m/rad", -0.2, 0.2));
        }
    }
    out
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

fn law(series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
    let link = def::link_of(target);
    let n = n_angles(series.scene, target);
    add_columns(series, out, |f, column, l| {
        if l != link {
            return Vector3::zeros();
        }
        f.links[l].rotation.column(column / n) * angle(f, link, column % n)
    });
}
