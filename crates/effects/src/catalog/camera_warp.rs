//! A reconstruction that is bent across the capture volume.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::displacement::add_columns;
use crate::{Columns, Scene, Series};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "camera_warp",
    title: "camera volume bent",
    kind: EffectKind::Artefact,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets: def::body,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Series(law)),
    inertia: None,
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
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    ["radial", "along_x", "along_y", "along_z"].iter().map(|n| Coefficient::within(*n, "1/m", -0.1, 0.1)).collect()
}

fn law(series: &Series<'_>, _: Target, _: &[f64], out: &mut Columns) {
    let scene = series.scene;
    add_columns(series, out, |f, column, link| {
        let x: Vector3<f64> = f.links[link].point(&scene.link_com_m[link]) - scene.volume_center_m;
        match column {
            0 => x * x.norm(),
            k => def::axis(k - 1) * x.norm_squared(),
        }
    });
}
