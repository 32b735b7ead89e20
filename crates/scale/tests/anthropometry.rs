//! The tables in `configs/anthropometry/` against their publications.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use aloft_body::Sex;
use aloft_scale::Anthropometry;
use aloft_scale::anthropometry::{SegmentAxes, TableBody, TableSegment};
use std::path::PathBuf;

fn table(name: &str) -> Anthropometry {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/anthropometry/{name}.yaml"));
    let table: Anthropometry = serde_yaml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(table.name, name);
    table.validate().unwrap();
    table
}

fn body(table: &Anthropometry, sex: Sex) -> &TableBody {
    table.bodies_for(Some(sex)).unwrap()[0].0
}

fn segment<'a>(body: &'a TableBody, name: &str) -> &'a TableSegment {
    body.segments.iter().find(|s| s.name == name).unwrap()
}

#[test]
fn validate_mass_fractions_add_up_as_published() {
    let (leva, dumas, winter) = (table("de_leva"), table("dumas"), table("winter"));
    assert!((body(&leva, Sex::Female).mass_sum() - 1.0).abs() < 2e-4);
    assert!((body(&leva, Sex::Male).mass_sum() - 1.0).abs() < 2e-4);
    assert!((body(&winter, Sex::Male).mass_sum() - 1.0).abs() < 2e-4);
    assert!((body(&dumas, Sex::Female).mass_sum() - 0.999).abs() < 2e-4);
    assert!((body(&dumas, Sex::Male).mass_sum() - 1.002).abs() < 2e-4);
}

/// Rows that are known to be wrong in copies of these tables.
#[test]
fn validate_rows_that_others_get_wrong() {
    let leva = table("de_leva");
    let (f, m) = (body(&leva, Sex::Female), body(&leva, Sex::Male));
    assert_eq!(segment(f, "head").mass, 0.0668);
    assert_eq!(segment(m, "head").mass, 0.0694);
    assert_eq!(segment(m, "shank").mass, 0.0433);
    assert_eq!(segment(m, "hand").mass, 0.0061);
    // Foot: its long axis is antero-posterior, so the longitudinal radius is about x.
    assert_eq!(segment(f, "foot").axes, SegmentAxes::Forward);
    assert_eq!(segment(f, "foot").radii[0], 0.139);
    assert_eq!(segment(m, "foot").radii[0], 0.124);
    assert_eq!(segment(f, "thigh").com, [0.0, -0.3612, 0.0]);
    assert_eq!(segment(f, "thigh").radii[..3], [0.369, 0.162, 0.364]);
    let dumas = table("dumas");
    let f = body(&dumas, Sex::Female);
    // Imaginary published radii are negative products.
    assert_eq!(segment(f, "head_neck").radii, [0.29, 0.23, 0.30, -0.04, 0.01, 0.0]);
    assert_eq!(segment(f, "pelvis").radii[3..], [-0.34, -0.01, -0.01]);
    // r_yz of the upper arm is real, unlike that of the forearm, as the centre of mass lies on the
    // other side of the axis.
    assert_eq!(segment(f, "upper_arm").radii[3..], [0.03, -0.05, 0.14]);
    // The corrected foot, not the superseded one with another reference length.
    assert_eq!(segment(body(&dumas, Sex::Male), "foot").com, [0.502, -0.199, 0.034]);
}

#[test]
fn an_unknown_sex_takes_both_bodies_by_halves() {
    let leva = table("de_leva");
    let both = leva.bodies_for(None).unwrap();
    assert_eq!(both.len(), 2);
    assert!(both.iter().all(|(_, w)| *w == 0.5));
    assert_eq!(table("winter").bodies_for(Some(Sex::Female)).unwrap().len(), 1);
}

#[test]
fn a_damaged_table_is_refused_with_its_segment() {
    let refuse = |change: &dyn Fn(&mut Anthropometry)| {
        let mut t = table("de_leva");
        change(&mut t);
        t.validate().unwrap_err().to_string()
    };
    assert!(refuse(&|t| t.bodies[0].segments[0].mass = 0.694).contains("add up"));
    assert!(refuse(&|t| t.bodies[0].segments[0].radii[1] = -0.3).contains("head"));
    assert!(refuse(&|t| t.bodies[0].segments[3].com[1] = f64::NAN).contains("lower_trunk"));
    assert!(refuse(&|t| t.bodies[0].reference_height_m = 174.1).contains("height"));
    assert!(refuse(&|t| t.bodies.clear()).contains("no bodies"));
}
