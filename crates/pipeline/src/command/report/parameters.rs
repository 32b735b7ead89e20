//! What was identified, beside the prior.

use super::words::{number, three};
use crate::command::parameters::ParametersView;
use aloft_report::{Block, Figure, Section, Table};

pub fn identified(found: &ParametersView) -> Section {
    let p = &found.parameters;
    let rows = p
        .base
        .iter()
        .map(|b| {
            vec![
                b.name.clone(),
                number(b.value),
                number(1.96 * b.se),
                b.prior.map_or("–".into(), number),
                b.unit.clone(),
                format!("{:?}", b.seen).to_lowercase(),
                b.formula.clone(),
            ]
        })
        .collect();
    let mut blocks = vec![Block::Text {
        text: format!(
            "Singular values: σ₁ {}, σ_N−1 {}, σ_N {}. Estimator: {}; intervals: {}.",
            number(p.sigma.max),
            number(p.sigma.second),
            number(p.sigma.min),
            p.estimator.name(),
            p.se_from
        ),
    }];
    for e in &p.effects {
        blocks.push(Block::Text { text: format!("Effect {}: {} ± {}", e.name, number(e.value), number(1.96 * e.se)) });
    }
    if !p.links.is_empty() {
        let names: Vec<String> = p.links.iter().map(|l| l.name.clone()).collect();
        let masses = p.links.iter().map(|l| l.mass_kg).collect();
        let spread = p.links.iter().map(|l| 1.96 * l.sd.mass_kg).collect();
        let prior = p.links.iter().map(|l| l.prior.mass_kg).collect();
        blocks.push(Block::Figure {
            figure: Figure::bars(
                "Mass of each link: identified (95 % interval) and prior",
                "kg",
                &names,
                &[("identified".to_owned(), masses, spread), ("prior".to_owned(), prior, vec![f64::NAN; names.len()])],
            ),
        });
        blocks.push(Block::Table {
            table: Table {
                caption: "Physically consistent links".into(),
                header: ["link", "mass, kg", "prior, kg", "centre of mass, m", "prior, m", "in words"]
                    .map(str::to_owned)
                    .to_vec(),
                rows: p
                    .links
                    .iter()
                    .map(|l| {
                        vec![
                            l.name.clone(),
                            number(l.mass_kg),
                            number(l.prior.mass_kg),
                            three(&l.com_m),
                            three(&l.prior.com_m.into()),
                            l.words.clone(),
                        ]
                    })
                    .collect(),
            },
        });
    }
    blocks.push(Block::Table {
        table: Table {
            caption: "Base parameters with the regrouping".into(),
            header: ["parameter", "value", "± 95 %", "prior", "unit", "seen", "regrouping"].map(str::to_owned).to_vec(),
            rows,
        },
    });
    Section {
        id: "parameters".into(),
        title: "Identified parameters".into(),
        lead: "The combinations of mass, first moment and inertia that motion in the air can tell, and links that agree with them.".into(),
        blocks,
    }
}
