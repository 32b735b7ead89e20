//! The wrench required by a change of inertial parameters: `Y δφ` from the kinematics of the links.

use crate::{Columns, Series};
use aloft_body::Phi;
use aloft_body::inertia::{first_moment, inertia_about_origin};

/// Adds `sign · Y δφ` (rate of momentum less weight, about the world origin) to a column.
pub(crate) fn add_wrench(series: &Series<'_>, change: &[Phi], sign: f64, column: usize, out: &mut Columns) {
    let g = series.scene.model.gravity_mps2;
    for i in 0..series.len() {
        for (link, phi) in series.links(i).iter().zip(change) {
            if phi.norm_squared() == 0.0 {
                continue;
            }
            let mc = link.rotation * first_moment(phi);
            let inertia = link.rotation * inertia_about_origin(phi) * link.rotation.transpose();
            let fall = link.acceleration - g;
            let force = fall * phi[0] + link.alpha.cross(&mc) + link.omega.cross(&link.omega.cross(&mc));
            let about_link = mc.cross(&fall) + inertia * link.alpha + link.omega.cross(&(inertia * link.omega));
            out.add(i, column, &(force * sign), &((about_link + link.origin.cross(&force)) * sign));
        }
    }
}
