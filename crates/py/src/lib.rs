//! The native part of the Python package `aloft` (`python/aloft` beside this folder).
//!
//! It binds functions of `aloft-analysis` and computes nothing itself. An answer is handed over as
//! the text that the command line prints with `--json`, so that both are the same to the last
//! digit; tables are handed over by the Arrow PyCapsule interface, series by numpy's array
//! interface, both without a copy. The Python part wraps these in classes with documentation and
//! types.

mod errors;
mod module;
mod native;
mod numbers;
mod places;
mod run;
mod table;
mod work;

use pyo3::prelude::*;

/// The native part of `aloft`; use the package, not this module.
#[pymodule(name = "_aloft")]
mod extension {
    #[pymodule_export]
    use super::module::{effects, init, inspect, schema, show_effect, simulate};
    #[pymodule_export]
    use super::native::Native;
    #[pymodule_export]
    use super::numbers::Numbers;
    #[pymodule_export]
    use super::table::NativeTable;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn version(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
