//! An elastic line to a fixed point of the room.

use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "tether",
    title: "tether or bungee",
    becomes: &["constant_force"],
    separated_by: Separation::OtherPlaces,
    accompanying: &["damping"],
    unbounded: "a stiffness is not negative and has no largest value; a damping of zero has to be found as zero from both sides",
    documentation: "\
## Physics
An elastic line, safety rope or cable runs from a point of a link to an anchor in the room. It pulls towards the anchor when stretched and does nothing when slack.

## Equation
`F = (k (d - l0) + c d_dot) u` for d > l0, else zero; d the distance and u the direction to the anchor. Coefficients: stiffness `k` (N/m, positive), damping `c` (N s/m). \
Nonlinear: anchor (m), rest length `l0` (m, zero or more), attachment within 0.3 m of the link's centre of mass (on a longer link up to its ends).

## Identifiability
Visible to 90-99 %. Anchor and rest length trade off along the line while the stiffness stays good; a slack tether shows nothing. A short stiff one is told from drag (0.8) and gravity (0.9-0.97) \
by flights in several places. A very distant anchor makes it a constant force.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

/// Column indices.
const STIFFNESS: usize = 0;
const DAMPING: usize = 1;

pub(super) struct Tether;

impl Effect for Tether {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::positive("stiffness", "N/m"), Coefficient::free("damping", "N*s/m")]
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        let mut out = NonlinearParameter::point_in_world("anchor", &scene.volume_centre_m, 8.0);
        out.push(NonlinearParameter::new("rest_length", "m", 0.0, 8.0, 0.1));
        out.extend(NonlinearParameter::point_of(scene, target));
        out
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        let attachment = scene.com_of(target);
        anchors(scene)
            .iter()
            .flat_map(|anchor| {
                let mean = (anchor - scene.volume_centre_m).norm();
                [0.0, 0.6 * mean, 0.95 * mean]
                    .map(|rest_length| [anchor.as_slice(), &[rest_length], attachment.as_slice()].concat())
            })
            .collect()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let mut values = Values::new(nonlinear);
        let (anchor_m, rest_length_m, attachment_m) = (values.vector(), values.scalar(), values.vector());
        for (i, f) in series.instants() {
            let link = &f.links[target.link()];
            let at = link.point(&attachment_m);
            let line = anchor_m - at;
            let distance = line.norm();
            let stretch = distance - rest_length_m.max(0.0);
            if stretch <= 0.0 || distance < 1e-9 {
                continue;
            }
            let u = line / distance;
            let lengthening = -u.dot(&link.point_velocity(&attachment_m));
            out.force_at(i, STIFFNESS, &(u * stretch), &at);
            out.force_at(i, DAMPING, &(u * lengthening), &at);
        }
    }
}

/// Anchors around the volume, at several heights and distances, slack and not.
pub(super) fn anchors(scene: &Scene) -> Vec<Vector3<f64>> {
    let c = scene.volume_centre_m;
    let mut out = vec![c + Vector3::z() * 2.0, c + Vector3::z() * 0.8, c - Vector3::z() * 1.0];
    for distance in [1.0, 2.5] {
        for k in 0..8 {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * k as f64).sin_cos();
            for height in [-0.4, 0.5] {
                out.push(c + Vector3::new(cos, sin, height) * distance);
            }
        }
    }
    out
}
