//! Renders the page as HTML with one template.

use crate::pack::deflated;
use crate::{Block, Page};
use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, Value, context};
use serde::Serialize;
use std::sync::LazyLock;

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The template does not fit what it is given.
    #[error("the report's template: {0}")]
    Template(#[from] minijinja::Error),
}

/// A script of others that is compressed in the page: the browser reads it when something needs it.
struct Library {
    /// Kind of figure that needs it.
    drawn_by: &'static str,
    /// HTML of the compressed script.
    html: String,
}

/// uPlot for line charts, three.js for the player (both MIT, `vendor/README.md`).
static LIBRARIES: LazyLock<[Library; 2]> = LazyLock::new(|| {
    let library = |drawn_by, name, text: &str| {
        // the first line is the notice that the licence asks for
        let notice = text.lines().next().unwrap_or_default();
        let packed = deflated(text);
        let html =
            format!("<script type=\"text/plain\" id=\"library-{name}\" data-notice=\"{notice}\">{packed}</script>\n");
        Library { drawn_by, html }
    };
    [
        library("chart", "uplot", include_str!("../vendor/uplot.min.js")),
        library("player", "three", include_str!("../vendor/three.min.js")),
    ]
});

/// The libraries that the page uses.
fn libraries(page: &Page) -> String {
    LIBRARIES.iter().filter(|l| page.has(l.drawn_by)).map(|l| l.html.as_str()).collect()
}

/// Scripts of the page, in the order in which they need each other.
const SCRIPTS: [&str; 10] = [
    include_str!("../vendor/fflate.min.js"),
    include_str!("../templates/numbers.js"),
    include_str!("../templates/time.js"),
    include_str!("../templates/charts.js"),
    include_str!("../templates/maps.js"),
    include_str!("../templates/player_scene.js"),
    include_str!("../templates/player_gl.js"),
    include_str!("../templates/player_canvas.js"),
    include_str!("../templates/player.js"),
    include_str!("../templates/page.js"),
];

/// Number that the page's security policy asks of scripts. Text from recordings cannot contain it,
/// because it is computed from all of the text.
fn nonce(page: &Page) -> String {
    // none: a page can be written, as it is at once
    let text = serde_json::to_vec(page).ok().unwrap_or_default();
    blake3::hash(&text).to_hex()[..32].to_owned()
}

