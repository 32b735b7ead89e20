//! The program's errors as Python exceptions: classes of `aloft._errors`, with message, hint and
//! place.

use aloft_workspace::error::PipelineError;
use miette::Diagnostic;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Module of the exceptions.
const MODULE: &str = "aloft._errors";

/// The exception for an error of the program.
pub fn raise(py: Python<'_>, error: &PipelineError) -> PyErr {
    if matches!(error, PipelineError::Stopped) {
        return PyKeyboardInterrupt::new_err(error.to_string());
    }
    let class = match error {
        PipelineError::Config { .. } => "ConfigError",
        PipelineError::Io { .. } => "FileError",
        PipelineError::Table { .. } | PipelineError::Damaged { .. } => "DamagedError",
        PipelineError::Locked { .. } => "LockedError",
        _ => "RequestError",
    };
    let (line, column) = place(error).unzip();
    let hint = error.help().map(|h| h.to_string());
    made(py, class, &error.to_string(), hint.as_deref(), line.zip(column)).unwrap_or_else(|e| e)
}

/// The exception for a defect of the program: a panic, with what it said.
pub fn defect(py: Python<'_>, what: &str) -> PyErr {
    let hint = "this is a defect of aloft, not of your data; please report it with this line";
    let problem = format!("stopped with an internal error: {what}");
    made(py, "DefectError", &problem, Some(hint), None).unwrap_or_else(|e| e)
}

/// An error of a table that the program made itself.
pub fn of_table(error: &impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

fn made(
    py: Python<'_>,
    class: &str,
    problem: &str,
    hint: Option<&str>,
    place: Option<(usize, usize)>,
) -> PyResult<PyErr> {
    let named = PyDict::new(py);
    named.set_item("hint", hint)?;
    named.set_item("place", place)?;
    let value = py.import(MODULE)?.getattr(class)?.call((problem,), Some(&named))?;
    Ok(PyErr::from_value(value))
}

/// Line and column of a configuration error, both from 1.
fn place(error: &PipelineError) -> Option<(usize, usize)> {
    let PipelineError::Config { text, at: Some(at), .. } = error else { return None };
    let before = text.inner().get(..at.offset())?;
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
    Some((line, column))
}
