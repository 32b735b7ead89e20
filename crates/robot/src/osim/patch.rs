//! Identified inertias back into the text of an OpenSim model. Only mass, mass centre and inertia
//! of bodies change: order, comments and layout stay.

use super::model::OsimModel;
use super::read;
use super::rigid::RigidTree;
use crate::RobotError;
use crate::patch::{Patched, number};
use aloft_body::LinkInertia;
use roxmltree::Node;
use std::ops::Range;

/// Writes the inertias of the rigid tree's links (link frames, in order) into the text that `osim`
/// was read from. Bodies that ride on others keep the file's inertia times `scale`. `provenance` is
/// written as a comment before the outermost element.
///
/// # Errors
/// [`RobotError::Model`] if the text is not that of the model, or an inertia is not that of any
/// body.
pub fn patch(
    text: &str,
    osim: &OsimModel,
    tree: &RigidTree,
    links: &[LinkInertia],
    scale: f64,
    provenance: &str,
) -> Result<Patched, RobotError> {
    let problem = |p: String| RobotError::model(&osim.file, p);
    let bodies = tree.of_bodies(osim, links, scale).map_err(problem)?;
    let document = crate::xml::parse(&osim.file, text)?;
    let root = document.root_element();
    let model = read::child(root, "Model").ok_or_else(|| problem("it holds no model".to_owned()))?;
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    let mut written = Vec::new();
    for node in read::objects(model, "BodySet") {
        let Some(name) = node.attribute("name") else { continue };
        let Some((_, inertia)) = bodies.iter().find(|b| b.0 == name) else { continue };
        let i = &inertia.inertia_com_kgm2;
        let tensor = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]];
        let com: Vec<f64> = inertia.com_m.iter().copied().collect();
        for (what, values) in [("mass", vec![inertia.mass_kg]), ("mass_center", com), ("inertia", tensor.to_vec())] {
            let list = values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(" ");
            set(text, node, what, &list, &mut edits);
        }
        written.push(name.to_owned());
    }
    if written.len() != bodies.len() {
        return Err(problem(format!("it holds {} of the {} bodies of the model", written.len(), bodies.len())));
    }
    let comment = provenance.replace("--", "- -");
    let start = root.range().start;
    edits.push((start..start, format!("<!-- {} -->\n", comment.trim())));
    edits.sort_by_key(|e| std::cmp::Reverse((e.0.start, e.0.end)));
    let mut out = text.to_owned();
    for (range, new) in edits {
        out.replace_range(range, &new);
    }
    let remarks = tree.merged.iter().filter(|m| m.why != "welded");
    let remarks = remarks.map(|m| format!("`{}` keeps its inertia: {}", m.body, m.why)).collect();
    Ok(Patched { text: out, written, remarks })
}

/// Replaces the text of a child element, or adds the element.
fn set(text: &str, body: Node<'_, '_>, name: &str, value: &str, edits: &mut Vec<(Range<usize>, String)>) {
    let Some(node) = read::child(body, name) else {
        // OpenSim reads properties in any order
        let inside = text[body.range()].find('>').map(|at| body.range().start + at + 1);
        if let Some(at) = inside {
            edits.push((at..at, format!("<{name}>{value}</{name}>")));
        }
        return;
    };
    match node.children().find(Node::is_text) {
        Some(inner) => edits.push((inner.range(), value.to_owned())),
        None => edits.push((node.range(), format!("<{name}>{value}</{name}>"))),
    }
}
