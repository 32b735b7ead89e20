//! The page: sections of cards, text, tables and figures, rendered with one template.

use crate::Figure;
use minijinja::{AutoEscape, Environment, context};
use serde::Serialize;

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The template does not fit what it is given.
    #[error("the report's template: {0}")]
    Template(#[from] minijinja::Error),
    /// The plotting library's script was not found in its package.
    #[error("the plotting script is missing from the build")]
    Script,
}

/// A traffic light; always shown with its word, never as colour alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// As it should be.
    Good,
    /// Usable, with a remark.
    Fair,
    /// Not to be relied on.
    Poor,
    /// Neither good nor bad.
    Neutral,
}

/// One figure of merit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Card {
    /// What it is.
    pub label: String,
    /// Its value with unit.
    pub value: String,
    /// A line below, for scale.
    pub note: String,
    /// Judgement.
    pub light: Light,
}

/// A table of text.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Table {
    /// Caption.
    pub caption: String,
    /// Column heads.
    pub header: Vec<String>,
    /// Rows; the first cell of each is its name.
    pub rows: Vec<Vec<String>>,
}

/// One piece of a section.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Block {
    /// A paragraph.
    Text {
        /// Plain text.
        text: String,
    },
    /// A remark that should not be missed.
    Remark {
        /// Plain text.
        text: String,
        /// Judgement.
        light: Light,
    },
    /// Figures of merit side by side.
    Cards {
        /// The cards.
        cards: Vec<Card>,
    },
    /// A table.
    Table {
        /// The table.
        table: Table,
    },
    /// A chart.
    Figure {
        /// The chart.
        figure: Figure,
    },
    /// Commands to type.
    Commands {
        /// One a line.
        lines: Vec<String>,
    },
}

/// A section with its heading.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Section {
    /// Identifier in links.
    pub id: String,
    /// Heading.
    pub title: String,
    /// One sentence below the heading.
    pub lead: String,
    /// Contents.
    pub blocks: Vec<Block>,
}

/// A whole page.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Page {
    /// Title.
    pub title: String,
    /// Line below the title.
    pub subtitle: String,
    /// Sections in order.
    pub sections: Vec<Section>,
    /// Small print: versions, hashes.
    pub footer: Vec<String>,
}

fn plotting_script() -> Result<String, ReportError> {
    // the package joins the plotting library and a formula renderer (2 MB, unused here); keep the first
    const END: &str = "</script>";
    let both = plotly::Plot::offline_js_sources();
    let end = both.find(END).ok_or(ReportError::Script)?;
    Ok(both[..end + END.len()].to_owned())
}

/// Renders the page as one HTML text that needs nothing else.
pub fn render(page: &Page) -> Result<String, ReportError> {
    let mut env = Environment::new();
    env.set_auto_escape_callback(|_| AutoEscape::Html);
    env.add_template("page.html", include_str!("../templates/page.html"))?;
    let figures: Vec<_> = page
        .sections
        .iter()
        .flat_map(|s| &s.blocks)
        .filter_map(|b| match b {
            Block::Figure { figure } => Some(figure.to_plot()),
            _ => None,
        })
        .collect();
    // `</` inside a script element would end it
    let figures = serde_json::Value::Array(figures).to_string().replace("</", "<\\/");
    let html = env.get_template("page.html")?.render(context! {
        page => minijinja::value::Serde(page),
        figures => figures,
        plotting_script => plotting_script()?,
        style => include_str!("../templates/page.css"),
        script => include_str!("../templates/page.js"),
    })?;
    Ok(html)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Series;

    #[test]
    fn prop_page_is_self_contained_and_escaped() {
        let page = Page {
            title: "S <01>".to_owned(),
            sections: vec![Section {
                id: "a".to_owned(),
                title: "A".to_owned(),
                blocks: vec![
                    Block::Figure {
                        figure: Figure::lines(
                            "t",
                            "x",
                            "y",
                            vec![Series::line("</script><b>", vec![0.0, 1.0], vec![f64::NAN, 2.0])],
                        ),
                    },
                    Block::Table {
                        table: Table { caption: "c".into(), header: vec!["h".into()], rows: vec![vec!["<i>".into()]] },
                    },
                ],
                ..Section::default()
            }],
            ..Page::default()
        };
        let html = render(&page).unwrap();
        assert!(html.contains("S &lt;01&gt;") && html.contains("&lt;i&gt;"));
        assert!(!html.contains("</script><b>"));
        assert!(html.contains("plotly.js v"), "the plotting library must be inside");
        assert!(html.len() < 6_000_000, "{} bytes", html.len());
        let own = html.replace(&plotting_script().unwrap(), "");
        assert!(!own.contains("src=\"http") && !own.contains("href=\"http"));
    }
}
