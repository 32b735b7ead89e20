//! Converts an object's specification into indices and rejects contradictions.

use crate::ScaleError;
use crate::object_spec::{ObjectFrame, ObjectJoint, ObjectSpec};

pub(super) struct Links<'a> {
    pub spec: &'a ObjectSpec,
    pub parents: Vec<Option<usize>>,
    /// Markers as (link, label), in order.
    pub markers: Vec<(usize, &'a str)>,
}

pub(super) fn error(spec: &ObjectSpec, link: &str, problem: impl Into<String>) -> ScaleError {
    ScaleError::Object { object: spec.name.clone(), link: link.into(), problem: problem.into() }
}

pub(super) fn read_links(spec: &ObjectSpec) -> Result<Links<'_>, ScaleError> {
    let mut parents = Vec::with_capacity(spec.links.len());
    let mut markers: Vec<(usize, &str)> = Vec::new();
    if spec.links.is_empty() {
        return Err(error(spec, "-", "the object has no links"));
    }
    for (i, link) in spec.links.iter().enumerate() {
        let fail = |problem: String| error(spec, &link.name, problem);
        if spec.links[..i].iter().any(|l| l.name == link.name) {
            return Err(fail("the name stands twice".into()));
        }
        let parent = match (&link.parent, i) {
            (None, 0) => None,
            (None, _) => return Err(fail("every link but the first needs a parent".into())),
            (Some(p), _) => Some(
                spec.links[..i]
                    .iter()
                    .position(|l| l.name == *p)
                    .ok_or_else(|| fail(format!("its parent `{p}` does not stand before it")))?,
            ),
        };
        match (parent, &link.joint, &link.frame) {
            (None, None, ObjectFrame::Markers { origin: Some(_), .. })
            | (Some(_), Some(ObjectJoint::Hinge { .. }), ObjectFrame::Hinge { .. })
            | (Some(_), Some(ObjectJoint::Ball), ObjectFrame::Markers { origin: None, .. }) => {}
            (None, Some(_), _) => return Err(fail("the first link has no joint".into())),
            (None, ..) => return Err(fail("the first link's frame is defined by markers, with an origin".into())),
            (Some(_), None, _) => return Err(fail("a joint to its parent is missing".into())),
            (Some(_), Some(ObjectJoint::Hinge { .. }), _) => {
                return Err(fail("a link on a hinge has a frame `by: hinge`".into()));
            }
            (Some(_), Some(ObjectJoint::Ball), _) => {
                return Err(fail("a link on a ball joint has a frame `by: markers` without an origin".into()));
            }
        }
        if link.markers.len() < 3 {
            return Err(fail(format!("{} markers; at least three are needed", link.markers.len())));
        }
        for label in &link.markers {
            if markers.iter().any(|(_, l)| l == label) {
                return Err(fail(format!("marker `{label}` stands twice")));
            }
            markers.push((i, label));
        }
        let known = |label: &String| {
            if link.markers.contains(label) {
                Ok(())
            } else {
                Err(fail(format!("its frame names `{label}`, which is not its marker")))
            }
        };
        match &link.frame {
            ObjectFrame::Markers { origin, y_axis, z_side } => {
                origin.iter().chain(y_axis).chain([z_side]).try_for_each(known)?;
            }
            ObjectFrame::Hinge { x_plane, .. } => known(x_plane)?,
        }
        parents.push(parent);
    }
    if !(spec.total_mass_kg > 0.0 && spec.total_mass_kg.is_finite()) {
        return Err(error(spec, "-", format!("a total mass of {} kg", spec.total_mass_kg)));
    }
    Ok(Links { spec, parents, markers })
}
