//! Text of each base parameter's formula.

use crate::base_parameters::{JointAxes, inertia_index};
use crate::{JointKind, Model};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

const AXES: [&str; 3] = ["x", "y", "z"];

/// A sum of products, each with its sign.
#[derive(Debug, Clone, Default)]
struct Sum(Vec<(bool, String)>);

impl Sum {
    fn add(&mut self, negative: bool, factors: &[&str]) {
        self.0.push((negative, factors.iter().filter(|f| !f.is_empty()).copied().collect::<Vec<_>>().join("·")));
    }
    fn minus(mut self, other: Self) -> Self {
        self.0.extend(other.0.into_iter().map(|(negative, text)| (!negative, text)));
        self
    }
    fn text(&self) -> String {
        let mut out = String::new();
        for (k, (negative, term)) in self.0.iter().enumerate() {
            out += match (k, negative) {
                (0, false) => "",
                (0, true) => "−",
                (_, false) => " + ",
                (_, true) => " − ",
            };
            out += term;
        }
        out
    }
}

/// Writes formulas for one tree.
pub(crate) struct Formulas<'a> {
    model: &'a Model,
    children: Vec<Vec<usize>>,
    /// Symbols that denote sums: link and φ index.
    symbols: BTreeMap<String, (usize, usize)>,
}

impl<'a> Formulas<'a> {
    pub(crate) fn of(model: &'a Model) -> Self {
        let mut children = vec![Vec::new(); model.n_links()];
        for (i, link) in model.links.iter().enumerate() {
            if let Some(parent) = link.parent {
                children[parent].push(i);
            }
        }
        let mut formulas = Self { model, children, symbols: BTreeMap::new() };
        let composite = (0..model.n_links()).filter(|i| !formulas.children[*i].is_empty());
        formulas.symbols =
            composite.flat_map(|i| (0..10).map(move |k| (i, k))).map(|(i, k)| (formulas.whole(i, k), (i, k))).collect();
        formulas
    }

    /// Formula of a kept parameter of link `i`: φ index and the one subtracted. Symbols of sums are
    /// defined after it.
    pub(crate) fn kept(&self, i: usize, of: (usize, Option<usize>)) -> String {
        let turned = match &self.model.links[i].joint.kind {
            JointKind::Revolute(axis) => match JointAxes::of(axis) {
                JointAxes::Turned(m) => Some(m),
                JointAxes::Cyclic(_) => None,
            },
            _ => None,
        };
        let side = |k: usize| match turned {
            Some(_) => {
                let mut sum = Sum::default();
                sum.add(false, &[&format!("{}'", self.whole(i, k))]);
                sum
            }
            None => self.expand(i, k),
        };
        let mut sum = side(of.0);
        if let Some(subtracted) = of.1 {
            sum = sum.minus(side(subtracted));
        }
        let mut text = sum.text();
        self.define_symbols(&mut text);
        if let Some(m) = turned {
            let row = |k: usize| format!("({:.4}, {:.4}, {:.4})", m[(k, 0)], m[(k, 1)], m[(k, 2)]);
            text += &format!("; x' = {}, y' = {}, z' = {}", row(0), row(1), row(2));
        }
        text
    }

    /// Appends `; M1 = m1 + m2` and the like for every symbol of a sum in `text`, and recursively
    /// for the symbols in those.
    fn define_symbols(&self, text: &mut String) {
        let mut defined: Vec<String> = Vec::new();
        let mut from = 0;
        while from < text.len() {
            let tokens: Vec<String> =
                text[from..].split(|c: char| !c.is_ascii_alphanumeric() && c != '\'').map(str::to_owned).collect();
            from = text.len();
            for token in tokens.into_iter().filter(|t| !t.is_empty()) {
                if defined.contains(&token) {
                    continue;
                }
                if let Some((i, k)) = self.symbols.get(&token) {
                    *text += &format!("; {token} = {}", self.expand(*i, *k).text());
                } else if let Some(i) = self.whole_body(&token) {
                    *text += &format!("; {token}: of link {i} with what {} gives", self.list(&self.children[i]));
                }
                defined.push(token);
            }
        }
    }

