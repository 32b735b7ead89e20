//! Compares identified segment parameters with the anthropometric tables.

use super::parameters::link_table;
use super::story::Story;
use aloft_body::{LinkInertia, Subject};
use aloft_identify::{LinkEstimate, Parameters, half_of};
use aloft_page::{Block, Dots, Figure, Section, Words};
use aloft_scale::{Anthropometry, StaticAnatomy, attach_prior};
use aloft_study::catalog;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use std::path::Path;

/// The tables of the catalogue.
const TABLES: [(&str, &str); 3] = [("de_leva", "de Leva"), ("dumas", "Dumas"), ("winter", "Winter")];

/// The section; none without links.
///
/// # Errors
/// The anatomy of the body is there and cannot be read.
pub fn section(story: &Story<'_>, p: &Parameters) -> Result<Option<Section>, PipelineError> {
    if p.links.is_empty() {
        return Ok(None);
    }
    let tables = tables(story)?;
    let names: Vec<String> = p.links.iter().map(|l| l.name.replace('_', " ")).collect();
    let person = !tables.is_empty();
    let figure = |words: Words<'_>,
                  unit: &str,
                  own: &dyn Fn(&LinkEstimate) -> (f64, f64),
                  other: &dyn Fn(&LinkInertia) -> f64| {
        let (values, half): (Vec<f64>, Vec<f64>) = p.links.iter().map(own).unzip();
        let mut kinds = vec![Dots::with_half("identified", values, &half)];
        if person {
            kinds.extend(
                tables.iter().map(|(title, links)| Dots::new(title.clone(), links.iter().map(other).collect())),
            );
        } else {
            kinds.push(Dots::new("tables", p.links.iter().map(|l| other(&l.prior)).collect()));
        }
        Block::from(Figure::dots(words, unit, &names, &kinds, &[]))
    };
    let half = |ci95: Option<[f64; 2]>| half_of(ci95).unwrap_or(f64::NAN);
    let radius = |mass: f64, about_z: f64| (about_z.max(0.0) / mass).sqrt();
    let mut blocks = vec![
        figure(
            Words::new(
                "Mass of each segment",
                "Identified value with its 95 % interval, and what the tables give for this sex, height and mass. Where the interval is as wide as \
                 the tables are apart, the motion did not determine the value; masses of single segments are the least observable in flight.",
            ),
            "mass, kg",
            &|l| (l.mass_kg, half(l.ci95.mass_kg)),
            &|i| i.mass_kg,
        ),
        figure(
            Words::new(
                "Centre of mass: distance from the segment's origin",
                "The origin is the proximal joint centre (of the pelvis, the point midway between the hips).",
            ),
            "distance, m",
            &|l| {
                let r = nalgebra::Vector3::from(l.com_m);
                let halves = nalgebra::Vector3::from(l.ci95.com_m.map(half));
                let along = if r.norm() > 1e-9 { (r / r.norm()).component_mul(&halves) } else { halves };
                (r.norm(), along.norm())
            },
            &|i| i.com_m.norm(),
        ),
        figure(
            Words::new(
                "Radius of gyration about the link's z axis",
                "About the centre of mass; for a person z points to the right: the axis of flexion.",
            ),
            "radius of gyration, m",
            &|l| {
                let r = radius(l.mass_kg, l.inertia_kgm2[2][2]);
                (r, 0.5 * r * half(l.ci95.inertia_kgm2[2]) / l.inertia_kgm2[2][2])
            },
            &|i| radius(i.mass_kg, i.inertia_com_kgm2[(2, 2)]),
        ),
    ];
    blocks.push(link_table(p).into());
    let lead = if person {
        "The tables are means of other people, applied to this person's joint centres; the spread between tables is a lower bound of their error."
    } else {
        "For an object, `tables` stands for what its description says."
    };
    Ok(Some(Section::new(
        "segments-identified",
        if person { "Segments against the tables" } else { "Links against the description" },
        lead,
        blocks,
    )))
}

/// Inertias of the links by each table, for this person's geometry; empty for objects.
fn tables(story: &Story<'_>) -> Result<Vec<(String, Vec<LinkInertia>)>, PipelineError> {
    let anatomy = read_json_if_there(&story.ws.place("scale", WHOLE_STUDY).join("anatomy.json"))?;
    let subject = story.subject.as_ref().filter(|_| !story.session.is_rigid());
    let (Some(subject), Some(anatomy)) = (subject, anatomy) else { return Ok(Vec::new()) };
    let anatomy: StaticAnatomy = anatomy;
    let own = &story.session.anthropometry;
    let used = TABLES.iter().find(|(name, _)| *name == own.name).map_or(own.title.as_str(), |t| t.1);
    let mut out = vec![(format!("{used} (in use)"), subject.prior.clone())];
    for (name, title) in TABLES.iter().filter(|(name, _)| *name != own.name) {
        let table = catalog::load::<Anthropometry>("anthropometry", name, Path::new("."))?;
        let mut other: Subject = subject.clone();
        // none: a table that lacks a segment of this body is not compared
        if attach_prior(&mut other, &table, &anatomy).is_ok() {
            out.push(((*title).to_owned(), other.prior));
        }
    }
    Ok(out)
}
