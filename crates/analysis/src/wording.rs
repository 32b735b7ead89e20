//! Words for readers, where they differ from those of JSON and YAML.

/// A model of the comparison: `prior` in JSON is `tables` for readers, on every surface.
pub fn model_word(model: &str) -> &str {
    if model == "prior" { "tables" } else { model }
}

/// A unit in readable form: `m^2` becomes m², `N*s/m` becomes N·s/m; `1` becomes empty.
pub fn unit(u: &str) -> String {
    if u == "1" { String::new() } else { u.replace("^2", "²").replace("^3", "³").replace('*', "·") }
}
