//! Placebo effects, which have no physical basis. If one wins, something other than the named
//! effects is at work.

use aloft_effects::{About, Coefficient, Columns, Effect, EffectKind, Scene, Series, Target};
use nalgebra::Vector3;

/// A placebo.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Placebo {
    /// Quadratic drag computed from the velocities of the time-reversed stretch.
    ReversedDrag,
    /// The same for a flywheel in the root.
    ReversedFlywheel,
    /// A spring to an arbitrary anchor point.
    Spring(u8),
}

pub(crate) static PLACEBOS: [Placebo; 4] =
    [Placebo::ReversedDrag, Placebo::ReversedFlywheel, Placebo::Spring(0), Placebo::Spring(1)];

impl Effect for Placebo {
    fn about(&self) -> About<'_> {
        let id = match self {
            Self::ReversedDrag => "placebo_reversed_drag",
            Self::ReversedFlywheel => "placebo_reversed_flywheel",
            Self::Spring(0) => "placebo_spring_1",
            Self::Spring(_) => "placebo_spring_2",
        };
        About {
            id,
            title: "placebo",
            kind: EffectKind::Artefact,
            documentation: "A placebo: an effect that does not exist. It should not be supported.",
            ..About::PLAIN
        }
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        vec![Target::Body]
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        match self {
            Self::ReversedFlywheel => Coefficient::vector_on_link("momentum", "N*m*s", f64::INFINITY),
            _ => vec![Coefficient::free("size", "1")],
        }
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        let scene = series.scene;
        for run in series.runs() {
            for (step, i) in run.clone().enumerate() {
                let mirror = run.end - 1 - step;
                let (here, there) = (series.links(i), series.links(mirror));
                match self {
                    Self::ReversedDrag => {
                        for (link, com) in scene.link_com_m.iter().enumerate() {
                            let v = there[link].point_velocity(com);
                            let force = v * (-scene.area_share[link] * v.norm());
                            out.force_at(i, 0, &force, &here[link].point(com));
                        }
                    }
                    Self::ReversedFlywheel => {
                        for k in 0..3 {
                            let axis: Vector3<f64> = there[0].rotation.column(k).into_owned();
                            out.couple(i, k, &-there[0].omega.cross(&axis));
                        }
                    }
                    Self::Spring(which) => {
                        let angle = 2.4 * f64::from(*which) + 0.7;
                        let height = if *which == 0 { 0.3 } else { -0.6 };
                        let anchor = scene.volume_centre_m + Vector3::new(angle.cos(), angle.sin(), height) * 1.3;
                        let at = here[0].point(&scene.link_com_m[0]);
                        let line = anchor - at;
                        // the force vanishes at the typical distance, so it is not constant to
                        // first order
                        let stretch = line.norm() - 1.3;
                        out.force_at(i, 0, &(line.normalize() * stretch), &at);
                    }
                }
            }
        }
    }
}
