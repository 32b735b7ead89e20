//! Tables for Python: polars frames behind the Arrow PyCapsule interface. Consumers share the
//! buffers of numbers; nothing is copied. Text is converted to the layout that every consumer
//! knows.

use crate::errors::of_table;
use crate::numbers::Numbers;
use polars::prelude::*;
use polars_arrow::array::{Array, StructArray};
use polars_arrow::datatypes::{ArrowDataType, Field as ArrowField};
use polars_arrow::ffi::{export_field_to_c, export_iterator};
use pyo3::exceptions::{PyKeyError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use std::path::PathBuf;

/// `CompatLevel::oldest` writes text as `large_utf8`, which every consumer reads; numbers have one
/// layout only.
fn level() -> CompatLevel {
    CompatLevel::oldest()
}

/// A table in memory.
#[pyclass(frozen, module = "aloft._aloft")]
pub struct NativeTable {
    frame: DataFrame,
}

#[pymethods]
impl NativeTable {
    /// Reads a Parquet file of the workspace.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let frame =
            py.detach(|| aloft_workspace::table::read_frame(&path)).map_err(|e| crate::errors::raise(py, &e))?;
        Ok(Self { frame })
    }

    /// A table from columns: name, kind (`bool`, `int`, `float`, `str`) and values, None where a
    /// value is missing.
    #[staticmethod]
    fn of(columns: Vec<(String, String, Bound<'_, PyAny>)>) -> PyResult<Self> {
        let mut made = Vec::with_capacity(columns.len());
        for (name, kind, values) in columns {
            let name = PlSmallStr::from(name);
            made.push(match kind.as_str() {
                "bool" => Column::new(name, values.extract::<Vec<Option<bool>>>()?),
                "int" => Column::new(name, values.extract::<Vec<Option<i64>>>()?),
                "float" => Column::new(name, values.extract::<Vec<Option<f64>>>()?),
                "str" => Column::new(name, values.extract::<Vec<Option<String>>>()?),
                other => return Err(PyTypeError::new_err(format!("no column of kind {other}"))),
            });
        }
        let height = made.first().map_or(0, Column::len);
        Ok(Self { frame: DataFrame::new(height, made).map_err(|e| of_table(&e))? })
    }

    /// Names of the columns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.frame.get_column_names().iter().map(ToString::to_string).collect()
    }

    fn __len__(&self) -> usize {
        self.frame.height()
    }

    /// One column of numbers, for numpy.
    fn numbers(&self, name: &str) -> PyResult<Numbers> {
        Numbers::of(self.column(name)?)
    }

    /// The values of a column as Python objects, None where one is missing; the kind of the column
    /// is `text` if it cannot be an array.
    fn texts(&self, name: &str) -> PyResult<Option<Vec<Option<String>>>> {
        let column = self.column(name)?;
        // none: a column of another kind
        let Ok(text) = column.str() else { return Ok(None) };
        Ok(Some(text.iter().map(|v| v.map(str::to_owned)).collect()))
    }

    /// The Arrow C schema: a struct of the columns.
    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let field = ArrowField::new(PlSmallStr::EMPTY, self.layout(), false);
        PyCapsule::new_with_value(py, export_field_to_c(&field), c"arrow_schema")
    }

    /// The Arrow C stream of the table. A consumer that asks for another schema converts itself, as
    /// the interface permits.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        drop(requested_schema);
        let layout = self.layout();
        let chunks: Vec<PolarsResult<Box<dyn Array>>> = self
            .frame
            .iter_chunks(level(), false)
            .map(|batch| {
                let rows = batch.len();
                StructArray::try_new(layout.clone(), rows, batch.into_arrays(), None).map(StructArray::boxed)
            })
            .collect();
        let field = ArrowField::new(PlSmallStr::EMPTY, layout, false);
        let stream = export_iterator(Box::new(chunks.into_iter()), field);
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }
}

impl NativeTable {
    fn column(&self, name: &str) -> PyResult<&Column> {
        self.frame.column(name).map_err(|_| PyKeyError::new_err(name.to_owned()))
    }

    fn layout(&self) -> ArrowDataType {
        let fields =
            self.frame.schema().iter().map(|(name, kind)| kind.to_arrow_field(name.clone(), level())).collect();
        ArrowDataType::Struct(fields)
    }
}
