//! Identified inertias back into the text of a model file. Only the numbers of inertials change:
//! order, comments and layout stay.

use crate::RobotError;
use crate::model::{Format, RobotModel};
use crate::xml::parse;
use aloft_body::inertia::pseudo_inertia;
use aloft_body::{LinkInertia, Phi};
use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};
use roxmltree::Node;
use std::ops::Range;

/// A patched file.
#[derive(Debug, Clone, PartialEq)]
pub struct Patched {
    /// The new text.
    pub text: String,
    /// Links of the file whose inertials were written, in the order of the file.
    pub written: Vec<String>,
    /// Remarks, for example on links fixed to others.
    pub remarks: Vec<String>,
}

/// True if a body of positive density can have these parameters.
pub fn is_consistent(inertia: &LinkInertia) -> bool {
    pseudo_inertia(&inertia.to_phi()).cholesky().is_some()
}

/// Inertias of every link of the file from those of the model's links: a link that was merged with
/// fixed ones gets the sum less theirs, which stay as they are. Where that leaves a link that no
/// body can be, the fixed ones are reduced in proportion.
fn shared_out(
    model: &RobotModel,
    links: &[(String, LinkInertia)],
    remarks: &mut Vec<String>,
) -> Vec<(String, LinkInertia)> {
    let mut out = Vec::new();
    for (name, total) in links {
        let fixed: Vec<_> = model.merged.iter().filter(|m| m.into == *name && m.inertia.mass_kg > 0.0).collect();
        if fixed.is_empty() {
            out.push((name.clone(), *total));
            continue;
        }
        let sum: Phi = fixed.iter().map(|m| m.inertia.to_phi()).sum();
        for share in [1.0, 0.75, 0.5, 0.25, 0.0] {
            let rest = total.to_phi() - sum * share;
            if pseudo_inertia(&rest).cholesky().is_none() {
                continue;
            }
            out.push((name.clone(), LinkInertia::from_phi(&rest)));
            if share < 1.0 {
                let names: Vec<&str> = fixed.iter().map(|m| m.name.as_str()).collect();
                remarks.push(format!(
                    "`{name}` with the links fixed to it ({}) is lighter than the model says: these were multiplied by {share}",
                    names.join(", ")
                ));
                for m in &fixed {
                    // in its own frame: a factor on mass and inertia needs no transformation
                    out.push((format!("{}*{share}", m.name), m.inertia));
                }
            }
            break;
        }
    }
    out
}

/// Writes the inertias of `links` (name and inertia in the link's frame, as in `model.spec`) into
/// the text that `model` was read from. `provenance` is written as a comment before the outermost
/// element.
///
/// # Errors
/// [`RobotError::Model`] if the text is not that of the model, or an inertia is not consistent.
pub fn patch(
    text: &str,
    model: &RobotModel,
    links: &[(String, LinkInertia)],
    provenance: &str,
) -> Result<Patched, RobotError> {
    if let Some((name, _)) = links.iter().find(|(_, i)| !is_consistent(i)) {
        return Err(RobotError::model(&model.file, format!("the inertia for `{name}` is not that of any body")));
    }
    let document = parse(&model.file, text)?;
    let mut remarks = Vec::new();
    let shared = shared_out(model, links, &mut remarks);
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    let mut written = Vec::new();
    let element = match model.format {
        Format::Urdf => "link",
        Format::Mjcf => "body",
    };
    let bodies = document.descendants().filter(|n| n.has_tag_name(element));
    for body in bodies {
        let Some(name) = body.attribute("name") else { continue };
        // none: a link that is no multiple of another one
        let scaled = shared.iter().find_map(|(n, _)| n.strip_prefix(name)?.strip_prefix('*')?.parse::<f64>().ok());
        if let Some(share) = scaled {
            scale(body, model.format, share, &mut edits);
            written.push(name.to_owned());
            continue;
        }
        let Some((_, inertia)) = shared.iter().find(|(n, _)| n == name) else { continue };
        let moved = model.moved.iter().find(|m| m.0 == name).map_or(Vector3::zeros(), |m| Vector3::from(m.1));
        let inertia = inertia.transformed(&Isometry3::translation(moved.x, moved.y, moved.z));
        match model.format {
            Format::Urdf => urdf(text, body, &inertia, &mut edits),
            Format::Mjcf => mjcf(text, body, &inertia, &mut edits),
        }
        written.push(name.to_owned());
    }
    if written.is_empty() {
        return Err(RobotError::model(&model.file, "none of the links identified is in the file"));
    }
    let comment = provenance.replace("--", "- -");
    let start = document.root_element().range().start;
    edits.push((start..start, format!("<!-- {} -->\n", comment.trim())));
    edits.sort_by_key(|e| std::cmp::Reverse((e.0.start, e.0.end)));
    let mut out = text.to_owned();
    for (range, new) in edits {
        out.replace_range(range, &new);
    }
    Ok(Patched { text: out, written, remarks })
}

/// Twelve significant digits, without trailing zeros.
pub(crate) fn number(x: f64) -> String {
    let rounded: f64 = format!("{x:.11e}").parse().unwrap_or(x);
    // exponents only where plain digits would be long
    if rounded != 0.0 && rounded.abs() < 1e-5 { format!("{rounded:e}") } else { format!("{rounded}") }
}

fn vector(v: &Vector3<f64>) -> String {
    format!("{} {} {}", number(v.x), number(v.y), number(v.z))
}

/// Replaces the value of an attribute, or adds the attribute after the element's name.
fn set(node: Node<'_, '_>, name: &str, value: String, edits: &mut Vec<(Range<usize>, String)>) {
    match node.attribute_node(name) {
        Some(a) => edits.push((a.range_value(), value)),
        None => {
            let at = node.range().start + 1 + node.tag_name().name().len();
            edits.push((at..at, format!(" {name}=\"{value}\"")));
        }
    }
}

