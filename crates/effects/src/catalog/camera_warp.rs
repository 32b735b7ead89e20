//! A reconstruction that is bent across the capture volume.

use crate::columns::axis;
use crate::displacement::add_columns;
use crate::{About, Coefficient, Columns, Effect, EffectKind, Family, Scene, Series, Target};
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "camera_warp",
    title: "camera volume bent",
    kind: EffectKind::Artefact,
    family: Family::Kinematics,
    usual_sd: USUAL,
    documentation: "\
## Physics
Lens distortion and an uneven calibration bend space by 1-5 mm across the volume: straight paths become curved, and flights show accelerations that depend on the place.

## Equation
Displacement field of second degree in the place x about the middle of the volume: radial `x |x|`, and along each axis `|x|2`. Coefficients: m at 1 m (1/m). Its wrench is that of a displacement field.

## Identifiability
A field along the vertical looks like a change of gravity, a horizontal one like a tilt, but depending on the place: flights all over the volume separate them. Where flights keep to one side of the cameras' middle \
the bend brings a stretch, which is a gravity of another size and direction: fit those beside it. `radial` and `along_z` are told apart only by flights above and below the middle.

## References
Chiari et al., Gait & Posture 21 (2005) 197-211; own simulations.
",
    ..About::PLAIN
};

/// Largest plausible bend, 1/m.
const MOST: f64 = 0.1;
/// First column of the bend along an axis; the column before it is radial.
const ALONG: usize = 1;

/// Standard deviation in ordinary recordings, 1/m: a millimetre at a metre from the middle.
const USUAL: f64 = 1e-3;

pub(super) struct CameraWarp;

impl Effect for CameraWarp {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, _: &Scene) -> Vec<Target> {
        Target::body()
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        let mut out = vec![Coefficient::within("radial", "1/m", -MOST, MOST)];
        out.extend(Coefficient::vector_in_world("along", "1/m", MOST));
        out
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
        let scene = series.scene;
        add_columns(series, out, |f, column, link| {
            let x: Vector3<f64> = f.links[link].point(&scene.link_com_m[link]) - scene.volume_centre_m;
            match column.checked_sub(ALONG) {
                None => x * x.norm(),
                Some(k) => axis(k) * x.norm_squared(),
            }
        });
    }
}
