//! numpy arrays as slices and back.

use glam::DVec3;
use numpy::prelude::*;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Positions (N, 3): those of a float64 array where they are, those of a float32 array converted.
pub(crate) enum Points<'py> {
    Borrowed(PyReadonlyArray2<'py, f64>),
    Converted(Vec<DVec3>),
}

impl<'py> Points<'py> {
    /// Reads an argument.
    pub(crate) fn read(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        if let Ok(array) = value.cast::<PyArray2<f64>>() {
            let array = array.try_readonly().map_err(|_| in_use(name))?;
            check_shape(name, array.shape())?;
            let flat = in_order(name, &array)?;
            finite(name, bytemuck::cast_slice(flat))?;
            return Ok(Self::Borrowed(array));
        }
        if let Ok(array) = value.cast::<PyArray2<f32>>() {
            let array = array.try_readonly().map_err(|_| in_use(name))?;
            check_shape(name, array.shape())?;
            let flat = in_order(name, &array)?;
            let points = flat.chunks_exact(3);
            let points: Vec<DVec3> = points
                .map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()))
                .collect();
            finite(name, &points)?;
            return Ok(Self::Converted(points));
        }
        Err(PyTypeError::new_err(format!(
            "{name}: must be a float64 or float32 array of shape (N, 3), is {}",
            described(value)
        )))
    }

    pub(crate) fn get(&self) -> &[DVec3] {
        match self {
            Self::Borrowed(array) => array
                .as_slice()
                .map(bytemuck::cast_slice)
                .unwrap_or_default(),
            Self::Converted(points) => points,
        }
    }
}

/// The number of rows of an (N, 3) array of floats, without looking at them.
pub(crate) fn node_count(name: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let shape = if let Ok(array) = value.cast::<PyArray2<f64>>() {
        array.shape()
    } else if let Ok(array) = value.cast::<PyArray2<f32>>() {
        array.shape()
    } else {
        return Points::read(name, value).map(|points| points.get().len());
    };
    check_shape(name, shape)?;
    Ok(shape[0])
}

fn check_shape(name: &str, shape: &[usize]) -> PyResult<()> {
    match shape {
        [_, 3] => Ok(()),
        _ => Err(PyValueError::new_err(format!(
            "{name}: shape is {shape:?}, must be (N, 3)"
        ))),
    }
}

fn finite(name: &str, points: &[DVec3]) -> PyResult<()> {
    match points.iter().position(|point| !point.is_finite()) {
        None => Ok(()),
        Some(row) => Err(PyValueError::new_err(format!(
            "{name}: row {row} is {}, must be finite",
            points[row]
        ))),
    }
}

fn not_contiguous(name: &str) -> PyErr {
    PyValueError::new_err(format!(
        "{name}: must be in C order without gaps (numpy.ascontiguousarray makes it so)"
    ))
}

/// The numbers row by row; numpy's own accessor also hands out those of a Fortran array, by columns.
fn in_order<'a, T: numpy::Element>(
    name: &str,
    array: &'a PyReadonlyArray2<'_, T>,
) -> PyResult<&'a [T]> {
    match array.as_slice() {
        Ok(values) if array.is_c_contiguous() => Ok(values),
        _ => Err(not_contiguous(name)),
    }
}

fn in_use(name: &str) -> PyErr {
    PyValueError::new_err(format!("{name}: is being written to elsewhere"))
}

fn described(value: &Bound<'_, PyAny>) -> String {
    let kind = value.get_type().name().map(|name| name.to_string());
    let kind = kind.unwrap_or_else(|_| "unknown".into());
    let field = |name: &str| value.getattr(name).map(|found| found.to_string());
    match (field("dtype"), field("shape")) {
        (Ok(dtype), Ok(shape)) => format!("{dtype} of shape {shape}"),
        _ => kind,
    }
}

/// Faces or edges (F, K) of any integer type.
pub(crate) fn indices<const K: usize>(
    name: &str,
    value: &Bound<'_, PyAny>,
) -> PyResult<Vec<[u32; K]>> {
    macro_rules! of {
        ($($kind:ty),*) => {$(
            if let Ok(array) = value.cast::<PyArray2<$kind>>() {
                let array = array.try_readonly().map_err(|_| in_use(name))?;
                if array.shape()[1] != K {
                    return Err(PyValueError::new_err(format!(
                        "{name}: shape is {:?}, must be (F, {K})", array.shape()
                    )));
                }
                let flat = in_order(name, &array)?;
                let index = |value: &$kind| u32::try_from(*value).map_err(|_| {
                    PyValueError::new_err(format!("{name}: {value}, must be a node's number"))
                });
                let rows = flat.chunks_exact(K);
                return rows.map(|row| {
                    let mut face = [0; K];
                    for (to, from) in face.iter_mut().zip(row) {
                        *to = index(from)?;
                    }
                    Ok(face)
                }).collect();
            }
        )*};
    }
    of!(u32, i32, i64, u64);
    Err(PyTypeError::new_err(format!(
        "{name}: must be an integer array of shape (F, {K}), is {}",
        described(value)
    )))
}

/// Faces (F, 4) or (F, 3), or none.
pub(crate) type Faces = (Vec<[u32; 4]>, Vec<[u32; 3]>);

/// Reads faces, of four or of three corners.
pub(crate) fn faces(name: &str, value: Option<&Bound<'_, PyAny>>) -> PyResult<Faces> {
    let Some(value) = value.filter(|value| !value.is_none()) else {
        return Ok((Vec::new(), Vec::new()));
    };
    let shape: Vec<usize> = value
        .getattr("shape")
        .and_then(|shape| shape.extract())
        .unwrap_or_default();
    match shape[..] {
        [_, 3] => Ok((Vec::new(), indices(name, value)?)),
        [_, 4] => Ok((indices(name, value)?, Vec::new())),
        _ => Err(PyValueError::new_err(format!(
            "{name}: is {}, must be integers of shape (F, 3) or (F, 4)",
            described(value)
        ))),
    }
}

/// A new (N, 3) array.
pub(crate) fn points_out<'py>(
    py: Python<'py>,
    points: &[DVec3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let array = PyArray2::zeros(py, [points.len(), 3], false);
    array
        .try_readwrite()
        .map_err(|error| PyValueError::new_err(error.to_string()))?
        .as_slice_mut()?
        .copy_from_slice(bytemuck::cast_slice(points));
    Ok(array)
}

/// A new (F, K) array.
pub(crate) fn rows_out<'py, const K: usize>(
    py: Python<'py>,
    rows: &[[u32; K]],
) -> PyResult<Bound<'py, PyArray2<u32>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), K])
}

/// A new (A, B, C) array.
pub(crate) fn cube_out<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    shape: [usize; 3],
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}
