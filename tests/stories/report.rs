//! Requirements on every report page: it is self-contained, its data can be read, and it holds the
//! expected chapters.

/// Most bytes of a page without its recordings.
const MOST_BYTES: usize = 1_500_000;

/// Checks a page; `chapters` are identifiers that it must contain.
pub fn check_page(html: &str, chapters: &[&str]) {
    let recordings: usize = texts(html).iter().filter(|t| !recording(t).is_empty()).map(|t| t.len()).sum();
    assert!(html.len() - recordings <= MOST_BYTES, "{} bytes, {recordings} of them recordings", html.len());
    assert!(!html.contains("plotly"), "a library that the page does not need");
    let own = without_libraries(html);
    for outside in ["http:", "https:", " src=", "@import", "url(", "<link"] {
        assert!(!own.contains(outside), "`{outside}` in the page: it must need nothing from outside");
    }
    assert!(own.contains("content=\"default-src 'none'; script-src 'nonce-"), "the page may not use a network");
    let ids = attributes(&own, " id=\"");
    for chapter in chapters {
        assert!(own.contains(&format!("<article class=\"chapter\" id=\"{chapter}\"")), "no chapter {chapter}: {ids:?}");
    }
    let mut once = ids.clone();
    once.sort_unstable();
    once.dedup();
    assert_eq!(once.len(), ids.len(), "an identifier twice: {ids:?}");
    for link in attributes(&own, "href=\"#") {
        assert!(ids.contains(&link), "a link leads nowhere: #{link}");
    }
    for tag in ["article", "section", "figure", "table", "tr", "td", "details", "ul", "ol", "li", "nav", "main", "div"]
    {
        let (open, close) = (
            own.matches(&format!("<{tag}>")).count() + own.matches(&format!("<{tag} ")).count(),
            own.matches(&format!("</{tag}>")).count(),
        );
        assert_eq!(open, close, "<{tag}> opened and closed");
    }
    first_screen(&own);
    let data = figures(&own);
    assert!(!data.is_empty());
    data.iter().filter(|f| f["kind"] == "chart").for_each(units);
}

/// The first section of the page answers: a sentence with its signal, and what a reader asks next.
fn first_screen(html: &str) {
    let start = html.find("<section id=\"result\"").expect("the first section");
    let first = &html[start..start + html[start..].find("</section>").unwrap()];
    let sentence = first.split("<p class=\"sentence\">").nth(1).expect("a sentence").split("</p>").next().unwrap();
    assert!(sentence.contains("<span>") && sentence.len() > 20, "{sentence}");
    for question in ["<dt>Missing</dt>", "<dt>How sure</dt>"] {
        assert!(first.contains(question), "{question} is not answered first");
    }
}

/// The signal of the headline: `good`, `fair`, `poor` or `neutral`.
pub fn signal(html: &str) -> String {
    html.split("<div class=\"headline ").nth(1).unwrap().split('"').next().unwrap().to_owned()
}

/// The page without the libraries, which are third-party text.
fn without_libraries(html: &str) -> String {
    let mut out = html.to_owned();
    while let Some(start) = out.find("<script type=\"text/plain\" id=\"library-") {
        let end = start + out[start..].find("</script>").unwrap();
        out.replace_range(start..end + "</script>".len(), "");
    }
    out
}

/// The recording that a figure belongs to; empty for none.
fn recording(text: &str) -> String {
    let data: serde_json::Value = serde_json::from_str(text).expect("figure data is JSON");
    data["recording"].as_str().unwrap_or_default().to_owned()
}

fn texts(html: &str) -> Vec<&str> {
    let parts = html.split("<script type=\"application/json\">").skip(1);
    parts.map(|rest| rest.split("</script>").next().unwrap()).collect()
}

fn attributes(html: &str, before: &str) -> Vec<String> {
    html.split(before).skip(1).map(|rest| rest.split('"').next().unwrap().to_owned()).collect()
}

/// The data of all figures.
pub fn figures(html: &str) -> Vec<serde_json::Value> {
    texts(html).into_iter().map(|t| serde_json::from_str(t).expect("figure data is JSON")).collect()
}

/// Checks that every axis of a chart has a title, with a unit if it is a quantity.
fn units(figure: &serde_json::Value) {
    assert!(!figure["x"].as_str().unwrap_or_default().is_empty(), "no title of the abscissa: {figure}");
    for panel in figure["panels"].as_array().unwrap() {
        assert!(!panel["y"].as_str().unwrap_or_default().is_empty(), "no unit in {}", panel["title"]);
    }
}