    /// The link to which a symbol of a regrouped tensor (`J2`), vector (`MC2`) or rotated entry
    /// (`J2xx'`, `MC2z'`) belongs.
    fn whole_body(&self, token: &str) -> Option<usize> {
        let rest = token.strip_prefix("MC").or_else(|| token.strip_prefix('J'))?;
        let rest = match rest.strip_suffix('\'') {
            Some(turned) => turned.trim_end_matches(['x', 'y', 'z']),
            None => rest,
        };
        rest.parse().ok()
    }

    fn list(&self, links: &[usize]) -> String {
        links.iter().map(|i| format!("link {i}")).collect::<Vec<_>>().join(" and ")
    }

    /// A link and all its descendants.
    fn subtree(&self, i: usize) -> Vec<usize> {
        let mut out = vec![i];
        let mut next = 0;
        while next < out.len() {
            out.extend(&self.children[out[next]]);
            next += 1;
        }
        out.sort_unstable();
        out
    }

    /// Symbol of φ entry `k` of link `i` alone.
    fn own(i: usize, k: usize) -> String {
        match k {
            0 => format!("m{i}"),
            1..=3 => format!("mc{i}{}", AXES[k - 1]),
            _ => format!("I{i}{}", ["xx", "yy", "zz", "yz", "zx", "xy"][k - 4]),
        }
    }

    /// Symbol of φ entry `k` of link `i` with everything regrouped into it.
    fn whole(&self, i: usize, k: usize) -> String {
        if self.children[i].is_empty() {
            return Self::own(i, k);
        }
        match k {
            0 => format!("M{i}"),
            1..=3 => format!("MC{i}{}", AXES[k - 1]),
            _ => format!("J{i}{}", ["xx", "yy", "zz", "yz", "zx", "xy"][k - 4]),
        }
    }

    /// φ entry `k` of link `i` with the contributions of its children.
    fn expand(&self, i: usize, k: usize) -> Sum {
        let mut sum = Sum::default();
        if k == 0 {
            // Masses are short enough to write out.
            for link in self.subtree(i) {
                sum.add(false, &[&Self::own(link, 0)]);
            }
            return sum;
        }
        sum.add(false, &[&Self::own(i, k)]);
        for &child in &self.children[i] {
            self.give(child, k, &mut sum);
        }
        sum
    }

    /// Adds the contribution of `child` to entry `k` of its parent.
    fn give(&self, child: usize, k: usize, sum: &mut Sum) {
        let joint = &self.model.links[child].joint;
        let rotation = joint.parent_from_joint.rotation.to_rotation_matrix().into_inner();
        let mass = self.whole(child, 0);
        point_mass(&mass, child, k, sum);
        match &joint.kind {
            JointKind::Free | JointKind::Spherical => {}
            JointKind::Revolute(axis) => {
                let axes = JointAxes::of(axis);
                let (along, across) = match axes {
                    JointAxes::Cyclic(first) => {
                        (self.whole(child, 1 + (first + 2) % 3), self.whole(child, 4 + (first + 1) % 3))
                    }
                    JointAxes::Turned(_) => {
                        (format!("{}'", self.whole(child, 3)), format!("{}'", self.whole(child, 5)))
                    }
                };
                let axis_in_parent = rotation * axes.matrix().row(2).transpose();
                axis_line(&along, &across, child, &axis_in_parent, k, sum);
            }
            JointKind::Prismatic(_) => self.turned_inertia(child, &rotation, k, sum),
            JointKind::Fixed => {
                self.turned_first_moment(child, &rotation, k, sum);
                self.turned_inertia(child, &rotation, k, sum);
            }
        }
    }

