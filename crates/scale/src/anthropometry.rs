//! Anthropometric tables as data: `configs/anthropometry/*.yaml`, read by `pipeline`, used by
//! [`crate::prior`].
//!
//! A table holds the segments of a body, for one or both sexes: the link that carries each, the
//! anatomical points that define its length, and mass, centre of mass and radii of gyration as
//! fractions. The code contains no values, so another population only needs another file.

use crate::ScaleError;
use aloft_body::Sex;
use serde::{Deserialize, Serialize};

/// One published table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Anthropometry {
    /// Identifier, also the file's stem.
    pub name: String,
    /// One-line description.
    pub title: String,
    /// Publication.
    pub source: String,
    /// Values that were filled in or chosen, with reasons.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Points between two others, to which segments may refer.
    #[serde(default)]
    pub derived_points: Vec<DerivedPoint>,
    /// One body per sex; a table that does not distinguish the sexes holds a single one without
    /// `sex`.
    pub bodies: Vec<TableBody>,
}

/// A point on the line between two anatomical points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DerivedPoint {
    /// Name.
    pub name: String,
    /// Point at fraction 0.
    pub from: String,
    /// Point at fraction 1.
    pub to: String,
    /// Fraction, women.
    pub fraction_female: f64,
    /// Fraction, men.
    pub fraction_male: f64,
}

/// The segments of one sex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableBody {
    /// Sex, where the table distinguishes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sex: Option<Sex>,
    /// Stature of the body whose lengths are given in `reference_length_m`; 1 if those are
    /// fractions of stature.
    pub reference_height_m: f64,
    /// Segments; limbs are listed once, for both sides.
    pub segments: Vec<TableSegment>,
}

/// Direction of a segment's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SegmentAxes {
    /// y points from `to` to `from` (limbs: proximal is up), z as close to the link's z as
    /// possible.
    Down,
    /// y points from `from` to `to`.
    Up,
    /// x points from `from` to `to` (the foot, heel to toe).
    Forward,
    /// The link's own ISB axes; the two points give the length only.
    Link,
}

/// Source of a segment's length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LengthFrom {
    /// The distance between the two points in this person; if a point is unknown, the reference
    /// length scaled by stature.
    #[default]
    Measured,
    /// Always the reference length scaled by stature.
    Stature,
}

/// One segment.
///
/// Anatomical points: `vertex cervicale neck lumbar mid_hip suprasternale xiphoid` and, by side,
/// `shoulder elbow wrist hand_distal hip knee ankle heel toe_tip toe`; and the table's derived
/// points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableSegment {
    /// Name.
    pub name: String,
    /// Link that carries it; without `_r`, `_l` for limbs.
    pub link: String,
    /// Point from which the centre of mass is measured.
    pub from: String,
    /// Point at the other end.
    pub to: String,
    /// Axes.
    pub axes: SegmentAxes,
    /// Length of the reference body, m (or a fraction of stature:
    /// [`TableBody::reference_height_m`]).
    pub reference_length_m: f64,
    /// Source of the length.
    #[serde(default)]
    pub length: LengthFrom,
    /// Fraction of body mass.
    pub mass: f64,
    /// Centre of mass from `from` in segment axes, fractions of length (right side; the left
    /// mirrors z).
    pub com: [f64; 3],
    /// `[rxx, ryy, rzz, rxy, rxz, ryz]` about the centre of mass, fractions of length:
    /// `I_ij = ± m (r_ij L)²`, with the sign of the entry (a published "i" is a minus). Right side;
    /// the left mirrors xz and yz.
    pub radii: [f64; 6],
    /// Uncertainty of the table for a single person.
    pub sd: SegmentSd,
}

/// Standard deviations of a table's prediction for one person.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SegmentSd {
    /// Of the mass, relative.
    pub mass: f64,
    /// Of the centre of mass, fraction of length.
    pub com: f64,
    /// Of the radii of gyration, relative.
    pub radius: f64,
}

/// Links that exist once; every other link of a table is a limb that exists on both sides.
const CENTRAL_LINKS: [&str; 3] = ["pelvis", "torso", "head"];

impl TableSegment {
    /// True for a segment that exists on both sides.
    pub(crate) fn is_limb(&self) -> bool {
        !CENTRAL_LINKS.contains(&self.link.as_str())
    }
}

impl TableBody {
    /// Sum of the mass fractions, limbs counted twice.
    pub fn mass_sum(&self) -> f64 {
        self.segments.iter().map(|s| if s.is_limb() { 2.0 * s.mass } else { s.mass }).sum()
    }
}

impl Anthropometry {
    /// The bodies to use for a person and the weight of each: that of the person's sex, the only
    /// one available, or, if the sex is unknown, both with equal weight.
    ///
    /// # Errors
    /// [`ScaleError::Table`] when the table has no body for this sex.
    pub fn bodies_for(&self, sex: Option<Sex>) -> Result<Vec<(&TableBody, f64)>, ScaleError> {
        let chosen: Vec<&TableBody> =
            self.bodies.iter().filter(|b| b.sex.is_none() || sex.is_none() || b.sex == sex).collect();
        if chosen.is_empty() {
            return Err(self.error(format!("no body for {sex:?}")));
        }
        let weight = 1.0 / chosen.len() as f64;
        Ok(chosen.into_iter().map(|b| (b, weight)).collect())
    }

    /// Checks a table from a file: mass sums, signs, lengths, names.
    ///
    /// # Errors
    /// [`ScaleError::Table`] naming the segment and the value.
    pub fn validate(&self) -> Result<(), ScaleError> {
        if self.bodies.is_empty() {
            return Err(self.error("no bodies".into()));
        }
        for body in &self.bodies {
            if !(body.reference_height_m > 0.0 && body.reference_height_m < 3.0) {
                return Err(self.error(format!("reference height {} m", body.reference_height_m)));
            }
            let sum = body.mass_sum();
            if (sum - 1.0).abs() > 5e-3 {
                return Err(self.error(format!("the mass fractions of {:?} add up to {sum:.4}, not to 1", body.sex)));
            }
            for s in &body.segments {
                let bad = |what: &str, x: f64| self.error(format!("segment `{}`: {what} {x}", s.name));
                if !(s.mass > 0.0 && s.mass < 1.0) {
                    return Err(bad("mass fraction", s.mass));
                }
                if !(s.reference_length_m > 0.0 && s.reference_length_m < 1.0) {
                    return Err(bad("reference length", s.reference_length_m));
                }
                if let Some(&c) = s.com.iter().find(|c| c.is_nan() || c.abs() > 1.5) {
                    return Err(bad("centre of mass", c));
                }
                if let Some(&r) = s.radii[..3].iter().find(|&&r| !(r > 0.0 && r < 2.0)) {
                    return Err(bad("radius of gyration", r));
                }
                if let Some(&r) = s.radii[3..].iter().find(|r| r.is_nan() || r.abs() >= 2.0) {
                    return Err(bad("product radius", r));
                }
                let sd = [s.sd.mass, s.sd.com, s.sd.radius];
                if let Some(&x) = sd.iter().find(|&&x| !(x > 0.0 && x < 2.0)) {
                    return Err(bad("standard deviation", x));
                }
            }
        }
        Ok(())
    }

    fn error(&self, problem: String) -> ScaleError {
        ScaleError::Table { table: self.name.clone(), problem }
    }
}
