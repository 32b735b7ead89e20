//! XML of model files.

use crate::RobotError;

/// Parses a text, with the line of what is wrong in it.
pub(crate) fn parse<'t>(file: &str, text: &'t str) -> Result<roxmltree::Document<'t>, RobotError> {
    aloft_body::check_xml(text).map_err(|problem| RobotError::model(file, problem))?;
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..roxmltree::ParsingOptions::default() };
    roxmltree::Document::parse_with_options(text, options).map_err(|e| RobotError::Model {
        file: file.to_owned(),
        line: Some(e.pos().row),
        problem: format!("not well-formed XML: {e}"),
    })
}
