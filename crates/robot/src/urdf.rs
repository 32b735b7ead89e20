//! What of a URDF file is read: links, joints, inertias and collision geometry.
//!
//! Visual elements, materials and sections of simulators are no physics. They are blanked out
//! before the file is read, so that what is wrong in them stops nobody (`<texture/>` without a file
//! in models of several robots), and lines keep their numbers. Numbers are checked here, because
//! the reader's own errors name no line.

use crate::RobotError;
use crate::xml::parse;
use roxmltree::Node;

/// Elements that are not read, wherever they are.
const NOT_READ: [&str; 5] = ["visual", "material", "gazebo", "transmission", "sensor"];
/// Attributes that hold a fixed number of numbers.
const NUMBERS: [(&str, usize); 24] = [
    ("xyz", 3),
    ("rpy", 3),
    ("size", 3),
    ("scale", 3),
    ("ixx", 1),
    ("ixy", 1),
    ("ixz", 1),
    ("iyy", 1),
    ("iyz", 1),
    ("izz", 1),
    ("radius", 1),
    ("length", 1),
    ("lower", 1),
    ("upper", 1),
    ("effort", 1),
    ("velocity", 1),
    ("damping", 1),
    ("friction", 1),
    ("multiplier", 1),
    ("offset", 1),
    ("rising", 1),
    ("falling", 1),
    ("k_velocity", 1),
    ("k_position", 1),
];

/// The text without what is not read.
///
/// # Errors
/// [`RobotError::Model`], with the line: text that is not XML, an unexpanded xacro file, an
/// attribute that is not the numbers that it has to be.
pub(crate) fn plain(file: &str, text: &str) -> Result<String, RobotError> {
    let document = parse(file, text)?;
    let at = |node: Node<'_, '_>, problem: String| RobotError::Model {
        file: file.to_owned(),
        line: Some(document.text_pos_at(node.range().start).row),
        problem,
    };
    let mut names: Vec<(&str, &str)> = Vec::new();
    let mut out = text.as_bytes().to_vec();
    let not_read = |node: Node<'_, '_>| NOT_READ.contains(&node.tag_name().name());
    for node in document.descendants().filter(Node::is_element) {
        if node.tag_name().namespace().is_some_and(|n| n.contains("xacro")) {
            let name = file.rsplit('/').next().unwrap_or(file);
            return Err(at(
                node,
                format!(
                    "`<xacro:{}>`: this is a xacro file, expected URDF: expand it (`xacro {name} > model.urdf`) and name the result",
                    node.tag_name().name()
                ),
            ));
        }
        if node.ancestors().skip(1).any(not_read) {
            continue;
        }
        if not_read(node) {
            out[node.range()].iter_mut().filter(|b| **b != b'\n').for_each(|b| *b = b' ');
            continue;
        }
        let tag = node.tag_name().name();
        if node.parent_element().is_some_and(|p| p == document.root_element()) && ["link", "joint"].contains(&tag) {
            let own = (tag, node.attribute("name").unwrap_or_default());
            if names.contains(&own) {
                return Err(at(node, format!("the {tag} `{}` is there twice: names have to differ", own.1)));
            }
            names.push(own);
        }
        if let Some(name) =
            ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].into_iter().find(|n| tag == "inertia" && !node.has_attribute(*n))
        {
            return Err(at(node, format!("<inertia> has no `{name}`, expected ixx, ixy, ixz, iyy, iyz and izz")));
        }
        if tag == "inertial" && node.children().filter(Node::is_element).all(|n| n.tag_name().name() != "inertia") {
            return Err(at(node, "<inertial> has no <inertia>".to_owned()));
        }
        for (name, count) in NUMBERS {
            let Some(value) = node.attribute(name) else { continue };
            // none: what is no number is counted
            let numbers = value.split_whitespace().filter(|t| t.parse::<f64>().is_ok_and(f64::is_finite)).count();
            if numbers != count || value.split_whitespace().count() != count {
                let expected = if count == 1 { "a number".to_owned() } else { format!("{count} numbers") };
                return Err(at(
                    node,
                    format!("`{name}` of <{}> is `{value}`, expected {expected}", node.tag_name().name()),
                ));
            }
        }
        if node.tag_name().name() == "mass"
            // none: what is no number is an error
            && let Some(value) = node.attribute("value").filter(|v| !v.trim().parse::<f64>().is_ok_and(f64::is_finite))
        {
            return Err(at(node, format!("`value` of <mass> is `{value}`, expected a number")));
        }
    }
    if !names.iter().any(|n| n.0 == "link") {
        return Err(RobotError::model(
            file,
            "it has no <link>: was a xacro file expanded without its arguments?".to_owned(),
        ));
    }
    String::from_utf8(out).map_err(|e| RobotError::model(file, e.to_string()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    const LINK: &str = r#"<link name="a"><inertial><origin xyz="0 0 0"/><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual><geometry><mesh filename="ü.stl"/></geometry>
<material name="m"><texture/></material></visual></link>"#;

    fn of(body: &str) -> Result<String, RobotError> {
        plain("r.urdf", &format!("<robot name=\"r\" xmlns:xacro=\"http://ros.org/wiki/xacro\">\n{body}\n</robot>"))
    }

    #[test]
    fn what_is_not_read_stops_nobody() {
        let text = of(LINK).unwrap();
        assert!(!text.contains("texture") && text.contains("<mass value=\"1\"/>"));
        assert_eq!(text.lines().count(), 6);
        assert!(urdf_rs::read_from_string(&text).is_ok());
    }

    #[test]
    fn errors_name_line_and_remedy() {
        let cases = [
            (
                LINK.replace("ixx=\"1\"", "ixx=\"one\""),
                "r.urdf, line 3: `ixx` of <inertia> is `one`, expected a number",
            ),
            (LINK.replace("0 0 0", "0 0"), "r.urdf, line 2: `xyz` of <origin> is `0 0`, expected 3 numbers"),
            (LINK.replace("value=\"1\"", "value=\"${m}\""), "r.urdf, line 2: `value` of <mass> is `${m}`"),
            (LINK.replace(" ixy=\"0\"", ""), "r.urdf, line 3: <inertia> has no `ixy`"),
            (format!("{LINK}\n{LINK}"), "r.urdf, line 6: the link `a` is there twice"),
            (String::new(), "r.urdf: it has no <link>"),
            ("<xacro:include filename=\"x\"/>".to_owned(), "r.urdf, line 2: `<xacro:include>`: this is a xacro file"),
        ];
        for (body, expected) in cases {
            let error = of(&body).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
