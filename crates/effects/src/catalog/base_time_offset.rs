//! A base pose that comes earlier or later than the joints.

use crate::displacement::{add_columns, add_turns};
use crate::{About, Coefficient, Columns, Effect, EffectKind, Family, Scene, Series, Target};

const ABOUT: About<'static> = About {
    id: "base_time_offset",
    title: "base pose against joints in time",
    kind: EffectKind::Artefact,
    family: Family::Kinematics,
    documentation: "\
## Physics
The base's pose and the joints come from two clocks. Where the offset between them is wrong, the base is seen where it is some milliseconds later or earlier than the joints.

## Equation
All links are seen displaced as one body by `e = v + w x (c - o)` and turned by `w`, with the velocity `v` and angular velocity `w` of the base and the links' centres of mass `c` about its origin `o`. \
Coefficient: `offset`, s, positive where the pose is from later than the joints. Only on robots.

## Identifiability
Needs joints that move quickly while the base turns. A gyroscope in the log finds the offset far better; without one it is here.

## References
Furgale, Rehder & Siegwart, IEEE/RSJ IROS (2013) 1280-1286; own simulations.
",
    ..About::PLAIN
};

/// Largest plausible offset that the search of the clocks leaves, s.
const LARGEST_S: f64 = 0.05;

pub(super) struct BaseTimeOffset;

impl Effect for BaseTimeOffset {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        if scene.model.encoders && scene.model.n_links() > 1 { Target::body() } else { Vec::new() }
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::within("offset", "s", -LARGEST_S, LARGEST_S)]
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        let scene = series.scene;
        add_columns(series, out, |f, _, link| {
            let base = &f.links[0];
            base.velocity + base.omega.cross(&(f.links[link].point(&scene.link_com_m[link]) - base.origin))
        });
        add_turns(series, 0, out, |f, _| f.links[0].omega);
    }
}
