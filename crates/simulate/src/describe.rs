//! Description files written with the recordings: `subject.yaml` for people, `object.yaml` for
//! objects.

use crate::object::TrueMarker;
use crate::scenario::{PersonSpec, Scenario};
use aloft_body::{Model, Sex};
use std::fmt::Write as _;

/// A number without trailing zeros, with at most `digits` decimals.
fn number(x: f64, digits: usize) -> String {
    let text = format!("{x:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// `subject.yaml` of a person: facts, laboratory, plates, trials (name and kind).
pub fn subject(
    scenario: &Scenario,
    person: &PersonSpec,
    mass_kg: f64,
    plates: bool,
    trials: &[(String, &'static str)],
) -> String {
    let c = &scenario.capture;
    let sex = if person.sex == Sex::Female { "F" } else { "M" };
    let rate = number(c.point_rate_hz, 3);
    let analog = number(c.point_rate_hz * c.analog_per_frame as f64, 3);
    let mut out = format!(
        "name: {}\nsex: {sex}\nheight_m: {}\nmass_kg: {}\nmarker_set: plug-in-gait-35\n\
         static_extra_markers: [LKNM, RKNM, LANM, RANM, LELM, RELM]\nlab:\n  up_axis: z\n  forward_axis: x\n  \
         gravity: [0, 0, -{}]\n  point_rate_hz: {rate}\n  analog_rate_hz: {analog}\n",
        quoted(&scenario.name),
        number(person.height_m, 4),
        number(mass_kg, 3),
        number(c.gravity_mps2, 6),
    );
    if plates {
        out.push_str(
            "plates:\n  - {id: 1, side: left, type: 2, size_mm: [400, 600], channels: [Fx1, Fy1, Fz1, Mx1, My1, Mz1]}\n  \
             - {id: 2, side: right, type: 2, size_mm: [400, 600], channels: [Fx2, Fy2, Fz2, Mx2, My2, Mz2]}\n",
        );
    }
    out.push_str("trials:\n");
    for (name, kind) in trials {
        let _ = writeln!(out, "  - {{file: {name}.c3d, kind: {kind}}}");
    }
    out
}

/// A YAML scalar, in double quotes if necessary.
fn quoted(text: &str) -> String {
    let plain = !text.is_empty()
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c))
        && text.starts_with(|c: char| c.is_ascii_alphabetic());
    if plain { text.to_owned() } else { format!("{text:?}") }
}

fn head(scenario: &Scenario, title: &str, mass_kg: f64) -> String {
    let c = &scenario.capture;
    format!(
        "# object as a laboratory would describe it\nname: {title}\ntotal_mass_kg: {:<12}# scale, +-0.0005\n\
         gravity_m_s2: {:<13}# along -Z of the capture frame\n\
         capture: {{system: optical, cameras: 10, rate_hz: {}, units: mm, up: Z, marker_noise_mm: {}}}\n",
        number(mass_kg, 4),
        number(c.gravity_mps2, 6),
        number(c.point_rate_hz, 3),
        number(1000.0 * c.marker_noise_m, 3),
    )
}

fn throws(n: usize) -> String {
    (1..=n).map(|i| format!("throws_{i:02}.c3d")).collect::<Vec<_>>().join(", ")
}

/// `object.yaml` of the chain: frames from markers, the hinge to be found from its calibration.
pub fn chain(scenario: &Scenario, mass_kg: f64, recordings: usize) -> String {
    let head = head(scenario, "two-link chain, one passive revolute joint with bearings", mass_kg);
    format!(
        "{head}links:
  - name: link0
    markers: [L0_1, L0_2, L0_3, L0_4, L0_5]
    frame:                  # defined by markers, no hidden offsets
      origin: L0_1
      y_axis: from L0_1 towards L0_2
      z_axis: perpendicular to y, on the side of L0_3 (L0_3 lies in the +z half of the y-z plane)
      x_axis: right handed (y cross z)
  - name: link1
    parent: link0
    markers: [L1_1, L1_2, L1_3, L1_4]
    joint:
      type: revolute
      axis: z of link1; positive direction is the one with positive dot product with +x of link0 at angle zero
      location: unknown, from hinge_calib.c3d (functional)
      zero: posture of static.c3d
      positive_angle: right hand rule about z of link1, link1 relative to link0
    frame:
      origin: point of the hinge axis closest to the link0 origin (L0_1)
      x_axis: perpendicular to z, such that L1_1 lies in the x-z plane on the -x side (L1_1 has y = 0, x < 0)
trials:
  static: static.c3d        # held still on a table, hinge angle zero
  hinge_calibration: hinge_calib.c3d   # base moved slowly, hinge swung back and forth by hand
  throws: [{}]   # thrown, caught, carried, thrown again; no force plates
",
        throws(recordings)
    )
}

/// `object.yaml` of any other object: joints and marker positions from its model.
pub fn custom(scenario: &Scenario, model: &Model, markers: &[TrueMarker], mass_kg: f64, recordings: usize) -> String {
    let mut out = head(scenario, &quoted(&model.name), mass_kg);
    out.push_str("links:\n");
    for (index, link) in model.links.iter().enumerate() {
        let own: Vec<&TrueMarker> = markers.iter().filter(|m| m.link == index).collect();
        let labels: Vec<String> = own.iter().map(|m| quoted(&m.label)).collect();
        let _ = writeln!(out, "  - name: {}", quoted(&link.name));
        if let Some(parent) = link.parent {
            let _ = writeln!(out, "    parent: {}", quoted(&model.links[parent].name));
        }
        let _ = writeln!(out, "    markers: [{}]", labels.join(", "));
        out.push_str("    marker_positions_m:\n");
        for marker in own {
            let p = marker.position_m;
            let _ = writeln!(out, "      {}: [{}, {}, {}]", quoted(&marker.label), p.x, p.y, p.z);
        }
    }
    let _ = write!(
        out,
        "trials:\n  static: static.c3d\n  joint_calibration: joint_calib.c3d\n  throws: [{}]\n",
        throws(recordings)
    );
    out
}
