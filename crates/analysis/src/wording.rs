//! Words for readers, where they differ from those of JSON and YAML.

/// A model of the comparison: `prior` in JSON is `tables` for readers, on every surface.
pub fn model_word(model: &str) -> &str {
    if model == "prior" { "tables" } else { model }
}