/// A judgement: its symbol, and its word if requested (`word`; `sign` where the text beside it is
/// the word). The symbols differ in shape, so that colour is not needed. In the list of chapters
/// screen readers hear `own`, or the word of the light where it is empty.
fn light(name: &str, with_word: &str, own: Option<&str>) -> Value {
    let word = if with_word != "word" || name == "neutral" {
        String::new()
    } else {
        format!("<b class=\"word {name}\">{name}</b> ")
    };
    // in running text a neutral judgement has no symbol
    let escape = |t: &str| t.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
    let spoken = escape(own.filter(|w| !w.is_empty()).unwrap_or(name));
    let sign = match (with_word.is_empty(), name) {
        (false, "neutral") => String::new(),
        (true, n) if n != "neutral" => {
            format!(
                "<svg class=\"light {name}\" role=\"img\" aria-label=\"{spoken}\"><use href=\"#light-{name}\"/></svg>"
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

/// A panel beside the chapters with its style and its script, which may talk to the server that the
/// page came from, if there is one, and to no other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Live<'a> {
    /// HTML of the panel.
    pub panel: &'a str,
    /// Style, after that of the page.
    pub style: &'a str,
    /// Script, after those of the page, whose functions it can call.
    pub script: &'a str,
    /// True if the script may talk to the server that the page came from.
    pub served: bool,
}

/// Renders the page as one HTML text without external files.
pub fn render(page: &Page) -> Result<String, ReportError> {
    render_with(page, None)
}

/// Renders the page with a panel.
pub fn render_live(page: &Page, live: &Live<'_>) -> Result<String, ReportError> {
    render_with(page, Some(live))
}

/// Renders blocks alone, for a page that is open already and has the style and the scripts.
pub fn render_blocks(blocks: &[Block]) -> Result<String, ReportError> {
    let env = environment()?;
    Ok(env.get_template("blocks.html")?.render(context! { blocks => Serde(blocks) })?)
}

fn environment() -> Result<Environment<'static>, ReportError> {
    let mut env = Environment::new();
    env.set_auto_escape_callback(|_| AutoEscape::Html);
    env.set_syntax(SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build()?);
    env.add_template("page.html", include_str!("../templates/page.html"))?;
    env.add_template("blocks.html", include_str!("../templates/blocks.html"))?;
    env.add_function("light", light);
    env.add_function("prose", prose);
    Ok(env)
}

fn render_with(page: &Page, live: Option<&Live<'_>>) -> Result<String, ReportError> {
    let env = environment()?;
    let html = env.get_template("page.html")?.render(context! {
        page => Serde(page),
        live => Serde(live),
        libraries => libraries(page),
        nonce => nonce(page),
        style => [include_str!("../vendor/uplot.min.css"), include_str!("../templates/page.css"), include_str!("../templates/figures.css"), live.map_or("", |l| l.style)].join("\n"),
        scripts => SCRIPTS.concat(),
    })?;
    Ok(html)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Animation, Cell, Chapter, Fact, Figure, Headline, Ladder, Light, Panel, Rung, Section, Series, Table, Words,
    };

    fn chapter(id: &str, blocks: Vec<Block>) -> Chapter {
        Chapter {
            id: id.into(),
            title: format!("Chapter {id}"),
            group: "Study".into(),
            light: Light::Fair,
            word: String::new(),
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

    /// The page without the libraries, which are third-party text.
    fn own(page: &Page) -> String {
        render(page).unwrap().replace(&libraries(page), "")
    }

    #[test]
    fn page_is_self_contained_and_escaped() {
        let html = render(&sample()).unwrap();
        assert!(html.contains("S &lt;01&gt;") && html.contains("&lt;i&gt;"));
        assert!(!html.contains("</script><b>"));
        assert!(html.contains("leeoniya/uPlot") && html.contains("three.js 0."), "the libraries must be inside");
        assert!(html.len() < 380_000, "{} bytes", html.len());
        for outside in [" src=", "http:", "https:", "@import", "url("] {
            assert!(!own(&sample()).contains(outside), "`{outside}` on the page");
        }
    }

    #[test]
    fn only_the_scripts_of_the_page_may_run_and_none_may_use_a_network() {
        let html = render(&sample()).unwrap();
        let policy = html.split("http-equiv=\"Content-Security-Policy\" content=\"").nth(1).unwrap();
        let policy = policy.split('"').next().unwrap();
        assert!(policy.starts_with("default-src 'none'") && !policy.contains("unsafe-eval"), "{policy}");
        let nonce = policy.split("'nonce-").nth(1).unwrap().split('\'').next().unwrap();
        assert!(nonce.len() == 32 && html.matches(&format!("<script nonce=\"{nonce}\">")).count() == 1);
        assert!(!own(&sample()).contains(" onclick="), "no script in attributes");
        assert_eq!(html, render(&sample()).unwrap(), "the same page each time");
        let other = Page { title: "another".into(), ..sample() };
        assert!(!render(&other).unwrap().contains(nonce), "another page, another number");
    }

    #[test]
    fn backticks_become_code_and_text_stays_text() {
        assert_eq!(prose("add `a<b>` & go").to_string(), "add <code>a&lt;b&gt;</code> &amp; go");
        assert_eq!(prose("one ` alone <").to_string(), "one ` alone &lt;");
    }

    #[test]
    fn lines_of_a_file_keep_their_indentation_and_are_copied_as_they_are() {
        let yaml = "corrections:\n  # 5 > 3 & \"x\"\n  plate_zero:\n    `F<1>`: {force_n: [0, 0, 1]}\n";
        let page = Page { chapters: vec![chapter("a", vec![Block::code(yaml)])], ..Page::default() };
        let html = render(&page).unwrap();
        let shown = html.split("<div class=\"lines\"><pre tabindex=\"0\"><code>").nth(1).unwrap();
        let (shown, after) = shown.split_once("</code></pre>").unwrap();
        let text = shown.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&");
        assert_eq!(text.replace("&#x2f;", "/"), yaml);
        assert!(!shown.contains('<') && after.starts_with("<button type=\"button\" class=\"copy-text\">"));
    }

    #[test]
    fn a_light_has_a_sign_and_a_word() {
        let html = render(&sample()).unwrap();
        assert!(html.contains("<use href=\"#light-poor\"/></svg><b class=\"word poor\">poor</b>"), "in the table");
        assert!(html.contains("role=\"img\" aria-label=\"fair\""), "in the list of chapters");
    }

    #[test]
    fn explanations_stand_below_names_and_a_judgement_has_one_word() {
        let rows = vec![vec![Cell::from("zero of plate").with_note("of <P>"), Cell::sign(Light::Fair, "differs")]];
        let table = Table::new("check", "", &["measured", "judged"], rows).two_at_a_time();
        let html = own(&Page { chapters: vec![chapter("a", vec![table.into()])], ..Page::default() });
        assert!(
            html.contains("zero of plate<small>of &lt;P&gt;</small>") && html.contains("figure class=\"table pair\"")
        );
        assert!(html.contains("<use href=\"#light-fair\"/></svg><b class=\"word fair\">differs</b>"));
        assert!(!html.contains("<b class=\"word fair\">fair</b>"));
    }

    #[test]
    fn only_a_live_page_may_talk_to_its_server() {
        let live = Live { panel: "<aside>p</aside>", style: ".p {}", script: "go()", served: true };
        let html = render_live(&sample(), &live).unwrap();
        assert!(html.contains("<aside>p</aside>") && html.contains("go()") && html.contains("connect-src 'self'"));
        assert!(!render(&sample()).unwrap().contains("connect-src"));
        let sent = render_live(&sample(), &Live { served: false, ..live }).unwrap();
        assert!(sent.contains("go()") && !sent.contains("connect-src"), "a page that was sent reaches nothing");
    }

    #[test]
    fn folded_blocks_are_drawn_and_chapters_lead_on() {
        let html = own(&sample());
        assert!(html.contains("<summary>more</summary>") && html.contains("class=\"drawing player\""));
        assert!(html.contains("<a rel=\"next\" href=\"#b\">Chapter b →</a>"));
        assert_eq!(html.matches("<figure").count(), html.matches("</figure>").count());
        assert_eq!(html.matches("class=\"csv\"").count(), 3, "each table and figure saves its numbers");
    }

    #[test]
    fn the_headline_and_the_ladder_are_text_and_html() {
        let headline = Headline {
            light: Light::Poor,
            word: "poor: <correct> first".into(),
            sentence: "4.4 times the floor <now>".into(),
            facts: vec![Fact { command: "aloft effect add 'tether[pelvis]'".into(), ..Fact::new("Next", "add it") }],
        };
        let rung = Rung { name: "start".into(), error: 4.0, words: "4.0 N".into(), ..Rung::default() };
        let ladder = Ladder { floor: Some(1.0), rungs: vec![rung], ..Ladder::default() };
        let blocks = vec![Block::Beside { left: vec![headline.into(), ladder.into()], right: vec![Block::text("t")] }];
        let page = Page { chapters: vec![chapter("a", blocks)], ..Page::default() };
        let html = render(&page).unwrap();
        assert!(
            html.contains("<b class=\"word poor\">poor: &lt;correct&gt; first</b>")
                && html.contains("4.4 times the floor &lt;now&gt;")
                && html.contains("aloft effect add &#x27;tether[pelvis]&#x27;")
        );
        assert!(html.contains("class=\"rung") && html.contains("left:24.51%"), "the floor at its place");
    }

    #[test]
    fn pages_carry_only_the_libraries_that_they_use() {
        let page = Page { chapters: vec![chapter("a", vec![Block::text("t")])], ..Page::default() };
        assert!(render(&page).unwrap().len() < 120_000);
    }
}
