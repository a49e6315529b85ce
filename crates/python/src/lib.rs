//! Selvedge for Python, see the package's documentation.
//!
//! Each file wraps one crate; arrays go in and out as numpy's. What is wrong with an argument is told
//! by an exception that names it.

mod arrays;
mod cloth;
mod gripper;
mod reach;
mod recording;
mod scenario;
mod trajectory;
mod values;
mod worlds;

use pyo3::prelude::*;

/// The compiled part of the package `selvedge`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::cloth::{Cloth, Mesh, step_all};
    #[pymodule_export]
    use crate::gripper::{Gripper, Grippers};
    #[pymodule_export]
    use crate::reach::reach;
    #[pymodule_export]
    use crate::recording::{Recording, write_page};
    #[pymodule_export]
    use crate::scenario::{Scenario, fold_error, half_fold};
    #[pymodule_export]
    use crate::trajectory::{Schedule, Sweep, read_log, write_log};
    #[pymodule_export]
    use crate::values::{BoxVolume, Pose, PyramidVolume, Squeeze};
    #[pymodule_export]
    use crate::worlds::Worlds;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

/// A `ValueError` with an error's text.
fn value_error(error: impl std::fmt::Display) -> PyErr {
    pyo3::exceptions::PyValueError::new_err(error.to_string())
}
