//! Renders the page as HTML with one template.

use crate::Page;
use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, Value, context};

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The template does not fit what it is given.
    #[error("the report's template: {0}")]
    Template(#[from] minijinja::Error),
}

/// plotly.js, the bundle with Cartesian charts only (MIT, `vendor/plotly-LICENSE`).
const PLOTLY: &str = include_str!("../vendor/plotly-cartesian.min.js");

/// The plotting library as text: the browser parses it only when a chart comes into view.
fn plotting_script() -> String {
    format!("<script type=\"text/plain\" id=\"plotting-library\">{PLOTLY}</script>")
}

/// A judgement: its symbol, and its word if requested. The symbols differ in shape, so that colour
/// is not needed.
fn light(name: &str, with_word: &str) -> Value {
    let word = if with_word.is_empty() || name == "neutral" {
        String::new()
    } else {
        format!("<b class=\"word {name}\">{name}</b> ")
    };
    // in a list the word is included for screen readers; in running text a neutral judgement has no
    // symbol
    let sign = match (with_word.is_empty(), name) {
        (false, "neutral") => String::new(),
        (true, n) if n != "neutral" => {
            format!(
                "<svg class=\"light {name}\" role=\"img\" aria-label=\"{name}\"><use href=\"#light-{name}\"/></svg>"
            )
        }
        _ => format!("<svg class=\"light {name}\" aria-hidden=\"true\"><use href=\"#light-{name}\"/></svg>"),
    };
    Value::from_safe_string(format!("{sign}{word}"))
}

/// Text in which parts between backticks are set as code.
fn prose(text: &str) -> Value {
    let escape = |t: &str| t.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;");
    let parts: Vec<&str> = text.split('`').collect();
    let paired = parts.len() % 2 == 1;
    let set =
        |(i, part): (usize, &&str)| if i % 2 == 1 { format!("<code>{}</code>", escape(part)) } else { escape(part) };
    Value::from_safe_string(if paired { parts.iter().enumerate().map(set).collect() } else { escape(text) })
}

/// Renders the page as one HTML text without external files.
pub fn render(page: &Page) -> Result<String, ReportError> {
    let mut env = Environment::new();
    env.set_auto_escape_callback(|_| AutoEscape::Html);
    env.set_syntax(SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build()?);
    env.add_template("page.html", include_str!("../templates/page.html"))?;
    env.add_template("blocks.html", include_str!("../templates/blocks.html"))?;
    env.add_function("light", light);
    env.add_function("prose", prose);
    // include the plotting library only if there are charts: pages without charts stay small
    let charts = page.has("chart");
    let html = env.get_template("page.html")?.render(context! {
        page => Serde(page),
        plotting_script => if charts { plotting_script() } else { String::new() },
        style => include_str!("../templates/page.css"),
        scripts => [
            include_str!("../templates/numbers.js"),
            include_str!("../templates/charts.js"),
            include_str!("../templates/player.js"),
            include_str!("../templates/page.js"),
        ].concat(),
    })?;
    Ok(html)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Animation, Block, Cell, Chapter, Figure, Light, Panel, Section, Series, Table, Words};

    fn chapter(id: &str, blocks: Vec<Block>) -> Chapter {
        Chapter {
            id: id.into(),
            title: format!("Chapter {id}"),
            group: "Study".into(),
            light: Light::Fair,
            sections: vec![Section::new(format!("{id}-s"), "Section", "What it says.", blocks)],
        }
    }

    fn sample() -> Page {
        let panel = Panel {
            y: "N".into(),
            series: vec![Series::line("</script><b>", vec![0.0, 1.0], vec![f64::NAN, 2.0])],
            ..Panel::default()
        };
        let figure = Figure::panels(Words::new("curve", "look"), "time, s", 1, &[panel], &[]);
        let player = Figure::animation(Words::new("player", ""), &Animation::default());
        let table = Table::new(
            "table",
            "",
            &["trial", "value"],
            vec![vec![Cell::light(Light::Poor, "<i>").to("#b"), Cell::from("1.5")]],
        );
        Page {
            title: "S <01>".into(),
            chapters: vec![
                chapter("a", vec![figure.into(), table.into()]),
                chapter("b", vec![Block::Folded { title: "more".into(), blocks: vec![player.into()] }]),
            ],
            ..Page::default()
        }
    }

    #[test]
    fn page_is_self_contained_and_escaped() {
        let html = render(&sample()).unwrap();
        assert!(html.contains("S &lt;01&gt;") && html.contains("&lt;i&gt;"));
        assert!(!html.contains("</script><b>"));
        assert!(html.contains("plotly.js (cartesian"), "the plotting library must be inside");
        assert!(html.len() < 6_000_000, "{} bytes", html.len());
        let own = html.replace(&plotting_script(), "");
        for outside in ["src=", "http:", "https:", "@import", "url("] {
            assert!(!own.contains(outside), "`{outside}` on the page");
        }
    }

    #[test]
    fn backticks_become_code_and_text_stays_text() {
        assert_eq!(prose("add `a<b>` & go").to_string(), "add <code>a&lt;b&gt;</code> &amp; go");
        assert_eq!(prose("one ` alone <").to_string(), "one ` alone &lt;");
    }

    #[test]
    fn a_light_has_a_sign_and_a_word() {
        let html = render(&sample()).unwrap();
        assert!(html.contains("<use href=\"#light-poor\"/></svg><b class=\"word poor\">poor</b>"), "in the table");
        assert!(html.contains("role=\"img\" aria-label=\"fair\""), "in the list of chapters");
    }

    #[test]
    fn folded_blocks_are_drawn_and_chapters_lead_on() {
        let html = render(&sample()).unwrap();
        assert!(html.contains("<summary>more</summary>") && html.contains("class=\"drawing player\""));
        assert!(html.contains("<a rel=\"next\" href=\"#b\">Chapter b →</a>"));
        assert_eq!(html.matches("<figure").count(), html.matches("</figure>").count());
        assert_eq!(html.matches("class=\"csv\"").count(), 3, "each table and figure saves its numbers");
    }

    #[test]
    fn pages_without_charts_do_not_carry_the_plotting_library() {
        let page = Page { chapters: vec![chapter("a", vec![Block::text("t")])], ..Page::default() };
        assert!(render(&page).unwrap().len() < 60_000);
    }
}
