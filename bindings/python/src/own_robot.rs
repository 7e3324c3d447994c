//! Facts of a robot that its law knows before its constructor runs.

use std::sync::Arc;

use protocol::brief::AgentBrief;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// An in-neighbor of the robot, whether or not it was heard yet.
#[pyclass(frozen, skip_from_py_object, module = "phalanx")]
#[derive(Clone)]
pub struct InNeighbor {
    #[pyo3(get)]
    name: String,
    #[pyo3(get)]
    index: usize,
    #[pyo3(get)]
    offset: (f64, f64),
    params: Arc<toml::Table>,
}

#[pymethods]
impl InNeighbor {
    /// Returns the parameters of the edge from this robot.
    #[getter]
    fn params<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dict(py, &self.params)
    }

    fn __repr__(&self) -> String {
        format!("InNeighbor({}, index={}, offset={:?})", self.name, self.index, self.offset)
    }
}

/// The robot of a law.
#[pyclass(frozen, get_all, module = "phalanx")]
pub struct OwnRobot {
    name: String,
    index: usize,
    law: String,
    incarnation: u64,
    seed: u64,
    neighbors: Vec<InNeighbor>,
    place: Option<(f64, f64)>,
    goal: Option<(f64, f64)>,
    params: Py<PyDict>,
    front_point_m: f64,
    limits: Option<Py<PyAny>>,
    distance_min_m: f64,
    speed_max_m_s: f64,
    sensing_radius_m: f64,
    period_s: f64,
    pace: &'static str,
}

impl OwnRobot {
    /// Creates the description of the robot of this brief.
    pub fn new(py: Python<'_>, brief: &AgentBrief, incarnation: u64) -> PyResult<OwnRobot> {
        let neighbors = brief.neighbors.iter().map(|neighbor| InNeighbor {
            name: neighbor.name.clone(),
            index: neighbor.index,
            offset: neighbor.offset_m.into(),
            params: Arc::new(neighbor.params.clone()),
        });
        let limits = brief.limits.map(|limits| {
            let numbers =
                (limits.acceleration_m_s2, limits.turn_acceleration_rad_s2, limits.braking_time_s);
            Ok::<_, PyErr>(py.import("phalanx")?.getattr("Limits")?.call1(numbers)?.unbind())
        });
        Ok(OwnRobot {
            name: brief.name.clone(),
            index: brief.index,
            law: brief.law.clone(),
            incarnation,
            seed: brief.seed,
            neighbors: neighbors.collect(),
            place: brief.place_m.map(Into::into),
            goal: brief.goal_m.map(Into::into),
            params: dict(py, &brief.params)?.unbind(),
            front_point_m: brief.front_point_m,
            limits: limits.transpose()?,
            distance_min_m: brief.avoidance.distance_min_m,
            speed_max_m_s: brief.avoidance.speed_max_m_s,
            sensing_radius_m: brief.avoidance.sensing_radius_m,
            period_s: brief.period_ns as f64 / 1e9,
            pace: brief.pace.keyword(),
        })
    }
}

#[pymethods]
impl OwnRobot {
    fn __repr__(&self) -> String {
        format!("OwnRobot({}, index={}, law={:?})", self.name, self.index, self.law)
    }
}

/// Returns a TOML value as a Python object.
fn object<'py>(py: Python<'py>, value: &toml::Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        toml::Value::String(text) => text.into_pyobject(py)?.into_any(),
        toml::Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        toml::Value::Float(number) => number.into_pyobject(py)?.into_any(),
        toml::Value::Boolean(truth) => truth.into_pyobject(py)?.to_owned().into_any(),
        toml::Value::Datetime(date) => date.to_string().into_pyobject(py)?.into_any(),
        toml::Value::Array(values) => {
            let values =
                values.iter().map(|value| object(py, value)).collect::<PyResult<Vec<_>>>()?;
            PyList::new(py, values)?.into_any()
        }
        toml::Value::Table(table) => dict(py, table)?.into_any(),
    })
}

/// Returns a TOML table as a dict of its own.
pub fn dict<'py>(py: Python<'py>, table: &toml::Table) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (key, value) in table {
        dict.set_item(key, object(py, value)?)?;
    }
    Ok(dict)
}
