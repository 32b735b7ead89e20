//! An encoder whose zero is wrong.

use crate::displacement::{add_columns, add_turns, carried};
use crate::{About, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};
use aloft_body::JointKind;
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "encoder_offset",
    title: "encoder with a wrong zero",
    kind: EffectKind::Artefact,
    family: Family::Kinematics,
    separated_by: Separation::OtherPlaces,
    documentation: "\
## Physics
The encoder of a robot's joint reads a constant too much: the joint was calibrated in another posture, or its flange was mounted a tooth further. The link and all that it carries are seen turned about the joint (moved along it, where it slides).

## Equation
A hinge: the links beyond it are seen displaced by `e = a x (c - o)` and turned by `a`, with the joint's axis `a` and origin `o` and the links' centres of mass `c`; a slide: displaced by `a`. The wrench is that of this displacement. \
Coefficient: `offset`, rad or m, what the encoder reads minus the truth. Only on robots.

## Identifiability
Only through joints further out: their axes are seen in wrong places. Turned with its own link alone, an offset is the same as another inertia of that link: for the last joint of a limb it is absorbed completely where inertias are fitted. \
Look for that one with the robot in a known posture.

## References
Mooring, Roth & Driels, Fundamentals of Manipulator Calibration (1991), ch. 2; own simulations.
",
    ..About::PLAIN
};

/// Largest plausible offset: a tooth of a coarse spline, rad.
const LARGEST_RAD: f64 = 0.5;
/// The same of a slide, m.
const LARGEST_M: f64 = 0.05;

pub(super) struct EncoderOffset;

impl Effect for EncoderOffset {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        let measured = |i: &usize| {
            scene.model.encoders
                && matches!(scene.model.links[*i].joint.kind, JointKind::Revolute(_) | JointKind::Prismatic(_))
        };
        (1..scene.model.n_links()).filter(measured).map(Target::Link).collect()
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let slides =
            matches!(scene.model.links.get(target.link()).map(|l| l.joint.kind), Some(JointKind::Prismatic(_)));
        let (unit, most) = if slides { ("m", LARGEST_M) } else { ("rad", LARGEST_RAD) };
        vec![Coefficient::within("offset", unit, -most, most)]
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let scene = series.scene;
        let joint = target.link();
        let Some(kind) = scene.model.links.get(joint).map(|l| l.joint.kind) else { return };
        let carried = carried(&scene.model, joint);
        match kind {
            JointKind::Revolute(axis) => {
                add_columns(series, out, |f, _, link| {
                    if !carried[link] {
                        return Vector3::zeros();
                    }
                    let from_joint = f.links[link].point(&scene.link_com_m[link]) - f.links[joint].origin;
                    (f.links[joint].rotation * *axis).cross(&from_joint)
                });
                add_turns(series, 0, out, |f, link| {
                    if carried[link] { f.links[joint].rotation * *axis } else { Vector3::zeros() }
                });
            }
            JointKind::Prismatic(axis) => {
                add_columns(
                    series,
                    out,
                    |f, _, link| {
                        if carried[link] { f.links[joint].rotation * *axis } else { Vector3::zeros() }
                    },
                )
            }
            _ => {}
        }
    }
}
