//! Where the segments of the standing body are, from the landmarks of its static trial: rigid
//! clusters whose labels say nothing (CAST: plates on the segments, landmarks in the static trial
//! alone) sit beside the axis of their segment.

use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A segment as a line, and how far from it markers usually sit, m.
struct Axis {
    link: String,
    from: Vector3<f64>,
    to: Vector3<f64>,
    radius_m: f64,
}

impl Axis {
    fn distance(&self, p: &Vector3<f64>) -> f64 {
        let along = self.to - self.from;
        let share = ((p - self.from).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        (p - self.from - along * share).norm()
    }
}

/// Farthest that a cluster may be from an axis, in usual distances.
const FARTHEST: f64 = 3.0;

/// The segment nearest to a point: link, distance from its axis, m, and whether another one is
/// nearly as near.
pub(super) struct Nearest {
    pub link: String,
    pub distance_m: f64,
    pub doubtful: Option<String>,
}

/// Axes of the segments that the landmarks define.
pub(super) struct SegmentAxes(Vec<Axis>);

impl SegmentAxes {
    /// From landmarks by name, m, Z up.
    pub fn of(landmarks: &BTreeMap<String, Vector3<f64>>) -> Self {
        let get = |name: &str| landmarks.get(name).copied();
        let mean = |names: &[String]| {
            let seen: Vec<Vector3<f64>> = names.iter().filter_map(|n| get(n)).collect();
            (!seen.is_empty()).then(|| seen.iter().sum::<Vector3<f64>>() / seen.len() as f64)
        };
        let sided = |stems: &[&str], side: char| mean(&stems.iter().map(|s| format!("{s}_{side}")).collect::<Vec<_>>());
        let both = |stem: &str| Some((get(&format!("{stem}_r"))? + get(&format!("{stem}_l"))?) / 2.0);
        let asis = both("asis");
        let width = get("asis_r").zip(get("asis_l")).map(|(r, l)| r - l);
        let mut axes = Vec::new();
        let mut add = |link: String, from: Option<Vector3<f64>>, to: Option<Vector3<f64>>, radius_m: f64| {
            if let (Some(from), Some(to)) = (from, to) {
                axes.push(Axis { link, from, to, radius_m });
            }
        };
        for (side, sign) in [('r', 1.0), ('l', -1.0)] {
            // Bell's proportions are enough to tell segments apart
            let by_pelvis = asis.zip(width).map(|(m, w)| m + w * (0.36 * sign) - Vector3::z() * (0.3 * w.norm()));
            let hip = get(&format!("hip_centre_{side}")).or(by_pelvis).or_else(|| sided(&["trochanter"], side));
            let knee = sided(&["knee_lateral", "knee_medial", "knee_centre"], side);
            let ankle = sided(&["ankle_lateral", "ankle_medial", "ankle_centre"], side);
            let toe = sided(&["toe", "mt1", "mt5"], side);
            let shoulder = sided(&["acromion", "shoulder_centre"], side);
            let elbow = sided(&["elbow_lateral", "elbow_medial", "elbow_centre"], side);
            let wrist = sided(&["wrist", "wrist_radial", "wrist_ulnar", "wrist_centre"], side);
            let fingers = sided(&["hand_distal"], side)
                .or_else(|| elbow.zip(wrist).and_then(|(e, w)| Some(w + (w - e).try_normalize(1e-6)? * 0.09)));
            add(format!("thigh_{side}"), hip, knee, 0.08);
            add(format!("shank_{side}"), knee, ankle, 0.06);
            add(format!("foot_{side}"), sided(&["heel"], side).or(ankle), toe, 0.05);
            add(format!("upper_arm_{side}"), shoulder, elbow, 0.06);
            add(format!("forearm_{side}"), elbow, wrist, 0.05);
            add(format!("hand_{side}"), wrist, fingers, 0.04);
        }
        let back = both("psis").or_else(|| get("sacrum"));
        add("pelvis".to_owned(), asis, back, 0.09);
        let shoulders = both("acromion").or_else(|| both("shoulder_centre"));
        let top = get("c7").or_else(|| get("neck_centre")).or(shoulders);
        let loin = asis.zip(back).map(|(a, b)| (a + b) / 2.0).zip(top).map(|(p, t)| p + (t - p) * 0.4);
        add("torso".to_owned(), loin, shoulders.or(top), 0.13);
        add("head".to_owned(), top.map(|t| t + Vector3::z() * 0.08), top.map(|t| t + Vector3::z() * 0.28), 0.11);
        Self(axes)
    }

    /// The nearest segment; none where every one is far.
    pub fn nearest(&self, p: &Vector3<f64>) -> Option<Nearest> {
        let mut each: Vec<(f64, &Axis)> = self.0.iter().map(|a| (a.distance(p) / a.radius_m, a)).collect();
        each.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (score, axis) = each.first().filter(|(score, _)| *score < FARTHEST)?;
        let next = each.get(1).filter(|(other, _)| *other < 1.4 * score.max(0.5));
        Some(Nearest {
            link: axis.link.clone(),
            distance_m: axis.distance(p),
            doubtful: next.map(|(_, a)| a.link.clone()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_beside_a_segment_are_on_it_and_far_ones_on_none() {
        let all = [
            ("asis_r", [0.05, -0.12, 0.97]),
            ("asis_l", [0.05, 0.12, 0.97]),
            ("knee_lateral_r", [0.03, -0.14, 0.49]),
            ("knee_medial_r", [0.03, -0.04, 0.49]),
            ("ankle_lateral_r", [-0.04, -0.13, 0.075]),
            ("ankle_medial_r", [-0.04, -0.05, 0.075]),
        ];
        let axes = SegmentAxes::of(&all.iter().map(|(n, p)| ((*n).to_owned(), Vector3::from(*p))).collect());
        let link = |p: [f64; 3]| axes.nearest(&p.into()).map(|n| n.link);
        assert_eq!(link([0.05, -0.17, 0.70]).as_deref(), Some("thigh_r"));
        assert_eq!(link([0.02, -0.14, 0.30]).as_deref(), Some("shank_r"));
        assert_eq!(link([0.0, 0.5, 0.3]), None, "no landmark of the left leg, and far from the right one");
    }
}