fn remove(text: &str, node: Node<'_, '_>, name: &str, edits: &mut Vec<(Range<usize>, String)>) {
    if let Some(a) = node.attribute_node(name) {
        let range = a.range();
        let spaces = text[..range.start].len() - text[..range.start].trim_end().len();
        edits.push((range.start - spaces..range.end, String::new()));
    }
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|n| n.has_tag_name(name))
}

/// Where the children of an element begin; none for `<link name="x"/>`.
fn inside(text: &str, node: Node<'_, '_>) -> Option<usize> {
    let range = node.range();
    let end = node.attributes().map(|a| a.range().end).max().unwrap_or(range.start + 1);
    let close = end + text[end..range.end].find('>')?;
    (!text[..close].ends_with('/')).then_some(close + 1)
}

fn insert(text: &str, node: Node<'_, '_>, element: String, edits: &mut Vec<(Range<usize>, String)>) {
    match inside(text, node) {
        Some(at) => edits.push((at..at, element)),
        None => {
            let range = node.range();
            edits.push((range.end - 2..range.end, format!(">{element}</{}>", node.tag_name().name())));
        }
    }
}

fn urdf(text: &str, link: Node<'_, '_>, inertia: &LinkInertia, edits: &mut Vec<(Range<usize>, String)>) {
    let names = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
    let values = |i: &Matrix3<f64>| [i[(0, 0)], i[(0, 1)], i[(0, 2)], i[(1, 1)], i[(1, 2)], i[(2, 2)]];
    let Some(inertial) = child(link, "inertial") else {
        let tensor: Vec<String> = names
            .iter()
            .zip(values(&inertia.inertia_com_kgm2))
            .map(|(n, v)| format!("{n}=\"{}\"", number(v)))
            .collect();
        let element = format!(
            "<inertial><origin xyz=\"{}\" rpy=\"0 0 0\"/><mass value=\"{}\"/><inertia {}/></inertial>",
            vector(&inertia.com_m),
            number(inertia.mass_kg),
            tensor.join(" ")
        );
        insert(text, link, element, edits);
        return;
    };
    let rpy: Vec<f64> = child(inertial, "origin")
        .and_then(|o| o.attribute("rpy"))
        // none: reading the model has refused any other text here
        .map(|t| t.split_whitespace().filter_map(|w| w.parse().ok()).collect())
        .unwrap_or_default();
    let turn = match rpy.as_slice() {
        [roll, pitch, yaw] => Rotation3::from_euler_angles(*roll, *pitch, *yaw).into_inner(),
        _ => Matrix3::identity(),
    };
    let own = turn.transpose() * inertia.inertia_com_kgm2 * turn;
    match child(inertial, "origin") {
        Some(origin) => set(origin, "xyz", vector(&inertia.com_m), edits),
        None => insert(text, inertial, format!("<origin xyz=\"{}\" rpy=\"0 0 0\"/>", vector(&inertia.com_m)), edits),
    }
    match child(inertial, "mass") {
        Some(mass) => set(mass, "value", number(inertia.mass_kg), edits),
        None => insert(text, inertial, format!("<mass value=\"{}\"/>", number(inertia.mass_kg)), edits),
    }
    if let Some(tensor) = child(inertial, "inertia") {
        for (name, value) in names.iter().zip(values(&own)) {
            set(tensor, name, number(value), edits);
        }
    }
}

fn mjcf(text: &str, body: Node<'_, '_>, inertia: &LinkInertia, edits: &mut Vec<(Range<usize>, String)>) {
    let i = &inertia.inertia_com_kgm2;
    let full = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]].map(number).join(" ");
    let Some(inertial) = child(body, "inertial") else {
        let element = format!(
            "<inertial pos=\"{}\" mass=\"{}\" fullinertia=\"{full}\"/>",
            vector(&inertia.com_m),
            number(inertia.mass_kg)
        );
        insert(text, body, element, edits);
        return;
    };
    set(inertial, "pos", vector(&inertia.com_m), edits);
    set(inertial, "mass", number(inertia.mass_kg), edits);
    set(inertial, "fullinertia", full, edits);
    // MuJoCo takes a full tensor in the axes of the body only
    for name in ["diaginertia", "quat", "axisangle", "euler", "xyaxes", "zaxis"] {
        remove(text, inertial, name, edits);
    }
}

/// Multiplies mass and inertia of a link by a factor.
fn scale(body: Node<'_, '_>, format: Format, share: f64, edits: &mut Vec<(Range<usize>, String)>) {
    let Some(inertial) = child(body, "inertial") else { return };
    let (mass, tensor): (Option<Node<'_, '_>>, Option<Node<'_, '_>>) = match format {
        Format::Urdf => (child(inertial, "mass"), child(inertial, "inertia")),
        Format::Mjcf => (Some(inertial), Some(inertial)),
    };
    let names = ["value", "mass", "ixx", "ixy", "ixz", "iyy", "iyz", "izz", "fullinertia", "diaginertia"];
    let mut seen = Vec::new();
    for node in [mass, tensor].into_iter().flatten() {
        for a in node.attributes().filter(|a| names.contains(&a.name())) {
            if seen.contains(&a.range_value()) {
                continue;
            }
            seen.push(a.range_value());
            let scaled: Vec<String> =
                // none: reading the model has refused any other text here
                a.value().split_whitespace().filter_map(|w| w.parse::<f64>().ok()).map(|x| number(x * share)).collect();
            edits.push((a.range_value(), scaled.join(" ")));
        }
    }
}
