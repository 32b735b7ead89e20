//! Requirements on every report page: it is self-contained, its data can be read, and it holds the
//! expected chapters.

/// Checks a page; `chapters` are identifiers that it must contain.
pub fn check_page(html: &str, chapters: &[&str]) {
    assert!(html.len() < 10_000_000, "{} bytes", html.len());
    let own = without_plotting_library(html);
    for outside in ["http:", "https:", " src=", "@import", "url(", "<link"] {
        assert!(!own.contains(outside), "`{outside}` in the page: it must need nothing from outside");
    }
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
    for tag in ["article", "section", "figure", "table", "tr", "td", "details", "ul", "li", "nav", "main"] {
        let (open, close) = (
            own.matches(&format!("<{tag}>")).count() + own.matches(&format!("<{tag} ")).count(),
            own.matches(&format!("</{tag}>")).count(),
        );
        assert_eq!(open, close, "<{tag}> opened and closed");
    }
    let data = figures(&own);
    assert!(!data.is_empty());
    for f in &data {
        if f["data"].is_array() {
            units(f);
        }
    }
}

/// The page without the plotting library, which is third-party text: the only script longer than a
/// megabyte.
fn without_plotting_library(html: &str) -> String {
    let start =
        html.find("<script type=\"text/plain\" id=\"plotting-library\">").expect("the plotting library is inside");
    let end = start + html[start..].find("</script>").unwrap();
    assert!(end - start > 1_000_000, "the plotting library is whole");
    [&html[..start], &html[end..]].concat()
}

fn attributes(html: &str, before: &str) -> Vec<String> {
    html.split(before).skip(1).map(|rest| rest.split('"').next().unwrap().to_owned()).collect()
}

/// The data of all figures.
pub fn figures(html: &str) -> Vec<serde_json::Value> {
    html.split("<script type=\"application/json\">")
        .skip(1)
        .map(|rest| serde_json::from_str(rest.split("</script>").next().unwrap()).expect("figure data is JSON"))
        .collect()
}

/// Checks that every axis of a chart has a title, with a unit if it is a quantity.
fn units(figure: &serde_json::Value) {
    let layout = figure["layout"].as_object().unwrap();
    let heat = figure["data"][0]["type"] == "heatmap";
    for (key, axis) in layout.iter().filter(|(k, _)| k.starts_with("xaxis") || k.starts_with("yaxis")) {
        let title = axis["title"]["text"].as_str().unwrap_or_default();
        let names = !axis["ticktext"].is_null() || heat;
        let hidden = axis["showticklabels"] == false;
        assert!(!title.is_empty() || names || hidden, "{key} has no title: {}", figure["panels"]);
    }
}