    /// Inertia of a child in parent axes.
    fn turned_inertia(&self, child: usize, rotation: &Matrix3<f64>, k: usize, sum: &mut Sum) {
        if k < 4 {
            return;
        }
        if *rotation == Matrix3::identity() {
            sum.add(false, &[&self.whole(child, k)]);
        } else {
            let name = if self.children[child].is_empty() { "I" } else { "J" };
            let pair = ["xx", "yy", "zz", "yz", "zx", "xy"][k - 4];
            sum.add(false, &[&format!("(R{child}·{name}{child}·R{child}ᵀ){pair}")]);
        }
    }

    /// First moment of a rigidly fixed child in parent axes, and its part in the inertia.
    fn turned_first_moment(&self, child: usize, rotation: &Matrix3<f64>, k: usize, sum: &mut Sum) {
        let name = |axis: usize| {
            if *rotation == Matrix3::identity() {
                self.whole(child, 1 + axis)
            } else {
                let symbol = if self.children[child].is_empty() { "mc" } else { "MC" };
                format!("(R{child}·{symbol}{child}){}", AXES[axis])
            }
        };
        let p = |axis: usize| format!("p{child}{}", AXES[axis]);
        match k {
            1..=3 => sum.add(false, &[&name(k - 1)]),
            4..=6 => {
                let (b, c) = ((k - 3) % 3, (k - 2) % 3);
                sum.add(false, &["2", &name(b), &p(b)]);
                sum.add(false, &["2", &name(c), &p(c)]);
            }
            7..=9 => {
                let (b, c) = off_diagonal(k);
                sum.add(true, &[&name(b), &p(c)]);
                sum.add(true, &[&name(c), &p(b)]);
            }
            _ => {}
        }
    }
}

/// Row and column of an off-diagonal φ entry.
fn off_diagonal(k: usize) -> (usize, usize) {
    let pair = [(1, 2), (2, 0), (0, 1)][k - 7];
    debug_assert_eq!(inertia_index(pair.0, pair.1), k);
    pair
}

/// A point mass at the origin `p` of the child.
fn point_mass(mass: &str, child: usize, k: usize, sum: &mut Sum) {
    let p = |axis: usize| format!("p{child}{}", AXES[axis]);
    match k {
        1..=3 => sum.add(false, &[mass, &p(k - 1)]),
        4..=6 => {
            let (b, c) = ((k - 3) % 3, (k - 2) % 3);
            let (b, c) = (b.min(c), b.max(c));
            sum.add(false, &[mass, &format!("({}² + {}²)", p(b), p(c))]);
        }
        7..=9 => {
            let (b, c) = off_diagonal(k);
            sum.add(true, &[mass, &p(b), &p(c)]);
        }
        _ => {}
    }
}

/// Mass distributed along the axis through `p`: first moment `along`, second moment `across` (as
/// diag(·, ·, 0) about the axis). Components of the axis that are exactly 0 or 1 simplify the text.
fn axis_line(along: &str, across: &str, child: usize, axis: &Vector3<f64>, k: usize, sum: &mut Sum) {
    let p = |i: usize| format!("p{child}{}", AXES[i]);
    let (is_zero, is_one) = (|i: usize| axis[i] == 0.0, |i: usize| axis[i] == 1.0);
    let a = |i: usize| if is_one(i) { String::new() } else { format!("a{child}{}", AXES[i]) };
    match k {
        1..=3 if !is_zero(k - 1) => sum.add(false, &[along, &a(k - 1)]),
        4..=6 => {
            let (b, c) = ((k - 3) % 3, (k - 2) % 3);
            for i in [b.min(c), b.max(c)] {
                if !is_zero(i) {
                    sum.add(false, &["2", along, &p(i), &a(i)]);
                    let square = if is_one(i) { String::new() } else { format!("{}²", a(i)) };
                    sum.add(false, &[across, &square]);
                }
            }
        }
        7..=9 => {
            let (b, c) = off_diagonal(k);
            if !is_zero(c) {
                sum.add(true, &[along, &p(b), &a(c)]);
            }
            if !is_zero(b) {
                sum.add(true, &[along, &p(c), &a(b)]);
            }
            if !is_zero(b) && !is_zero(c) {
                sum.add(true, &[across, &a(b), &a(c)]);
            }
        }
        _ => {}
    }
}
