//! Targets of effects, and the sets of targets that effects commonly offer.

use crate::Scene;
use serde::{Deserialize, Serialize};

/// Target of an effect: one of the choices from which a ranking selects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// The whole body (or all plates) with one set of coefficients.
    Body,
    /// The whole body, with one coefficient for every link.
    EveryLink,
    /// The whole body, with coefficients for the shape of every link.
    Shape,
    /// One link, by index.
    Link(usize),
    /// One plate, by index.
    Plate(usize),
    /// One joint of a robot, by the index of the link that it carries.
    Joint(usize),
}

impl Target {
    /// Short name for columns and reports: empty for the body, `links`, `shape`, a link's or
    /// joint's name, `plate1` …
    pub fn label(&self, scene: &Scene) -> String {
        match self {
            Self::Body => String::new(),
            Self::EveryLink => "links".to_owned(),
            Self::Shape => "shape".to_owned(),
            Self::Link(i) => scene.model.links.get(*i).map_or_else(|| format!("link{i}"), |l| l.name.clone()),
            Self::Plate(i) => format!("plate{}", i + 1),
            Self::Joint(i) => scene.joint_name(*i).map_or_else(|| format!("joint{i}"), str::to_owned),
        }
    }

    /// Index of its link; the root's if the target has no link.
    pub fn link(self) -> usize {
        match self {
            Self::Link(i) | Self::Joint(i) => i,
            _ => 0,
        }
    }

    /// True if the target includes the plate.
    pub fn includes_plate(self, plate: usize) -> bool {
        match self {
            Self::Plate(i) => i == plate,
            _ => true,
        }
    }

    /// The whole body.
    pub fn body() -> Vec<Self> {
        vec![Self::Body]
    }

    /// Every link.
    pub fn links(scene: &Scene) -> Vec<Self> {
        (0..scene.model.n_links()).map(Self::Link).collect()
    }

    /// Every hinge and slide whose torque a robot's log may hold.
    pub fn joints(scene: &Scene) -> Vec<Self> {
        (1..scene.model.n_links()).filter(|i| scene.joint_name(*i).is_some()).map(Self::Joint).collect()
    }

    /// The whole body, and one coefficient per link if there are two or three links.
    pub fn body_or_links(scene: &Scene) -> Vec<Self> {
        if (2..=3).contains(&scene.model.n_links()) { vec![Self::Body, Self::EveryLink] } else { vec![Self::Body] }
    }

    /// The same, and coefficients for the shape of each link if there are two or three links.
    pub fn body_links_or_shape(scene: &Scene) -> Vec<Self> {
        let mut out = Self::body_or_links(scene);
        if out.len() > 1 {
            out.push(Self::Shape);
        }
        out
    }

    /// The whole body if there are plates; nothing without plates.
    pub fn body_on_plates(scene: &Scene) -> Vec<Self> {
        if scene.n_plates() > 0 { vec![Self::Body] } else { Vec::new() }
    }

    /// Every plate.
    pub fn plates(scene: &Scene) -> Vec<Self> {
        (0..scene.n_plates()).map(Self::Plate).collect()
    }

    /// All plates together, and each plate alone.
    pub fn all_or_one_plate(scene: &Scene) -> Vec<Self> {
        match scene.n_plates() {
            0 => Vec::new(),
            1 => vec![Self::Body],
            n => std::iter::once(Self::Body).chain((0..n).map(Self::Plate)).collect(),
        }
    }
}
