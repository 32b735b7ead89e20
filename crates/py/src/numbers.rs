//! Columns of numbers for numpy, by the array interface: numpy reads the address and keeps the
//! object alive; nothing is copied where the values lie in one piece.

use crate::errors::of_table;
use polars::prelude::*;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A column that numpy reads with `numpy.asarray`; the array is read-only.
#[pyclass(frozen, module = "aloft._aloft")]
pub struct Numbers {
    values: Values,
}

enum Values {
    /// The table's own buffer.
    Float(Float64Chunked),
    /// The table's own buffer.
    Whole(Int64Chunked),
    /// A copy: whole numbers of which some are missing (NaN).
    Copied(Vec<f64>),
    /// A copy: Arrow packs eight truth values into one byte.
    Truth(Vec<u8>),
}

impl Numbers {
    /// The numbers of a column; a missing one is NaN.
    ///
    /// # Errors
    /// The column holds no numbers, or truth values of which some are missing.
    pub fn of(column: &Column) -> PyResult<Self> {
        let series = column.as_materialized_series().rechunk();
        let (missing, kind) = (series.null_count(), series.dtype().clone());
        let values = match kind {
            DataType::Float64 if missing == 0 => Values::Float(series.f64().map_err(|e| of_table(&e))?.clone()),
            DataType::Int64 if missing == 0 => Values::Whole(series.i64().map_err(|e| of_table(&e))?.clone()),
            DataType::Boolean if missing == 0 => {
                let truth = series.bool().map_err(|e| of_table(&e))?;
                Values::Truth(truth.iter().map(|v| u8::from(v == Some(true))).collect())
            }
            _ if kind.is_primitive_numeric() => {
                let wide = series.cast(&DataType::Float64).map_err(|e| of_table(&e))?;
                let wide = wide.f64().map_err(|e| of_table(&e))?;
                Values::Copied(wide.iter().map(|v| v.unwrap_or(f64::NAN)).collect())
            }
            _ => return Err(PyTypeError::new_err(format!("`{}` holds {kind}, not numbers", column.name()))),
        };
        Ok(Self { values })
    }
}

#[pymethods]
impl Numbers {
    /// Version 3 of numpy's array interface.
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let of = |e: PolarsError| of_table(&e);
        let (address, length, kind) = match &self.values {
            Values::Float(v) => v.cont_slice().map(|s| (s.as_ptr() as usize, s.len(), 'f')).map_err(of)?,
            Values::Whole(v) => v.cont_slice().map(|s| (s.as_ptr() as usize, s.len(), 'i')).map_err(of)?,
            Values::Copied(v) => (v.as_ptr() as usize, v.len(), 'f'),
            Values::Truth(v) => (v.as_ptr() as usize, v.len(), 'b'),
        };
        let order = if cfg!(target_endian = "big") { '>' } else { '<' };
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("shape", (length,))?;
        interface.set_item("typestr", if kind == 'b' { "|b1".to_owned() } else { format!("{order}{kind}8") })?;
        interface.set_item("data", (address, true))?;
        Ok(interface)
    }
}
