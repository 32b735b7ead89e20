//! Functions of the module: those that need no pipeline.

use crate::native::text;
use crate::work::work;
use pyo3::prelude::*;
use std::path::PathBuf;

/// As `aloft effect list --json`.
#[pyfunction]
pub fn effects(py: Python<'_>, pipeline: Option<PathBuf>) -> PyResult<String> {
    work(py, None, move |_| text(&aloft_analysis::effect::list(pipeline.as_deref())?))
}

/// As `aloft effect show`: Markdown.
#[pyfunction]
pub fn show_effect(py: Python<'_>, name: String, pipeline: Option<PathBuf>) -> PyResult<String> {
    work(py, None, move |_| Ok(aloft_analysis::effect::show(&name, pipeline.as_deref())?.markdown()))
}

/// As `aloft inspect --json`.
#[pyfunction]
pub fn inspect(py: Python<'_>, file: PathBuf) -> PyResult<String> {
    work(py, None, move |_| text(&aloft_analysis::inspect::inspect(&file)?))
}

/// As `aloft init`; returns the path of the pipeline file.
#[pyfunction]
pub fn init(
    py: Python<'_>,
    folder: PathBuf,
    out: Option<PathBuf>,
    one_subject: bool,
    subject: Option<String>,
) -> PyResult<PathBuf> {
    let options = aloft_analysis::init::InitOptions { one_subject, subject };
    work(py, None, move |_| aloft_analysis::init::init(&folder, out.as_deref(), &options).map(|w| w.path))
}

/// As `aloft simulate`; returns the paths written.
#[pyfunction]
pub fn simulate(py: Python<'_>, scenario: String, out: PathBuf, seed: Option<u64>) -> PyResult<Vec<PathBuf>> {
    work(py, None, move |_| aloft_analysis::simulate::simulate(&scenario, &out, seed))
}

/// As `aloft schema`.
#[pyfunction]
pub fn schema(py: Python<'_>) -> PyResult<String> {
    work(py, None, |_| text(&aloft_study::config_schema()))
}
