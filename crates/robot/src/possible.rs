//! Inertias that no body has: of another unit, or beyond the triangle inequality.

use crate::RobotError;
use aloft_body::{LinkInertia, ModelSpec};
use nalgebra::{Matrix3, SymmetricEigen};

/// Radius of gyration and distance of the centre of mass above which an inertia is impossible, in
/// lengths of the robot (all offsets of joints together, at least a tenth of a metre).
const TIMES_THE_ROBOT: f64 = 10.0;
/// The robot's length where no joint has an offset, m.
const ONE_LINK_M: f64 = 1.0;
/// Share of the trace by which a second moment may be negative because digits are few.
const ROUNDING: f64 = 1e-3;

/// Share of the robot's mass below which a link's inertia is that of a frame, not of a body.
const NEGLIGIBLE: f64 = 1e-5;

/// Refuses impossible inertias; replaces those beyond the triangle inequality by the nearest
/// possible ones, and says so.
///
/// # Errors
/// [`RobotError::Model`]: a link with a negative mass, a negative principal moment, or an inertia
/// whose size is that of another unit.
pub(crate) fn inertias(file: &str, spec: &mut ModelSpec) -> Result<Vec<String>, RobotError> {
    let offsets: f64 = spec.links.iter().skip(1).map(|l| l.position_m.iter().map(|x| x * x).sum::<f64>().sqrt()).sum();
    let length = if offsets > 0.0 { offsets.max(0.1) } else { ONE_LINK_M };
    let total_kg: f64 = spec.links.iter().filter_map(|l| l.inertia).map(|i| i.mass_kg).sum();
    let mut remarks = Vec::new();
    for link in &mut spec.links {
        let Some(inertia) = &mut link.inertia else { continue };
        let wrong = |problem: String| Err(RobotError::model(file, format!("link `{}`: {problem}", link.name)));
        if inertia.mass_kg < 0.0 {
            return wrong(format!("a mass of {} kg, expected zero or more", inertia.mass_kg));
        }
        let moments = inertia.inertia_com_kgm2.symmetric_eigenvalues();
        let size = moments.iter().fold(0.0, |a: f64, m| a.max(m.abs()));
        // zeros that were turned, and frames that weigh nothing beside the robot
        let negligible = size < 1e-12 * total_kg * length * length || inertia.mass_kg < NEGLIGIBLE * total_kg;
        if !negligible && moments.iter().any(|m| *m < -ROUNDING * size) {
            return wrong(format!(
                "its inertia has the principal moments {:.3e}, {:.3e} and {:.3e} kg m², expected none below zero: a sign of ixy, ixz or iyz, or an inertia about another point?",
                moments[0], moments[1], moments[2]
            ));
        }
        if inertia.mass_kg == 0.0 {
            continue;
        }
        if negligible {
            if moments.iter().any(|m| *m < 0.0) {
                let second = Matrix3::identity() * (0.5 * moments.sum()) - inertia.inertia_com_kgm2;
                inertia.inertia_com_kgm2 = possible(second);
            }
            continue;
        }
        let radius = (0.5 * moments.sum() / inertia.mass_kg).sqrt();
        if radius > TIMES_THE_ROBOT * length {
            return wrong(format!(
                "its inertia has a radius of gyration of {radius:.3} m with {:.4} kg, in a robot whose joints are {length:.2} m apart together: expected kg m² (kg mm² are 10⁶ times as large, kg cm² 10⁴ times)",
                inertia.mass_kg
            ));
        }
        let com = inertia.com_m.norm();
        if com > TIMES_THE_ROBOT * length {
            return wrong(format!("its centre of mass is {com:.1} m from its origin, expected m: millimetres?"));
        }
        if let Some(nearest) = nearest_possible(inertia) {
            remarks.push(format!(
                "the inertia of `{}` in {file} has the principal moments {:.3e}, {:.3e} and {:.3e} kg m², but no body has a moment larger than the sum of the other two: the nearest possible inertia is used instead",
                link.name, moments[0], moments[1], moments[2]
            ));
            *inertia = nearest;
        }
    }
    Ok(remarks)
}

/// The inertia with second moments `½ tr(I) 1 − I` of zero where they are negative; none if they
/// are negative by rounding alone.
fn nearest_possible(inertia: &LinkInertia) -> Option<LinkInertia> {
    let of = inertia.inertia_com_kgm2;
    let second = Matrix3::identity() * (0.5 * of.trace()) - of;
    if SymmetricEigen::new(second).eigenvalues.min() >= -ROUNDING * second.trace() {
        return None;
    }
    Some(LinkInertia { inertia_com_kgm2: possible(second), ..*inertia })
}

/// The inertia of second moments, without those below zero.
fn possible(second: Matrix3<f64>) -> Matrix3<f64> {
    let eigen = SymmetricEigen::new(second);
    let vectors = eigen.eigenvectors;
    let clipped = vectors * Matrix3::from_diagonal(&eigen.eigenvalues.map(|x| x.max(0.0))) * vectors.transpose();
    Matrix3::identity() * clipped.trace() - clipped
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use crate::RobotModel;

    fn model(of: &str) -> Result<RobotModel, crate::RobotError> {
        let link =
            |name: &str, i: &str| format!("<link name=\"{name}\"><inertial><mass value=\"2\"/>{i}</inertial></link>");
        let own = "<inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" iyy=\"0.02\" iyz=\"0\" izz=\"0.02\"/>";
        RobotModel::parse(
            "r.urdf",
            &format!(
                "<robot name=\"r\">{}{}<joint name=\"j\" type=\"continuous\"><parent link=\"a\"/><child link=\"b\"/><origin xyz=\"0 0 0.4\"/><axis xyz=\"1 0 0\"/></joint></robot>",
                link("a", own),
                link("b", of)
            ),
        )
    }

    fn inertia(xx: f64, yy: f64, zz: f64) -> String {
        format!("<inertia ixx=\"{xx}\" ixy=\"0\" ixz=\"0\" iyy=\"{yy}\" iyz=\"0\" izz=\"{zz}\"/>")
    }

    #[test]
    fn other_units_are_refused_with_the_link() {
        let said = model(&inertia(2e4, 2e4, 2e4)).unwrap_err().to_string();
        assert!(said.starts_with("r.urdf: link `b`: its inertia has a radius of gyration of 122.474 m"), "{said}");
        let said = model(&format!("<origin xyz=\"0 0 120\"/>{}", inertia(0.1, 0.1, 0.1))).unwrap_err().to_string();
        assert!(said.contains("its centre of mass is 120.0 m from its origin, expected m: millimetres?"), "{said}");
        let said = model(&inertia(0.1, -0.1, 0.1)).unwrap_err().to_string();
        assert!(said.contains("expected none below zero"), "{said}");
    }

    #[test]
    fn the_nearest_possible_inertia_is_taken_and_named() {
        let found = model(&inertia(0.5, 0.1, 0.1)).unwrap();
        assert!(found.remarks[0].contains("`b` in r.urdf"), "{:?}", found.remarks);
        let i = found.spec.links[1].inertia.unwrap().inertia_com_kgm2;
        assert!((i[(0, 0)] - i[(1, 1)] - i[(2, 2)]).abs() < 1e-12 && i[(1, 1)] > 0.1, "{i}");
        // a thin plate in three digits is one
        assert!(model(&inertia(0.0333, 0.0333, 0.0667)).unwrap().remarks.is_empty());
    }
}
